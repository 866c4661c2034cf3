//! Values far from zero, settings at the ends of their ranges, and images of few rows.

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

#[test]
fn settings_at_the_ends_of_their_ranges_mean_their_limits() {
    for size in [Size::new(40, 44), Size::new(150, 170)] {
        let (image, mask) = (picture(size), random_mask(size, 0.2, 3));
        let measured = || image.pixels().iter().zip(mask.as_slice()).filter(|(_, flag)| **flag);
        let mean = measured().map(|(value, _)| f64::from(*value)).sum::<f64>() / mask.count() as f64;
        let mean = Plane::filled(size, mean as f32);
        let near = |settings: Settings, weights: Option<&Plane>, wanted: &Plane| {
            let (found, outcome) = solve(&settings, &image, &mask, weights);
            let distance = top(&found, wanted, 0.0);
            assert_eq!(outcome.stop, Stop::Converged, "{size} {settings:?} {distance}");
            assert!(distance <= 2.0 * AIM, "{size} {settings:?}: {distance}");
        };
        for order in [Order::Second, Order::Third] {
            let own = Settings { order, ..Settings::default() };
            for lambda in [1e12, 1e30, f64::MAX] {
                near(Settings { lambda, ..own }, None, &mean);
                let heavy = f64::min(1e20 * lambda, f64::MAX);
                near(Settings { lambda: heavy, ..own }, Some(&Plane::filled(size, 1e20)), &mean);
                near(Settings { lambda, tension: 1e6, ..own }, None, &mean);
            }
            near(Settings { lambda: 1e3, tension: 1e6, ..own }, None, &mean);
            let (plain, _) = solve(&own, &image, &mask, None);
            for lambda in [1e-13, 1e-20, 1e-30, 1e-320] {
                near(Settings { lambda, ..own }, None, &plain);
            }
            let (stiff, _) = solve(&Settings { tension: 1e8, ..own }, &image, &mask, None);
            for tension in [1e10, 1e15, f64::MAX] {
                near(Settings { tension, ..own }, None, &stiff);
            }
            let large = Plane::from_fn(size, |y, x| 1e14 * image.at(y, x));
            let (found, outcome) = solve(&Settings { tension: 1e9, ..own }, &large, &mask, None);
            assert_eq!(outcome.stop, Stop::Converged);
            assert!(top(&found, &Plane::from_fn(size, |y, x| 1e14 * stiff.at(y, x)), 0.0) <= 2e14 * AIM);
        }
    }
}

/// Samples whose spline leaves the range of a float.
#[test]
fn what_is_not_finite_has_not_converged() {
    let size = Size::new(80, 90);
    let mask = random_mask(size, 0.2, 3);
    let ends = Plane::from_fn(size, |y, x| if (y + x / 3) % 2 == 0 { f32::MAX } else { f32::MIN });
    for order in [Order::Second, Order::Third] {
        let (found, outcome) = solve(&Settings { order, ..Settings::default() }, &ends, &mask, None);
        let finite = found.pixels().iter().all(|value| value.is_finite());
        assert!(finite || outcome.stop > Stop::Converged, "{order:?} {outcome:?}");
    }
}
