//! Tests of the second pass.

use proptest::prelude::*;

use super::*;
use crate::Size;
use crate::baseline::push_pull;
use crate::sampling::{Band, Order, Pattern};

const PREFERENCE: Preference = Preference::new(3, None);

fn field(height: usize, width: usize) -> Field {
    Field { x: -4, y: 9, size: Size::new(height, width) }
}

fn first_pass(field: Field, density: f64) -> Arc<Mask> {
    Arc::new(Order::new(Pattern::Shuffle, field, PREFERENCE.seed(), 0).unwrap().mask(Band::below(density)))
}

fn of(image: &Plane, mask: &Arc<Mask>) -> Estimate {
    let samples = Planes::new(image.size(), vec![image.clone()]).unwrap();
    estimate(&samples, mask, &push_pull::Settings, &Run::default()).unwrap()
}

/// A step along a slanted line in the left half, nothing in the right.
fn step(size: Size) -> Plane {
    Plane::from_fn(size, |y, x| {
        let edge = size.width as f32 / 4.0 + y as f32 / 5.0 - size.height as f32 / 10.0;
        if (x as f32) < edge { 0.2 } else { 0.9 }
    })
}

#[test]
fn takes_what_is_missing_and_only_once() {
    let field = field(31, 44);
    let mask = first_pass(field, 0.2);
    let estimate = of(&step(field.size), &mask);
    let taken = estimate.next(200, field, PREFERENCE, |_| true);
    assert_eq!(taken.len(), 200);
    assert!(taken.iter().all(|&pixel| !mask.as_slice()[pixel]));
    let mut sorted = taken.clone();
    sorted.sort_unstable();
    sorted.dedup();
    assert_eq!(sorted.len(), 200);
    // A shorter list is the beginning of a longer one, and all that are missing are all.
    assert_eq!(estimate.next(50, field, PREFERENCE, |_| true), taken[..50]);
    let missing = field.size.pixels() - mask.count();
    assert_eq!(estimate.next(usize::MAX, field, PREFERENCE, |_| true).len(), missing);
    let even = estimate.next(100, field, PREFERENCE, |pixel| pixel % 2 == 0);
    assert!(even.len() == 100 && even.iter().all(|pixel| pixel % 2 == 0));
}

#[test]
fn goes_where_the_edge_is() {
    let field = field(80, 120);
    let mask = first_pass(field, 0.1);
    let estimate = of(&step(field.size), &mask);
    let taken = estimate.next(96, field, PREFERENCE, |_| true);
    let near = taken.iter().filter(|&&pixel| {
        let (y, x) = ((pixel / 120) as f32, (pixel % 120) as f32);
        (x - (30.0 + y / 5.0 - 8.0)).abs() < 6.0
    });
    // 6 pixels to both sides are a tenth of the image.
    assert!(near.count() > 86, "most of 96 lie within 6 pixels of the edge");
}

/// Both estimates, whatever the unit: squares of tiny values are nothing in f32.
#[test]
fn units_choose_nothing() {
    let field = field(60, 90);
    let mask = first_pass(field, 0.1);
    let spline = ss::Settings::default();
    for unit in [2.0_f32.powi(-22), 2.0_f32.powi(-80), 2.0_f32.powi(-120)] {
        let in_units = |unit: f32| {
            let step = step(field.size);
            let samples = Planes::from(Plane::from_fn(field.size, |y, x| unit * step.at(y, x)));
            let by_parts = estimate(&samples, &mask, &push_pull::Settings, &Run::default()).unwrap();
            [by_parts, estimate_spline(&samples, &mask, &spline, &Run::default()).unwrap()]
        };
        for (usual, tiny) in in_units(1.0).iter().zip(in_units(unit)) {
            let [usual_next, tiny_next] =
                [usual, &tiny].map(|estimate| estimate.next(300, field, PREFERENCE, |_| true));
            assert!(usual_next == tiny_next, "{unit}");
            let (usual, tiny) = (usual.error(), tiny.error());
            let off = usual.pixels().iter().zip(tiny.pixels()).map(|(a, b)| (a - b / unit).abs());
            assert!(off.fold(0.0, f32::max) <= 1e-5, "{unit}");
        }
    }
}

#[test]
fn negative_values_count_as_positive_ones_do() {
    let field = field(80, 120);
    let mask = first_pass(field, 0.1);
    for dark in [-5.0, -f32::MAX] {
        let image = |sign: f32| {
            let step = step(field.size);
            Plane::from_fn(field.size, |y, x| if step.at(y, x) > 0.5 { sign * dark } else { 0.0 })
        };
        let [own, other] = [1.0, -1.0].map(|sign| of(&image(sign), &mask));
        let next = |estimate: &Estimate| estimate.next(96, field, PREFERENCE, |_| true);
        assert_eq!(next(&own), next(&other), "{dark}");
        assert!(own.error().pixels().iter().all(|error| error.is_finite()));
    }
}

