//! What a low-resolution pixel says about the high-resolution image.

use std::fmt;

use crate::Error;

/// The model of a low-resolution pixel, the same along both axes. Distances are in low-resolution pixels.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub enum Sampling {
    /// Its value is the value at its centre: of the spline, or, in terms of high-resolution pixels, of the cubic through the four around
    /// that along each axis, or the pixel that stands there.
    Point,
    /// It is one of the high-resolution pixels: (i, j) is (S i, S j) for whole factors S.
    Grid,
    /// The mean over its area.
    #[default]
    Box,
    /// The mean weighted by `exp(-2 (d / radius)^2)` along each axis, `|d| <= radius`; `radius` is 0.5 to 1.5.
    Gaussian(f64),
    /// The mean weighted by the cubic of Mitchell and Netravali with B = C = 1/3, `|d| <= 2`.
    ///
    /// Source: D. Mitchell, A. Netravali, "Reconstruction filters in computer graphics", SIGGRAPH 1988.
    Mitchell,
}

impl Sampling {
    /// Whether the parameters are in range.
    ///
    /// # Errors
    /// [`Error::Setting`].
    pub fn check(self) -> Result<(), Error> {
        match self {
            Self::Gaussian(radius) if !(0.5..=1.5).contains(&radius) => {
                Err(Error::setting("gaussian", &radius, "0.5 to 1.5"))
            }
            _ => Ok(()),
        }
    }

    /// Whether a pixel is a value at a point and not a mean.
    pub const fn is_pointwise(self) -> bool {
        matches!(self, Self::Point | Self::Grid)
    }

    /// The weight at a distance from the pixel's centre and the distance from which on it is zero; nothing for the
    /// models that are no weighted means of values at points.
    pub(super) fn weight(self) -> Option<(f64, impl Fn(f64) -> f64)> {
        let radius = match self {
            Self::Gaussian(radius) => radius,
            Self::Mitchell => 2.0,
            Self::Point | Self::Grid | Self::Box => return None,
        };
        let weight = move |distance: f64| {
            let d = distance.abs();
            match self {
                _ if d > radius => 0.0,
                Self::Gaussian(_) => (-2.0 * (d / radius).powi(2)).exp(),
                _ if d < 1.0 => (7.0 * d * d * d - 12.0 * d * d + 16.0 / 3.0) / 6.0,
                _ => (-7.0 / 3.0 * d * d * d + 12.0 * d * d - 20.0 * d + 32.0 / 3.0) / 6.0,
            }
        };
        Some((radius, weight))
    }
}

impl fmt::Display for Sampling {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Point => f.write_str("point"),
            Self::Grid => f.write_str("grid"),
            Self::Box => f.write_str("box"),
            Self::Gaussian(radius) => write!(f, "gaussian:{radius}"),
            Self::Mitchell => f.write_str("mitchell"),
        }
    }
}

impl std::str::FromStr for Sampling {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        let gaussian = |radius: &str| {
            let sampling = Self::Gaussian(radius.parse().ok()?);
            sampling.check().ok().map(|()| sampling)
        };
        match (text, text.strip_prefix("gaussian:")) {
            ("point", _) => Ok(Self::Point),
            ("grid", _) => Ok(Self::Grid),
            ("box", _) => Ok(Self::Box),
            ("mitchell", _) => Ok(Self::Mitchell),
            (_, Some(radius)) => gaussian(radius)
                .ok_or_else(|| "the radius of gaussian:R is a number of pixels from 0.5 to 1.5".into()),
            _ => Err("not a model of a pixel; choose point, grid, box, gaussian:R or mitchell".into()),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn names_are_read_as_they_are_written() {
        for text in ["point", "grid", "box", "gaussian:1.5", "mitchell"] {
            assert_eq!(text.parse::<Sampling>().unwrap().to_string(), text);
        }
        for text in ["", "gaussian", "gaussian:", "gaussian:0", "gaussian:2", "gaussian:nan", "Box"] {
            assert!(text.parse::<Sampling>().is_err(), "{text}");
        }
    }

    #[test]
    fn mitchell_is_continuous_and_sums_to_one() {
        let (radius, weight) = Sampling::Mitchell.weight().unwrap();
        assert!(radius == 2.0 && weight(2.0).abs() < 1e-15);
        assert!((weight(1.0 - 1e-9) - weight(1.0)).abs() < 1e-8);
        for shift in [0.0, 0.3, 0.5] {
            let sum: f64 = (-3..4).map(|k| weight(f64::from(k) + shift)).sum();
            assert!((sum - 1.0).abs() < 1e-12);
        }
    }
}
