//! The second pass: where a fill is likely wrong, and which pixels to compute next.
//!
//! Given samples `y` (a group of channels) at the pixels of a mask `m` with measured pixels `M`, the squared error of the
//! fill at a missing pixel x is modelled as `e(x)^2 = c(x) l(x) d(x)^6`:
//!
//! - `d(x)`: distance to the nearest measured pixel. A spline of third order errs like the cube of it where the image is smooth.
//! - `c(x)`: leave-out error (`leave_out.rs`): the squared error of the very filter of the fill where a sample was left out, over the
//!   sixth power of its distance to the samples that were kept: `c = G_s * e_out^2 / G_s * d_out^6` over M, with `G_s` a Gaussian of standard deviation
//!   0.6 spacings (spacing: `sqrt(1 / density)`).
//! - `l(x) = (g / G_t * g)^0.75`: where within that neighbourhood, `g` the squared gradient of the fill over all channels,
//!   `G_t` a Gaussian of 1.2 spacings. This finds the edge that passes between samples.
//!
//! Values enter as `t(v) = v` up to 1 and `1 + ln v` above, so that a highlight counts by its relative error.
//!
//! The next pixels are taken greedily, each where `e^2 d^2` is largest: a sample mends the area around it, too, which goes by `d^2`. With a
//! density `r` the squared error is `c l r^-3`, and its sum over the image is least where `c l r^-4` is the same everywhere. `d` is brought up to
//! date after each: a pixel beside one just taken has d = 1 and waits, so no clumps arise. Equal scores are taken in the order of the shuffle; where
//! the estimate is zero everywhere, that order is simply continued.
//!
//! Cost: a fill of a spline, 9 of any other filter; O(N log N) for the picks; 8 planes. Fails: on noisy samples, whose noise looks like error.
//!
//! Source: Y. Eldar, M. Lindenbaum, M. Porat, Y. Zeevi, "The Farthest Point Strategy for
//! Progressive Image Sampling", IEEE Transactions on Image Processing 6(9), 1997 (greedy by distance, which this weighs).

use std::cmp::Reverse;
use std::collections::BinaryHeap;
use std::sync::Arc;

use super::leave_out::{self, LeftOut};
use super::{Field, shuffle};
use crate::baseline::nearest::NearestMap;
use crate::variational::ss;
use crate::{Error, Filter, Mask, Plane, Planes, Run, Size};

/// Width of the neighbourhood of the leave-out error, in spacings.
const SPREAD: f64 = 0.6;
/// Width of the neighbourhood of the gradient, in spacings.
const CONTEXT: f64 = 1.2;
/// Power of the ratio of gradients.
const DETAIL: f32 = 0.75;
/// Share of its mean that is added to the squared gradient, so that flat regions have a ratio.
const FLOOR: f64 = 1e-6;

/// What is known about the error of a fill.
#[derive(Clone, Debug)]
pub struct Estimate {
    mask: Arc<Mask>,
    /// `c l`: the squared error per sixth power of the distance.
    coefficient: Vec<f32>,
    /// Squared distance to the nearest measured pixel.
    squared: Vec<u32>,
    /// The fill whose error it is, of the samples as they count.
    filled: Planes,
}

/// Estimates the error of `filter` on these samples.
///
/// `samples` holds finite values at measured pixels; what it holds elsewhere is not read.
///
/// # Errors
/// Those of the filter: [`Error::EmptyMask`], [`Error::SizeMismatch`], [`Error::NotFinite`].
pub fn estimate(
    samples: &Planes,
    mask: &Arc<Mask>,
    filter: &dyn Filter,
    run: &Run<'_>,
) -> Result<Estimate, Error> {
    let samples = compressed(samples);
    let left = leave_out::by_parts(&samples, mask, filter, run)?;
    Estimate::new(mask, &left, leave_out::fill(&samples, mask, filter, run)?)
}

/// The same of a spline; of one that `leave_out::of_spline` knows at the cost of one fill.
///
/// # Errors
/// As [`estimate`].
pub fn estimate_spline(
    samples: &Planes,
    mask: &Arc<Mask>,
    settings: &ss::Settings,
    run: &Run<'_>,
) -> Result<Estimate, Error> {
    if !leave_out::suits(settings) {
        return estimate(samples, mask, settings, run);
    }
    let samples = compressed(samples);
    let filled = leave_out::fill(&samples, mask, settings, run)?;
    Estimate::new(mask, &leave_out::of_spline(settings, mask, &filled), filled)
}

