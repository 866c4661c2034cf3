//! Conjugate gradients in f32 on a small window whose free unknowns all have measured pixels near.
//!
//! There the energy, preconditioned by the masked blur, is so well conditioned that one or two dozen steps suffice and
//! f32 is enough. All buffers of a window of 136 x 192 stay in L2 (six of 115 kB).
//!
//! Source: M. Hestenes, E. Stiefel, "Methods of conjugate gradients for solving linear systems", J. Res. NBS 49, 1952.

use crate::kernel::Isa;
use crate::kernel::simd::MOST;
use crate::kernel::stencil::{PAD, Separable, Window, apply};
use crate::kernel::chebyshev;
use crate::kernel::step::{self, Move, Sums, aligned, pass};
use crate::kernel::vector::add_scaled;

/// Added to the middle of the preconditioner's blur.
const CENTRE: f64 = 0.5;
/// Steps before the least eigenvalue that they show is believed.
const FEW: usize = 4;

/// Steps of a probe between looks at its least eigenvalue, and at most.
const PROBES: (usize, usize) = (4, 40);
/// A probe ends when the least eigenvalue has not fallen below so much of what it was at the last look.
const SETTLED: f64 = 0.93;
/// How many times larger than the Chebyshev polynomials promise the residual may be.
const LATE: f64 = 20.0;
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
    r: &'a mut [f32],
    u: &'a mut [f32],
    /// Free for any use before the solve, with finite numbers.
    pub w: &'a mut [f32],
    p: &'a mut [f32],
    s: &'a mut [f32],
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
        views.p[..rows].fill(0.0);
        views.p[below..].fill(0.0);
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

/// Extreme eigenvalues of the preconditioned matrix.
#[derive(Clone, Copy, Debug)]
pub struct Spectrum {
    /// The least one.
    pub least: f64,
    /// The largest one.
    pub largest: f64,
}

/// How far a local solve came.
#[derive(Clone, Copy, Debug)]
pub struct Ending {
    /// Steps taken: 0 if the image was within the tolerance already.
    pub steps: usize,
    /// Whether the tolerance was met.
    pub converged: bool,
    /// The largest entry of the preconditioned residual at the start and at the end.
    pub tops: (f64, f64),
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

    /// Whether all eigenvalues are below `bound`.
    fn below(&self, bound: f64) -> bool {
        let mut pivot = 1.0;
        self.rows.iter().all(|&(diagonal, square)| {
            pivot = bound - diagonal - square / pivot;
            pivot > 0.0
        })
    }

    /// The least eigenvalue to within 2 %, from below.
    fn least(&self) -> f64 {
        let Some(high) = self.rows.iter().map(|row| row.0).reduce(f64::min) else { return f64::INFINITY };
        bisect(high * 1e-9, high, |bound| self.exceeds(bound)).0
    }

    /// The largest eigenvalue to within 2 %, from above.
    fn largest(&self) -> f64 {
        let Some(low) = self.rows.iter().map(|row| row.0).reduce(f64::max) else { return 0.0 };
        bisect(low, 4.0 * low, |bound| !self.below(bound)).1
    }
}

/// Narrows an interval at whose lower end `holds` is true, and at whose upper end it is not, to 2 %.
fn bisect(mut low: f64, mut high: f64, holds: impl Fn(f64) -> bool) -> (f64, f64) {
    while high > 1.02 * low {
        let middle = (low * high).sqrt();
        if holds(middle) { low = middle } else { high = middle }
    }
    (low, high)
}

