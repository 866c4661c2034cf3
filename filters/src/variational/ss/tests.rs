//! Against a dense direct solve in f64, and against what is known in closed form.

use std::sync::Arc;

use proptest::prelude::*;

use super::*;
use crate::Size;
use crate::kernel::stencil::Separable;

mod hole;
mod limits;

/// The minimiser by Cholesky's factorisation of the full matrix. Returns every pixel.
fn reference(settings: &Settings, samples: &Plane, mask: &Mask, weights: Option<&Plane>) -> Vec<f64> {
    let size = mask.size();
    let matrix: Separable<f64> =
        Form::new(settings.kernel, settings.order.number(), settings.tension).energy(size, (1.0, 1.0));
    let place = |k: usize| (k / size.width, k % size.width);
    let unknown: Vec<usize> =
        (0..size.pixels()).filter(|&k| settings.lambda > 0.0 || !mask.as_slice()[k]).collect();
    let weight = |k: usize| weights.map_or(1.0, |w| f64::from(w.pixels()[k]));
    let n = unknown.len();
    let (mut a, mut b) = (vec![0.0; n * n], vec![0.0; n]);
    for (r, &k) in unknown.iter().enumerate() {
        for (c, &l) in unknown.iter().enumerate() {
            a[r * n + c] = matrix.entry(place(k), place(l));
        }
        if settings.lambda > 0.0 {
            if mask.as_slice()[k] {
                a[r * n + r] += weight(k) / settings.lambda;
                b[r] += weight(k) / settings.lambda * f64::from(samples.pixels()[k]);
            }
        } else {
            for l in (0..size.pixels()).filter(|&l| mask.as_slice()[l]) {
                b[r] -= matrix.entry(place(k), place(l)) * f64::from(samples.pixels()[l]);
            }
        }
    }
    let solution = cholesky(a, b);
    let mut result: Vec<f64> = samples.pixels().iter().map(|&x| f64::from(x)).collect();
    for (k, x) in unknown.into_iter().zip(solution) {
        result[k] = x;
    }
    result
}

fn cholesky(mut a: Vec<f64>, mut b: Vec<f64>) -> Vec<f64> {
    let n = b.len();
    for i in 0..n {
        for j in 0..=i {
            let (before, rest) = a.split_at_mut(i * n);
            let row = &mut rest[..n];
            let other = if i == j { row[..j].to_vec() } else { before[j * n..j * n + j].to_vec() };
            let sum = row[j] - row[..j].iter().zip(&other).map(|(x, y)| x * y).sum::<f64>();
            row[j] = if i == j { sum.sqrt() } else { sum / before[j * n + j] };
        }
    }
    for i in 0..n {
        let sum: f64 = (0..i).map(|k| a[i * n + k] * b[k]).sum();
        b[i] = (b[i] - sum) / a[i * n + i];
    }
    for i in (0..n).rev() {
        let sum: f64 = (i + 1..n).map(|k| a[k * n + i] * b[k]).sum();
        b[i] = (b[i] - sum) / a[i * n + i];
    }
    b
}

/// Values without structure in [0, 1].
fn noise(size: Size, seed: u32) -> Plane {
    let mut state = seed.wrapping_mul(2_654_435_761).wrapping_add(12345);
    Plane::from_fn(size, |_, _| {
        state ^= state << 13;
        state ^= state >> 17;
        state ^= state << 5;
        (state >> 8) as f32 / (1 << 24) as f32
    })
}

fn random_mask(size: Size, density: f32, seed: u32) -> Mask {
    let values = noise(size, seed ^ 0x5bd1);
    let mut flags: Vec<bool> = values.pixels().iter().map(|&x| x < density).collect();
    if !flags.contains(&true) {
        flags[seed as usize % size.pixels()] = true;
    }
    Mask::new(size, flags).unwrap()
}

