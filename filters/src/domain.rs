//! Value domain: scene-linear values with a long range are interpolated as logarithms, all others as they are.
//!
//! A spline through 0.1, 0.1, 1000 swings by hundreds; through their logarithms it swings by a factor. The map is
//! `f(v) = asinh(v / s)`, back by `s sinh(u)`: near zero it is v / s, far from it a logarithm, it is odd, smooth and strictly
//! monotone over all reals, so that zero and negative values need no special care. One scale s serves all channels of
//! a group (R, G and B of a layer), so that equal channels stay equal: grey stays grey.
//!
//! The scale is the power mean of the measured values that are not zero, all channels together:
//! `s = (mean |v|^(1/4))^4`. It lies between the geometric mean, which a faint border drags to zero, and
//! the arithmetic, which the highlights dominate. [`Domain::Auto`] takes the logarithm where `max |v| > 50 l`, with `l` the same mean of what
//! is not black. Black is what a display of 8 bits shows as black where white is 1, or the largest absolute value if that
//! is less: a faint haze or the noise of a background counts as little as zeros do. As long as the largest is at most 1,
//! multiplying all values by a factor multiplies both sides; above, a darker frame has more black. Volume renders in [0, 1] stay below 20; 1000 beside 0.1 is above 50
//! as long as it covers less than about 3 of 10 pixels that are not black.
//!
//! Error: a value through f and back is off by at most `(2 + asinh |v / s|) eps / 2` of itself, eps = 2^-23. Measured
//! pixels do not go that way: the caller puts their bits back.
//! Cost: one f64 logarithm per measured pixel, one exponential per pixel back; nothing if the map is linear.
//! Fails: overshoot becomes a factor and does not vanish: see [`crate::limiter`].

use lacuna_core::parallel::prelude::*;
use serde::Serialize;

use crate::{Mask, Plane};

/// In which domain a group of channels is reconstructed.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash, Serialize)]
#[serde(rename_all = "kebab-case")]
pub enum Domain {
    /// Logarithmic where the range of the measured values asks for it, else linear.
    #[default]
    Auto,
    /// The values as they are.
    Linear,
    /// Logarithmic far from zero.
    Log,
}

/// The largest absolute value over the scale above which [`Domain::Auto`] takes the logarithm.
const LONG_RANGE: f64 = 50.0;

/// The least step of an 8-bit display from black, of white: the linear part of sRGB (IEC 61966-2-1).
const BLACK: f64 = 1.0 / (255.0 * 12.92);

impl Domain {
    /// The map for a group of channels, from its measured values; those must be finite.
    ///
    /// Linear if no measured value differs from zero. Each plane has the size of the mask.
    pub fn map(self, mask: &Mask, group: &[Plane]) -> Map {
        if self == Self::Linear {
            return Map::Linear;
        }
        let scale = power_mean(mask, group, 0.0);
        if scale > 0.0 && (self == Self::Log || has_long_range(mask, group)) {
            Map::Log { scale }
        } else {
            Map::Linear
        }
    }
}

fn has_long_range(mask: &Mask, group: &[Plane]) -> bool {
    let (lit, largest) = lit(mask, group);
    largest > LONG_RANGE * lit
}

/// The power mean of the measured values that are not black, and the largest absolute one.
pub(crate) fn lit(mask: &Mask, group: &[Plane]) -> (f64, f64) {
    let (black, largest) = black(mask, group);
    (power_mean(mask, group, black), largest)
}

/// Up to which absolute value a display shows black, and the largest measured one.
pub(crate) fn black(mask: &Mask, group: &[Plane]) -> (f64, f64) {
    let largest = group.iter().map(|plane| largest(mask, plane)).fold(0.0, f64::max);
    (BLACK * largest.min(1.0), largest)
}

/// The power mean of the measured values that are larger than `black`, whatever their sign; 0 if there is none.
fn power_mean(mask: &Mask, group: &[Plane], black: f64) -> f64 {
    let (sum, count) = group.iter().fold((0.0, 0_u64), |all, plane| {
        let (sum, count) = roots(mask, plane, black);
        (all.0 + sum, all.1 + count)
    });
    (sum / count.max(1) as f64).powi(4)
}

