//! Row loops for what one pass over a row cannot do: the projection on a ball round the samples, whose sum is over all of them, and
//! the dual step alone. About 10 operations a pixel for a primal step and 20, a root and a division for a dual step.

use super::dispatch;

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

/// What the dual step of a row reads: the extrapolated image here and one row below (this row again at the last).
#[derive(Clone, Copy, Debug)]
pub struct DualRow<'a> {
    /// Extrapolated image, this row.
    pub over: &'a [f32],
    /// Extrapolated image, next row.
    pub below: &'a [f32],
    /// Dual steps.
    pub sigma: &'a [f32],
}

dispatch! {
    /// One dual step: `q <- q + rho (clip(q + sigma grad over) - q)`; the last column has no horizontal gradient.
    dual_row<B> = dual(vertical: &mut [f32], horizontal: &mut [f32], row: DualRow<'_>, rho: f32)
}

#[inline(always)]
fn dual<B: super::DualBall>(vertical: &mut [f32], horizontal: &mut [f32], row: DualRow<'_>, rho: f32) {
    let n = vertical.len();
    if n == 0 {
        return;
    }
    let (horizontal, over, below) = (&mut horizontal[..n], &row.over[..n], &row.below[..n]);
    let sigma = &row.sigma[..n];
    let right = &over[1..n];
    for j in 0..n - 1 {
        let up = vertical[j] + sigma[j] * (below[j] - over[j]);
        let along = horizontal[j] + sigma[j] * (right[j] - over[j]);
        let (a, b) = B::clip(up, along);
        vertical[j] += rho * (a - vertical[j]);
        horizontal[j] += rho * (b - horizontal[j]);
    }
    let last = n - 1;
    let (a, _) = B::clip(vertical[last] + sigma[last] * (below[last] - over[last]), 0.0);
    vertical[last] += rho * (a - vertical[last]);
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
    /// One primal step: `x <- x + rho d`, `over <- x + 2 d` with `d = -ease tau grad* q` at free pixels; a fixed one goes to
    /// `sample + keep (x + d - sample)`. `rates` are tau, rho and keep.
    ball_row = ball(x: &mut [f32], over: &mut [f32], samples: HeldRow<'_>, row: PrimalRow<'_>, rates: [f32; 3])
}

#[inline(always)]
fn ball(x: &mut [f32], over: &mut [f32], samples: HeldRow<'_>, row: PrimalRow<'_>, rates: [f32; 3]) {
    let [tau, rho, keep] = rates;
    let HeldRow { sample, ease } = samples;
    let mut left = 0.0;
    for j in 0..x.len() {
        let flow = (row.vertical[j] - row.above[j]) + (row.horizontal[j] - left);
        left = row.horizontal[j];
        let there = x[j] + ease[j] * tau * flow;
        let held = sample[j] + keep * (there - sample[j]);
        let move_by = (if row.free[j] == 1 { there } else { held }) - x[j];
        over[j] = x[j] + 2.0 * move_by;
        x[j] += rho * move_by;
    }
}
