//! Weighted linear regressions at many pixels at once: one lane a pixel, all lanes of a block over the same samples.
//!
//! For the pixel `p` of a lane, over the samples `q` of the block's runs,
//!
//! ```text
//! w_q  = (1 - |q - p|^2 / r^2)+^2  (1 + sum_k (b_k (g_kq - g_kp))^2)^-4       times FOREIGN where the labels differ, times the sample's own
//! min  sum_q w_q (v_q - c - sum_k a_k (g_kq - g_kp))^2  +  ridge sum_k a_k^2         over c and a;  the result is c
//! ```
//!
//! With `u_q = (1, g_q - o)`, an origin `o` near by, the normal equations are sums of `w_q u_q u_q'` and `w_q u_q v_q`. But for
//! the weights nothing in them depends on the pixel: a [`Table`] holds the products of each sample, and the sums of a block are
//! a product of matrices, products by samples times samples by lanes. Where `A` is the sum of the first and `R` of the
//! second, the result is `u_p' A^-1 R`. The constant stands first in `A`, so eliminating it centres the guides; values are
//! taken from the one nearest to zero, so that dark pixels beside bright ones keep their digits.
//!
//! Roofline, a sample and vector of lanes: 9 arithmetic instructions and a division for the distance, two for each guide,
//! `(k + 1) (k / 2 + 1 + c)` multiply-adds for `k` slopes and `c` channels, accumulators in registers: 58 and a division for five
//! guides and three channels, about 40 cycles where two can begin in one.

pub mod nodes;

use super::simd::{Vector, Vectored};
use super::{Body, Isa, dispatch};

/// Pixels of one block.
pub const LANES: usize = 16;
/// What a sample of another label weighs.
pub const FOREIGN: f32 = 1e-4;
/// The usual weight of the slopes' squares; guides are scaled so that their bandwidth is about 0.4.
pub const RIDGE: f32 = 1e-4;
/// How far beyond the samples around a prediction may go, in parts of their range.
const BEYOND: f32 = 0.25;
/// Sums that stay in registers together.
const CHUNK: usize = 13;
/// Products that are formed together.
const ROW: usize = 8;
/// Channels whose range is found together.
const QUAD: usize = 4;

/// One number for each pixel of a block.
#[derive(Clone, Copy, Debug, PartialEq)]
#[repr(align(64))]
pub struct Lanes(pub [f32; LANES]);

impl Lanes {
    /// Zeros.
    pub const ZERO: Self = Self([0.0; LANES]);
}

/// The measured pixels that may serve, row by row.
#[derive(Clone, Debug, Default)]
pub struct Samples {
    /// Row and column.
    pub at: Vec<[f32; 2]>,
    /// Guides, all of a sample together.
    pub guides: Vec<f32>,
    /// Channels, all of a sample together.
    pub values: Vec<f32>,
    /// Labels; empty where there are none.
    pub labels: Vec<u32>,
    /// What each weighs; empty where all weigh the same.
    pub weights: Vec<f32>,
}

/// What each guide counts for.
#[derive(Clone, Debug, PartialEq)]
pub struct Scales {
    /// Factor of a guide's difference in the weight; 0 ignores it there.
    pub bandwidths: Vec<f32>,
    /// Whether it has a slope.
    pub slopes: Vec<bool>,
    /// Weight of the slopes' squares, such as [`RIDGE`].
    pub ridge: f32,
}

/// The samples of a part of the image with their products.
#[derive(Clone, Debug)]
pub struct Table {
    /// Guides with a weight, and their factors.
    weighing: Vec<(usize, f32)>,
    /// Guides with a slope.
    sloping: Vec<usize>,
    ridge: f32,
    guides: usize,
    channels: usize,
    /// Origins of guides and channels.
    origins: (Vec<f32>, Vec<f32>),
    at: Vec<[f32; 2]>,
    labels: Vec<u32>,
    /// Channels, to fill whole quads.
    values: Vec<[f32; QUAD]>,
    /// Guides times their factors.
    scaled: Vec<f32>,
    /// For each entry `a` of `u`: its products with the channels, then with the entries up to itself.
    products: Vec<f32>,
    /// Products from one sample to the next.
    stride: usize,
}

