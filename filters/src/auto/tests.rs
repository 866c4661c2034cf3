//! What the choice promises: it is never far behind the best candidate, keeps what was measured, and depends on no thread.

#![allow(clippy::float_cmp, reason = "where bits are promised, bits are compared")]

use std::sync::atomic::{AtomicUsize, Ordering};

use super::*;
use crate::baseline::testing::with_threads;
use crate::estimate::Verdict;
use crate::fill::{Estimate, Options};
use crate::sampling::{Field as Place, Pattern, Temporal, mask as generate};
use crate::{Method, Plane, Size, fill};

const SIZE: Size = Size::new(150, 170);

fn mask(density: f64) -> Arc<Mask> {
    let field = Place { x: 0, y: 0, size: SIZE };
    Arc::new(generate(Pattern::Shuffle, field, density, 3, Temporal::Fixed, 0).unwrap())
}

/// A number between 0 and 1 without a pattern.
fn noise(row: usize, column: usize) -> f32 {
    lacuna_core::mix((row * 4096 + column) as u64) as f32 / u64::MAX as f32
}

/// A wave.
fn smooth(row: usize, column: usize) -> f32 {
    0.5 + 0.2 * (0.09 * row as f32).sin() * (0.07 * column as f32).cos()
}

/// Flat regions, which total variation is made for.
fn flat(row: usize, column: usize) -> f32 {
    let (v, u) = (row as f32, column as f32);
    if (0.37 * v + 0.93 * u) % 31.0 < 14.0 { 0.8 } else { 0.2 + 0.02 * noise(row / 40, column / 40) }
}

