//! Tests of the Poisson disks.

use proptest::prelude::*;

use super::*;

const fn field(height: usize, width: usize) -> Field {
    Field { x: 3, y: -8, size: Size::new(height, width) }
}

/// The least squared distance of two samples.
fn least(mask: &Mask) -> usize {
    let size = mask.size();
    let points: Vec<_> = (0..size.pixels())
        .filter(|&pixel| mask.as_slice()[pixel])
        .map(|pixel| (pixel / size.width, pixel % size.width))
        .collect();
    let mut least = usize::MAX;
    for (index, a) in points.iter().enumerate() {
        for b in &points[..index] {
            least = least.min(a.0.abs_diff(b.0).pow(2) + a.1.abs_diff(b.1).pow(2));
        }
    }
    least
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(24))]
    #[test]
    fn counts_are_exact(height in 1_usize..40, width in 1_usize..40, density in 0.0..=1.0_f64, seed in any::<u64>()) {
        let mask = mask(field(height, width), density, seed).unwrap();
        prop_assert_eq!(mask.count(), (density * (height * width) as f64).round() as usize);
    }
}

#[test]
fn samples_keep_the_distance_of_the_density() {
    for (density, expected) in [(0.4, 1), (0.3, 2), (0.2, 2), (0.1, 5), (0.05, 10), (0.01, 64)] {
        let mask = mask(field(90, 101), density, 1).unwrap();
        assert!(least(&mask) >= expected, "{density}: {}", least(&mask));
    }
}

#[test]
fn a_pass_is_maximal_and_keeps_the_distance() {
    let size = Size::new(90, 70);
    let mut set = Set::new(size);
    for squared in [8, 5] {
        set.pass(squared, 9);
        let samples: Vec<usize> = (0..size.pixels()).filter(|&pixel| set.taken[pixel]).collect();
        for pixel in 0..size.pixels() {
            let distance =
                |a: usize| (a / 70).abs_diff(pixel / 70).pow(2) + (a % 70).abs_diff(pixel % 70).pow(2);
            let least = samples.iter().filter(|&&a| a != pixel).map(|&a| distance(a)).min().unwrap();
            assert_eq!(least >= squared as usize, set.taken[pixel], "{pixel}");
        }
    }
}

#[test]
fn radii_are_sums_of_two_squares() {
    let sums = [1, 2, 4, 5, 8, 9, 10, 13, 16, 17, 18, 20, 25];
    for pair in sums.windows(2) {
        assert_eq!((sum_of_squares_above(pair[0]), sum_of_squares_below(pair[1])), (pair[1], pair[0]));
    }
    assert_eq!((sum_of_squares_above(0), sum_of_squares_below(1)), (1, 1));
}

#[test]
fn a_field_larger_than_the_probe_is_exact_too() {
    let field = field(700, 1100);
    assert_eq!(mask(field, 0.07, 2).unwrap().count(), 53_900);
}

#[test]
fn seeds_differ_and_repeat() {
    let of = |seed| mask(field(50, 50), 0.2, seed).unwrap();
    assert_eq!(of(1), of(1));
    assert_ne!(of(1), of(2));
}
