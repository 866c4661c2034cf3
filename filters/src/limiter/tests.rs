//! The limiter against a search of every disc, and what it promises.

use proptest::prelude::*;

use super::*;
use crate::baseline::testing;

/// The rule of the head of the file, in f64, by looking at every pixel of every disc. `None` for measured pixels.
fn slow(mask: &Mask, samples: &Plane) -> Vec<Option<(f64, f64)>> {
    let Size { height, width } = mask.size();
    let radius = (2.0 / mask.density().sqrt()).ceil().clamp(8.0, 64.0);
    // The range of the measured pixels at most so far from a pixel, if there are any.
    let range = |y: usize, x: usize, radius: f64| {
        let pixels = (0..height).flat_map(|v| (0..width).map(move |u| (v, u)));
        let near = |v: usize, u: usize| (v as f64 - y as f64).hypot(u as f64 - x as f64) <= radius;
        let measured = pixels.filter(|&(v, u)| mask.is_measured(v, u) && near(v, u));
        let values = measured.map(|(v, u)| f64::from(samples.at(v, u)));
        values.fold(None, |range, v| Some(range.map_or((v, v), |(a, b): (f64, f64)| (a.min(v), b.max(v)))))
    };
    let whole = range(0, 0, f64::INFINITY).unwrap();
    let signed = whole.0 < -whole.1 / 64.0;
    let bounds = |y: usize, x: usize| {
        let (a, b) = range(y, x, radius).unwrap_or(whole);
        if signed {
            let margin = (b - a) / 2.0 + (whole.1 - whole.0) / 16.0;
            return (a - margin, b + margin);
        }
        let a = range(y, x, 8.0).map_or(a, |near| near.0);
        (if a < 0.0 { 2.0 * a } else { a / 2.0 }, if b < 0.0 { b / 2.0 } else { 2.0 * b })
    };
    let pixels = (0..height).flat_map(|y| (0..width).map(move |x| (y, x)));
    pixels.map(|(y, x)| (!mask.is_measured(y, x)).then(|| bounds(y, x))).collect()
}

/// Around all of the plane, the disc decides nothing.
#[test]
fn the_whole_plane_allows_what_its_range_does() {
    let size = Size::new(30, 40);
    let mask = Mask::from_fn(size, |y, x| (3 * y + x) % 5 == 0);
    for (offset, low, high) in [(0.25, 0.125, 1.5), (-0.25, -0.25 - 0.28125, 0.25 + 0.28125)] {
        let samples = Plane::from_fn(size, |y, _| offset + if y == 12 { 0.5 } else { 0.0 });
        let free = |y: usize, x: usize| [-3.0, low, 0.2, high, 7.0, f32::NAN][(y + x) % 6];
        let mut out =
            Plane::from_fn(size, |y, x| if mask.is_measured(y, x) { samples.at(y, x) } else { free(y, x) });
        let moved = whole(&mask, &samples, &mut out).unwrap();
        let mut expected = 0;
        for (y, x) in (0..30).flat_map(|y| (0..40).map(move |x| (y, x))) {
            let free = free(y, x);
            let right = match free {
                _ if mask.is_measured(y, x) => samples.at(y, x),
                free if free.is_nan() => low,
                free => free.clamp(low, high),
            };
            assert_eq!(out.at(y, x), right, "{offset} {y} {x}");
            expected += usize::from(!mask.is_measured(y, x) && !(low..=high).contains(&free));
        }
        assert_eq!(moved.values, expected);
    }
}

/// Samples, and a reconstruction that leaves their range in places.
fn frames(mask: &Mask, seed: u32, offset: f32) -> (Plane, Plane) {
    let noise = |y: usize, x: usize, k: u32| {
        let mixed = ((y * 7349 + x * 9151) as u32 ^ seed.rotate_left(k)).wrapping_mul(2_654_435_761);
        (mixed >> 8) as f32 / (1 << 24) as f32
    };
    let samples =
        Plane::from_fn(
            mask.size(),
            |y, x| {
                if mask.is_measured(y, x) { noise(y, x, 3) + offset } else { f32::NAN }
            },
        );
    (samples, Plane::from_fn(mask.size(), |y, x| 6.0 * noise(y, x, 17) - 3.0 + offset))
}