fn scenes() -> [(&'static str, Planes); 3] {
    let half = |row, column| if column < SIZE.width / 2 { smooth(row, column) } else { flat(row, column) };
    let image =
        |value: &dyn Fn(usize, usize) -> f32| Planes::new(SIZE, vec![Plane::from_fn(SIZE, value)]).unwrap();
    [("smooth", image(&smooth)), ("flat", image(&flat)), ("half", image(&half))]
}

/// The sum of squared errors.
fn error(truth: &Planes, image: &Planes) -> f64 {
    let pairs = truth.as_slice()[0].pixels().iter().zip(image.as_slice()[0].pixels());
    pairs.map(|(a, b)| f64::from(a - b).powi(2)).sum()
}

fn by(filter: &dyn Filter, truth: &Planes, mask: &Arc<Mask>) -> Planes {
    let (run, mut out) = (Run::default(), Planes::zeros(SIZE, truth.len()));
    filter.plan(&Problem::fill(Arc::clone(mask)), &run).unwrap().reconstruct(truth, &mut out, &run).unwrap();
    out
}

#[test]
fn it_is_never_far_behind_the_best_and_keeps_what_was_measured() {
    for density in [0.1, 0.2, 0.5] {
        let mask = mask(density);
        for (name, truth) in scenes() {
            let chosen = by(&Settings, &truth, &mask);
            let alone = candidates().map(|(_, filter)| error(&truth, &by(filter.as_ref(), &truth, &mask)));
            let best = alone.iter().copied().fold(f64::INFINITY, f64::min);
            let behind = 10.0 * (error(&truth, &chosen) / best).log10();
            assert!(behind < 0.15, "{name} at {density}: {behind} dB behind");
            let kept = mask
                .as_slice()
                .iter()
                .zip(truth.as_slice()[0].pixels().iter().zip(chosen.as_slice()[0].pixels()));
            assert!({ kept }.filter(|(flag, _)| **flag).all(|(_, (a, b))| a == b), "{name}");
        }
    }
}

/// Two candidates miss lamps, each a part of its own. By their errors, as displays show them, a mean of both would be better; it is one of
/// logarithms, though, and dark.
#[test]
fn a_blend_that_is_worse_than_the_best_gives_way_to_it() {
    let mask = mask(0.2);
    let samples = Planes::new(SIZE, vec![Plane::filled(SIZE, 7.6)]).unwrap();
    let map = Map::Log { scale: 1e-3 };
    let at: Vec<u32> =
        (0..).zip(mask.as_slice()).filter(|(_, flag)| **flag).map(|(pixel, _)| pixel).collect();
    let missing = |part: std::ops::Range<u64>| {
        let one = |pixel: &u32| {
            if part.contains(&(lacuna_core::mix(u64::from(*pixel)) % 100)) { 0.0 } else { 7.6 }
        };
        HeldOut { predicted: vec![at.iter().map(one).collect()], at: at.clone(), variance: Vec::new() }
    };
    let held = [missing(0..34), missing(34..65)];
    let chosen = |map: Map| {
        let truth = Truth { mask: &mask, voronoi: None, samples: &samples, map, less: 1.0 };
        blend_or_best(&truth, &held, BETTER)
    };
    let (weights, near) = chosen(map);
    assert_eq!(weights.alone(), Some(1));
    assert_eq!(weights.share(1), 1.0);
    assert_eq!(near, held[1]);
    // Of the values themselves the mean is better.
    assert_eq!(chosen(Map::Linear).0.alone(), None);
}

#[test]
fn an_image_to_start_from_changes_no_bit_and_serves_most_candidates() {
    let (mask, [.., (_, truth)], run) = (mask(0.2), scenes(), Run::default());
    let plan = |name: &str| {
        let (_, filter) =
            { candidates().into_iter() }.find(|(descriptor, _)| descriptor.name == name).unwrap();
        (filter.start(), filter.plan(&Problem::fill(Arc::clone(&mask)), &run).unwrap())
    };
    let fill = |plan: &dyn Plan, error: Option<f64>| {
        let mut out = Planes::zeros(SIZE, truth.len());
        match error {
            Some(error) => plan.reconstruct_roughly(&truth, error, &mut out, &run).unwrap(),
            None => plan.reconstruct(&truth, &mut out, &run).unwrap(),
        };
        out
    };
    for (name, error) in ["cnn", "edge"].into_iter().flat_map(|name| [(name, None), (name, Some(HELD_OUT))]) {
        let (start, own) = plan(name);
        let mut out = fill(plan(start.unwrap()).1.as_ref(), error);
        own.reconstruct_from_start(&truth, error, &mut out, &run).unwrap();
        assert_eq!(out, fill(own.as_ref(), error), "{name} {error:?}");
    }
    assert_eq!(plan("ss").0, None);
}

#[test]
fn threads_change_no_bit() {
    let mask = mask(0.2);
    let [.., (_, truth)] = scenes();
    let one = with_threads(1, || by(&Settings, &truth, &mask));
    assert_eq!(one, with_threads(3, || by(&Settings, &truth, &mask)));
}

#[test]
fn plain_splines_are_left_when_the_time_is_up() {
    let [_, (_, truth), _] = scenes();
    let mask = mask(0.2);
    let plain = by(&ss::Settings::default(), &truth, &mask);
    let plan = Settings.plan(&Problem::fill(Arc::clone(&mask)), &Run::default()).unwrap();
    let asked = AtomicUsize::new(0);
    let mut until = 0;
    loop {
        asked.store(0, Ordering::Relaxed);
        let stop = || (asked.fetch_add(1, Ordering::Relaxed) >= until).then_some(Stop::TimeLimit);
        let mut out = Planes::zeros(SIZE, 1);
        let outcome = plan.reconstruct(&truth, &mut out, &Run { interrupt: Some(&stop) }).unwrap();
        if outcome.stop == Stop::Converged {
            break;
        }
        assert_eq!(outcome.stop, Stop::TimeLimit);
        assert!(out.as_slice()[0].pixels() == plain.as_slice()[0].pixels(), "{until}");
        until = until * 2 + 1;
    }
    assert!(until > 30, "{until}");
}

#[test]
fn guides_are_a_candidate_like_the_others() {
    let mask = mask(0.2);
    // A texture that nothing between samples tells, and a guide that shows it.
    let texture = |row: usize, column: usize| 0.2 + 0.6 * noise(row / 2, column / 3);
    let truth = Planes::new(SIZE, vec![Plane::from_fn(SIZE, texture)]).unwrap();
    let mut guides = Guides::new(SIZE);
    guides.add("albedo", vec![Plane::from_fn(SIZE, |row, column| 1.0 - texture(row, column))]).unwrap();
    let mut options = Options::of(Method::from(Settings));
    let plain = fill(&truth, Arc::clone(&mask), &options).unwrap();
    (options.guides, options.estimate) = (Some(&guides), Estimate::Figure);
    let guided = fill(&truth, Arc::clone(&mask), &options).unwrap();
    let share = guided.sets[0].shares.iter().find(|(name, _)| *name == "guided").unwrap().1;
    assert!(share > 0.8, "{share}");
    assert!(error(&truth, &guided.planes) < 0.01 * error(&truth, &plain.planes));
    assert_eq!(guided.sets[0].guides, ["albedo"]);
    assert!(guided.sets[0].estimate.is_some());
}

#[test]
fn large_images_try_candidates_on_tiles() {
    let size = Size::new(900, 940);
    let field = Place { x: 0, y: 0, size };
    let mask = Arc::new(generate(Pattern::Shuffle, field, 0.2, 3, Temporal::Fixed, 0).unwrap());
    let all: Vec<Candidate<'_>> = { candidates().into_iter() }.map(Candidate::of).collect();
    let try_on = |mask: &Mask, image: &dyn Fn(usize, usize) -> f32| {
        let truth = Planes::new(size, vec![Plane::from_fn(size, image)]).unwrap();
        let stage = Stage::new(mask, Folds::default())?;
        Some(stage.try_out(&all, (&truth, Map::Linear), true, &Run::default()).unwrap())
    };
    // One is clearly best.
    let trial = try_on(&mask, &smooth).unwrap();
    assert!(trial.names.len() == 1 && trial.names[0] != "tv", "{:?}", trial.names);
    // What it errs by is known of the tiles: a tenth of the samples inside them.
    let [own, splines] = trial.alone.unwrap();
    assert_eq!(own.at, splines.at);
    assert!((2700..3200).contains(&own.at.len()), "{}", own.at.len());
    assert!(own.at.iter().all(|&pixel| Folds::default().part(pixel as usize) == 0));
    // Several count: with each what it starts from.
    let halves = |row, column| if column < 470 { smooth(row, column) } else { flat(row, column) };
    let trial = try_on(&mask, &halves).unwrap();
    assert!(trial.alone.is_none());
    let found = trial.names;
    assert!(found.contains(&"tv") && found.len() > 2, "{found:?}");
    for candidate in all.iter().filter(|candidate| found.contains(&candidate.name)) {
        assert!(candidate.filter.start().is_none_or(|start| found.contains(&start)), "{found:?}");
    }
    let few = Arc::new(Mask::from_fn(size, |row, column| row % 200 == 0 && column % 200 == 0));
    assert!(try_on(&few, &smooth).is_none());
}

/// A large image that one candidate fills alone: the bits are that one's, whether its error is learned or not, and the error is about the true one.
#[test]
fn one_candidate_alone_is_judged_by_tiles() {
    let size = Size::new(900, 940);
    let field = Place { x: 0, y: 0, size };
    let mask = Arc::new(generate(Pattern::Shuffle, field, 0.2, 3, Temporal::Fixed, 0).unwrap());
    // Discs with steep rims, on shading.
    let disc = |row: usize, column: usize| {
        let (y, x) = ((row % 90) as f32 - 45.0, (column % 100) as f32 - 50.0);
        let rim = (1.5 * (30.0 - (y * y + x * x).sqrt())).clamp(-8.0, 8.0);
        0.3 * smooth(row, column) + 0.6 / (1.0 + (-rim).exp())
    };
    let truth = Planes::new(size, vec![Plane::from_fn(size, disc)]).unwrap();
    let mut options = Options::of(Method::from(Settings));
    let plain = fill(&truth, Arc::clone(&mask), &options).unwrap();
    options.estimate = Estimate::Figure;
    let judged = fill(&truth, Arc::clone(&mask), &options).unwrap();
    assert_eq!(plain.planes, judged.planes);
    let [(name, share)] = judged.sets[0].shares[..] else { panic!("{:?}", judged.sets[0].shares) };
    assert_eq!(share, 1.0);
    let (_, filter) = { candidates().into_iter() }.find(|(descriptor, _)| descriptor.name == name).unwrap();
    let plan = filter.plan(&Problem::fill(Arc::clone(&mask)), &Run::default()).unwrap();
    let mut own = Planes::zeros(size, 1);
    plan.reconstruct(&truth, &mut own, &Run::default()).unwrap();
    let missing = |image: &Planes| {
        let pixels =
            image.as_slice()[0].pixels().iter().zip(truth.as_slice()[0].pixels()).zip(mask.as_slice());
        let squares = pixels.filter(|(_, flag)| !**flag).map(|((a, b), _)| f64::from(a - b).powi(2));
        (squares.sum::<f64>() / (size.pixels() - mask.count()) as f64).sqrt()
    };
    // The limiter is all that comes after.
    assert!((missing(&judged.planes) / missing(&own) - 1.0).abs() < 0.05);
    let Some(Verdict::Estimate(told)) = judged.sets[0].estimate else {
        panic!("{:?}", judged.sets[0].estimate)
    };
    let off: f64 = 20.0 * (told.rmse / missing(&judged.planes)).log10();
    assert!(off.abs() < 2.0, "{off} dB of {} by {name}", missing(&judged.planes));
}

/// Around lamps a spline through logarithms glows, which displays show, and total variation does not: what errs less by logarithms is not taken for it.
#[test]
fn lamps_are_judged_as_displays_show_them() {
    let lamp = |row: usize, column: usize| (row % 48).abs_diff(24) < 7 && (column % 48).abs_diff(24) < 9;
    let light =
        |row: usize, column: usize| if lamp(row, column) { 900.0 } else { 0.1 + 0.05 * smooth(row, column) };
    let truth = Planes::new(SIZE, vec![Plane::from_fn(SIZE, light)]).unwrap();
    let mask = mask(0.5);
    let chosen = fill(&truth, Arc::clone(&mask), &Options::of(Method::from(Settings))).unwrap();
    let map = chosen.sets[0].map;
    assert!(!map.is_linear());
    let each = |planes: &Planes, change: &dyn Fn(f32) -> f32| {
        let values = planes.as_slice()[0].pixels().iter().map(|value| change(*value)).collect();
        Planes::of(SIZE, vec![Plane::of(SIZE, values)])
    };
    let by_logarithms = each(&by(&Settings, &each(&truth, &|v| map.forward(v)), &mask), &|u| map.inverse(u));
    let shown =
        |image: &Planes| error(&each(&truth, &|v| v.clamp(0.0, 1.0)), &each(image, &|v| v.clamp(0.0, 1.0)));
    let [found, other] = [&chosen.planes, &by_logarithms].map(shown);
    assert!(found < 0.7 * other, "{found} {other}");
}

#[test]
fn few_samples_are_for_splines() {
    let truth = scenes()[0].1.clone();
    let few = Arc::new(Mask::from_fn(SIZE, |row, column| row % 40 == 0 && column % 40 == 0));
    assert_eq!(by(&Settings, &truth, &few), by(&ss::Settings::default(), &truth, &few));
    assert_eq!(fill(&truth, few, &Options::default()).unwrap().sets[0].shares, [("ss", 1.0)]);
}
