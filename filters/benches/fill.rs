//! Times of the filters, planes in memory to planes in memory: filter x size x mask, on a render (see `rendered`) or synthetic frames. `plan` is what the mask
//! alone needs, everything else is the time of `reconstruct`. `scripts/bench` runs this beside the peers.
#![allow(missing_docs, reason = "the macro of the harness makes public items")]

use std::sync::Arc;

use divan::counter::ItemsCount;
use divan::{Bencher, black_box};
use lacuna_filters::baseline::push_pull;
use lacuna_filters::variational::{guided, ss, tv};
use lacuna_filters::{Error, Filter, Mask, Method, Plane, Planes, Problem, Run, Size};

const SIZE: Size = Size::new(1200, 1200);
const CHANNELS: usize = 3;

fn main() {
    divan::main();
}

fn shuffle(y: usize, x: usize) -> bool {
    (x as f64 * 0.754_877_666_246_692_7 + y as f64 * 0.569_840_290_998_053_2 + 0.618).fract() < 0.2
}

/// One of a hundred pixels, without a pattern.
fn sparse(y: usize, x: usize) -> bool {
    let mixed = ((y << 20 | x) as u64).wrapping_mul(0x9e37_79b9_7f4a_7c15);
    let mixed = (mixed ^ mixed >> 29).wrapping_mul(0xbf58_476d_1ce4_e5b9);
    (mixed ^ mixed >> 32).is_multiple_of(100)
}

/// A mask by name: low-discrepancy, the same with a lost bucket of 256 x 256, the same with nine of 64 x 64, random.
fn mask(size: Size, name: &str) -> Arc<Mask> {
    let inside = |a: usize, from: usize, length: usize| (from..from + length).contains(&a);
    Arc::new(Mask::from_fn(size, |y, x| {
        let lost = match name {
            "random-1%" => return sparse(y, x),
            "hole-256" => inside(y, 472, 256) && inside(x, 472, 256),
            "holes-64" => inside(y % 400, 100, 64) && inside(x % 400, 100, 64),
            _ => false,
        };
        shuffle(y, x) && !lost
    }))
}

/// The planes of a render, if `LACUNA_BENCH_PLANES` names a file with them: `f32`, little-endian, one plane after the other.
fn rendered(size: Size, channels: usize) -> Option<Vec<Plane>> {
    let bytes = std::fs::read(std::env::var_os("LACUNA_BENCH_PLANES")?).ok()?;
    let pixels = size.pixels();
    if bytes.len() != 4 * pixels * channels {
        return None;
    }
    let (numbers, _) = bytes.as_chunks::<4>();
    let plane =
        |c: usize| Plane::from_fn(size, |y, x| f32::from_le_bytes(numbers[c * pixels + y * size.width + x]));
    Some((0..channels).map(plane).collect())
}

fn samples(size: Size, channels: usize) -> Result<Planes, Error> {
    if let Some(planes) = rendered(size, channels) {
        return Planes::new(size, planes);
    }
    let plane = |c: usize| {
        Plane::from_fn(size, |y, x| {
            let (y, x) = (y as f32 / 60.0, x as f32 / 70.0 + c as f32);
            0.5 + 0.3 * (y + x.sin()).sin() * x.cos() + if (y * x).sin() > 0.9 { 0.2 } else { 0.0 }
        })
    };
    Planes::new(size, (0..channels).map(plane).collect())
}

/// Times `reconstruct` alone, warm.
fn reconstruct(
    bencher: Bencher<'_, '_>,
    filter: &dyn Filter,
    (size, channels): (Size, usize),
    mask: Arc<Mask>,
) {
    let plan = filter.plan(&Problem::fill(mask), &Run::default());
    let (Ok(plan), Ok(samples)) = (plan, samples(size, channels)) else { return };
    let mut out = Planes::zeros(size, channels);
    bencher
        .counter(ItemsCount::new(size.pixels() * channels))
        .bench_local(|| plan.reconstruct(black_box(&samples), &mut out, &Run::default()).is_ok());
}

