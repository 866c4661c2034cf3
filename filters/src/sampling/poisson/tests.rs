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
fn is_maximal_but_for_the_dropped() {
    // No hole: every pixel lies within the larger radius of a sample, but for the 1 % dropped.
    let size = Size::new(120, 130);
    let taken = throw(size, 6.3, 9);
    let (small, large) = neighbours(6.3);
    assert_eq!((small, large), (5, 8));
    for row in 0..size.height {
        for column in 0..size.width {
            let near = (0..size.pixels()).filter(|&pixel| taken[pixel]).any(|pixel| {
                (pixel / size.width).abs_diff(row).pow(2) + (pixel % size.width).abs_diff(column).pow(2)
                    < large as usize
            });
            assert!(near, "{row} {column}");
        }
    }
}

#[test]
fn few_are_dropped() {
    for density in [0.05, 0.2, 0.5] {
        let size = Size::new(300, 310);
        let wanted = density * size.pixels() as f64;
        let squared = solve(size, wanted, density, 4);
        let count = count(&throw(size, squared, 4)) as f64;
        assert!(count >= wanted && count < 1.01 * wanted, "{density}: {count} for {wanted}");
    }
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
