//! Estimates against the truth, on frames and masks that nothing was tuned on.

use super::*;
use crate::descriptor::Kind;
use crate::estimate::{Folds, HeldOut, Repeated, Rounds};
use crate::excerpt::Excerpt;
use crate::sampling::{Field, Pattern, Temporal, mask as generate, refine};
use crate::variational::{ss, tv};
use crate::{Filter, Plane, Problem, Run};

/// Discs, a wave and a ramp.
fn scene(size: Size) -> Planes {
    let value = |y: usize, x: usize| {
        let (y, x) = (y as f32, x as f32);
        let disc = |cy: f32, cx: f32, r: f32| if (y - cy).hypot(x - cx) < r { 0.5 } else { 0.0 };
        0.1 * (0.15 * x).sin() + 0.002 * y + disc(50.0, 60.0, 30.0) + disc(95.0, 120.0, 22.0)
    };
    Planes::new(size, vec![Plane::from_fn(size, value)]).unwrap()
}

fn masks(size: Size) -> Vec<Arc<Mask>> {
    let field = Field { x: 0, y: 0, size };
    let one = |pattern, density| Arc::new(generate(pattern, field, density, 3, Temporal::Fixed, 0).unwrap());
    vec![one(Pattern::Shuffle, 0.2), one(Pattern::Random, 0.2), one(Pattern::BlueNoise, 0.4)]
}

fn fill(filter: &dyn Filter, samples: &Planes, mask: &Arc<Mask>) -> Planes {
    let (run, mut out) = (Run::default(), Planes::zeros(samples.size(), samples.len()));
    filter.plan(&Problem::fill(mask.clone()), &run).unwrap().reconstruct(samples, &mut out, &run).unwrap();
    out
}

/// The root mean square error of missing pixels.
fn truly(truth: &Planes, filled: &Planes, mask: &Mask) -> f64 {
    let pairs = truth.as_slice()[0].pixels().iter().zip(filled.as_slice()[0].pixels());
    let missing = pairs.zip(mask.as_slice()).filter(|(_, flag)| !**flag);
    let sum: f64 = missing.map(|((a, b), _)| f64::from(a - b).powi(2)).sum();
    (sum / (mask.size().pixels() - mask.count()) as f64).sqrt()
}

fn check(name: &str, model: &Model, right: f64) {
    let Verdict::Estimate(found) = model.verdict() else { panic!("{name}: {:?}", model.verdict()) };
    let off = 20.0 * (found.rmse / right).log10();
    assert!(off.abs() < 3.0, "{name}: {off} dB");
    assert!(found.low <= right && right <= found.high, "{name}: {right} in {found:?}");
    let plane = model.plane(None);
    let sum: f64 = plane.pixels().iter().map(|&error| f64::from(error).powi(2)).sum();
    let measured = plane.pixels().iter().zip(model.mask.as_slice()).filter(|(_, flag)| **flag);
    assert!(measured.clone().all(|(error, _)| *error == 0.0), "{name}");
    let mean = (sum / (model.mask.size().pixels() - model.mask.count()) as f64).sqrt();
    // Errors below rounding are 0 there.
    assert!((mean / found.rmse - 1.0).abs() < 1e-3, "{name}: {mean} of the plane for {}", found.rmse);
    assert!(f64::from(plane.pixels().iter().copied().fold(0.0, f32::max)) <= 1.1 * model.range, "{name}");
}

/// The share of the squared error that the tenth of the pixels has that is told to be worst.
fn worst_tenth(told: &Plane, truth: &Planes, filled: &Planes) -> f64 {
    let squared: Vec<f64> = (truth.as_slice()[0].pixels().iter().zip(filled.as_slice()[0].pixels()))
        .map(|(a, b)| f64::from(a - b).powi(2))
        .collect();
    let mut order: Vec<usize> = (0..squared.len()).collect();
    order.sort_by(|&a, &b| told.pixels()[b].total_cmp(&told.pixels()[a]));
    let worst: f64 = order[..order.len() / 10].iter().map(|&pixel| squared[pixel]).sum();
    worst / squared.iter().sum::<f64>()
}

