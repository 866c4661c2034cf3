//! Noise like that of samples, from what a renderer tells of it: half buffers, or the variance of each pixel's mean.

use lacuna_core::hash;

use super::Noise;
use crate::{Mask, Plane, Planes};

/// How far the mean of two halves may be from the samples, over the larger of these and their mean level: rounding of halves.
const ROUNDING: f32 = 0.02;
/// The share of pixels that may be further off.
const FEW: f64 = 0.02;

/// Why half buffers or variances tell no noise.
#[derive(Clone, Copy, Debug, PartialEq, thiserror::Error)]
pub enum Untold {
    /// Two halves that are one.
    #[error("both halves are the same")]
    SameHalves,
    /// Halves of another image.
    #[error("the halves do not average to the image")]
    OtherHalves,
    /// A value that no variance has, at a measured pixel.
    #[error("{0} at a measured pixel is no variance")]
    Negative(f32),
    /// No noise at any measured pixel, though the samples are not all the same.
    #[error("nowhere above 0 and finite at measured pixels")]
    Nowhere,
    /// No noise that is known there.
    #[error("not finite at any measured pixel")]
    NotFinite,
}

impl Noise {
    /// Half the difference of two half buffers, whose mean is `samples`; NaN at the few measured pixels where it is not, as where only the samples
    /// were clamped.
    ///
    /// # Errors
    /// The halves are the same, or those of something else.
    pub fn of_halves(samples: &Plane, halves: [&Plane; 2], mask: &Mask) -> Result<Plane, Untold> {
        let [first, second] = halves.map(Plane::pixels);
        let measured = || mask.as_slice().iter().enumerate().filter(|(_, flag)| **flag).map(|(at, _)| at);
        let finite = |at: &usize| samples.pixels()[*at].is_finite();
        let count = measured().filter(finite).count().max(1) as f64;
        let sum: f64 = measured().filter(finite).map(|at| f64::from(samples.pixels()[at]).abs()).sum();
        let level = (sum / count) as f32;
        let off = |at: &usize| {
            let (mean, value) = (0.5 * (first[*at] + second[*at]), samples.pixels()[*at]);
            mean.is_finite() && (mean - value).abs() > ROUNDING * value.abs().max(level)
        };
        if measured().filter(finite).filter(off).count() as f64 > FEW * count {
            let same = measured().all(|at| first[at] == second[at]);
            return Err(if same { Untold::SameHalves } else { Untold::OtherHalves });
        }
        let mut half = Plane::from_fn(samples.size(), |row, column| {
            0.5 * (halves[0].at(row, column) - halves[1].at(row, column))
        });
        measured().filter(off).for_each(|at| half.pixels_mut()[at] = f32::NAN);
        Ok(half)
    }

    /// Noise of this variance at each pixel, drawn by a seed; NaN where the variance is not finite or below 0.
    #[must_use]
    pub fn of_variance(variance: &Plane, seed: u64) -> Plane {
        let mut at = 0_u64;
        let uniform = |value: u64| ((hash(seed, value) >> 11) as f64 + 0.5) / (1_u64 << 53) as f64;
        Plane::from_fn(variance.size(), |row, column| {
            let (a, b) = (uniform(2 * at), uniform(2 * at + 1));
            at += 1;
            let normal = (-2.0 * a.ln()).sqrt() * (std::f64::consts::TAU * b).cos();
            let variance = Some(variance.at(row, column)).filter(|variance| variance.is_finite());
            (f64::from(variance.unwrap_or(f32::NAN)).sqrt() * normal) as f32
        })
    }

    /// The same of the plane of that number in its group, each its own draw, as noise of channels differs.
    ///
    /// # Errors
    /// A variance below 0 at a measured pixel.
    pub fn of_variance_at(variance: &Plane, number: usize, mask: &Mask) -> Result<Plane, Untold> {
        const SEED: u64 = 1;
        let mut pixels = variance.pixels().iter().zip(mask.as_slice());
        match pixels.find(|(value, flag)| **flag && **value < 0.0) {
            Some((value, _)) => Err(Untold::Negative(*value)),
            None => Ok(Self::of_variance(variance, SEED.wrapping_add(number as u64))),
        }
    }

    /// What planes of noise tell of the samples: none where all is 0 and the samples of each plane are the same.
    ///
    /// # Errors
    /// All is 0, or nothing is known, though samples differ.
    pub fn like(planes: Vec<Plane>, samples: &Planes, mask: &Mask) -> Result<Self, Untold> {
        let measured = |plane: &Plane, holds: &dyn Fn(f32) -> bool| {
            let mut pixels = plane.pixels().iter().zip(mask.as_slice());
            pixels
                .find(|(value, flag)| **flag && value.is_finite() && holds(**value))
                .map(|(value, _)| *value)
        };
        if planes.iter().any(|plane| measured(plane, &|noise| noise != 0.0).is_some()) {
            return Ok(Self::Like(planes));
        }
        let flat = |plane: &Plane| {
            measured(plane, &|_| true).is_none_or(|first| measured(plane, &|value| value != first).is_none())
        };
        if samples.as_slice().iter().all(flat) {
            return Ok(Self::None);
        }
        let is_known = planes.iter().any(|plane| measured(plane, &|_| true).is_some());
        Err(if is_known { Untold::Nowhere } else { Untold::NotFinite })
    }
}
