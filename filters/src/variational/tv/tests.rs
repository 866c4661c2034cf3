//! Total variation against its slow twin, closed forms, and what the contracts promise.

#![allow(clippy::float_cmp, reason = "where bits are promised, bits are compared")]

use std::sync::Arc;
use std::sync::atomic::{AtomicUsize, Ordering};

use proptest::prelude::*;

use super::twin::Twin;
use super::{Norm, Settings, Solver};
use crate::baseline::testing::with_threads;
use crate::{Error, Filter, Mask, Method, Outcome, Plane, Planes, Problem, Run, Size, Stop};

const NORMS: [Norm; 2] = [Norm::Isotropic, Norm::Anisotropic];

/// Values in [0, 1) that look random and depend on position and seed.
fn hash(y: usize, x: usize, seed: u64) -> f64 {
    let mut v = (y as u64) << 32 ^ x as u64 ^ seed.wrapping_mul(0x9E37_79B9_7F4A_7C15);
    for _ in 0..2 {
        v ^= v >> 31;
        v = v.wrapping_mul(0xBF58_476D_1CE4_E5B9);
    }
    ((v >> 11) as f64) / (1_u64 << 53) as f64
}

/// A smooth hill with an edge and some noise.
fn scene(size: Size, seed: u64) -> Plane {
    Plane::from_fn(size, |y, x| {
        let (v, u) = (y as f64 / 9.0, x as f64 / 7.0);
        let edge = if x * 2 > y + 5 { 0.6 } else { 0.0 };
        (0.4 * (u * v + seed as f64).sin() + edge + 0.1 * hash(y, x, seed)) as f32
    })
}

fn random_mask(size: Size, density: f64, seed: u64) -> Arc<Mask> {
    let first = (hash(1, 2, seed) * size.pixels() as f64) as usize;
    Arc::new(Mask::from_fn(size, |y, x| y * size.width + x == first || hash(y, x, seed + 77) < density))
}

fn run(settings: Settings, mask: &Arc<Mask>, planes: Vec<Plane>) -> (Planes, Outcome) {
    solve(settings, &Problem::fill(mask.clone()), planes)
}

fn solve(settings: Settings, problem: &Problem, planes: Vec<Plane>) -> (Planes, Outcome) {
    let size = problem.mask.size();
    let samples = Planes::new(size, planes).unwrap();
    let mut out = Planes::zeros(size, samples.len());
    let run = Run::default();
    let plan = settings.plan(problem, &run).unwrap();
    let outcome = plan.reconstruct(&samples, &mut out, &run).unwrap();
    (out, outcome)
}

fn one(settings: Settings, mask: &Arc<Mask>, plane: &Plane) -> (Plane, Outcome) {
    let (out, outcome) = run(settings, mask, vec![plane.clone()]);
    (out.into_vec().remove(0), outcome)
}

fn twin(settings: Settings, mask: &Mask, plane: &Plane) -> Twin {
    Twin {
        height: mask.size().height,
        width: mask.size().width,
        measured: mask.as_slice().to_vec(),
        sample: plane.pixels().iter().map(|&v| f64::from(v)).collect(),
        norm: settings.norm,
        epsilon: settings.epsilon,
        root: vec![1.0; mask.size().pixels()],
    }
}

fn as_f64(plane: &Plane) -> Vec<f64> {
    plane.pixels().iter().map(|&v| f64::from(v)).collect()
}

/// How far the objective of an f32 image may be from that of the image before rounding.
fn rounding(plane: &Plane) -> f64 {
    let largest = plane.pixels().iter().fold(0.0_f32, |m, v| m.max(v.abs()));
    4.0 * f64::from(f32::EPSILON) * f64::from(largest) * plane.pixels().len() as f64
}

/// Solves both ways and compares: feasible, gap true, objective within the gap of the proven minimum.
fn compare(settings: Settings, mask: &Arc<Mask>, plane: &Plane) {
    let (out, outcome) = one(settings, mask, plane);
    check(settings, &twin(settings, mask, plane), &out, &outcome);
}

