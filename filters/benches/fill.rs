//! Times of the filters on a synthetic frame of 1200 x 1200 pixels and three channels, planes in memory to planes in
//! memory. `plan` is what the mask alone needs, `reconstruct` the rest.
#![allow(missing_docs, reason = "the macro of the harness makes public items")]

use std::sync::Arc;

use divan::counter::ItemsCount;
use divan::{Bencher, black_box};
use lacuna_filters::variational::{guided, ss};
use lacuna_filters::{Error, Filter, Mask, Method, Plane, Planes, Problem, Run, Size};

const SIZE: Size = Size::new(1200, 1200);
const CHANNELS: usize = 3;

fn main() {
    divan::main();
}

fn shuffle(y: usize, x: usize) -> bool {
    (x as f64 * 0.754_877_666_246_692_7 + y as f64 * 0.569_840_290_998_053_2 + 0.618).fract() < 0.2
}

/// A mask by name: low-discrepancy, the same with a lost bucket of 256 x 256, the same with nine of 64 x 64.
fn mask(name: &str) -> Arc<Mask> {
    let inside = |a: usize, from: usize, length: usize| (from..from + length).contains(&a);
    Arc::new(Mask::from_fn(SIZE, |y, x| {
        let lost = match name {
            "hole-256" => inside(y, 472, 256) && inside(x, 472, 256),
            "holes-64" => inside(y % 400, 100, 64) && inside(x % 400, 100, 64),
            _ => false,
        };
        shuffle(y, x) && !lost
    }))
}

fn samples() -> Result<Planes, Error> {
    let plane = |c: usize| {
        Plane::from_fn(SIZE, |y, x| {
            let (y, x) = (y as f32 / 60.0, x as f32 / 70.0 + c as f32);
            0.5 + 0.3 * (y + x.sin()).sin() * x.cos() + if (y * x).sin() > 0.9 { 0.2 } else { 0.0 }
        })
    };
    Planes::new(SIZE, (0..CHANNELS).map(plane).collect())
}

#[divan::bench(args = ["shuffle", "hole-256", "holes-64"], sample_count = 5)]
fn ss_plan(bencher: Bencher<'_, '_>, name: &str) {
    let problem = Problem::fill(mask(name));
    bencher.bench_local(|| ss::Settings::default().plan(black_box(&problem), &Run::default()).is_ok());
}

#[divan::bench(args = ["shuffle", "hole-256", "holes-64"], sample_count = 5)]
fn ss_reconstruct(bencher: Bencher<'_, '_>, name: &str) {
    let plan = ss::Settings::default().plan(&Problem::fill(mask(name)), &Run::default());
    let (Ok(plan), Ok(samples)) = (plan, samples()) else { return };
    let mut out = Planes::zeros(SIZE, CHANNELS);
    bencher
        .counter(ItemsCount::new(SIZE.pixels() * CHANNELS))
        .bench_local(|| plan.reconstruct(black_box(&samples), None, &mut out, &Run::default()).is_ok());
}

/// Five guide channels that the colour follows in part.
fn guides() -> Result<guided::Guides, Error> {
    let mut guides = guided::Guides::new(SIZE);
    let plane = |value: fn(f32, f32) -> f32| Plane::from_fn(SIZE, |y, x| value(y as f32, x as f32));
    let normal = [
        plane(|y, x| (y / 60.0 + (x / 70.0).sin()).sin()),
        plane(|_, x| (x / 70.0).cos()),
        plane(|y, x| f32::from(u8::from((y * x / 4200.0).sin() > 0.9))),
    ];
    guides.add("N", normal.into())?;
    guides.add("Z", vec![plane(|y, x| y + 0.3 * x)])?;
    guides.add("A", vec![plane(|y, x| ((y - 600.0).hypot(x - 600.0) / 600.0).min(1.0))])?;
    Ok(guides)
}

#[divan::bench(sample_count = 5)]
fn guided_reconstruct(bencher: Bencher<'_, '_>) {
    let (method, mask) = (Method::Ss(ss::Settings::default()), mask("shuffle"));
    let plan = method.filter().plan(&Problem::fill(Arc::clone(&mask)), &Run::default());
    let (Ok(plan), Ok(samples), Ok(guides)) = (plan, samples(), guides()) else { return };
    let mut out = Planes::zeros(SIZE, CHANNELS);
    let with = (&method, plan.as_ref());
    bencher.counter(ItemsCount::new(SIZE.pixels() * CHANNELS)).bench_local(|| {
        guided::reconstruct(with, &mask, black_box(&samples), &guides, &mut out, &Run::default()).is_ok()
    });
}
