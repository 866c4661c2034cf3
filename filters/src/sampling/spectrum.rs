//! Power spectra of masks, and histograms of the Fourier magnitudes of images (thesis, figure 3.2).
//!
//! The periodogram of a mask of density D over n x m pixels is `|DFT(mask - D)|^2 / (n m D (1 - D))`: 1 on average over
//! all frequencies but zero (Parseval), and everywhere 1 in expectation for a random mask. Large masks are cut into squares
//! of at most 256 pixels, of at most 64 of which (evenly chosen) the periodograms are averaged. The radial average
//! takes rings of equal width in cycles per pixel, up to 0.5.
//!
//! Sources: R. Ulichney, "Digital Halftoning", MIT Press 1987 (radially averaged power spectra, anisotropy); M. Bartlett,
//! "Smoothing Periodograms from Time-Series with Continuous Spectra", Nature 161, 1948 (averaging).

use lacuna_transforms::{Complex, Planned};
use serde::Serialize;

use crate::{Mask, Plane, Size};

/// Side of the squares at most.
const SIDE: usize = 256;
/// Squares along each direction at most.
const SQUARES: usize = 8;

/// A power spectrum in two dimensions and its radial average.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Spectrum {
    /// Height and width of `power`.
    pub height: usize,
    /// Width of `power`.
    pub width: usize,
    /// Power by frequency, frequency 0 at row `height / 2`, column `width / 2`; a random mask has 1 in expectation.
    #[serde(skip)]
    pub power: Vec<f64>,
    /// Mean power of the rings, the k-th about frequency (k + 1/2) / (2 K) cycles per pixel of K rings.
    pub radial: Vec<f64>,
}

/// The spectrum of a mask; without a frequency but zero (1x1) there are no rings.
pub fn of_mask(mask: &Mask) -> Spectrum {
    let size = mask.size();
    let square = Size::new(size.height.min(SIDE), size.width.min(SIDE));
    let mut power = vec![0.0; square.pixels()];
    let starts = |whole: usize, part: usize| -> Vec<usize> {
        let fitting = (whole / part.max(1)).max(1);
        let count = fitting.min(SQUARES);
        (0..count).map(|k| k * fitting / count * part).collect()
    };
    let density = mask.density();
    let scale = density * (1.0 - density) * square.pixels() as f64;
    let (tops, lefts) = (starts(size.height, square.height), starts(size.width, square.width));
    let squares = (tops.len() * lefts.len()) as f64;
    for &top in &tops {
        for &left in &lefts {
            let value = |y: usize, x: usize| f64::from(u8::from(mask.is_measured(top + y, left + x)));
            let values = (0..square.pixels()).map(|p| value(p / square.width, p % square.width) - density);
            let transform = dft(square, values.map(|re| Complex { re, im: 0.0 }).collect());
            for (power, value) in power.iter_mut().zip(transform) {
                *power += if scale > 0.0 { value.norm_sqr() / (scale * squares) } else { 0.0 };
            }
        }
    }
    let radial = radial(square, &power);
    let centred = (0..square.pixels()).map(|pixel| {
        let (y, x) = (pixel / square.width, pixel % square.width);
        let y = (y + square.height - square.height / 2) % square.height;
        let x = (x + square.width - square.width / 2) % square.width;
        power[y * square.width + x]
    });
    Spectrum { height: square.height, width: square.width, power: centred.collect(), radial }
}

/// Means over rings; a ring without a frequency takes the one before.
fn radial(size: Size, power: &[f64]) -> Vec<f64> {
    let rings = (size.height.min(size.width) / 2).max(1);
    let (mut sums, mut counts) = (vec![0.0; rings], vec![0_u32; rings]);
    for (pixel, value) in power.iter().enumerate().skip(1) {
        let (fy, fx) =
            (frequency(pixel / size.width, size.height), frequency(pixel % size.width, size.width));
        // The last ring has its upper end: the peaks of a grid of step 2 lie there.
        let ring = 2.0 * fy.hypot(fx) * rings as f64;
        if ring <= rings as f64 {
            let ring = (ring as usize).min(rings - 1);
            sums[ring] += value;
            counts[ring] += 1;
        }
    }
    let mut last = 0.0;
    let mean = |(sum, count): (f64, u32)| {
        last = if count > 0 { sum / f64::from(count) } else { last };
        last
    };
    sums.into_iter().zip(counts).map(mean).collect()
}

/// The frequency of a DFT index in cycles per pixel, -1/2 to 1/2.
fn frequency(index: usize, count: usize) -> f64 {
    let index = if 2 * index > count { index as f64 - count as f64 } else { index as f64 };
    index / count as f64
}

/// The two-dimensional discrete Fourier transform, not scaled.
pub(super) fn dft(size: Size, mut values: Vec<Complex<f64>>) -> Vec<Complex<f64>> {
    if values.is_empty() {
        return values;
    }
    f64::forward(size.width).process(&mut values);
    let columns = f64::forward(size.height);
    let mut column = vec![Complex::default(); size.height];
    for x in 0..size.width {
        for (y, value) in column.iter_mut().enumerate() {
            *value = values[y * size.width + x];
        }
        columns.process(&mut column);
        for (y, value) in column.iter().enumerate() {
            values[y * size.width + x] = *value;
        }
    }
    values
}

/// A histogram over powers of ten.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Histogram {
    /// The decimal logarithm of the lower end of the first bin.
    pub from: f64,
    /// Width of a bin in decades.
    pub step: f64,
    /// Values in each bin; those below or above count in the first or last.
    pub counts: Vec<u64>,
}

