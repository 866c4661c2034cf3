//! Structural similarity: luminance, contrast and structure compared in a sliding Gaussian window.
//!
//! `SSIM = (2 mx my + C1) (2 sxy + C2) / ((mx^2 + my^2 + C1) (sx^2 + sy^2 + C2))` with the local means `m`, variances
//! `s^2` and covariance `sxy` under an 11x11 Gaussian of standard deviation 1.5, `C1 = (0.01 L)^2`, `C2 = (0.03 L)^2`,
//! `L` the range of values. The map repeats the border; the mean leaves out the outermost 5 pixels, whose windows
//! reach beyond the image (all are taken where the image is no larger than the window).
//!
//! Computed from the sum `s = x + y` and the difference `d = x - y`: `2 mx my = (ms^2 - md^2) / 2`, `mx^2 + my^2 = (ms^2 +
//! md^2) / 2`, and likewise with the variances. That is one blur less, and small differences keep their digits in f32.
//!
//! Source: Z. Wang, A. C. Bovik, H. R. Sheikh, E. P. Simoncelli, "Image Quality Assessment: From Error Visibility to
//! Structural Similarity", IEEE Transactions on Image Processing 13(4), 2004, equation 13 and section III.C.

use lacuna_core::parallel::prelude::*;

use super::{mean, same_size};
use crate::kernel::fir::separable;
use crate::{Error, Plane};

/// Half the window: 11x11 pixels.
const RADIUS: usize = 5;

/// Structural similarity of each pixel, -1 to 1, and over a region.
#[derive(Clone, Debug, PartialEq)]
pub struct Similarity {
    /// SSIM of each pixel.
    pub map: Plane,
}

impl Similarity {
    /// Compares two planes of finite values; `range` is the extent of their values (1 for 0 to 1).
    ///
    /// # Errors
    /// [`Error::SizeMismatch`].
    pub fn new(reference: &Plane, test: &Plane, range: f32) -> Result<Self, Error> {
        same_size(reference.size(), &[test])?;
        let taps = gaussian(1.5, RADIUS);
        let blur = |plane: &Plane| separable(plane, &taps, &taps);
        // Sums about a mean value: squares of large values would swallow small variances.
        let centre = mean(reference, None)?.unwrap_or(0.0) as f32;
        let of = |f: &(dyn Fn(f32, f32) -> f32 + Sync)| {
            let mut of = reference.clone();
            of.pixels_mut().par_iter_mut().zip(test.pixels()).for_each(|(a, &b)| *a = f(*a, b));
            of
        };
        let sum = of(&|a, b| (a - centre) + (b - centre));
        let difference = of(&|a, b| a - b);
        let square = |mut plane: Plane| {
            plane.pixels_mut().par_iter_mut().for_each(|value| *value *= *value);
            plane
        };
        let (sums, differences) = (blur(&sum), blur(&difference));
        let (sum_squares, difference_squares) = (blur(&square(sum)), blur(&square(difference)));
        let (c1, c2) = (2.0 * (0.01 * range).powi(2), 2.0 * (0.03 * range).powi(2));
        let mut map = sums;
        map.pixels_mut().par_iter_mut().enumerate().for_each(|(i, out)| {
            let (s, d) = (*out, differences.pixels()[i]);
            let spread = (sum_squares.pixels()[i] - s * s).max(0.0);
            let distance = (difference_squares.pixels()[i] - d * d).max(0.0);
            let level = s + 2.0 * centre;
            let luminance = (level * level - d * d + c1) / (level * level + d * d + c1);
            *out = luminance * ((spread - distance + c2) / (spread + distance + c2));
        });
        Ok(Self { map })
    }

    /// Mean SSIM of a region without the border; `None` if nothing is left.
    ///
    /// # Errors
    /// [`Error::SizeMismatch`] for a region of another size.
    pub fn mean(&self, region: Option<&[bool]>) -> Result<Option<f64>, Error> {
        let size = self.map.size();
        Error::of_region(size, region)?;
        if size.height <= 2 * RADIUS || size.width <= 2 * RADIUS {
            return mean(&self.map, region);
        }
        let mut inner = vec![false; size.pixels()];
        for y in RADIUS..size.height - RADIUS {
            let row = y * size.width + RADIUS..(y + 1) * size.width - RADIUS;
            match region {
                None => inner[row].fill(true),
                Some(flags) => inner[row.clone()].copy_from_slice(&flags[row]),
            }
        }
        mean(&self.map, Some(&inner))
    }
}

