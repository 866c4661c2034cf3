//! Pixels as codes on a logarithmic scale, packed for a page: few bytes, decoded exactly to the step that is stated.
//!
//! A value `v` has the code `c(v) = sign(v) round(L ln(1 + 64 |v|) / ln(1 + 64 V))`, `V` the largest absolute value of
//! the images and `L` the number of levels: linear in the dark, relative steps in the light. `L` is the largest of a few for
//! which the entropy of what is packed fits the budget; the page states the step. What is not finite has the code `L + 1`.
//!
//! The test image's codes are the reference's plus the rounded difference of both on that scale: what is equal stays equal,
//! and a value is true to one step.
//!
//! Packed of the reference: green, red minus green, blue minus green, each less its prediction from left, above and
//! above left (M. J. Weinberger, G. Seroussi, G. Sapiro, "The LOCO-I Lossless Image Compression Algorithm", IEEE
//! Transactions on Image Processing 9(8), 2000, equation 1); of the test image: its codes less the reference's.
//! All modulo 2^16, signs folded into the lowest bit, low bytes before high bytes, deflated.

use base64::Engine;
use lacuna_core::parallel::prelude::*;
use lacuna_filters::Plane;
use serde::Serialize;

/// Values far below this are linear in their codes.
const KNEE: f64 = 64.0;
/// Levels to choose from.
const LEVELS: [i32; 11] = [16383, 8191, 4095, 2047, 1535, 1023, 767, 639, 511, 383, 255];
/// Bytes a pixel that the images may take.
pub const BUDGET: f64 = 0.55;
/// Images up to this number of pixels always get all levels.
const SMALL: usize = 1 << 16;

/// A reference and a test image of one size, or one image alone.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Codes {
    /// The number of levels `L`.
    pub levels: i32,
    /// The largest absolute value `V`.
    pub largest: f64,
    /// The reference, or the only image, as base64.
    pub first: String,
    /// The test image, as base64.
    pub second: Option<String>,
}

impl Codes {
    /// Packs images of three planes each, in about `budget` bytes a pixel.
    pub fn new(first: [&Plane; 3], second: Option<[&Plane; 3]>, budget: f64) -> Self {
        let all = || first.iter().chain(second.iter().flatten()).flat_map(|plane| plane.pixels());
        let largest =
            all().filter(|value| value.is_finite()).fold(0.0_f32, |most, value| most.max(value.abs()));
        let largest = f64::from(largest.max(f32::MIN_POSITIVE));
        let whole = (KNEE * largest).ln_1p();
        let first = Logarithms::new(first, whole);
        let second = second.map(|second| Logarithms::new(second, whole));
        let pixels = first.planes[0].len();
        // Finer levels take more bytes, so that halving the list asks for few of them.
        let too_fine =
            |&levels: &i32| pixels > SMALL && bytes(&first, second.as_ref(), levels) > budget * pixels as f64;
        let levels = LEVELS[LEVELS.partition_point(too_fine).min(LEVELS.len() - 1)];
        let (first, second) = codes(&first, second.as_ref(), levels);
        let (first, second) = rayon::join(|| packed(&first), || second.map(|second| packed(&second)));
        Self { levels, largest, first, second }
    }
}

impl Codes {
    /// The steps from one level to the next at 0, and at the largest value over that value.
    pub fn steps(&self) -> (f64, f64) {
        let dark = ((KNEE * self.largest).ln_1p() / f64::from(self.levels)).exp_m1() / KNEE;
        (dark, dark * (1.0 + KNEE * self.largest) / self.largest)
    }
}

/// Deflated (zlib), as base64.
pub fn packed(bytes: &[u8]) -> String {
    let mut compressor = libdeflater::Compressor::new(libdeflater::CompressionLvl::default());
    if let Ok(level) = libdeflater::CompressionLvl::new(9) {
        compressor = libdeflater::Compressor::new(level);
    }
    let mut out = vec![0; compressor.zlib_compress_bound(bytes.len())];
    let length = compressor.zlib_compress(bytes, &mut out).unwrap_or(0);
    base64(&out[..length])
}

/// Bytes as text of 64 signs.
pub fn base64(bytes: &[u8]) -> String {
    base64::engine::general_purpose::STANDARD.encode(bytes)
}

