//! Regressions at the nodes of a grid, and what they predict between them.
//!
//! Where weights depend on place alone, a regression is the same function of the guides for pixels that stand close together. It is
//! solved at nodes, for its coefficients `a` and `c` as in [`regress`](super) and the range of the samples around; each pixel takes
//! these linearly interpolated between the four nodes around it:
//!
//! ```text
//! x(p) = sum over nodes n of b_n(p) (c_n + a_n . (g_p - o)),  held within the range of samples and a quarter of it more, interpolated too
//! ```
//!
//! The sums of a node run over its own samples, in vectors along the products of a sample; all nodes of a block are then solved
//! together, one lane each.

use super::{BEYOND, Lanes, QUAD, Scratch, Table, at, right};
use crate::kernel::simd::{Vector, Vectored};
use crate::kernel::{Body, fma};

/// Vectors of sums that stay in registers together.
const SUMS: usize = 10;
/// Products that are read together at most: of the longest vectors.
pub(super) const GROUP: usize = SUMS * crate::kernel::simd::MOST;
/// Channels are padded to so many.
pub const PADDED: usize = 8;

/// A node.
#[derive(Clone, Debug)]
pub struct Node {
    /// Row and column.
    pub at: [f32; 2],
    /// One over the square of the radius.
    pub inverse: f32,
    /// Which of the runs are its own.
    pub runs: std::ops::Range<usize>,
}

/// Numbers of a node's record: for each entry of `u` a coefficient a channel, then the least and the largest of the samples.
pub fn record(table: &Table) -> usize {
    (table.sloping.len() + 3) * padded(table)
}

fn padded(table: &Table) -> usize {
    table.channels.next_multiple_of(PADDED)
}

/// Regressions at up to [`LANES`](super::LANES) nodes; the record of one near which there is no sample is not a number.
pub struct Fit<'a> {
    /// The samples around, without weights of guides and labels.
    pub table: &'a Table,
    /// Runs of samples of all nodes.
    pub runs: &'a [(usize, usize)],
    /// The nodes.
    pub nodes: &'a [Node],
    /// Memory that is used again.
    pub scratch: &'a mut Scratch,
    /// By node its record.
    pub records: &'a mut [f32],
}

impl Vectored<f32> for Fit<'_> {
    type Output = ();
    #[inline(always)]
    fn run<V: Vector<Number = f32>>(mut self) {
        let order = self.table.sloping.len() + 1;
        self.scratch.sums.resize(self.table.stride.next_multiple_of(GROUP), Lanes::ZERO);
        self.scratch.solution.resize(order, Lanes::ZERO);
        self.scratch.factor.resize(at(order, 0), [Lanes::ZERO; 2]);
        for lane in 0..self.nodes.len() {
            self.weigh(lane);
            self.range(lane);
            self.accumulate::<V>(lane);
        }
        for from in (0..self.nodes.len()).step_by(V::LANES) {
            self.scratch.factor::<V>((self.table.channels, self.table.ridge), from);
            for channel in 0..self.table.channels {
                self.solve::<V>(channel, from);
            }
        }
    }
}

impl Fit<'_> {
    /// The weights of a node's samples.
    #[inline(always)]
    fn weigh(&mut self, lane: usize) {
        let Node { at: [row, column], inverse, .. } = self.nodes[lane];
        let runs = &self.runs[self.nodes[lane].runs.clone()];
        let weights = &mut self.scratch.single;
        weights.clear();
        weights.resize(runs.iter().map(|(start, end)| end - start).sum(), 0.0);
        let mut from = 0;
        for &(start, end) in runs {
            let weights = &mut weights[from..from + end - start];
            for (weight, [y, x]) in weights.iter_mut().zip(&self.table.at[start..end]) {
                let square = (y - row) * (y - row) + (x - column) * (x - column);
                let inside = (1.0 - square * inverse).max(0.0);
                *weight = inside * inside;
            }
            from += end - start;
        }
    }

    /// The range of each channel around a node.
    #[inline(always)]
    fn range(&mut self, lane: usize) {
        let (record, padded) = (record(self.table), padded(self.table));
        let quads = self.table.channels.div_ceil(QUAD);
        let range = &mut self.records[lane * record..][record - 2 * padded..record];
        let (lows, highs) = range.split_at_mut(padded);
        for quad in 0..quads {
            let (mut low, mut high) = ([f32::INFINITY; QUAD], [f32::NEG_INFINITY; QUAD]);
            for &(start, end) in &self.runs[self.nodes[lane].runs.clone()] {
                for values in self.table.values[start * quads..end * quads].chunks_exact(quads) {
                    let values = &values[quad];
                    for k in 0..QUAD {
                        low[k] = if values[k] < low[k] { values[k] } else { low[k] };
                        high[k] = if values[k] > high[k] { values[k] } else { high[k] };
                    }
                }
            }
            lows[quad * QUAD..][..QUAD].copy_from_slice(&low);
            highs[quad * QUAD..][..QUAD].copy_from_slice(&high);
        }
    }

    /// Sums up the normal equations of a node.
    #[inline(always)]
    fn accumulate<V: Vector<Number = f32>>(&mut self, lane: usize) {
        let stride = self.table.stride;
        for from in (0..stride).step_by(SUMS * V::LANES) {
            let mut own = [V::splat(0.0); SUMS];
            let mut weights = self.scratch.single.iter();
            for &(start, end) in &self.runs[self.nodes[lane].runs.clone()] {
                for (sample, &weight) in (start..end).zip(&mut weights) {
                    let weight = V::splat(weight);
                    let products = &self.table.products[sample * stride + from..][..SUMS * V::LANES];
                    for (own, products) in own.iter_mut().zip(products.chunks_exact(V::LANES)) {
                        *own = V::load(products).fused(weight, *own);
                    }
                }
            }
            let mut line = [0.0; GROUP];
            for (line, own) in line.chunks_exact_mut(V::LANES).zip(own) {
                own.store(line);
            }
            for (sum, line) in self.scratch.sums[from..].iter_mut().zip(&line[..SUMS * V::LANES]) {
                sum.0[lane] = *line;
            }
        }
    }

    /// The coefficients of one channel.
    #[inline(always)]
    fn solve<V: Vector<Number = f32>>(&mut self, channel: usize, from: usize) {
        let channels = self.table.channels;
        let Scratch { sums, solution, .. } = &mut *self.scratch;
        for (a, own) in solution.iter_mut().enumerate() {
            V::load(&sums[right(a, channels) + channel].0[from..]).store(&mut own.0[from..]);
        }
        self.scratch.solve::<V>(from);
        let Scratch { sums, solution, .. } = &*self.scratch;
        let (padded, record) = (padded(self.table), record(self.table));
        let near = &sums[right(0, channels) + channels];
        for lane in from..(from + V::LANES).min(self.nodes.len()) {
            let own = &mut self.records[lane * record..][..record];
            for (a, value) in solution.iter().enumerate() {
                let origin = if a == 0 { self.table.origins.1[channel] } else { 0.0 };
                let known = near.0[lane] > 0.0 && value.0[lane].is_finite();
                own[a * padded + channel] = if known { origin + value.0[lane] } else { f32::NAN };
            }
        }
    }
}

