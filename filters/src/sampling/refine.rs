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
//! Values enter as `t(v) = v` up to 1 and `1 + ln v` above, so that a highlight counts by its relative error; `t(-v) = -t(v)`. Those of a tiny
//! range are counted in a power of two, as f32 would not hold their squares.
//!
//! The next pixels are taken greedily, each where `e^2 d^2` is largest: a sample mends the area around it, too, which goes by `d^2`. With a
//! density `r` the squared error is `c l r^-3`, and its sum over the image is least where `c l r^-4` is the same everywhere. `d` is brought up to
//! date after each: a pixel beside one just taken has d = 1 and waits, so no clumps arise. Equal scores are taken in the order of the shuffle; where
//! the estimate is zero everywhere, that order is simply continued. Frames in a row, whose orders are not those of their first masks, then take what is farthest from all.
//!
//! Frames in a row choose by nearly the same image. So that they do not choose the same pixels, each has a shuffle order of its own, and the score of a pixel of rank r
//! in it is multiplied by `2^(-4 r)` ([`Preference`]). Of pixels beside each other, whose scores differ little, each frame then takes others. Turntables of engine, head and
//! aneurism (0.5 degrees a frame, 20 %, filled along with their neighbours) gained 0.2 to 0.6 dB by it, those of engine and head with the camera at rest 0.6 and 1.1 dB, and
//! nothing at 5 %. Single frames lost up to 0.4 dB or gained up to 0.1 dB, so that it is not done there.
//!
//! Cost: a fill of a spline, 9 of any other filter; O(N log N) for the picks; 8 planes. Fails: on noisy samples, whose noise looks like error.
//!
//! Source: Y. Eldar, M. Lindenbaum, M. Porat, Y. Zeevi, "The Farthest Point Strategy for
//! Progressive Image Sampling", IEEE Transactions on Image Processing 6(9), 1997 (greedy by distance, which this weighs).

use std::sync::Arc;

use lacuna_core::parallel::prelude::*;

use super::Field;
use super::leave_out::{self, LeftOut};
use crate::baseline::nearest::NearestMap;
use crate::baseline::push_pull;
use crate::kernel::blur::blur;
use crate::kernel::extremes;
use crate::variational::ss;
use crate::{Error, Filter, Mask, Plane, Planes, Run};

mod picks;
mod preference;
#[cfg(test)]
mod tests;

use picks::Picks;
pub use preference::Preference;

/// How exact a fill by parts is, over the range of the samples, and a spline near them. Choices from fills a hundred times as exact were no
/// better, on nine frames at 5, 10 and 20 %.
const ROUGH: f64 = 1e-2;
/// Steps of a tile, from a pyramid's image. 20 chose pixels no better (engine, head, tooth and aneurism-iso at 5, 10 and 20 %, two seeds).
const STEPS: usize = 12;
/// The same, from the fill of fewer samples; nor did 8 (engine-soft in place of tooth, three seeds).
const MORE: usize = 5;
/// Rows that one task takes.
const ROWS: usize = 16;
/// Pixels that one task takes.
const PIECE: usize = 1 << 16;
/// Trailing bits of a float that a bin leaves open: it is an eighth to a sixteenth of its values wide.
const BIN: u32 = 20;
/// Width of the neighbourhood of the leave-out error, in spacings.
const SPREAD: f64 = 0.6;
/// Width of the neighbourhood of the gradient, in spacings.
const CONTEXT: f64 = 1.2;
/// From this range of the samples on, f32 holds the square of a thousandth of it over the sixth power of any distance between samples.
const RANGE: f64 = 1.0 / (1 << 20) as f64;
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
    /// What these were multiplied by.
    unit: f32,
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
    let (samples, unit) = compressed(samples, mask);
    Ok(Estimate { unit, ..of_compressed(&samples, mask, filter, run)? })
}

/// The same of a spline; of the default one at the cost of a sweep of tiles.
///
/// # Errors
/// As [`estimate`].
pub fn estimate_spline(
    samples: &Planes,
    mask: &Arc<Mask>,
    settings: &ss::Settings,
    run: &Run<'_>,
) -> Result<Estimate, Error> {
    let (samples, unit) = compressed(samples, mask);
    let found = if leave_out::suits(settings) {
        Estimate::of_spline(&samples, mask, None, run)
    } else {
        of_compressed(&samples, mask, settings, run)
    };
    Ok(Estimate { unit, ..found? })
}

fn of_compressed(
    samples: &Planes,
    mask: &Arc<Mask>,
    filter: &dyn Filter,
    run: &Run<'_>,
) -> Result<Estimate, Error> {
    let left = leave_out::by_parts(samples, mask, filter, ROUGH, run)?;
    Estimate::new(mask, &left, leave_out::fill(samples, mask, filter, ROUGH, run)?, None)
}