impl Table {
    /// An empty one.
    pub fn new(scales: &Scales, channels: usize) -> Self {
        let guides = scales.bandwidths.len();
        let factors = scales.bandwidths.iter().copied().enumerate();
        let sloping: Vec<usize> = (0..guides).filter(|&guide| scales.slopes[guide]).collect();
        let order = sloping.len() + 1;
        Self {
            weighing: factors.filter(|(_, factor)| *factor != 0.0).collect(),
            sloping,
            ridge: scales.ridge,
            guides,
            channels,
            origins: (vec![0.0; guides], vec![0.0; channels]),
            at: Vec::new(),
            labels: Vec::new(),
            values: Vec::new(),
            scaled: Vec::new(),
            products: Vec::new(),
            stride: (order * (order + 1) / 2 + order * channels).next_multiple_of(CHUNK),
        }
    }

    /// Takes the given samples instead of those it held, in their order.
    pub fn fill(&mut self, isa: Isa, samples: &Samples, runs: &[(usize, usize)]) {
        self.clear();
        for &(start, end) in runs {
            self.at.extend_from_slice(&samples.at[start..end]);
            if !samples.labels.is_empty() {
                self.labels.extend_from_slice(&samples.labels[start..end]);
            }
        }
        self.find_origins(samples, runs);
        dispatch(isa, Fill { table: self, samples, runs });
    }

    /// Sets the channels, the scaled guides and the products.
    #[inline(always)]
    fn multiply(&mut self, samples: &Samples, runs: &[(usize, usize)]) {
        let (channels, quads) = (self.channels, self.channels.div_ceil(QUAD));
        // The channels, then `u`; a row of products is the beginning of this line times an entry of `u`.
        let mut line = vec![0.0; (channels + self.sloping.len() + 1).next_multiple_of(ROW)];
        line[channels] = 1.0;
        self.values.resize(self.at.len() * quads, [0.0; QUAD]);
        self.products.resize(self.at.len() * self.stride + line.len().max(nodes::GROUP), 0.0);
        for (place, index) in runs.iter().flat_map(|&(start, end)| start..end).enumerate() {
            let guides = &samples.guides[index * self.guides..][..self.guides];
            self.scaled.extend(self.weighing.iter().map(|&(guide, factor)| guides[guide] * factor));
            let values = &samples.values[index * channels..][..channels];
            let weight = samples.weights.get(index).copied().unwrap_or(1.0);
            let own = self.values[place * quads..][..quads].as_flattened_mut();
            for (k, (&value, origin)) in values.iter().zip(&self.origins.1).enumerate() {
                own[k] = value;
                line[k] = value - origin;
            }
            for (u, &guide) in line[channels + 1..].iter_mut().zip(&self.sloping) {
                *u = guides[guide] - self.origins.0[guide];
            }
            let own = &mut self.products[place * self.stride..];
            for a in 0..=self.sloping.len() {
                // The line is longer than the row; what is too much is overwritten by the next.
                let row = &mut own[right(a, channels)..][..line.len()];
                let factor = weight * line[channels + a];
                for (row, line) in row.as_chunks_mut::<ROW>().0.iter_mut().zip(line.as_chunks::<ROW>().0) {
                    for (product, other) in row.iter_mut().zip(line) {
                        *product = factor * other;
                    }
                }
            }
        }
    }

    fn clear(&mut self) {
        self.at.clear();
        self.labels.clear();
        self.values.clear();
        self.scaled.clear();
    }

