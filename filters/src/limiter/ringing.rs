//! Ringing on black: faint contours beside edges that no sample supports.
//!
//! A spline that falls to 0 swings below it and above it once more, in a contour that follows the edge. Where light is nowhere negative the first
//! swing is cut off, the second one stays. Told by the samples around a pixel, those that are nearest to it and to the eight places as far away as the first of
//! these: where all of them are 0, a missing pixel keeps no more than
//!
//! ```text
//! r(p) = max over paths from p to any other kind of pixel of  min over the path of x
//! ```
//!
//! that is, what can be reached from there without rising: a soft border keeps every bit, a contour falls to the valley before it.
//!
//! Only where samples stand in clusters, as those do that were chosen in rounds: many along edges and few in the black beside them, where splines ring most. Even
//! samples gain little from it, and it costs a tenth of their splines.
//!
//! Algorithm: the pixels of which this is asked are taken up by falling `r`, from a heap. Cost: the nearest samples of all pixels, little else.
//! Fails: on contours that an edge touches.
//!
//! Source: L. Vincent, "Morphological Grayscale Reconstruction in Image Analysis: Applications and Efficient Algorithms", IEEE Transactions on Image
//! Processing 2, 1993.

use std::collections::BinaryHeap;

use lacuna_core::parallel::prelude::*;

use super::Moved;
use crate::baseline::nearest::NearestMap;
use crate::kernel::extremes::range;
use crate::{Mask, Plane, Size};

/// What nobody sees, over the largest measured value.
const FAINT: f32 = 1.0 / 65536.0;
/// Rows that one task takes, and the side of the blocks in which samples are counted.
const ROWS: usize = 16;
/// The variance of samples in a block over their mean beyond which they stand in clusters; that of random ones is 1.
const CLUSTERED: f64 = 4.0;

/// Takes away contours on black, of a plane that is nowhere negative. Returns how many pixels were moved, and how far. `nearest` is asked for the
/// nearest samples where some are 0.
pub fn on_black<E>(
    mask: &Mask,
    samples: &Plane,
    out: &mut Plane,
    nearest: impl FnOnce() -> Result<std::sync::Arc<NearestMap>, E>,
) -> Result<Moved, E> {
    let (least, most) = range(mask.as_slice(), samples.pixels());
    if least != 0.0 || most <= 0.0 || mask.is_full() || !is_clustered(mask) {
        return Ok(Moved::default());
    }
    let nearest = nearest()?;
    let around = Around { size: mask.size(), nearest: nearest.as_slice(), samples: samples.pixels() };
    let asked = around.asked(mask, out, FAINT * most);
    let mut moved = Moved::default();
    for (pixel, reached) in reached(mask.size(), out.pixels(), &asked) {
        let value = &mut out.pixels_mut()[pixel as usize];
        moved += Moved::between(*value, reached);
        *value = reached;
    }
    Ok(moved)
}

/// Whether samples stand in clusters.
fn is_clustered(mask: &Mask) -> bool {
    let width = mask.size().width;
    let bands = mask.as_slice().par_chunks(ROWS * width).map(|band| {
        let mut counts = vec![0_u32; width.div_ceil(ROWS)];
        for row in band.chunks(width) {
            for (count, flags) in counts.iter_mut().zip(row.chunks(ROWS)) {
                *count += flags.iter().map(|flag| u32::from(*flag)).sum::<u32>();
            }
        }
        counts
    });
    let counts: Vec<u32> = bands.into_iter().collect::<Vec<_>>().concat();
    let mean = mask.count() as f64 / counts.len().max(1) as f64;
    let squares: f64 = counts.iter().map(|count| (f64::from(*count) - mean).powi(2)).sum();
    squares > CLUSTERED * mean * counts.len() as f64
}

/// The samples around pixels.
struct Around<'a> {
    size: Size,
    nearest: &'a [u32],
    samples: &'a [f32],
}

