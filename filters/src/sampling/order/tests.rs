//! Tests of the orders and of all patterns.

use proptest::prelude::*;

use super::*;
use crate::sampling::{Temporal, mask, shuffle};

const PROGRESSIVE: [Pattern; 3] = [Pattern::Random, Pattern::Shuffle, Pattern::BlueNoise];
const ALL: [Pattern; 5] =
    [Pattern::Random, Pattern::Shuffle, Pattern::Poisson, Pattern::BlueNoise, Pattern::Grid];

fn field(x: i32, y: i32, height: usize, width: usize) -> Field {
    Field { x, y, size: Size::new(height, width) }
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(5))]
    #[test]
    fn ranks_make_nested_masks(
        x in any::<i32>(), y in any::<i32>(), height in 1_usize..30, width in 1_usize..30, seed in any::<u64>(),
        a in 0.0..=1.0_f64, b in 0.0..=1.0_f64,
    ) {
        let field = field(x, y, height, width);
        for pattern in PROGRESSIVE {
            let order = Order::new(pattern, field, seed, 0).unwrap();
            let of = |density| mask(pattern, field, density, seed, Temporal::Fixed, 0).unwrap();
            let (sparse, dense) = (of(a.min(b)), of(a.max(b)));
            for row in 0..height {
                for column in 0..width {
                    let rank = order.rank(row, column);
                    prop_assert!((0.0..1.0).contains(&rank));
                    prop_assert_eq!(sparse.is_measured(row, column), rank < a.min(b));
                    prop_assert!(!sparse.is_measured(row, column) || dense.is_measured(row, column));
                }
            }
        }
    }
}

#[test]
fn empty_and_full_densities() {
    for pattern in ALL {
        for (height, width) in [(1, 1), (1, 17), (17, 1), (33, 7), (64, 64)] {
            let of =
                |density| mask(pattern, field(-3, 4, height, width), density, 7, Temporal::Fixed, 0).unwrap();
            assert!(of(0.0).is_empty(), "{pattern:?} {height}x{width}");
            assert!(of(1.0).is_full(), "{pattern:?} {height}x{width}");
        }
        let nothing = mask(pattern, field(0, 0, 0, 0), 0.5, 0, Temporal::Fixed, 0).unwrap();
        assert_eq!(nothing.count(), 0);
    }
}

#[test]
fn densities_are_met() {
    for pattern in PROGRESSIVE.into_iter().chain([Pattern::Poisson]) {
        for density in [0.01, 0.05, 0.2, 0.5, 0.93] {
            let mask = mask(pattern, field(100, 50, 301, 299), density, 3, Temporal::Fixed, 0).unwrap();
            let error = mask.density() / density - 1.0;
            // Random and Poisson are exact; the shuffle and the tile of the blue noise are near by discrepancy.
            let exact = matches!(pattern, Pattern::Random | Pattern::Poisson);
            let bound = if exact { 0.5 / (density * 301.0 * 299.0) + 1e-12 } else { 0.02 };
            assert!(error.abs() <= bound, "{pattern:?} {density}: {error}");
        }
    }
}

#[test]
fn absolute_patterns_agree_where_windows_overlap() {
    for pattern in [Pattern::Shuffle, Pattern::BlueNoise, Pattern::Grid] {
        let of = |field| mask(pattern, field, 0.3, 2, Temporal::Fixed, 0).unwrap();
        let (large, small) = (of(field(-20, -10, 60, 70)), of(field(-3, 5, 20, 31)));
        for row in 0..20 {
            for column in 0..31 {
                assert_eq!(small.is_measured(row, column), large.is_measured(row + 15, column + 17));
            }
        }
    }
}

#[test]
fn threads_do_not_matter() {
    let masks = |threads| {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
        pool.install(|| {
            ALL.map(|pattern| mask(pattern, field(0, 0, 203, 171), 0.17, 11, Temporal::Offset, 3).unwrap())
        })
    };
    let one = masks(1);
    assert_eq!(one, masks(2));
    assert_eq!(one, masks(5));
}

#[test]
fn one_seed_is_one_mask() {
    for pattern in ALL {
        let of = |seed| mask(pattern, field(-8, 1, 37, 51), 0.21, seed, Temporal::Fixed, 0).unwrap();
        assert_eq!(of(3), of(3), "{pattern:?}");
        assert!((4..9).any(|seed| of(seed) != of(3)), "{pattern:?}: seeds make no difference");
    }
}

#[test]
fn the_shuffle_is_that_of_the_shuffle() {
    let (field, density) = (field(-9, 70, 33, 44), 0.37);
    let order = Order::new(Pattern::Shuffle, field, 6, 0).unwrap();
    assert_eq!(order.mask(Band::below(density)), shuffle::mask(-9, 70, field.size, density, 6).unwrap());
}
