use lacuna_core::hash;

use super::*;
use crate::{Options, Size, fill};

fn hashed(seed: u64, at: usize) -> f32 {
    (hash(seed, at as u64) >> 40) as f32 / (1 << 24) as f32 - 0.5
}

fn mask(size: Size, density: f32) -> Arc<Mask> {
    Arc::new(Mask::from_fn(size, |row, column| hashed(7, row * size.width + column) + 0.5 < density))
}

fn truth(size: Size) -> Plane {
    Plane::from_fn(size, |row, column| 0.5 + 0.3 * (row as f32 / 9.0).sin() * (column as f32 / 11.0).cos())
}

/// Two halves, and their mean, with noise of this size.
fn halves(truth: &Plane, size: f32) -> [Plane; 3] {
    let width = truth.size().width;
    let half = |seed: u64| {
        Plane::from_fn(truth.size(), |row, column| {
            let sum: f32 = (0..4).map(|k| hashed(seed + k, row * width + column)).sum();
            truth.at(row, column) + size * 1.732 * 1.414 * sum
        })
    };
    let (a, b) = (half(100), half(200));
    let mean = Plane::from_fn(truth.size(), |row, column| 0.5 * (a.at(row, column) + b.at(row, column)));
    [a, b, mean]
}

fn like(a: &Plane, b: &Plane) -> Plane {
    Plane::from_fn(a.size(), |row, column| 0.5 * (a.at(row, column) - b.at(row, column)))
}

fn filled(mean: &Plane, mask: &Arc<Mask>, noise: Noise) -> crate::Filled {
    let options = Options { noise, ..Options::of(crate::variational::ss::Settings::default()) };
    fill(&Planes::new(mean.size(), vec![mean.clone()]).unwrap(), Arc::clone(mask), &options).unwrap()
}

fn error(image: &Planes, truth: &Plane) -> f64 {
    let squares = image.as_slice()[0].pixels().iter().zip(truth.pixels());
    (squares.map(|(a, b)| f64::from(a - b).powi(2)).sum::<f64>() / truth.pixels().len() as f64).sqrt()
}

#[test]
fn noise_is_smoothed_by_halves_and_by_held_out_samples() {
    let size = Size::new(120, 130);
    let (truth, mask) = (truth(size), mask(size, 0.25));
    let [a, b, mean] = halves(&truth, 0.1);
    let plain = error(&filled(&mean, &mask, Noise::None).planes, &truth);
    for noise in [Noise::Like(vec![like(&a, &b)]), Noise::Unknown] {
        let found = filled(&mean, &mask, noise.clone());
        assert!(found.sets[0].smoothed, "{noise:?}");
        let smoothed = error(&found.planes, &truth);
        // About 30 samples lie within a period's quarter: their mean has a fifth of the noise.
        assert!(smoothed < 0.35 * plain, "{smoothed} {plain}");
    }
}

#[test]
fn what_has_no_noise_keeps_its_bits() {
    let size = Size::new(80, 90);
    let (truth, mask) = (truth(size), mask(size, 0.25));
    let found = filled(&truth, &mask, Noise::Unknown);
    assert!(!found.sets[0].smoothed);
    let plain = filled(&truth, &mask, Noise::None);
    let bits =
        |planes: &Planes| planes.as_slice()[0].pixels().iter().map(|x| x.to_bits()).collect::<Vec<_>>();
    assert_eq!(bits(&found.planes), bits(&plain.planes));
    // Half buffers that agree say the same: next to nothing is smoothed.
    let found = filled(&truth, &mask, Noise::Like(vec![Plane::filled(size, 0.0)]));
    assert!(error(&found.planes, &truth) <= 1.05 * error(&plain.planes, &truth));
}