impl Estimate {
    fn new(mask: &Arc<Mask>, left: &LeftOut, filled: Planes) -> Result<Self, Error> {
        let size = mask.size();
        let spacing = mask.density().sqrt().recip();
        let LeftOut { error, distance } = left;
        let ratio = local_gradient(&filled, CONTEXT * spacing);
        let above = blur(size, error, SPREAD * spacing);
        let below = blur(size, distance, SPREAD * spacing);
        // Far from every sample, in a hole, the frame's mean is all that is known.
        let (mean_above, mean_below) = (mean(error), mean(distance));
        let least = 1e-6 * mean_below;
        let coefficient = above.iter().zip(&below).zip(&ratio).map(|((above, below), ratio)| {
            let share = f64::from(*below) + least;
            let c = if share > 0.0 { (f64::from(*above) + 1e-6 * mean_above) / share } else { 0.0 };
            (c * f64::from(*ratio)) as f32
        });
        let coefficient = coefficient.collect();
        Ok(Self { mask: mask.clone(), coefficient, squared: squared_distances(mask)?, filled })
    }

    /// The estimated error of each pixel, in the unit of the samples (root of the sum over channels of squares); 0 at
    /// measured ones.
    pub fn error(&self) -> Plane {
        let size = self.mask.size();
        let value = |pixel: usize| self.coefficient[pixel].sqrt() * (self.squared[pixel] as f32).powf(1.5);
        Plane::from_fn(size, |row, column| value(row * size.width + column))
    }

    /// The squared error of a pixel, summed over the channels.
    pub(super) fn squared_error(&self, pixel: usize) -> f32 {
        self.coefficient[pixel] * (self.squared[pixel] as f32).powi(3)
    }

    /// By how much the fill misses a pixel of these samples: the sum of squares over the channels.
    pub(super) fn misses(&self, samples: &Planes, pixel: usize) -> f64 {
        let planes = samples.as_slice().iter().zip(self.filled.as_slice());
        planes.map(|(y, x)| f64::from(y.pixels()[pixel] - x.pixels()[pixel]).powi(2)).sum()
    }

    /// The fill whose error it is.
    pub(super) fn filled(&self) -> &Planes {
        &self.filled
    }

    /// The next `count` pixels to compute, the most useful first, as indices row by row; fewer only if fewer are missing.
    ///
    /// `allowed` says which pixels may be taken; `seed` is that of the shuffle order that decides between equals, and
    /// `field` where the frame lies in it.
    pub fn next(&self, count: usize, field: Field, seed: u64, allowed: impl Fn(usize) -> bool) -> Vec<usize> {
        self.next_beside(&[], count, field, seed, allowed)
    }

    /// The same beside others that are computed anyway.
    pub(super) fn next_beside(
        &self,
        others: &[usize],
        count: usize,
        field: Field,
        seed: u64,
        allowed: impl Fn(usize) -> bool,
    ) -> Vec<usize> {
        let size = self.mask.size();
        let mut squared = self.squared.clone();
        for &pixel in others {
            take(size, &mut squared, pixel);
        }
        let order = |pixel: usize| {
            let (x, y) = field.at(pixel / size.width, pixel % size.width);
            (shuffle::rank(x, y, seed) * f64::from(u32::MAX)) as u32
        };
        let missing = (0..size.pixels()).filter(|&pixel| squared[pixel] > 0 && allowed(pixel));
        // A score only falls as pixels are taken, so a stale entry is found out when it comes to the top.
        let mut heap: BinaryHeap<(u32, Reverse<u32>, Reverse<usize>)> = missing
            .map(|pixel| (self.gain(pixel, squared[pixel]), Reverse(order(pixel)), Reverse(pixel)))
            .collect();
        let mut taken = Vec::with_capacity(count.min(heap.len()));
        while taken.len() < count {
            let Some((score, tie, Reverse(pixel))) = heap.pop() else { break };
            let now = self.gain(pixel, squared[pixel]);
            if now < score {
                heap.push((now, tie, Reverse(pixel)));
                continue;
            }
            take(size, &mut squared, pixel);
            taken.push(pixel);
        }
        taken
    }

    /// What measuring a pixel at this squared distance from all others is worth, as bits, which order like the non-negative floats they are.
    fn gain(&self, pixel: usize, squared: u32) -> u32 {
        (self.coefficient[pixel] * (squared as f32).powi(4)).max(0.0).to_bits()
    }
}

/// Samples as they count.
fn compressed(samples: &Planes) -> Planes {
    let mut samples = samples.clone();
    for plane in samples.as_mut_slice() {
        plane.pixels_mut().iter_mut().for_each(|value| *value = compress(*value));
    }
    samples
}

