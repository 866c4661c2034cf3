//! Both methods against an independent convex solver, their contracts, and threads.

use std::sync::Arc;

use lacuna_core::parallel::prelude::*;
use proptest::prelude::*;

use super::{Solver, cs_gradient, cs_wavelet};
use crate::baseline::testing::{self, with_threads};
use crate::sensing::cs_wavelet::testing::operator;
use crate::solver::sparsity::{Ending, Samples, Sparsity};
use crate::solver::{nesta, saddle};
use crate::{Error, Mask, Method, Outcome, Plane, Planes, Problem, Run, Size, Stop};

/// Minima found by Clarabel, written by `scripts/python/sensing_reference.py`.
const OPTIMA: &str = include_str!("../../tests/data/optima.txt");

/// The images and masks that the fixture was made from.
fn image(size: Size) -> Vec<f32> {
    (0..size.pixels()).map(|i| ((i * 7919 + 13) % 101) as f32 / 64.0 - 0.75).collect()
}

fn mask(size: Size, density: f64) -> Mask {
    let flag = |i: usize| ((i as u64 * 2_654_435_761) % (1 << 32)) as f64 / 4_294_967_296.0 < density;
    Mask::new(size, (0..size.pixels()).map(flag).collect()).unwrap()
}

/// The minimum as nearly as f32 finds it.
fn minimum<S: Sparsity>(operator: &S, size: Size, density: f64, radius: f64, solver: Solver) -> Ending {
    let (values, mask) = (image(size), mask(size, density));
    let samples = Samples { values: &values, measured: mask.as_slice(), radius };
    let mut x = vec![0.0; size.pixels()];
    let run = Run::default();
    // The objective settles long before it is minimal where the operator is badly conditioned.
    let goal = |tolerance| nesta::Goal { mu: 2e-5, tolerance, iterations: 30_000 };
    let ending = match solver {
        Solver::Nesta => nesta::solve(operator, samples, goal(3e-10), &mut x, &run),
        Solver::PrimalDual => saddle::solve(operator, samples, goal(3e-9), 1.5, &mut x, &run),
    };
    if radius == 0.0 {
        assert_eq!(ending.distance, 0.0);
        assert!(x.iter().zip(&values).zip(mask.as_slice()).all(|((x, value), flag)| !flag || x == value));
    }
    ending
}

/// The objective is the minimum to 1e-4, with either solver, wherever Clarabel says it is.
#[test]
fn objectives_are_those_of_an_independent_solver() {
    let lines: Vec<&str> = OPTIMA.lines().filter(|line| !line.starts_with('#')).collect();
    assert_eq!(lines.len(), 7);
    lines.into_par_iter().for_each(|line| {
        let (head, optimum) = line.split_once(" : ").unwrap();
        let optimum: f64 = optimum.parse().unwrap();
        let words: Vec<&str> = head.split(' ').collect();
        let number = |at: usize| words[at].parse::<f64>().unwrap();
        let solve = |solver| {
            if words[0] == "fourier" {
                let size = Size::new(number(1) as usize, number(2) as usize);
                return minimum(&cs_gradient::testing::operator(size), size, number(3), 0.0, solver);
            }
            let settings = cs_wavelet::Settings {
                wavelet: words[1].parse().unwrap(),
                boundary: if words[2] == "periodic" {
                    super::wavelet::Boundary::Periodic
                } else {
                    super::wavelet::Boundary::Symmetric
                },
                levels: number(5) as usize,
                blur: number(6),
                wiener: number(7),
                ..cs_wavelet::Settings::default()
            };
            let size = Size::new(number(3) as usize, number(4) as usize);
            minimum(&operator(size, &settings), size, number(8), 0.0, solver)
        };
        for solver in [Solver::Nesta, Solver::PrimalDual] {
            let found = solve(solver).objective;
            let relative = (found - optimum) / optimum;
            assert!(relative.abs() <= 1e-4, "{head} {solver:?}: {found} where {optimum} is the minimum");
        }
    });
}