/// Samples in one corner: beyond, values stay within reach of them, as without noise.
#[test]
fn far_from_all_samples_values_stay_in_reach() {
    let size = Size::new(100, 110);
    let corner =
        Mask::from_fn(size, |row, column| row < 20 && column < 20 && hashed(7, row * 110 + column) < -0.1);
    let mask = Arc::new(corner);
    let [a, b, mean] = halves(&truth(size), 0.1);
    for noise in [Noise::Like(vec![like(&a, &b)]), Noise::Unknown] {
        let found = filled(&mean, &mask, noise.clone());
        assert!(found.sets[0].smoothed, "{noise:?}");
        let values = || found.planes.as_slice()[0].pixels().iter().zip(mask.as_slice());
        let top =
            values().filter(|(_, measured)| **measured).fold(0.0_f32, |top, (value, _)| top.max(*value));
        assert!(values().all(|(value, _)| (0.0..=2.0 * top).contains(value)), "{noise:?}");
    }
}

/// Noise far above the light, as variances may tell, is no reason to darken: the mean stays.
#[test]
fn variances_above_all_light_leave_the_mean() {
    let size = Size::new(100, 110);
    let (truth, mask) = (truth(size), mask(size, 0.25));
    let noise = Noise::Like(vec![Noise::of_variance(&Plane::filled(size, 1e4), 3)]);
    let found = filled(&truth, &mask, noise);
    let mean = |planes: &Plane| planes.pixels().iter().map(|v| f64::from(*v)).sum::<f64>() / 11000.0;
    let (found, truth) = (mean(&found.planes.as_slice()[0]), mean(&truth));
    assert!((found / truth - 1.0).abs() < 0.05, "{found} {truth}");
}

/// What counts no sample was not measured: whatever stands there changes no bit, with guides or without.
#[test]
fn samples_that_count_nothing_are_missing() {
    let size = Size::new(90, 100);
    let (truth, whole) = (truth(size), mask(size, 0.4));
    let [.., mean] = halves(&truth, 0.1);
    let counts = |row: usize, column: usize| hashed(9, row * 100 + column) < 0.1;
    let garbage =
        Plane::from_fn(size, |row, column| if counts(row, column) { mean.at(row, column) } else { 7.0 });
    let weights = Plane::from_fn(size, |row, column| if counts(row, column) { 16.0 } else { 0.0 });
    let kept =
        Arc::new(Mask::from_fn(size, |row, column| whole.is_measured(row, column) && counts(row, column)));
    let mut guides = Guides::new(size);
    guides.add("guide", vec![truth.clone()]).unwrap();
    for guides in [None, Some(&guides)] {
        let options = |weights: Option<Plane>| Options {
            noise: Noise::Unknown,
            weights: weights.map(Arc::new),
            guides,
            ..Options::of(crate::variational::ss::Settings::default())
        };
        let planes = |plane: &Plane| Planes::new(size, vec![plane.clone()]).unwrap();
        let counted = fill(&planes(&garbage), Arc::clone(&whole), &options(Some(weights.clone()))).unwrap();
        let dropped = fill(&planes(&mean), Arc::clone(&kept), &options(None)).unwrap();
        assert!(counted.sets[0].smoothed);
        let error = error(&counted.planes, &dropped.planes.as_slice()[0]);
        // Where all others weigh the same, rounding of the weights alone is left.
        assert!(error < 1e-5, "{error}");
    }
}

/// Guides that show what splines cannot are no sign of noise.
#[test]
fn what_guides_gain_is_not_taken_for_noise() {
    let size = Size::new(90, 100);
    let mask = mask(size, 0.25);
    let guide = Plane::from_fn(size, |row, column| if (row / 6 + column / 5) % 2 == 0 { 0.2 } else { 0.8 });
    let mut guides = Guides::new(size);
    guides.add("albedo", vec![guide.clone()]).unwrap();
    let samples = Planes::new(size, vec![guide]).unwrap();
    let of = |noise| {
        let options = Options { noise, guides: Some(&guides), ..Options::default() };
        fill(&samples, Arc::clone(&mask), &options).unwrap()
    };
    let (found, plain) = (of(Noise::Unknown), of(Noise::None));
    assert!(!found.sets[0].smoothed);
    assert_eq!(found.planes, plain.planes);
}

