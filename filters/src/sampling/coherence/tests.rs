//! Tests of the coherence: closed forms, theory, and the definition in f64.

use super::*;
use crate::sampling::{Field, Pattern, Temporal};

fn mask(side: usize, pattern: Pattern, density: f64, seed: u64) -> Mask {
    let field = Field { x: 0, y: 0, size: Size::new(side, side) };
    crate::sampling::mask(pattern, field, density, seed, Temporal::Fixed, 0).unwrap()
}

#[test]
fn partial_fourier_has_its_closed_forms() {
    let of = |measured: fn(usize, usize) -> bool| fourier(&Mask::from_fn(Size::new(64, 64), measured));
    assert!(of(|_, _| true).unwrap() < 1e-12, "the whole basis is orthogonal");
    assert!((of(|y, x| y == 5 && x == 9).unwrap() - 1.0).abs() < 1e-12, "one row: all columns alike");
    assert!((of(|y, x| y % 4 == 0 && x % 4 == 0).unwrap() - 1.0).abs() < 1e-12, "a grid aliases");
    // All pixels but one: |DFT| is 1 off the origin, over M = N - 1.
    assert!((of(|y, x| y + x > 0).unwrap() - 1.0 / 4095.0).abs() < 1e-12);
    // Half of the columns, side by side: a Dirichlet kernel, 1 / (32 sin(pi / 64)) at its first frequency.
    let dirichlet = 1.0 / (32.0 * (std::f64::consts::PI / 64.0).sin());
    assert!((of(|_, x| x < 32).unwrap() - dirichlet).abs() < 1e-12);
    assert_eq!(of(|_, _| false), None);
}

#[test]
fn random_partial_fourier_follows_theory() {
    // Welch: at least sqrt((N - M) / (M (N - 1))), which is the root mean square over the frequencies (Parseval). The
    // squares of N / 2 independent frequencies of a random mask are about exponential, so the largest of them is near
    // ln(N / 2) + 0.577 times their mean, with a standard deviation of 1.28 times it.
    let pixels = 4096.0_f64;
    for density in [0.1, 0.2, 0.5, 0.8] {
        let measured = (density * pixels).round();
        let square = (pixels - measured) / (measured * (pixels - 1.0));
        let mut sum = 0.0;
        for seed in 0..16 {
            let coherence = fourier(&mask(64, Pattern::Random, density, seed)).unwrap();
            assert!(coherence > square.sqrt() * (1.0 - 1e-12));
            sum += coherence.powi(2) / square;
        }
        let expected = (pixels / 2.0).ln() + 0.577;
        // Five standard errors of the mean of 16, 1.6.
        assert!((sum / 16.0 - expected).abs() < 1.6, "{density}: {} {expected}", sum / 16.0);
    }
}

#[test]
fn complete_wavelets_are_orthonormal() {
    let full = Mask::from_fn(Size::new(32, 32), |_, _| true);
    for wavelet in [Wavelet::Haar, Wavelet::Daubechies4, Wavelet::Daubechies8] {
        let basis = Basis::new(32, wavelet, None).unwrap();
        let coherence = basis.coherence(&full).unwrap().unwrap();
        assert!(coherence < 32.0 * f64::from(f32::EPSILON), "{wavelet:?}: {coherence}");
    }
    // CDF 9/7 is nearly orthogonal only.
    let cdf = Basis::new(32, Wavelet::Cdf97, None).unwrap().coherence(&full).unwrap().unwrap();
    assert!((0.01..0.5).contains(&cdf), "{cdf}");
}

#[test]
fn filters_have_their_moments() {
    for wavelet in Wavelet::ALL {
        let [(low, _), (high, _)] = wavelet.synthesis();
        assert!((low.iter().sum::<f64>() - std::f64::consts::SQRT_2).abs() < 1e-9, "{wavelet:?}");
        assert!(high.iter().sum::<f64>().abs() < 1e-9, "{wavelet:?}");
    }
}

#[test]
fn agrees_with_the_definition() {
    for (wavelet, sigma) in
        [(Wavelet::Haar, None), (Wavelet::Daubechies4, Some(3.0)), (Wavelet::Cdf97, Some(6.0))]
    {
        let basis = Basis::new(8, wavelet, sigma).unwrap();
        let mask = mask(8, Pattern::Random, 0.6, 1);
        let rows: Vec<usize> = (0..64).filter(|&pixel| mask.as_slice()[pixel]).collect();
        let column = |j: usize| rows.iter().map(|&i| f64::from(basis.matrix[[i, j]])).collect::<Vec<_>>();
        let dot = |a: &[f64], b: &[f64]| a.iter().zip(b).map(|(a, b)| a * b).sum::<f64>();
        let mut expected = 0.0_f64;
        for i in 0..64 {
            for j in 0..i {
                let (a, b) = (column(i), column(j));
                let norms = (dot(&a, &a) * dot(&b, &b)).sqrt();
                if norms > 1e-9 {
                    expected = expected.max(dot(&a, &b).abs() / norms);
                }
            }
        }
        let found = basis.coherence(&mask).unwrap().unwrap();
        assert!((found - expected).abs() < 64.0 * f64::from(f32::EPSILON), "{wavelet:?}: {found} {expected}");
    }
}

#[test]
fn the_blur_is_undone() {
    let mut image = vec![0.0; 64];
    image[27] = 1.0;
    sharpen(8, &mut image, 2.5);
    // Blurred again, in the Fourier domain, the point is back.
    let size = Size::new(8, 8);
    let mut transform = dft(size, image.iter().map(|&re| Complex { re, im: 0.0 }).collect());
    for (k, value) in transform.iter_mut().enumerate() {
        let index = |k: usize| k.min(8 - k) as f64;
        *value *= (-(index(k / 8).powi(2) + index(k % 8).powi(2)) / 12.5).exp();
        let phase = std::f64::consts::TAU * ((k / 8 * 3) as f64 + (k % 8 * 3) as f64) / 8.0;
        assert!((*value - Complex::from_polar(1.0, -phase)).norm() < 1e-9);
    }
}

#[test]
fn nonsense_is_refused() {
    assert!(Basis::new(12, Wavelet::Haar, None).is_err());
    assert!(Basis::new(128, Wavelet::Haar, None).is_err());
    assert!(Basis::new(8, Wavelet::Haar, Some(0.0)).is_err());
    let basis = Basis::new(8, Wavelet::Haar, None).unwrap();
    assert!(basis.coherence(&Mask::from_fn(Size::new(8, 9), |_, _| true)).is_err());
    assert_eq!(basis.coherence(&Mask::from_fn(Size::new(8, 8), |_, _| false)), Ok(None));
}