impl Estimate {
    /// Of the default spline of samples as they count, with what is known from `before`: the fill of fewer of them or a [`start`], and the
    /// squared distances to all where there was one of fewer.
    pub(super) fn of_spline(
        samples: &Planes,
        mask: &Arc<Mask>,
        before: Option<(Planes, Option<Vec<u32>>)>,
        run: &Run<'_>,
    ) -> Result<Self, Error> {
        let (mut filled, squared, steps) = match before {
            Some((filled, Some(squared))) => (filled, Some(squared), MORE),
            Some((filled, None)) => (filled, None, STEPS),
            None => (start(samples, mask, run)?, None, STEPS),
        };
        ss::improve(mask, samples, (ROUGH, steps), &mut filled, run);
        let left = leave_out::of_spline(&ss::Settings::default(), mask, &filled);
        Self::new(mask, &left, filled, squared)
    }

    fn new(
        mask: &Arc<Mask>,
        left: &LeftOut,
        filled: Planes,
        squared: Option<Vec<u32>>,
    ) -> Result<Self, Error> {
        let size = mask.size();
        let spacing = mask.density().sqrt().recip();
        let LeftOut { error, distance, .. } = left;
        let ratio = local_gradient(&filled, CONTEXT * spacing);
        let above = blur(size, error, SPREAD * spacing);
        let below = blur(size, distance, SPREAD * spacing);
        // Far from every sample, in a hole, the frame's mean is all that is known.
        let (mean_above, mean_below) = (mean(error), mean(distance));
        let least = 1e-6 * mean_below;
        let mut coefficient = ratio;
        let around = above.par_chunks(PIECE).zip(below.par_chunks(PIECE));
        coefficient.par_chunks_mut(PIECE).zip(around).for_each(|(out, (above, below))| {
            for (out, (above, below)) in out.iter_mut().zip(above.iter().zip(below)) {
                let share = f64::from(*below) + least;
                let c = if share > 0.0 { (f64::from(*above) + 1e-6 * mean_above) / share } else { 0.0 };
                *out = (c * f64::from(*out)) as f32;
            }
        });
        let squared = squared.map_or_else(|| NearestMap::new(mask).map(|map| map.squared_distances()), Ok)?;
        Ok(Self { mask: mask.clone(), coefficient, squared, filled, unit: 1.0 })
    }

    /// The estimated error of each pixel, in the unit of the samples (root of the sum over channels of squares); 0 at
    /// measured ones.
    pub fn error(&self) -> Plane {
        let size = self.mask.size();
        let value = |pixel: usize| {
            self.coefficient[pixel].sqrt() * (self.squared[pixel] as f32).powf(1.5) / self.unit
        };
        Plane::from_fn(size, |row, column| value(row * size.width + column))
    }

    /// The squared error of a pixel, summed over the channels, as the samples count.
    pub(crate) fn squared_error(&self, pixel: usize) -> f32 {
        self.coefficient[pixel] * (self.squared[pixel] as f32).powi(3)
    }

    /// How many pixels have which squared errors, summed over the channels, in bins of [`BIN`]: the middle of each bin, and its count. The first
    /// bin, from zero to far below the least normal float, is left out; what is beyond all floats counts as infinite.
    pub(super) fn squared_errors(&self) -> Vec<(f32, usize)> {
        let values = self.coefficient.par_chunks(PIECE).zip(self.squared.par_chunks(PIECE));
        let pieces: Vec<Vec<u32>> = values.map(|(coefficients, squared)| {
            let mut counts = vec![0; 1 << (u32::BITS - BIN)];
            for (coefficient, &squared) in coefficients.iter().zip(squared) {
                let value = coefficient * (squared as f32).powi(3);
                counts[(value.to_bits() >> BIN) as usize] += 1;
            }
            counts
        });
        let middle = |bin: usize| f32::from_bits(((bin as u32) << BIN) | 1 << (BIN - 1));
        let count = |bin: usize| pieces.iter().map(|counts| counts[bin] as usize).sum::<usize>();
        let infinite = (f32::INFINITY.to_bits() >> BIN) as usize;
        let last = std::iter::once((f32::INFINITY, count(infinite)));
        (1..infinite)
            .map(|bin| (middle(bin), count(bin)))
            .chain(last)
            .filter(|(_, count)| *count > 0)
            .collect()
    }

    /// By how much the fill misses a pixel of these samples: the sum of squares over the channels.
    pub(super) fn misses(&self, samples: &Planes, pixel: usize) -> f64 {
        let planes = samples.as_slice().iter().zip(self.filled.as_slice());
        planes.map(|(y, x)| f64::from(y.pixels()[pixel] - x.pixels()[pixel]).powi(2)).sum()
    }

    /// The same where only these pixels count: no other errs.
    pub(super) fn within(mut self, counted: &Mask) -> Self {
        let others = self.coefficient.iter_mut().zip(counted.as_slice()).filter(|(_, counts)| !**counts);
        others.for_each(|(coefficient, _)| *coefficient = 0.0);
        self
    }