/// The same, for a result that is there.
fn check(settings: Settings, twin: &Twin, out: &Plane, outcome: &Outcome) {
    let best = twin.solve(1e-9);
    assert!(best.gap <= 1e-9 * best.objective + 1e-13, "twin: gap {} of {}", best.gap, best.objective);
    let x = as_f64(out);
    let objective = twin.objective(&x);
    let gap = outcome.gap.unwrap();
    let slack = rounding(out);
    let distance = twin.distance(&x);
    assert!(distance <= settings.epsilon * (1.0 + 1e-6) + slack, "distance {distance}");
    assert!(twin.distance(&best.x) <= settings.epsilon * (1.0 + 1e-9));
    assert!(
        objective >= best.objective - best.gap - slack,
        "below the minimum: {objective} {}",
        best.objective
    );
    let above = objective - best.objective;
    assert!(above <= gap * objective + slack, "gap {gap} not true: {above} of {objective}, {outcome:?}");
    assert_eq!(outcome.stop == Stop::Converged, gap <= settings.gap, "{outcome:?}");
}

#[test]
fn twin_agrees_on_small_frames() {
    for (height, width) in [(1, 9), (9, 1), (2, 2), (3, 7), (6, 5), (8, 8)] {
        for norm in NORMS {
            for (seed, density) in [(1, 0.2), (2, 0.5), (3, 0.8)] {
                let size = Size::new(height, width);
                let mask = random_mask(size, density, seed);
                let plane = scene(size, seed);
                let settings = Settings { norm, gap: 1e-3, max_iterations: 20_000, ..Settings::default() };
                compare(settings, &mask, &plane);
                compare(Settings { epsilon: 0.05, ..settings }, &mask, &plane);
            }
        }
    }
}

/// Samples between 0 and 8 times as heavy as others; those of weight 0 are missing.
#[test]
fn twin_agrees_with_weights() {
    for (height, width) in [(1, 9), (3, 7), (8, 8)] {
        for (norm, seed) in [(Norm::Isotropic, 1), (Norm::Anisotropic, 2), (Norm::Isotropic, 3)] {
            let size = Size::new(height, width);
            let mask = random_mask(size, 0.6, seed);
            let first = mask.as_slice().iter().position(|&measured| measured).unwrap();
            let weight = |y: usize, x: usize| {
                let value = (9.0 * hash(y, x, seed + 5)).floor();
                if y * width + x == first { 2.0 } else { value }
            };
            let weights = Plane::from_fn(size, |y, x| weight(y, x) as f32);
            let plane = scene(size, seed);
            let settings =
                Settings { norm, gap: 1e-3, epsilon: 0.1, max_iterations: 20_000, ..Settings::default() };
            let problem = Problem { weights: Some(Arc::new(weights.clone())), ..Problem::fill(mask.clone()) };
            let (out, outcome) = solve(settings, &problem, vec![plane.clone()]);
            let counted = Mask::from_fn(size, |y, x| mask.is_measured(y, x) && weight(y, x) > 0.0);
            let root = weights.pixels().iter().map(|&w| f64::from(w).sqrt()).collect();
            let twin = Twin { root, ..twin(settings, &counted, &plane) };
            check(settings, &twin, &out.as_slice()[0], &outcome);
        }
    }
}

/// Weights that are all alike but for a factor are a radius; with `epsilon` 0 they are not looked at.
#[test]
fn equal_weights_are_a_radius() {
    let size = Size::new(40, 33);
    let mask = random_mask(size, 0.4, 3);
    let plane = scene(size, 3);
    let weighted = |settings: Settings, weight: f32| {
        let weights = Some(Arc::new(Plane::filled(size, weight)));
        solve(settings, &Problem { weights, ..Problem::fill(mask.clone()) }, vec![plane.clone()]).0
    };
    let settings = Settings { epsilon: 0.5, ..Settings::default() };
    let plain = |epsilon| run(Settings { epsilon, ..settings }, &mask, vec![plane.clone()]).0;
    assert_eq!(weighted(settings, 4.0), plain(0.25));
    assert_eq!(weighted(settings, 1.0), plain(0.5));
    assert_eq!(
        weighted(Settings::default(), f32::NAN),
        run(Settings::default(), &mask, vec![plane.clone()]).0
    );
    let nesta = Settings { solver: Solver::Nesta, ..settings };
    let problem =
        Problem { weights: Some(Arc::new(Plane::filled(size, 1.0))), ..Problem::fill(mask.clone()) };
    assert!(matches!(nesta.plan(&problem, &Run::default()), Err(Error::Setting { name: "solver", .. })));
}

