//! Changes from frame to frame that motion does not explain: of light, of a translucent body behind a surface, by a motion that is a little off.
//!
//! Over a few frames such changes are about linear in time. So the differences between samples and an image, of each plane and around each place, are
//! regressed on how many frames later they were measured; what goes with it is taken away, and what does not, which is what the image lacks, stays.
//! Weights: a Gaussian of two pixels, and one over the distance in time.
//!
//! Cost: sums over the samples, and Gaussians over a quarter of the pixels.

use lacuna_core::parallel::prelude::*;

use super::carried::pixel;
use super::{Carried, PIECE};
use crate::Size;
use crate::kernel::blur::blur;

/// Side of the blocks of pixels that have a change of their own.
const BLOCK: usize = 2;
/// Standard deviation of the Gaussian, in blocks.
const SPREAD: f64 = 1.0;
/// The least part of the offsets' mean square that is variance: below, all lie on one side, and little is known of the change.
const RIDGE: f32 = 0.02;

/// Takes what changes linearly with time away from the differences between samples and an image of that size; of each frame they are sample
/// by sample, and plane by plane within these. None of them counts for more than `most`.
pub fn take_away(
    size: Size,
    carried: &[Carried],
    differences: &mut [Vec<f32>],
    (planes, most): (usize, f32),
) {
    let blocks = Size::new(size.height.div_ceil(BLOCK), size.width.div_ceil(BLOCK));
    let block = |place: &[f32; 2]| {
        let at = pixel(size, *place);
        (at / size.width / BLOCK * blocks.width + at % size.width / BLOCK) as u32
    };
    let places: Vec<Vec<u32>> =
        carried.iter().map(|carried| carried.places.par_iter().with_min_len(PIECE).map(block)).collect();
    // The weighted sum around each block of a power of the offset and, if one is named, the difference in a plane.
    let sum = |power: usize, plane: Option<usize>| {
        let mut sums = vec![0.0; blocks.pixels()];
        for ((carried, places), differences) in carried.iter().zip(&places).zip(&*differences) {
            let weight = (carried.offset as f32).powi(power as i32) / carried.distance() as f32;
            for (i, at) in places.iter().enumerate() {
                let difference = |plane: usize| differences[i * planes + plane].clamp(-most, most);
                sums[*at as usize] += weight * plane.map_or(1.0, difference);
            }
        }
        blur(blocks, &sums, SPREAD)
    };
    let powers = (0..3).into_par_iter().with_max_len(1).map(|power| sum(power, None));
    let change = |plane: usize| -> Vec<f32> {
        let [all, later] = [0, 1].map(|power| sum(power, Some(plane)));
        let one = |at: usize| {
            let [count, mean, square] = [0, 1, 2].map(|power| powers[power][at]);
            let variance = count * square - mean * mean + RIDGE * count * square;
            let change = (count * later[at] - mean * all[at]) / variance;
            if change.is_finite() { change } else { 0.0 }
        };
        (0..blocks.pixels()).map(one).collect()
    };
    let changes = (0..planes).into_par_iter().with_max_len(1).map(change);
    for ((carried, places), differences) in carried.iter().zip(&places).zip(differences) {
        let offset = carried.offset as f32;
        let samples = differences.par_chunks_mut(planes.max(1)).zip(places).with_min_len(PIECE);
        samples.for_each(|(differences, at)| {
            for (difference, change) in differences.iter_mut().zip(&changes) {
                *difference -= offset * change[*at as usize];
            }
        });
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{Mask, Planes};
    use lacuna_core::hash;

    const SIZE: Size = Size::new(23, 30);

    /// A tenth of the pixels of frames that are so many frames later, each moved by a part of a pixel.
    fn frames(offsets: &[i32]) -> Vec<Carried> {
        let frame = |&offset: &i32| {
            let at = |y: usize, x: usize| hash(offset as u64, (y * SIZE.width + x) as u64).is_multiple_of(10);
            let place = |at: usize| {
                let [y, x] = [at / SIZE.width, at % SIZE.width].map(|at| at as f32);
                [y + 0.3 * offset as f32, x - 0.2 * offset as f32]
            };
            Carried::new(SIZE, (&Planes::zeros(SIZE, 2), &Mask::from_fn(SIZE, at)), offset, place).unwrap()
        };
        offsets.iter().map(frame).collect()
    }

    /// What a function of the place, the offset and the plane gives.
    fn differences(carried: &[Carried], value: impl Fn([f32; 2], f32, usize) -> f32) -> Vec<Vec<f32>> {
        let one = |carried: &Carried| {
            let sample = |place: &[f32; 2]| [0, 1].map(|plane| value(*place, carried.offset as f32, plane));
            carried.places.iter().flat_map(sample).collect()
        };
        carried.iter().map(one).collect()
    }

    #[test]
    fn what_goes_with_time_is_taken_away() {
        let carried = frames(&[-3, -2, -1, 1, 2, 3]);
        let begun = differences(&carried, |_, offset, plane| 0.1 * offset * (1.0 + plane as f32));
        let mut found = begun.clone();
        take_away(SIZE, &carried, &mut found, (2, f32::MAX));
        // The ridge keeps its share of a slope, over the variance: at a corner, by chance, less than half of the mean square.
        for (found, begun) in found.iter().flatten().zip(begun.iter().flatten()) {
            assert!(found.abs() <= 2.0 * RIDGE * begun.abs() + 1e-6, "{found} of {begun}");
        }
    }

    #[test]
    fn what_the_image_lacks_stays() {
        let carried = frames(&[-2, -1, 1, 2]);
        // As far as it is the same all around.
        let begun = differences(&carried, |_, _, plane| 0.1 * (1.0 + plane as f32));
        let mut found = begun.clone();
        take_away(SIZE, &carried, &mut found, (2, f32::MAX));
        for (found, begun) in found.iter().flatten().zip(begun.iter().flatten()) {
            // Sums of some fifty terms, over a variance of a fifth of the mean square or more.
            assert!((found - begun).abs() < 5.0 * 50.0 * f32::EPSILON * begun, "{found} of {begun}");
        }
    }

    #[test]
    fn one_frame_says_nothing_of_time() {
        let carried = frames(&[2]);
        let begun = differences(&carried, |[y, x], _, _| 0.01 * y + (0.7 * x).sin());
        let mut found = begun.clone();
        take_away(SIZE, &carried, &mut found, (2, f32::MAX));
        for (found, begun) in found.iter().flatten().zip(begun.iter().flatten()) {
            assert!((found - begun).abs() < 50.0 * f32::EPSILON / RIDGE, "{found} of {begun}");
        }
    }

    #[test]
    fn it_is_the_regression_in_double_precision() {
        let carried = frames(&[-2, -1, 1, 3]);
        let value = |[y, x]: [f32; 2], offset: f32, plane: usize| {
            (0.3 * y + offset).sin() + offset * (0.2 * x + plane as f32).cos()
        };
        let begun = differences(&carried, value);
        let mut found = begun.clone();
        take_away(SIZE, &carried, &mut found, (2, f32::MAX));
        let block = |place: &[f32; 2]| {
            let at = pixel(SIZE, *place);
            [at / SIZE.width / BLOCK, at % SIZE.width / BLOCK]
        };
        let samples = || {
            let one = |(carried, begun): (&Carried, &Vec<f32>)| {
                let offset = f64::from(carried.offset);
                let each = carried.places.iter().zip(begun.chunks(2));
                each.map(|(place, values)| (block(place), offset, [values[0], values[1]].map(f64::from)))
                    .collect::<Vec<_>>()
            };
            carried.iter().zip(&begun).flat_map(one)
        };
        for ((at, offset, values), found) in samples().zip(found.iter().flat_map(|found| found.chunks(2))) {
            for plane in 0..2 {
                let mut sums = [[0.0; 2]; 3];
                for (other, offset, values) in samples() {
                    let away = [0, 1].map(|axis| at[axis].abs_diff(other[axis]));
                    // The Gaussian is cut at four deviations.
                    if away.iter().any(|away| *away as f64 > 4.0 * SPREAD) {
                        continue;
                    }
                    let square = (away[0].pow(2) + away[1].pow(2)) as f64;
                    let weight = (-square / (2.0 * SPREAD * SPREAD)).exp() / offset.abs();
                    for (power, sums) in sums.iter_mut().enumerate() {
                        let weight = weight * offset.powi(power as i32);
                        *sums = [sums[0] + weight, sums[1] + weight * values[plane]];
                    }
                }
                let [[count, all], [mean, later], [square, _]] = sums;
                let variance = count * square - mean * mean + f64::from(RIDGE) * count * square;
                let expected = values[plane] - offset * (count * later - mean * all) / variance;
                // Sums of some thirty terms of up to 4, over a variance of at least the ridge.
                let tolerance = 30.0 * 4.0 * f64::from(f32::EPSILON / RIDGE);
                assert!(
                    (f64::from(found[plane]) - expected).abs() < tolerance,
                    "{at:?}: {found:?}, {expected}"
                );
            }
        }
    }

    #[test]
    fn values_at_the_end_of_the_range_stay_finite() {
        let carried = frames(&[-1, 1]);
        let mut found = differences(&carried, |_, offset, _| 1e38 * offset);
        take_away(SIZE, &carried, &mut found, (2, f32::MAX));
        assert!(found.iter().flatten().all(|value| value.is_finite()));
    }
}
