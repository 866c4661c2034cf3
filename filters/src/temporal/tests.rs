//! What other frames bring: all of what they measured where nothing moves, more than a frame alone knows along its motion, and nothing worse where
//! they show something else.

#![allow(clippy::float_cmp, reason = "where bits are promised, bits are compared")]

use std::sync::Arc;
use std::sync::atomic::{AtomicUsize, Ordering};

use super::*;
use crate::baseline::testing::with_threads;
use crate::fill::{Estimate, fill_with};
use crate::sampling::{Field as Place, Pattern, Temporal, mask as generate};
use crate::variational::ss;
use crate::{Options, Plans, Size, fill};

const SIZE: Size = Size::new(96, 112);

fn masks(temporal: Temporal) -> Vec<Arc<Mask>> {
    let field = Place { x: 0, y: 0, size: SIZE };
    let one = |k: i64| Arc::new(generate(Pattern::Shuffle, field, 0.2, 3, temporal, k).unwrap());
    (0..5).map(one).collect()
}

/// Fine waves and an edge, moved by so many pixels.
fn scene(dy: f32, dx: f32) -> Planes {
    let value = |y: usize, x: usize| {
        let (y, x) = (y as f32 - dy, x as f32 - dx);
        let disc = if (y - 50.0).hypot(x - 60.0) < 25.0 { 0.3 } else { 0.0 };
        0.4 + disc + 0.1 * (0.9 * y).sin() * (0.7 * x).cos() + 0.1 * ((0.5 * x + 0.8 * y) / 1.3).sin()
    };
    Planes::new(SIZE, vec![Plane::from_fn(SIZE, value)]).unwrap()
}

fn at(pixel: usize) -> [f32; 2] {
    [(pixel / SIZE.width) as f32, (pixel % SIZE.width) as f32]
}

/// The mean squared error.
fn error(a: &Planes, b: &Planes) -> f64 {
    let pairs = a.as_slice()[0].pixels().iter().zip(b.as_slice()[0].pixels());
    pairs.map(|(a, b)| f64::from(a - b).powi(2)).sum::<f64>() / SIZE.pixels() as f64
}

/// Samples of the frames beside the third of five: `shows(k)` is what frame `k` shows, `moves(k)` how far they have to be carried.
fn carried(
    masks: &[Arc<Mask>],
    shows: impl Fn(usize) -> Planes,
    moves: impl Fn(usize) -> [f32; 2],
) -> Vec<Carried> {
    let one = |k: usize| {
        let [dy, dx] = moves(k);
        let place = |pixel: usize| [at(pixel)[0] + dy, at(pixel)[1] + dx];
        Carried::new(SIZE, (&shows(k), &masks[k]), k as i32 - 2, place).unwrap()
    };
    [0, 1, 3, 4].map(one).into()
}

/// The third of five frames, filled with samples of the others.
fn filled(
    masks: &[Arc<Mask>],
    shows: impl Fn(usize) -> Planes,
    moves: impl Fn(usize) -> [f32; 2],
) -> (Planes, Option<f64>) {
    let carried = carried(masks, &shows, moves);
    let options = Options { carried: &carried, ..Options::default() };
    let mut filled = fill(&shows(2), Arc::clone(&masks[2]), &options).unwrap();
    (filled.planes, filled.sets.remove(0).along)
}

fn alone(mask: &Arc<Mask>, samples: &Planes) -> Planes {
    fill(samples, Arc::clone(mask), &Options::default()).unwrap().planes
}

#[test]
fn frames_of_a_still_scene_that_cover_every_pixel_give_every_pixel() {
    let masks = masks(Temporal::Complementary);
    let truth = scene(0.0, 0.0);
    let (image, gain) = filled(&masks, |_| truth.clone(), |_| [0.0; 2]);
    assert!(gain.is_some_and(|gain| gain > 0.5), "{gain:?}");
    let pairs = image.as_slice()[0].pixels().iter().zip(truth.as_slice()[0].pixels());
    let top = pairs.fold(0.0, |top: f32, (a, b)| top.max((a - b).abs()));
    // Half a unit of the last place of half floats between 0.5 and 1.
    assert!(top < 2.4e-4, "{top}");
}