proptest! {
    #[test]
    fn agrees_with_a_search(mask in testing::mask(40), seed in any::<u32>(), offset in -1.5..1.5_f32) {
        let (samples, before) = frames(&mask, seed, offset);
        let mut out = before.clone();
        let count = local(&mask, &samples, &mut out).unwrap();
        let mut moved = Moved::default();
        for (((bounds, out), before), flag) in
            slow(&mask, &samples).iter().zip(out.pixels()).zip(before.pixels()).zip(mask.as_slice())
        {
            prop_assert_eq!(bounds.is_none(), *flag);
            let (low, high) = bounds.unwrap_or((f64::NEG_INFINITY, f64::INFINITY));
            let expected = f64::from(*before).clamp(low, high);
            // Four roundings, of numbers below 8.
            prop_assert!((f64::from(*out) - expected).abs() <= 16.0 * f64::from(f32::EPSILON));
            if out.to_bits() != before.to_bits() {
                moved.values += 1;
                moved.most = moved.most.max((out - before).abs());
            }
        }
        prop_assert_eq!(count, moved);
    }

    #[test]
    fn what_is_in_range_keeps_its_bits(
        mask in testing::mask(40), seed in any::<u32>(), offset in -1.5..1.5_f32, part in 0.01..0.99_f64,
    ) {
        let (samples, _) = frames(&mask, seed, offset);
        let inside = |bounds: &Option<(f64, f64)>| bounds.map_or(f32::NAN, |(a, b)| (a + part * (b - a)) as f32);
        let before: Vec<f32> = slow(&mask, &samples).iter().map(inside).collect();
        let mut out = Plane::new(mask.size(), before.clone()).unwrap();
        prop_assert_eq!(local(&mask, &samples, &mut out).unwrap(), Moved::default());
        prop_assert!(out.pixels().iter().zip(&before).all(|(a, b)| a.to_bits() == b.to_bits()));
    }
}

#[test]
fn a_smooth_frame_keeps_its_bits() {
    let size = Size::new(90, 120);
    let colour = Plane::from_fn(size, |y, x| 0.4 + 0.3 * (x as f32 / 15.0).sin() * (y as f32 / 11.0).cos());
    // A position crosses zero; its neighbours of one sign say nothing against the other.
    let position = Plane::from_fn(size, |y, x| 0.25 * x as f32 - 0.5 * y as f32);
    for (plane, density) in [(&colour, 0.2), (&colour, 0.03), (&position, 0.2), (&position, 0.03)] {
        let mask = crate::sampling::shuffle::mask(0, 0, size, density, 1).unwrap();
        let mut out = plane.clone();
        assert_eq!(local(&mask, plane, &mut out).unwrap(), Moved::default());
        assert_eq!(&out, plane);
    }
}

#[test]
fn a_highlight_does_not_ring() {
    let size = Size::new(64, 64);
    let mask = Mask::from_fn(size, |y, x| (3 * y + x) % 5 == 0);
    let bright = |y: usize, x: usize| (28..36).contains(&y) && (28..36).contains(&x);
    let samples = Plane::from_fn(size, |y, x| if bright(y, x) { 1000.0 } else { 0.1 });
    let bad = [-300.0, 0.01, f32::NAN, f32::INFINITY, f32::NEG_INFINITY, 0.3, 1e30];
    let mut out = Plane::from_fn(size, |y, x| bad[(y * 64 + x) % 7]);
    let before = out.clone();
    assert!(local(&mask, &samples, &mut out).unwrap().values > 64 * 64 / 2);
    for y in 0..64 {
        for x in 0..64 {
            let value = out.at(y, x);
            if mask.is_measured(y, x) {
                assert_eq!(value.to_bits(), before.at(y, x).to_bits());
            } else {
                assert!((0.05..=2000.0).contains(&value), "{value} at {y}, {x}");
                let far = y < 19 || x < 19 || y > 44 || x > 44;
                assert!(!far || value <= 0.2, "{value} at {y}, {x}");
            }
        }
    }
}

#[test]
fn a_hole_takes_the_bounds_of_the_plane() {
    let size = Size::new(60, 60);
    let mask = Mask::from_fn(size, |y, x| !((10..50).contains(&y) && (10..50).contains(&x)));
    let samples = Plane::from_fn(size, |y, _| if y < 30 { 1.0 } else { 4.0 });
    let mut out = Plane::filled(size, -1.0);
    local(&mask, &samples, &mut out).unwrap();
    assert_eq!(out.at(30, 30).to_bits(), 0.5_f32.to_bits());
    // Within eight pixels of the lower rim: half of four.
    assert_eq!(out.at(48, 30).to_bits(), 2.0_f32.to_bits());
    out.pixels_mut().fill(100.0);
    local(&mask, &samples, &mut out).unwrap();
    assert_eq!(out.at(30, 30).to_bits(), 8.0_f32.to_bits());
    assert_eq!(out.at(11, 30).to_bits(), 2.0_f32.to_bits());
}