#[test]
fn complete_images_are_smoothed_too() {
    let size = Size::new(60, 64);
    let truth = truth(size);
    let [a, b, mean] = halves(&truth, 0.1);
    let full = Arc::new(Mask::from_fn(size, |_, _| true));
    let found = filled(&mean, &full, Noise::Like(vec![like(&a, &b)]));
    assert!(error(&found.planes, &truth) < 0.5 * error(&Planes::new(size, vec![mean]).unwrap(), &truth));
}

#[test]
fn lights_stay_and_fireflies_do_not_spread() {
    let size = Size::new(90, 90);
    let (truth, mask) = (truth(size), mask(size, 0.3));
    let [mut a, mut b, _] = halves(&truth, 0.02);
    let measured: Vec<usize> = (0..8100).filter(|&at| mask.as_slice()[at]).collect();
    let (light, firefly) = (measured[700], measured[1500]);
    (a.pixels_mut()[light], b.pixels_mut()[light]) = (50.0, 50.5);
    a.pixels_mut()[firefly] = 80.0;
    let mean = Plane::from_fn(size, |row, column| 0.5 * (a.at(row, column) + b.at(row, column)));
    let found = filled(&mean, &mask, Noise::Like(vec![like(&a, &b)]));
    let pixels = found.planes.as_slice()[0].pixels();
    assert!(pixels[light] > 40.0, "{}", pixels[light]);
    assert!(pixels[firefly] < 3.0, "{}", pixels[firefly]);
    // Neither does a light, whatever tells the noise: further away than four samples the image is as it is where the light was not measured.
    let unlit = Mask::from_fn(size, |y, x| mask.is_measured(y, x) && y * 90 + x != light);
    let unlit = Arc::new(unlit);
    let reach = 4.0 / 0.3_f32.sqrt() + 0.5;
    for (mean, noise) in
        [(mean.clone(), Noise::Like(vec![like(&a, &b)])), (clamped(&mean, firefly), Noise::Unknown)]
    {
        let [lit, dark] = [&mask, &unlit].map(|mask| filled(&mean, mask, noise.clone()).planes.into_vec());
        let (lit, dark) = (lit[0].pixels(), dark[0].pixels());
        assert!(lit[light] > 40.0, "{}", lit[light]);
        let distance = |at: usize| {
            ((at / 90) as f32 - (light / 90) as f32).hypot((at % 90) as f32 - (light % 90) as f32)
        };
        let most = |far: bool| {
            let pixels = (0..8100).filter(|&at| at != light && (distance(at) > reach) == far);
            pixels.map(|at| (lit[at] - dark[at]).abs()).fold(0.0, f32::max)
        };
        assert!(most(true) < 1e-3 && most(false) < 0.25, "{} {}", most(true), most(false));
    }
}

/// The plane with an ordinary value at one place.
fn clamped(plane: &Plane, at: usize) -> Plane {
    let mut plane = plane.clone();
    plane.pixels_mut()[at] = 0.5;
    plane
}

/// Where noise is small beside the errors of filling, missing pixels are filled as well as without it.
#[test]
fn small_noise_costs_edges_nothing() {
    let size = Size::new(128, 128);
    let mask = mask(size, 0.25);
    let far = |y: usize, x: usize, (row, column): (f32, f32)| (y as f32 - row).hypot(x as f32 - column);
    let truth = Plane::from_fn(size, |y, x| {
        let discs = [(40.3, 41.2, 25.0), (80.1, 85.7, 30.5), (30.6, 100.2, 14.0)];
        let inside = |&(row, column, radius): &(f32, f32, f32)| {
            (radius + 0.5 - far(y, x, (row, column))).clamp(0.0, 1.0)
        };
        0.2 + 0.5 * discs.iter().map(inside).fold(0.0, f32::max)
    });
    let [a, b, mean] = halves(&truth, 0.002);
    let samples = Planes::new(size, vec![mean]).unwrap();
    let missing = |planes: Planes| {
        let planes = planes.as_slice()[0].pixels().iter().zip(truth.pixels()).zip(mask.as_slice());
        planes.filter(|(_, flag)| !**flag).map(|((a, b), _)| f64::from(a - b).powi(2)).sum::<f64>()
    };
    let of = |noise| {
        let options = Options { noise, ..Options::default() };
        missing(fill(&samples, Arc::clone(&mask), &options).unwrap().planes)
    };
    let (found, plain) = (of(Noise::Like(vec![like(&a, &b)])), of(Noise::None));
    assert!(found < 1.05 * plain, "{found} {plain}");
}