#[test]
fn leave_one_out_errors_show_where_edges_are() {
    let size = Size::new(150, 180);
    // Edges stand as far apart as held-out samples, so that every neighbourhood of these has some.
    let rings = |y: usize, x: usize| if (y as f32).hypot(x as f32) % 30.0 < 15.0 { 0.2 } else { 0.7 };
    let truth = Planes::new(size, vec![Plane::from_fn(size, rings)]).unwrap();
    let filter = ss::Settings::default();
    let mask = &masks(size)[0];
    let model = learn(&filter, Kind::Spline, &truth, mask);
    let filled = fill(&filter, &truth, mask);
    let left_out = refine::estimate_spline(&truth, mask, &filter, &Run::default()).unwrap();
    let shaped = model.plane(Some(&|pixel| left_out.squared_error(pixel)));
    let [plain, shaped] = [model.plane(None), shaped].map(|told| worst_tenth(&told, &truth, &filled));
    assert!(shaped > plain + 0.05, "{plain} {shaped}");
}

/// What the folds of a filter's fill show.
fn learn(filter: &dyn Filter, kind: Kind, truth: &Planes, mask: &Arc<Mask>) -> Model {
    let mut again = |_: Option<&Excerpt>, samples: &Planes, mask: &Arc<Mask>| Ok(fill(filter, samples, mask));
    let (folds, run) = ((Folds { seed: 2 }, kind), Run::default());
    let rounds = Rounds { repeated: &Repeated::default(), are_colours: true };
    let evidence = Evidence::of_folds((truth, mask), None, folds, rounds, &mut again, &run).unwrap();
    Model::new(&evidence, truth, mask, 2)
}

#[test]
fn methods_know_how_wrong_they_are() {
    let truth = scene(Size::new(150, 180));
    let filters: [(&str, Kind, &dyn Filter); 2] =
        [("ss", Kind::Spline, &ss::Settings::default()), ("tv", Kind::Distance, &tv::Settings::default())];
    for (name, kind, filter) in filters {
        for (k, mask) in masks(truth.size()).iter().enumerate() {
            let model = learn(filter, kind, &truth, mask);
            check(&format!("{name} {k}"), &model, truly(&truth, &fill(filter, &truth, mask), mask));
        }
    }
}

/// Few samples everywhere, and many along edges.
fn chosen(truth: &Planes, seed: u64) -> Arc<Mask> {
    let plane = &truth.as_slice()[0];
    let Size { height, width } = plane.size();
    let is_edge = |y: usize, x: usize| {
        let (low, high) =
            ((y.saturating_sub(2), x.saturating_sub(2)), ((y + 2).min(height - 1), (x + 2).min(width - 1)));
        (plane.at(low.0, low.1) - plane.at(high.0, high.1)).abs() > 0.3
            || (plane.at(low.0, high.1) - plane.at(high.0, low.1)).abs() > 0.3
    };
    let share = |y, x| if is_edge(y, x) { 0.5 } else { 0.08 };
    let chance = |y: usize, x: usize| hash(seed, (y * width + x) as u64) as f64 / u64::MAX as f64;
    Arc::new(Mask::from_fn(plane.size(), |y, x| chance(y, x) < share(y, x)))
}

#[test]
fn samples_that_were_put_where_errors_are_do_not_speak_for_all() {
    let truth = scene(Size::new(150, 180));
    for seed in 1..5 {
        let (filter, mask) = (ss::Settings::default(), chosen(&truth, seed));
        let model = learn(&filter, Kind::Spline, &truth, &mask);
        assert!(model.owned.is_some(), "{seed}");
        let Verdict::Estimate(found) = model.verdict() else { panic!("{:?}", model.verdict()) };
        let off = 20.0 * (found.rmse / truly(&truth, &fill(&filter, &truth, &mask), &mask)).log10();
        assert!(off.abs() < 3.0, "{seed}: {off} dB");
    }
    let random = masks(truth.size()).swap_remove(1);
    assert!(learn(&ss::Settings::default(), Kind::Spline, &truth, &random).owned.is_none());
}

#[test]
fn samples_of_a_lattice_say_less() {
    let size = Size::new(130, 170);
    let truth = scene(size);
    let mask = Arc::new(Mask::from_fn(size, |y, x| y % 2 == 0 && x % 2 == 0));
    let model = learn(&ss::Settings::default(), Kind::Spline, &truth, &mask);
    let told = |model: &Model| match model.verdict() {
        Verdict::Estimate(found) => found,
        other => panic!("{other:?}"),
    };
    let (own, other) = (told(&model), told(&Model { is_lattice: false, ..model.clone() }));
    assert!(own.rmse.to_bits() == other.rmse.to_bits() && own.high > 1.04 * other.high, "{own:?} {other:?}");
}