/// An image on the logarithmic scale, -1 to 1; what is not finite is NaN.
struct Logarithms {
    planes: [Vec<f32>; 3],
    width: usize,
}

impl Logarithms {
    /// `whole` is the logarithm of the largest value.
    fn new(image: [&Plane; 3], whole: f64) -> Self {
        let of = |&value: &f32| {
            let log = (KNEE * f64::from(value.abs())).ln_1p() / whole;
            if value.is_finite() { (log as f32).copysign(value) } else { f32::NAN }
        };
        Self { planes: image.map(|plane| plane.pixels().par_iter().map(of)), width: image[0].size().width }
    }

    fn codes(&self, levels: i32) -> Vec<u8> {
        let code = |&log: &f32| code(log, levels);
        let [r, g, b] = [0, 1, 2].map(|k| self.planes[k].iter().map(code).collect::<Vec<i16>>());
        let less = |a: &[i16]| a.iter().zip(&g).map(|(a, g)| a.wrapping_sub(*g)).collect::<Vec<_>>();
        let planes = [less(&r), less(&b)];
        let folded: Vec<u16> =
            [&g, &planes[0], &planes[1]].into_iter().flat_map(|plane| predicted(plane, self.width)).collect();
        split(&folded)
    }

    fn codes_after(&self, reference: &Self, levels: i32) -> Vec<u8> {
        let pairs = reference.planes.iter().flatten().zip(self.planes.iter().flatten());
        let folded: Vec<u16> = pairs.map(|(&r, &t)| fold(after(r, t, levels))).collect();
        split(&folded)
    }
}

/// The codes of a reference and of its test image.
fn codes(first: &Logarithms, second: Option<&Logarithms>, levels: i32) -> (Vec<u8>, Option<Vec<u8>>) {
    rayon::join(|| first.codes(levels), || second.map(|second| second.codes_after(first, levels)))
}

/// Bytes that they would take.
fn bytes(first: &Logarithms, second: Option<&Logarithms>, levels: i32) -> f64 {
    let (first, second) = codes(first, second, levels);
    let (first, second) = rayon::join(|| entropy(&first), || second.map_or(0.0, |second| entropy(&second)));
    first + second
}

/// The code of a value by its logarithm.
fn code(log: f32, levels: i32) -> i16 {
    if log.is_nan() { (levels + 1) as i16 } else { (log * levels as f32).round() as i16 }
}

/// The test image's code less the reference's: the difference is rounded, not both, so that what is equal stays equal.
fn after(reference: f32, test: f32, levels: i32) -> i16 {
    let from = code(reference, levels);
    if reference.is_nan() || test.is_nan() {
        return code(test, levels).wrapping_sub(from);
    }
    let most = levels as i16;
    let difference = ((test - reference) * levels as f32).round() as i16;
    from.saturating_add(difference).clamp(-most, most) - from
}

/// Each value less its prediction.
fn predicted(plane: &[i16], width: usize) -> Vec<u16> {
    let mut out = Vec::with_capacity(plane.len());
    for (at, &value) in plane.iter().enumerate() {
        let left = if at % width > 0 { i32::from(plane[at - 1]) } else { 0 };
        let above = if at >= width { i32::from(plane[at - width]) } else { 0 };
        let corner = if at % width > 0 && at >= width { i32::from(plane[at - width - 1]) } else { 0 };
        let (low, high) = (left.min(above), left.max(above));
        let guess = if corner >= high {
            low
        } else if corner <= low {
            high
        } else {
            left + above - corner
        };
        out.push(fold(value.wrapping_sub(guess as i16)));
    }
    out
}

/// The sign into the lowest bit: 0, -1, 1, -2 become 0, 1, 2, 3.
fn fold(value: i16) -> u16 {
    ((value << 1) ^ (value >> 15)) as u16
}

/// Low bytes, then high bytes.
fn split(values: &[u16]) -> Vec<u8> {
    let low = values.iter().map(|value| *value as u8);
    low.chain(values.iter().map(|value| (value >> 8) as u8)).collect()
}

/// Bytes that an ideal code of single bytes would take, each half by itself.
fn entropy(bytes: &[u8]) -> f64 {
    bytes.chunks(bytes.len().div_ceil(2).max(1)).map(of_half).sum()
}

