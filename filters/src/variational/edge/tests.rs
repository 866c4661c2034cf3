//! What edge-enhancing splines promise: exact samples, planes, joint edges, symmetry, and the contracts of every filter.

#![allow(clippy::float_cmp, reason = "where bits are promised, bits are compared")]

use std::sync::Arc;
use std::sync::atomic::{AtomicUsize, Ordering};

use super::Settings;
use crate::baseline::testing::with_threads;
use crate::variational::ss;
use crate::{Error, Filter, Mask, Outcome, Plane, Planes, Problem, Run, Size, Stop};

/// A low-discrepancy mask.
fn mask(size: Size, density: f64) -> Arc<Mask> {
    let part = |y: usize, x: usize| (x as f64 * 0.754_877_666 + y as f64 * 0.569_840_291 + 0.618).fract();
    Arc::new(Mask::from_fn(size, |y, x| part(y, x) < density))
}

/// A shaded disc before a ramp.
fn disc(size: Size) -> Plane {
    let (cy, cx) = (0.47 * size.height as f64, 0.52 * size.width as f64);
    let radius = 0.31 * size.height.min(size.width) as f64;
    Plane::from_fn(size, |y, x| {
        let (v, u) = ((y as f64 - cy) / radius, (x as f64 - cx) / radius);
        let inside = u * u + v * v < 1.0;
        (if inside { 0.8 - 0.2 * u + 0.1 * v * v } else { 0.1 + 0.002 * x as f64 }) as f32
    })
}

fn fill(filter: &dyn Filter, mask: &Arc<Mask>, planes: Vec<Plane>, run: &Run<'_>) -> (Planes, Outcome) {
    let samples = Planes::new(mask.size(), planes).unwrap();
    let mut out = Planes::zeros(mask.size(), samples.len());
    let plan = filter.plan(&Problem::fill(Arc::clone(mask)), run).unwrap();
    let outcome = plan.reconstruct(&samples, &mut out, run).unwrap();
    (out, outcome)
}

fn edge(mask: &Arc<Mask>, planes: Vec<Plane>) -> Vec<Plane> {
    fill(&Settings::default(), mask, planes, &Run::default()).0.into_vec()
}

fn splines(mask: &Arc<Mask>, plane: Plane) -> Plane {
    fill(&ss::Settings::default(), mask, vec![plane], &Run::default()).0.into_vec().remove(0)
}

fn squared_error(one: &Plane, other: &Plane) -> f64 {
    one.pixels().iter().zip(other.pixels()).map(|(a, b)| f64::from(a - b).powi(2)).sum()
}

fn largest_difference(one: &Plane, other: &Plane) -> f32 {
    one.pixels().iter().zip(other.pixels()).map(|(a, b)| (a - b).abs()).fold(0.0, f32::max)
}

/// From the side of a square, a row and a column to where that pixel comes from.
type Map = fn(usize, usize, usize) -> (usize, usize);

#[test]
fn edges_are_straighter_than_those_of_splines_and_samples_are_exact() {
    let size = Size::new(150, 170);
    for density in [0.2, 0.5] {
        let (mask, full) = (mask(size, density), disc(size));
        let out = edge(&mask, vec![full.clone()]).remove(0);
        let (own, other) = (squared_error(&out, &full), squared_error(&splines(&mask, full.clone()), &full));
        assert!(own < 0.8 * other, "{density}: {own} against {other}");
        let both = out.pixels().iter().zip(full.pixels()).zip(mask.as_slice());
        assert!(both.filter(|(_, measured)| **measured).all(|((a, b), _)| a.to_bits() == b.to_bits()));
    }
}

#[test]
fn smooth_images_are_left_to_splines() {
    let size = Size::new(90, 140);
    let mask = mask(size, 0.3);
    let wave = Plane::from_fn(size, |y, x| ((y as f64 / 30.0).sin() + (x as f64 / 40.0).cos()) as f32);
    let plane = Plane::from_fn(size, |y, x| 3.0 + 0.5 * y as f32 - 0.25 * x as f32);
    for smooth in [wave, plane, Plane::filled(size, 0.3)] {
        assert_eq!(edge(&mask, vec![smooth.clone()])[0], splines(&mask, smooth));
    }
}

#[test]
fn an_edge_of_one_channel_is_an_edge_of_all() {
    let size = Size::new(128, 128);
    let (mask, strong) = (mask(size, 0.2), disc(size));
    // By itself the ramp hides the disc.
    let faint = Plane::from_fn(size, |y, x| 0.005 * x as f32 + strong.at(y, x) / 256.0);
    let alone = edge(&mask, vec![faint.clone()]).remove(0);
    let joint = edge(&mask, vec![strong.clone(), faint.clone()]);
    let errors = [&joint[1], &alone].map(|out| squared_error(out, &faint));
    assert!(errors[0] < 0.8 * errors[1], "{errors:?}");
    let flat = edge(&mask, vec![strong.clone(), Plane::filled(size, 0.5)]);
    assert_eq!(flat, [edge(&mask, vec![strong]).remove(0), Plane::filled(size, 0.5)]);
}