#[test]
fn the_range_holds_what_was_measured() {
    let size = Size::new(1, 4);
    let mask = Mask::from_fn(size, |_, x| x == 0);
    let run = |measured: f32, bounds: crate::Bounds| {
        let samples = Plane::from_fn(size, |_, x| if x == 0 { measured } else { f32::NAN });
        let mut out = Plane::new(size, vec![-7.0, -0.5, 0.5, 1.5]).unwrap();
        let Moved { values, most } = range(&mask, &samples, &mut out, bounds).unwrap();
        (out.into_pixels(), values, most)
    };
    let (light, alpha) = (crate::Bounds::Positive, crate::Bounds::Unit);
    assert_eq!(run(0.0, light), (vec![-7.0, 0.0, 0.5, 1.5], 1, 0.5));
    assert_eq!(run(-0.1, light), (vec![-7.0, -0.5, 0.5, 1.5], 0, 0.0));
    assert_eq!(run(1.0, alpha), (vec![-7.0, 0.0, 0.5, 1.0], 2, 0.5));
    // An excess of rounding moves a bound by as much, and frees none.
    assert_eq!(run(1.000_000_1, alpha), (vec![-7.0, 0.0, 0.5, 1.000_000_1], 2, 0.5));
    assert_eq!(run(-1e-7, alpha), (vec![-7.0, -1e-7, 0.5, 1.0], 2, 0.5));
}

#[test]
fn extremes_and_small_sizes() {
    for (height, width) in [(1, 1), (1, 50), (50, 1), (2, 3), (17, 33), (16, 16)] {
        let size = Size::new(height, width);
        let mask = Mask::from_fn(size, |y, x| y * width + x == size.pixels() / 2);
        for value in [0.0, 3.0, -3.0, f32::MAX, f32::MIN, f32::MIN_POSITIVE] {
            let mut out = Plane::filled(size, f32::NAN);
            let count = local(&mask, &Plane::filled(size, value), &mut out).unwrap();
            assert_eq!(count, Moved { values: size.pixels() - 1, most: 0.0 });
            let missing = out.pixels().iter().zip(mask.as_slice()).filter(|(_, flag)| !**flag);
            assert!(missing.clone().all(|(v, _)| v.is_finite()));
            assert!(value < 0.0 || missing.clone().all(|(v, _)| v.to_bits() == (value / 2.0).to_bits()));
        }
    }
    let size = Size::new(3, 3);
    let mask = Mask::from_fn(size, |y, x| x != y);
    let samples = Plane::from_fn(size, |y, x| if x > y { f32::MAX } else { f32::MIN });
    let mut out = Plane::filled(size, f32::INFINITY);
    assert_eq!(local(&mask, &samples, &mut out).unwrap().values, 3);
    assert!((0..3).all(|i| out.at(i, i).is_finite()));
}

#[test]
fn refuses_what_does_not_fit() {
    let size = Size::new(2, 2);
    let (plane, other) = (Plane::filled(size, 0.0), Plane::filled(Size::new(1, 4), 0.0));
    let mask = Mask::from_fn(size, |_, x| x == 0);
    assert!(matches!(local(&mask, &other, &mut plane.clone()), Err(Error::SizeMismatch { .. })));
    assert!(matches!(
        range(&mask, &plane, &mut other.clone(), crate::Bounds::Positive),
        Err(Error::SizeMismatch { .. })
    ));
    let empty = Mask::from_fn(size, |_, _| false);
    assert_eq!(local(&empty, &plane, &mut plane.clone()), Err(Error::EmptyMask));
}

#[test]
fn threads_change_no_bit() {
    let mask = crate::sampling::shuffle::mask(0, 0, Size::new(203, 301), 0.2, 4).unwrap();
    let (samples, before) = frames(&mask, 5, 0.0);
    let with = |threads| {
        testing::with_threads(threads, || {
            let mut out = before.clone();
            (local(&mask, &samples, &mut out).unwrap(), out)
        })
    };
    let one = with(1);
    assert!(one.0.values > 0 && one.0.most > 0.0);
    assert_eq!(one, with(2));
    assert_eq!(one, with(5));
}

#[test]
fn one_pixel_out_of_bounds_is_found_anywhere() {
    let size = Size::new(37, 61);
    let mask = crate::sampling::shuffle::mask(0, 0, size, 0.3, 2).unwrap();
    let smooth = Plane::from_fn(size, |y, x| 1.0 + 0.01 * (y + x) as f32);
    let bounds = slow(&mask, &smooth);
    for at in (0..size.pixels()).filter(|&at| !mask.as_slice()[at]).step_by(13) {
        for (bad, lowest) in
            [(f32::NAN, true), (f32::INFINITY, false), (f32::NEG_INFINITY, true), (9.0, false), (0.4, true)]
        {
            let mut out = smooth.clone();
            out.pixels_mut()[at] = bad;
            assert_eq!(local(&mask, &smooth, &mut out).unwrap().values, 1);
            let (bottom, top) = bounds[at].unwrap();
            let expected = if lowest { bottom } else { top } as f32;
            assert!((out.pixels()[at] - expected).abs() <= 4.0 * f32::EPSILON);
        }
    }
}