fn solve(settings: &Settings, samples: &Plane, mask: &Mask, weights: Option<&Plane>) -> (Plane, Outcome) {
    let problem = Problem { mask: Arc::new(mask.clone()), weights: weights.cloned().map(Arc::new) };
    // What stands at missing pixels must not be read.
    let hidden =
        Plane::from_fn(
            samples.size(),
            |y, x| if mask.is_measured(y, x) { samples.at(y, x) } else { f32::NAN },
        );
    let group = Planes::new(samples.size(), vec![hidden]).unwrap();
    let mut out = Planes::zeros(samples.size(), 1);
    let plan = settings.plan(&problem, &Run::default()).unwrap();
    let outcome = plan.reconstruct(&group, &mut out, &Run::default()).unwrap();
    (out.into_vec().remove(0), outcome)
}

/// Solves both ways and asks for 1e-4 of the measured range.
fn compare(settings: &Settings, samples: &Plane, mask: &Mask, weights: Option<&Plane>) {
    let (image, outcome) = solve(settings, samples, mask, weights);
    assert_eq!(outcome.stop, Stop::Converged, "{settings:?} {:?} {outcome:?}", mask.size());
    let expected = reference(settings, samples, mask, weights);
    let measured: Vec<f32> =
        samples.pixels().iter().zip(mask.as_slice()).filter(|(_, m)| **m).map(|(x, _)| *x).collect();
    let range =
        measured.iter().fold(0.0, |a: f32, x| a.max(*x)) - measured.iter().fold(f32::MAX, |a, x| a.min(*x));
    let limit = 1e-4 * f64::from(range) + 1e-6;
    for (k, (&x, e)) in image.pixels().iter().zip(expected).enumerate() {
        assert!(
            (f64::from(x) - e).abs() <= limit,
            "{settings:?} {:?} pixel {k}: {x} instead of {e}",
            mask.size()
        );
        if settings.lambda == 0.0 && mask.as_slice()[k] {
            assert_eq!(x.to_bits(), samples.pixels()[k].to_bits());
        }
    }
}

fn kinds() -> Vec<Settings> {
    let mut result = Vec::new();
    for kernel in [Kernel::Bspline, Kernel::Piecewise] {
        for order in [Order::Second, Order::Third] {
            result.push(Settings { kernel, order, ..Settings::default() });
        }
    }
    result
}

#[test]
fn every_mask_class_meets_the_direct_solution() {
    let size = Size::new(29, 34);
    let samples = noise(size, 3);
    let hole = |y: usize, x: usize| (4..25).contains(&y) && (5..30).contains(&x);
    let masks = [
        Mask::from_fn(size, |y, x| (y, x) == (7, 20)),
        Mask::from_fn(size, |y, _| y == 11),
        Mask::from_fn(size, |y, x| y == x),
        Mask::from_fn(size, |y, x| y % 5 == 0 && x % 5 == 0),
        Mask::from_fn(size, |y, x| (y, x) != (13, 13)),
        Mask::from_fn(size, |y, x| !hole(y, x)),
        random_mask(size, 0.01, 1),
        random_mask(size, 0.2, 2),
        random_mask(size, 0.9, 3),
    ];
    for settings in kinds() {
        for mask in &masks {
            compare(&settings, &samples, mask, None);
        }
    }
}

#[test]
fn every_size_meets_the_direct_solution() {
    let sizes = [
        (1, 1),
        (1, 2),
        (2, 1),
        (2, 2),
        (1, 9),
        (9, 1),
        (1, 70),
        (65, 1),
        (3, 40),
        (40, 2),
        (17, 16),
        (4, 4),
    ];
    for (height, width) in sizes {
        let size = Size::new(height, width);
        for settings in kinds() {
            for (density, seed) in [(0.0, 5), (0.3, 6), (0.8, 7)] {
                compare(&settings, &noise(size, seed), &random_mask(size, density, seed), None);
            }
        }
    }
}

#[test]
fn smoothing_meets_the_direct_solution() {
    let size = Size::new(21, 26);
    let samples = noise(size, 8);
    let weights =
        Plane::from_fn(size, |y, x| if (y + x) % 7 == 0 { 0.0 } else { 0.2 + noise(size, 9).at(y, x) });
    for lambda in [1e-6, 0.01, 1.0, 1e4] {
        for settings in kinds() {
            let settings = Settings { lambda, ..settings };
            compare(&settings, &samples, &random_mask(size, 0.3, 10), None);
            compare(&settings, &samples, &random_mask(size, 0.3, 11), Some(&weights));
        }
    }
}

