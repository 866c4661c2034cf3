//! The values that all but a few samples have.
//!
//! A few hot pixels, however bright, must decide nothing about all others: neither the range that disagreements are compared with, nor sums of squares.
//! So what lies beyond the quantiles of [`SHARE`] at either end, or beyond these by more than what is between them, counts as if it lay there. Of values
//! without such samples, every one is itself.
//!
//! Cost: a selection among the values. Fails: where all but a few values are the same, which then say nothing: all count as they are.
//!
//! Source: J. Tukey, "Exploratory Data Analysis", 1977 (fences); W. Dixon, "Simplified estimation from censored normal samples", Annals of
//! Mathematical Statistics 31, 1960 (winsorizing).

use lacuna_core::parallel::prelude::*;

use super::{Carried, PIECE, Taps};
use crate::kernel::extremes;
use crate::{Mask, Plane, Planes};

/// The part of the values, at either end, that may be anything.
const SHARE: f64 = 0.005;

/// A range of values.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Usual {
    low: f32,
    high: f32,
}

impl Usual {
    /// Between the quantiles of those that are finite.
    pub fn of(values: impl Iterator<Item = f32>) -> Self {
        let mut values: Vec<f32> = values.filter(|value| value.is_finite()).collect();
        let Some(last) = values.len().checked_sub(1) else { return Self { low: 0.0, high: 0.0 } };
        let beyond = (values.len() as f64 * SHARE) as usize;
        let mut at = |rank: usize| *values.select_nth_unstable_by(rank, f32::total_cmp).1;
        let (low, high) = (at(beyond), at(last - beyond));
        if low < high { Self { low, high } } else { Self { low: at(0), high: at(last) } }
    }

    /// Of the measured values of a plane.
    pub fn measured(mask: &Mask, plane: &Plane) -> Self {
        let values = plane.pixels().iter().zip(mask.as_slice());
        Self::of(values.filter(|(_, flag)| **flag).map(|(value, _)| *value))
    }

    /// With as much again on either side: what is beyond is an outlier.
    pub fn widened(self) -> Self {
        let wide = self.high - self.low;
        Self { low: (self.low - wide).max(f32::MIN), high: (self.high + wide).min(f32::MAX) }
    }

    /// The value of the range that is nearest; NaN stays.
    pub fn clamp(self, value: f32) -> f32 {
        value.clamp(self.low, self.high)
    }
}

/// How wide the range of the measured values is without outliers.
pub fn wide(mask: &Mask, plane: &Plane) -> f64 {
    let (low, high) = extremes::range(mask.as_slice(), plane.pixels());
    let usual = Usual::measured(mask, plane).widened();
    (f64::from(usual.clamp(high)) - f64::from(usual.clamp(low))).max(0.0)
}

/// The ranges of the measured values without outliers, by plane.
pub fn usual_of(samples: &Planes, mask: &Mask) -> Vec<Usual> {
    samples.as_slice().iter().map(|plane| Usual::measured(mask, plane).widened()).collect()
}

/// Values within these ranges.
pub fn within(planes: &Planes, usual: &[Usual]) -> Planes {
    let mut planes = planes.clone();
    for (plane, usual) in planes.as_mut_slice().iter_mut().zip(usual) {
        plane.pixels_mut().iter_mut().for_each(|value| *value = usual.clamp(*value));
    }
    planes
}

/// An image without outliers.
pub fn clamped(image: &Planes) -> Planes {
    let everything = Mask::from_fn(image.size(), |_, _| true);
    within(image, &usual_of(image, &everything))
}

/// The usual values of samples, by plane.
pub fn of_samples(carried: &Carried) -> Vec<Usual> {
    carried.values.iter().map(|values| Usual::of(values.iter().copied())).collect()
}

/// By how much an image misses samples, squared and summed up, of what is usual in either.
pub fn missed(carried: &Carried, image: &Planes, usual: &[Usual]) -> f64 {
    let one = |i: usize| {
        let [y, x] = carried.places[i];
        let taps = Taps::new(image.size(), y, x);
        let planes = image.as_slice().iter().zip(&carried.values).zip(usual);
        let squares = planes.map(|((plane, values), usual)| {
            f64::from(usual.clamp(values[i]) - usual.clamp(taps.of(plane))).powi(2)
        });
        squares.sum::<f64>()
    };
    let all = (0..carried.len()).into_par_iter().with_min_len(PIECE).map(one);
    all.into_iter().filter(|off| off.is_finite()).sum()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::Size;

    #[test]
    fn few_values_decide_nothing_and_others_are_themselves() {
        let values = || (0..1000).map(|k| k as f32 / 999.0);
        let usual = Usual::of(values()).widened();
        assert!(values().all(|value| usual.clamp(value).to_bits() == value.to_bits()));
        for hot in [20.0, 1e30, f32::INFINITY, f32::NAN] {
            let spoiled = Usual::of(values().chain([hot, -hot])).widened();
            assert!((spoiled.low - usual.low).abs() < 0.01 && (spoiled.high - usual.high).abs() < 0.01);
        }
    }

    #[test]
    fn a_range_is_as_it_was_but_for_outliers() {
        let size = Size::new(20, 30);
        let mask = Mask::from_fn(size, |y, x| (y + x) % 2 == 0);
        let mut plane = Plane::from_fn(size, |y, x| 0.1 + (y * 30 + x) as f32 / 1000.0);
        let (low, high) = extremes::range(mask.as_slice(), plane.pixels());
        let before = wide(&mask, &plane);
        assert!((before - f64::from(high - low)).abs() < 1e-6);
        plane.pixels_mut()[0] = 1e4;
        assert!(wide(&mask, &plane) < 2.1 * before);
        // Of what is the same all over, single values are all that there is.
        let mut flat = Plane::filled(size, 0.0);
        flat.pixels_mut()[0] = 2.0;
        assert!((wide(&mask, &flat) - 2.0).abs() < 1e-6 && Usual::of(std::iter::empty()).low == 0.0);
    }
}
