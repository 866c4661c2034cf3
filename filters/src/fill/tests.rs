//! What the call decides, on images made by hand; the bits of every method are compared with the tool's by the tool's own tests.

use super::*;
use crate::baseline::testing::with_threads;
use crate::estimate::Verdict;
use crate::sampling;
use crate::{METHODS, Size};

fn size() -> Size {
    Size::new(24, 31)
}

/// About a third of the pixels.
fn mask() -> Arc<Mask> {
    Arc::new(Mask::from_fn(size(), |y, x| lacuna_core::hash(y as u64, x as u64).is_multiple_of(3)))
}

fn image(at: usize) -> Plane {
    Plane::from_fn(size(), |y, x| 0.2 + ((y * 3 + x * (at + 1)) % 17) as f32 / 20.0)
}

fn images(count: usize) -> Planes {
    Planes::new(size(), (0..count).map(image).collect()).unwrap()
}

fn bits(plane: &Plane) -> Vec<u32> {
    plane.pixels().iter().map(|value| value.to_bits()).collect()
}

/// What guides predict by a slope may lie beyond the samples around, and stays within reach of them all.
#[test]
fn the_limiter_holds_with_guides() {
    let size = Size::new(90, 110);
    let mask = Arc::new(Mask::from_fn(size, |y, x| lacuna_core::hash(y as u64, x as u64).is_multiple_of(5)));
    let fine = |y: usize, x: usize| (lacuna_core::hash(x as u64, y as u64) % 1000) as f32 / 1000.0;
    let is_far = |y: usize, x: usize| !mask.is_measured(y, x) && (y + x).is_multiple_of(11);
    let guide = Plane::from_fn(size, |y, x| if is_far(y, x) { -0.4 } else { fine(y, x) });
    let samples = Plane::from_fn(size, |y, x| 0.1 + 0.7 * fine(y, x));
    let mut guides = Guides::new(size);
    guides.add("g", vec![guide]).unwrap();
    let filled = |limit: bool| {
        let method = Method::named("ss", &[]).unwrap();
        let options = Options { guides: Some(&guides), domain: Domain::Linear, limit, ..Options::of(method) };
        let filled = fill(&Planes::from(samples.clone()), Arc::clone(&mask), &options).unwrap();
        assert!(filled.sets[0].gain.is_some());
        filled.planes.into_vec().remove(0)
    };
    let moved = |mut plane: Plane| crate::limiter::whole(&mask, &samples, &mut plane).unwrap().values;
    assert!(moved(filled(false)) > 0);
    assert_eq!(moved(filled(true)), 0);
}

/// Whether guides count is one question for a fill, for those that samples are held out of, and for those of its simulation.
#[test]
fn what_is_told_of_guided_fills_of_few_samples_holds() {
    // The smaller image has 184 to 348 samples.
    for side in [150, 158, 160, 164, 178, 200, 130] {
        let size = Size::new(side, side);
        let field = sampling::Field { x: 0, y: 0, size };
        let mask = sampling::mask(sampling::Pattern::Shuffle, field, 0.1, 1, sampling::Temporal::Fixed, 0);
        let mask = Arc::new(mask.unwrap());
        let fine = |y: usize, x: usize| (lacuna_core::hash(x as u64, y as u64) % 1000) as f32 / 1000.0;
        let truth =
            Plane::from_fn(size, |y, x| fine(y, x) * (0.6 + 0.3 * (0.11 * x as f32 + 0.07 * y as f32).sin()));
        let mut guides = Guides::new(size);
        guides.add("albedo", vec![Plane::from_fn(size, |y, x| 0.1 + 0.5 * fine(y, x))]).unwrap();
        let options = Options {
            guides: Some(&guides),
            domain: Domain::Linear,
            estimate: Estimate::Figure,
            ..Options::of(Method::named("ss", &[]).unwrap())
        };
        let filled = fill(&Planes::from(truth.clone()), Arc::clone(&mask), &options).unwrap();
        let set = &filled.sets[0];
        assert!(set.gain.is_some());
        let pairs = truth.pixels().iter().zip(filled.planes.as_slice()[0].pixels());
        let sum: f64 = pairs.map(|(a, b)| f64::from(a - b).powi(2)).sum();
        let right = (sum / (size.pixels() - mask.count()) as f64).sqrt();
        match set.estimate.unwrap() {
            Verdict::Estimate(told) => {
                assert!(told.low <= right && right <= told.high, "{side}: {right} in {told:?}");
            }
            Verdict::AtMost(bound) => assert!(right <= bound, "{side}: {right}, at most {bound}"),
            Verdict::CannotTell(why) => panic!("{side}: {why}"),
        }
    }
}