#[test]
fn polynomials_are_exact_up_to_the_borders() {
    let size = Size::new(40, 53);
    let plane = Plane::from_fn(size, |y, x| 0.3 + 0.01 * y as f32 - 0.02 * x as f32);
    let parabola = Plane::from_fn(size, |y, x| {
        let (y, x) = (y as f32 / 40.0, x as f32 / 53.0);
        0.3 + 0.5 * y - 0.2 * x + 0.7 * y * y - 0.4 * x * y + 0.3 * x * x
    });
    for settings in kinds() {
        let settings = Settings { tension: 0.0, ..settings };
        let truth = if settings.order == Order::Third { &parabola } else { &plane };
        for density in [0.03, 0.2] {
            let (image, outcome) = solve(&settings, truth, &random_mask(size, density, 21), None);
            assert_eq!(outcome.stop, Stop::Converged, "{settings:?} {density} {outcome:?}");
            for (x, e) in image.pixels().iter().zip(truth.pixels()) {
                assert!((x - e).abs() < 1e-4, "{settings:?} {x} {e}");
            }
        }
    }
}

#[test]
fn undetermined_images_take_the_harmonic_limit() {
    let size = Size::new(12, 15);
    let samples = noise(size, 30);
    let masks = [
        Mask::from_fn(size, |y, x| (y, x) == (3, 9)),
        Mask::from_fn(size, |y, _| y == 4),
        Mask::from_fn(size, |y, x| y == x),
        Mask::from_fn(size, |y, x| (y, x) == (0, 0) || (y, x) == (11, 14)),
    ];
    for settings in kinds() {
        let (none, tiny) = (Settings { tension: 0.0, ..settings }, Settings { tension: 1e-7, ..settings });
        for mask in &masks {
            let (image, _) = solve(&none, &samples, mask, None);
            assert!(image.pixels().iter().all(|x| x.is_finite()));
            if settings.order == Order::Second {
                let limit = reference(&tiny, &samples, mask, None);
                for (x, e) in image.pixels().iter().zip(limit) {
                    assert!((f64::from(*x) - e).abs() < 2e-2, "{none:?} {x} {e}");
                }
            }
        }
    }
}

#[test]
fn a_constant_stays_one() {
    let size = Size::new(30, 31);
    for settings in kinds() {
        let (image, outcome) = solve(&settings, &Plane::filled(size, 0.7), &random_mask(size, 0.1, 4), None);
        assert_eq!(outcome, Outcome::direct());
        assert!(image.pixels().iter().all(|x| x.to_bits() == 0.7_f32.to_bits()));
    }
}

#[test]
fn settings_out_of_range_are_refused() {
    let problem = Problem::fill(Arc::new(Mask::from_fn(Size::new(2, 2), |_, _| true)));
    for settings in [
        Settings { lambda: -1.0, ..Settings::default() },
        Settings { lambda: f64::NAN, ..Settings::default() },
        Settings { tension: f64::INFINITY, ..Settings::default() },
    ] {
        assert!(matches!(settings.plan(&problem, &Run::default()), Err(Error::Setting { .. })));
    }
    assert_eq!(
        crate::Method::named("ss", &[]).unwrap().settings(),
        "lambda=0 kernel=bspline order=2 tension=0.03"
    );
}

#[test]
fn an_interrupt_ends_the_solver() {
    let size = Size::new(40, 40);
    let (samples, mask) = (noise(size, 1), random_mask(size, 0.02, 2));
    let stop = || Some(Stop::TimeLimit);
    let run = Run { interrupt: Some(&stop) };
    let plan = Settings::default().plan(&Problem::fill(Arc::new(mask)), &run).unwrap();
    let mut out = Planes::zeros(size, 1);
    let outcome = plan.reconstruct(&Planes::new(size, vec![samples]).unwrap(), &mut out, &run).unwrap();
    assert_eq!(outcome.stop, Stop::TimeLimit);
    assert!(out.as_slice()[0].pixels().iter().all(|x| x.is_finite()));
}

