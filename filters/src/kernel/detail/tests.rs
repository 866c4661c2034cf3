//! Detail against its definition in f64, and every instruction set against the others.

#![allow(clippy::float_cmp, reason = "where bits are promised, bits are compared")]

use super::*;
use crate::kernel::{Isa, dispatch};

const SIZES: [(usize, usize); 7] = [(2, 2), (2, 8), (8, 2), (4, 6), (14, 10), (20, 36), (50, 26)];

/// A step, a ramp and some noise.
fn window(h: usize, w: usize) -> Vec<f32> {
    let noise = |i: usize| (lacuna_core::hash(7, i as u64) >> 40) as f32 / (1 << 24) as f32;
    let step = |i: usize| if 2 * (i % w) > i / w + w / 2 { 0.7 } else { 0.1 };
    (0..h * w).map(|i| step(i) + 0.01 * (i % w) as f32 + 0.05 * noise(i)).collect()
}

fn measured(isa: Isa, values: &[f32], width: usize) -> Detail {
    let mut detail = Detail::default();
    dispatch(isa, Measure { values, width, detail: &mut detail });
    detail
}

/// The sum over the window of a Gaussian, both dimensions at once; beyond the border the mirrored value, or the outermost.
fn blurred(u: &[f64], (h, w): (usize, usize), (sigma, reach): (f64, usize), reflects: bool) -> Vec<f64> {
    let reach = reach as isize;
    let weight = |d: isize| (-((d * d) as f64) / (2.0 * sigma * sigma)).exp();
    let total: f64 = (-reach..=reach).map(weight).sum();
    // Factors of at most two places along an axis.
    let along = |at: isize, n: usize| -> Vec<(usize, f64)> {
        let last = n as isize - 1;
        let edge = at.clamp(0, last);
        let mirrored = (2 * edge - at).clamp(0, last);
        if at == edge || !reflects {
            vec![(edge as usize, 1.0)]
        } else {
            vec![(edge as usize, 2.0), (mirrored as usize, -1.0)]
        }
    };
    let pixels = (0..h as isize).flat_map(|y| (0..w as isize).map(move |x| (y, x)));
    let at = |(y, x): (isize, isize)| {
        let mut sum = 0.0;
        for (dy, dx) in (-reach..=reach).flat_map(|dy| (-reach..=reach).map(move |dx| (dy, dx))) {
            for (v, a) in along(y + dy, h) {
                for (u_, b) in along(x + dx, w) {
                    sum += weight(dy) * weight(dx) * a * b * u[v * w + u_];
                }
            }
        }
        sum / (total * total)
    };
    pixels.map(at).collect()
}

#[test]
fn it_is_what_its_definition_says_on_every_instruction_set() {
    for (h, w) in SIZES {
        let values = window(h, w);
        let exact: Vec<f64> = values.iter().map(|x| f64::from(*x)).collect();
        let difference = |a: &[f64], b: &[f64]| -> Vec<f64> { a.iter().zip(b).map(|(a, b)| a - b).collect() };
        let squares = |a: &[f64]| -> Vec<f64> { a.iter().map(|a| a * a).collect() };
        let root = |a: Vec<f64>| -> Vec<f64> { a.into_iter().map(f64::sqrt).collect() };
        let size = (h, w);
        let detail = difference(&exact, &blurred(&exact, size, (1.5, 4), true));
        let finest = difference(&detail, &blurred(&detail, size, (1.5, 4), false));
        let near = root(blurred(&squares(&finest), size, (1.0, 3), false));
        let around = root(blurred(&squares(&detail), size, (2.5, 6), false));
        let made: Vec<Detail> = Isa::all().map(|isa| measured(isa, &values, w)).collect();
        for i in 0..h * w {
            let (y, x) = (i / w, i % w);
            let near_by = (y.saturating_sub(1)..(y + 2).min(h))
                .flat_map(|y| (x.saturating_sub(1)..(x + 2).min(w)).map(move |x| y * w + x));
            let low = near_by.clone().map(|i| values[i]).fold(f32::INFINITY, f32::min);
            let high = near_by.map(|i| values[i]).fold(f32::NEG_INFINITY, f32::max);
            for made in &made {
                assert_eq!((made.low[i], made.high[i]), (low, high));
                // Values are of order 1, and a dozen roundings lie behind each detail.
                let bound = 40.0 * f64::from(f32::EPSILON);
                let over = |bound: f64| bound / around[i] * (1.0 + near[i] / around[i]);
                let span = f64::from(high - low);
                let close = |found: f32, exact: f64, bound: f64| (f64::from(found) - exact).abs() <= bound;
                assert!(close(made.amplitude[i], near[i].min(span), bound), "{h} {w} {i}");
                assert!(close(made.signed[i], (detail[i] / around[i]).clamp(-6.0, 6.0), 8.0 * over(bound)));
                assert!(close(made.fine[i], near[i] / around[i], 8.0 * over(bound)), "{h} {w} {i}");
                assert!(close(made.steep[i], (span / around[i]).min(6.0), 8.0 * over(bound)), "{h} {w} {i}");
            }
            let first = &made[0];
            assert!(made.iter().all(|made| made.signed[i] == first.signed[i]));
        }
    }
}

#[test]
fn planes_have_no_detail() {
    let (h, w) = (24, 30);
    // Quarters: sums of them are exact, products with taps are not.
    let plane: Vec<f32> = (0..h * w).map(|i| 3.0 + 0.25 * (i % w) as f32 - 0.5 * (i / w) as f32).collect();
    let detail = measured(Isa::best(), &plane, w);
    let largest = detail.amplitude.iter().fold(0.0_f32, |a, b| a.max(*b));
    // Values up to 15, a dozen roundings.
    assert!(largest <= 15.0 * 12.0 * f32::EPSILON, "{largest}");
}