/// The twin's own objective, on a problem whose minimum is known: along a line it is the sum of the samples' steps.
#[test]
fn a_line_has_the_variation_of_its_samples() {
    for transposed in [false, true] {
        let size = if transposed { Size::new(40, 1) } else { Size::new(1, 40) };
        let mask = Arc::new(Mask::from_fn(size, |y, x| (y + x) % 7 == 2));
        let plane = scene(Size::new(40, 40), 4);
        let plane = Plane::from_fn(size, |y, x| plane.at(y, x));
        let at = |k: usize| f64::from(plane.pixels()[k]);
        let known: Vec<usize> = (2..40).step_by(7).collect();
        let want: f64 = known.windows(2).map(|pair| (at(pair[1]) - at(pair[0])).abs()).sum();
        for norm in NORMS {
            let settings = Settings { norm, gap: 1e-4, max_iterations: 100_000, ..Settings::default() };
            let (out, outcome) = one(settings, &mask, &plane);
            assert_eq!(outcome.stop, Stop::Converged);
            let got: f64 = out.pixels().windows(2).map(|p| f64::from((p[1] - p[0]).abs())).sum();
            assert!((got - want).abs() <= 1e-4 * got + rounding(&out), "{got} {want}");
        }
    }
}

/// A frame that an image of the form `a y` or `a x` fits, measured on two opposite sides, has that one minimiser
/// for the anisotropic norm only up to monotone curves, but its objective is that of the ramp.
#[test]
fn opposite_sides_give_the_objective_of_a_step() {
    let size = Size::new(12, 20);
    let mask = Arc::new(Mask::from_fn(size, |_, x| x == 0 || x == 19));
    let plane = Plane::from_fn(size, |_, x| if x == 0 { -3.0 } else { 5.0 });
    for norm in NORMS {
        let settings = Settings { norm, gap: 1e-3, max_iterations: 20_000, ..Settings::default() };
        let (out, outcome) = one(settings, &mask, &plane);
        assert_eq!(outcome.stop, Stop::Converged);
        let objective = twin(settings, &mask, &plane).objective(&as_f64(&out));
        assert!((objective - 96.0).abs() <= 1e-3 * objective + rounding(&out), "{objective}");
    }
}

/// NESTA ends at an objective that is the sweeps' to within the gap that both report, and threads change no bit of it.
#[test]
fn nesta_is_as_near_to_the_minimum() {
    let size = Size::new(30, 41);
    let (mask, plane) = (random_mask(size, 0.3, 5), scene(size, 5));
    for (norm, epsilon) in [(Norm::Isotropic, 0.0), (Norm::Anisotropic, 0.0), (Norm::Isotropic, 0.3)] {
        let settings = Settings { norm, epsilon, gap: 1e-3, max_iterations: 20_000, ..Settings::default() };
        let nesta = Settings { solver: Solver::Nesta, ..settings };
        let twin = twin(settings, &mask, &plane);
        let [sweeps, smoothed] = [settings, nesta].map(|settings| {
            let (out, outcome) = one(settings, &mask, &plane);
            assert_eq!(outcome.stop, Stop::Converged, "{settings:?}");
            assert!(outcome.gap.unwrap() <= 1e-3);
            twin.objective(&as_f64(&out))
        });
        assert!(
            (sweeps - smoothed).abs() <= 1e-3 * sweeps.max(smoothed),
            "{settings:?}: {sweeps} {smoothed}"
        );
        let with = |threads| with_threads(threads, || one(nesta, &mask, &plane));
        assert!(with(1) == with(3), "{nesta:?}");
    }
}

