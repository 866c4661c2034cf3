//! The correction against its definition in f64, what it promises, and that it helps.

#![allow(clippy::float_cmp, reason = "where bits are promised, bits are compared")]

use std::sync::Arc;
use std::sync::atomic::{AtomicUsize, Ordering};

use super::{Settings, refine};
use crate::baseline::testing::with_threads;
use crate::variational::edge;
use crate::{Filter, Mask, Plane, Planes, Problem, Run, Size, Stop};
use lacuna_core::hash;

mod reference;

/// A low-discrepancy mask.
fn mask(size: Size, density: f64) -> Arc<Mask> {
    let part = |y: usize, x: usize| (x as f64 * 0.754_877_666 + y as f64 * 0.569_840_291 + 0.618).fract();
    Arc::new(Mask::from_fn(size, |y, x| part(y, x) < density))
}

/// Shaded discs before a ramp.
fn discs(size: Size) -> Plane {
    Plane::from_fn(size, |y, x| {
        let (v, u) = ((y % 45) as f64 / 16.0 - 1.4, (x % 52) as f64 / 18.0 - 1.4);
        let inside = u * u + v * v < 1.0;
        (if inside { 0.8 - 0.2 * u + 0.1 * v * v } else { 0.1 + 0.002 * x as f64 }) as f32
    })
}

fn fill(filter: &dyn Filter, mask: &Arc<Mask>, plane: &Plane, run: &Run<'_>) -> Plane {
    let samples = Planes::new(mask.size(), vec![plane.clone()]).unwrap();
    let mut out = Planes::zeros(mask.size(), 1);
    let plan = filter.plan(&Problem::fill(Arc::clone(mask)), run).unwrap();
    plan.reconstruct(&samples, &mut out, run).unwrap();
    out.into_vec().remove(0)
}

fn squared_error(one: &Plane, other: &Plane) -> f64 {
    one.pixels().iter().zip(other.pixels()).map(|(a, b)| f64::from(a - b).powi(2)).sum()
}

fn largest_difference(one: &Plane, other: &Plane) -> f32 {
    one.pixels().iter().zip(other.pixels()).map(|(a, b)| (a - b).abs()).fold(0.0, f32::max)
}

/// Over borders of tiles, at odd and tiny sizes.
#[test]
fn it_is_the_network_of_its_definition() {
    let noise = |i: usize| (hash(5, i as u64) >> 40) as f32 / (1 << 24) as f32;
    for (height, width) in [(1, 1), (1, 2), (3, 1), (5, 7), (31, 45), (133, 141)] {
        let size = Size::new(height, width);
        let image = discs(size);
        let image = Plane::from_fn(size, |y, x| image.at(y, x) + 0.05 * noise(y * width + x));
        let mask = mask(size, 0.3);
        let exact = reference::corrected(&image, &mask);
        let mut out = Planes::new(size, vec![image]).unwrap();
        refine::refine(&mask, &[1.0], &mut out, &Run::default());
        let out = out.into_vec().remove(0);
        let off = |(found, exact): (&f32, &f64)| (f64::from(*found) - exact).abs();
        let largest = out.pixels().iter().zip(&exact).map(off).fold(0.0, f64::max);
        // Corrections are up to 0.1 and go through about 800 sums of products, whose roundings are random; those under the least amplitude are left out.
        let bound = 1e-5 + f64::from(refine::LEAST);
        assert!(largest <= bound, "{height} {width}: {largest}");
        let large = out.pixels().iter().zip(&exact).filter(|(a, b)| off((a, b)) > 1e-5).count();
        assert!(large <= size.pixels() / 1000, "{height} {width}: {large}");
    }
}

#[test]
fn it_is_nearer_to_discs_than_edges_are_and_samples_are_exact() {
    let size = Size::new(150, 170);
    for density in [0.1, 0.2, 0.5] {
        let (mask, full) = (mask(size, density), discs(size));
        let out = fill(&Settings, &mask, &full, &Run::default());
        let before = fill(&edge::Settings::default(), &mask, &full, &Run::default());
        let (own, other) = (squared_error(&out, &full), squared_error(&before, &full));
        assert!(own < 0.95 * other, "{density}: {own} against {other}");
        let both = out.pixels().iter().zip(full.pixels()).zip(mask.as_slice());
        assert!(both.filter(|(_, measured)| **measured).all(|((a, b), _)| a.to_bits() == b.to_bits()));
        for (y, x) in (0..size.height).flat_map(|y| (0..size.width).map(move |x| (y, x))) {
            let near = (y.saturating_sub(1)..(y + 2).min(size.height))
                .flat_map(|y| (x.saturating_sub(1)..(x + 2).min(size.width)).map(move |x| (y, x)));
            let near = near.map(|(y, x)| before.at(y, x));
            let (low, high) = (near.clone().fold(f32::MAX, f32::min), near.fold(f32::MIN, f32::max));
            assert!((low..=high).contains(&out.at(y, x)), "{y} {x}");
        }
    }
}

#[test]
fn planes_are_left_as_they_are() {
    let size = Size::new(90, 140);
    let mask = mask(size, 0.3);
    for plane in
        [Plane::from_fn(size, |y, x| 3.0 + 0.5 * y as f32 - 0.25 * x as f32), Plane::filled(size, 0.3)]
    {
        let before = fill(&edge::Settings::default(), &mask, &plane, &Run::default());
        assert_eq!(fill(&Settings, &mask, &plane, &Run::default()), before);
    }
}

#[test]
fn exposure_is_a_factor() {
    let size = Size::new(80, 100);
    let (mask, full) = (mask(size, 0.25), discs(size));
    let plain = fill(&Settings, &mask, &full, &Run::default());
    for factor in [1e-6_f32, 0.37, 1024.0, 3e7] {
        let back =
            fill(&Settings, &mask, &Plane::from_fn(size, |y, x| factor * full.at(y, x)), &Run::default());
        let back = Plane::from_fn(size, |y, x| back.at(y, x) / factor);
        // As the filter it starts from.
        assert!(largest_difference(&back, &plain) <= 1e-3, "{factor}");
    }
}

#[test]
fn threads_change_no_bit_and_an_interrupt_ends_it() {
    let size = Size::new(150, 300);
    let (mask, full) = (mask(size, 0.2), discs(size));
    let one = with_threads(1, || fill(&Settings, &mask, &full, &Run::default()));
    assert_eq!(with_threads(3, || fill(&Settings, &mask, &full, &Run::default())), one);
    let asked = AtomicUsize::new(0);
    let stop = || (asked.fetch_add(1, Ordering::Relaxed) > 2).then_some(Stop::Cancelled);
    let stopped = fill(&Settings, &mask, &full, &Run { interrupt: Some(&stop) });
    assert!(stopped.pixels().iter().all(|value| value.is_finite()));
    assert_ne!(stopped, one);
}