#[test]
fn what_is_sparse_like_the_samples_neither_guides_nor_is_copied() {
    let size = Size::new(40, 50);
    let mask = Arc::new(Mask::from_fn(size, |y, x| (y * 7 + x * 3).is_multiple_of(5)));
    let whole = |at: usize| Plane::from_fn(size, |y, x| ((y * (2 + at) + x) % 17) as f32 / 20.0);
    let sparse = |at: usize, clear: f32| {
        let whole = whole(at);
        Plane::from_fn(size, |y, x| if mask.is_measured(y, x) { whole.row(y)[x] } else { clear })
    };
    let samples = Planes::from(sparse(0, 0.0));
    let told = |add: &dyn Fn(&mut Guides)| {
        let mut guides = Guides::new(size);
        guides.add("whole", vec![whole(1)]).unwrap();
        add(&mut guides);
        fill(&samples, Arc::clone(&mask), &Options { guides: Some(&guides), ..Options::default() })
    };
    for clear in [0.0, 0.6, f32::NAN] {
        // A plane that is the same everywhere says nothing, but holds something.
        let found = told(&|guides| {
            guides.add("N", vec![sparse(1, clear), sparse(2, clear), Plane::filled(size, 0.0)]).unwrap();
        });
        assert_eq!(found.unwrap_err(), Error::SparseGuide { name: "N".into() }, "{clear}");
        let options = |twin: Plane| Options { twins: vec![Some(Arc::new(twin))], ..Options::default() };
        let copied = |twin| fill(&samples, Arc::clone(&mask), &options(twin)).unwrap().sets[0].copied;
        assert!(copied(whole(0)) && !copied(sparse(0, clear)));
    }
    let labels = |clear: bool| -> Vec<u32> {
        let id = |at: usize| if clear && !mask.as_slice()[at] { 0 } else { 1 + at as u32 % 9 };
        (0..size.pixels()).map(id).collect()
    };
    let found = told(&|guides| assert!(guides.add_labels("id", &labels(true)).unwrap()));
    assert_eq!(found.unwrap_err(), Error::SparseGuide { name: "id".into() });
    assert!(told(&|guides| assert!(guides.add_labels("id", &labels(false)).unwrap())).is_ok());
    let flat = vec![whole(1), Plane::filled(size, 1.0)];
    assert!(told(&|guides| assert!(guides.add("N", flat.clone()).unwrap())).is_ok());
}

#[test]
fn measured_bits_stay_in_every_domain_and_all_is_finite() {
    let mut samples = images(3);
    samples.as_mut_slice()[0].pixels_mut()[5] = 1e6;
    for found in METHODS.iter().filter(|found| !found.takes.dictionary) {
        for domain in [Domain::Linear, Domain::Log] {
            let options = Options { domain, ..Options::of(Method::of(found, &[]).unwrap()) };
            let filled = fill(&samples, mask(), &options).unwrap();
            for (before, after) in samples.as_slice().iter().zip(filled.planes.as_slice()) {
                assert!(after.pixels().iter().all(|value| value.is_finite()), "{}", found.name);
                let pairs = mask()
                    .as_slice()
                    .iter()
                    .zip(bits(before).into_iter().zip(bits(after)))
                    .all(|(&flag, (before, after))| !flag || before == after);
                assert!(pairs, "{} {domain:?}", found.name);
            }
        }
    }
}

