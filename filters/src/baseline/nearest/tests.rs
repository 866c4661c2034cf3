//! The nearest measured pixel against a search over all of them.

use proptest::prelude::*;

use super::*;
use crate::{Plane, baseline::testing};

/// The nearest measured pixel, found by looking at each.
fn slow(mask: &Mask) -> Vec<u32> {
    let Size { height, width } = mask.size();
    let pixels = || (0..height).flat_map(move |y| (0..width).map(move |x| (y, x)));
    let nearest = |(y, x): (usize, usize)| {
        let measured = pixels().filter(|&(v, u)| mask.is_measured(v, u));
        let place = |(v, u): (usize, usize)| (y.abs_diff(v).pow(2) + x.abs_diff(u).pow(2), v * width + u);
        measured.map(place).min().unwrap().1 as u32
    };
    pixels().map(nearest).collect()
}

proptest! {
    #[test]
    fn agrees_with_a_search(mask in testing::mask(28)) {
        let map = NearestMap::new(&mask).unwrap();
        prop_assert_eq!(map.as_slice(), slow(&mask));
    }

    #[test]
    fn a_measured_pixel_is_its_own(mask in testing::mask(50)) {
        let map = NearestMap::new(&mask).unwrap();
        for (i, &source) in map.as_slice().iter().enumerate() {
            prop_assert!(mask.as_slice()[source as usize]);
            prop_assert!(!mask.as_slice()[i] || source as usize == i);
        }
    }
}

#[test]
fn agrees_with_a_search_where_columns_and_rows_are_empty() {
    for (height, width) in [(1, 1), (1, 40), (40, 1), (33, 17), (16, 32), (31, 48)] {
        for step in [1, 3, 7, 11] {
            let mask = Mask::from_fn(Size::new(height, width), |y, x| y % step == 0 && x % step == 0);
            assert_eq!(NearestMap::new(&mask).unwrap().as_slice(), slow(&mask));
            let mask = Mask::from_fn(Size::new(height, width), |y, x| {
                (y + 1, x + 1) == (height, width) || x * y == 9
            });
            assert_eq!(NearestMap::new(&mask).unwrap().as_slice(), slow(&mask));
        }
    }
}

#[test]
fn ties_go_to_the_first_in_row_major_order() {
    // Four neighbours of the middle at one distance.
    let mask = Mask::from_fn(Size::new(3, 3), |y, x| (y + x) % 2 == 1);
    assert_eq!(NearestMap::new(&mask).unwrap().as_slice(), [1, 1, 1, 3, 1, 5, 3, 7, 5]);
}

#[test]
fn copies_the_bits_of_any_type() {
    let size = Size::new(2, 4);
    let mask = Mask::from_fn(size, |_, x| x == 0 || x == 3);
    let map = NearestMap::new(&mask).unwrap();
    let mut halfs = [0_u16; 8];
    map.copy(&[0x7e01, 9, 9, 0xfc00, 0x8000, 9, 9, 1], &mut halfs).unwrap();
    assert_eq!(halfs, [0x7e01, 0x7e01, 0xfc00, 0xfc00, 0x8000, 0x8000, 1, 1]);
    let error = map.copy(&[1_u32; 7], &mut [0; 8]);
    assert_eq!(error, Err(Error::SizeMismatch { expected: size, found: "7 values".into() }));
    assert!(map.copy(&[1_u32; 8], &mut [0; 9]).is_err());
}

#[test]
fn the_filter_copies_every_plane() {
    let size = Size::new(5, 7);
    let mask = Mask::from_fn(size, |y, x| (3 * y + x) % 4 == 0);
    let plane = |k: usize| Plane::from_fn(size, |y, x| (y * 7 + x + 100 * k) as f32);
    let samples = Planes::new(size, vec![plane(0), plane(1)]).unwrap();
    let mut out = Planes::zeros(size, 2);
    let plan = Settings.plan(&Problem::fill(Arc::new(mask.clone())), &Run::default()).unwrap();
    plan.reconstruct(&samples, &mut out, &Run::default()).unwrap();
    for (k, out) in out.as_slice().iter().enumerate() {
        let expected: Vec<f32> = slow(&mask).iter().map(|&i| (i as usize + 100 * k) as f32).collect();
        assert_eq!(out.pixels(), expected);
    }
    let empty = Arc::new(Mask::from_fn(size, |_, _| false));
    assert_eq!(Settings.plan(&Problem::fill(empty), &Run::default()).err(), Some(Error::EmptyMask));
}

#[test]
fn threads_change_no_bit() {
    let mask = Mask::from_fn(Size::new(301, 203), |y, x| (y * 31 + x * 17 + y * x) % 57 == 0);
    let with = |threads| testing::with_threads(threads, || NearestMap::new(&mask).unwrap());
    let one = with(1);
    assert_eq!(one, with(2));
    assert_eq!(one, with(5));
}
