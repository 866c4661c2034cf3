//! What guides promise: exact samples, the plain filter's bits where they say nothing, and no harm.

use super::*;
use crate::variational::ss;
use crate::{Size, sampling::shuffle};

const SIZE: Size = Size::new(120, 150);

/// The plain filter, steered.
fn reconstruct(
    (filter, plan): (&dyn Filter, &dyn Plan),
    mask: &Arc<Mask>,
    samples: &Planes,
    guides: &Guides,
    out: &mut Planes,
    run: &Run<'_>,
) -> Result<(Outcome, Effect), Error> {
    plan.reconstruct(samples, out, run)?;
    steer((filter, plan), mask, samples, guides, out, run)
}

fn method() -> ss::Settings {
    ss::Settings::default()
}

fn mask(density: f64) -> Arc<Mask> {
    Arc::new(shuffle::mask(0, 0, SIZE, density, 1).unwrap())
}

/// Numbers between 0 and 1 without a pattern.
fn noise(seed: u64) -> impl Fn(usize, usize) -> f32 {
    move |y, x| {
        let key = (((y as u64) << 32) | x as u64) ^ seed.wrapping_mul(0x9e37_79b9_7f4a_7c15);
        let mixed = (key ^ (key >> 31)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
        let mixed = (mixed ^ (mixed >> 29)).wrapping_mul(0x94d0_49bb_1331_11eb);
        (mixed >> 40) as f32 / (1 << 24) as f32
    }
}

/// A normal of a field of bumps, with hard creases.
fn normal(y: usize, x: usize) -> [f32; 3] {
    let (v, u) = ((y % 23) as f32 / 11.5 - 1.0, (x % 19) as f32 / 9.5 - 1.0);
    let square = u * u + v * v;
    if square >= 0.95 { [0.0, 0.0, 1.0] } else { [u, v, (1.0 - square).sqrt()] }
}

/// A texture that no spline could guess.
fn albedo(y: usize, x: usize) -> [f32; 3] {
    let cell = noise(5)(y / 3, x / 4);
    [0.2 + 0.7 * cell, 0.9 - 0.6 * cell, 0.3 + 0.3 * noise(6)(y / 2, x / 2)]
}

fn shaded(y: usize, x: usize) -> [f32; 3] {
    let [u, v, w] = normal(y, x);
    let light = (0.5 * u - 0.3 * v + 0.8 * w).max(0.0) + 0.1 + 0.05 * (y as f32 / 40.0).sin();
    albedo(y, x).map(|albedo| albedo * light)
}

fn planes(pixel: impl Fn(usize, usize) -> [f32; 3]) -> Vec<Plane> {
    (0..3).map(|channel| Plane::from_fn(SIZE, |y, x| pixel(y, x)[channel])).collect()
}

fn image() -> Planes {
    Planes::new(SIZE, planes(shaded)).unwrap()
}

fn guides(groups: Vec<Vec<Plane>>) -> Guides {
    let mut guides = Guides::new(SIZE);
    for (index, group) in groups.into_iter().enumerate() {
        guides.add(&format!("guide {index}"), group).unwrap();
    }
    guides
}

/// The plain image, the guided one, and what guides did.
fn both(mask: &Arc<Mask>, image: &Planes, guides: &Guides) -> (Planes, Planes, Effect) {
    let (method, run) = (method(), Run::default());
    let plan = method.plan(&Problem::fill(Arc::clone(mask)), &run).unwrap();
    let mut samples = image.clone();
    for plane in samples.as_mut_slice() {
        for (value, _) in plane.pixels_mut().iter_mut().zip(mask.as_slice()).filter(|(_, flag)| !**flag) {
            *value = 0.0;
        }
    }
    let mut plain = Planes::zeros(SIZE, image.len());
    plan.reconstruct(&samples, &mut plain, &run).unwrap();
    let mut guided = Planes::zeros(SIZE, image.len());
    let (_, effect) =
        reconstruct((&method, plan.as_ref()), mask, &samples, guides, &mut guided, &run).unwrap();
    (plain, guided, effect)
}

fn psnr(a: &Planes, b: &Planes) -> f64 {
    let pairs = a.as_slice().iter().zip(b.as_slice()).flat_map(|(a, b)| a.pixels().iter().zip(b.pixels()));
    let (sum, count) = pairs.fold((0.0, 0.0), |(sum, count): (f64, f64), (a, b)| {
        (sum + f64::from(a.clamp(0.0, 1.0) - b.clamp(0.0, 1.0)).powi(2), count + 1.0)
    });
    -10.0 * (sum / count).log10()
}

fn same_bits(a: &Planes, b: &Planes) -> bool {
    let bits = |planes: &Planes| -> Vec<u32> {
        planes
            .as_slice()
            .iter()
            .flat_map(|plane| plane.pixels().iter().map(|value| value.to_bits()))
            .collect()
    };
    bits(a) == bits(b)
}

#[test]
fn good_guides_gain_much_and_samples_stay() {
    let image = image();
    for (density, least) in [(0.2, 4.0), (0.05, 2.0)] {
        let mask = mask(density);
        let (plain, guided, effect) = both(&mask, &image, &guides(vec![planes(normal), planes(albedo)]));
        let gain = psnr(&guided, &image) - psnr(&plain, &image);
        assert!(gain > least, "{density}: {gain}");
        assert!(effect.gain.unwrap() > 0.3 && effect.guides.contains(&"guide 1".to_owned()), "{effect:?}");
        for (guided, image) in guided.as_slice().iter().zip(image.as_slice()) {
            for ((a, b), _) in
                guided.pixels().iter().zip(image.pixels()).zip(mask.as_slice()).filter(|(_, m)| **m)
            {
                assert_eq!(a.to_bits(), b.to_bits());
            }
        }
    }
}

#[test]
fn guides_that_say_nothing_change_no_bit() {
    let (image, mask) = (image(), mask(0.2));
    let constant = |value: f32| vec![Plane::filled(SIZE, value)];
    let unknown = constant(f32::NAN);
    for guides in [guides(vec![]), guides(vec![constant(0.5), constant(-3.0)]), guides(vec![unknown])] {
        let (plain, guided, effect) = both(&mask, &image, &guides);
        assert!(same_bits(&plain, &guided) && effect == Effect::default());
    }
}

#[test]
fn useless_guides_do_no_harm() {
    let smooth = |y: usize, x: usize| {
        let (v, u) = (y as f32 / 30.0, x as f32 / 25.0);
        [0.5 + 0.3 * (u + v).sin(), 0.5 + 0.3 * (u * v).cos(), 0.4 + 0.2 * (u - 0.5 * v).sin()]
    };
    let random = |y: usize, x: usize| [noise(1)(y, x), noise(2)(y, x), noise(3)(y, x)];
    let elsewhere = |y: usize, x: usize| normal(y + 41, x * 2 + 13);
    for image in [image(), Planes::new(SIZE, planes(smooth)).unwrap()] {
        for (name, group) in [("noise", planes(random)), ("another frame", planes(elsewhere))] {
            for density in [0.2, 0.05] {
                let (plain, guided, _) = both(&mask(density), &image, &guides(vec![group.clone()]));
                let loss = psnr(&plain, &image) - psnr(&guided, &image);
                assert!(loss <= 0.1, "{name}, {density}: {loss}");
            }
        }
    }
}

#[test]
fn noise_in_guides_costs_gain_but_no_quality() {
    let (image, mask) = (image(), mask(0.2));
    let mut last = f64::INFINITY;
    for size in [0.0, 0.05, 0.2, 0.8] {
        let noisy = |y: usize, x: usize| {
            let mut seed = 10;
            albedo(y, x).map(|value| {
                seed += 1;
                // A sum of four is nearly Gaussian, of standard deviation 0.58.
                let sum: f32 = (0..4).map(|part| noise(100 * part + seed)(y, x)).sum::<f32>() - 2.0;
                value + size / 0.58 * sum
            })
        };
        let (plain, guided, _) = both(&mask, &image, &guides(vec![planes(normal), planes(noisy)]));
        let gain = psnr(&guided, &image) - psnr(&plain, &image);
        assert!(gain >= -0.1 && gain <= last + 0.1, "{size}: {gain} after {last}");
        last = gain;
    }
}

#[test]
fn pixels_without_a_number_are_left_to_the_plain_filter() {
    let (image, mask) = (image(), mask(0.2));
    let hole = |y: usize, x: usize| (40..60).contains(&y) && (50..90).contains(&x);
    let broken = |y: usize, x: usize| if hole(y, x) { [f32::NAN; 3] } else { albedo(y, x) };
    let given = guides(vec![planes(normal), planes(broken)]);
    assert_eq!(given.unknown(), 20 * 40);
    let (plain, guided, _) = both(&mask, &image, &given);
    assert!(psnr(&guided, &image) > psnr(&plain, &image) + 2.0);
    for (plain, guided) in plain.as_slice().iter().zip(guided.as_slice()) {
        for (y, x) in (40..60).flat_map(|y| (50..90).map(move |x| (y, x))) {
            assert_eq!(plain.at(y, x).to_bits(), guided.at(y, x).to_bits());
        }
    }
}

#[test]
fn infinite_depths_and_labels_are_guides() {
    let (image, mask) = (image(), mask(0.2));
    let depth =
        Plane::from_fn(
            SIZE,
            |y, x| if normal(y, x)[2] == 1.0 { f32::INFINITY } else { 3.0 + normal(y, x)[2] },
        );
    let mut given = guides(vec![planes(albedo), vec![depth]]);
    let labels: Vec<u32> =
        (0..SIZE.pixels()).map(|at| u32::from(normal(at / SIZE.width, at % SIZE.width)[2] < 1.0)).collect();
    assert!(given.add_labels("id", &labels).unwrap());
    assert!(!given.add_labels("same", &vec![7; SIZE.pixels()]).unwrap());
    let (plain, guided, effect) = both(&mask, &image, &given);
    assert!(guided.as_slice().iter().all(|plane| plane.pixels().iter().all(|value| value.is_finite())));
    assert!(psnr(&guided, &image) > psnr(&plain, &image) + 1.0);
    assert!(effect.guides.contains(&"id".to_owned()));
}

/// Few surfaces, of one value each: no value but the ends of the range, or one between them.
#[test]
fn planes_of_two_or_three_values_guide() {
    let (surface, mask) = (|y: usize, x: usize| (7 * x + 10 * y) % 370 / 124, mask(0.2));
    let light = |y: usize, x: usize| [0.1, 0.5, 0.9][surface(y, x)] * (0.8 + 0.2 * (x as f32 / 20.0).sin());
    let image = Planes::new(SIZE, planes(|y, x| [light(y, x); 3])).unwrap();
    let far = |y: usize, x: usize| if y < 9 { 1e10 } else { surface(y, x) as f32 };
    let hidden = |y: usize, x: usize| if y < 9 { f32::INFINITY } else { surface(y, x) as f32 };
    let single = |y: usize, x: usize| if (y, x) == (1, 1) { 0.50001 } else { [0.1, 0.5, 0.9][surface(y, x)] };
    let pair = |y: usize, x: usize| if y < 9 { 1e10 } else { surface(y, x).min(1) as f32 };
    let given: [&dyn Fn(usize, usize) -> f32; 5] =
        [&|y, x| [0.1, 0.5, 0.9][surface(y, x)], &single, &far, &hidden, &pair];
    for (at, value) in given.into_iter().enumerate() {
        let guides = guides(vec![vec![Plane::from_fn(SIZE, value)]]);
        let (plain, guided, _) = both(&mask, &image, &guides);
        let gain = psnr(&guided, &image) - psnr(&plain, &image);
        assert!(gain > if at == 4 { 1.5 } else { 8.0 }, "{at}: {gain}");
    }
}

#[test]
fn threads_do_not_matter() {
    let (image, mask) = (image(), mask(0.1));
    let run = |threads: usize| {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
        pool.install(|| both(&mask, &image, &guides(vec![planes(normal), planes(albedo)])).1)
    };
    assert!(same_bits(&run(1), &run(3)));
}

#[test]
fn other_sizes_are_refused_and_small_images_are_plain() {
    let (method, run) = (method(), Run::default());
    let size = Size::new(1, 7);
    let mask = Arc::new(Mask::from_fn(size, |_, x| x % 2 == 0));
    let plan = method.plan(&Problem::fill(Arc::clone(&mask)), &run).unwrap();
    let samples = Planes::zeros(size, 2);
    let mut out = Planes::zeros(size, 2);
    let wrong = reconstruct((&method, plan.as_ref()), &mask, &samples, &guides(vec![]), &mut out, &run);
    assert!(matches!(wrong, Err(Error::SizeMismatch { .. })));
    let mut own = Guides::new(size);
    assert!(own.add("wrong", planes(normal)).is_err());
    own.add("x", vec![Plane::from_fn(size, |_, x| x as f32)]).unwrap();
    let (_, effect) = reconstruct((&method, plan.as_ref()), &mask, &samples, &own, &mut out, &run).unwrap();
    assert_eq!(effect, Effect::default());
}

#[test]
fn a_reach_holds_the_samples_wanted() {
    for density in [0.05, 0.2, 0.5] {
        let reach = Reach::new(&mask(density), SAMPLES);
        for (row, column) in [(60, 75), (50, 40), (70, 100)] {
            let seen = std::f64::consts::PI * f64::from(reach.at(row, column)).powi(2) * density;
            assert!((seen / SAMPLES - 1.0).abs() < 0.25, "{density}: {seen}");
        }
    }
}

/// Also those that are constant here, not finite or far off.
#[test]
fn guides_of_another_frame_are_on_the_scale_of_these() {
    let size = Size::new(20, 30);
    let value = |k: usize, y: usize, x: usize| match (k, y, x) {
        (1, ..) => 0.5,
        (2, 3, 4) => f32::INFINITY,
        (2, 5, 6) => 1e30,
        _ => 10.0 * k as f32 + (0.3 * y as f32 + 0.2 * x as f32).sin(),
    };
    let all = || (0..3).map(|k| Plane::from_fn(size, |y, x| value(k, y, x))).collect::<Vec<_>>();
    let mut guides = Guides::new(size);
    guides.add("a", all()).unwrap();
    let alike = guides.alike(|name| (name == "a").then(all)).unwrap();
    assert_eq!(alike.len(), 2);
    let bits = |plane: &Plane| plane.pixels().iter().map(|value| value.to_bits()).collect::<Vec<_>>();
    assert!(alike.iter().zip(guides.planes()).all(|(other, own)| bits(other) == bits(own)));
    assert!(guides.alike(|_| None).is_none());
    assert!(guides.alike(|_| Some(all()[..2].to_vec())).is_none());
}
