//! Errors of values: squared, largest, relative, in log space; PSNR; counts of non-finite values.
//!
//! For reference `r` and test `t`, both clipped to `[0, peak]` where [`Options::clip`] says so, over the `n` pixels of
//! the region at which both are finite:
//!
//! - MSE `= sum (t - r)^2 / n`, RMSE its root, PSNR `= 10 log10(peak^2 / MSE)` in dB;
//! - relative MSE `= sum (t - r)^2 / (r^2 + 0.01) / n`, unclipped, after F. Rousselle, C. Knaus, M. Zwicker, "Adaptive
//!   Sampling and Reconstruction using Greedy Error Minimization", SIGGRAPH Asia 2011;
//! - log PSNR: PSNR of `l(v) = sign(v) log2(1 + |v|)`, unclipped, its peak `l` of the largest reference value.

use lacuna_core::parallel::prelude::*;
use serde::Serialize;

use super::same_size;
use crate::{Error, Plane, check};

/// Keeps the relative error finite where the reference is black (Rousselle et al. 2011).
const RELATIVE_FLOOR: f64 = 0.01;

/// How values are compared.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Options {
    /// The value that counts as white, above 0; default 1.
    pub peak: f32,
    /// Whether values are clipped to `[0, peak]` first; default true, as the field does.
    pub clip: bool,
}

impl Default for Options {
    fn default() -> Self {
        Self { peak: 1.0, clip: true }
    }
}

/// What was added up over pixels; statistics of channels or frames add up in turn.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize)]
pub struct Statistics {
    /// Pixels compared: those of the region at which both values are finite.
    pub count: usize,
    /// Sum of squared differences.
    pub squares: f64,
    /// Sum of squared differences over the squared reference.
    pub relative: f64,
    /// Sum of squared differences of logarithms.
    pub log_squares: f64,
    /// Largest absolute difference.
    pub largest: f64,
    /// Index of the pixel with the largest difference, the first of several.
    pub largest_at: Option<usize>,
    /// Largest absolute value of the reference.
    pub reference_peak: f64,
    /// NaNs in the reference.
    pub reference_nan: usize,
    /// Infinities in the reference.
    pub reference_infinite: usize,
    /// NaNs in the test image.
    pub test_nan: usize,
    /// Infinities in the test image.
    pub test_infinite: usize,
    /// NaNs in the test image where the reference has none.
    pub new_nan: usize,
    /// Infinities in the test image where the reference has another value.
    pub new_infinite: usize,
    /// Pixels at which the values differ in their bits.
    pub different: usize,
    /// Pixels at which the values differ, but not once they are clipped.
    pub hidden: usize,
}

/// Where more of the values than this differ only beyond what clipping leaves, the measures say little of them.
const HIDDEN: f64 = 0.05;

/// Compares two planes of one size, over all pixels or a region: a flag for each.
///
/// # Errors
/// [`Error::SizeMismatch`] and, for a peak that is not above 0 and finite, [`Error::Setting`].
pub fn compare(
    reference: &Plane,
    test: &Plane,
    region: Option<&[bool]>,
    options: Options,
) -> Result<Statistics, Error> {
    compare_regions(reference, test, &[region], options)
        .map(|found| found.first().copied().unwrap_or_default())
}

/// Compares two planes of one size over several regions, in one pass.
///
/// # Errors
/// As [`compare`].
pub fn compare_regions(
    reference: &Plane,
    test: &Plane,
    regions: &[Option<&[bool]>],
    options: Options,
) -> Result<Vec<Statistics>, Error> {
    check::positive("peak", f64::from(options.peak))?;
    same_size(reference.size(), &[test])?;
    regions.iter().try_for_each(|region| Error::of_region(reference.size(), *region))?;
    let width = reference.size().width.max(1);
    let rows: Vec<Vec<Statistics>> = (reference.pixels().par_chunks(width))
        .zip(test.pixels().par_chunks(width))
        .enumerate()
        .map(|(y, (reference, test))| row(y * width, reference, test, regions, options));
    let sum = |index: usize| rows.iter().fold(Statistics::default(), |sum, row| sum.and(row[index]));
    Ok((0..regions.len()).map(sum).collect())
}

/// One row, its first pixel at index `start`.
fn row(
    start: usize,
    reference: &[f32],
    test: &[f32],
    regions: &[Option<&[bool]>],
    options: Options,
) -> Vec<Statistics> {
    let mut sums = vec![Statistics::default(); regions.len()];
    for (x, (&r, &t)) in reference.iter().zip(test).enumerate() {
        let terms = Terms::new(r, t, options);
        for (sums, region) in sums.iter_mut().zip(regions) {
            if region.is_none_or(|flags| flags[start + x]) {
                sums.add(start + x, r, t, &terms);
            }
        }
    }
    sums
}