impl Around<'_> {
    /// The missing pixels above `faint` around which all samples are 0.
    fn asked(&self, mask: &Mask, out: &Plane, faint: f32) -> Vec<u32> {
        let width = self.size.width;
        let bands = out.pixels().par_chunks(ROWS * width).enumerate().map(|(band, values)| {
            let first = band * ROWS * width;
            let all = values.iter().enumerate().map(|(k, value)| (first + k, *value));
            let bright = all.filter(|&(pixel, value)| value > faint && !mask.as_slice()[pixel]);
            bright.map(|(pixel, _)| pixel).filter(|&pixel| self.is_black(pixel)).map(|at| at as u32).collect()
        });
        bands.into_iter().collect::<Vec<Vec<u32>>>().concat()
    }

    fn is_black(&self, pixel: usize) -> bool {
        let Size { height, width } = self.size;
        let own = self.nearest[pixel] as usize;
        if self.samples[own] != 0.0 {
            return false;
        }
        let [(y, x), (row, column)] = [pixel, own].map(|at| ((at / width) as i64, (at % width) as i64));
        let away = ((y - row) as f64).hypot((x - column) as f64);
        let straight = away.ceil();
        let slanted = (straight * std::f64::consts::FRAC_1_SQRT_2).round() as i64;
        let straight = straight as i64;
        let at = |at: i64, by: i64, length: usize| (at + by).clamp(0, length as i64 - 1) as usize;
        let ways = [(0, 1), (0, -1), (1, 0), (-1, 0), (1, 1), (1, -1), (-1, 1), (-1, -1)];
        ways.into_iter().all(|(down, right)| {
            let far = if down == 0 || right == 0 { straight } else { slanted };
            let place = at(y, down * far, height) * width + at(x, right * far, width);
            self.samples[self.nearest[place] as usize] == 0.0
        })
    }
}

/// What each of these pixels of an image without negative values keeps.
fn reached(size: Size, image: &[f32], asked: &[u32]) -> Vec<(u32, f32)> {
    /// Of a pixel of which nothing is asked.
    const OTHER: u32 = u32::MAX;
    let Size { height, width } = size;
    let mut slots = vec![OTHER; if asked.is_empty() { 0 } else { image.len() }];
    asked.iter().enumerate().for_each(|(slot, &pixel)| slots[pixel as usize] = slot as u32);
    let beside = |pixel: usize| {
        let (y, x) = (pixel / width, pixel % width);
        let rows = y.saturating_sub(1)..(y + 2).min(height);
        rows.flat_map(move |row| (x.saturating_sub(1)..(x + 2).min(width)).map(move |x| row * width + x))
    };
    let mut found = vec![0.0_f32; asked.len()];
    // Values without a sign are ordered as their bits are.
    let mut heap = BinaryHeap::new();
    for (slot, &pixel) in asked.iter().enumerate() {
        let others = beside(pixel as usize).filter(|&other| slots[other] == OTHER).map(|other| image[other]);
        let best = others.fold(0.0, f32::max).min(image[pixel as usize]);
        heap.push((best.to_bits(), slot as u32));
    }
    while let Some((bits, slot)) = heap.pop() {
        let (value, pixel) = (f32::from_bits(bits), asked[slot as usize] as usize);
        if value <= found[slot as usize] {
            continue;
        }
        found[slot as usize] = value;
        for other in beside(pixel).filter(|&other| slots[other] != OTHER) {
            let next = value.min(image[other]);
            if next > found[slots[other] as usize] {
                heap.push((next.to_bits(), slots[other]));
            }
        }
    }
    asked.iter().copied().zip(found).collect()
}

#[cfg(test)]
mod tests {
    use std::convert::Infallible;
    use std::sync::Arc;

    use super::*;

    const SIZE: Size = Size::new(40, 150);

    fn away(y: usize, x: usize) -> f32 {
        (y as f32 - 20.0).hypot(x as f32 - 25.0)
    }

