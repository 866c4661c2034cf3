//! Solves on a small window whose free unknowns all have measured pixels near: the Chebyshev iteration and conjugate gradients
//! in f32.
//!
//! There the energy, preconditioned by the masked blur or, at order 3, by a sparse factor of its inverse, is so well conditioned
//! that ten to twenty steps suffice and f32 is enough.
//! Where the extreme eigenvalues are known beforehand, as they are much the same in all windows of a mask, the Chebyshev
//! iteration needs as many steps as conjugate gradients, and a step moves half as much memory; these find the eigenvalues, and
//! take over where they were wrong. What an iteration needs of a window of 136 x 192 are four buffers of 120 kB, in L2; with the
//! sparse factor eight.
//!
//! Source: M. Hestenes, E. Stiefel, "Methods of conjugate gradients for solving linear systems", J. Res. NBS 49, 1952;
//! G. Golub, R. Varga, "Chebyshev semi-iterative methods, successive overrelaxation iterative methods, and second order
//! Richardson iterative methods", Numerische Mathematik 3, 1961.

use crate::kernel::Isa;
use crate::kernel::aligned::Aligned;
use crate::kernel::chebyshev::{self, Turn};
use crate::kernel::factor::PLANES;
use crate::kernel::preconditioner::Preconditioner;
use crate::kernel::stencil::{Separable, apply};
use crate::kernel::step::{self, Move, Sums, pass};
use crate::kernel::vector::add_scaled;
use crate::kernel::window::{PAD, Window};
use crate::solver::factor::Factors;
use crate::solver::lanczos::Lanczos;

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
    all: Aligned<f32>,
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
    /// With `d` before them the planes of the sparse factor, if it is the preconditioner.
    planes: [&'a mut [f32]; PLANES - 1],
}

impl Views<'_> {
    /// What stands in `w`, and the planes of the sparse factor.
    pub fn factor(&mut self) -> (&[f32], [&mut [f32]; PLANES]) {
        let [b, c, d, e] = &mut self.planes;
        (self.w, [self.d, b, c, d, e])
    }
}

/// How many buffers there are.
const BUFFERS: usize = 6 + PLANES;

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
        if self.all.len() < BUFFERS * apart {
            self.all = Aligned::zeros(BUFFERS * apart);
        }
        let mut rest = &mut self.all[..];
        let mut next = || {
            let (own, others) = std::mem::take(&mut rest).split_at_mut(apart);
            rest = others;
            &mut own[..length]
        };
        let (x, d, r, u, w, p, s) = (next(), next(), next(), next(), next(), next(), next());
        let planes = std::array::from_fn(|_| next());
        Views { x, d, r, u, w, p, s, planes }
    }
}

/// The preconditioner of an energy, whose diagonal or planes have been set.
fn preconditioner<'a>(
    a: &Separable<f32>,
    d: &'a [f32],
    planes: [&'a mut [f32]; PLANES - 1],
) -> Preconditioner<'a, f32> {
    if !Factors::suit(a.terms) {
        return Preconditioner::Blur { d, c: CENTRE };
    }
    let mut all = [d; PLANES];
    for (own, plane) in all[1..].iter_mut().zip(planes) {
        *own = plane;
    }
    Preconditioner::Factor(all)
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

