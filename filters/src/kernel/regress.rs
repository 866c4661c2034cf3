//! Weighted linear regressions at many pixels at once: one lane a pixel, all lanes of a block over the same samples.
//!
//! For the pixel `p` of a lane, over the samples `q` of the block's runs,
//!
//! ```text
//! w_q  = (1 - |q - p|^2 / r^2)+^2  (1 + sum_k (b_k (g_kq - g_kp))^2)^-4       times FOREIGN where the labels differ
//! min  sum_q w_q (v_q - c - sum_k a_k s_k (g_kq - g_kp))^2  +  ridge sum_k a_k^2          over c and a;  the result is c
//! ```
//!
//! Values are taken from the middle of their range, so that constants come out as they are. The constant stands last in
//! the matrix: forward substitution alone gives it.
//!
//! Roofline: `(k + 1) (k + 2) / 2 + c (k + 1)` multiplications and additions a sample and lane for `k` slopes and `c`
//! channels, accumulators in L1; about 0.1 us a pixel for five guides and 40 samples.

use super::{Body, fma};

/// Pixels of one block.
pub const LANES: usize = 16;
/// One number for each pixel of a block.
pub type Lanes = [f32; LANES];
/// What a sample of another label weighs.
pub const FOREIGN: f32 = 1e-4;
/// Weight of the slopes' squares; guides are scaled so that their bandwidth is about 0.4.
pub const RIDGE: f32 = 1e-4;
/// How far beyond the samples around a prediction may go, in parts of their range.
const BEYOND: f32 = 0.25;

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
}

/// What each guide counts for.
#[derive(Clone, Debug, PartialEq)]
pub struct Scales {
    /// Factor of a guide's difference in the weight; 0 ignores it there.
    pub bandwidths: Vec<f32>,
    /// Whether it has a slope.
    pub slopes: Vec<bool>,
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
    /// The samples of the image.
    pub samples: &'a Samples,
    /// Number of channels.
    pub channels: usize,
    /// Which samples the block sees.
    pub runs: &'a [(usize, usize)],
    /// The pixels.
    pub centres: &'a Centres,
    /// What guides count for.
    pub scales: &'a Scales,
    /// Whether a pixel's own sample is left out.
    pub leave_out: bool,
    /// Memory that is used again: see [`Scratch::new`].
    pub scratch: &'a mut Scratch,
    /// The values found.
    pub out: &'a mut [Lanes],
}

/// Sums of one block.
#[derive(Clone, Debug)]
pub struct Scratch {
    matrix: Vec<Lanes>,
    right: Vec<Lanes>,
    phi: Vec<Lanes>,
    low: Vec<f32>,
    high: Vec<f32>,
    middle: Vec<f32>,
}

impl Scratch {
    /// For so many guides and channels.
    pub fn new(guides: usize, channels: usize) -> Self {
        let order = guides + 1;
        Self {
            matrix: vec![[0.0; LANES]; order * (order + 1) / 2],
            right: vec![[0.0; LANES]; order * channels],
            phi: vec![[0.0; LANES]; order],
            low: vec![0.0; channels],
            high: vec![0.0; channels],
            middle: vec![0.0; channels],
        }
    }
}

impl Body for Regress<'_> {
    type Output = Lanes;
    #[inline(always)]
    fn run<const FUSED: bool>(mut self) -> Lanes {
        if self.range() {
            // All samples alike: so is what lies between them.
            for (out, low) in self.out.iter_mut().zip(&self.scratch.low) {
                *out = [*low; LANES];
            }
            return [1.0; LANES];
        }
        let slopes = self.scales.slopes.iter().filter(|slope| **slope).count();
        let total = self.accumulate::<FUSED>(slopes);
        self.solve::<FUSED>(slopes);
        for (channel, out) in self.out.iter_mut().enumerate() {
            let (low, high) = (self.scratch.low[channel], self.scratch.high[channel]);
            let (middle, room) = (self.scratch.middle[channel], BEYOND * (high - low));
            for out in out {
                *out = (*out + middle).clamp(low - room, high + room);
            }
        }
        total
    }
}

