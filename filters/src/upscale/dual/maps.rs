//! Sparse maps of one axis over images that fit into the first cache, rows padded with zeros to a multiple of [`LANES`].
//!
//! Along columns a tap weighs whole rows. Along rows eight outputs share the inputs of all of them, so that they are the lanes of a
//! vector too: twice the multiplications, and nothing is turned on its side. Loops, as closures may miss the features of their caller.

use crate::kernel::fma;
use crate::kernel::rows::Rows;
use crate::operator::taps::Taps;

/// Pixels that are summed side by side.
pub const LANES: usize = 8;
/// Vectors whose sums stay in registers.
const VECTORS: usize = 4;

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
            let rows = &from[start * width..][..taps.len() * width];
            let mut blocks = to.chunks_exact_mut(VECTORS * LANES);
            let mut at = 0;
            for to in blocks.by_ref() {
                weigh::<VECTORS, FUSED>(taps, (rows, width, at), to);
                at += VECTORS * LANES;
            }
            for to in blocks.into_remainder().chunks_exact_mut(LANES) {
                weigh::<1, FUSED>(taps, (rows, width, at), to);
                at += LANES;
            }
        }
    }

    /// Maps every row of an image whose rows have this length in memory.
    #[inline(always)]
    pub fn along_rows<const FUSED: bool>(&self, from: &[f32], width: usize, to: &mut Vec<f32>) {
        let wide = self.places.len() * LANES;
        to.resize(from.len() / width * wide, 0.0);
        let (mut from, mut to) = (from.chunks_exact(VECTORS * width), to.chunks_exact_mut(VECTORS * wide));
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
            let [mut a, mut b, mut c, mut d] = [[0.0; LANES]; VECTORS];
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

/// Weighs `N` vectors of rows of this length, from a column on.
#[inline(always)]
fn weigh<const N: usize, const FUSED: bool>(
    taps: &[f32],
    (rows, width, at): (&[f32], usize, usize),
    to: &mut [f32],
) {
    let mut sums = [[0.0; LANES]; N];
    for (tap, row) in taps.iter().zip(rows.chunks_exact(width)) {
        let values = row[at..at + N * LANES].as_chunks::<LANES>().0;
        for (sums, values) in sums.iter_mut().zip(values) {
            add::<FUSED>(sums, *tap, values);
        }
    }
    to.as_chunks_mut::<LANES>().0.copy_from_slice(&sums);
}

#[inline(always)]
fn add<const FUSED: bool>(sums: &mut [f32; LANES], factor: f32, values: &[f32; LANES]) {
    for (sum, value) in sums.iter_mut().zip(values) {
        *sum = fma::<f32, FUSED>(factor, *value, *sum);
    }
}
