//! Total variation for a larger image: the least sum of gradient lengths among the images that reduce to the input.
//!
//! ```text
//! min_x |x|_TV   subject to   (R x)_i = y_i at the measured pixels i,     low <= x <= high
//! ```
//!
//! `R` and `y` as in [`super`], `|x|_TV` as in [`crate::variational::tv`]. With missing pixels this fills and enlarges in one
//! problem: only what was measured binds `x`. `low..high` is the measured range and half as much to either side.
//!
//! Algorithm: over-relaxed primal-dual sweeps from the spline, in the affine space of the constraint:
//!
//! ```text
//! d = -tau P grad* q,   x~ = x + d,   q~ = clip(q + sigma grad (x~ + d)),   (x, q) <- (x, q) + rho ((x~, q~) - (x, q))
//! ```
//!
//! where `P = 1 - R' (R R')^-1 R` projects on the changes that the measured pixels do not see. Where pixels are missing and
//! footprints overlap, `(R R')^-1` of the measured rows alone is a few steps of conjugate gradients.
//! Stops on the duality gap `(|x|_TV - D) / |x|_TV`: for any `q` in the unit ball and any `m`, with `w = grad* q - R' m`,
//! `D = m' y + sum_j min(low w_j, high w_j)` bounds the minimum from below; `m` is the one of the projection. Over-relaxed `q` may lie
//! outside the ball, and `w` is slow to vanish where an image is flat. So before a bound is taken `q` is made nearly free of what the
//! measured pixels do not see, by projected descent on `|P grad* q|^2 / 2`,
//!
//! ```text
//! q <- clip(q - alpha_k grad (P grad* q))
//! ```
//!
//! with the steps of `tighten`, and the sweeps go on from there. (Without it an alpha at 3x, 0.01 from the bound, took more than 2000
//! sweeps, long after its image had settled; with it 300.)
//! In the end the bounds are made to hold exactly ([`super::settle`]).
//!
//! Boundary: no gradient across the border. Source: as [`crate::variational::tv`]. Settings: those of it; `epsilon` is 0, as the
//! constraint is exact. Cost: a sweep takes about 60 operations and four passes of `R` a pixel, a look at the gap as much as 18 sweeps or more;
//! 60 to 300 sweeps.
//! Fails: smooth shading becomes flat steps of the size of a low-resolution pixel; it is slower than `ss` by two orders.

use lacuna_core::parallel::prelude::*;

use super::{Enlarged, Plan, Question, settle};
use crate::kernel::vector;
use crate::prox::Norm;
use crate::variational::tv::{Settings, tighten};
use crate::{Error, Mask, Outcome, Plane, Run, Size, Stop, kernel::Isa};

/// Sweeps between two looks at the gap at least, and the part of those that were done by which they grow.
const CHECK: (usize, usize) = (20, 4);
/// Pixels a sample at which [`tighten`]'s usual number of steps is right.
const USUAL: f64 = 5.0;
/// Over-relaxation.
const RHO: f32 = 1.6;
/// `tau sigma |grad|^2`, below 1.
const PRODUCT: f32 = 0.99;
/// Primal step over the mean gradient of the start.
const STEP: f64 = 1.6;
/// Conjugate-gradient steps and the relative residual that a projection with missing pixels takes.
const INNER: (usize, f64) = (12, 1e-3);

/// Enlarges one channel, from the spline.
pub(super) fn enlarge(
    plan: &Plan,
    settings: Settings,
    (samples, question): (&Plane, &Question<'_>),
    start: Enlarged,
    run: &Run<'_>,
) -> Result<Enlarged, Error> {
    settings.check()?;
    let (low, high) = range(samples, question.mask);
    let is_over = matches!(start.outcome.stop, Stop::TimeLimit | Stop::Cancelled);
    if is_over || low >= high || start.plane.size().pixels() == 1 {
        return Ok(start);
    }
    let mut solver = Solver::new(plan, settings, (samples, question.mask), start.plane);
    let outcome = solver.run((low, high), run);
    let Solver { x, .. } = solver;
    // What the missing pixels are now, so that the bounds may be settled for all.
    let seen = plan.model.reduce(&x);
    let measured = |at: usize| question.mask.is_none_or(|mask| mask.as_slice()[at]);
    let values = samples.pixels().iter().zip(seen.pixels()).enumerate();
    let values = values.map(|(at, (given, seen))| if measured(at) { *given } else { *seen }).collect();
    let whole = Plane::new(samples.size(), values)?;
    let settled = settle::settle(plan, (&whole, None), x, question, run);
    Ok(Enlarged { outcome: settled.outcome.worst(outcome), ..settled })
}

/// The range of the measured values.
fn range(samples: &Plane, mask: Option<&Mask>) -> (f32, f32) {
    let counts = |at: usize| mask.is_none_or(|mask| mask.as_slice()[at]);
    let values = samples.pixels().iter().enumerate().filter(|(at, _)| counts(*at)).map(|(_, value)| *value);
    values.fold((f32::INFINITY, f32::NEG_INFINITY), |(low, high), value| (low.min(value), high.max(value)))
}

/// The problem on its way.
struct Solver<'a> {
    plan: &'a Plan,
    settings: Settings,
    samples: &'a Plane,
    /// Only if a pixel is missing.
    mask: Option<&'a Mask>,
    x: Plane,
    vertical: Plane,
    horizontal: Plane,
    tau: f32,
    sigma: f32,
}

