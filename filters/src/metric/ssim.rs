//! Structural similarity: luminance, contrast and structure compared in a sliding Gaussian window.
//!
//! `SSIM = (2 mx my + C1) (2 sxy + C2) / ((mx^2 + my^2 + C1) (sx^2 + sy^2 + C2))` with the local means `m`, variances
//! `s^2` and covariance `sxy` under an 11x11 Gaussian of standard deviation 1.5, `C1 = (0.01 L)^2`, `C2 = (0.03 L)^2`,
//! `L` the range of values. The map repeats the border; the mean leaves out the outermost 5 pixels, whose windows
//! reach beyond the image (all are taken where one side of the image is no longer than the window).
//!
//! Computed from the sum `s = x + y` and the difference `d = x - y`: `2 mx my = (ms^2 - md^2) / 2`, `mx^2 + my^2 = (ms^2 +
//! md^2) / 2`, and likewise with the variances. That is one blur less, and equal images have exactly 1. Values are divided by L first, and all is
//! in f64, a band of rows at a time: unclipped highlights of 1000 L leave variances of 1e-9.
//!
//! Source: Z. Wang, A. C. Bovik, H. R. Sheikh, E. P. Simoncelli, "Image Quality Assessment: From Error Visibility to
//! Structural Similarity", IEEE Transactions on Image Processing 13(4), 2004, equation 13 and section III.C.

use lacuna_core::parallel::prelude::*;

use super::{mean, same_size};
use crate::kernel::fir::{across, along, pad};
use crate::{Error, Plane, Size, check};

/// Half the window: 11x11 pixels.
const RADIUS: usize = 5;
/// Rows that one task takes: those of a window beside them are few, and f64 does not fill memory.
const BAND: usize = 32;

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
    /// [`Error::SizeMismatch`] and, for a range that is not a finite number of 0 or more, [`Error::Setting`].
    pub fn new(reference: &Plane, test: &Plane, range: f32) -> Result<Self, Error> {
        check::not_negative("range", f64::from(range))?;
        same_size(reference.size(), &[test])?;
        let mut map = Plane::filled(reference.size(), 0.0);
        // A range of 0 is that of images of zeros.
        let range = f64::from(range.max(f32::from_bits(1)));
        // Sums about a mean value: squares of large values would swallow small variances.
        let centre = mean(reference, None)?.unwrap_or(0.0);
        let (pair, taps) = (Pair { reference, test, centre, range }, gaussian(1.5, RADIUS));
        let width = reference.size().width.max(1);
        map.pixels_mut()
            .par_chunks_mut(BAND * width)
            .enumerate()
            .for_each(|(band, out)| pair.similarity(band * BAND, &taps, out));
        Ok(Self { map })
    }

    /// Mean SSIM of a region without the border; `None` if nothing is left.
    ///
    /// # Errors
    /// [`Error::SizeMismatch`] for a region of another size.
    pub fn mean(&self, region: Option<&[bool]>) -> Result<Option<f64>, Error> {
        let size = self.map.size();
        Error::of_region(size, region)?;
        if size.height.min(size.width) <= 2 * RADIUS + 1 {
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

/// Two images, and what their values are counted from and in.
struct Pair<'a> {
    reference: &'a Plane,
    test: &'a Plane,
    centre: f64,
    range: f64,
}

impl Pair<'_> {
    /// SSIM of some rows, from row `top` on.
    fn similarity(&self, top: usize, taps: &[f64], out: &mut [f32]) {
        let width = self.reference.size().width;
        let moments = self.moments(top, out.len() / width + 2 * RADIUS);
        let (mut column, mut padded) = (vec![0.0; width], Vec::new());
        let mut local = [(); 4].map(|()| vec![0.0; width]);
        let level = 2.0 * self.centre / self.range;
        for (y, out) in out.chunks_mut(width).enumerate() {
            for (local, moment) in local.iter_mut().zip(&moments) {
                let rows: Vec<&[f64]> = moment[y * width..].chunks(width).take(taps.len()).collect();
                across(&rows, taps, &mut column);
                pad(&column, RADIUS, &mut padded);
                along(&padded, taps, local);
            }
            for (x, out) in out.iter_mut().enumerate() {
                *out = index(local.each_ref().map(|local| local[x]), level) as f32;
            }
        }
    }

    /// The sum, the difference and their squares in the rows of the windows of some rows, from row `top` on.
    fn moments(&self, top: usize, rows: usize) -> [Vec<f64>; 4] {
        let Size { height, width } = self.reference.size();
        let mut moments = [(); 4].map(|()| Vec::with_capacity(rows * width));
        for y in (top..top + rows).map(|y| y.saturating_sub(RADIUS).min(height - 1)) {
            for (&a, &b) in self.reference.row(y).iter().zip(self.test.row(y)) {
                let (a, b) = (f64::from(a), f64::from(b));
                let (s, d) = ((a - self.centre + (b - self.centre)) / self.range, (a - b) / self.range);
                moments.iter_mut().zip([s, d, s * s, d * d]).for_each(|(own, value)| own.push(value));
            }
        }
        moments
    }
}

/// SSIM from means of the sum about twice the centre, which `level` is, of the difference, and of their squares.
fn index([s, d, ss, dd]: [f64; 4], level: f64) -> f64 {
    let (c1, c2) = (2.0 * 0.01 * 0.01, 2.0 * 0.03 * 0.03);
    let (spread, distance) = ((ss - s * s).max(0.0), (dd - d * d).max(0.0));
    let (level, off) = ((s + level).powi(2), d * d);
    (level - off + c1) / (level + off + c1) * ((spread - distance + c2) / (spread + distance + c2))
}