proptest! {
    #![proptest_config(ProptestConfig { cases: 48, ..ProptestConfig::default() })]

    /// The reported gap bounds the distance from the minimum, also when the solver is stopped early.
    #[test]
    fn gap_is_true(
        height in 1_usize..8, width in 1_usize..8, seed in 0_u64..1000, density in 0.05..1.0_f64,
        anisotropic: bool, epsilon in prop_oneof![Just(0.0), 0.01..0.5_f64], max_iterations in 1_usize..400,
    ) {
        let size = Size::new(height, width);
        let mask = random_mask(size, density, seed);
        let norm = if anisotropic { Norm::Anisotropic } else { Norm::Isotropic };
        let settings = Settings { norm, epsilon, gap: 1e-3, max_iterations, ..Settings::default() };
        compare_early(settings, &mask, &scene(size, seed));
    }

    /// A thousand times the values give a thousand times the image; measured pixels keep their bits.
    #[test]
    fn scale_and_sign(seed in 0_u64..1000, height in 2_usize..20, width in 2_usize..20) {
        let size = Size::new(height, width);
        let mask = random_mask(size, 0.3, seed);
        let plane = scene(size, seed);
        // A gap that is never met: rounding decides at which sweep another one is.
        let settings = Settings { max_iterations: 100, gap: 1e-300, ..Settings::default() };
        let (small, ended) = one(settings, &mask, &plane);
        let large = Plane::from_fn(size, |y, x| plane.at(y, x) * 1000.0);
        let (large, last) = one(settings, &mask, &large);
        prop_assert_eq!(ended.iterations, last.iterations);
        // Rounding of the inputs is amplified by at most the number of sweeps.
        let tolerance = 100.0 * f64::from(f32::EPSILON) * 2.0;
        for (i, (&a, &b)) in small.pixels().iter().zip(large.pixels()).enumerate() {
            prop_assert!((f64::from(b) / 1000.0 - f64::from(a)).abs() <= tolerance, "{a} {b}");
            if mask.as_slice()[i] {
                prop_assert_eq!(a.to_bits(), plane.pixels()[i].to_bits());
            }
        }
    }
}

/// As [`compare`], but the twin may find that there is nothing to minimise.
fn compare_early(settings: Settings, mask: &Arc<Mask>, plane: &Plane) {
    let values: Vec<f64> =
        as_f64(plane).into_iter().zip(mask.as_slice()).filter(|v| *v.1).map(|v| v.0).collect();
    let mean = values.iter().sum::<f64>() / values.len() as f64;
    let distance = values.iter().map(|v| (v - mean).powi(2)).sum::<f64>().sqrt();
    if distance <= settings.epsilon {
        let (out, outcome) = one(settings, mask, plane);
        assert_eq!((outcome.stop, outcome.gap), (Stop::Converged, Some(0.0)));
        assert!(out.pixels().windows(2).all(|pair| pair[0] == pair[1]));
    } else {
        compare(settings, mask, plane);
    }
}

#[test]
fn threads_never_change_a_bit() {
    let size = Size::new(300, 37);
    let mask = random_mask(size, 0.15, 5);
    let planes: Vec<Plane> = (0..3).map(|seed| scene(size, seed)).collect();
    for norm in NORMS {
        for epsilon in [0.0, 0.3] {
            let settings = Settings { norm, epsilon, max_iterations: 100, ..Settings::default() };
            let solve = |threads| {
                let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
                pool.install(|| run(settings, &mask, planes.clone()))
            };
            let (want, outcome) = solve(1);
            for threads in [2, 5] {
                let (got, other) = solve(threads);
                assert_eq!(outcome, other);
                for (a, b) in want.as_slice().iter().zip(got.as_slice()) {
                    assert!(a.pixels().iter().zip(b.pixels()).all(|(a, b)| a.to_bits() == b.to_bits()));
                }
            }
        }
    }
}

/// A channel does not know which others it came with.
#[test]
fn channels_are_independent() {
    let size = Size::new(21, 34);
    let mask = random_mask(size, 0.2, 9);
    let planes: Vec<Plane> = (0..3).map(|seed| scene(size, seed)).collect();
    let (all, _) = run(Settings::default(), &mask, planes.clone());
    for (plane, together) in planes.iter().zip(all.as_slice()) {
        assert_eq!(&one(Settings::default(), &mask, plane).0, together);
    }
}

#[test]
fn flat_cases() {
    for (height, width) in [(1, 1), (1, 6), (6, 1), (5, 5), (130, 2)] {
        let size = Size::new(height, width);
        for norm in NORMS {
            let settings = Settings { norm, ..Settings::default() };
            // One measured pixel: its value everywhere, proven.
            let mask = Arc::new(Mask::from_fn(size, |y, x| y == height / 2 && x == width / 2));
            let (out, outcome) = one(settings, &mask, &Plane::filled(size, -7.25));
            assert!(out.pixels().iter().all(|&v| v == -7.25));
            assert_eq!((outcome.stop, outcome.gap), (Stop::Converged, Some(0.0)));
            // Full mask: a copy, to the bit.
            let mask = Arc::new(Mask::from_fn(size, |_, _| true));
            let plane = Plane::from_fn(size, |y, x| if x == y { -0.0 } else { hash(y, x, 1) as f32 });
            let (out, outcome) = one(settings, &mask, &plane);
            assert!(out.pixels().iter().zip(plane.pixels()).all(|(a, b)| a.to_bits() == b.to_bits()));
            assert_eq!(outcome.stop, Stop::Converged);
        }
    }
}