/// The extreme eigenvalues of the preconditioned matrix on a window, as conjugate gradients from a rough start show them. The
/// least one is a few percent too large. `None` if nothing is free.
pub fn probe(isa: Isa, a: &Separable<f32>, window: Window, views: Views<'_>) -> Option<Spectrum> {
    let Views { x, d, r, u, w, p, s } = views;
    // A residual that has a share in everything.
    for (k, w) in w.iter_mut().enumerate() {
        *w = ((k as u64).wrapping_mul(0x9e37_79b9_7f4a_7c15) >> 40) as f32 - (1 << 23) as f32;
    }
    let mut go =
        |what: Move| pass(isa, a, window, (what, true), CENTRE, step::Buffers { d, x, r, u, w, p, s });
    let mut lanczos = Lanczos::default();
    let mut sums = go(Move::Begin);
    let (mut length, mut before, mut settled) = (0.0, 0.0, f64::INFINITY);
    for steps in 0..PROBES.1 {
        if sums.square.is_nan() || sums.square <= 0.0 {
            break;
        }
        let ratio = if steps == 0 { 0.0 } else { sums.square / before };
        let conjugate = if steps == 0 { 0.0 } else { ratio * sums.square / length };
        length = sums.square / (sums.curvature - conjugate);
        before = sums.square;
        lanczos.push(length, ratio);
        if steps % PROBES.0 == PROBES.0 - 1 {
            let least = lanczos.least();
            if least > SETTLED * settled {
                break;
            }
            settled = least;
        }
        sums = go(if steps == 0 { Move::First(length) } else { Move::Step(length, ratio) });
    }
    let (least, largest) = (lanczos.least(), lanczos.largest());
    (!lanczos.rows.is_empty()).then_some(Spectrum { least, largest })
}

/// Minimises `x' A x` over the free pixels as [`solve`] does, by the Chebyshev iteration for eigenvalues in `spectrum`: as many
/// steps, at half the price. Where it falls behind what they promise, or `limit` steps are done, conjugate gradients go on.
///
/// Source: G. Golub, R. Varga, "Chebyshev semi-iterative methods, successive overrelaxation iterative methods, and second
/// order Richardson iterative methods", Numerische Mathematik 3, 1961.
pub fn iterate(
    isa: Isa,
    a: &Separable<f32>,
    window: Window,
    views: Views<'_>,
    (target, spectrum): (Target, Spectrum),
    limit: usize,
) -> Ending {
    let Views { x, d, r, u, w, p, s } = views;
    let unit = 1.0 / ((4.0 + CENTRE) * a.diagonal(a.vertical.len / 2, a.horizontal.len / 2));
    let (middle, radius) =
        (0.5 * (spectrum.largest + spectrum.least), 0.5 * (spectrum.largest - spectrum.least));
    let sigma = middle / radius;
    let mut go = |begins: bool, factors: (f64, f64)| {
        let buffers = chebyshev::Buffers { d, x, r, p, q: w };
        chebyshev::pass(isa, a, window, begins, factors, CENTRE, buffers)
    };
    let least = target.least.unwrap_or(spectrum.least);
    let first = go(true, (0.0, 1.0 / middle));
    let (mut top, mut rho, mut promised) = (first, 1.0 / sigma, 1.0);
    for steps in 0..=limit {
        let enough = f64::max(target.floor / unit, target.tolerance * least);
        let end = |steps: usize, top: f64| {
            Ending { steps, converged: top <= enough, tops: (first, top), least, error: top / least }
        };
        if top <= enough || (limit == 0 && top.is_finite()) {
            return end(steps, top);
        }
        let next = 1.0 / (2.0 * sigma - rho);
        if steps > 0 && top * next <= enough {
            // The correction to come is there already, and what it promises suffices.
            add_scaled(isa, x, 1.0, p);
            return end(steps + 1, top * next);
        }
        // A NaN ends here, too.
        if !(top <= LATE * promised * first) {
            break;
        }
        top = go(false, (next * rho, 2.0 * next / radius));
        promised *= next;
        rho = next;
    }
    solve(isa, a, window, Views { x, d, r, u, w, p, s }, target, limit)
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
    let first = sums.top;
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
            return Ending { steps, converged, tops: (first, top), least, error };
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
    Ending { steps: limit, converged: false, tops: (first, sums.top), least: 0.0, error: f64::INFINITY }
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