    /// The means of the guides; of each channel the value that is nearest to zero.
    fn find_origins(&mut self, samples: &Samples, runs: &[(usize, usize)]) {
        let (guides, channels) = &mut self.origins;
        guides.fill(0.0);
        let part = 1.0 / self.at.len().max(1) as f32;
        for &(start, end) in runs {
            for sample in
                samples.guides[start * self.guides..end * self.guides].chunks_exact(self.guides.max(1))
            {
                guides.iter_mut().zip(sample).for_each(|(mean, guide)| *mean += part * guide);
            }
        }
        channels.fill(f32::INFINITY);
        for &(start, end) in runs {
            for values in
                samples.values[start * self.channels..end * self.channels].chunks_exact(self.channels)
            {
                for (origin, &value) in channels.iter_mut().zip(values) {
                    *origin = if value.abs() < origin.abs() { value } else { *origin };
                }
            }
        }
    }
}

struct Fill<'a> {
    table: &'a mut Table,
    samples: &'a Samples,
    runs: &'a [(usize, usize)],
}

impl Body for Fill<'_> {
    type Output = ();
    #[inline(always)]
    fn run<const FUSED: bool>(self) {
        self.table.multiply(self.samples, self.runs);
    }
}

/// The pixels of a block.
#[derive(Clone, Debug)]
pub struct Centres {
    /// Rows and columns.
    pub at: [Lanes; 2],
    /// One over the square of the radius.
    pub inverse: Lanes,
    /// Guides.
    pub guides: Vec<Lanes>,
    /// Labels.
    pub labels: [u32; LANES],
}

/// Regressions of one block. The result goes to `out`, one entry a channel; the sums of weights are returned, zero where
/// nothing was near.
pub struct Regress<'a> {
    /// The samples around.
    pub table: &'a Table,
    /// Which of them the block sees.
    pub runs: &'a [(usize, usize)],
    /// The pixels.
    pub centres: &'a Centres,
    /// Whether a pixel's own sample is left out.
    pub leave_out: bool,
    /// Memory that is used again.
    pub scratch: &'a mut Scratch,
    /// The values found.
    pub out: &'a mut [Lanes],
}

/// Memory of one block.
#[derive(Clone, Debug, Default)]
pub struct Scratch {
    /// Guides of the pixels times their factors.
    scaled: Vec<Lanes>,
    /// One of each sample.
    weights: Vec<Lanes>,
    /// Sums of the products.
    sums: Vec<Lanes>,
    /// The unit lower factor and the same times its pivots, by rows; `1 / pivot` on the diagonal.
    factor: Vec<[Lanes; 2]>,
    /// `u_p`, then `A^-1 u_p`.
    solution: Vec<Lanes>,
    low: Vec<[f32; QUAD]>,
    high: Vec<[f32; QUAD]>,
    /// One of each sample, for a single pixel.
    single: Vec<f32>,
}

impl Scratch {
    /// The factors of the matrix, `L D L'`.
    #[inline(always)]
    fn factor<V: Vector<Number = f32>>(&mut self, (channels, ridge): (usize, f32), from: usize) {
        let Self { sums, factor, solution, .. } = self;
        let load = |lanes: &Lanes| V::load(&lanes.0[from..]);
        for a in 0..solution.len() {
            let row = right(a, channels) + channels;
            for b in 0..=a {
                let mut sum = load(&sums[row + b]);
                for k in 0..b {
                    let [unit, _] = &factor[at(a, k)];
                    let [_, other] = &factor[at(b, k)];
                    sum = sum.minus(load(unit).times(load(other)));
                }
                let least = if a == 0 { f32::MIN_POSITIVE } else { 0.5 * ridge };
                if a == b {
                    let ridge = if a == 0 { 0.0 } else { ridge };
                    let pivot = sum.plus(V::splat(ridge)).larger(V::splat(least));
                    V::splat(1.0).over(pivot).store(&mut factor[at(a, a)][0].0[from..]);
                } else {
                    let inverse = load(&factor[at(b, b)][0]);
                    let [unit, whole] = &mut factor[at(a, b)];
                    sum.times(inverse).store(&mut unit.0[from..]);
                    sum.store(&mut whole.0[from..]);
                }
            }
        }
    }

