//! The unitary discrete Fourier transform of real images, planned once for a size.
//!
//! `X(k, l) = (h w)^-1/2 sum_ij x(i, j) exp(-2 pi i (k i / h + l j / w))`. Of the columns `l` only `0 ..= w / 2` are kept; the
//! others are their conjugates. The spectrum is stored by columns: `h` values of column 0, then of column 1.
//!
//! Cost: `O(h w log(h w))` for every size, primes included. Memory: two half spectra, a plane each.

use std::sync::Arc;

use lacuna_core::parallel::prelude::*;
use lacuna_transforms::{Complex, ComplexToReal, Fft, Planned, RealToComplex};

use crate::Size;

/// Columns that a task gathers at once.
const BLOCK: usize = 8;

/// The transform of images of one size, at least one pixel.
pub struct Fourier {
    size: Size,
    rows: Arc<dyn RealToComplex<f32>>,
    rows_back: Arc<dyn ComplexToReal<f32>>,
    columns: Arc<dyn Fft<f32>>,
    columns_back: Arc<dyn Fft<f32>>,
}

/// Buffers for one transform at a time.
#[derive(Clone, Debug)]
pub struct Spectrum {
    /// The spectrum, column by column.
    pub values: Vec<Complex<f32>>,
    /// Rows transformed, columns not yet.
    rows: Vec<Complex<f32>>,
}

impl Fourier {
    /// Plans for a size.
    pub fn new(size: Size) -> Self {
        Self {
            size,
            rows: f32::real_forward(size.width),
            rows_back: f32::real_inverse(size.width),
            columns: f32::forward(size.height),
            columns_back: f32::inverse(size.height),
        }
    }

    /// Columns of a spectrum.
    pub fn columns(&self) -> usize {
        self.size.width / 2 + 1
    }

    /// Values of the whole spectrum that a value of column `l` stands for: itself and, if it is not kept, its conjugate.
    pub fn multiplicity(&self, l: usize) -> f64 {
        if l == 0 || 2 * l == self.size.width { 1.0 } else { 2.0 }
    }

    /// Buffers.
    pub fn spectrum(&self) -> Spectrum {
        let zeros = vec![Complex::default(); self.size.height * self.columns()];
        Spectrum { values: zeros.clone(), rows: zeros }
    }

    /// The spectrum of an image.
    pub fn forward(&self, x: &[f32], out: &mut Spectrum) {
        let (width, columns) = (self.size.width, self.columns());
        let scale = 1.0 / (self.size.pixels() as f32).sqrt();
        let rows = x.par_chunks(width).zip(out.rows.par_chunks_mut(columns));
        rows.for_each_init(
            || (vec![0.0; width], self.rows.make_scratch_vec()),
            |(line, scratch), (x, row)| {
                for (line, x) in line.iter_mut().zip(x) {
                    *line = scale * x;
                }
                // The lengths are those of the plan, the only thing that it checks.
                let _ = self.rows.process_with_scratch(line, row, scratch);
            },
        );
        transpose(&out.rows, &mut out.values, self.size.height, columns);
        self.along_columns(&self.columns, &mut out.values);
    }

    /// The image of a spectrum, which is destroyed. Imaginary parts that no real image has are dropped.
    pub fn inverse(&self, spectrum: &mut Spectrum, x: &mut [f32]) {
        let (width, columns) = (self.size.width, self.columns());
        let scale = 1.0 / (self.size.pixels() as f32).sqrt();
        self.along_columns(&self.columns_back, &mut spectrum.values);
        transpose(&spectrum.values, &mut spectrum.rows, columns, self.size.height);
        let rows = x.par_chunks_mut(width).zip(spectrum.rows.par_chunks_mut(columns));
        rows.for_each_init(
            || self.rows_back.make_scratch_vec(),
            |scratch, (x, row)| {
                row[0].im = 0.0;
                if width % 2 == 0 {
                    row[columns - 1].im = 0.0;
                }
                let _ = self.rows_back.process_with_scratch(row, x, scratch);
                for x in x {
                    *x *= scale;
                }
            },
        );
    }

    fn along_columns(&self, plan: &Arc<dyn Fft<f32>>, values: &mut [Complex<f32>]) {
        values.par_chunks_mut(self.size.height).for_each_init(
            || vec![Complex::default(); plan.get_inplace_scratch_len()],
            |scratch, column| plan.process_with_scratch(column, scratch),
        );
    }
}

