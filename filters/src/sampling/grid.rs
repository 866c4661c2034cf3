//! Grid: every n-th pixel of every n-th row, as for upscaling by a whole factor.
//!
//! The density is 1 / n^2, the nearest one to D that squares allow, and not D itself.
//! Anchored to absolute coordinates: the pixels with `x = a`, `y = b` modulo n; seed 0 and frame 0 have a = b = 0. Frames
//! k = 0, 1, ... run through all n^2 offsets, each next one far from those before, and so do seeds.
//!
//! Properties: best hole size for its count, worst spectrum: all energy in a few peaks, so that detail beyond them
//! aliases into patterns. Not progressive. Cost: two divisions a pixel. Fails: only 1, 1/4, 1/9, ... can be had.

use super::{Field, checked};
use crate::{Error, Mask};

/// The mask of one frame.
///
/// # Errors
/// [`Error::Setting`] if the density is outside 0 to 1.
pub fn mask(field: Field, density: f64, seed: u64, frame: i64) -> Result<Mask, Error> {
    let density = checked(density)?;
    let step = step(density);
    let Some(step) = step else { return Ok(field.mask(|_, _| false)) };
    let (a, b) = offset(step, seed, frame);
    Ok(field.mask(|row, column| {
        let (x, y) = field.at(row, column);
        i64::from(x).rem_euclid(step) == a && i64::from(y).rem_euclid(step) == b
    }))
}

/// The step in pixels; nothing at density 0.
fn step(density: f64) -> Option<i64> {
    let least = (density > 0.0).then(|| density.recip().sqrt().floor().min(f64::from(i32::MAX)))?;
    let off = |step: f64| (step.powi(-2) - density).abs();
    Some(if off(least) < off(least + 1.0) { least } else { least + 1.0 } as i64)
}

/// The place of a frame within the step x step block.
fn offset(step: i64, seed: u64, frame: i64) -> (i64, i64) {
    let count = step * step;
    // A stride near the golden share of the block, coprime with it, visits all places far apart.
    let golden = (count as f64 * 0.618_033_988_749_894_9).round().max(1.0) as i64;
    let stride = (golden..=golden + count).find(|&stride| gcd(stride, count) == 1).unwrap_or(1);
    let steps = i128::from(seed) + i128::from(frame.rem_euclid(count));
    let place = (steps % i128::from(count) * i128::from(stride) % i128::from(count)) as i64;
    (place % step, place / step)
}

fn gcd(a: i64, b: i64) -> i64 {
    if b == 0 { a } else { gcd(b, a % b) }
}

#[cfg(test)]
mod tests {
    use std::collections::BTreeSet;

    use super::*;
    use crate::Size;

    #[test]
    fn steps_are_the_next_squares() {
        for (density, expected) in
            [(1.0, 1), (0.63, 1), (0.5, 2), (0.25, 2), (0.2, 2), (0.17, 3), (0.1, 3), (0.05, 5), (0.01, 10)]
        {
            assert_eq!(step(density), Some(expected), "{density}");
        }
        assert_eq!(step(0.0), None);
    }

    #[test]
    fn is_anchored_to_absolute_pixels() {
        let field = Field { x: -5, y: 3, size: Size::new(20, 30) };
        let mask = mask(field, 0.1, 0, 0).unwrap();
        for row in 0..20 {
            for column in 0..30 {
                let (x, y) = field.at(row, column);
                assert_eq!(mask.is_measured(row, column), x % 3 == 0 && y % 3 == 0);
            }
        }
    }

    #[test]
    fn offsets_visit_every_place_once() {
        for step in 1..12 {
            let frames: BTreeSet<_> = (0..step * step).map(|frame| offset(step, 9, frame)).collect();
            let seeds: BTreeSet<_> = (0..step * step).map(|seed| offset(step, seed as u64, 0)).collect();
            assert_eq!([frames.len() as i64, seeds.len() as i64], [step * step; 2]);
            assert_eq!(offset(step, 0, 0), (0, 0));
        }
    }
}