    /// Solves the factored system in place: `solution` holds the right side before.
    #[inline(always)]
    fn solve<V: Vector<Number = f32>>(&mut self, from: usize) {
        let Self { factor, solution, .. } = self;
        let load = |lanes: &Lanes| V::load(&lanes.0[from..]);
        let order = solution.len();
        for a in 1..order {
            let mut sum = load(&solution[a]);
            for k in 0..a {
                sum = sum.minus(load(&factor[at(a, k)][0]).times(load(&solution[k])));
            }
            sum.store(&mut solution[a].0[from..]);
        }
        for a in (0..order).rev() {
            let mut sum = load(&solution[a]).times(load(&factor[at(a, a)][0]));
            for k in a + 1..order {
                sum = sum.minus(load(&factor[at(k, a)][0]).times(load(&solution[k])));
            }
            sum.store(&mut solution[a].0[from..]);
        }
    }
}

impl Vectored<f32> for Regress<'_> {
    type Output = Lanes;
    #[inline(always)]
    fn run<V: Vector<Number = f32>>(mut self) -> Lanes {
        if self.range() {
            // All samples alike: so is what lies between them.
            for (out, low) in self.out.iter_mut().zip(self.scratch.low.as_flattened()) {
                out.0 = [*low; LANES];
            }
            return Lanes([1.0; LANES]);
        }
        self.prepare();
        for from in (0..LANES).step_by(V::LANES) {
            self.weigh::<V>(from);
            if !self.table.labels.is_empty() {
                self.tell_labels(from..from + V::LANES);
            }
            self.accumulate::<V>(from);
            self.scratch.factor::<V>((self.table.channels, self.table.ridge), from);
            self.predict::<V>(from);
        }
        let Scratch { sums, low, high, .. } = &*self.scratch;
        for ((out, &low), &high) in self.out.iter_mut().zip(low.as_flattened()).zip(high.as_flattened()) {
            let room = BEYOND * (high - low);
            for out in &mut out.0 {
                *out = out.clamp(low - room, high + room);
            }
        }
        sums[right(0, self.table.channels) + self.table.channels]
    }
}

/// Where the products of entry `a` with the channels stand; those with the entries up to itself come after them.
#[inline(always)]
const fn right(a: usize, channels: usize) -> usize {
    at(a, 0) + a * channels
}

/// Where row `a`, column `b` of a lower triangle stands.
#[inline(always)]
const fn at(a: usize, b: usize) -> usize {
    a * (a + 1) / 2 + b
}