#[test]
fn guides_carry_what_noise_hides() {
    let size = Size::new(120, 120);
    let mask = mask(size, 0.25);
    let pattern =
        |row: usize, column: usize| if (row / 5 + column / 7).is_multiple_of(2) { 0.2 } else { 0.8 };
    let truth = Plane::from_fn(size, pattern);
    let [a, b, mean] = halves(&truth, 0.15);
    let mut guides = Guides::new(size);
    guides.add("albedo", vec![Plane::from_fn(size, |row, column| 2.0 * pattern(row, column) + 1.0)]).unwrap();
    let noise = Noise::Like(vec![like(&a, &b)]);
    let alone = error(&filled(&mean, &mask, noise.clone()).planes, &truth);
    let options = Options { noise, guides: Some(&guides), ..Options::default() };
    let samples = Planes::new(size, vec![mean]).unwrap();
    let found = fill(&samples, Arc::clone(&mask), &options).unwrap();
    assert_eq!(found.sets[0].guides, ["albedo"]);
    assert!(error(&found.planes, &truth) < 0.25 * alone, "{} {alone}", error(&found.planes, &truth));
}

/// A function of a guide that no plane follows, and that has no neighbourhood in the image.
#[test]
fn guides_carry_what_is_no_plane_of_them() {
    let size = Size::new(120, 120);
    let mask = mask(size, 0.25);
    let guide = Plane::from_fn(size, |row, column| hashed(11, row * size.width + column));
    let truth = Plane::from_fn(size, |row, column| (9.0 * guide.at(row, column)).sin());
    let [a, b, mean] = halves(&truth, 0.1);
    let mut guides = Guides::new(size);
    guides.add("guide", vec![guide]).unwrap();
    let noise = Noise::Like(vec![like(&a, &b)]);
    let options = Options { noise, guides: Some(&guides), ..Options::default() };
    let found = fill(&Planes::new(size, vec![mean]).unwrap(), mask, &options).unwrap();
    // Planes leave 0.69 of it.
    assert!(error(&found.planes, &truth) < 0.3, "{}", error(&found.planes, &truth));
}

#[test]
fn stein_s_estimate_is_that_of_the_truth() {
    // The products at all samples, against the errors that the truth shows.
    let size = Size::new(150, 150);
    let truth = truth(size);
    let full = Arc::new(Mask::from_fn(size, |_, _| true));
    let [a, b, mean] = halves(&truth, 0.1);
    let n = like(&a, &b);
    let run = Run::default();
    let task = Task { guides: None, weights: None, counted: false, tuned: None, run: &run };
    let all = Candidate::all(false);
    let planes = |plane: &Plane| Planes::new(size, vec![plane.clone()]).unwrap();
    let (values, noises, _) = task.both(&all, &full, (&planes(&mean), &planes(&n))).unwrap();
    for (value, noise) in values.iter().zip(&noises).skip(2) {
        let pixel = |planes: &Planes, at: usize| f64::from(planes.as_slice()[0].pixels()[at]);
        let count = size.pixels();
        let stein: f64 = (0..count)
            .map(|at| {
                let (y, n) = (f64::from(mean.pixels()[at]), f64::from(n.pixels()[at]));
                (pixel(value, at) - y).powi(2) + 2.0 * n * pixel(noise, at) - n * n
            })
            .sum::<f64>()
            / count as f64;
        let true_error = error(value, &truth).powi(2);
        // Both sums scatter as the mean of so many squares of noise of 0.1 does.
        let scatter = 0.01 * (2.0 / count as f64).sqrt();
        assert!((stein - true_error).abs() < 4.0 * scatter, "{stein} {true_error}");
    }
}