/// A sampled Gaussian of `2 radius + 1` taps that sum to 1.
pub(super) fn gaussian(sigma: f64, radius: usize) -> Vec<f32> {
    let value = |k: usize| {
        let distance = k as f64 - radius as f64;
        (-0.5 * (distance / sigma).powi(2)).exp()
    };
    let sum: f64 = (0..=2 * radius).map(value).sum();
    (0..=2 * radius).map(|k| (value(k) / sum) as f32).collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::Size;

    fn texture(height: usize, width: usize, seed: usize) -> Plane {
        Plane::from_fn(Size::new(height, width), |y, x| ((y * 37 + x * 57 + seed * y * x) % 23) as f32 / 22.0)
    }

    /// SSIM of one pixel by the definition, in f64, with a two-dimensional window.
    fn slow(a: &Plane, b: &Plane, y: usize, x: usize) -> f64 {
        let (size, mut sums) = (a.size(), [0.0_f64; 6]);
        for j in 0..11_usize {
            for i in 0..11_usize {
                let (v, u) = (j as f64 - 5.0, i as f64 - 5.0);
                let w = (-(v * v + u * u) / 4.5).exp();
                let (row, column) = ((y + j).saturating_sub(5), (x + i).saturating_sub(5));
                let (row, column) = (row.min(size.height - 1), column.min(size.width - 1));
                let (p, q) = (f64::from(a.at(row, column)), f64::from(b.at(row, column)));
                for (sum, term) in sums.iter_mut().zip([1.0, p, q, p * p, q * q, p * q]) {
                    *sum += w * term;
                }
            }
        }
        let [mx, my, xx, yy, xy] = [1, 2, 3, 4, 5].map(|k| sums[k] / sums[0]);
        let (c1, c2) = (1e-4, 9e-4);
        (2.0 * mx * my + c1) * (2.0 * (xy - mx * my) + c2)
            / ((mx * mx + my * my + c1) * (xx - mx * mx + yy - my * my + c2))
    }

    #[test]
    fn agrees_with_the_definition() {
        for (height, width) in [(1, 1), (1, 9), (13, 17), (24, 12)] {
            let (a, b) = (texture(height, width, 1), texture(height, width, 2));
            let map = Similarity::new(&a, &b, 1.0).unwrap().map;
            for y in 0..height {
                for x in 0..width {
                    let difference = f64::from(map.at(y, x)) - slow(&a, &b, y, x);
                    // Two passes of 11 products, divided by at least C2.
                    assert!(difference.abs() < 32.0 * f64::from(f32::EPSILON) / 9e-4, "{difference}");
                }
            }
        }
    }

    #[test]
    fn equal_images_score_one_and_inverted_ones_less() {
        let a = texture(20, 30, 1);
        assert_eq!(Similarity::new(&a, &a, 1.0).unwrap().mean(None), Ok(Some(1.0)));
        let inverted = Plane::from_fn(a.size(), |y, x| 1.0 - a.at(y, x));
        assert!(Similarity::new(&a, &inverted, 1.0).unwrap().mean(None).unwrap().unwrap() < 0.0);
    }

    #[test]
    fn the_mean_leaves_the_border_out() {
        let a = texture(20, 30, 1);
        let mut b = a.clone();
        b.row_mut(0)[0] = 5.0;
        let similarity = Similarity::new(&a, &b, 1.0).unwrap();
        assert!(similarity.map.at(0, 0) < 0.5);
        let mut inner = vec![false; 600];
        inner[10 * 30 + 15] = true;
        assert_eq!(similarity.mean(Some(&inner)), Ok(Some(f64::from(similarity.map.at(10, 15)))));
        let mut outer = vec![false; 600];
        outer[0] = true;
        assert_eq!(similarity.mean(Some(&outer)), Ok(None));
        assert!(similarity.mean(Some(&outer[1..])).is_err());
    }
}