/// With a radius, the distance from the samples is that radius, and the objective falls.
#[test]
fn a_radius_is_used_up() {
    let size = Size::new(12, 10);
    let settings = cs_wavelet::Settings { blur: 0.0, ..cs_wavelet::Settings::default() };
    let operator = operator(size, &settings);
    let with = |radius, solver| minimum(&operator, size, 0.5, radius, solver);
    let [nesta, saddle] = [Solver::Nesta, Solver::PrimalDual].map(|solver| {
        let (exact, near) = (with(0.0, solver), with(0.5, solver));
        assert!(near.objective < 0.99 * exact.objective);
        assert!((near.distance - 0.5).abs() <= 1e-4, "{solver:?} {}", near.distance);
        near.objective
    });
    assert!((nesta - saddle).abs() <= 2e-4 * nesta, "{nesta} {saddle}");
}

fn adjoint<S: Sparsity>(operator: &S, x: &[f32], y: &[f32], dot: impl Fn(&[S::Entry], &[S::Entry]) -> f64) {
    let (mut of_x, mut of_y) = (operator.work(), operator.work());
    operator.analyse(x, &mut of_x);
    operator.analyse(y, &mut of_y);
    let left = dot(operator.entries(&mut of_x), operator.entries(&mut of_y));
    let entries = &*operator.entries(&mut of_x);
    let own = dot(entries, entries);
    let mut back = vec![0.0; x.len()];
    operator.adjoint(&mut of_y, &mut back);
    let inner =
        |a: &[f32], b: &[f32]| a.iter().zip(b).map(|(a, b)| f64::from(*a) * f64::from(*b)).sum::<f64>();
    let right = inner(x, &back);
    let scale = operator.bound() * (inner(x, x) * inner(y, y)).sqrt();
    assert!((left - right).abs() <= 1e-5 * scale, "{left} {right}");
    assert!(own <= operator.bound() * inner(x, x) * (1.0 + 1e-5), "{own} {}", operator.bound());
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(64))]

    /// `<U x, U y> = <x, U^T U y>`, and no image is stretched by more than the bound.
    #[test]
    fn operators_have_adjoints_and_bounds(
        height in 1_usize..30, width in 1_usize..30, at in 0_usize..25, symmetric in any::<bool>(),
        blur in 0.0..30.0_f64, wiener in 0.0..0.1_f64, seed in 0_usize..1000,
    ) {
        let size = Size::new(height, width);
        let boundary = if symmetric { super::wavelet::Boundary::Symmetric } else { super::wavelet::Boundary::Periodic };
        let settings = cs_wavelet::Settings {
            wavelet: super::wavelet::Wavelet::all()[at], boundary, blur, wiener, ..cs_wavelet::Settings::default()
        };
        let x = image(size);
        let y: Vec<f32> = (0..size.pixels()).map(|i| ((i * 7907 + seed) % 211) as f32 / 105.0 - 1.0).collect();
        let real = |a: &[f32], b: &[f32]| a.iter().zip(b).map(|(a, b)| f64::from(*a) * f64::from(*b)).sum();
        adjoint(&operator(size, &settings), &x, &y, real);
        adjoint(&operator(size, &settings), &y, &x, real);
    }

    #[test]
    fn measured_bits_stay_and_every_pixel_is_finite(mask in testing::mask(24), restore in any::<bool>()) {
        let size = mask.size();
        let samples = Plane::new(size, image(size)).unwrap();
        let samples = Planes::new(size, vec![samples; 2]).unwrap();
        let gradient = cs_gradient::Settings { restore, ..cs_gradient::Settings::default() };
        for method in [Method::from(cs_wavelet::Settings::default()), Method::from(gradient)] {
            let mut out = Planes::zeros(size, 2);
            let plan = method.filter().plan(&Problem::fill(Arc::new(mask.clone())), &Run::default()).unwrap();
            let result = plan.reconstruct(&samples, &mut out, &Run::default());
            if result == Err(Error::NoPairs) {
                continue;
            }
            prop_assert!(result.is_ok());
            for (out, samples) in out.as_slice().iter().zip(samples.as_slice()) {
                prop_assert!(out.pixels().iter().all(|value| value.is_finite()));
                let both = out.pixels().iter().zip(samples.pixels()).zip(mask.as_slice());
                let kept = both.filter(|(_, flag)| **flag).all(|((a, b), _)| a.to_bits() == b.to_bits());
                prop_assert!(kept || !method.keeps_measured());
            }
        }
    }
}