#[test]
fn continues_the_order_where_there_is_nothing_to_gain() {
    let field = field(40, 50);
    let mask = first_pass(field, 0.15);
    let estimate = of(&Plane::filled(field.size, 0.4), &mask);
    assert!(estimate.error().pixels().iter().all(|&error| error == 0.0));
    let more = first_pass(field, 0.25);
    let added = more.count() - mask.count();
    let taken = estimate.next(added, field, PREFERENCE, |_| true);
    assert!(taken.iter().all(|&pixel| more.as_slice()[pixel] && !mask.as_slice()[pixel]));
}

#[test]
fn leaves_no_clumps_where_the_error_is_even() {
    // White noise errs alike everywhere: the new samples keep off each other and off the old ones.
    let field = field(64, 64);
    let mask = first_pass(field, 0.1);
    let mut estimate = of(&Plane::filled(field.size, 0.0), &mask);
    estimate.coefficient.fill(1.0);
    let mut all = mask.as_slice().to_vec();
    for pixel in estimate.next(205, field, PREFERENCE, |_| true) {
        let (row, column) = (pixel / 64, pixel % 64);
        for (y, x) in [
            (row + 1, column),
            (row.wrapping_sub(1), column),
            (row, column + 1),
            (row, column.wrapping_sub(1)),
        ] {
            assert!(y > 63 || x > 63 || !all[y * 64 + x], "row {row}, column {column}");
        }
        all[pixel] = true;
    }
}

#[test]
fn the_error_is_that_of_the_fill_in_scale() {
    // A plane wave, which no filter here reproduces: the estimate is right within a factor of three, both ways.
    let field = field(96, 96);
    let mask = first_pass(field, 0.15);
    let image = Plane::from_fn(field.size, |y, x| 0.5 + 0.4 * ((x as f32) * 0.5 + (y as f32) * 0.3).sin());
    let samples = Planes::new(field.size, vec![image.clone()]).unwrap();
    let filled = leave_out::fill(&samples, &mask, &push_pull::Settings, ROUGH, &Run::default()).unwrap();
    let square = |values: &mut dyn Iterator<Item = f32>| values.map(|v| f64::from(v * v)).sum::<f64>().sqrt();
    let real = square(&mut image.pixels().iter().zip(filled.as_slice()[0].pixels()).map(|(a, b)| a - b));
    let estimated = square(&mut of(&image, &mask).error().pixels().iter().copied());
    assert!(estimated > real / 3.0 && estimated < real * 3.0, "{estimated} for {real}");
}

#[test]
fn smallest_frames_and_single_samples_work() {
    for (height, width) in [(1, 1), (1, 2), (1, 9), (9, 1), (2, 2), (5, 7)] {
        let field = field(height, width);
        let mask = Arc::new(Mask::from_fn(field.size, |y, x| y + x == 0));
        let estimate = of(&Plane::from_fn(field.size, |y, x| (y * 3 + x) as f32), &mask);
        assert!(estimate.error().pixels().iter().all(|error| error.is_finite()));
        assert_eq!(
            estimate.next(usize::MAX, field, Preference::new(0, None), |_| true).len(),
            height * width - 1
        );
    }
    let nothing = Arc::new(Mask::from_fn(Size::new(3, 3), |_, _| false));
    let samples = Planes::zeros(Size::new(3, 3), 1);
    let error = estimate(&samples, &nothing, &push_pull::Settings, &Run::default()).unwrap_err();
    assert_eq!(error, Error::EmptyMask);
}

#[test]
fn threads_do_not_matter() {
    let field = field(60, 70);
    let mask = first_pass(field, 0.15);
    let run = |threads| {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
        pool.install(|| {
            let estimate = of(&step(field.size), &mask);
            (estimate.error(), estimate.next(300, field, PREFERENCE, |_| true))
        })
    };
    assert_eq!(run(1), run(3));
}

proptest! {
    #[test]
    fn distances_are_kept_up_to_date(
        flags in proptest::collection::vec(proptest::bool::weighted(0.03), 20 * 23), picks in proptest::collection::vec(0_usize..460, 1..9),
    ) {
        let size = Size::new(20, 23);
        let mut flags = flags;
        flags[7] = true;
        let before = NearestMap::new(&Mask::new(size, flags.clone()).unwrap()).unwrap().squared_distances();
        let mut taken = Picks::new(size, &[], before);
        for pick in picks {
            taken.take(pick);
            flags[pick] = true;
        }
        let after = NearestMap::new(&Mask::new(size, flags).unwrap()).unwrap().squared_distances();
        prop_assert_eq!(taken.squared().to_vec(), after);
    }
}

/// A frame's own order does not continue the first mask, which may be of another order.
#[test]
fn frames_without_error_take_what_is_far_from_measured_pixels() {
    let field = field(64, 64);
    let mask = first_pass(field, 0.2);
    let estimate = of(&Plane::filled(field.size, 0.0), &mask);
    let squared = NearestMap::new(&mask).unwrap().squared_distances();
    for number in [1, 7] {
        let taken = estimate.next(60, field, Preference::new(3, Some(number)), |_| true);
        let beside = taken.iter().filter(|pixel| squared[**pixel] <= 1).count();
        assert_eq!(beside, 0, "{number}");
    }
}