#[test]
fn threads_change_no_bit_of_any_method() {
    // More pixels than one task takes.
    let size = Size::new(96, 180);
    let shade = |y: usize, x: usize| 0.2 + ((y * 3 + x * 2) % 17) as f32 / 20.0;
    let planes = vec![Plane::from_fn(size, shade), Plane::from_fn(size, |y, x| shade(x, y))];
    let samples = Planes::new(size, planes).unwrap();
    let third = |y, x| lacuna_core::hash(y as u64, x as u64).is_multiple_of(3);
    let mask = Arc::new(Mask::from_fn(size, third));
    for found in METHODS.iter().filter(|found| !found.takes.dictionary) {
        let options = Options { estimate: Estimate::Pixels, ..Options::of(Method::of(found, &[]).unwrap()) };
        let run = |threads| {
            let filled = with_threads(threads, || fill(&samples, mask.clone(), &options).unwrap());
            let errors = filled.sets[0].errors.as_ref().map(bits);
            (filled.planes.as_slice().iter().map(bits).collect::<Vec<_>>(), errors)
        };
        assert!(run(1) == run(3), "{}", found.name);
    }
}

/// A plane that misses a pixel more is a set of its own; what is told is that of all planes, in any unit.
#[test]
fn errors_are_over_all_planes() {
    for unit in [1.0, 1e-20, 1e25] {
        let mut samples = images(3);
        samples.as_mut_slice().iter_mut().flat_map(Plane::pixels_mut).for_each(|value| *value *= unit);
        let first = mask().as_slice().iter().position(|&flag| flag).unwrap();
        samples.as_mut_slice()[1].pixels_mut()[first] = f32::NAN;
        let method = Method::named("ss", &[]).unwrap();
        let options = Options { estimate: Estimate::Pixels, peak: unit, ..Options::of(method) };
        let filled = fill(&samples, mask(), &options).unwrap();
        let [two, one] = &filled.sets[..] else { panic!("{} sets", filled.sets.len()) };
        let [two, one] = [two, one].map(|set| set.errors.as_ref().unwrap().pixels());
        for ((all, two), one) in filled.errors().unwrap().pixels().iter().zip(two).zip(one) {
            let [all, two, one] = [all, two, one].map(|error| f64::from(error / unit).powi(2));
            assert!((all - (2.0 * two + one) / 3.0).abs() <= 1e-5 * all, "{unit}: {all} {two} {one}");
        }
        assert!(filled.errors().unwrap().pixels().iter().any(|error| *error > 0.01 * unit));
    }
}

/// Plans write their result, whatever stood there.
#[test]
fn what_an_output_holds_changes_no_bit_of_any_method() {
    let size = Size::new(96, 120);
    let edges = |y: usize, x: usize| f32::from(u8::from((y * 37 + x * 93) % 3100 < 1400));
    let smooth = |y: usize, x: usize| 0.5 + 0.2 * (0.09 * y as f32).sin() * (0.07 * x as f32).cos();
    let half = |y: usize, x: usize| if x < 60 { smooth(y, x) } else { edges(y, x) };
    let samples = Planes::from(Plane::from_fn(size, half));
    let third = |y, x| lacuna_core::hash(y as u64, x as u64).is_multiple_of(3);
    let mask = Arc::new(Mask::from_fn(size, third));
    for found in METHODS.iter().filter(|found| !found.takes.dictionary) {
        let method = Method::of(found, &[]).unwrap();
        let plan = Plans::new().filter(&method, &mask, None, &Run::default()).unwrap();
        let from = |value: f32| {
            let mut out = Planes::from(Plane::filled(size, value));
            plan.reconstruct(&samples, &mut out, &Run::default()).unwrap();
            bits(&out.as_slice()[0])
        };
        let clean = from(0.0);
        assert!(clean == from(5.0) && clean == from(f32::NAN), "{}", found.name);
    }
    let shares =
        &fill(&samples, mask, &Options { values: Values::Other, ..Options::default() }).unwrap().sets[0]
            .shares;
    assert!(shares.len() > 1, "one candidate alone: {shares:?}");
}

