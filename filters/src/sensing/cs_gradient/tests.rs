//! Recovery of what is exactly sparse, and the ways in.

use super::*;
use crate::Mask;

fn random(size: Size, density: f64) -> Mask {
    let flag = |i: usize| {
        let mixed = (i as u64 ^ 0x9e37).wrapping_mul(0x9e37_79b9_7f4a_7c15);
        ((mixed ^ (mixed >> 29)).wrapping_mul(0xbf58_476d_1ce4_e5b9) >> 40) as f64 / f64::from(1 << 24)
            < density
    };
    Mask::new(size, (0..size.pixels()).map(flag).collect()).unwrap()
}

fn relative_error(found: &[f32], expected: &[f32]) -> f64 {
    let square = |pair: (&f32, &f32)| f64::from(pair.0 - pair.1).powi(2);
    let error: f64 = found.iter().zip(expected).map(square).sum();
    let norm: f64 = expected.iter().map(|value| f64::from(*value).powi(2)).sum();
    (error / norm).sqrt()
}

fn solve(size: Size, values: &[f32], mask: &Mask) -> Vec<f32> {
    let operator = super::testing::operator(size);
    let samples = Samples { values, measured: mask.as_slice(), radius: 0.0 };
    let rule = Rule { solver: Solver::Nesta, tolerance: 1e-7, iterations: 20_000 };
    let mut x = vec![0.0; values.len()];
    rule.solve(&operator, samples, 1.0, &mut x, &Run::default());
    x
}

/// Phase transition: a few waves are recovered from enough random samples, and not from too few.
#[test]
fn an_exactly_sparse_spectrum_is_recovered() {
    let size = Size::new(32, 32);
    let waves = [(3, 5, 1.0), (0, 7, 0.7), (11, 2, 0.5), (29, 13, 0.4), (8, 8, 0.3), (1, 0, 0.9)];
    let value = |y: usize, x: usize| -> f32 {
        let wave = |&(k, l, a): &(usize, usize, f64)| {
            a * (std::f64::consts::TAU * ((k * y + l * x) % 32) as f64 / 32.0 + a).cos()
        };
        waves.iter().map(wave).sum::<f64>() as f32
    };
    let values: Vec<f32> = (0..size.pixels()).map(|i| value(i / 32, i % 32)).collect();
    for density in [0.25, 0.5] {
        let error = relative_error(&solve(size, &values, &random(size, density)), &values);
        assert!(error <= 1e-4, "{density}: {error}");
    }
    let error = relative_error(&solve(size, &values, &random(size, 0.01)), &values);
    assert!(error > 0.1, "{error}");
}

fn planes(size: Size, value: impl Fn(f64, f64) -> f64) -> Planes {
    let plane = Plane::from_fn(size, |y, x| value(y as f64, x as f64) as f32);
    Planes::new(size, vec![plane]).unwrap()
}

/// A periodic image of few waves comes back from its derivatives at random pixels and from random pairs.
#[test]
fn images_come_back_from_gradients_and_from_pairs() {
    let size = Size::new(48, 40);
    let (a, b) = (std::f64::consts::TAU / 48.0, std::f64::consts::TAU / 40.0);
    let image = planes(size, |y, x| (a * y).sin() + 0.5 * (2.0 * b * x).cos());
    let dy = planes(size, |y, _| a * (a * y).cos());
    let dx = planes(size, |_, x| -b * (2.0 * b * x).sin());
    let mask = Arc::new(random(size, 0.4));
    let settings = Settings { tolerance: 1e-4, restore: true, ..Settings::default() };
    for anchor in [Anchor::Border, Anchor::Measured] {
        let plan =
            Settings { anchor, ..settings }.plan(&Problem::fill(mask.clone()), &Run::default()).unwrap();
        let gradients = Gradients { planes: [&dx, &dy], mask: &mask };
        let mut out = Planes::zeros(size, 1);
        let outcome = plan.reconstruct_gradients(&image, &gradients, &mut out, &Run::default()).unwrap();
        assert!(outcome.objective.is_some());
        // The trapezoid rule on the shortest wave: h^2 / 12 times its second derivative.
        let error = relative_error(out.as_slice()[0].pixels(), image.as_slice()[0].pixels());
        assert!(error < 2e-2, "{anchor:?}: {error}");
    }
    // Every second pixel with its two neighbours, at random.
    let pairs = random(size, 0.3);
    let near = |y: usize, x: usize| {
        pairs.is_measured(y, x)
            || y > 0 && pairs.is_measured(y - 1, x)
            || x > 0 && pairs.is_measured(y, x - 1)
    };
    let mask = Arc::new(Mask::from_fn(size, near));
    let plan = settings.plan(&Problem::fill(mask), &Run::default()).unwrap();
    let mut out = Planes::zeros(size, 1);
    plan.reconstruct(&image, &mut out, &Run::default()).unwrap();
    let error = relative_error(out.as_slice()[0].pixels(), image.as_slice()[0].pixels());
    assert!(error < 5e-3, "{error}");
}

#[test]
fn a_mask_without_pairs_is_refused_with_the_way_out() {
    let size = Size::new(8, 8);
    let image = planes(size, |y, x| y + x);
    let plan =
        |mask: Mask| Settings::default().plan(&Problem::fill(Arc::new(mask)), &Run::default()).unwrap();
    let mut out = Planes::zeros(size, 1);
    let mut run =
        |mask| plan(mask).reconstruct(&image, &mut out, &Run::default()).map(|outcome| outcome.stop);
    assert_eq!(run(Mask::from_fn(size, |y, x| (y + x) % 2 == 0)), Err(Error::NoPairs));
    assert_eq!(run(Mask::from_fn(size, |y, _| y % 2 == 0)), Err(Error::NoPairs));
    assert_eq!(run(Mask::from_fn(size, |_, _| true)), Ok(crate::Stop::Converged));
}
