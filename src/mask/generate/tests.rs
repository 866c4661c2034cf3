//! Tests of masks within bounds and of rank images.

use super::*;
use crate::testing::{float, frame as frame_of, half, part, window};

fn request(pattern: Pattern, density: f64) -> Request {
    Request {
        window: window(-3, 7, 29, 31),
        pattern,
        density,
        seed: 2,
        temporal: Temporal::Fixed,
        paired: false,
    }
}

#[test]
fn a_rank_image_holds_the_masks_of_all_densities() {
    for pattern in [Pattern::Random, Pattern::Shuffle, Pattern::BlueNoise] {
        let ranks = ranks(&request(pattern, 1.0), 0, &Bounds::default()).unwrap();
        assert!(generate(&request(pattern, 1e-4), 0, &Bounds::default()).is_err());
        for density in [0.013, 0.2, 0.5, 0.77, 1.0] {
            let mask = generate(&request(pattern, density), 0, &Bounds::default()).unwrap();
            let flags = ranks.iter().map(|&rank| f64::from(rank) < density);
            assert!(mask.as_slice().iter().copied().eq(flags), "{pattern:?} {density}");
        }
    }
    for pattern in [Pattern::Poisson, Pattern::Grid] {
        let error = ranks(&request(pattern, 1.0), 0, &Bounds::default()).unwrap_err();
        assert!(error.to_string().contains("not progressive"));
    }
}

#[test]
fn bounds_narrow_and_force() {
    let size = Size::new(31, 29);
    let bounds = Bounds {
        inside: Some(Mask::from_fn(size, |_, x| x < 10)),
        always: Some(Mask::from_fn(size, |y, x| y == 15 && x == 20)),
        border: 2,
    };
    let request = request(Pattern::Shuffle, 0.3);
    let (free, bound) =
        (generate(&request, 0, &Bounds::default()).unwrap(), generate(&request, 0, &bounds).unwrap());
    let ranks = ranks(&request, 0, &bounds).unwrap();
    for y in 0..31 {
        for x in 0..29 {
            let forced = y < 2 || x < 2 || y > 28 || x > 26 || (y, x) == (15, 20);
            let expected = forced || x < 10 && free.is_measured(y, x);
            assert_eq!(bound.is_measured(y, x), expected, "{y} {x}");
            assert_eq!(f64::from(ranks[y * 29 + x]) < 0.3, expected, "{y} {x}");
        }
    }
}

#[test]
fn regions_lie_by_absolute_coordinates() {
    let alpha = half("A", &[0.0, 0.25, 1.0, f32::NAN, -1.0, 0.001]);
    let frame = frame_of(vec![part(window(0, 8, 3, 2), vec![alpha, float("Z", &[1.0; 6])])]);
    let region = of_frame(&frame, None, window(-1, 7, 5, 4)).unwrap();
    let found: Vec<usize> = (0..20).filter(|&pixel| region.as_slice()[pixel]).collect();
    assert_eq!(found, [5 + 2, 5 + 3, 10 + 3], "above 0, inside of the data window");
    assert_eq!(of_frame(&frame, Some("Z"), window(-1, 7, 5, 4)).unwrap().count(), 6);
    assert!(of_frame(&frame, Some("no"), window(0, 0, 1, 1)).unwrap_err().contains("no channel"));
}

#[test]
fn the_order_of_a_complementary_frame_begins_with_its_own_pixels() {
    let request = Request { temporal: Temporal::Complementary, ..request(Pattern::Shuffle, 0.2) };
    // Beyond 2^53 not every number is one of f64.
    for frame in [0, 1, 3, (1 << 53) + 1] {
        let (mask, rank) = (generate(&request, frame, &Bounds::default()).unwrap(), order(&request, frame));
        for y in 0..31 {
            for x in 0..29 {
                let rank = rank(y, x);
                // Rounding may put a pixel on the border into the neighbouring frame.
                let near = (rank - 0.2).abs() < 1e-12 || rank > 1.0 - 1e-12;
                assert!(near || mask.is_measured(y, x) == (rank < 0.2), "{frame} {y} {x}");
            }
        }
    }
}