fn of_half(bytes: &[u8]) -> f64 {
    let mut counts = [0_u32; 256];
    for &byte in bytes {
        counts[usize::from(byte)] += 1;
    }
    let total = bytes.len() as f64;
    let bits = |&count: &u32| {
        let share = f64::from(count) / total;
        if count == 0 { 0.0 } else { -f64::from(count) * share.log2() }
    };
    counts.iter().map(bits).sum::<f64>() / 8.0
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn signs_are_folded() {
        assert_eq!([0, -1, 1, -2, i16::MAX, i16::MIN].map(fold), [0, 1, 2, 3, 65534, 65535]);
    }

    #[test]
    fn codes_are_exact_to_half_a_step_and_differences_too() {
        let values = [0.0, 1e-4, -0.3, 0.5, 0.5004, 9.99, 10.0, f32::NAN];
        let plane = Plane::new(lacuna_filters::Size::new(1, values.len()), values.to_vec()).unwrap();
        let whole = (KNEE * 10.0_f64).ln_1p();
        let logs = Logarithms::new([&plane; 3], whole);
        let levels = 1023;
        let back = |code: i16| {
            let size = (f64::from(code.abs()) / f64::from(levels) * whole).exp_m1();
            size / KNEE * f64::from(code.signum())
        };
        let step = |value: f32| (f64::from(value.abs()) + 1.0 / KNEE) * whole / f64::from(levels);
        for (&value, &log) in values.iter().zip(&logs.planes[0]).filter(|(value, _)| value.is_finite()) {
            let error = back(code(log, levels)) - f64::from(value);
            assert!(error.abs() <= 0.51 * step(value), "{value} {error}");
            for (&other, &other_log) in values.iter().zip(&logs.planes[0]).filter(|(v, _)| v.is_finite()) {
                let found = back(code(log, levels) + after(log, other_log, levels));
                assert!((found - f64::from(other)).abs() <= 1.02 * step(other), "{value} {other} {found}");
            }
            assert_eq!(after(log, log, levels), 0);
            assert_eq!(code(log, levels) + after(log, f32::NAN, levels), 1024);
        }
        assert_eq!(code(f32::NAN, levels), 1024);
    }

    #[test]
    fn black_and_the_faintest_values_have_codes() {
        for faint in [0.0, 1e-30_f32] {
            let plane = Plane::new(lacuna_filters::Size::new(1, 2), vec![0.0, faint]).unwrap();
            let codes = Codes::new([&plane; 3], None, BUDGET);
            let logs = Logarithms::new([&plane; 3], (KNEE * codes.largest).ln_1p());
            let all: Vec<i16> = logs.planes[0].iter().map(|&log| code(log, codes.levels)).collect();
            assert_eq!(all, [0, if faint > 0.0 { codes.levels as i16 } else { 0 }]);
            let (dark, bright) = codes.steps();
            assert!(dark > 0.0 && (bright * f64::from(codes.levels) - 1.0).abs() < 1e-3, "{dark} {bright}");
        }
    }

    #[test]
    fn levels_are_the_most_that_fit() {
        let size = lacuna_filters::Size::new(260, 260);
        let noise = |y: usize, x: usize| ((y * 7919 + x * 104_729) % 1009) as f32 / 1009.0 - 0.5;
        let mut chosen = Vec::new();
        for strength in [1e-6, 3e-5, 1e-4, 3e-4, 1e-3, 1.0] {
            let image = Plane::from_fn(size, |y, x| (y as f32 / 300.0).sin() * (x as f32 / 400.0).cos());
            let other =
                Plane::from_fn(size, |y, x| image.pixels()[y * size.width + x] + strength * noise(y, x));
            let found = Codes::new([&image; 3], Some([&other; 3]), BUDGET);
            let whole = (KNEE * found.largest).ln_1p();
            let (image, other) = (Logarithms::new([&image; 3], whole), Logarithms::new([&other; 3], whole));
            let fits = |levels: &i32| bytes(&image, Some(&other), *levels) <= BUDGET * size.pixels() as f64;
            assert_eq!(found.levels, LEVELS.into_iter().find(fits).unwrap_or(255), "{strength}");
            chosen.push(found.levels);
        }
        chosen.dedup();
        assert!(chosen.len() > 2, "{chosen:?}");
    }
}