/// A value as it counts: linear to 1, logarithmic above.
pub(super) fn compress(value: f32) -> f32 {
    if value > 1.0 { 1.0 + value.ln() } else { value }
}

/// Squared distance of each pixel to the nearest measured one.
pub(super) fn squared_distances(mask: &Mask) -> Result<Vec<u32>, Error> {
    let map = NearestMap::new(mask)?;
    let width = mask.size().width;
    let squared = |(pixel, source): (usize, usize)| {
        let (dy, dx) = ((pixel / width).abs_diff(source / width), (pixel % width).abs_diff(source % width));
        u32::try_from(dy * dy + dx * dx).unwrap_or(u32::MAX)
    };
    Ok(map.as_slice().iter().enumerate().map(|(pixel, source)| squared((pixel, *source as usize))).collect())
}

/// A power of the squared gradient over its mean in the neighbourhood.
fn local_gradient(filled: &Planes, sigma: f64) -> Vec<f32> {
    let size = filled.size();
    let mut gradient = vec![0.0_f32; size.pixels()];
    for plane in filled.as_slice() {
        for row in 0..size.height {
            let (above, below) = (row.saturating_sub(1), (row + 1).min(size.height - 1));
            for column in 0..size.width {
                let (left, right) = (column.saturating_sub(1), (column + 1).min(size.width - 1));
                // Central differences; one-sided at the border, over the distance that they span.
                let dy = (plane.at(below, column) - plane.at(above, column)) / (below - above).max(1) as f32;
                let dx = (plane.at(row, right) - plane.at(row, left)) / (right - left).max(1) as f32;
                gradient[row * size.width + column] += dy * dy + dx * dx;
            }
        }
    }
    let floor = (FLOOR * mean(&gradient)) as f32;
    let around = blur(size, &gradient, sigma);
    let ratio = |(g, around): (&f32, &f32)| {
        if around + floor > 0.0 { ((g + floor) / (around + floor)).powf(DETAIL) } else { 1.0 }
    };
    gradient.iter().zip(&around).map(ratio).collect()
}

fn mean(values: &[f32]) -> f64 {
    values.iter().map(|&value| f64::from(value)).sum::<f64>() / values.len().max(1) as f64
}

/// Marks a pixel as measured: those that are nearer to it than to any other learn so.
///
/// The pixels that change surround the new one without a gap (they are its Voronoi cell), so they are found by spreading.
fn take(size: Size, squared: &mut [u32], pixel: usize) {
    let (row, column) = (pixel / size.width, pixel % size.width);
    squared[pixel] = 0;
    let mut open = vec![(row, column)];
    while let Some((y, x)) = open.pop() {
        for y in y.saturating_sub(1)..(y + 2).min(size.height) {
            for x in x.saturating_sub(1)..(x + 2).min(size.width) {
                let new = u32::try_from(y.abs_diff(row).pow(2) + x.abs_diff(column).pow(2));
                let old = &mut squared[y * size.width + x];
                if let Some(new) = new.ok().filter(|new| *new < *old) {
                    *old = new;
                    open.push((y, x));
                }
            }
        }
    }
}

/// Convolves with a Gaussian of standard deviation `sigma` pixels, cut at four of them; zero outside of the image.
pub(crate) fn blur(size: Size, values: &[f32], sigma: f64) -> Vec<f32> {
    let reach = (4.0 * sigma).ceil() as usize;
    let weights: Vec<f32> =
        (0..=reach).map(|d| (-((d * d) as f64) / (2.0 * sigma * sigma)).exp() as f32).collect();
    let total = 2.0 * weights.iter().sum::<f32>() - weights[0];
    let mut rows = vec![0.0; values.len()];
    for (out, row) in rows.chunks_exact_mut(size.width.max(1)).zip(values.chunks_exact(size.width.max(1))) {
        for (d, weight) in weights.iter().enumerate().take(size.width) {
            let weight = weight / total;
            for x in 0..size.width - d {
                out[x] += weight * row[x + d];
            }
            if d > 0 {
                for x in d..size.width {
                    out[x] += weight * row[x - d];
                }
            }
        }
    }
    let mut out = vec![0.0; values.len()];
    for y in 0..size.height {
        let target = &mut out[y * size.width..][..size.width];
        for v in y.saturating_sub(reach)..(y + reach + 1).min(size.height) {
            let weight = weights[y.abs_diff(v)] / total;
            for (value, row) in target.iter_mut().zip(&rows[v * size.width..][..size.width]) {
                *value += weight * row;
            }
        }
    }
    out
}

#[cfg(test)]
#[path = "refine/tests.rs"]
mod tests;