#[test]
fn what_cannot_be_told_is_not() {
    let size = Size::new(40, 40);
    let verdict = |truth: &Planes, mask: &Arc<Mask>| {
        learn(&ss::Settings::default(), Kind::Spline, truth, mask).verdict()
    };
    let few = Arc::new(Mask::from_fn(size, |row, column| row % 9 == 0 && column % 9 == 0));
    assert_eq!(verdict(&scene(size), &few), Verdict::CannotTell(Why::FewSamples));
    let some = Arc::new(Mask::from_fn(size, |row, column| (3 * row + column) % 7 == 0));
    let spark =
        Plane::from_fn(size, |row, column| if (row, column) == (14, 14) { 1e3 } else { 0.01 * row as f32 });
    let spark = Planes::new(size, vec![spark]).unwrap();
    assert_eq!(verdict(&spark, &some), Verdict::CannotTell(Why::FewCarryAll));
    let full = Arc::new(Mask::from_fn(size, |_, _| true));
    assert!(matches!(verdict(&scene(size), &full), Verdict::Estimate(Rmse { rmse: 0.0, .. })));
}

/// As many as were held out may err by nothing, and one of a hundred pixels by all of the range.
#[test]
fn where_no_error_is_seen_it_has_a_bound() {
    let size = Size::new(130, 150);
    let mask = &masks(size)[1];
    let flat = |spark: Option<usize>| {
        let value = |y: usize, x: usize| if Some(y * size.width + x) == spark { 1.0 } else { 0.25 };
        let truth = Planes::new(size, vec![Plane::from_fn(size, value)]).unwrap();
        let held = masked_near(mask);
        let near = HeldOut { predicted: vec![vec![0.25; held.0.len()]], at: held.0, variance: held.1 };
        let evidence = Evidence::new(Kind::Distance, Folds { seed: 2 }, &near, &near, &near);
        Model::new(&evidence, &truth, mask, 2)
    };
    let exact = |model: &Model| model.verdict() == Verdict::Estimate(Rmse { rmse: 0.0, low: 0.0, high: 0.0 });
    assert!(exact(&flat(None)));
    // A sample that is another, and was not held out.
    let spark = (0..).zip(mask.as_slice()).find(|(pixel, flag)| **flag && pixel % 3 != 0).unwrap().0;
    let model = flat(Some(spark));
    let bound = 0.75 * (3.0 / model.held.len() as f64).sqrt();
    assert_eq!(model.verdict(), Verdict::AtMost(bound));
    let plane = model.plane(None);
    let told = plane.pixels().iter().zip(mask.as_slice());
    assert!(told.into_iter().all(|(error, flag)| *error == if *flag { 0.0 } else { bound as f32 }));
}

/// A third of the samples, as if held out, and variances.
fn masked_near(mask: &Mask) -> (Vec<u32>, Vec<f32>) {
    let at = pixels_where(mask, |measured, pixel| measured && pixel % 3 == 0);
    let variance = vec![1.0; at.len()];
    (at, variance)
}

/// Samples in islands say nothing of what lies between them, least of all that it is wrong by more than any value could be.
#[test]
fn no_error_is_larger_than_the_range_of_the_samples() {
    let size = Size::new(200, 220);
    let (truth, filter) = (scene(size), ss::Settings::default());
    for (side, step) in [(6, 40), (8, 50), (12, 100), (30, 200)] {
        let mask = Arc::new(Mask::from_fn(size, |row, column| row % step < side && column % step < side));
        let model = learn(&filter, Kind::Spline, &truth, &mask);
        match model.verdict() {
            Verdict::Estimate(Rmse { high, .. }) | Verdict::AtMost(high) => {
                assert!(high <= model.range, "{side} {step}: {high} of {}", model.range);
            }
            Verdict::CannotTell(_) => {}
        }
    }
}

#[test]
fn errors_of_other_frames_go_less_by_the_pattern_of_this_one() {
    let at = |ln_variance: f32| PixelError { pixel: 0, squared: 1.0, ln_variance, weight: 1.0 };
    let (held, missing) = ([at(0.1), at(0.3)], [at(-0.9), at(-0.3)]);
    let of = |own: f64| of_part(1.5, own, &held, &missing);
    // The means are 0.8 apart.
    let whole = (-1.5_f64 * 0.8).exp();
    let half = (0.5 * whole + 0.5 * whole.powf(OTHERS)).ln() / -0.8;
    for (own, exact) in [(1.0, 1.5), (0.0, 1.5 * OTHERS), (0.5, half)] {
        assert!((of(own) - exact).abs() < 1e-6, "{own}");
    }
    // Where nothing is emptier, or noise decides, there is nothing to tell apart.
    assert_eq!(of_part(1.5, 0.3, &held, &held), 1.5);
    assert_eq!(of_part(0.0, 0.3, &held, &missing), 0.0);
}