#[test]
fn a_pattern_that_moves_is_known_better_along_its_motion() {
    let masks = masks(Temporal::Complementary);
    let shift = |k: usize| [0.7 * (k as f32 - 2.0), -1.3 * (k as f32 - 2.0)];
    let shows = |k: usize| scene(shift(k)[0], shift(k)[1]);
    let (image, _) = filled(&masks, shows, |k| shift(k).map(|at| -at));
    let (own, with) = (error(&alone(&masks[2], &shows(2)), &shows(2)), error(&image, &shows(2)));
    assert!(with < own / 2.0, "{with} of {own}");
    let samples = shows(2);
    let measured = masks[2].as_slice().iter().zip(samples.as_slice()[0].pixels());
    let kept = measured.zip(image.as_slice()[0].pixels());
    assert!(kept.filter(|((flag, _), _)| **flag).all(|((_, a), b)| a == b));
}

#[test]
fn the_frame_alone_or_plain_splines_are_left_when_the_time_is_up() {
    let masks = masks(Temporal::Complementary);
    let shows = |k: usize| scene(0.7 * (k as f32 - 2.0), 0.0);
    let carried = carried(&masks, shows, |k| [-0.7 * (k as f32 - 2.0), 0.0]);
    let options = Options { carried: &carried, estimate: Estimate::No, ..Options::default() };
    let splines =
        Options { method: ss::Settings::default().into(), estimate: Estimate::No, ..Options::default() };
    let plain = fill(&shows(2), Arc::clone(&masks[2]), &splines).unwrap().planes;
    let alone = alone(&masks[2], &shows(2));
    let (mut until, mut left) = (0, [0; 2]);
    loop {
        let asked = AtomicUsize::new(0);
        let stop = || (asked.fetch_add(1, Ordering::Relaxed) >= until).then_some(Stop::TimeLimit);
        let run = Run { interrupt: Some(&stop) };
        let filled = fill_with(&shows(2), &masks[2], &options, &Plans::new(), &run).unwrap();
        if filled.sets[0].outcome.stop != Stop::TimeLimit {
            break;
        }
        let is = [&plain, &alone].map(|image| *image == filled.planes);
        assert!(is[0] || is[1], "{until}");
        left[usize::from(is[1])] += 1;
        until += until / 4 + 1;
    }
    assert!(left[0] > 2 && left[1] > 2, "{left:?}");
}

#[test]
fn what_shows_something_else_costs_nothing() {
    for temporal in [Temporal::Complementary, Temporal::Fixed] {
        let masks = masks(temporal);
        let truth = scene(0.0, 0.0);
        let own = error(&alone(&masks[2], &truth), &truth);
        let bound = own * 10.0_f64.powf(0.01);
        // A cut, a wrong motion, a wrong sign.
        let other = scene(31.0, 17.0);
        let cut = filled(&masks, |k| if k == 2 { truth.clone() } else { other.clone() }, |_| [0.0; 2]).0;
        let wrong = filled(&masks, |_| truth.clone(), |k| [2.5 * (k as f32 - 2.0), 3.0]).0;
        let sign =
            filled(&masks, |k| scene(0.0, 2.0 * (k as f32 - 2.0)), |k| [0.0, 2.0 * (k as f32 - 2.0)]).0;
        // What moves, taken for still.
        let still = filled(&masks, |k| scene(0.4 * (k as f32 - 2.0), 0.9 * (k as f32 - 2.0)), |_| [0.0; 2]).0;
        for (name, image) in [("cut", cut), ("wrong", wrong), ("sign", sign), ("still", still)] {
            let with = error(&image, &truth);
            assert!(with <= bound, "{name}: {with}, alone {own}");
        }
    }
}

#[test]
fn light_that_changes_is_levelled() {
    let masks = masks(Temporal::Complementary);
    let truth = scene(0.0, 0.0);
    let shows = |k: usize| {
        let (time, plane) = (k as f32 - 2.0, &truth.as_slice()[0]);
        let lit =
            |y: usize, x: usize| plane.at(y, x) * (1.0 + 0.2 * time * (0.05 * x as f32).sin()) + 0.05 * time;
        Planes::new(SIZE, vec![Plane::from_fn(SIZE, lit)]).unwrap()
    };
    let (image, gain) = filled(&masks, shows, |_| [0.0; 2]);
    let (own, with) = (error(&alone(&masks[2], &truth), &truth), error(&image, &truth));
    assert!(with < own / 3.0, "{with} of {own}, {gain:?}");
}