#[test]
fn extreme_values_stay_finite_and_in_range() {
    let size = Size::new(9, 9);
    let mask = random_mask(size, 0.3, 2);
    for scale in [f32::MAX, 1e30, 1e-30, 1e-40] {
        let plane = Plane::from_fn(size, |y, x| if (y + x) % 2 == 0 { scale } else { -scale });
        let (out, _) = one(Settings::default(), &mask, &plane);
        assert!(out.pixels().iter().all(|v| v.is_finite() && v.abs() <= scale));
    }
}

/// What stands at missing pixels is never read.
#[test]
fn missing_values_are_not_read() {
    let size = Size::new(13, 11);
    let mask = random_mask(size, 0.3, 3);
    let plane = scene(size, 3);
    let dirty = Plane::from_fn(size, |y, x| if mask.is_measured(y, x) { plane.at(y, x) } else { f32::NAN });
    for epsilon in [0.0, 0.2] {
        let settings = Settings { epsilon, ..Settings::default() };
        assert_eq!(one(settings, &mask, &plane), one(settings, &mask, &dirty));
    }
}

#[test]
fn stops_are_told_apart() {
    let size = Size::new(40, 40);
    let mask = random_mask(size, 0.1, 8);
    let samples = Planes::new(size, vec![scene(size, 8); 2]).unwrap();
    let strict = Settings { gap: 1e-7, max_iterations: 70, ..Settings::default() };
    let outcome = run(strict, &mask, samples.clone().into_vec()).1;
    assert_eq!((outcome.stop, outcome.iterations), (Stop::IterationLimit, 70));
    let eager = Settings { gap: 0.1, ..strict };
    assert_eq!(run(eager, &mask, samples.clone().into_vec()).1.stop, Stop::Converged);
    let plan = strict.plan(&Problem::fill(mask.clone()), &Run::default()).unwrap();
    for (stop, after) in [(Stop::TimeLimit, 0), (Stop::Cancelled, 2)] {
        let asked = AtomicUsize::new(0);
        let ask = || (asked.fetch_add(1, Ordering::Relaxed) >= after).then_some(stop);
        let run = Run { interrupt: Some(&ask) };
        let mut out = Planes::zeros(size, 2);
        let outcome = plan.reconstruct(&samples, &mut out, &run).unwrap();
        assert_eq!(outcome.stop, stop);
        assert_eq!(outcome.iterations, after * super::ROUND);
        assert!(outcome.gap.unwrap() > 1e-7 && outcome.gap.unwrap() <= 1.0);
        assert!(out.as_slice().iter().all(|plane| plane.pixels().iter().all(|v| v.is_finite())));
    }
}

#[test]
fn bad_input_is_named() {
    let size = Size::new(3, 4);
    let mask = random_mask(size, 0.5, 1);
    let problem = Problem::fill(mask.clone());
    let run = Run::default();
    let base = Settings::default();
    for (settings, name) in [
        (Settings { epsilon: -1.0, ..base }, "epsilon"),
        (Settings { epsilon: f64::NAN, ..base }, "epsilon"),
        (Settings { epsilon: f64::INFINITY, ..base }, "epsilon"),
        (Settings { gap: 0.0, ..base }, "gap"),
        (Settings { gap: f64::NAN, ..base }, "gap"),
        (Settings { max_iterations: 0, ..base }, "max_iterations"),
    ] {
        let error = settings.plan(&problem, &run).err().unwrap();
        assert!(matches!(error, Error::Setting { name: found, .. } if found == name), "{error}");
    }
    let empty = Problem::fill(Arc::new(Mask::from_fn(size, |_, _| false)));
    assert_eq!(base.plan(&empty, &run).err(), Some(Error::EmptyMask));
    let plan = base.plan(&problem, &run).unwrap();
    let mut out = Planes::zeros(size, 1);
    let other = Planes::zeros(Size::new(4, 3), 1);
    assert!(matches!(plan.reconstruct(&other, &mut out, &run), Err(Error::SizeMismatch { .. })));
    let two = Planes::zeros(size, 2);
    assert!(matches!(plan.reconstruct(&two, &mut out, &run), Err(Error::SizeMismatch { .. })));
    let at = mask.as_slice().iter().position(|&m| m).unwrap();
    let mut bad = Planes::zeros(size, 1);
    bad.as_mut_slice()[0].pixels_mut()[at] = f32::NAN;
    let found = plan.reconstruct(&bad, &mut out, &run);
    assert_eq!(found.err(), Some(Error::NotFinite { row: at / 4, column: at % 4 }));
}