/// Values that bounds take back are no errors: what is told of an opacity is nearer to the truth with them.
#[test]
fn estimates_know_the_bounds() {
    let size = Size::new(120, 160);
    let discs = |y: usize, x: usize| {
        let [y, x] = [(y % 40) as f32 - 20.0, (x % 40) as f32 - 20.0];
        f32::from(u8::from(y.hypot(x) < 13.0))
    };
    let truth = Planes::new(size, vec![Plane::from_fn(size, discs)]).unwrap();
    let mask = Arc::new(crate::sampling::shuffle::mask(0, 0, size, 0.3, 1).unwrap());
    let told_and_true = |bounds: Bounds| {
        let method = Method::named("ss", &[]).unwrap();
        let options = Options {
            values: Values::Other,
            bounds: vec![bounds],
            estimate: Estimate::Figure,
            ..Options::of(method)
        };
        let filled = fill(&truth, Arc::clone(&mask), &options).unwrap();
        let pairs = truth.as_slice()[0].pixels().iter().zip(filled.planes.as_slice()[0].pixels());
        let squares: f64 = pairs.map(|(a, b)| f64::from(a - b).powi(2)).sum();
        let Some(crate::estimate::Verdict::Estimate(told)) = filled.sets[0].estimate else { panic!() };
        (told.rmse, (squares / (size.pixels() - mask.count()) as f64).sqrt())
    };
    let [free, unit] = [Bounds::Free, Bounds::Unit].map(told_and_true);
    assert!(unit.0 < 0.98 * free.0 && unit.0 / unit.1 < free.0 / free.1, "{free:?} {unit:?}");
}

/// The same frame in other units is told the same errors in these.
#[test]
fn estimates_follow_the_unit() {
    let size = Size::new(90, 100);
    let image = |y: usize, x: usize| {
        let wave = (x as f32 / 3.0).sin() * (y as f32 / 2.0).cos();
        0.4 * wave + if x > y { 0.7 } else { 0.5 }
    };
    let mask = Arc::new(crate::sampling::shuffle::mask(0, 0, size, 0.3, 0).unwrap());
    let told = |unit: f32, name: &str| {
        let method = Method::named(name, &[]).unwrap();
        let options = Options { peak: unit, estimate: Estimate::Pixels, ..Options::of(method) };
        let samples = Planes::from(Plane::from_fn(size, |y, x| unit * image(y, x)));
        let mut set = fill(&samples, Arc::clone(&mask), &options).unwrap().sets.remove(0);
        let Some(crate::estimate::Verdict::Estimate(found)) = set.estimate else {
            panic!("{name} {unit}: {:?}", set.estimate)
        };
        let errors = set.errors.take().unwrap();
        let relative = |error: f64| error / f64::from(unit);
        let squares = errors.pixels().iter().map(|&error| relative(f64::from(error)).powi(2)).sum::<f64>();
        [relative(found.rmse), relative(found.low), relative(found.high), squares.sqrt()]
    };
    for name in ["ss", "auto"] {
        let usual = told(1.0, name);
        for power in [-100, -80, -45, 40, 70, 120] {
            let found = told(2.0_f32.powi(power), name);
            let are_near = usual.iter().zip(found).all(|(a, b)| (a - b).abs() < 3e-3 * a);
            assert!(are_near, "{name}, 2^{power}: {found:?} for {usual:?}");
        }
    }
}

