//! Push-pull against a slow f64 twin, on constants, at every small size and for several thread counts.

use std::sync::Arc;

use proptest::prelude::*;

use super::*;

/// Push-pull as the head of the file says it, in f64, with weights that are carried instead of planned.
fn slow(size: Size, weights: &[f64], values: &[f64]) -> Vec<f64> {
    if size.pixels() == 1 {
        return values.to_vec();
    }
    let above = halved(size);
    let (mut w, mut v) = (vec![0.0; above.pixels()], vec![0.0; above.pixels()]);
    for y in 0..size.height {
        for x in 0..size.width {
            let (to, from) = (y / 2 * above.width + x / 2, y * size.width + x);
            w[to] += weights[from];
            v[to] += weights[from] * values[from];
        }
    }
    for (w, v) in w.iter_mut().zip(&mut v) {
        *v /= if *w > 0.0 { *w } else { 1.0 };
        *w = w.min(1.0);
    }
    let v = slow(above, &w, &v);
    let mut out = vec![0.0; size.pixels()];
    for y in 0..size.height {
        for x in 0..size.width {
            let (cy, cx) = (0.5 * y as f64 - 0.25, 0.5 * x as f64 - 0.25);
            let (fy, fx) = (cy - cy.floor(), cx - cx.floor());
            let at = |dy: f64, dx: f64| {
                let y = (cy.floor() + dy).clamp(0.0, above.height as f64 - 1.0) as usize;
                let x = (cx.floor() + dx).clamp(0.0, above.width as f64 - 1.0) as usize;
                v[y * above.width + x]
            };
            let upper = (1.0 - fx) * at(0.0, 0.0) + fx * at(0.0, 1.0);
            let lower = (1.0 - fx) * at(1.0, 0.0) + fx * at(1.0, 1.0);
            let i = y * size.width + x;
            out[i] = weights[i] * values[i] + (1.0 - weights[i]) * ((1.0 - fy) * upper + fy * lower);
        }
    }
    out
}

/// A mask with at least one measured pixel, and samples that are NaN where nothing was measured.
fn problem(largest: usize) -> impl Strategy<Value = (Mask, Plane)> {
    (1..=largest, 1..=largest).prop_flat_map(|(height, width)| {
        let size = Size::new(height, width);
        let flags = (0.0..1.0_f64).prop_flat_map(move |density| {
            prop::collection::vec(prop::bool::weighted(density), size.pixels())
        });
        let values = prop::collection::vec(-1000.0..1000.0_f32, size.pixels());
        (flags, values, 0..size.pixels()).prop_map(move |(mut flags, mut values, one)| {
            flags[one] = true;
            for (value, flag) in values.iter_mut().zip(&flags) {
                *value = if *flag { *value } else { f32::NAN };
            }
            (Mask::new(size, flags).unwrap(), Plane::new(size, values).unwrap())
        })
    })
}

fn run(mask: &Mask, samples: &[Plane]) -> Planes {
    let size = mask.size();
    let samples = Planes::new(size, samples.to_vec()).unwrap();
    let mut out = Planes::zeros(size, samples.len());
    let plan = Settings.plan(&Problem::fill(Arc::new(mask.clone())), &Run::default()).unwrap();
    let outcome = plan.reconstruct(&samples, &mut out, &Run::default()).unwrap();
    assert_eq!(outcome, Outcome::direct());
    out
}

