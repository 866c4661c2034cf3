//! `W G`: a filter in the Fourier domain, then wavelets; with its adjoint and a bound of its norm.

use lacuna_core::parallel::prelude::*;

use super::Settings;
use crate::Size;
use crate::operator::fourier::{Fourier, Spectrum};
use crate::operator::wavelet::{Scratch, Transform};
use crate::solver::sparsity::{ROW, Sparsity};

/// The largest gain of the Wiener filter's inverse.
const MOST: f64 = 8.0;
/// Steps of the power iteration; the norms of wavelet transforms lie close together, so it settles quickly.
const POWER: usize = 20;
/// What its result is multiplied by, as it comes from below.
const MARGIN: f64 = 1.05;

/// The operator of one image size.
#[derive(Debug)]
pub struct Operator {
    pixels: usize,
    transform: Transform,
    /// The Fourier transform and the gain at its columns; nothing without blur.
    blur: Option<(Fourier, Vec<f32>)>,
    bound: f64,
}

/// Buffers for one application at a time.
#[derive(Debug)]
pub struct Work {
    spectrum: Option<Spectrum>,
    image: Vec<f32>,
    coefficients: Vec<f32>,
    scratch: Scratch,
}

impl Operator {
    /// The operator of a size with at least one pixel.
    pub fn new(size: Size, settings: &Settings) -> Self {
        let transform = Transform::new(size, settings.wavelet, settings.boundary, settings.levels);
        let blur = (settings.blur > 0.0).then(|| {
            let fourier = Fourier::new(size);
            let gain = gain(size, fourier.columns(), settings.blur, settings.wiener);
            (fourier, gain)
        });
        let largest = blur.as_ref().map_or(1.0, |(_, gain)| gain.iter().copied().fold(0.0, f32::max));
        let mut operator = Self { pixels: size.pixels(), transform, blur, bound: 1.0 };
        operator.bound = operator.wavelet_bound() * f64::from(largest).powi(2);
        operator
    }

    /// The square of the wavelet transform's norm: 1 if it is orthonormal, otherwise by the power method.
    fn wavelet_bound(&self) -> f64 {
        if self.transform.is_orthonormal() {
            return 1.0;
        }
        let mut work = self.work();
        let spread = |i: usize| ((i * 7919 + 13) % 1009) as f32 / 504.0 - 1.0;
        let mut x: Vec<f32> = (0..self.pixels).map(spread).collect();
        let mut square = 1.0_f64;
        for _ in 0..POWER {
            self.transform.forward(&x, &mut work.coefficients, &mut work.scratch);
            let before = squares(&x);
            let after = squares(&work.coefficients);
            square = if before > 0.0 { square.max(after / before) } else { square };
            self.transform.adjoint(&work.coefficients, &mut x, &mut work.scratch);
            let shrink = (1.0 / squares(&x).max(f64::MIN_POSITIVE).sqrt()) as f32;
            x.par_iter_mut().for_each(|x| *x *= shrink);
        }
        MARGIN * square
    }

    /// Filters an image, in place.
    fn filter(&self, image: &mut [f32], spectrum: Option<&mut Spectrum>) {
        if let (Some((fourier, gain)), Some(spectrum)) = (&self.blur, spectrum) {
            fourier.forward(image, spectrum);
            let values = spectrum.values.par_iter_mut().zip(gain).with_min_len(ROW);
            values.for_each(|(value, gain)| *value *= *gain);
            fourier.inverse(spectrum, image);
        }
    }
}

/// Sum of squares, row by row.
fn squares(values: &[f32]) -> f64 {
    let rows: Vec<f64> =
        values.par_chunks(ROW).map(|row| row.iter().map(|value| f64::from(*value).powi(2)).sum::<f64>());
    rows.iter().sum()
}

/// The gain at the kept columns of a spectrum, column by column.
fn gain(size: Size, columns: usize, sigma: f64, kappa: f64) -> Vec<f32> {
    let index = |k: usize| k.min(size.height - k) as f64;
    let at = |l: usize, k: usize| {
        let blur = (-(index(k).powi(2) + (l * l) as f64) / (2.0 * sigma * sigma)).exp();
        if kappa == 0.0 {
            return blur as f32;
        }
        ((blur + kappa / blur.max(f64::MIN_POSITIVE)) / (1.0 + kappa)).min(MOST) as f32
    };
    (0..columns).flat_map(|l| (0..size.height).map(move |k| at(l, k))).collect()
}

impl Sparsity for Operator {
    type Entry = f32;
    type Work = Work;

    fn work(&self) -> Work {
        Work {
            spectrum: self.blur.as_ref().map(|(fourier, _)| fourier.spectrum()),
            image: vec![0.0; self.pixels],
            coefficients: vec![0.0; self.transform.coefficients()],
            scratch: self.transform.scratch(),
        }
    }

    fn analyse(&self, x: &[f32], work: &mut Work) {
        work.image.copy_from_slice(x);
        self.filter(&mut work.image, work.spectrum.as_mut());
        self.transform.forward(&work.image, &mut work.coefficients, &mut work.scratch);
    }

    fn adjoint(&self, work: &mut Work, x: &mut [f32]) {
        self.transform.adjoint(&work.coefficients, x, &mut work.scratch);
        self.filter(x, work.spectrum.as_mut());
    }

    fn entries<'a>(&self, work: &'a mut Work) -> &'a mut [f32] {
        &mut work.coefficients
    }

    fn bound(&self) -> f64 {
        self.bound
    }

    fn peak(&self, x: &[f32], work: &mut Work) -> f64 {
        let mean = (x.iter().copied().map(f64::from).sum::<f64>() / x.len().max(1) as f64) as f32;
        self.analyse(&x.iter().map(|value| value - mean).collect::<Vec<_>>(), work);
        self.largest(work)
    }
}