#[divan::bench(args = ["shuffle", "hole-256", "holes-64"], sample_count = 5)]
fn ss_plan(bencher: Bencher<'_, '_>, name: &str) {
    let problem = Problem::fill(mask(SIZE, name));
    bencher.bench_local(|| ss::Settings::default().plan(black_box(&problem), &Run::default()).is_ok());
}

#[divan::bench(args = ["shuffle", "hole-256", "holes-64", "random-1%"], sample_count = 5, sample_size = 1)]
fn ss_reconstruct(bencher: Bencher<'_, '_>, name: &str) {
    reconstruct(bencher, &ss::Settings::default(), (SIZE, CHANNELS), mask(SIZE, name));
}

#[divan::bench(sample_count = 5, sample_size = 1)]
fn ss_third_order(bencher: Bencher<'_, '_>) {
    let settings = ss::Settings { order: ss::Order::Third, ..ss::Settings::default() };
    reconstruct(bencher, &settings, (SIZE, CHANNELS), mask(SIZE, "shuffle"));
}

/// One channel of a square frame.
#[divan::bench(args = [1024, 2048, 4096, 8192], sample_count = 5, sample_size = 1)]
fn ss_side(bencher: Bencher<'_, '_>, side: usize) {
    let size = Size::new(side, side);
    reconstruct(bencher, &ss::Settings::default(), (size, 1), mask(size, "shuffle"));
}

#[divan::bench(args = [1, 2], sample_count = 5, sample_size = 1)]
fn ss_threads(bencher: Bencher<'_, '_>, threads: usize) {
    let Ok(pool) = rayon::ThreadPoolBuilder::new().num_threads(threads).build() else { return };
    let settings = ss::Settings::default();
    let plan = settings.plan(&Problem::fill(mask(SIZE, "shuffle")), &Run::default());
    let (Ok(plan), Ok(samples)) = (plan, samples(SIZE, CHANNELS)) else { return };
    let mut out = Planes::zeros(SIZE, CHANNELS);
    bencher.bench_local(|| {
        pool.install(|| plan.reconstruct(black_box(&samples), &mut out, &Run::default()).is_ok())
    });
}

#[divan::bench(args = [0.01, 0.001], sample_count = 5, sample_size = 1)]
fn tv_gap(bencher: Bencher<'_, '_>, gap: f64) {
    let settings = tv::Settings { gap, ..tv::Settings::default() };
    reconstruct(bencher, &settings, (SIZE, CHANNELS), mask(SIZE, "shuffle"));
}

#[divan::bench(sample_count = 5)]
fn push_pull_reconstruct(bencher: Bencher<'_, '_>) {
    reconstruct(bencher, &push_pull::Settings, (SIZE, CHANNELS), mask(SIZE, "shuffle"));
}

/// Five guide channels that the colour follows in part.
fn guides(size: Size) -> Result<guided::Guides, Error> {
    let mut guides = guided::Guides::new(size);
    let plane = |value: fn(f32, f32) -> f32| Plane::from_fn(size, |y, x| value(y as f32, x as f32));
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

/// A square frame of so many pixels a side.
#[divan::bench(args = [1200, 2400], sample_count = 5, sample_size = 1)]
fn guided_reconstruct(bencher: Bencher<'_, '_>, side: usize) {
    let size = Size::new(side, side);
    let (method, mask) = (Method::from(ss::Settings::default()), mask(size, "shuffle"));
    let plan = method.filter().plan(&Problem::fill(Arc::clone(&mask)), &Run::default());
    let (Ok(plan), Ok(samples), Ok(guides)) = (plan, samples(size, CHANNELS), guides(size)) else { return };
    let mut out = Planes::zeros(size, CHANNELS);
    let with = (method.filter(), plan.as_ref());
    bencher.counter(ItemsCount::new(size.pixels() * CHANNELS)).bench_local(|| {
        plan.reconstruct(black_box(&samples), &mut out, &Run::default()).is_ok()
            && guided::steer(with, &mask, &samples, &guides, &mut out, &Run::default()).is_ok()
    });
}
