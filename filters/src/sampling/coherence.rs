//! Coherence of sensing matrices (thesis, equation 3.6 and figure 3.1).
//!
//! A sensing matrix `A = S B` (M x N) keeps the M rows of a synthesis matrix B (N x N) that belong to measured pixels. Its
//! coherence is `max over i < j of |<a_i, a_j>| / (|a_i| |a_j|)`, 0 to 1: the lower, the better for recovery by l1
//! minimisation. Columns that no measured pixel sees have no direction and are left out.
//!
//! - Partial Fourier, `B = F^-1`: `<a_i, a_j>` depends on the difference of the frequencies alone and is the transform of
//!   the mask, so that the coherence is `max over k != 0 of |DFT(mask)(k)| / M`: one FFT.
//! - CS-Wavelet, `B = Phi^-1 W^-1` (equation 3.7): W a periodic wavelet transform over all levels (rows, then columns, of the
//!   coarse quarter each), Phi a blur that multiplies the frequency (k, l) (indices -n/2 to n/2) by
//!   `exp(-(k^2 + l^2) / (2 sigma^2))`: sigma is the standard deviation in the Fourier domain, smaller blurs more.
//!
//! Cost: building a basis O(N^2 log N), a coherence N^2 M / 2 multiplications in f32, and twice 4 N^2 bytes.
//!
//! Sources: I. Daubechies, "Ten Lectures on Wavelets", SIAM 1992 (tables 6.1 and 8.3: the filters); P. Sen, S. Darabi,
//! "Compressive Rendering: A Rendering Application of Compressed Sensing", IEEE TVCG 17(4), 2011 (the blur); L. Welch, "Lower
//! Bounds on the Maximum Cross Correlation of Signals", IEEE Transactions on Information Theory 20(3), 1974.

use lacuna_core::parallel::prelude::*;
use lacuna_transforms::Complex;
use ndarray::{Array2, Axis, s};

use super::spectrum::dft;
use crate::{Error, Mask, Size};

/// The wavelets of a basis.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Wavelet {
    /// Haar, 2 taps.
    Haar,
    /// Daubechies, 4 taps.
    Daubechies4,
    /// Daubechies, 8 taps.
    Daubechies8,
    /// Cohen, Daubechies and Feauveau, 9 and 7 taps, biorthogonal.
    Cdf97,
}

impl Wavelet {
    /// All families.
    pub const ALL: [Self; 4] = [Self::Haar, Self::Daubechies4, Self::Daubechies8, Self::Cdf97];

    /// The name in tables.
    pub const fn name(self) -> &'static str {
        match self {
            Self::Haar => "haar",
            Self::Daubechies4 => "daubechies-4",
            Self::Daubechies8 => "daubechies-8",
            Self::Cdf97 => "cdf-9/7",
        }
    }

    /// The synthesis filters, low-pass and high-pass, each with the offset of its first tap.
    fn synthesis(self) -> [(Vec<f64>, isize); 2] {
        let low: &[f64] = match self {
            Self::Haar => &[std::f64::consts::FRAC_1_SQRT_2; 2],
            Self::Daubechies4 => &DAUBECHIES_4,
            Self::Daubechies8 => &DAUBECHIES_8,
            Self::Cdf97 => return cdf97(),
        };
        // The quadrature mirror: reversed, every second sign changed.
        let high = low.iter().rev().enumerate().map(|(i, tap)| if i % 2 == 0 { *tap } else { -tap });
        [(low.to_vec(), 0), (high.collect(), 0)]
    }
}

const DAUBECHIES_4: [f64; 4] =
    [0.482_962_913_144_534_2, 0.836_516_303_737_807_9, 0.224_143_868_042_013_4, -0.129_409_522_551_260_4];
const DAUBECHIES_8: [f64; 8] = [
    0.230_377_813_308_896_5,
    0.714_846_570_552_915_6,
    0.630_880_767_929_858_9,
    -0.027_983_769_416_859_85,
    -0.187_034_811_719_093_1,
    0.030_841_381_835_560_76,
    0.032_883_011_666_885_2,
    -0.010_597_401_785_069_03,
];