impl Regress<'_> {
    /// The range of each channel; whether all samples are alike. No sample at all counts as alike, at zero.
    #[inline(always)]
    fn range(&mut self) -> bool {
        let Scratch { low, high, .. } = &mut *self.scratch;
        let quads = self.table.channels.div_ceil(QUAD);
        low.clear();
        low.resize(quads, [f32::INFINITY; QUAD]);
        high.clear();
        high.resize(quads, [f32::NEG_INFINITY; QUAD]);
        for &(start, end) in self.runs {
            for values in self.table.values[start * quads..end * quads].chunks_exact(quads) {
                for ((low, high), values) in low.iter_mut().zip(high.iter_mut()).zip(values) {
                    for k in 0..QUAD {
                        low[k] = if values[k] < low[k] { values[k] } else { low[k] };
                        high[k] = if values[k] > high[k] { values[k] } else { high[k] };
                    }
                }
            }
        }
        if low[0][0] > high[0][0] {
            low.fill([0.0; QUAD]);
            high.fill([0.0; QUAD]);
        }
        low == high
    }

    /// Sets the pixels' own guides, and makes room.
    #[inline(always)]
    fn prepare(&mut self) {
        let (table, centres) = (self.table, self.centres);
        let Scratch { scaled, weights, sums, factor, solution, .. } = &mut *self.scratch;
        scaled.clear();
        scaled.extend(
            table.weighing.iter().map(|&(guide, scale)| Lanes(centres.guides[guide].0.map(|g| g * scale))),
        );
        solution.clear();
        solution.push(Lanes([1.0; LANES]));
        let less = |&guide: &usize| Lanes(centres.guides[guide].0.map(|g| g - table.origins.0[guide]));
        solution.extend(table.sloping.iter().map(less));
        weights.resize(self.runs.iter().map(|(start, end)| end - start).sum(), Lanes::ZERO);
        sums.resize(table.stride, Lanes::ZERO);
        factor.resize(at(solution.len(), 0), [Lanes::ZERO; 2]);
    }

    /// The weights of all samples but for their labels.
    #[inline(always)]
    fn weigh<V: Vector<Number = f32>>(&mut self, from: usize) {
        let Scratch { scaled, weights, .. } = &mut *self.scratch;
        let load = |lanes: &Lanes| V::load(&lanes.0[from..]);
        let (zero, one) = (V::splat(0.0), V::splat(1.0));
        let [rows, columns] = self.centres.at.each_ref().map(load);
        let inverse = zero.minus(load(&self.centres.inverse));
        let guides = self.table.weighing.len();
        let samples = self.runs.iter().flat_map(|&(start, end)| start..end);
        for (sample, weight) in samples.zip(weights) {
            let [row, column] = self.table.at[sample];
            let (y, x) = (V::splat(row).minus(rows), V::splat(column).minus(columns));
            let square = y.fused(y, x.times(x));
            let inside = square.fused(inverse, one).larger(zero);
            let mut sum = one;
            let values = &self.table.scaled[sample * guides..][..guides];
            for (&value, centre) in values.iter().zip(&*scaled) {
                let difference = V::splat(value).minus(load(centre));
                sum = difference.fused(difference, sum);
            }
            let sum = sum.times(sum);
            let mut value = inside.times(inside).over(sum.times(sum));
            if self.leave_out {
                // Squares of distances are whole numbers: 0 or at least 1.
                value = value.times(one.minus(one.minus(square).larger(zero)));
            }
            value.store(&mut weight.0[from..]);
        }
    }

    /// Takes the weight from samples of other labels.
    #[inline(always)]
    fn tell_labels(&mut self, lanes: std::ops::Range<usize>) {
        let samples = self.runs.iter().flat_map(|&(start, end)| &self.table.labels[start..end]);
        for (weight, label) in self.scratch.weights.iter_mut().zip(samples) {
            for (weight, own) in weight.0[lanes.clone()].iter_mut().zip(&self.centres.labels[lanes.clone()]) {
                *weight *= if label == own { 1.0 } else { FOREIGN };
            }
        }
    }

    /// Sums up the normal equations.
    #[inline(always)]
    fn accumulate<V: Vector<Number = f32>>(&mut self, from: usize) {
        let Scratch { weights, sums, .. } = &mut *self.scratch;
        let stride = self.table.stride;
        for (chunk, sums) in sums.chunks_exact_mut(CHUNK).enumerate() {
            let mut own = [V::splat(0.0); CHUNK];
            let mut weights = weights.iter();
            for &(start, end) in self.runs {
                let products = self.table.products[start * stride..end * stride].chunks_exact(stride);
                for (products, weight) in products.zip(&mut weights) {
                    let weight = V::load(&weight.0[from..]);
                    let products = &products[chunk * CHUNK..][..CHUNK];
                    for k in 0..CHUNK {
                        own[k] = V::splat(products[k]).fused(weight, own[k]);
                    }
                }
            }
            for (sum, own) in sums.iter_mut().zip(own) {
                own.store(&mut sum.0[from..]);
            }
        }
    }

    /// Solves for the weights of the right sides, and sums these up.
    #[inline(always)]
    fn predict<V: Vector<Number = f32>>(&mut self, from: usize) {
        self.scratch.solve::<V>(from);
        let Scratch { sums, solution, .. } = &*self.scratch;
        let load = |lanes: &Lanes| V::load(&lanes.0[from..]);
        let channels = self.table.channels;
        for (channel, out) in self.out.iter_mut().enumerate() {
            let mut sum = V::splat(self.table.origins.1[channel]);
            for (a, own) in solution.iter().enumerate() {
                sum = load(own).fused(load(&sums[right(a, channels) + channel]), sum);
            }
            sum.store(&mut out.0[from..]);
        }
    }
}

#[cfg(test)]
mod tests;