/// A sampled Gaussian of `2 radius + 1` taps that sum to 1.
fn gaussian(sigma: f64, radius: usize) -> Vec<f64> {
    let value = |k: usize| {
        let distance = k as f64 - radius as f64;
        (-0.5 * (distance / sigma).powi(2)).exp()
    };
    let sum: f64 = (0..=2 * radius).map(value).sum();
    (0..=2 * radius).map(|k| value(k) / sum).collect()
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
        let size = a.size();
        let mut terms = Vec::new();
        for j in 0..11_usize {
            for i in 0..11_usize {
                let (v, u) = (j as f64 - 5.0, i as f64 - 5.0);
                let w = (-(v * v + u * u) / 4.5).exp();
                let (row, column) = ((y + j).saturating_sub(5), (x + i).saturating_sub(5));
                let (row, column) = (row.min(size.height - 1), column.min(size.width - 1));
                terms.push((w, f64::from(a.at(row, column)), f64::from(b.at(row, column))));
            }
        }
        let mean = |f: &dyn Fn(f64, f64) -> f64| {
            terms.iter().map(|(w, p, q)| w * f(*p, *q)).sum::<f64>()
                / terms.iter().map(|term| term.0).sum::<f64>()
        };
        let (mx, my) = (mean(&|p, _| p), mean(&|_, q| q));
        let spread = mean(&|p, q| (p - mx).powi(2) + (q - my).powi(2));
        let (c1, c2) = (1e-4, 9e-4);
        (2.0 * mx * my + c1) * (2.0 * mean(&|p, q| (p - mx) * (q - my)) + c2)
            / ((mx * mx + my * my + c1) * (spread + c2))
    }

    #[test]
    fn agrees_with_the_definition() {
        for (height, width) in [(1, 1), (1, 9), (13, 17), (24, 12)] {
            let (a, b) = (texture(height, width, 1), texture(height, width, 2));
            let map = Similarity::new(&a, &b, 1.0).unwrap().map;
            for y in 0..height {
                for x in 0..width {
                    let difference = f64::from(map.at(y, x)) - slow(&a, &b, y, x);
                    assert!(difference.abs() < f64::from(f32::EPSILON), "{difference}");
                }
            }
        }
    }

    /// What no clipping leaves: a half a thousand times as bright, and an image far from zero.
    #[test]
    fn highlights_and_levels_swallow_no_variance() {
        let (a, b) = (texture(40, 50, 1), texture(40, 50, 2));
        for [left, right] in [[1000.0, 0.0], [2e4, 2e4], [-2e4, -2e4]] {
            let [a, b] = [&a, &b].map(|plane| {
                Plane::from_fn(plane.size(), |y, x| plane.at(y, x) + if x < 25 { left } else { right })
            });
            let map = Similarity::new(&a, &b, 1.0).unwrap().map;
            for (y, x) in (0..40).flat_map(|y| (0..50).map(move |x| (y, x))) {
                let difference = f64::from(map.at(y, x)) - slow(&a, &b, y, x);
                assert!(difference.abs() < 1e-6, "{y} {x}: {difference}");
            }
        }
    }

    #[test]
    fn units_change_nothing() {
        let (a, b) = (texture(20, 70, 1), texture(20, 70, 2));
        let usual = Similarity::new(&a, &b, 1.0).unwrap();
        for unit in [2.0_f32.powi(-120), 2.0_f32.powi(126)] {
            let scaled = |plane: &Plane| Plane::from_fn(plane.size(), |y, x| unit * plane.at(y, x));
            assert_eq!(Similarity::new(&scaled(&a), &scaled(&b), unit).unwrap(), usual);
        }
    }

    #[test]
    fn equal_images_score_one_and_inverted_ones_less() {
        let a = texture(20, 30, 1);
        let large = Plane::from_fn(a.size(), |y, x| f32::MAX * (2.0 * a.at(y, x) - 1.0));
        for (image, range) in
            [(&a, 1.0), (&a, 1e30), (&a, 1e-30), (&large, 1.0), (&large, 0.0), (&a, f32::MAX)]
        {
            assert_eq!(Similarity::new(image, image, range).unwrap().mean(None), Ok(Some(1.0)), "{range}");
        }
        let inverted = Plane::from_fn(a.size(), |y, x| 1.0 - a.at(y, x));
        assert!(Similarity::new(&a, &inverted, 1.0).unwrap().mean(None).unwrap().unwrap() < 0.0);
    }

    #[test]
    fn a_range_is_finite_and_not_negative() {
        let (a, b) = (texture(20, 30, 1), texture(20, 30, 2));
        for range in [-1.0, f32::NAN, f32::INFINITY] {
            let found = Similarity::new(&a, &b, range);
            assert!(matches!(found, Err(Error::Setting { name: "range", .. })), "{range}");
        }
    }

    #[test]
    fn all_of_an_image_like_the_window_counts() {
        for (height, width, inner) in [(11, 11, false), (11, 30, false), (30, 11, false), (12, 12, true)] {
            let found = Similarity::new(&texture(height, width, 1), &texture(height, width, 2), 1.0).unwrap();
            let all = mean(&found.map, None).unwrap();
            assert_eq!(found.mean(None).unwrap() != all, inner, "{height} {width}");
        }
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