/// Synthesis low-pass of 7 taps; the high-pass is the analysis low-pass of 9 taps with alternating signs.
fn cdf97() -> [(Vec<f64>, isize); 2] {
    let seven =
        [0.788_485_616_405_583, 0.418_092_273_221_617, -0.040_689_417_609_558, -0.064_538_882_628_697];
    let nine = [
        0.852_698_679_008_894,
        0.377_402_855_612_831,
        -0.110_624_404_418_437,
        -0.023_849_465_019_557,
        0.037_828_455_507_264,
    ];
    let unfold = |half: &[f64], alternate: bool| {
        let reach = half.len() as isize - 1;
        let tap = |i: isize| {
            let sign = if alternate && i % 2 != 0 { -1.0 } else { 1.0 };
            sign * half[i.unsigned_abs()]
        };
        (-reach..=reach).map(tap).collect::<Vec<f64>>()
    };
    [(unfold(&seven, false), -3), (unfold(&nine, true), -3)]
}

/// The coherence of the partial Fourier matrix of a mask; nothing without measured pixels or with one pixel in all.
pub fn fourier(mask: &Mask) -> Option<f64> {
    if mask.is_empty() || mask.size().pixels() < 2 {
        return None;
    }
    let flags = mask.as_slice().iter().map(|&flag| Complex { re: f64::from(u8::from(flag)), im: 0.0 });
    let transform = dft(mask.size(), flags.collect());
    let largest = transform.iter().skip(1).map(|value| value.norm()).fold(0.0, f64::max);
    Some(largest / mask.count() as f64)
}

/// A synthesis matrix of n x n images.
#[derive(Clone, Debug)]
pub struct Basis {
    side: usize,
    /// One row per pixel, one column per coefficient.
    matrix: Array2<f32>,
}

impl Basis {
    /// Wavelets, with the inverse of a blur of standard deviation `sigma` in the Fourier domain, if one is given.
    ///
    /// # Errors
    /// [`Error::Setting`] if the side is no power of two from 2 to 64 or sigma not above 0.
    pub fn new(side: usize, wavelet: Wavelet, sigma: Option<f64>) -> Result<Self, Error> {
        if !side.is_power_of_two() || !(2..=64).contains(&side) {
            return Err(Error::setting("side", &side, "a power of two from 2 to 64"));
        }
        if let Some(value) = sigma.filter(|sigma| sigma.is_nan() || *sigma <= 0.0) {
            return Err(Error::setting("sigma", &value, "above 0"));
        }
        let pixels = side * side;
        let filters = wavelet.synthesis();
        let mut columns = vec![0.0_f32; pixels * pixels];
        columns.par_chunks_mut(pixels).enumerate().for_each(|(index, column)| {
            let mut image = vec![0.0; pixels];
            image[index] = 1.0;
            synthesise(side, &mut image, &filters);
            if let Some(sigma) = sigma {
                sharpen(side, &mut image, sigma);
            }
            for (value, pixel) in column.iter_mut().zip(&image) {
                *value = *pixel as f32;
            }
        });
        let columns = Array2::from_shape_vec((pixels, pixels), columns)
            .map_err(|_| Error::TooLarge { size: Size::new(pixels, pixels) })?;
        Ok(Self { side, matrix: columns.reversed_axes() })
    }