#[test]
fn noise_of_a_variance_has_it() {
    let variance = Plane::filled(Size::new(200, 200), 0.04);
    let noise = Noise::of_variance(&variance, 3);
    let mean = noise.pixels().iter().map(|n| f64::from(*n)).sum::<f64>() / 40_000.0;
    let square = noise.pixels().iter().map(|n| f64::from(*n).powi(2)).sum::<f64>() / 40_000.0;
    assert!(mean.abs() < 4.0 * 0.2 / 200.0, "{mean}");
    assert!((square / 0.04 - 1.0).abs() < 4.0 * (2.0_f64 / 40_000.0).sqrt(), "{square}");
    for none in [-1.0, f32::INFINITY, f32::NAN] {
        assert!(Noise::of_variance(&Plane::filled(Size::new(1, 1), none), 3).at(0, 0).is_nan(), "{none}");
    }
}

#[test]
fn threads_change_no_bit() {
    let size = Size::new(70, 90);
    let (truth, mask) = (truth(size), mask(size, 0.3));
    let [a, b, mean] = halves(&truth, 0.1);
    let of = |threads: usize| {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
        pool.install(|| filled(&mean, &mask, Noise::Like(vec![like(&a, &b)])).planes)
    };
    let bits = |planes: Planes| planes.as_slice()[0].pixels().iter().map(|x| x.to_bits()).collect::<Vec<_>>();
    assert_eq!(bits(of(1)), bits(of(3)));
}

/// A soft noisy ball that covers a tenth to a fifth of a black frame: the level must not fall into its rim.
#[test]
fn black_around_an_object_changes_nothing_in_it() {
    let error = |border: usize| {
        let size = Size::new(48 + 2 * border, 48 + 2 * border);
        let own = |row: usize, column: usize| {
            let (y, x) = (row.checked_sub(border)?, column.checked_sub(border)?);
            (y < 48 && x < 48).then_some((y, x))
        };
        let shade = |y: usize, x: usize| {
            let away = (y as f32 - 23.5).hypot(x as f32 - 23.5) / 22.0;
            0.9 * (1.0 - away * away).max(0.0).powf(1.5)
        };
        let half = |seed: u64| {
            Plane::from_fn(size, |row, column| {
                own(row, column).map_or(0.0, |(y, x)| {
                    let noise = 0.5 * hashed(seed, y * 48 + x) * shade(y, x).sqrt();
                    (shade(y, x) + noise).max(0.0)
                })
            })
        };
        let (a, b) = (half(1), half(2));
        let mean = Plane::from_fn(size, |row, column| 0.5 * (a.at(row, column) + b.at(row, column)));
        let mask = Arc::new(Mask::from_fn(size, |row, column| match own(row, column) {
            Some((y, x)) => hashed(7, y * 48 + x) < 0.0,
            None => hashed(8, row * size.width + column) < 0.0,
        }));
        let found = filled(&mean, &mask, Noise::Like(vec![like(&a, &b)])).planes;
        let squares = (0..48 * 48)
            .map(|at| (at / 48, at % 48))
            .map(|(y, x)| f64::from(found.as_slice()[0].at(y + border, x + border) - shade(y, x)).powi(2));
        (squares.sum::<f64>() / f64::from(48 * 48)).sqrt()
    };
    let alone = error(0);
    for border in [24, 30, 36] {
        let bordered = error(border);
        assert!(bordered < 1.1 * alone, "{border}: {bordered} {alone}");
    }
}