/// What one pixel adds to the sums.
#[derive(Default)]
struct Terms {
    distance: f64,
    relative: f64,
    log_squares: f64,
}

impl Terms {
    fn new(r: f32, t: f32, options: Options) -> Self {
        if r.to_bits() == t.to_bits() || !(r.is_finite() && t.is_finite()) {
            return Self::default();
        }
        let clip = |value: f32| if options.clip { value.clamp(0.0, options.peak) } else { value };
        let plain = f64::from(t) - f64::from(r);
        let log = logarithm(f64::from(t)) - logarithm(f64::from(r));
        Self {
            distance: (f64::from(clip(t)) - f64::from(clip(r))).abs(),
            relative: plain * plain / (f64::from(r) * f64::from(r) + RELATIVE_FLOOR),
            log_squares: log * log,
        }
    }
}

impl Statistics {
    /// Adds one pixel.
    fn add(&mut self, index: usize, r: f32, t: f32, terms: &Terms) {
        self.reference_nan += usize::from(r.is_nan());
        self.reference_infinite += usize::from(r.is_infinite());
        self.test_nan += usize::from(t.is_nan());
        self.test_infinite += usize::from(t.is_infinite());
        self.new_nan += usize::from(t.is_nan() && !r.is_nan());
        self.new_infinite += usize::from(t.is_infinite() && t.to_bits() != r.to_bits());
        self.different += usize::from(r.to_bits() != t.to_bits());
        if !(r.is_finite() && t.is_finite()) {
            return;
        }
        self.count += 1;
        self.hidden += usize::from(r != t && terms.distance == 0.0);
        self.reference_peak = self.reference_peak.max(f64::from(r.abs()));
        self.squares += terms.distance * terms.distance;
        if terms.distance > self.largest {
            self.largest = terms.distance;
            self.largest_at = Some(index);
        }
        self.relative += terms.relative;
        self.log_squares += terms.log_squares;
    }

    /// The statistics of the pixels of both.
    #[must_use]
    pub fn and(self, other: Self) -> Self {
        let larger = other.largest > self.largest;
        Self {
            count: self.count + other.count,
            squares: self.squares + other.squares,
            relative: self.relative + other.relative,
            log_squares: self.log_squares + other.log_squares,
            largest: self.largest.max(other.largest),
            largest_at: if larger { other.largest_at } else { self.largest_at },
            reference_peak: self.reference_peak.max(other.reference_peak),
            reference_nan: self.reference_nan + other.reference_nan,
            reference_infinite: self.reference_infinite + other.reference_infinite,
            test_nan: self.test_nan + other.test_nan,
            test_infinite: self.test_infinite + other.test_infinite,
            new_nan: self.new_nan + other.new_nan,
            new_infinite: self.new_infinite + other.new_infinite,
            different: self.different + other.different,
            hidden: self.hidden + other.hidden,
        }
    }

    /// The share of the compared values that differ only where clipping makes them equal, if it is more than a twentieth:
    /// no measure of clipped values tells of those.
    pub fn hidden_share(&self) -> Option<f64> {
        let share = self.hidden as f64 / self.count.max(1) as f64;
        (share > HIDDEN).then_some(share)
    }

    /// Mean squared error; `None` if no pixel was compared.
    pub fn mse(&self) -> Option<f64> {
        (self.count > 0).then(|| self.squares / self.count as f64)
    }

    /// Root of the mean squared error.
    pub fn rmse(&self) -> Option<f64> {
        self.mse().map(f64::sqrt)
    }

    /// Peak signal-to-noise ratio in dB; infinite for equal images.
    pub fn psnr(&self, peak: f32) -> Option<f64> {
        self.mse().map(|mse| decibels(f64::from(peak), mse))
    }

    /// Mean squared error relative to the squared reference.
    pub fn relative_mse(&self) -> Option<f64> {
        (self.count > 0).then(|| self.relative / self.count as f64)
    }

    /// PSNR of the logarithms in dB, its peak that of the reference; `None` also for a black reference.
    pub fn log_psnr(&self) -> Option<f64> {
        let peak = logarithm(self.reference_peak);
        (self.count > 0 && peak > 0.0).then(|| decibels(peak, self.log_squares / self.count as f64))
    }
}

/// `10 log10(peak^2 / mse)`.
fn decibels(peak: f64, mse: f64) -> f64 {
    if mse == 0.0 { f64::INFINITY } else { 10.0 * (peak * peak / mse).log10() }
}

