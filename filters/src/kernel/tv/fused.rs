//! One row of a sweep in one pass: the primal step of row `y`, then the dual step of row `y - 1`, which it completes.
//!
//! Roofline, per pixel of a sweep: it reads x, the dual variable of both rows, the extrapolation and the mask (25 bytes; the
//! rows of step sizes stay in L1) and writes x, the extrapolation and the dual variable (16). About 17 and 12 of these come from and
//! go to L2, as the next sweep's rows are those that this one has just left in L1; [`crate::solver::primal_dual`] keeps all in L2.
//! 30 operations in two pipes of 16 lanes are 0.95 cycles, the root and the division 2.2 in their own unit; L2 gives about 30 bytes a
//! cycle, one cycle. Measured with rows in L2, AVX-512, Emerald Rapids at work: 0.54 ns, or 0.63 if rows do not begin at a line
//! of the cache. Newton steps instead of root and division: 0.56. Fused products and sums: 0.47, but then instruction sets differ.

use super::dispatch;

/// Columns of the first piece of a row; whole vectors for any instruction set, so that those of the rest are aligned as the row.
const HEAD: usize = 16;

/// What a sweep of a row reads; all slices have the row's width.
#[derive(Clone, Copy, Debug)]
pub struct SweepRow<'a> {
    /// Vertical dual variable of row `y`.
    pub vertical: &'a [f32],
    /// Horizontal dual variable of row `y`.
    pub horizontal: &'a [f32],
    /// 1 where the pixel may move, 0 where it is fixed.
    pub free: &'a [u8],
}

/// Step sizes of a row; both slices have its width.
#[derive(Clone, Copy, Debug)]
pub struct Rates<'a> {
    /// Primal steps of row `y`.
    pub tau: &'a [f32],
    /// Dual steps of row `y - 1`.
    pub sigma: &'a [f32],
    /// Over-relaxation, in (0, 2).
    pub rho: f32,
}

impl SweepRow<'_> {
    /// Columns `from..to`.
    #[inline(always)]
    fn part(self, from: usize, to: usize) -> Self {
        let Self { vertical, horizontal, free } = self;
        Self { vertical: &vertical[from..to], horizontal: &horizontal[from..to], free: &free[from..to] }
    }

    /// The left neighbours of the first columns.
    #[inline(always)]
    fn head(&self) -> [f32; HEAD] {
        let mut left = [0.0; HEAD];
        left[1..].iter_mut().zip(self.horizontal).for_each(|(left, horizontal)| *left = *horizontal);
        left
    }
}

dispatch! {
    /// At row `y`, `x <- x + rho d` with `d = -tau grad* q` at free pixels; then at row `y - 1`, whose dual variable is `above` and
    /// `beside` (vertical and horizontal), `q <- q + rho (clip(q + sigma grad over) - q)`. `over` holds `x + 2 d` of row `y - 1` before,
    /// and of row `y` after, and one more value, which does not matter. The last column has no horizontal gradient.
    sweep_row<B> = sweep(
        x: &mut [f32], over: &mut [f32], above: &mut [f32], beside: &mut [f32], row: SweepRow<'_>, rates: Rates<'_>
    )
}

#[inline(always)]
fn sweep<B: super::DualBall>(
    x: &mut [f32],
    over: &mut [f32],
    above: &mut [f32],
    beside: &mut [f32],
    row: SweepRow<'_>,
    rates: Rates<'_>,
) {
    let n = x.len();
    if n == 0 {
        return;
    }
    let (last, head) = (n - 1, n.min(HEAD));
    let end = (above[last], over[last]);
    let left = row.head();
    let parts = [(0, head, &left[..head]), (head, n, &row.horizontal[head - 1..last])];
    for (from, to, left) in parts {
        let rates = Rates { tau: &rates.tau[from..to], sigma: &rates.sigma[from..to], ..rates };
        let (above, beside) = (&mut above[from..to], &mut beside[from..to]);
        let row = (row.part(from, to), left);
        sweep_part::<B>(&mut x[from..to], &mut over[from..=to], above, beside, row, rates);
    }
    let (a, _) = B::clip(end.0 + rates.sigma[last] * (over[last] - end.1), 0.0);
    above[last] = end.0 + rates.rho * (a - end.0);
    beside[last] = 0.0;
}

