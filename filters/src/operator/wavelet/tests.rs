//! The transform against `PyWavelets`, its inverse and its adjoint.

use proptest::prelude::*;

use super::*;

/// Written by `scripts/python/sensing_reference.py` with `PyWavelets`: lines
/// `wavelet boundary height width levels coefficients n : every n-th coefficient`.
const FIXTURE: &str = include_str!("../../../tests/data/wavelets.txt");

/// The images that the fixture was made from.
fn image(size: Size) -> Vec<f32> {
    (0..size.pixels()).map(|i| ((i * 7919 + 13) % 101) as f32 / 64.0 - 0.75).collect()
}

fn forward(transform: &Transform, x: &[f32]) -> Vec<f32> {
    let mut c = vec![0.0; transform.coefficients()];
    transform.forward(x, &mut c, &mut transform.scratch());
    c
}

#[test]
fn coefficients_are_those_of_pywavelets() {
    let mut families = std::collections::HashSet::new();
    let mut lines = 0;
    for line in FIXTURE.lines().filter(|line| !line.starts_with('#')) {
        let (head, values) = line.split_once(" : ").unwrap();
        let words: Vec<&str> = head.split(' ').collect();
        let number = |at: usize| words[at].parse::<usize>().unwrap();
        let boundary = if words[1] == "periodic" { Boundary::Periodic } else { Boundary::Symmetric };
        let size = Size::new(number(2), number(3));
        let transform = Transform::new(size, words[0].parse().unwrap(), boundary, number(4));
        assert_eq!(transform.levels(), number(4), "{head}");
        let expected: Vec<f64> = values.split(' ').map(|value| value.parse().unwrap()).collect();
        let found = forward(&transform, &image(size));
        assert_eq!(found.len(), number(5), "{head}");
        assert_eq!(found.len().div_ceil(number(6)), expected.len(), "{head}");
        for (found, expected) in found.iter().step_by(number(6)).zip(&expected) {
            assert!((f64::from(*found) - expected).abs() <= 1e-5, "{head}: {found} {expected}");
        }
        families.insert((words[0], words[1]));
        lines += 1;
    }
    assert_eq!(families.len(), 2 * Wavelet::all().len());
    assert!(lines >= 150);
}

fn any_case() -> impl Strategy<Value = (Size, Wavelet, Boundary, usize)> {
    let boundary = prop_oneof![Just(Boundary::Periodic), Just(Boundary::Symmetric)];
    (1_usize..48, 1_usize..48, prop::sample::select(Wavelet::all()), boundary, 0_usize..6).prop_map(
        |(height, width, wavelet, boundary, levels)| (Size::new(height, width), wavelet, boundary, levels),
    )
}

proptest! {
    #[test]
    fn the_inverse_is_perfect((size, wavelet, boundary, levels) in any_case()) {
        let transform = Transform::new(size, wavelet, boundary, levels);
        let x = image(size);
        let c = forward(&transform, &x);
        let mut back = vec![0.0; x.len()];
        transform.inverse(&c, &mut back, &mut transform.scratch());
        for (back, x) in back.iter().zip(&x) {
            prop_assert!((back - x).abs() <= 1e-5);
        }
        if transform.is_orthonormal() {
            let mut adjoint = vec![0.0; x.len()];
            transform.adjoint(&c, &mut adjoint, &mut transform.scratch());
            for (adjoint, x) in adjoint.iter().zip(&x) {
                prop_assert!((adjoint - x).abs() <= 1e-5);
            }
        }
    }

    /// `<W x, c> = <x, W^T c>`.
    #[test]
    fn the_adjoint_is_one((size, wavelet, boundary, levels) in any_case(), seed in 0_usize..1000) {
        let transform = Transform::new(size, wavelet, boundary, levels);
        let x = image(size);
        let c: Vec<f32> =
            (0..transform.coefficients()).map(|i| ((i * 7907 + seed) % 211) as f32 / 105.0 - 1.0).collect();
        let mut back = vec![0.0; x.len()];
        transform.adjoint(&c, &mut back, &mut transform.scratch());
        let dot = |a: &[f32], b: &[f32]| -> f64 {
            a.iter().zip(b).map(|(a, b)| f64::from(*a) * f64::from(*b)).sum()
        };
        let (left, right) = (dot(&forward(&transform, &x), &c), dot(&x, &back));
        prop_assert!((left - right).abs() <= 1e-5 * x.len() as f64, "{} {}", left, right);
    }
}

#[test]
fn no_level_grows_an_image_and_a_pixel_is_left_alone() {
    let transform = Transform::new(Size::new(1, 1), Wavelet::Haar, Boundary::Periodic, 9);
    assert_eq!((transform.levels(), transform.coefficients()), (0, 1));
    assert_eq!(forward(&transform, &[3.0]), [3.0]);
    let long = Transform::new(Size::new(9, 9), Wavelet::Daubechies(10), Boundary::Symmetric, 3);
    assert_eq!(long.levels(), 0);
    let even = |size| Transform::new(size, Wavelet::Daubechies(4), Boundary::Periodic, 3);
    assert!(even(Size::new(16, 24)).is_orthonormal() && !even(Size::new(16, 20)).is_orthonormal());
}