#[test]
fn errors_that_clipping_hides_are_told_from_none() {
    let size = Size::new(144, 180);
    let bright = Plane::from_fn(size, |y, x| 3.0 + (y as f32 / 9.0).sin() * (x as f32 / 7.0).cos());
    let mask = Arc::new(crate::sampling::shuffle::mask(0, 0, size, 0.3, 1).unwrap());
    let fill = |peak: f32| {
        let method = Method::named("ss", &[]).unwrap();
        let domain = Domain::Linear;
        let options = Options { peak, domain, estimate: Estimate::Figure, ..Options::of(method) };
        fill(&Planes::from(bright.clone()), Arc::clone(&mask), &options)
    };
    let told = |peak: f32| {
        let set = fill(peak).unwrap().sets.remove(0);
        (set.estimate, set.unclipped)
    };
    let (hidden, unclipped) = told(1.0);
    assert_eq!(hidden, Some(crate::estimate::Verdict::CannotTell(crate::estimate::Why::Clipped)));
    assert!(matches!(unclipped, Some(crate::estimate::Verdict::Estimate(rmse)) if rmse.rmse > 0.0));
    assert_eq!(told(8.0), (unclipped, None));
    for wrong in [0.0, -1.0, f32::NAN, f32::INFINITY] {
        assert!(matches!(fill(wrong), Err(Error::Setting { name: "peak", .. })), "{wrong}");
    }
}

#[test]
fn planes_with_other_measured_values_are_solved_apart() {
    let mut samples = images(3);
    let first = mask().as_slice().iter().position(|&flag| flag).unwrap();
    samples.as_mut_slice()[1].pixels_mut()[first] = f32::NAN;
    let filled = fill(&samples, mask(), &Options::default()).unwrap();
    let places: Vec<_> = filled.sets.iter().map(|set| set.planes.clone()).collect();
    assert_eq!((places, filled.non_finite.clone()), (vec![vec![0, 2], vec![1]], vec![0, 1, 0]));
    assert_eq!(filled.mask(1).unwrap().count() + 1, filled.mask(0).unwrap().count());
    let alone = fill(&Planes::from(samples.as_slice()[1].clone()), mask(), &Options::default()).unwrap();
    assert_eq!(bits(&filled.planes.as_slice()[1]), bits(&alone.planes.as_slice()[0]));
    samples.as_mut_slice()[2].pixels_mut().fill(f32::NAN);
    let error = fill(&samples, mask(), &Options::default()).unwrap_err();
    assert_eq!(error, Error::NothingFinite { plane: 2 });
}

#[test]
fn what_misses_nothing_is_left_alone() {
    let mut samples = images(2);
    samples.as_mut_slice()[0].pixels_mut()[3] = f32::NAN;
    let full = Mask::from_fn(size(), |_, _| true);
    let filled = fill(&samples, full.clone(), &Options::default()).unwrap();
    assert_eq!(bits(&filled.planes.as_slice()[0]), bits(&samples.as_slice()[0]));
    assert!(filled.sets.is_empty());
    let restoring = Method::named("dct", &[("restore", "true"), ("sparsity", "2")]).unwrap();
    let filled = fill(&samples, full, &Options::of(restoring)).unwrap();
    assert_ne!(bits(&filled.planes.as_slice()[1]), bits(&samples.as_slice()[1]));
}

#[test]
fn sizes_and_numbers_must_agree() {
    let samples = images(2);
    let wrong = |options: Options<'_>| {
        let error = fill(&samples, mask(), &options).unwrap_err();
        assert!(matches!(error, Error::SizeMismatch { .. }), "{error}");
    };
    wrong(Options { bounds: vec![Bounds::Unit], ..Options::default() });
    wrong(Options { gradients: vec![None], ..Options::default() });
    let small = Plane::filled(Size::new(1, 1), 1.0);
    wrong(Options { weights: Some(Arc::new(small.clone())), ..Options::default() });
    wrong(Options { gradients: vec![None, Some([image(0), small])], ..Options::default() });
    wrong(Options { guides: Some(&Guides::new(Size::new(1, 1))), ..Options::default() });
    wrong(Options { noise: Noise::Like(vec![image(0)]), ..Options::default() });
    wrong(Options { noise: Noise::Like(Vec::new()), ..Options::default() });
    let empty = Mask::from_fn(size(), |_, _| false);
    assert_eq!(fill(&samples, empty, &Options::default()).unwrap_err(), Error::EmptyMask);
}