    /// What is left of an image of which a part is measured, by samples of the truth.
    fn left(
        truth: impl Fn(usize, usize) -> f32,
        image: impl Fn(usize, usize) -> f32,
    ) -> (Plane, Plane, Moved) {
        let drawn = |y: usize, x: usize| lacuna_core::mix((y * 4096 + x) as u64) % 100;
        let mask = Mask::from_fn(SIZE, |y, x| drawn(y, x) < if x < 50 { 33 } else { 2 });
        let samples = Plane::from_fn(SIZE, truth);
        let before =
            Plane::from_fn(SIZE, |y, x| if mask.is_measured(y, x) { samples.at(y, x) } else { image(y, x) });
        let mut out = before.clone();
        let nearest = || Ok::<_, Infallible>(Arc::new(NearestMap::new(&mask).unwrap()));
        let moved = on_black(&mask, &samples, &mut out, nearest).unwrap();
        (before, out, moved)
    }

    #[test]
    fn a_contour_beside_an_edge_goes_and_nothing_else() {
        let disc = |y, x| if away(y, x) < 8.0 { 1.0 } else { 0.0 };
        let is_contour = |y, x| (away(y, x) - 14.0).abs() < 2.0;
        let (before, after, moved) = left(disc, |y, x| if is_contour(y, x) { 0.02 } else { disc(y, x) });
        let at = |plane: &Plane, contour: bool| -> Vec<f32> {
            let all = (0..SIZE.pixels()).map(|at| (at / SIZE.width, at % SIZE.width));
            all.filter(|&(y, x)| is_contour(y, x) == contour).map(|(y, x)| plane.at(y, x)).collect()
        };
        assert!(at(&before, false) == at(&after, false));
        assert!(at(&before, true).contains(&0.02) && at(&after, true).iter().all(|value| *value == 0.0));
        assert_eq!(moved.values, at(&before, true).iter().filter(|value| **value > 0.0).count());
    }

    #[test]
    fn a_soft_border_keeps_every_bit() {
        let soft = |y, x| (1.0 - away(y, x) / 9.0_f32).max(0.0).powi(2);
        let (before, after, moved) = left(soft, soft);
        assert!(before == after && moved == Moved::default());
        let (before, after, _) =
            left(|y, x| soft(y, x) + 0.1, |y, x| if y == 3 { 0.2 } else { soft(y, x) + 0.1 });
        assert!(before == after, "nothing is black");
    }

    #[test]
    fn samples_of_rounds_stand_in_clusters_and_no_others() {
        let size = Size::new(320, 320);
        let drawn = |y: usize, x: usize| lacuna_core::mix((y * 4096 + x) as u64) as f64 / u64::MAX as f64;
        for density in [0.01, 0.2, 0.9] {
            assert!(!is_clustered(&Mask::from_fn(size, |y, x| drawn(y, x) < density)), "{density}");
        }
        assert!(!is_clustered(&Mask::from_fn(size, |y, x| y % 3 == 0 && x % 2 == 0)));
        assert!(is_clustered(
            &Mask::from_fn(size, |y, x| drawn(y, x) < if x.abs_diff(y) < 30 { 0.3 } else { 0.02 })
        ));
    }

    #[test]
    fn the_highest_path_counts() {
        // A row: what is asked stands between 0.5 and 0.1, with a valley.
        let image = [0.5, 0.4, 0.2, 0.3, 0.3, 0.1];
        let found = reached(Size::new(1, 6), &image, &[1, 2, 3, 4]);
        assert_eq!(found, [(1, 0.4), (2, 0.2), (3, 0.2), (4, 0.2)]);
        assert_eq!(reached(Size::new(1, 2), &[0.3, 0.2], &[0, 1]), [(0, 0.0), (1, 0.0)]);
        assert!(reached(Size::new(1, 1), &[0.3], &[]).is_empty());
    }
}