/// `sign(v) log2(1 + |v|)`.
fn logarithm(value: f64) -> f64 {
    value.signum() * value.abs().ln_1p() * std::f64::consts::LOG2_E
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::Size;

    fn plane(values: &[f32]) -> Plane {
        Plane::new(Size::new(1, values.len()), values.to_vec()).unwrap()
    }

    #[test]
    fn known_values() {
        let (r, t) = (plane(&[0.0, 0.5, 1.0, 0.25]), plane(&[0.1, 0.5, 0.8, 0.25]));
        let s = compare(&r, &t, None, Options::default()).unwrap();
        let mse = (f64::from(0.1_f32).powi(2) + (1.0 - f64::from(0.8_f32)).powi(2)) / 4.0;
        assert!((s.mse().unwrap() - mse).abs() < 1e-15);
        assert!((s.psnr(1.0).unwrap() - 10.0 * (1.0 / mse).log10()).abs() < 1e-12);
        assert_eq!((s.largest_at, s.different, s.count), (Some(2), 2, 4));
    }

    #[test]
    fn clipping_hides_what_is_beyond_the_peak() {
        let (r, t) = (plane(&[5.0, -1.0]), plane(&[1.0, 0.0]));
        assert_eq!(compare(&r, &t, None, Options::default()).unwrap().squares, 0.0);
        let open = compare(&r, &t, None, Options { clip: false, ..Options::default() }).unwrap();
        assert_eq!(open.squares, 17.0);
        let shares = |r: &[f32], clip| {
            compare(&plane(r), &plane(&[2.0, -1.0, 0.5]), None, Options { clip, ..Options::default() })
                .unwrap()
                .hidden_share()
        };
        assert_eq!(shares(&[3.0, -2.0, 0.5], true), Some(2.0 / 3.0));
        assert_eq!(shares(&[2.0, -1.0, 0.4], true), None);
        assert_eq!(shares(&[3.0, -2.0, 0.5], false), None);
    }

    #[test]
    fn non_finite_values_are_counted_and_left_out() {
        let (r, t) = (plane(&[f32::NAN, 1.0, 2.0]), plane(&[0.0, f32::INFINITY, 2.0]));
        let s = compare(&r, &t, None, Options::default()).unwrap();
        assert_eq!((s.reference_nan, s.test_infinite, s.count, s.squares), (1, 1, 1, 0.0));
        assert_eq!(s.psnr(1.0), Some(f64::INFINITY));
    }

    #[test]
    fn values_that_are_not_finite_are_new_where_the_reference_has_others() {
        let [far, none] = [f32::INFINITY, f32::NAN];
        let (r, t) = (plane(&[none, 1.0, far, far, none, far]), plane(&[none, none, far, -far, far, none]));
        let s = compare(&r, &t, None, Options::default()).unwrap();
        assert_eq!((s.new_nan, s.new_infinite), (2, 2));
    }

    #[test]
    fn a_region_leaves_the_rest_out() {
        let (r, t) = (plane(&[0.0, 0.0]), plane(&[1.0, 0.5]));
        let s = compare(&r, &t, Some(&[false, true]), Options::default()).unwrap();
        assert_eq!((s.count, s.squares), (1, 0.25));
        let none = compare(&r, &t, Some(&[false, false]), Options::default()).unwrap();
        assert_eq!((none.mse(), none.psnr(1.0), none.relative_mse()), (None, None, None));
    }

    #[test]
    fn a_scaled_pair_has_the_psnr_of_its_scaled_peak() {
        let r = Plane::from_fn(Size::new(9, 7), |y, x| (y * 7 + x) as f32 / 64.0);
        let t = Plane::from_fn(Size::new(9, 7), |y, x| r.at(y, x) * 0.5);
        let double = |p: &Plane| Plane::from_fn(p.size(), |y, x| 2.0 * p.at(y, x));
        let one = compare(&r, &t, None, Options::default()).unwrap().psnr(1.0).unwrap();
        let options = Options { peak: 2.0, clip: true };
        let two = compare(&double(&r), &double(&t), None, options).unwrap().psnr(2.0).unwrap();
        assert!((one - two).abs() < 1e-12);
    }

    #[test]
    fn sizes_must_agree_and_the_peak_be_positive() {
        for peak in [0.0, -1.0, f32::NAN, f32::INFINITY] {
            let found = compare(&plane(&[0.0]), &plane(&[1.0]), None, Options { peak, clip: true });
            assert!(matches!(found, Err(Error::Setting { name: "peak", .. })), "{peak}");
        }
        let found = compare(&plane(&[0.0]), &plane(&[0.0, 1.0]), None, Options::default());
        assert!(matches!(found, Err(Error::SizeMismatch { .. })));
        for flags in [&[true][..], &[true; 3]] {
            let pair = (plane(&[0.0, 1.0]), plane(&[0.0, 1.0]));
            let found = compare(&pair.0, &pair.1, Some(flags), Options::default()).unwrap_err().to_string();
            assert!(found.ends_with("flags") && found.contains("a region of"), "{found}");
            assert!(super::super::mean(&pair.0, Some(flags)).is_err());
        }
    }
}