impl<'a> Solver<'a> {
    fn new(
        plan: &'a Plan,
        settings: Settings,
        (samples, mask): (&'a Plane, Option<&'a Mask>),
        x: Plane,
    ) -> Self {
        let mask = mask.filter(|mask| !mask.is_full());
        let zeros = || Plane::filled(x.size(), 0.0);
        let (vertical, horizontal) = (zeros(), zeros());
        let mut solver =
            Self { plan, settings, samples, mask, x, vertical, horizontal, tau: 1.0, sigma: 1.0 };
        let mean = solver.variation() / solver.x.size().pixels() as f64;
        solver.tau = (STEP * mean.max(f64::from(f32::MIN_POSITIVE))) as f32;
        solver.sigma = PRODUCT / 8.0 / solver.tau;
        solver
    }

    /// Sweeps until the gap is small, or someone wants the end.
    fn run(&mut self, (low, high): (f32, f32), run: &Run<'_>) -> Outcome {
        let margin = 0.5 * (high - low);
        let bounds = (low - margin, high + margin);
        let mut outcome = Outcome { stop: Stop::IterationLimit, ..Outcome::direct() };
        let alphas = tighten::step_sizes(self.sparsity() / USUAL);
        let mut best = f64::NEG_INFINITY;
        while outcome.iterations < self.settings.max_iterations {
            let count = CHECK.0.max(outcome.iterations / CHECK.1);
            for _ in 0..count.min(self.settings.max_iterations - outcome.iterations) {
                if let Some(stop) = run.interrupted() {
                    outcome.stop = stop;
                    return outcome;
                }
                self.sweep();
                outcome.iterations += 1;
            }
            for alpha in &alphas {
                if let Some(stop) = run.interrupted() {
                    outcome.stop = stop;
                    return outcome;
                }
                self.repair(*alpha);
            }
            let objective = self.variation();
            best = best.max(self.bound(bounds));
            let gap = ((objective - best) / objective.max(f64::MIN_POSITIVE)).max(0.0);
            outcome.gap = Some(gap);
            if gap <= self.settings.gap {
                outcome.stop = Stop::Converged;
                break;
            }
        }
        outcome
    }

    /// Pixels of the result for each that binds it.
    fn sparsity(&self) -> f64 {
        let bound = self.mask.map_or_else(|| self.samples.size().pixels(), Mask::count);
        self.x.size().pixels() as f64 / bound.max(1) as f64
    }

    fn sweep(&mut self) {
        let mut step = self.divergence(self.tau);
        self.project(&mut step);
        let mut over = self.x.clone();
        vector::add_scaled(Isa::best(), over.pixels_mut(), 2.0, step.pixels());
        vector::add_scaled(Isa::best(), self.x.pixels_mut(), f64::from(RHO), step.pixels());
        self.step((self.sigma, RHO), &over);
    }

    /// One step of projected descent on what of `grad* q` the measured pixels do not see; leaves `q` in its ball.
    fn repair(&mut self, alpha: f32) {
        let mut unseen = self.divergence(-1.0);
        self.project(&mut unseen);
        self.step((-alpha, 1.0), &unseen);
    }

    /// `q + rho (clip(q + sigma grad image) - q)`.
    fn step(&mut self, rates: (f32, f32), image: &Plane) {
        let (size, norm) = (image.size(), self.settings.norm);
        let rows = self.vertical.pixels_mut().par_chunks_mut(size.width);
        rows.zip(self.horizontal.pixels_mut().par_chunks_mut(size.width)).enumerate().for_each(
            |(y, (v, h))| {
                let below = image.row((y + 1).min(size.height - 1));
                dual(norm, rates, (v, h), image.row(y), below);
            },
        );
    }

    /// `-factor grad* q`.
    fn divergence(&self, factor: f32) -> Plane {
        let Size { width, .. } = self.x.size();
        let mut out = Plane::filled(self.x.size(), 0.0);
        out.pixels_mut().par_chunks_mut(width).enumerate().for_each(|(y, out)| {
            let (v, h) = (self.vertical.row(y), self.horizontal.row(y));
            for ((out, v), h) in out.iter_mut().zip(v).zip(h) {
                *out = factor * (v + h);
            }
            if y > 0 {
                out.iter_mut().zip(self.vertical.row(y - 1)).for_each(|(out, v)| *out -= factor * v);
            }
            out[1..].iter_mut().zip(h).for_each(|(out, h)| *out -= factor * h);
        });
        out
    }