/// Predictions for a row of pixels.
pub struct Between<'a, 'b> {
    /// The samples that the nodes were fitted to.
    pub table: &'a Table,
    /// The records of the nodes above and below the row.
    pub records: [&'a [f32]; 2],
    /// How far the row lies from the upper ones to the lower ones, 0 to 1.
    pub part: f32,
    /// Pixels between nodes.
    pub step: usize,
    /// By guide its values at the pixels, of which the first stands at a node.
    pub guides: &'a [&'a [f32]],
    /// Which pixels are wanted.
    pub wanted: &'a [bool],
    /// Memory that is used again.
    pub line: &'a mut Vec<f32>,
    /// By channel the pixels.
    pub out: &'a mut [&'b mut [f32]],
}

impl Body for Between<'_, '_> {
    type Output = ();
    #[inline(always)]
    fn run<const FUSED: bool>(mut self) {
        let (order, padded, record) = (self.table.sloping.len() + 1, padded(self.table), record(self.table));
        self.between_rows::<FUSED>();
        let mut own = vec![1.0; order];
        for (pixel, _) in self.wanted.iter().enumerate().filter(|(_, wanted)| **wanted) {
            for (own, &guide) in own[1..].iter_mut().zip(&self.table.sloping) {
                *own = self.guides[guide][pixel] - self.table.origins.0[guide];
            }
            let (node, part) = (pixel / self.step, (pixel % self.step) as f32 / self.step as f32);
            let left = &self.line[node * record..][..record];
            let right = if part > 0.0 { &self.line[(node + 1) * record..][..record] } else { left };
            for from in (0..padded).step_by(PADDED) {
                let mut sum = [0.0; PADDED];
                for (a, &u) in own.iter().enumerate() {
                    let line = between::<FUSED>(left, right, a * padded + from, part);
                    for k in 0..PADDED {
                        sum[k] = fma::<f32, FUSED>(u, line[k], sum[k]);
                    }
                }
                let low = between::<FUSED>(left, right, order * padded + from, part);
                let high = between::<FUSED>(left, right, (order + 1) * padded + from, part);
                for (k, out) in self.out[from..].iter_mut().take(PADDED).enumerate() {
                    let room = BEYOND * (high[k] - low[k]);
                    let held = sum[k].max(low[k] - room).min(high[k] + room);
                    out[pixel] = if sum[k].is_finite() { held } else { f32::NAN };
                }
            }
        }
    }
}

impl Between<'_, '_> {
    /// Interpolates the records between the two rows of nodes.
    #[inline(always)]
    fn between_rows<const FUSED: bool>(&mut self) {
        let [above, below] = self.records;
        self.line.clear();
        self.line.extend_from_slice(above);
        if self.part > 0.0 {
            for (own, below) in self.line.iter_mut().zip(below) {
                *own = fma::<f32, FUSED>(self.part, below - *own, *own);
            }
        }
    }
}

/// Some numbers between those of two records.
#[inline(always)]
fn between<const FUSED: bool>(left: &[f32], right: &[f32], at: usize, part: f32) -> [f32; PADDED] {
    let mut line = [0.0; PADDED];
    for ((line, a), b) in line.iter_mut().zip(&left[at..at + PADDED]).zip(&right[at..at + PADDED]) {
        *line = fma::<f32, FUSED>(part, b - a, *a);
    }
    line
}