/// What is made of the sizes of the measured values of each row.
fn by_rows<R: Send>(
    mask: &Mask,
    plane: &Plane,
    row: impl Fn(&mut dyn Iterator<Item = f64>) -> R + Sync,
) -> Vec<R> {
    let width = mask.size().width.max(1);
    let rows = mask.as_slice().par_chunks(width).zip(plane.pixels().par_chunks(width));
    rows.map(|(flags, values)| {
        let measured = flags.iter().zip(values).filter(|(flag, _)| **flag);
        row(&mut measured.map(|(_, value)| f64::from(*value).abs()))
    })
}

/// The largest absolute measured value.
fn largest(mask: &Mask, plane: &Plane) -> f64 {
    by_rows(mask, plane, |sizes| sizes.fold(0.0, f64::max)).into_iter().fold(0.0, f64::max)
}

/// Of the measured values above black: the sum of their fourth roots, and their number.
fn roots(mask: &Mask, plane: &Plane, black: f64) -> (f64, u64) {
    let rows = by_rows(mask, plane, |sizes| {
        sizes
            .filter(|size| *size > black)
            .fold((0.0, 0), |(sum, count), size| (sum + size.sqrt().sqrt(), count + 1))
    });
    // In the order of the rows, whatever the threads.
    rows.into_iter().fold((0.0, 0), |all, row| (all.0 + row.0, all.1 + row.1))
}

/// A reversible, strictly monotone, odd map of the values of a group of channels.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
#[serde(rename_all = "kebab-case")]
pub enum Map {
    /// The identity.
    Linear,
    /// `factor v`: values in another unit. `factor` is a power of two, so that there and back no bit changes.
    Scaled {
        /// From 2^-126 to 2^126.
        factor: f32,
    },
    /// `asinh(v / scale)`.
    Log {
        /// Where the map turns from linear to logarithmic, in units of the values; positive.
        scale: f64,
    },
}

/// White, in scales, in frames of brighter light than displays show. Chosen, with the square root, on `hdr`, `gloss_reference` and photographs of
/// docs/measurements/methods.md; 2 did about as well.
const WHITE: f64 = 4.0;

/// Below this the series of asinh and sinh to third order are exact to f64, and the closed forms are not.
const SMALL: f64 = 1e-4;

/// Powers of two to either side of 1 within which the size of a group's values is left as it is: squares, and what the inverse of a wide
/// Gaussian multiplies by, are far from the ends of f32 there.
const USUAL: i32 = 20;

impl Map {
    /// The name that the report prints: `linear` or `log`.
    pub const fn name(self) -> &'static str {
        match self {
            Self::Linear | Self::Scaled { .. } => "linear",
            Self::Log { .. } => "log",
        }
    }

    /// Whether values stay as they are.
    pub fn is_linear(self) -> bool {
        self == Self::Linear
    }

    /// Whether values become logarithms.
    pub const fn is_log(self) -> bool {
        matches!(self, Self::Log { .. })
    }

    /// The map for solvers that take squares of values: a linear one of values whose squares would leave f32 becomes one to a unit in which they
    /// are about 1. So it is the power mean of all that are not zero, which a few that are far larger hardly move, that is brought to 1.
    /// Each plane has the size of the mask.
    pub(crate) fn in_range(self, mask: &Mask, group: &[Plane]) -> Self {
        let typical = if self.is_linear() { power_mean(mask, group, 0.0) } else { 0.0 };
        let exponent = (typical.to_bits() >> 52) as i32 - 1023;
        if typical > 0.0 && exponent.abs() > USUAL {
            let factor = f32::from_bits(((127 - exponent.clamp(-126, 126)) as u32) << 23);
            Self::Scaled { factor }
        } else {
            self
        }
    }

    /// Maps one value.
    pub fn forward(self, value: f32) -> f32 {
        match self {
            Self::Linear => value,
            Self::Scaled { factor } => value * factor,
            Self::Log { scale } => asinh(f64::from(value) / scale) as f32,
        }
    }

    /// What can be seen of a mapped value on a display, by which errors of light are compared: up to white, which is 1, or four times the
    /// scale where that is more, by its square root, about as displays encode it. It is odd: negative values count, too. Without logarithms the value itself.
    pub fn shown(self, mapped: f64) -> f64 {
        match self {
            Self::Linear => mapped,
            Self::Scaled { factor } => mapped / f64::from(factor),
            Self::Log { scale } => {
                let part = (mapped.sinh() / (1.0 / scale).max(WHITE)).clamp(-1.0, 1.0);
                part.abs().sqrt().copysign(part)
            }
        }
    }

    /// The derivative of the map at a value: what a derivative is multiplied by when the value is mapped.
    pub fn slope(self, value: f32) -> f32 {
        match self {
            Self::Linear => 1.0,
            Self::Scaled { factor } => factor,
            Self::Log { scale } => (1.0 / f64::from(value).hypot(scale)) as f32,
        }
    }

    /// Maps one value back. What would be beyond the largest f32 becomes that where values are logarithms.
    pub fn inverse(self, value: f32) -> f32 {
        match self {
            Self::Linear => value,
            Self::Scaled { factor } => value / factor,
            Self::Log { scale } => {
                let most = f64::from(f32::MAX);
                (scale * sinh(f64::from(value))).clamp(-most, most) as f32
            }
        }
    }

    /// Maps the measured pixels of a plane and sets the missing ones to zero; a linear map changes nothing.
    pub fn forward_plane(self, mask: &Mask, plane: &mut Plane) {
        if !self.is_linear() {
            let rows = plane.pixels_mut().par_chunks_mut(ROW).zip(mask.as_slice().par_chunks(ROW));
            rows.for_each(|(values, flags)| {
                for (value, flag) in values.iter_mut().zip(flags) {
                    *value = if *flag { self.forward(*value) } else { 0.0 };
                }
            });
        }
    }

    /// Maps all pixels of a plane back; the bits of measured ones are then for the caller to restore.
    pub fn inverse_plane(self, plane: &mut Plane) {
        if !self.is_linear() {
            plane.pixels_mut().par_chunks_mut(ROW).for_each(|values| {
                for value in values {
                    *value = self.inverse(*value);
                }
            });
        }
    }
}