#[test]
fn settings_are_one_stable_line() {
    let settings = Settings::default();
    assert_eq!(
        crate::Method::from(settings).settings(),
        "norm=isotropic epsilon=0 gap=0.01 max_iterations=2000"
    );
    assert!(Method::from(settings).keeps_measured());
    assert!(!Method::from(Settings { epsilon: 0.1, ..settings }).keeps_measured());
}

/// What f32 reaches, as the settings' documentation says.
#[test]
fn a_gap_of_1e_5_is_reached() {
    let size = Size::new(24, 24);
    let mask = random_mask(size, 0.3, 6);
    for norm in NORMS {
        let settings = Settings { norm, gap: 1e-5, max_iterations: 50_000, ..Settings::default() };
        let (_, outcome) = one(settings, &mask, &scene(size, 6));
        assert_eq!(outcome.stop, Stop::Converged, "{outcome:?}");
    }
}

/// Tightening takes divergence away at missing pixels, never leaves the ball, and copes with nothing to do.
#[test]
fn tightening_is_sound() {
    use super::tighten::step_sizes;
    use crate::kernel::Isa;
    use crate::kernel::tv::Isotropic;
    use crate::solver::primal_dual::State;
    for (height, width) in [(1, 1), (1, 9), (9, 1), (16, 3), (17, 5), (32, 4), (33, 7), (48, 6), (85, 21)] {
        let size = Size::new(height, width);
        let n = size.pixels();
        let free: Vec<u8> = (0..n).map(|i| u8::from(hash(i, 0, 4) > 0.2)).collect();
        let divergence = |vertical: &[f32], horizontal: &[f32]| -> f64 {
            let at = |plane: &[f32], i: usize| f64::from(plane[i]);
            let d = |i: usize| {
                let above = if i < width { 0.0 } else { at(vertical, i - width) };
                let left = if i.is_multiple_of(width) { 0.0 } else { at(horizontal, i - 1) };
                above - at(vertical, i) + left - at(horizontal, i)
            };
            (0..n).filter(|&i| free[i] == 1).map(|i| d(i).abs()).sum()
        };
        for amount in [0.0, 1e-30, 0.5, 3.0] {
            let value = |i: usize, seed| (amount * (2.0 * hash(i, 1, seed) - 1.0)) as f32;
            let last_row = |i: usize| i + width >= n;
            let last_column = |i: usize| i % width == width - 1;
            let mut state = State::new(size, &vec![0.5; n], |v| v);
            for i in 0..n {
                state.vertical[i] = if last_row(i) { 0.0 } else { value(i, 5) };
                state.horizontal[i] = if last_column(i) { 0.0 } else { value(i, 6) };
            }
            state.repair::<Isotropic>(Isa::best(), &free, &[0.0]);
            let before = divergence(&state.vertical, &state.horizontal);
            state.repair::<Isotropic>(Isa::best(), &free, &step_sizes(1.0));
            assert!(state.x.iter().all(|&x| x == 0.5));
            for (i, (&a, &b)) in state.vertical.iter().zip(state.horizontal.iter()).enumerate() {
                assert!(f64::from(a).hypot(f64::from(b)) <= 1.0 + 4.0 * f64::from(f32::EPSILON));
                assert!((a == 0.0 || !last_row(i)) && (b == 0.0 || !last_column(i)));
            }
            let after = divergence(&state.vertical, &state.horizontal);
            assert!(after <= before, "{height}x{width}: {after} of {before}");
            assert!(n < 20 || amount != 0.5 || after < 0.1 * before, "{height}x{width}: {after} of {before}");
        }
    }
}