/// The largest difference between the planned division of the work and multigrid on the whole image, which the tests above
/// compare with a direct solution.
fn distance_to_whole(settings: &Settings, samples: &Plane, mask: &Mask) -> f64 {
    let (image, outcome) = solve(settings, samples, mask, None);
    assert_eq!(outcome.stop, Stop::Converged, "{outcome:?}");
    let form = Form::new(settings.kernel, settings.order.number(), settings.tension);
    let region = Region::whole(Isa::best(), &form, mask, 0.0, None);
    let mut whole =
        Plane::from_fn(mask.size(), |y, x| if mask.is_measured(y, x) { samples.at(y, x) } else { 0.5 });
    assert_eq!(region.solve(samples, &mut whole, 1e-8, &Run::default()).stop, Stop::Converged);
    image.pixels().iter().zip(whole.pixels()).fold(0.0, |top, (a, b)| f64::max(top, f64::from((a - b).abs())))
}

#[test]
fn tiles_and_holes_meet_the_whole() {
    let size = Size::new(301, 270);
    let samples = noise(size, 40);
    let settings = Settings::default();
    let base = random_mask(size, 0.2, 41);
    let lost = |y: usize, x: usize| (100..164).contains(&y) && (90..154).contains(&x) || (y < 20 && x > 240);
    let masks = [
        base.clone(),
        random_mask(size, 0.6, 42),
        Mask::from_fn(size, |y, x| base.is_measured(y, x) && !lost(y, x)),
        Mask::from_fn(size, |y, x| y % 4 == 0 && x % 4 == 0),
    ];
    for (k, mask) in masks.iter().enumerate() {
        assert_eq!(matches!(holes::divide(mask), Division::Holes(..)), k == 2);
        let distance = distance_to_whole(&settings, &samples, mask);
        assert!(distance <= 1e-4, "mask {k}: {distance}");
    }
}

#[test]
fn a_lost_bucket_meets_the_whole_at_every_order() {
    let size = Size::new(150, 161);
    let samples = noise(size, 50);
    let base = random_mask(size, 0.25, 51);
    let mask = Mask::from_fn(size, |y, x| {
        base.is_measured(y, x) && !((60..92).contains(&y) && (64..96).contains(&x))
    });
    for settings in kinds() {
        let distance = distance_to_whole(&settings, &samples, &mask);
        assert!(distance <= 1e-4, "{settings:?}: {distance}");
    }
}

#[test]
fn dense_masks_meet_the_whole_at_third_order() {
    let size = Size::new(140, 131);
    let settings = Settings { order: Order::Third, ..Settings::default() };
    let shuffle = |y: usize, x: usize| (x as f64 * 0.754_877_666 + y as f64 * 0.569_840_291).fract() < 0.2;
    for mask in [Mask::from_fn(size, shuffle), random_mask(size, 0.5, 81)] {
        assert!(matches!(holes::divide(&mask), Division::Dense));
        let distance = distance_to_whole(&settings, &noise(size, 80), &mask);
        assert!(distance <= 1e-4, "{distance}");
    }
}

/// Images hardly wider than the rows at their ends that have entries of their own.
#[test]
fn narrow_images_meet_the_whole() {
    for order in [Order::Second, Order::Third] {
        let settings = Settings { order, ..Settings::default() };
        for size in [Size::new(200, 32), Size::new(260, 29), Size::new(31, 210), Size::new(150, 33)] {
            let mask = random_mask(size, 0.35, 90);
            let distance = distance_to_whole(&settings, &noise(size, 91), &mask);
            assert!(distance <= 1e-4, "{settings:?} {size}: {distance}");
        }
    }
}

/// Squares of very large and of very small numbers do not fit f32.
/// Samples hundreds of pixels apart on a line.
#[test]
fn a_line_with_few_samples_meets_the_direct_solution() {
    let size = Size::new(1, 1500);
    let samples = Plane::from_fn(size, |_, x| (x as f32 / 20.0).sin() + 0.1 * (x % 7) as f32);
    for seed in [3, 4] {
        compare(&Settings::default(), &samples, &random_mask(size, 0.004, seed), None);
    }
}

