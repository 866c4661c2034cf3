//! Conjugate gradients in f32 on a small window whose free unknowns all have measured pixels near.
//!
//! There the energy, preconditioned by the masked blur, is so well conditioned that one or two dozen steps suffice and
//! f32 is enough. All buffers of a window of 136 x 192 stay in L2 (six of 115 kB).
//!
//! Source: M. Hestenes, E. Stiefel, "Methods of conjugate gradients for solving linear systems", J. Res. NBS 49, 1952.

use crate::kernel::Isa;
use crate::kernel::simd::MOST;
use crate::kernel::stencil::{PAD, Separable, Window, apply};
use crate::kernel::step::{self, Move, Sums, aligned, pass};

/// Added to the middle of the preconditioner's blur.
const CENTRE: f64 = 0.5;
/// Steps before the least eigenvalue that they show is believed.
const FEW: usize = 4;

/// Numbers from one page of memory to the next.
const PAGE: usize = 1024;
/// By how many numbers the place of a buffer in its page differs from that of the one before. Loads that lie where a store
/// before them does, one or more pages apart, wait for it.
const STAGGER: usize = 144;

/// Buffers of one window, whose rows begin at multiples of a cache line.
#[derive(Default)]
pub struct Buffers {
    length: usize,
    all: Vec<f32>,
}

/// The buffers of a window by name: see [`step::Buffers`].
pub struct Views<'a> {
    /// The image. What its padding holds does not matter, as long as it is finite.
    pub x: &'a mut [f32],
    /// The diagonal of the preconditioner: 0 where pixels are not free, to be set in whole strides.
    pub d: &'a mut [f32],
    pub r: &'a mut [f32],
    pub u: &'a mut [f32],
    /// Free for any use before the solve, with finite numbers.
    pub w: &'a mut [f32],
    pub p: &'a mut [f32],
    pub s: &'a mut [f32],
}

impl Buffers {
    /// Makes room for `window`, whatever window they served before.
    pub fn fit(&mut self, window: Window) -> Views<'_> {
        self.length = window.len();
        let views = self.views();
        let rows = PAD * window.stride();
        let below = (PAD + window.height) * window.stride();
        views.r[..rows].fill(0.0);
        views.u[..rows].fill(0.0);
        views.u[below..].fill(0.0);
        views
    }

    /// The buffers as they are.
    pub fn views(&mut self) -> Views<'_> {
        let length = self.length;
        let apart = length.next_multiple_of(PAGE) + STAGGER;
        if self.all.len() < 7 * apart + MOST {
            self.all.resize(7 * apart + MOST, 0.0);
        }
        let mut rest = &mut self.all[..];
        let skip = aligned(rest);
        rest = &mut rest[skip..];
        let mut next = || {
            let (own, others) = std::mem::take(&mut rest).split_at_mut(apart);
            rest = others;
            &mut own[..length]
        };
        let (x, d, r, u, w, p, s) = (next(), next(), next(), next(), next(), next(), next());
        Views { x, d, r, u, w, p, s }
    }
}

/// When a local solve is done.
#[derive(Clone, Copy, Debug)]
pub struct Target {
    /// Largest error that may be left.
    pub tolerance: f64,
    /// Correction of a lone pixel that f32 cannot tell from rounding.
    pub floor: f64,
    /// What is known of the least eigenvalue of the preconditioned matrix.
    pub least: Option<f64>,
}

/// How far a local solve came.
#[derive(Clone, Copy, Debug)]
pub struct Ending {
    /// Steps taken: 0 if the image was within the tolerance already.
    pub steps: usize,
    /// Whether the tolerance was met.
    pub converged: bool,
    /// The residual's square, measured by the preconditioner, at the start and at the end.
    pub squares: (f64, f64),
    /// The least eigenvalue of the preconditioned matrix as far as it has shown, or the one that was given.
    pub least: f64,
    /// The largest error that may be left, by that eigenvalue.
    pub error: f64,
}

/// The tridiagonal matrix that conjugate gradients build, whose extreme eigenvalues approach those of the preconditioned
/// matrix from inside (C. Lanczos, 1950).
#[derive(Default)]
struct Lanczos {
    /// Diagonal entries and the squares of those before them in the row.
    rows: Vec<(f64, f64)>,
    step: f64,
}