#[test]
fn a_method_without_use_for_gradients_fills_as_without_them() {
    let slopes = || Some([image(1), image(0)]);
    for method in [Method::default(), Method::named("ss", &[]).unwrap()] {
        let [without, with] = [vec![None, None], vec![slopes(), slopes()]].map(|gradients| {
            let options = Options { gradients, ..Options::of(method.clone()) };
            fill(&images(2), mask(), &options).unwrap().planes
        });
        assert_eq!(bits(&without.as_slice()[0]), bits(&with.as_slice()[0]));
    }
}

#[test]
fn other_frames_have_the_size_and_the_planes_of_this_one() {
    let from = |size: Size, planes: usize| {
        let samples = Planes::new(size, vec![Plane::from_fn(size, |y, x| (y + x) as f32); planes]).unwrap();
        let place = |at: usize| [(at / size.width) as f32, (at % size.width) as f32];
        Carried::new(size, (&samples, &Mask::from_fn(size, |_, _| true)), 1, place).unwrap()
    };
    let tall = Size::new(100, 31);
    let judged = from(size(), 2).judged_by(from(size(), 1));
    for carried in [from(size(), 1), from(size(), 3), from(tall, 2), judged, Carried::default()] {
        let options = Options { carried: &[from(size(), 2), carried], ..Options::default() };
        let error = fill(&images(2), mask(), &options).unwrap_err();
        assert!(error.to_string().contains("of another frame"), "{error}");
    }
    let full = Mask::from_fn(tall, |_, _| true);
    assert!(Carried::new(size(), (&images(2), &full), 1, |_| [0.0; 2]).is_err());
    assert!(from(size(), 2).guided(&[Plane::filled(tall, 1.0)]).is_err());
}

#[test]
fn the_line_of_a_wrong_size_names_what_is_wrong() {
    let options =
        Options { weights: Some(Arc::new(Plane::filled(Size::new(3, 4), 1.0))), ..Options::default() };
    let line = fill(&images(1), mask(), &options).unwrap_err().to_string();
    assert_eq!(line, "expected 31x24 pixels, found weights of 4x3");
}

#[test]
fn only_the_ratios_of_weights_matter() {
    let smooth = Method::named("ss", &[("lambda", "0.1")]).unwrap();
    let counts = Plane::from_fn(size(), |y, x| ((y + x) % 4) as f32);
    let with = |factor: f32| {
        let weights = Plane::from_fn(size(), |y, x| counts.at(y, x) * factor);
        let options = Options { weights: Some(Arc::new(weights)), ..Options::of(smooth.clone()) };
        fill(&images(1), mask(), &options)
    };
    let (one, four) = (with(1.0).unwrap(), with(4.0).unwrap());
    assert_eq!(bits(&one.planes.as_slice()[0]), bits(&four.planes.as_slice()[0]));
    let none = (0..size().pixels()).filter(|&at| mask().as_slice()[at] && counts.pixels()[at] == 0.0).count();
    assert_eq!((one.sets[0].weightless, none > 0), (none, true));
    assert_eq!(with(0.0).unwrap_err(), Error::NothingWeighs);
}

#[test]
fn bounds_are_those_of_the_values_unless_they_are_given() {
    let light = Options::default();
    let other = Options { values: Values::Other, ..Options::default() };
    let given = Options { bounds: vec![Bounds::Unit, Bounds::Free], ..Options::default() };
    assert_eq!([light.bounds_of(1), other.bounds_of(0)], [Bounds::Positive, Bounds::Free]);
    assert_eq!([given.bounds_of(0), given.bounds_of(1)], [Bounds::Unit, Bounds::Free]);
}