/// Eigenvalues of the preconditioned matrix.
#[derive(Clone, Copy, Debug)]
pub struct Spectrum {
    /// The least one, as it bounds errors.
    pub least: f64,
    /// Where the interval begins that the Chebyshev iteration is for: the few below it have little share in a residual.
    pub begin: f64,
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

/// The correction of a pixel among free ones over its entry of the preconditioned residual, if it were alone.
fn lone(a: &Separable<f32>) -> f64 {
    if Factors::suit(a.terms) {
        return 1.0;
    }
    1.0 / ((4.0 + CENTRE) * a.diagonal(a.vertical.len / 2, a.horizontal.len / 2))
}

/// The numbers that conjugate gradients carry from step to step.
#[derive(Default)]
struct Steps {
    length: f64,
    /// `r' M r` of the step before.
    square: f64,
    lanczos: Lanczos,
}

impl Steps {
    /// The step that follows from the sums of the pass before.
    fn next(&mut self, sums: Sums) -> Move {
        let begins = self.lanczos.is_empty();
        let share = if begins { 0.0 } else { sums.square / self.square };
        let conjugate = if begins { 0.0 } else { share * sums.square / self.length };
        self.length = sums.square / (sums.curvature - conjugate);
        self.square = sums.square;
        self.lanczos.push(self.length, share);
        if begins { Move::First(self.length) } else { Move::Step(self.length, share) }
    }
}

/// The extreme eigenvalues of the preconditioned matrix on a window, as conjugate gradients from a rough start show them. The
/// least one is a few percent too large. `None` if nothing is free.
pub fn probe(isa: Isa, a: &Separable<f32>, window: Window, views: Views<'_>) -> Option<Spectrum> {
    let Views { x, d, r, u, w, p, s, planes } = views;
    let m = preconditioner(a, d, planes);
    // A residual that has a share in everything: the upper bits of multiples of an odd number, without their mean.
    for (k, w) in w.iter_mut().enumerate() {
        *w = ((k as u64).wrapping_mul(0x9e37_79b9_7f4a_7c15) >> 40) as f32 - (1 << 23) as f32;
    }
    let mut go = |what: Move| pass(isa, a, window, (what, true), step::Buffers { m, x, r, u, w, p, s });
    let mut steps = Steps::default();
    let mut sums = go(Move::Begin);
    let mut settled = f64::INFINITY;
    for step in 1..=PROBES.1 {
        if sums.square.is_nan() || sums.square <= 0.0 {
            break;
        }
        let what = steps.next(sums);
        if step % PROBES.0 == 0 {
            let least = steps.lanczos.least();
            if least > SETTLED * settled {
                break;
            }
            settled = least;
        }
        sums = go(what);
    }
    let (least, largest) = (steps.lanczos.least(), steps.lanczos.largest());
    (!steps.lanczos.is_empty()).then_some(Spectrum { least, begin: least, largest })
}

/// Minimises `x' A x` over the free pixels as [`solve`] does, by the Chebyshev iteration for eigenvalues in `spectrum`: as many
/// steps, each of which moves half as much memory. Where it falls behind what they promise, or `limit` steps are done,
/// conjugate gradients go on.
pub fn iterate(
    isa: Isa,
    a: &Separable<f32>,
    window: Window,
    views: Views<'_>,
    (target, spectrum): (Target, Spectrum),
    limit: usize,
) -> Ending {
    let Views { x, d, r, u, w, p, s, planes } = views;
    let m = preconditioner(a, d, planes);
    let unit = lone(a);
    let (middle, radius) =
        (0.5 * (spectrum.largest + spectrum.begin), 0.5 * (spectrum.largest - spectrum.begin));
    let sigma = middle / radius;
    let mut go = |turn: Turn, factors: (f64, f64)| {
        let buffers = chebyshev::Buffers { m, x, r, p, q: w };
        chebyshev::pass(isa, a, window, turn, factors, buffers)
    };
    let least = target.least.unwrap_or(spectrum.least);
    let first = go(Turn::Begin, (0.0, 1.0 / middle));
    let (mut top, mut rho, mut promised) = (first, 1.0 / sigma, 1.0);
    // What the last step left of the residual.
    let mut share = 0.0;
    for steps in 0..=limit {
        let enough = f64::max(target.floor / unit, target.tolerance * least);
        let end = |steps: usize, top: f64| Ending {
            steps,
            converged: top <= enough,
            tops: (first, top),
            least,
            error: top / least,
        };
        if top <= enough || limit == 0 {
            return end(steps, top);
        }
        let next = 1.0 / (2.0 * sigma - rho);
        let foreseen = top * f64::max(next, share);
        if steps > 0 && foreseen <= enough {
            // The correction to come is there already, and suffices; after an odd number of steps the image has it.
            if steps % 2 == 0 {
                add_scaled(isa, x, 1.0, p);
            }
            return end(steps + 1, foreseen);
        }
        if top.is_nan() || top > LATE * promised * first {
            break;
        }
        let before = top;
        let turn = if steps % 2 == 0 { Turn::Take } else { Turn::Hold };
        top = go(turn, (next * rho, 2.0 * next / radius));
        share = top / before;
        promised *= next;
        rho = next;
    }
    let ending = conjugate(isa, a, window, step::Buffers { m, x, r, u, w, p, s }, target, limit);
    // The image has moved, whatever was left to do.
    Ending { steps: ending.steps + 1, tops: (first, ending.tops.1), ..ending }
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
    let Views { x, d, r, u, w, p, s, planes } = views;
    let m = preconditioner(a, d, planes);
    conjugate(isa, a, window, step::Buffers { m, x, r, u, w, p, s }, target, limit)
}

/// The same with a preconditioner.
fn conjugate(
    isa: Isa,
    a: &Separable<f32>,
    window: Window,
    buffers: step::Buffers<'_, f32>,
    target: Target,
    limit: usize,
) -> Ending {
    let step::Buffers { m, x, r, u, w, p, s } = buffers;
    let unit = lone(a);
    apply(isa, a, window, x, None, w);
    let mut go = |what: Move, applies: bool| -> Sums {
        pass(isa, a, window, (what, applies), step::Buffers { m, x, r, u, w, p, s })
    };
    // Where the least eigenvalue is known, most windows have nothing left to do.
    let mut sums = go(Move::Begin, target.least.is_none());
    let first = sums.top;
    let mut recurrence = Steps::default();
    for steps in 0..=limit {
        let Sums { square, top, .. } = sums;
        let bound = top / target.tolerance;
        let known = target.least.map_or(steps >= FEW, |least| least >= bound);
        // The largest of some numbers does not tell that others are none.
        if !square.is_finite() {
            let least = target.least.unwrap_or(0.0);
            return Ending {
                steps: 0,
                converged: false,
                tops: (first, f64::INFINITY),
                least,
                error: f64::INFINITY,
            };
        }
        let converged = top * unit <= target.floor || (known && recurrence.lanczos.exceeds(bound));
        if converged || steps == limit || square <= 0.0 {
            let least = recurrence.lanczos.least().min(target.least.unwrap_or(f64::INFINITY));
            let error = if top > 0.0 { top / least } else { 0.0 };
            return Ending { steps, converged, tops: (first, top), least, error };
        }
        if steps == 0 && target.least.is_some() {
            sums = go(Move::Begin, true);
        }
        sums = go(recurrence.next(sums), true);
    }
    Ending { steps: limit, converged: false, tops: (first, sums.top), least: 0.0, error: f64::INFINITY }
}

#[cfg(test)]
mod tests;