impl Histogram {
    /// The decimal logarithm at the middle of the bin that holds the median.
    pub fn median(&self) -> f64 {
        let half = self.counts.iter().sum::<u64>().div_ceil(2);
        let mut sum = 0;
        let reached = |count: &u64| {
            sum += count;
            sum >= half
        };
        let bin = self.counts.iter().position(reached).unwrap_or(0);
        self.from + self.step * (bin as f64 + 0.5)
    }
}

/// The DFT magnitudes of an image and of its derivatives along x and y (forward differences), each brought to the range
/// [0, 1] before, as in figure 3.2 of the thesis. Magnitudes are divided by the number of pixels.
pub fn magnitudes(image: &Plane) -> [Histogram; 3] {
    let size = image.size();
    let next = |i: usize, count: usize| (i + 1).min(count.saturating_sub(1));
    let dx = Plane::from_fn(size, |y, x| image.at(y, next(x, size.width)) - image.at(y, x));
    let dy = Plane::from_fn(size, |y, x| image.at(next(y, size.height), x) - image.at(y, x));
    [histogram(image), histogram(&dx), histogram(&dy)]
}

fn histogram(image: &Plane) -> Histogram {
    let (from, step) = (-10.0, 0.1);
    let mut counts = vec![0; 100];
    let finite = || image.pixels().iter().copied().filter(|value| value.is_finite());
    let (low, high) = finite().fold((f32::INFINITY, f32::NEG_INFINITY), |(l, h), v| (l.min(v), h.max(v)));
    let range = if high > low { f64::from(high) - f64::from(low) } else { 1.0 };
    let scaled = |value: &f32| {
        let value = if value.is_finite() { f64::from(*value) - f64::from(low) } else { 0.0 };
        Complex { re: value / range, im: 0.0 }
    };
    let pixels = image.size().pixels() as f64;
    for value in dft(image.size(), image.pixels().iter().map(scaled).collect()) {
        let decade = (value.norm() / pixels).max(1e-300).log10();
        counts[((decade - from) / step).clamp(0.0, 99.0) as usize] += 1;
    }
    Histogram { from, step, counts }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::sampling::{Band, Field, Order, Pattern};

    fn mask(pattern: Pattern, density: f64) -> Mask {
        let field = Field { x: 0, y: 0, size: Size::new(256, 256) };
        Order::new(pattern, field, 1, 0).unwrap().mask(Band::below(density))
    }

    #[test]
    fn the_mean_power_is_one() {
        for pattern in [Pattern::Random, Pattern::Shuffle, Pattern::BlueNoise] {
            let spectrum = of_mask(&mask(pattern, 0.2));
            let mean = spectrum.power.iter().sum::<f64>() / 65536.0;
            assert!((mean - 1.0).abs() < 1e-9, "{pattern:?}: {mean}");
        }
    }

    #[test]
    fn random_is_white_and_blue_noise_is_blue() {
        let white = of_mask(&mask(Pattern::Random, 0.2)).radial;
        assert!(white[16..].iter().all(|power| (0.6..1.5).contains(power)), "{white:?}");
        let blue = of_mask(&mask(Pattern::BlueNoise, 0.2)).radial;
        // The principal frequency is sqrt(0.2) = 0.447 cycles per pixel, ring 114; up to half of it there is next to nothing (a tenth).
        assert!(blue[..57].iter().all(|power| *power < 0.2), "{blue:?}");
        assert!(blue[105..120].iter().any(|power| *power > 1.5), "{blue:?}");
    }

    #[test]
    fn the_transform_is_the_sum_of_its_definition() {
        let size = Size::new(3, 5);
        let values: Vec<_> =
            (0..15).map(|i| Complex { re: f64::from(i * i % 7), im: f64::from(i % 4) }).collect();
        let fast = dft(size, values.clone());
        for (k, fast) in fast.iter().enumerate() {
            let sum: Complex<f64> = (0..15)
                .map(|p| {
                    let phase = (k / 5 * (p / 5)) as f64 / 3.0 + (k % 5 * (p % 5)) as f64 / 5.0;
                    values[p] * Complex::from_polar(1.0, -std::f64::consts::TAU * phase)
                })
                .sum();
            assert!((sum - fast).norm() < 1e-12 * 15.0 * 7.0);
        }
    }

    #[test]
    fn degenerate_masks_have_a_spectrum() {
        for size in [Size::new(1, 1), Size::new(1, 9), Size::new(9, 1), Size::new(0, 0)] {
            for flag in [false, true] {
                let spectrum = of_mask(&Mask::from_fn(size, |_, _| flag));
                assert!(spectrum.radial.iter().chain(&spectrum.power).all(|power| *power == 0.0));
            }
        }
    }

    #[test]
    fn a_wave_has_one_magnitude() {
        let size = Size::new(16, 32);
        let wave = Plane::from_fn(size, |_, x| (std::f32::consts::TAU * x as f32 / 8.0).cos());
        let [image, dx, dy] = magnitudes(&wave);
        for histogram in [&image, &dx, &dy] {
            assert_eq!(histogram.counts.iter().sum::<u64>(), 512);
        }
        // Mean 1/2 and two peaks of 1/4; the derivative along y is 0 everywhere.
        let bin = |magnitude: f64| ((magnitude.log10() + 10.0) / 0.1) as usize;
        assert_eq!(image.counts[bin(0.5)], 1);
        assert_eq!(image.counts[bin(0.25)], 2);
        assert_eq!(dy.counts[0], 512);
    }
}