#[test]
fn exposure_is_a_factor() {
    let size = Size::new(80, 100);
    let (mask, full) = (mask(size, 0.25), disc(size));
    let plain = edge(&mask, vec![full.clone()]).remove(0);
    for factor in [1e-6_f32, 0.37, 1024.0, 3e7] {
        let scaled = Plane::from_fn(size, |y, x| factor * full.at(y, x));
        let back = edge(&mask, vec![scaled]).remove(0);
        let back = Plane::from_fn(size, |y, x| back.at(y, x) / factor);
        // The start is exact to 1e-4 of the range.
        assert!(largest_difference(&back, &plain) <= 1e-3, "{factor}");
    }
}

#[test]
fn flips_and_transposition_do_not_matter() {
    // The grid of tiles is symmetric only where sides are multiples of a tile's.
    let size = Size::new(128, 128);
    let (side, random, full) = (size.width, mask(size, 0.3), disc(size));
    let plain = edge(&random, vec![full.clone()]).remove(0);
    let maps: [Map; 3] = [|n, y, x| (n - 1 - y, x), |n, y, x| (y, n - 1 - x), |_, y, x| (x, y)];
    for (k, map) in maps.into_iter().enumerate() {
        let at = |y, x| map(side, y, x);
        let turned = Arc::new(Mask::from_fn(size, |y, x| random.is_measured(at(y, x).0, at(y, x).1)));
        let image = Plane::from_fn(size, |y, x| full.at(at(y, x).0, at(y, x).1));
        let out = edge(&turned, vec![image]).remove(0);
        let back = Plane::from_fn(size, |y, x| out.at(at(y, x).0, at(y, x).1));
        assert!(largest_difference(&back, &plain) <= 2e-3, "{k}: {}", largest_difference(&back, &plain));
    }
}

#[test]
fn every_size_and_any_range_gives_finite_values() {
    for (h, w) in [(1, 1), (1, 2), (2, 1), (1, 90), (90, 1), (2, 70), (3, 3), (65, 2), (64, 65), (33, 97)] {
        let size = Size::new(h, w);
        for density in [0.02, 0.3] {
            let (spread, scattered) = (mask(size, density), |y, x| y == h / 2 && x == w / 2);
            let mask = Arc::new(Mask::from_fn(size, |y, x| scattered(y, x) || spread.is_measured(y, x)));
            for factor in [1e-38_f32, 1.0, 1e30] {
                let step = |y: usize, x: usize| if (y + 2 * x) % 11 < 5 { factor } else { -factor * 1e-3 };
                let out = edge(&mask, vec![Plane::from_fn(size, step)]).remove(0);
                assert!(out.pixels().iter().all(|v| v.is_finite()), "{size} {density} {factor}");
            }
        }
    }
}

#[test]
fn a_highlight_far_beyond_the_rest_is_borne() {
    let size = Size::new(70, 70);
    let mask = mask(size, 0.3);
    let at = mask.as_slice().iter().position(|measured| *measured).unwrap();
    let mut full = disc(size);
    full.pixels_mut()[at] = 1e30;
    assert!(edge(&mask, vec![full]).remove(0).pixels().iter().all(|v| v.is_finite()));
}

#[test]
fn threads_change_no_bit() {
    let size = Size::new(140, 200);
    let mask = mask(size, 0.2);
    let with = |threads| with_threads(threads, || edge(&mask, vec![disc(size), Plane::filled(size, 0.5)]));
    let one = with(1);
    assert!(one[0] != splines(&mask, disc(size)));
    assert_eq!(one, with(2));
    assert_eq!(one, with(5));
}

#[test]
fn an_interrupt_keeps_the_best_so_far() {
    let size = Size::new(140, 200);
    let (mask, full) = (mask(size, 0.2), disc(size));
    // Asked once a tile: the time is up in the midst of a round.
    let settings = Settings { rounds: 1000, ..Settings::default() };
    let asked = AtomicUsize::new(0);
    let stop = || (asked.fetch_add(1, Ordering::Relaxed) >= 60).then_some(Stop::TimeLimit);
    let run = Run { interrupt: Some(&stop) };
    let (out, outcome) = with_threads(1, || fill(&settings, &mask, vec![full.clone()], &run));
    assert_eq!(outcome.stop, Stop::TimeLimit);
    assert!(outcome.iterations < 1000);
    assert!(largest_difference(&out.as_slice()[0], &full) < 1.0);
}

#[test]
fn settings_out_of_range_and_empty_masks_are_refused() {
    let plan = |settings: Settings, density| {
        let problem = Problem::fill(mask(Size::new(5, 5), density));
        settings.plan(&problem, &Run::default()).err()
    };
    for contrast in [0.0, -1.0, f64::NAN, f64::INFINITY] {
        assert!(matches!(
            plan(Settings { contrast, ..Settings::default() }, 0.5),
            Some(Error::Setting { .. })
        ));
    }
    assert!(matches!(plan(Settings { rounds: 0, ..Settings::default() }, 0.5), Some(Error::Setting { .. })));
    assert_eq!(plan(Settings::default(), 0.0), Some(Error::EmptyMask));
}

#[test]
fn a_complete_frame_stays_as_it_is() {
    let size = Size::new(20, 30);
    assert_eq!(edge(&mask(size, 1.5), vec![disc(size)])[0], disc(size));
}