/// What both halves of a sample show is put back with its bits, not as the smaller half.
#[test]
fn lights_have_their_bits_and_fireflies_are_cut() {
    let size = Size::new(10, 20);
    let own = [(10.0, 3.0), (5.0, 4.9), (0.2, 0.05), (10.0, f32::NAN)];
    let at = |row: usize, column: usize| if row == 3 && column < 4 { own[column] } else { (0.2, 0.05) };
    let [samples, noise] = [
        Plane::from_fn(size, |row, column| at(row, column).0),
        Plane::from_fn(size, |row, column| at(row, column).1),
    ]
    .map(|plane| Planes::new(size, vec![plane]).unwrap());
    let split = Split::new(&Mask::from_fn(size, |_, _| true), &samples, Some(&noise), true);
    let limit = LIMIT * split.level;
    for found in [split.with_lights().unwrap(), split.without_fireflies().unwrap()] {
        let found = &found.as_slice()[0].pixels()[60..64];
        let cut = 0.5 * (5.0_f32 - 4.9 + limit);
        assert_eq!(
            found.iter().map(|v| v.to_bits()).collect::<Vec<_>>(),
            [10.0, cut, 0.2, 10.0].map(f32::to_bits)
        );
    }
}

/// Noise that is not known in one half of the image weighs as the mean there, whatever the unit; not as none.
#[test]
fn unknown_noise_weighs_as_the_mean() {
    let size = Size::new(40, 80);
    let mask = Mask::from_fn(size, |row, column| (row + 2 * column).is_multiple_of(3));
    let weights = |unit: f32, far: f32| {
        let own = |row: usize, column: usize| if column < 40 { unit * (1 + row % 2) as f32 } else { far };
        precision(&mask, &Planes::new(size, vec![Plane::from_fn(size, own)]).unwrap()).unwrap()
    };
    let one = weights(1.0, f32::NAN);
    for (at, weight) in one.pixels().iter().enumerate().filter(|(at, _)| at % 80 > 70 || at % 80 < 40) {
        assert!((weight - 1.0).abs() < 0.1, "{at}: {weight}");
    }
    assert_eq!(one, weights(1.0, f32::INFINITY));
    for unit in [2.0_f32.powi(-100), 2.0_f32.powi(100)] {
        assert_eq!(one, weights(unit, f32::NAN));
    }
    let quiet = weights(1.0, 0.0);
    assert!(quiet.at(20, 75) > 100.0 * quiet.at(20, 10));
}

#[test]
fn halves_of_the_image_tell_half_their_difference() {
    let size = Size::new(40, 30);
    let [first, second, mean] = halves(&truth(size), 0.1);
    let mask = Mask::full(size);
    let noise = Noise::of_halves(&mean, [&first, &second], &mask).unwrap();
    let expected = |at: usize| 0.5 * (first.pixels()[at] - second.pixels()[at]);
    assert!((0..noise.pixels().len()).all(|at| noise.pixels()[at] == expected(at)));
    // Where only the mean was clamped, halves tell nothing.
    let mut clamped = mean.clone();
    clamped.pixels_mut()[7] = 0.0;
    let noise = Noise::of_halves(&clamped, [&first, &second], &mask).unwrap();
    assert!((0..noise.pixels().len()).all(|at| (noise.pixels()[at] == expected(at)) != (at == 7)));
    let other = Plane::filled(size, 3.0);
    assert_eq!(Noise::of_halves(&other, [&first, &second], &mask), Err(Untold::OtherHalves));
    assert_eq!(Noise::of_halves(&other, [&first, &first], &mask), Err(Untold::SameHalves));
    let bad = Noise::of_variance_at(&Plane::filled(size, -1.0), 0, &mask);
    assert_eq!(bad, Err(Untold::Negative(-1.0)));
    let none = || vec![Plane::filled(size, 0.0)];
    let planes = |plane: Plane| Planes::new(size, vec![plane]).unwrap();
    let unknown = vec![Plane::filled(size, f32::NAN)];
    assert_eq!(Noise::like(unknown, &planes(mean.clone()), &mask), Err(Untold::NotFinite));
    assert_eq!(Noise::like(none(), &planes(mean), &mask), Err(Untold::Nowhere));
    assert_eq!(Noise::like(none(), &planes(other), &mask), Ok(Noise::None));
}