    /// The fill whose error it is, for the next one.
    pub(super) fn into_filled(self) -> Planes {
        self.filled
    }

    /// The next `count` pixels to compute, the most useful first, as indices row by row; fewer only if fewer are missing.
    ///
    /// `allowed` says which pixels may be taken, `preference` which ones of these rather, and `field` where the frame lies in its order.
    pub fn next(
        &self,
        count: usize,
        field: Field,
        preference: Preference,
        allowed: impl Fn(usize) -> bool + Sync,
    ) -> Vec<usize> {
        self.next_beside(&[], count, field, preference, allowed).0
    }

    /// The same beside others that are computed anyway; also the squared distances to what is measured then.
    pub fn next_beside(
        &self,
        others: &[usize],
        count: usize,
        field: Field,
        preference: Preference,
        allowed: impl Fn(usize) -> bool + Sync,
    ) -> (Vec<usize>, Vec<u32>) {
        let order = |pixel: usize, squared: u32| preference.order(field, pixel, squared);
        let preferred = preference.applied(&self.coefficient, field);
        let mut picks = Picks::new(self.mask.size(), &preferred, self.squared.clone());
        for &pixel in others {
            picks.take(pixel);
        }
        picks.next(count, &order, &allowed)
    }
}

/// A pyramid's image of the samples, from which their spline is found.
pub(super) fn start(samples: &Planes, mask: &Arc<Mask>, run: &Run<'_>) -> Result<Planes, Error> {
    leave_out::fill(samples, mask, &push_pull::Settings, ROUGH, run)
}

/// Samples as they count, and what they were multiplied by.
fn compressed(samples: &Planes, mask: &Mask) -> (Planes, f32) {
    let mut samples = samples.clone();
    let mut largest = 0.0_f64;
    for plane in samples.as_mut_slice() {
        plane.pixels_mut().iter_mut().for_each(|value| *value = compress(*value));
        let (low, high) = extremes::range(mask.as_slice(), plane.pixels());
        largest = largest.max(f64::from(high) - f64::from(low));
    }
    let unit = unit(largest);
    if unit > 1.0 {
        let values = samples.as_mut_slice().iter_mut().flat_map(Plane::pixels_mut);
        values.for_each(|value| *value *= unit);
    }
    (samples, unit)
}

/// The power of two that brings values of such a range near 1, as far as f32 has one; 1 where that is not needed.
pub(super) fn unit(range: f64) -> f32 {
    let is_tiny = range > 0.0 && range < RANGE;
    if is_tiny { 2.0_f32.powi(-range.log2().floor().max(-126.0) as i32) } else { 1.0 }
}

/// A value as it counts: linear to 1, logarithmic beyond.
pub(super) fn compress(value: f32) -> f32 {
    let size = value.abs();
    if size > 1.0 { (1.0 + size.ln()).copysign(value) } else { value }
}

/// The squared gradient over its mean in the neighbourhood, to the power of 3/4.
fn local_gradient(filled: &Planes, sigma: f64) -> Vec<f32> {
    let size = filled.size();
    let mut gradient = vec![0.0_f32; size.pixels()];
    gradient.par_chunks_mut(size.width.max(1)).enumerate().with_min_len(ROWS).for_each(|(row, gradient)| {
        let (above, below) = (row.saturating_sub(1), (row + 1).min(size.height - 1));
        for plane in filled.as_slice() {
            // Central differences; one-sided at the border, over the distance that they span.
            let part = 1.0 / (below - above).max(1) as f32;
            let vertical = plane.row(above).iter().zip(plane.row(below));
            for (gradient, (above, below)) in gradient.iter_mut().zip(vertical) {
                *gradient += (part * (below - above)).powi(2);
            }
            let own = plane.row(row);
            let inner = gradient.iter_mut().skip(1).zip(own.iter().zip(own.iter().skip(2)));
            for (gradient, (left, right)) in inner {
                *gradient += (0.5 * (right - left)).powi(2);
            }
            if let ([first, second, ..], [.., before, last]) = (own, own) {
                gradient[0] += (second - first).powi(2);
                gradient[own.len() - 1] += (last - before).powi(2);
            }
        }
    });
    let floor = (FLOOR * mean(&gradient)) as f32;
    let around = blur(size, &gradient, sigma);
    gradient.par_chunks_mut(PIECE).zip(around.par_chunks(PIECE)).for_each(|(gradient, around)| {
        for (g, around) in gradient.iter_mut().zip(around) {
            let ratio = if around + floor > 0.0 { (*g + floor) / (around + floor) } else { 1.0 };
            let root = ratio.sqrt();
            *g = root * root.sqrt();
        }
    });
    gradient
}

fn mean(values: &[f32]) -> f64 {
    let sum = |values: &[f32]| values.iter().map(|&value| f64::from(value)).sum::<f64>();
    let sums: Vec<f64> = values.par_chunks(PIECE).map(sum);
    sums.into_iter().sum::<f64>() / values.len().max(1) as f64
}