/// With one measured pixel that is far too bright, another one in each frame.
fn hot(planes: Planes, mask: &Mask, frame: usize) -> Planes {
    let mut planes = planes;
    let at = (0..SIZE.pixels()).filter(|&at| mask.as_slice()[at]).nth(700 + 211 * frame).unwrap();
    planes.as_mut_slice()[0].pixels_mut()[at] = 100.0;
    planes
}

#[test]
fn one_hot_pixel_of_each_frame_does_not_decide() {
    let masks = masks(Temporal::Complementary);
    let shift = |k: usize| [0.7 * (k as f32 - 2.0), -1.3 * (k as f32 - 2.0)];
    let back = |k: usize| shift(k).map(|at| -at);
    let clean = |k: usize| scene(shift(k)[0], shift(k)[1]);
    let spoiled = |k: usize| hot(clean(k), &masks[k], k);
    let samples = spoiled(2);
    let splines = Options { limit: false, ..Options::of(ss::Settings::default()) };
    let image = fill(&samples, Arc::clone(&masks[2]), &splines).unwrap().planes;
    let cut = |k: usize| hot(scene(shift(k)[0] + 31.0, 17.0), &masks[k], k);
    for (same, other) in carried(&masks, spoiled, back).iter().zip(&carried(&masks, cut, back)) {
        assert!(explained(same, &image) > 0.7 && explained(other, &image) < 0.3);
    }
    // But for the surroundings of the hot pixel.
    let truth = clean(2);
    let at = samples.as_slice()[0].pixels().iter().position(|value| *value > 50.0).unwrap();
    let error = |image: &Planes| {
        let mut image = image.clone();
        let near = |pixel: &usize| {
            (pixel / SIZE.width).abs_diff(at / SIZE.width).max((pixel % SIZE.width).abs_diff(at % SIZE.width))
                < 12
        };
        for pixel in (0..SIZE.pixels()).filter(near) {
            image.as_mut_slice()[0].pixels_mut()[pixel] = truth.as_slice()[0].pixels()[pixel];
        }
        error(&image, &truth)
    };
    let (with, own) = (error(&filled(&masks, spoiled, back).0), error(&alone(&masks[2], &samples)));
    let best = error(&filled(&masks, clean, back).0);
    assert!(with < own / 2.0 && with < 2.0 * best, "{with} of {own}, clean {best}");
}

#[test]
fn masks_that_are_the_same_promise_nothing() {
    // Other frames know the very pixels that this one knows: held-out samples must not be predicted by them.
    let masks = masks(Temporal::Fixed);
    let truth = scene(0.0, 0.0);
    let (image, _) = filled(&masks, |_| truth.clone(), |_| [0.0; 2]);
    let own = error(&alone(&masks[2], &truth), &truth);
    assert!(error(&image, &truth) <= own * 10.0_f64.powf(0.01));
}

#[test]
fn the_number_of_threads_changes_nothing() {
    let masks = masks(Temporal::Complementary);
    let run = |threads| {
        with_threads(threads, || {
            filled(&masks, |k| scene(0.0, 0.4 * k as f32), |k| [0.0, 0.4 * (2.0 - k as f32)]).0
        })
    };
    assert_eq!(run(1), run(3));
}

#[test]
fn samples_that_are_not_known_or_outside_are_left_out() {
    let size = Size::new(3, 4);
    let mask = Mask::from_fn(size, |_, _| true);
    let mut values = Plane::from_fn(size, |y, x| (4 * y + x) as f32);
    values.pixels_mut()[2] = f32::NAN;
    let samples = Planes::new(size, vec![values]).unwrap();
    let place = |pixel: usize| match pixel {
        0 => [f32::NAN, 0.0],
        1 => [0.0, f32::INFINITY],
        3 => [0.0, 3.6],
        4 => [-0.4, 0.0],
        5 => [1.0 + 1e-5, 2.0],
        6 => [1.0, -0.6],
        _ => [2.0, 2.5],
    };
    let carried = Carried::new(size, (&samples, &mask), 0, place).unwrap();
    assert_eq!(*carried.values[0], [4.0, 5.0, 7.0, 8.0, 9.0, 10.0, 11.0]);
    assert_eq!(carried.places[1], [1.0, 2.0]);
    assert!(!carried.is_still());
}