/// Pixels that one task takes.
const ROW: usize = 4096;

/// To about 1e-12 of the result.
fn asinh(t: f64) -> f64 {
    let a = t.abs();
    let u = if a < SMALL { a - a * a * a / 6.0 } else { (a + (a * a + 1.0).sqrt()).ln() };
    u.copysign(t)
}

/// To about 1e-12 of the result.
fn sinh(u: f64) -> f64 {
    let a = u.abs();
    let t = if a < SMALL { a + a * a * a / 6.0 } else { 0.5 * (a.exp() - (-a).exp()) };
    t.copysign(u)
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;
    use crate::{Size, baseline::testing};

    /// A row with one value for each flag, all measured.
    fn row(values: &[f32]) -> (Mask, Plane) {
        let size = Size::new(1, values.len());
        (Mask::from_fn(size, |_, _| true), Plane::new(size, values.to_vec()).unwrap())
    }

    fn auto(values: &[f32]) -> Map {
        let (mask, plane) = row(values);
        Domain::Auto.map(&mask, &[plane])
    }

    #[test]
    fn auto_takes_the_logarithm_of_a_long_range_only() {
        let mut values = vec![0.1; 1000];
        assert_eq!(auto(&values), Map::Linear);
        values[7] = 1000.0;
        assert_eq!(auto(&values).name(), "log");
        values[..200].fill(1000.0);
        assert_eq!(auto(&values).name(), "log");
        values[..200].fill(-1000.0);
        assert_eq!(auto(&values).name(), "log");
        let ramp: Vec<f32> = (0..1000).map(|i| i as f32 / 1000.0).collect();
        assert_eq!(auto(&ramp), Map::Linear);
        // A soft volume: a quarter of what is not black lies below a thousandth.
        let soft: Vec<f32> = (1..1000).map(|i| (i as f32 / 1000.0).powi(5)).collect();
        assert_eq!(auto(&soft), Map::Linear);
        // Black does not count, nor a haze that looks like it.
        let mut sparse = vec![0.0; 10_000];
        sparse[..100].fill(0.5);
        assert_eq!(auto(&sparse), Map::Linear);
        for haze in [1e-12, 1e-5, -1e-5, 1e-4] {
            sparse[100..].fill(haze);
            assert_eq!(auto(&sparse), Map::Linear);
        }
        // Whoever asks for logarithms gets those of black, too.
        let (mask, plane) = row(&sparse);
        let Map::Log { scale } = Domain::Log.map(&mask, &[plane]) else { panic!("linear") };
        assert!(scale < 1e-3, "{scale}");
        // Of a dark frame, black is as much darker.
        let mut dark = vec![1e-8; 1000];
        dark[7] = 1e-5;
        assert_eq!(auto(&dark).name(), "log");
        assert_eq!(auto(&[0.0, -0.0]), Map::Linear);
        assert_eq!(Domain::Log.map(&row(&[0.0]).0, &[row(&[0.0]).1]), Map::Linear);
        assert_eq!(Domain::Linear.map(&row(&[0.1, 1e9]).0, &[row(&[0.1, 1e9]).1]), Map::Linear);
        assert_eq!(Domain::Log.map(&row(&[2.0]).0, &[row(&[2.0]).1]).name(), "log");
    }

    #[test]
    fn the_channels_of_a_group_decide_together_and_by_measured_pixels_only() {
        let size = Size::new(1, 400);
        let mask = Mask::from_fn(size, |_, x| x != 3);
        let plane = |peak: f32| Plane::from_fn(size, |_, x| if x == 9 { peak } else { 0.1 });
        let group = [plane(0.1), plane(900.0), plane(0.1)];
        let map = Domain::Auto.map(&mask, &group);
        assert_eq!(map.name(), "log");
        // One map, so that equal values of two channels stay equal.
        assert_eq!(Domain::Auto.map(&mask, &[group[1].clone(), plane(0.1), plane(0.1)]), map);
        let unseen = Plane::from_fn(size, |_, x| if x == 3 { f32::NAN } else { 0.1 });
        assert_eq!(Domain::Auto.map(&mask, &[unseen]), Map::Linear);
    }

    #[test]
    fn planes_follow_the_values() {
        let size = Size::new(3, 2000);
        let mask = Mask::from_fn(size, |y, x| (y + x) % 3 == 0);
        let plane = Plane::from_fn(size, |y, x| if (y + x) % 3 == 0 { x as f32 - 900.0 } else { f32::NAN });
        let map = Map::Log { scale: 0.7 };
        let mut mapped = plane.clone();
        map.forward_plane(&mask, &mut mapped);
        for ((mapped, flag), value) in mapped.pixels().iter().zip(mask.as_slice()).zip(plane.pixels()) {
            assert_eq!(mapped.to_bits(), if *flag { map.forward(*value) } else { 0.0 }.to_bits());
        }
        let mut back = mapped.clone();
        map.inverse_plane(&mut back);
        for (back, mapped) in back.pixels().iter().zip(mapped.pixels()) {
            assert_eq!(back.to_bits(), map.inverse(*mapped).to_bits());
        }
        let mut same = plane.clone();
        Map::Linear.forward_plane(&mask, &mut same);
        Map::Linear.inverse_plane(&mut same);
        assert!(same.pixels().iter().zip(plane.pixels()).all(|(a, b)| a.to_bits() == b.to_bits()));
    }

    #[test]
    fn the_slope_is_that_of_the_map() {
        let map = Map::Log { scale: 0.5 };
        for value in [-3.0_f32, -0.1, 0.0, 0.2, 40.0] {
            let h = 1e-2 * (1.0 + value.abs());
            let difference = (map.forward(value + h) - map.forward(value - h)) / (2.0 * h);
            assert!((map.slope(value) - difference).abs() <= 1e-2 * difference, "{value}");
        }
        assert_eq!(Map::Linear.slope(7.0), 1.0);
    }

    #[test]
    fn what_is_shown_ends_at_white() {
        for (scale, white) in [(0.01, 1.0), (0.25, 1.0), (3.0, 12.0)] {
            let map = Map::Log { scale };
            let shown = |value: f32| map.shown(f64::from(map.forward(value)));
            for (value, expected) in
                [(-9.0, -1.0), (-0.25, -0.5), (0.0, 0.0), (0.25, 0.5), (1.0, 1.0), (50.0, 1.0)]
            {
                let found = shown(value * white);
                assert!((found - expected).abs() <= 8.0 * f64::from(f32::EPSILON), "{value} {found}");
            }
        }
        assert_eq!(Map::Linear.shown(-7.0), -7.0);
    }

    #[test]
    fn what_is_too_large_becomes_the_largest() {
        let map = Map::Log { scale: 1.0 };
        assert_eq!(map.inverse(1e9).to_bits(), f32::MAX.to_bits());
        assert_eq!(map.inverse(-1e9).to_bits(), f32::MIN.to_bits());
        assert_eq!(map.forward(0.0).to_bits(), 0.0_f32.to_bits());
        assert_eq!(map.inverse(-0.0).to_bits(), (-0.0_f32).to_bits());
    }

    #[test]
    fn values_far_from_one_take_another_unit_without_a_bit_changed() {
        let of = |exponent: i32| {
            let values = [0.3, 1.0, -7.0, 0.0, 1e-3].map(|value: f32| value * 2.0_f32.powi(exponent));
            let (mask, plane) = row(&values);
            (Map::Linear.in_range(&mask, std::slice::from_ref(&plane)), values)
        };
        for exponent in [-126, -110, -40, -18, 0, 18, 40, 110, 124] {
            let (map, values) = of(exponent);
            assert_eq!(map.is_linear(), exponent.abs() <= 18, "{exponent}");
            assert!(map.name() == "linear" && !map.is_log());
            for value in values {
                assert_eq!(map.inverse(map.forward(value)).to_bits(), value.to_bits(), "{exponent}");
                assert_eq!(map.shown(f64::from(map.forward(value))), f64::from(value));
            }
            // About 1, whatever it was.
            assert!((1.0..=32.0).contains(&map.forward(values[2]).abs()) || map.is_linear(), "{exponent}");
        }
        // One value that is far larger is not what the others are squared for.
        let (mask, plane) = row(&[vec![1.0; 10_000], vec![1e20]].concat());
        assert!(Map::Linear.in_range(&mask, &[plane]).is_linear());
        let (mask, black) = row(&[0.0]);
        assert!(Map::Linear.in_range(&mask, &[black]).is_linear());
        let log = Map::Log { scale: 1e-30 };
        assert_eq!(log.in_range(&row(&[1e-30]).0, &[row(&[1e-30]).1]), log);
    }

    /// Normal values of every size and both signs.
    fn value() -> impl Strategy<Value = f32> {
        (-60.0..60.0_f32, any::<bool>()).prop_map(|(log, sign)| if sign { log.exp2() } else { -log.exp2() })
    }

    proptest! {
        #[test]
        fn there_and_back_within_the_stated_error(value in value(), log in -20.0..20.0_f64) {
            let scale = log.exp2();
            let map = Map::Log { scale };
            let back = map.inverse(map.forward(value));
            let size = f64::from(value).abs();
            let bound = (2.0 + (size / scale).asinh()) * f64::from(f32::EPSILON) / 2.0 * size;
            // Second-order terms and the 1e-12 of the f64 functions.
            prop_assert!(f64::from(back - value).abs() <= 1.0001 * bound, "{value} {back}");
        }

        #[test]
        fn the_functions_are_those_of_the_library(log in -40.0..8.0_f64) {
            let t = log.exp2();
            prop_assert!((asinh(t) / t.asinh() - 1.0).abs() < 4e-12);
            prop_assert!((sinh(t) / t.sinh() - 1.0).abs() < 4e-12);
        }

        #[test]
        fn it_is_odd_and_monotone(a in value(), b in value(), step in 1..1000_u32) {
            let map = Map::Log { scale: 0.3 };
            prop_assert_eq!(map.forward(-a).to_bits(), (-map.forward(a)).to_bits());
            prop_assert!(a > b || map.forward(a) <= map.forward(b));
            // Also between neighbours, and where the series takes over.
            for start in [a.abs(), 0.3 * SMALL as f32] {
                let next = f32::from_bits(start.to_bits() + step);
                prop_assert!(map.forward(start) <= map.forward(next));
                prop_assert!(map.inverse(start.min(50.0)) <= map.inverse(next.min(50.0)));
            }
        }

        #[test]
        fn a_factor_does_not_change_the_decision_below_white(
            values in prop::collection::vec(value(), 1..40), exponent in 0..30_i32,
        ) {
            let largest = values.iter().fold(0.0, |largest: f32, v| largest.max(v.abs()));
            // Powers of two multiply without rounding.
            let below = (-largest.log2().ceil()).exp2();
            let times = |factor: f32| auto(&values.iter().map(|v| v * factor).collect::<Vec<_>>());
            prop_assert_eq!(times(below).is_linear(), times(below * (-exponent as f32).exp2()).is_linear());
        }
    }

    #[test]
    fn threads_change_no_bit() {
        let size = Size::new(300, 111);
        let mask = Mask::from_fn(size, |y, x| (y * x) % 3 == 1);
        let plane = Plane::from_fn(size, |y, x| ((y * 131 + x * 17) % 1009) as f32 / 3.0 + 0.01);
        let with =
            |threads| testing::with_threads(threads, || Domain::Log.map(&mask, std::slice::from_ref(&plane)));
        let one = with(1);
        assert!(!one.is_linear());
        assert_eq!(one, with(2));
        assert_eq!(one, with(5));
    }
}