#[test]
fn ranges_of_any_size_are_solved() {
    let size = Size::new(130, 190);
    let (samples, mask) = (noise(size, 92), random_mask(size, 0.3, 93));
    let settings = Settings::default();
    let (expected, _) = solve(&settings, &samples, &mask, None);
    for scale in [1e-30_f32, 1e14, 1e30] {
        let scaled = Plane::from_fn(size, |y, x| scale * samples.at(y, x));
        let (found, outcome) = solve(&settings, &scaled, &mask, None);
        assert_eq!(outcome.stop, Stop::Converged, "{scale} {outcome:?}");
        for (found, expected) in found.pixels().iter().zip(expected.pixels()) {
            assert!((found / scale - expected).abs() <= 2e-4, "{scale}: {found} {expected}");
        }
    }
}

#[test]
fn threads_do_not_change_a_bit() {
    let size = Size::new(290, 410);
    let samples = noise(size, 60);
    for density in [0.005, 0.08, 0.3] {
        let mask = random_mask(size, density, 61);
        let with = |threads| {
            let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
            pool.install(|| solve(&Settings::default(), &samples, &mask, None).0)
        };
        let one = with(1);
        for threads in [2, 5] {
            let same =
                one.pixels().iter().zip(with(threads).pixels()).all(|(a, b)| a.to_bits() == b.to_bits());
            assert!(same, "density {density}, {threads} threads");
        }
    }
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(48))]
    #[test]
    fn any_mask_meets_the_direct_solution(
        height in 1_usize..24, width in 1_usize..24, density in 0.0_f32..1.0, seed in any::<u32>(), kind in 0_usize..4,
    ) {
        let size = Size::new(height, width);
        compare(&kinds()[kind], &noise(size, seed), &random_mask(size, density, seed), None);
    }
}

#[test]
fn pulled_splines_are_the_minimisers() {
    let size = Size::new(17, 19);
    let mask = random_mask(size, 0.2, 5);
    let start = noise(size, 3);
    let values = Plane::from_fn(size, |y, x| start.at(y, x) + 0.3 * ((3 * y + 5 * x) as f32).sin());
    let strength = |k: usize| [0.0, 1.0, 10.0, 0.0, 1e6][k % 5];
    let pulls = Plane::from_fn(size, |y, x| if mask.is_measured(y, x) { 7.0 } else { strength(y * 19 + x) });
    let Settings { kernel, order, tension, .. } = Settings::default();
    let matrix: Separable<f64> = Form::new(kernel, order.number(), tension).energy(size, (1.0, 1.0));
    let place = |k: usize| (k / size.width, k % size.width);
    let free: Vec<usize> = (0..size.pixels()).filter(|&k| !mask.as_slice()[k]).collect();
    let n = free.len();
    let (mut a, mut b) = (vec![0.0; n * n], vec![0.0; n]);
    for (r, &k) in free.iter().enumerate() {
        for (c, &l) in free.iter().enumerate() {
            a[r * n + c] = matrix.entry(place(k), place(l));
        }
        let pull = f64::from(pulls.pixels()[k]);
        a[r * n + r] += pull;
        b[r] += pull * f64::from(values.pixels()[k]);
        for l in (0..size.pixels()).filter(|&l| mask.as_slice()[l]) {
            b[r] -= matrix.entry(place(k), place(l)) * f64::from(start.pixels()[l]);
        }
    }
    let expected = cholesky(a, b);
    let mut image = Planes::new(size, vec![start.clone()]).unwrap();
    let values = Planes::new(size, vec![values]).unwrap();
    let outcome = super::Pulled::new(&mask, &pulls).solve(&values, &[2e-6], &mut image, &Run::default());
    assert_eq!(outcome.stop, Stop::Converged);
    for (k, expected) in free.into_iter().zip(expected) {
        let found = f64::from(image.as_slice()[0].pixels()[k]);
        assert!((found - expected).abs() < 1e-4, "{k}: {found} for {expected}");
    }
    let kept = mask.as_slice().iter().zip(image.as_slice()[0].pixels()).zip(start.pixels());
    assert!({ kept }.filter(|((flag, _), _)| **flag).all(|((_, a), b)| a.to_bits() == b.to_bits()));
}