/// Some columns, with `over` of one more to the right.
#[inline(always)]
fn sweep_part<B: super::DualBall>(
    x: &mut [f32],
    over: &mut [f32],
    above: &mut [f32],
    beside: &mut [f32],
    (row, left): (SweepRow<'_>, &[f32]),
    rates: Rates<'_>,
) {
    let n = x.len();
    let (over, above, beside) = (&mut over[..=n], &mut above[..n], &mut beside[..n]);
    let (vertical, horizontal, left) = (&row.vertical[..n], &row.horizontal[..n], &left[..n]);
    let (free, tau, sigma, rho) = (&row.free[..n], &rates.tau[..n], &rates.sigma[..n], rates.rho);
    for j in 0..n {
        let flow = (vertical[j] - above[j]) + (horizontal[j] - left[j]);
        let move_by = (if free[j] == 0 { 0.0 } else { tau[j] }) * flow;
        let (here, right, below) = (over[j], over[j + 1], x[j] + 2.0 * move_by);
        x[j] += rho * move_by;
        let (a, b) = B::clip(above[j] + sigma[j] * (below - here), beside[j] + sigma[j] * (right - here));
        above[j] += rho * (a - above[j]);
        beside[j] += rho * (b - beside[j]);
        over[j] = below;
    }
}

dispatch! {
    /// A step of projected descent on half the squared divergence at free pixels: `d = -alpha grad* q` at row `y`, then
    /// `q <- clip(q + grad d)` at row `y - 1`; `over` holds `d`. The names are those of [`sweep_row`], with one `alpha` for `tau`.
    repair_row<B> = repair(
        over: &mut [f32], above: &mut [f32], beside: &mut [f32], row: SweepRow<'_>, alpha: f32
    )
}

#[inline(always)]
fn repair<B: super::DualBall>(
    over: &mut [f32],
    above: &mut [f32],
    beside: &mut [f32],
    row: SweepRow<'_>,
    alpha: f32,
) {
    let n = above.len();
    if n == 0 {
        return;
    }
    let (last, head) = (n - 1, n.min(HEAD));
    let end = (above[last], over[last]);
    let left = row.head();
    let parts = [(0, head, &left[..head]), (head, n, &row.horizontal[head - 1..last])];
    for (from, to, left) in parts {
        let (above, beside) = (&mut above[from..to], &mut beside[from..to]);
        repair_part::<B>(&mut over[from..=to], above, beside, (row.part(from, to), left), alpha);
    }
    (above[last], _) = B::clip(end.0 + (over[last] - end.1), 0.0);
    beside[last] = 0.0;
}

/// Some columns, with `over` of one more to the right.
#[inline(always)]
fn repair_part<B: super::DualBall>(
    over: &mut [f32],
    above: &mut [f32],
    beside: &mut [f32],
    (row, left): (SweepRow<'_>, &[f32]),
    alpha: f32,
) {
    let n = above.len();
    let (over, beside, left) = (&mut over[..=n], &mut beside[..n], &left[..n]);
    let (vertical, horizontal, free) = (&row.vertical[..n], &row.horizontal[..n], &row.free[..n]);
    for j in 0..n {
        let flow = (vertical[j] - above[j]) + (horizontal[j] - left[j]);
        let below = (if free[j] == 0 { 0.0 } else { alpha }) * flow;
        let here = over[j];
        (above[j], beside[j]) = B::clip(above[j] + (below - here), beside[j] + (over[j + 1] - here));
        over[j] = below;
    }
}