    /// The coherence of the rows of measured pixels; nothing if fewer than two columns have a direction.
    ///
    /// # Errors
    /// [`Error::SizeMismatch`] if the mask's size is not the basis's.
    pub fn coherence(&self, mask: &Mask) -> Result<Option<f64>, Error> {
        let size = Size::new(self.side, self.side);
        if mask.size() != size {
            return Err(Error::SizeMismatch { expected: size, found: mask.size().to_string() });
        }
        let rows: Vec<usize> = (0..size.pixels()).filter(|&pixel| mask.as_slice()[pixel]).collect();
        let mut sensing = self.matrix.select(Axis(0), &rows);
        let norms: Vec<f64> = sensing.axis_iter(Axis(1)).map(|column| norm(column.iter())).collect();
        let full: Vec<f64> = self.matrix.axis_iter(Axis(1)).map(|column| norm(column.iter())).collect();
        // Rounding leaves traces of columns that the measured pixels do not see.
        let seen: Vec<usize> =
            (0..size.pixels()).filter(|&column| norms[column] > 1e-5 * full[column]).collect();
        if seen.len() < 2 {
            return Ok(None);
        }
        for (mut column, norm) in sensing.axis_iter_mut(Axis(1)).zip(&norms) {
            let scale = if *norm > 0.0 { norm.recip() as f32 } else { 0.0 };
            column.mapv_inplace(|value| value * scale);
        }
        let sensing = sensing.select(Axis(1), &seen);
        Ok(Some(largest_product(&sensing)))
    }
}

fn norm<'a>(values: impl Iterator<Item = &'a f32>) -> f64 {
    values.map(|&value| f64::from(value).powi(2)).sum::<f64>().sqrt()
}

/// The largest inner product of two different columns by its magnitude, from the blocks of the upper triangle.
fn largest_product(columns: &Array2<f32>) -> f64 {
    const BLOCK: usize = 256;
    let starts: Vec<usize> = (0..columns.ncols()).step_by(BLOCK).collect();
    let pairs: Vec<(usize, usize)> =
        starts.iter().flat_map(|&a| starts.iter().filter(move |&&b| b >= a).map(move |&b| (a, b))).collect();
    let block = |start: usize| columns.slice(s![.., start..(start + BLOCK).min(columns.ncols())]);
    let largest = pairs.into_par_iter().map(|(a, b)| {
        let products = block(a).t().dot(&block(b));
        let mut largest = 0.0_f32;
        for ((i, j), product) in products.indexed_iter() {
            if a + i < b + j {
                largest = largest.max(product.abs());
            }
        }
        largest
    });
    f64::from(largest.into_iter().fold(0.0, f32::max))
}

/// The inverse wavelet transform over all levels, in place: level after level the coarse square doubles its side.
fn synthesise(side: usize, image: &mut [f64], filters: &[(Vec<f64>, isize); 2]) {
    let mut level = 2;
    while level <= side {
        let mut line = vec![0.0; level];
        for x in 0..level {
            (0..level).for_each(|y| line[y] = image[y * side + x]);
            let out = unite(&line, filters);
            (0..level).for_each(|y| image[y * side + x] = out[y]);
        }
        for row in image.chunks_exact_mut(side).take(level) {
            let out = unite(&row[..level], filters);
            row[..level].copy_from_slice(&out);
        }
        level *= 2;
    }
}

/// One level of synthesis: the first half of `line` is coarse, the second detail; periodic.
fn unite(line: &[f64], filters: &[(Vec<f64>, isize); 2]) -> Vec<f64> {
    let mut out = vec![0.0; line.len()];
    let half = line.len() / 2;
    for (part, (taps, first)) in line.chunks_exact(half).zip(filters) {
        for (i, value) in part.iter().enumerate().filter(|(_, value)| **value != 0.0) {
            for (t, tap) in taps.iter().enumerate() {
                let at = (2 * i) as isize + first + t as isize;
                out[at.rem_euclid(line.len() as isize) as usize] += tap * value;
            }
        }
    }
    out
}

/// Undoes the blur.
fn sharpen(side: usize, image: &mut [f64], sigma: f64) {
    let size = Size::new(side, side);
    let mut transform = dft(size, image.iter().map(|&re| Complex { re, im: 0.0 }).collect());
    let index = |k: usize| k.min(side - k) as f64;
    for (k, value) in transform.iter_mut().enumerate() {
        let squared = index(k / side).powi(2) + index(k % side).powi(2);
        // Conjugated, so that the forward transform serves as the inverse.
        *value = value.conj() * (squared / (2.0 * sigma * sigma)).exp();
    }
    for (pixel, value) in image.iter_mut().zip(dft(size, transform)) {
        *pixel = value.re / size.pixels() as f64;
    }
}

#[cfg(test)]
#[path = "coherence/tests.rs"]
mod tests;