impl Regress<'_> {
    /// The range of each channel; whether all samples are alike. No sample at all counts as alike, at zero.
    #[inline(always)]
    fn range(&mut self) -> bool {
        let Scratch { low, high, middle, .. } = &mut *self.scratch;
        low.fill(f32::INFINITY);
        high.fill(f32::NEG_INFINITY);
        for &(start, end) in self.runs {
            let values = &self.samples.values[start * self.channels..end * self.channels];
            for value in values.chunks_exact(self.channels) {
                for ((low, high), &value) in low.iter_mut().zip(high.iter_mut()).zip(value) {
                    *low = low.min(value);
                    *high = high.max(value);
                }
            }
        }
        if low[0] > high[0] {
            low.fill(0.0);
            high.fill(0.0);
        }
        for ((middle, low), high) in middle.iter_mut().zip(low.iter()).zip(high.iter()) {
            *middle = 0.5 * low + 0.5 * high;
        }
        low == high
    }

    /// Sums up the normal equations; returns the sums of weights.
    #[inline(always)]
    fn accumulate<const FUSED: bool>(&mut self, slopes: usize) -> Lanes {
        let Scratch { matrix, right, phi, middle, .. } = &mut *self.scratch;
        let order = slopes + 1;
        let matrix = &mut matrix[..order * (order + 1) / 2];
        let right = &mut right[..order * self.channels];
        matrix.fill([0.0; LANES]);
        right.fill([0.0; LANES]);
        phi[slopes] = [1.0; LANES];
        let count = self.scales.bandwidths.len();
        for index in self.runs.iter().flat_map(|&(start, end)| start..end) {
            let mut weight = near::<FUSED>(self.samples.at[index], self.centres, self.leave_out);
            if weight.iter().all(|weight| *weight == 0.0) {
                continue;
            }
            let mut sum = [1.0_f32; LANES];
            let mut at = 0;
            let sample = &self.samples.guides[index * count..][..count];
            for (guide, &value) in sample.iter().enumerate() {
                let centre = &self.centres.guides[guide];
                let band = self.scales.bandwidths[guide];
                let slope = &mut phi[at];
                for i in 0..LANES {
                    slope[i] = value - centre[i];
                    let scaled = band * slope[i];
                    sum[i] = fma::<f32, FUSED>(scaled, scaled, sum[i]);
                }
                at += usize::from(self.scales.slopes[guide]);
                phi[slopes] = [1.0; LANES];
            }
            for i in 0..LANES {
                let inverse = 1.0 / (sum[i] * sum[i]);
                weight[i] *= inverse * inverse;
            }
            if let Some(&label) = self.samples.labels.get(index) {
                for (weight, own) in weight.iter_mut().zip(&self.centres.labels) {
                    *weight *= if label == *own { 1.0 } else { FOREIGN };
                }
            }
            let mut entry = 0;
            let values = &self.samples.values[index * self.channels..][..self.channels];
            for a in 0..order {
                let mut weighted = [0.0; LANES];
                for i in 0..LANES {
                    weighted[i] = weight[i] * phi[a][i];
                }
                for b in &phi[..=a] {
                    add::<FUSED>(&mut matrix[entry], &weighted, b);
                    entry += 1;
                }
                for (channel, &value) in values.iter().enumerate() {
                    let value = value - middle[channel];
                    let sum = &mut right[a * self.channels + channel];
                    for i in 0..LANES {
                        sum[i] = fma::<f32, FUSED>(weighted[i], value, sum[i]);
                    }
                }
            }
        }
        matrix[matrix.len() - 1]
    }

    /// Cholesky's factor, and forward substitution as far as the constant, which comes last.
    #[inline(always)]
    fn solve<const FUSED: bool>(&mut self, slopes: usize) {
        let Scratch { matrix, right, .. } = &mut *self.scratch;
        let order = slopes + 1;
        let at = |a: usize, b: usize| a * (a + 1) / 2 + b;
        for a in 0..order {
            let least = if a < slopes { RIDGE } else { f32::MIN_POSITIVE };
            for b in 0..=a {
                let mut sum = matrix[at(a, b)];
                if a == b && a < slopes {
                    sum = sum.map(|sum| sum + RIDGE);
                }
                for k in 0..b {
                    let (left, other) = (matrix[at(a, k)], matrix[at(b, k)]);
                    for i in 0..LANES {
                        sum[i] = fma::<f32, FUSED>(-left[i], other[i], sum[i]);
                    }
                }
                if a == b {
                    // Diagonals hold the inverse of the factor's.
                    matrix[at(a, a)] = sum.map(|sum| 1.0 / sum.max(0.5 * least).sqrt());
                } else {
                    let inverse = matrix[at(b, b)];
                    for i in 0..LANES {
                        sum[i] *= inverse[i];
                    }
                    matrix[at(a, b)] = sum;
                }
            }
            for channel in 0..self.channels {
                let mut sum = right[a * self.channels + channel];
                for k in 0..a {
                    let (left, other) = (matrix[at(a, k)], right[k * self.channels + channel]);
                    for i in 0..LANES {
                        sum[i] = fma::<f32, FUSED>(-left[i], other[i], sum[i]);
                    }
                }
                let inverse = matrix[at(a, a)];
                for i in 0..LANES {
                    sum[i] *= inverse[i];
                }
                right[a * self.channels + channel] = sum;
            }
        }
        let last = matrix[at(slopes, slopes)];
        for (channel, out) in self.out.iter_mut().enumerate() {
            let sum = &right[slopes * self.channels + channel];
            for i in 0..LANES {
                out[i] = sum[i] * last[i];
            }
        }
    }
}

#[inline(always)]
fn add<const FUSED: bool>(sum: &mut Lanes, a: &Lanes, b: &Lanes) {
    for i in 0..LANES {
        sum[i] = fma::<f32, FUSED>(a[i], b[i], sum[i]);
    }
}

/// How near a sample is to each pixel: 1 at the pixel, 0 from the radius on.
#[inline(always)]
fn near<const FUSED: bool>([row, column]: [f32; 2], centres: &Centres, leave_out: bool) -> Lanes {
    let mut weight = [0.0; LANES];
    let ([rows, columns], inverse) = (&centres.at, &centres.inverse);
    for i in 0..LANES {
        let (y, x) = (row - rows[i], column - columns[i]);
        let square = fma::<f32, FUSED>(y, y, x * x);
        let inside = fma::<f32, FUSED>(-square, inverse[i], 1.0).max(0.0);
        let own = leave_out && square == 0.0;
        weight[i] = if own { 0.0 } else { inside * inside };
    }
    weight
}

#[cfg(test)]
mod tests;