fn methods() -> Vec<Method> {
    let wavelet =
        cs_wavelet::Settings { epsilon: 0.1, solver: Solver::PrimalDual, ..cs_wavelet::Settings::default() };
    let symmetric = cs_wavelet::Settings {
        boundary: super::wavelet::Boundary::Symmetric,
        ..cs_wavelet::Settings::default()
    };
    let anchored =
        cs_gradient::Settings { anchor: cs_gradient::Anchor::Measured, ..cs_gradient::Settings::default() };
    vec![
        Method::from(cs_wavelet::Settings::default()),
        Method::from(wavelet),
        Method::from(symmetric),
        Method::from(cs_gradient::Settings::default()),
        Method::from(anchored),
    ]
}

#[test]
fn threads_change_no_bit_and_outcomes_tell_objective_and_constraint() {
    let size = Size::new(61, 150);
    let mask = Arc::new(mask(size, 0.6));
    let smooth = |c: usize| {
        Plane::from_fn(size, |y, x| ((y as f32 / 9.0).sin() + (x as f32 / 7.0 + c as f32).cos()) * 0.5 + 1.0)
    };
    let samples = Planes::new(size, (0..4).map(smooth).collect()).unwrap();
    for method in methods() {
        let run = |threads| {
            with_threads(threads, || {
                let plan = method.filter().plan(&Problem::fill(mask.clone()), &Run::default()).unwrap();
                let mut out = Planes::zeros(size, 4);
                let outcome = plan.reconstruct(&samples, &mut out, &Run::default()).unwrap();
                (outcome, out)
            })
        };
        let one = run(1);
        assert!(one.0.objective.is_some_and(|objective| objective > 0.0), "{}", method.settings());
        assert!(one.0.constraint.is_some());
        assert_eq!(one.0.stop, Stop::Converged);
        for threads in [2, 3, 8] {
            assert!(one == run(threads), "{} {threads}", method.settings());
        }
    }
}

#[test]
fn constants_stay_and_an_interrupted_run_says_so() {
    let size = Size::new(20, 23);
    let mask = Arc::new(mask(size, 0.6));
    for method in methods() {
        let plan = method.filter().plan(&Problem::fill(mask.clone()), &Run::default()).unwrap();
        let mut out = Planes::zeros(size, 1);
        let constant = Planes::new(size, vec![Plane::filled(size, 0.7)]).unwrap();
        plan.reconstruct(&constant, &mut out, &Run::default()).unwrap();
        assert!(
            out.as_slice()[0].pixels().iter().all(|value| (value - 0.7).abs() < 1e-6),
            "{}",
            method.settings()
        );
        let samples = Planes::new(size, vec![Plane::new(size, image(size)).unwrap()]).unwrap();
        let stop = || Some(Stop::TimeLimit);
        let outcome = plan.reconstruct(&samples, &mut out, &Run { interrupt: Some(&stop) }).unwrap();
        assert_eq!((outcome.stop, outcome.iterations), (Stop::TimeLimit, 0));
        assert!(out.as_slice()[0].pixels().iter().all(|value| value.is_finite()));
    }
}