    /// Takes off what the measured pixels see; returns the multipliers.
    fn project(&self, step: &mut Plane) -> Plane {
        let mut seen = self.plan.model.reduce(step);
        let multiplier = match self.mask {
            None => self.plan.model.gram_inverse(&seen),
            Some(mask) => {
                keep(&mut seen, mask);
                self.solve(&seen, mask)
            }
        };
        let back = self.plan.model.adjoint(&multiplier);
        vector::add_scaled(Isa::best(), step.pixels_mut(), -1.0, back.pixels());
        multiplier
    }

    /// `(R_m R_m')^-1 b` over the measured pixels, by conjugate gradients with the inverse of the whole before it; where
    /// footprints share nothing that is exact at once.
    fn solve(&self, b: &Plane, mask: &Mask) -> Plane {
        let isa = Isa::best();
        let inverse = |r: &Plane| {
            let mut z = self.plan.model.gram_inverse(r);
            keep(&mut z, mask);
            z
        };
        let mut x = Plane::filled(b.size(), 0.0);
        let mut r = b.clone();
        let mut z = inverse(&r);
        let mut p = z.clone();
        let mut square = vector::dot(isa, r.pixels(), z.pixels());
        let first = square;
        for _ in 0..INNER.0 {
            if square <= first * INNER.1 * INNER.1 || square <= 0.0 {
                break;
            }
            let mut q = self.plan.model.reduce(&self.plan.model.adjoint(&p));
            keep(&mut q, mask);
            let length = vector::dot(isa, p.pixels(), q.pixels());
            if length <= 0.0 {
                break;
            }
            let a = square / length;
            vector::add_scaled(isa, x.pixels_mut(), a, p.pixels());
            vector::add_scaled(isa, r.pixels_mut(), -a, q.pixels());
            z = inverse(&r);
            let next = vector::dot(isa, r.pixels(), z.pixels());
            vector::scale_add(isa, p.pixels_mut(), next / square, z.pixels());
            square = next;
        }
        x
    }

    /// A lower bound of the minimum.
    fn bound(&self, (low, high): (f32, f32)) -> f64 {
        // grad* q = R' m + w: the divergence is its negative, and so are the multipliers.
        let mut w = self.divergence(-1.0);
        let multiplier = self.project(&mut w);
        let given = vector::dot(Isa::best(), multiplier.pixels(), self.samples.pixels());
        let (low, high) = (f64::from(low), f64::from(high));
        let rows = w.pixels().par_chunks(self.x.size().width);
        let least =
            rows.map(|row| row.iter().map(|w| f64::from(*w)).map(|w| (low * w).min(high * w)).sum::<f64>());
        // In the order of the rows, whatever the threads.
        given + least.into_iter().sum::<f64>()
    }

    /// The total variation of the image.
    fn variation(&self) -> f64 {
        let size = self.x.size();
        let rows = (0..size.height).into_par_iter().map(|y| {
            let (row, below) = (self.x.row(y), self.x.row((y + 1).min(size.height - 1)));
            let length = |x: usize| {
                let right = row[(x + 1).min(size.width - 1)];
                self.settings.norm.of([f64::from(below[x] - row[x]), f64::from(right - row[x])])
            };
            (0..size.width).map(length).sum::<f64>()
        });
        rows.into_iter().sum()
    }
}

/// Sets missing pixels to zero.
fn keep(plane: &mut Plane, mask: &Mask) {
    for (value, flag) in plane.pixels_mut().iter_mut().zip(mask.as_slice()) {
        *value = if *flag { *value } else { 0.0 };
    }
}

/// The dual step of a row; there is no gradient across the border.
fn dual(norm: Norm, (sigma, rho): (f32, f32), (v, h): (&mut [f32], &mut [f32]), row: &[f32], below: &[f32]) {
    let mut one = |x: usize, right: f32| {
        let (a, b) = (v[x] + sigma * (below[x] - row[x]), h[x] + sigma * (right - row[x]));
        let (a, b) = match norm {
            Norm::Isotropic => {
                let shrink = 1.0 / (a * a + b * b).sqrt().max(1.0);
                (a * shrink, b * shrink)
            }
            Norm::Anisotropic => (a.clamp(-1.0, 1.0), b.clamp(-1.0, 1.0)),
        };
        v[x] += rho * (a - v[x]);
        h[x] += rho * (b - h[x]);
    };
    let last = row.len() - 1;
    for x in 0..last {
        one(x, row[x + 1]);
    }
    one(last, row[last]);
}
