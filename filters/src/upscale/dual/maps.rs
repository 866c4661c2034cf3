//! Sparse maps of one axis over images that fit into the first cache, rows padded with zeros to a multiple of [`LANES`].
//!
//! Along columns a tap weighs whole rows. Along rows eight outputs share the inputs of all of them, so that they are the lanes of a
//! vector too: twice the multiplications, and nothing is turned on its side. Loops, as closures may miss the features of their caller.

use crate::kernel::rows::{Combine, Rows};
use crate::kernel::{Body, fma};
use crate::operator::taps::Taps;

/// Pixels that are summed side by side.
pub const LANES: usize = 8;
/// Rows that are mapped at a time: their sums stay in registers.
const ROWS: usize = 4;

/// The length of a row in memory.
pub const fn padded(width: usize) -> usize {
    width.next_multiple_of(LANES)
}

/// A map along columns and along rows.
pub struct Map {
    columns: Rows,
    /// Per eight outputs: the first input, and where their weights stand.
    places: Vec<(usize, std::ops::Range<usize>)>,
    /// Per input, what the eight outputs take of it.
    weights: Vec<[f32; LANES]>,
}

impl Map {
    pub fn new(taps: &Taps) -> Self {
        let outputs: Vec<_> = (0..taps.outputs()).collect();
        let mut weights = Vec::new();
        let places = outputs.chunks(LANES).map(|outputs| {
            let rows = || outputs.iter().map(|&output| taps.row(output));
            let start = rows().map(|(start, _)| start).min().unwrap_or(0);
            let end = rows().map(|(start, row)| start + row.len()).max().unwrap_or(start);
            let from = weights.len();
            weights.resize(from + end - start, [0.0; LANES]);
            for (lane, (first, row)) in rows().enumerate() {
                let own = &mut weights[from + first - start..];
                own.iter_mut().zip(row).for_each(|(weights, weight)| weights[lane] = *weight as f32);
            }
            (start, from..weights.len())
        });
        let places = places.collect();
        Self { columns: taps.rows(), places, weights }
    }

    /// Maps every column of an image whose rows have this length in memory.
    #[inline(always)]
    pub fn along_columns<const FUSED: bool>(&self, from: &[f32], width: usize, to: &mut Vec<f32>) {
        to.resize(self.columns.outputs() * width, 0.0);
        for (output, to) in to.chunks_exact_mut(width).enumerate() {
            let (start, taps) = self.columns.row(output);
            Combine { out: to, rows: &from[start * width..], taps }.run::<FUSED>();
        }
    }

    /// Maps every row of an image whose rows have this length in memory.
    #[inline(always)]
    pub fn along_rows<const FUSED: bool>(&self, from: &[f32], width: usize, to: &mut Vec<f32>) {
        let wide = self.places.len() * LANES;
        to.resize(from.len() / width * wide, 0.0);
        let (mut from, mut to) = (from.chunks_exact(ROWS * width), to.chunks_exact_mut(ROWS * wide));
        for (from, to) in from.by_ref().zip(to.by_ref()) {
            self.four_rows::<FUSED>((from, width), (to, wide));
        }
        let rest = from.remainder().chunks_exact(width).zip(to.into_remainder().chunks_exact_mut(wide));
        for (from, to) in rest {
            for ((start, range), to) in self.places.iter().zip(to.as_chunks_mut::<LANES>().0) {
                let mut sums = [0.0; LANES];
                for (weights, value) in self.weights[range.clone()].iter().zip(&from[*start..]) {
                    add::<FUSED>(&mut sums, *value, weights);
                }
                *to = sums;
            }
        }
    }

    #[inline(always)]
    fn four_rows<const FUSED: bool>(&self, (from, width): (&[f32], usize), (to, wide): (&mut [f32], usize)) {
        for (x, (start, range)) in self.places.iter().enumerate() {
            let weights = &self.weights[range.clone()];
            let [mut a, mut b, mut c, mut d] = [[0.0; LANES]; ROWS];
            let from = &from[*start..];
            let rows =
                weights.iter().zip(from).zip(&from[width..]).zip(&from[2 * width..]).zip(&from[3 * width..]);
            for ((((weights, p), q), r), s) in rows {
                add::<FUSED>(&mut a, *p, weights);
                add::<FUSED>(&mut b, *q, weights);
                add::<FUSED>(&mut c, *r, weights);
                add::<FUSED>(&mut d, *s, weights);
            }
            for (y, sums) in [a, b, c, d].iter().enumerate() {
                to[y * wide + x * LANES..][..LANES].copy_from_slice(sums);
            }
        }
    }
}

#[inline(always)]
fn add<const FUSED: bool>(sums: &mut [f32; LANES], factor: f32, values: &[f32; LANES]) {
    for (sum, value) in sums.iter_mut().zip(values) {
        *sum = fma::<f32, FUSED>(factor, *value, *sum);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Rows of one to five entries, as random as a hash.
    fn example(inputs: usize, outputs: usize) -> Taps {
        let row = |i: usize| {
            let start = (i * inputs / outputs).min(inputs - 1);
            let count = (1 + i % 5).min(inputs - start);
            (start, (0..count).map(|k| ((i * 7 + k * 3) as f64).sin()).collect())
        };
        Taps::from_rows(inputs, (0..outputs).map(row))
    }

    #[test]
    fn images_agree_with_the_map_on_lines_at_every_size() {
        for (height, width, outputs) in
            [(1, 1, 3), (5, 1, 2), (1, 9, 14), (13, 30, 12), (12, 12, 30), (7, 70, 41)]
        {
            let pixel = |y: usize, x: usize| ((y * 31 + x * 17) % 11) as f64 - 5.0;
            let stride = padded(width);
            let mut image = vec![0.0_f32; height * stride];
            for y in 0..height {
                (0..width).for_each(|x| image[y * stride + x] = pixel(y, x) as f32);
            }
            // Sums of at most five products of numbers up to 5.
            let close = |a: f32, b: f64| (f64::from(a) - b).abs() <= 50.0 * f64::from(f32::EPSILON);
            let mut to = Vec::new();
            let taps = example(width, outputs);
            let wide = padded(outputs);
            Map::new(&taps).along_rows::<false>(&image, stride, &mut to);
            assert_eq!(to.len(), height * wide);
            for y in 0..height {
                let expected = taps.apply(&(0..width).map(|x| pixel(y, x)).collect::<Vec<_>>());
                let row = &to[y * wide..][..wide];
                assert!(row.iter().zip(&expected).all(|(a, b)| close(*a, *b)), "{height} {width} {outputs}");
                assert!(row[outputs..].iter().all(|value| *value == 0.0), "{height} {width} {outputs}");
            }
            let taps = example(height, outputs);
            Map::new(&taps).along_columns::<false>(&image, stride, &mut to);
            assert_eq!(to.len(), outputs * stride);
            for x in 0..width {
                let expected = taps.apply(&(0..height).map(|y| pixel(y, x)).collect::<Vec<_>>());
                let column = to[x..].iter().step_by(stride);
                assert!(column.zip(&expected).all(|(a, b)| close(*a, *b)), "{height} {width} {outputs}");
            }
        }
    }
}