#[test]
fn settings_out_of_range_are_refused() {
    let problem = Problem::fill(Arc::new(mask(Size::new(4, 4), 0.5)));
    let wavelet = cs_wavelet::Settings::default();
    let gradient = cs_gradient::Settings::default();
    let wrong = [
        Method::from(cs_wavelet::Settings { blur: -1.0, ..wavelet }),
        Method::from(cs_wavelet::Settings { wiener: f64::NAN, ..wavelet }),
        Method::from(cs_wavelet::Settings { levels: 17, ..wavelet }),
        Method::from(cs_wavelet::Settings { wavelet: super::wavelet::Wavelet::Coiflet(9), ..wavelet }),
        Method::from(cs_wavelet::Settings { tolerance: 0.0, ..wavelet }),
        Method::from(cs_gradient::Settings { max_iterations: 0, ..gradient }),
        Method::from(cs_gradient::Settings { epsilon: -0.1, ..gradient }),
    ];
    for method in wrong {
        let refused = method.filter().plan(&problem, &Run::default()).err();
        assert!(matches!(refused, Some(Error::Setting { .. })), "{}", method.settings());
    }
    let outcome = Outcome::direct();
    assert_eq!((outcome.objective, outcome.constraint), (None, None));
}

/// A level has large coefficients that say nothing of how far it is from the minimum.
#[test]
fn a_level_that_is_large_against_the_range_is_kept() {
    let size = Size::new(64, 64);
    let mask = Arc::new(mask(size, 0.2));
    let odd = (0..size.pixels()).filter(|&pixel| mask.as_slice()[pixel]).nth(400).unwrap();
    let one = |y: usize, x: usize| if y * 64 + x == odd { 0.999 } else { 1.0 };
    let waves = |y: usize, x: usize| 1000.0 + x as f32 / 64.0 + 0.3 * (y as f32 / 6.0).sin();
    for (image, off) in [(Plane::from_fn(size, one), 1e-3), (Plane::from_fn(size, waves), 5.0)] {
        let samples = Planes::new(size, vec![image.clone()]).unwrap();
        let [nesta, saddle] = [Solver::Nesta, Solver::PrimalDual].map(|solver| {
            let settings = cs_wavelet::Settings { solver, ..cs_wavelet::Settings::default() };
            let plan = Method::from(settings).filter().plan(&Problem::fill(mask.clone()), &Run::default());
            let mut out = Planes::zeros(size, 1);
            let outcome = plan.unwrap().reconstruct(&samples, &mut out, &Run::default()).unwrap();
            if solver == Solver::Nesta {
                let all = out.as_slice()[0].pixels().iter().zip(image.pixels());
                let mean = all.map(|(a, b)| (a - b).abs()).sum::<f32>() / size.pixels() as f32;
                assert!(mean <= off, "{mean}");
            }
            outcome.objective.unwrap()
        });
        // The objective has no level in it; what is smoothed by 1e-2 of the range is as far from the norm as that makes it.
        let values = image.pixels();
        let (low, high) = values.iter().fold((f32::MAX, f32::MIN), |(a, b), x| (a.min(*x), b.max(*x)));
        let smoothing = 1e-2 * f64::from(high - low) * size.pixels() as f64 / 2.0;
        assert!(nesta <= saddle * 1.01 + smoothing, "{nesta} {saddle}");
    }
}

#[test]
fn what_is_added_to_all_samples_is_added_to_the_result() {
    let size = Size::new(40, 33);
    let mask = Arc::new(mask(size, 0.3));
    for (solver, epsilon) in [(Solver::Nesta, 0.0), (Solver::Nesta, 0.5), (Solver::PrimalDual, 0.0)] {
        let settings = cs_wavelet::Settings { epsilon, solver, ..cs_wavelet::Settings::default() };
        let plan =
            Method::from(settings).filter().plan(&Problem::fill(mask.clone()), &Run::default()).unwrap();
        let fill = |level: f32| {
            let samples = image(size).into_iter().map(|x| x + level).collect();
            let samples = Planes::new(size, vec![Plane::new(size, samples).unwrap()]).unwrap();
            let mut out = Planes::zeros(size, 1);
            plan.reconstruct(&samples, &mut out, &Run::default()).unwrap();
            out.as_slice()[0].pixels().to_vec()
        };
        let plain = fill(0.0);
        for level in [-256.0, 16.0, 1024.0] {
            let worst =
                fill(level).iter().zip(&plain).map(|(a, b)| (a - level - b).abs()).fold(0.0, f32::max);
            assert!(worst <= 5e-3, "{level} {solver:?}: {worst}");
        }
    }
}
