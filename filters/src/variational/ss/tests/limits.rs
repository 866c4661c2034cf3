//! Values far from zero, and images of few rows.

use super::*;
use crate::fill::{Options, Values};
use crate::{Method, fill};

/// Waves and a disc, in steps of a float that offsets leave exact.
fn picture(size: Size) -> Plane {
    Plane::from_fn(size, |y, x| {
        let (y, x) = (y as f32, x as f32);
        let disc = if (x - 20.0).hypot(y - 15.0) < 9.0 { 0.4 } else { 0.0 };
        ((0.5 + 0.3 * (y / 7.0).sin() * (x / 9.0).cos() + disc) * 512.0).round() / 512.0
    })
}

fn top(a: &Plane, b: &Plane, off: f32) -> f64 {
    let pairs = a.pixels().iter().zip(b.pixels());
    pairs.fold(0.0, |top, (a, b)| f64::max(top, f64::from((a - off - b).abs())))
}

/// What is added to all samples is added to the image, but for the aim twice and the rounding of what leaves.
#[test]
fn an_offset_changes_no_more_than_the_rounding() {
    let size = Size::new(150, 170);
    let image = picture(size);
    let bucket = |y: usize, x: usize| (50..90).contains(&y) && (60..110).contains(&x);
    let random = |density: f32| random_mask(size, density, 7);
    let holed = Mask::from_fn(size, |y, x| !bucket(y, x) && random(0.5).is_measured(y, x));
    for (mask, order) in [
        (random(0.08), Order::Second),
        (random(0.3), Order::Second),
        (random(0.3), Order::Third),
        (holed, Order::Second),
    ] {
        let settings = Settings { order, ..Settings::default() };
        let (plain, _) = solve(&settings, &image, &mask, None);
        for off in [4.0, 16.0, -128.0, 1024.0, 16384.0_f32] {
            let moved = Plane::from_fn(size, |y, x| image.at(y, x) + off);
            let (found, outcome) = solve(&settings, &moved, &mask, None);
            assert_eq!(outcome.stop, Stop::Converged);
            let distance = top(&found, &plain, off);
            let rounding = f64::from(off.abs() * f32::EPSILON);
            assert!(distance <= 2.0 * AIM + rounding, "{order:?} {off}: {distance}, {outcome:?}");
            let kept = |at: usize| {
                !mask.as_slice()[at] || found.pixels()[at].to_bits() == moved.pixels()[at].to_bits()
            };
            assert!((0..size.pixels()).all(kept), "{off}");
        }
    }
}

#[test]
fn third_order_fills_images_of_a_few_rows() {
    for (height, width) in [(1, 4097), (2, 2049), (2049, 2), (3, 1400), (3, 2000), (4, 1100), (7, 800)] {
        let size = Size::new(height, width);
        let mask = Mask::from_fn(size, |y, x| (y + x) % 2 == 0);
        let settings = Settings { order: Order::Third, ..Settings::default() };
        let image = picture(size);
        assert!(distance_to_whole(&settings, &image, &mask) < 2.0 * AIM, "{size}");
        let method = Method::named("ss", &[("order", "3")]).unwrap();
        let options = Options { values: Values::Other, ..Options::of(method) };
        let filled = fill(&Planes::from(image), mask, &options).unwrap();
        assert_eq!(filled.outcome.stop, Stop::Converged, "{size}");
    }
}