proptest! {
    #[test]
    fn agrees_with_its_slow_twin((mask, samples) in problem(37)) {
        let out = fill(&mask, &samples);
        let weights: Vec<f64> = mask.as_slice().iter().map(|&flag| f64::from(u8::from(flag))).collect();
        let values: Vec<f64> = samples.pixels().iter().map(|&v| if v.is_nan() { 0.0 } else { v.into() }).collect();
        let slow = slow(mask.size(), &weights, &values);
        let scale = values.iter().fold(0.0_f64, |most, v| most.max(v.abs()));
        // Per level one rounding of a mean and three in each of two blends; 37 pixels have six levels.
        let tolerance = 6.0 * 7.0 * f64::from(f32::EPSILON) / 2.0 * scale;
        for (fast, slow) in out.pixels().iter().zip(&slow) {
            prop_assert!((f64::from(*fast) - slow).abs() <= tolerance, "{fast} {slow}");
        }
    }

    #[test]
    fn keeps_measured_bits_and_the_range((mask, samples) in problem(40)) {
        let out = run(&mask, &[samples.clone(), samples.clone()]);
        let known = || mask.as_slice().iter().zip(samples.pixels()).filter(|(flag, _)| **flag).map(|(_, v)| *v);
        let low = known().fold(f32::INFINITY, f32::min);
        let high = known().fold(f32::NEG_INFINITY, f32::max);
        for plane in out.as_slice() {
            for ((out, flag), value) in plane.pixels().iter().zip(mask.as_slice()).zip(samples.pixels()) {
                prop_assert!(!flag || out.to_bits() == value.to_bits());
                prop_assert!((low..=high).contains(out), "{out} is outside {low}..{high}");
            }
        }
    }

    #[test]
    fn is_exact_on_constants((mask, _) in problem(40), constant in prop::num::f32::NORMAL) {
        let samples = Plane::filled(mask.size(), constant);
        let out = fill(&mask, &samples);
        prop_assert!(out.pixels().iter().all(|v| v.to_bits() == constant.to_bits()));
    }
}

#[test]
fn fills_every_small_size_from_one_pixel() {
    for (height, width) in [(1, 1), (1, 2), (2, 1), (1, 17), (17, 1), (5, 8), (8, 5), (3, 3), (64, 63)] {
        let size = Size::new(height, width);
        for one in [0, size.pixels() / 2, size.pixels() - 1] {
            let mask = Mask::from_fn(size, |y, x| y * width + x == one);
            let out = fill(&mask, &Plane::from_fn(size, |y, x| (y * width + x) as f32));
            assert_eq!(out, Plane::filled(size, one as f32));
        }
    }
}

#[test]
fn extreme_values_stay_finite() {
    let size = Size::new(9, 9);
    let mask = Mask::from_fn(size, |y, x| (3 * y + x) % 5 != 0);
    let samples = Plane::from_fn(size, |y, x| if (x + y) % 2 == 0 { f32::MAX } else { f32::MIN });
    assert!(fill(&mask, &samples).pixels().iter().all(|v| v.is_finite()));
}

#[test]
fn threads_change_no_bit() {
    let size = Size::new(401, 333);
    let mask = Mask::from_fn(size, |y, x| (y * 31 + x * 17 + y * x) % 23 == 0);
    let samples = Plane::from_fn(size, |y, x| ((y * 7 + x * 13) % 101) as f32 / 7.0);
    let with = |threads| {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
        pool.install(|| fill(&mask, &samples))
    };
    let one = with(1);
    assert_eq!(one, with(2));
    assert_eq!(one, with(5));
}

#[test]
fn refuses_what_it_cannot_fill() {
    let size = Size::new(2, 3);
    let empty = Arc::new(Mask::from_fn(size, |_, _| false));
    let error = Settings.plan(&Problem::fill(empty), &Run::default()).err();
    assert_eq!(error, Some(Error::EmptyMask));

    let mask = Arc::new(Mask::from_fn(size, |_, x| x == 1));
    let plan = Settings.plan(&Problem::fill(mask), &Run::default()).unwrap();
    let bad = Plane::from_fn(size, |y, x| if (y, x) == (1, 1) { f32::INFINITY } else { 0.0 });
    let bad = Planes::new(size, vec![bad]).unwrap();
    let found = plan.reconstruct(&bad, &mut Planes::zeros(size, 1), &Run::default());
    assert_eq!(found, Err(Error::NotFinite { row: 1, column: 1 }));
    let found = plan.reconstruct(&bad, &mut Planes::zeros(size, 2), &Run::default());
    assert!(matches!(found, Err(Error::SizeMismatch { .. })));
    let other = Size::new(3, 2);
    let found = plan.reconstruct(&Planes::zeros(other, 1), &mut Planes::zeros(size, 1), &Run::default());
    assert!(matches!(found, Err(Error::SizeMismatch { .. })));
}