impl std::fmt::Debug for Fourier {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("Fourier").field("size", &self.size).finish_non_exhaustive()
    }
}

/// `to` becomes the transpose of `from`, which has `rows` rows of `columns` values.
fn transpose(from: &[Complex<f32>], to: &mut [Complex<f32>], rows: usize, columns: usize) {
    to.par_chunks_mut(rows * BLOCK).enumerate().for_each(|(block, out)| {
        let first = block * BLOCK;
        for (y, row) in from.chunks(columns).enumerate() {
            for (k, value) in row[first..(first + BLOCK).min(columns)].iter().enumerate() {
                out[k * rows + y] = *value;
            }
        }
    });
}

#[cfg(test)]
mod tests {
    use std::f64::consts::TAU;

    use super::*;

    const SIZES: [(usize, usize); 8] = [(1, 1), (1, 7), (6, 1), (5, 8), (8, 5), (13, 11), (16, 18), (9, 2)];

    fn image(size: Size, seed: usize) -> Vec<f32> {
        (0..size.pixels()).map(|i| ((i * 7919 + seed * 104_729) % 1009) as f32 / 504.0 - 1.0).collect()
    }

    /// The definition, slowly.
    fn slow(size: Size, x: &[f32], k: usize, l: usize) -> Complex<f64> {
        let (h, w) = (size.height as f64, size.width as f64);
        let term = |(at, &x): (usize, &f32)| {
            let (i, j) = ((at / size.width) as f64, (at % size.width) as f64);
            Complex::from_polar(f64::from(x), -TAU * (k as f64 * i / h + l as f64 * j / w))
        };
        x.iter().enumerate().map(term).sum::<Complex<f64>>() / (h * w).sqrt()
    }

    #[test]
    fn it_is_the_definition_and_comes_back() {
        for (height, width) in SIZES {
            let size = Size::new(height, width);
            let fourier = Fourier::new(size);
            let x = image(size, 1);
            let mut spectrum = fourier.spectrum();
            fourier.forward(&x, &mut spectrum);
            // Rounding grows with the logarithm of the size; the values with its root.
            let bound = 16.0 * f64::from(f32::EPSILON) * (size.pixels() as f64).sqrt();
            let mut energy = 0.0;
            for l in 0..fourier.columns() {
                for k in 0..height {
                    let value = spectrum.values[l * height + k];
                    let wide = Complex::new(f64::from(value.re), f64::from(value.im));
                    assert!((wide - slow(size, &x, k, l)).norm() <= bound, "{size} {k} {l}");
                    energy += fourier.multiplicity(l) * wide.norm_sqr();
                }
            }
            let expected: f64 = x.iter().map(|x| f64::from(*x).powi(2)).sum();
            assert!((energy - expected).abs() <= 1e-5 * expected, "{size}: unitary");
            let mut back = vec![0.0; x.len()];
            fourier.inverse(&mut spectrum, &mut back);
            for (back, x) in back.iter().zip(&x) {
                assert!((back - x).abs() <= 1e-5, "{size}");
            }
        }
    }

    /// `Re <F x, c> = <x, F* c>` over the whole spectrum.
    #[test]
    fn the_inverse_is_the_adjoint() {
        for (height, width) in SIZES {
            let size = Size::new(height, width);
            let fourier = Fourier::new(size);
            let (x, y) = (image(size, 1), image(size, 2));
            // A spectrum that belongs to a real image.
            let (mut of_x, mut c) = (fourier.spectrum(), fourier.spectrum());
            fourier.forward(&x, &mut of_x);
            fourier.forward(&y, &mut c);
            let mut left = 0.0;
            for (at, (a, b)) in of_x.values.iter().zip(&c.values).enumerate() {
                left += fourier.multiplicity(at / height) * f64::from(a.re * b.re + a.im * b.im);
            }
            let mut back = vec![0.0; x.len()];
            fourier.inverse(&mut c, &mut back);
            let right: f64 = x.iter().zip(&back).map(|(a, b)| f64::from(*a) * f64::from(*b)).sum();
            assert!((left - right).abs() <= 1e-5 * x.len() as f64, "{size}: {left} {right}");
        }
    }
}