impl Lanczos {
    fn push(&mut self, step: f64, ratio: f64) {
        let (add, square) = if self.rows.is_empty() {
            (0.0, 0.0)
        } else {
            (ratio / self.step, ratio / (self.step * self.step))
        };
        self.rows.push((1.0 / step + add, square));
        self.step = step;
    }

    /// Whether all eigenvalues exceed `bound`: the pivots of the shifted matrix are positive.
    fn exceeds(&self, bound: f64) -> bool {
        let mut pivot = 1.0;
        self.rows.iter().all(|&(diagonal, square)| {
            pivot = diagonal - bound - square / pivot;
            pivot > 0.0
        })
    }

    /// The least eigenvalue to within 2 %, from below.
    fn least(&self) -> f64 {
        let Some(mut high) = self.rows.iter().map(|row| row.0).reduce(f64::min) else { return f64::INFINITY };
        let mut low = high * 1e-9;
        while high > 1.02 * low {
            let middle = (low * high).sqrt();
            if self.exceeds(middle) { low = middle } else { high = middle }
        }
        low
    }
}

/// Minimises `x' A x` over the free pixels until the error is at most about `tolerance` everywhere, or `limit` steps are
/// done. With `u` the preconditioned residual and `least` the least eigenvalue of the preconditioned matrix, the error is
/// about `max |u| / least` at most. That eigenvalue is taken from the steps themselves and from what is known of it already;
/// where nothing is, a few steps are taken in any case.
pub fn solve(
    isa: Isa,
    a: &Separable<f32>,
    window: Window,
    views: Views<'_>,
    target: Target,
    limit: usize,
) -> Ending {
    let Views { x, d, r, u, w, p, s } = views;
    // In these units the correction of a lone free pixel is exact.
    let unit = 1.0 / ((4.0 + CENTRE) * a.diagonal(a.vertical.len / 2, a.horizontal.len / 2));
    apply(isa, a, window, x, None, w);
    let mut go = |what: Move, applies: bool| -> Sums {
        pass(isa, a, window, (what, applies), CENTRE, step::Buffers { d, x, r, u, w, p, s })
    };
    // Where the least eigenvalue is known, most windows have nothing left to do.
    let mut sums = go(Move::Begin, target.least.is_none());
    let first = sums.square;
    let (mut length, mut before) = (0.0, 0.0);
    let mut lanczos = Lanczos::default();
    for steps in 0..=limit {
        let Sums { square, top, .. } = sums;
        let bound = top / target.tolerance;
        let known = target.least.map_or(steps >= FEW, |least| least >= bound);
        let converged = top * unit <= target.floor || (known && lanczos.exceeds(bound));
        if converged || steps == limit || square.is_nan() || square <= 0.0 {
            let least = lanczos.least().min(target.least.unwrap_or(f64::INFINITY));
            let error = if top > 0.0 { top / least } else { 0.0 };
            return Ending { steps, converged, squares: (first, square), least, error };
        }
        if steps == 0 && target.least.is_some() {
            sums = go(Move::Begin, true);
        }
        let ratio = if steps == 0 { 0.0 } else { square / before };
        let conjugate = if steps == 0 { 0.0 } else { ratio * square / length };
        length = square / (sums.curvature - conjugate);
        before = square;
        lanczos.push(length, ratio);
        sums = go(if steps == 0 { Move::First(length) } else { Move::Step(length, ratio) }, true);
    }
    Ending { steps: limit, converged: false, squares: (first, before), least: 0.0, error: f64::INFINITY }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn lanczos_finds_the_least_eigenvalue() {
        // Conjugate gradients on diag(1, 4, 9) from the residual (1, 1, 1), in full.
        let matrix = [1.0, 4.0, 9.0];
        let (mut r, mut p, mut lanczos) = ([1.0_f64; 3], [0.0; 3], Lanczos::default());
        let mut before = 0.0;
        for k in 0..3 {
            let rr: f64 = r.iter().map(|r| r * r).sum();
            let ratio = if k == 0 { 0.0 } else { rr / before };
            let mut curvature = 0.0;
            for i in 0..3 {
                p[i] = r[i] + ratio * p[i];
                curvature += matrix[i] * p[i] * p[i];
            }
            lanczos.push(rr / curvature, ratio);
            for i in 0..3 {
                r[i] -= rr / curvature * matrix[i] * p[i];
            }
            before = rr;
        }
        assert!(lanczos.exceeds(0.999) && !lanczos.exceeds(1.001));
        assert!((lanczos.least() - 1.0).abs() <= 0.02, "{}", lanczos.least());
    }
}
