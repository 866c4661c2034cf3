//! The two row loops of an over-relaxed primal-dual sweep, and the projection on a ball round the samples.
//!
//! Roofline of a sweep, per pixel: it reads and writes x, q1 and q2 (24 bytes) and reads one byte of mask; about 10
//! operations of primal step and 30 of dual step, a third of these for the inverse root (by Newton steps: a root
//! and a division would cost twice as much). Streaming 4.32 million pixels (1200x1200x3) is 108 MB a sweep.
//! [`crate::solver::primal_dual`] takes several sweeps over a band while its rows are in the L2 cache, which divides that by
//! their number, so arithmetic bounds the speed: 40 operations in two 16-lane pipes are 1.25 cycles. Measured:
//! 1.0 ns in the dual and 0.5 ns in the primal step on a busy Sapphire Rapids; AVX2 takes 1.4 times as long.

use super::dispatch;

/// Step sizes of a sweep.
#[derive(Clone, Copy, Debug)]
pub struct Rates {
    /// Primal step.
    pub tau: f32,
    /// Dual step; `tau * sigma * 8 < 1`.
    pub sigma: f32,
    /// Over-relaxation, in (0, 2).
    pub rho: f32,
}

/// What the primal step of a row reads; all slices have the row's width.
#[derive(Clone, Copy, Debug)]
pub struct PrimalRow<'a> {
    /// Vertical dual variable one row above; zeros above the first row.
    pub above: &'a [f32],
    /// Vertical dual variable of this row.
    pub vertical: &'a [f32],
    /// Horizontal dual variable of this row.
    pub horizontal: &'a [f32],
    /// 1 where the pixel may move, 0 where it is fixed.
    pub free: &'a [u8],
}

dispatch! {
    /// One primal step: `x <- x + rho d`, `over <- x + 2 d` with `d = -tau div* q` at free pixels.
    primal_row = primal(x: &mut [f32], over: &mut [f32], row: PrimalRow<'_>, rates: Rates)
}

#[inline(always)]
fn primal(x: &mut [f32], over: &mut [f32], row: PrimalRow<'_>, rates: Rates) {
    let n = x.len();
    if n == 0 {
        return;
    }
    let (over, above, vertical) = (&mut over[..n], &row.above[..n], &row.vertical[..n]);
    let (horizontal, free) = (&row.horizontal[..n], &row.free[..n]);
    let step = |j: usize, left: f32| {
        (f32::from(free[j]) * rates.tau) * ((vertical[j] - above[j]) + (horizontal[j] - left))
    };
    let first = step(0, 0.0);
    over[0] = x[0] + 2.0 * first;
    x[0] += rates.rho * first;
    let left = &horizontal[..n - 1];
    let (x, over, above, vertical) = (&mut x[1..n], &mut over[1..n], &above[1..n], &vertical[1..n]);
    let (horizontal, free) = (&horizontal[1..n], &free[1..n]);
    for j in 0..n - 1 {
        let flow = (vertical[j] - above[j]) + (horizontal[j] - left[j]);
        let move_by = (f32::from(free[j]) * rates.tau) * flow;
        over[j] = x[j] + 2.0 * move_by;
        x[j] += rates.rho * move_by;
    }
}

/// What the dual step of a row reads: the extrapolated image here and one row below (this row again at the last).
#[derive(Clone, Copy, Debug)]
pub struct DualRow<'a> {
    /// Extrapolated image, this row.
    pub over: &'a [f32],
    /// Extrapolated image, next row.
    pub below: &'a [f32],
}

dispatch! {
    /// One dual step: `q <- q + rho (clip(q + sigma grad over) - q)`; the last column has no horizontal gradient.
    dual_row<B> = dual(vertical: &mut [f32], horizontal: &mut [f32], row: DualRow<'_>, rates: Rates)
}

#[inline(always)]
fn dual<B: super::DualBall>(vertical: &mut [f32], horizontal: &mut [f32], row: DualRow<'_>, rates: Rates) {
    let n = vertical.len();
    if n == 0 {
        return;
    }
    let (horizontal, over, below) = (&mut horizontal[..n], &row.over[..n], &row.below[..n]);
    let right = &over[1..n];
    for j in 0..n - 1 {
        let up = vertical[j] + rates.sigma * (below[j] - over[j]);
        let along = horizontal[j] + rates.sigma * (right[j] - over[j]);
        let (a, b) = B::clip_roughly(up, along);
        vertical[j] += rates.rho * (a - vertical[j]);
        horizontal[j] += rates.rho * (b - horizontal[j]);
    }
    let last = n - 1;
    let (a, _) = B::clip_roughly(vertical[last] + rates.sigma * (below[last] - over[last]), 0.0);
    vertical[last] += rates.rho * (a - vertical[last]);
}

dispatch! {
    /// Sum of squared distances of the primal step's result from the samples over `ease`, over fixed pixels.
    distance_row = distance(x: &[f32], samples: HeldRow<'_>, row: PrimalRow<'_>, tau: f32) -> f64
}

/// What holds the fixed pixels of a row; both slices have the row's width.
#[derive(Clone, Copy, Debug)]
pub struct HeldRow<'a> {
    /// The samples.
    pub sample: &'a [f32],
    /// The inverse of their weights, in (0, 1] at fixed pixels and 1 elsewhere: a pixel's step is this times `tau`.
    pub ease: &'a [f32],
}

#[inline(always)]
fn distance(x: &[f32], samples: HeldRow<'_>, row: PrimalRow<'_>, tau: f32) -> f64 {
    let HeldRow { sample, ease } = samples;
    let mut sum = 0.0;
    let mut left = 0.0;
    for j in 0..x.len() {
        let flow = (row.vertical[j] - row.above[j]) + (row.horizontal[j] - left);
        left = row.horizontal[j];
        let gap = f64::from(x[j] + ease[j] * tau * flow - sample[j]);
        sum += f64::from(1 - row.free[j]) * gap * gap / f64::from(ease[j]);
    }
    sum
}

dispatch! {
    /// As [`primal_row`], but `d` is `ease` times that, and a fixed pixel goes to `sample + keep (x + d - sample)`.
    ball_row = ball(x: &mut [f32], over: &mut [f32], samples: HeldRow<'_>, row: PrimalRow<'_>, rates: Rates, keep: f32)
}

#[inline(always)]
fn ball(x: &mut [f32], over: &mut [f32], samples: HeldRow<'_>, row: PrimalRow<'_>, rates: Rates, keep: f32) {
    let HeldRow { sample, ease } = samples;
    let mut left = 0.0;
    for j in 0..x.len() {
        let flow = (row.vertical[j] - row.above[j]) + (row.horizontal[j] - left);
        left = row.horizontal[j];
        let there = x[j] + ease[j] * rates.tau * flow;
        let held = sample[j] + keep * (there - sample[j]);
        let move_by = (if row.free[j] == 1 { there } else { held }) - x[j];
        over[j] = x[j] + 2.0 * move_by;
        x[j] += rates.rho * move_by;
    }
}
