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
//! is less: a faint haze or the noise of a background counts as little as zeros do. Where samples lie unevenly each counts for the pixels that it is
//! the nearest of, as rounds crowd onto highlights. As long as the largest is at most 1,
//! multiplying all values by a factor multiplies both sides; above, a darker frame has more black. Volume renders in [0, 1] stay below 20; 1000 beside 0.1 is above 50
//! as long as it covers less than about 3 of 10 pixels that are not black.
//!
//! Error: a value through f and back is off by at most `(2 + asinh |v / s|) eps / 2` of itself, eps = 2^-23. Measured
//! pixels do not go that way: the caller puts their bits back.
//! Cost: the nearest sample of each pixel; one f64 logarithm per measured pixel, one exponential per pixel back; nothing if the map is linear.
//! Fails: overshoot becomes a factor and does not vanish: see [`crate::limiter`].

use lacuna_core::parallel::prelude::*;
use serde::Serialize;

use crate::baseline::nearest::{Cells, NearestMap};
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
        let scale = power_mean(mask, group, (0.0, None));
        if scale > 0.0 && (self == Self::Log || has_long_range(mask, group)) {
            Map::Log { scale }
        } else {
            Map::Linear
        }
    }
}

fn has_long_range(mask: &Mask, group: &[Plane]) -> bool {
    let (black, largest) = black(mask, group);
    largest > LONG_RANGE * power_mean(mask, group, (black, cells(mask).as_ref()))
}

/// How many pixels each measured one is the nearest of, where samples lie unevenly.
fn cells(mask: &Mask) -> Option<Cells> {
    let map = (!mask.is_full()).then(|| NearestMap::new(mask).ok())??;
    Some(Cells::new(mask, Some(&map))).filter(Cells::is_uneven)
}

/// The power mean of the measured values that are not black, and the largest absolute one.
pub(crate) fn lit(mask: &Mask, group: &[Plane]) -> (f64, f64) {
    let (black, largest) = black(mask, group);
    (power_mean(mask, group, (black, None)), largest)
}

/// Up to which absolute value a display shows black, and the largest measured one.
pub(crate) fn black(mask: &Mask, group: &[Plane]) -> (f64, f64) {
    let largest = group.iter().map(|plane| largest(mask, plane)).fold(0.0, f64::max);
    (BLACK * largest.min(1.0), largest)
}

/// The power mean of the measured values that are larger than `black`, whatever their sign, each counted once or for its cell; 0 if there is none.
fn power_mean(mask: &Mask, group: &[Plane], (black, cells): (f64, Option<&Cells>)) -> f64 {
    let (sum, count) = group.iter().fold((0.0, 0_u64), |all, plane| {
        let (sum, count) = roots(mask, plane, (black, cells));
        (all.0 + sum, all.1 + count)
    });
    (sum / count.max(1) as f64).powi(4)
}

/// What is made of the sizes of the measured values of each row, each behind its pixel.
fn by_rows<R: Send>(
    mask: &Mask,
    plane: &Plane,
    row: impl Fn(&mut dyn Iterator<Item = (usize, f64)>) -> R + Sync,
) -> Vec<R> {
    let width = mask.size().width.max(1);
    let rows = mask.as_slice().par_chunks(width).zip(plane.pixels().par_chunks(width));
    rows.enumerate().map(|(y, (flags, values))| {
        let measured = (y * width..).zip(flags.iter().zip(values)).filter(|(_, (flag, _))| **flag);
        row(&mut measured.map(|(pixel, (_, value))| (pixel, f64::from(*value).abs())))
    })
}

/// The largest absolute measured value.
fn largest(mask: &Mask, plane: &Plane) -> f64 {
    let of_row =
        |sizes: &mut dyn Iterator<Item = (usize, f64)>| sizes.map(|(_, size)| size).fold(0.0, f64::max);
    by_rows(mask, plane, of_row).into_iter().fold(0.0, f64::max)
}

/// Of the measured values above black: the sum of their fourth roots, and their number, each counted once or for its cell.
fn roots(mask: &Mask, plane: &Plane, (black, cells): (f64, Option<&Cells>)) -> (f64, u64) {
    let rows = by_rows(mask, plane, |sizes| {
        sizes.filter(|(_, size)| *size > black).fold((0.0, 0), |(sum, count), (pixel, size)| {
            let cell = cells.map_or(1.0, |cells| cells.count(pixel));
            (sum + f64::from(cell) * size.sqrt().sqrt(), count + cell as u64)
        })
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
        let typical = if self.is_linear() { power_mean(mask, group, (0.0, None)) } else { 0.0 };
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
mod tests;
