//! NESTA: Nesterov's method on a smoothed l1 norm, the smoothing lowered step by step.
//!
//! For `min |U x|_1 subject to |S x - y|_2 <= epsilon` the norm is replaced by
//! `f_mu(x) = max over |u|_inf <= 1 of <u, U x> - mu/2 |u|^2`, at most `mu n / 2` below it, whose gradient `U^T u` is Lipschitz
//! with `L = |U|^2 / mu`. From the centre `x_0` of a step, with `P` the projection on the constraint,
//!
//! ```text
//! y_k = P(x_k - grad f / L),  z_k = P(x_0 - sum_i (i + 1)/2 grad f(x_i) / L),  x_k+1 = 2/(k+3) z_k + (k+1)/(k+3) y_k
//! ```
//!
//! until the objective settles ([`Settling`]); the next step starts there with a smaller `mu` and tolerance, both falling
//! geometrically from 0.9 of the largest entry of `U x_0`, and from 0.1, to what is asked. The level of an image has large entries that say nothing of how
//! far it is from the minimum: smoothed by them it would walk further away than the small last steps come back ([`Sparsity::peak`]).
//!
//! No step is sure to lower the objective. If it is above the first one in the end, `x` is what it was at first, and has not converged unless that is within the
//! tolerance.
//!
//! Cost: an iteration is one `U` and one `U^T`. Memory: four images beside `x`, and the operator's buffers.
//!
//! Source: S. Becker, J. Bobin, E. Candes, "NESTA: A Fast and Accurate First-Order Method for Sparse Recovery", SIAM Journal
//! on Imaging Sciences 4(1), 2011 (algorithm of section 3.1, projection of section 3.3, continuation of section 3.6).

use lacuna_core::parallel::prelude::*;

use super::sparsity::{Ending, ROW, Samples, Settling, Sparsity};
use crate::{Run, Stop};

/// Steps of the continuation.
const STEPS: usize = 5;
/// Tolerance before the first step.
const LOOSE: f64 = 0.1;
/// Share of the largest entry that the smoothing starts below.
const START: f64 = 0.9;

/// When to stop.
#[derive(Clone, Copy, Debug)]
pub struct Goal {
    /// Smoothing of the last step, in units of the entries.
    pub mu: f64,
    /// Relative variation of the objective at which the last step ends.
    pub tolerance: f64,
    /// Iterations of all steps at most.
    pub iterations: usize,
}

/// Improves `x`, which it first projects on the constraint.
pub fn solve<S: Sparsity>(
    operator: &S,
    samples: Samples<'_>,
    goal: Goal,
    x: &mut [f32],
    run: &Run<'_>,
) -> Ending {
    let mut work = operator.work();
    project(samples, x);
    let objective_of = |x: &[f32], work: &mut S::Work| {
        operator.analyse(x, work);
        operator.norm(work)
    };
    let (first, before) = (x.to_vec(), objective_of(x, &mut work));
    let peak = START * operator.peak(x, &mut work);
    let (mut mu, mut tolerance) = (peak.max(goal.mu), LOOSE.max(goal.tolerance));
    let factors = [goal.mu / mu, goal.tolerance / tolerance].map(|f| f.powf(1.0 / STEPS as f64));
    let mut stop = Stop::Converged;
    let mut iterations = 0;
    let mut buffers = Buffers::new(x.len());
    for _ in 0..STEPS {
        (mu, tolerance) = (mu * factors[0], tolerance * factors[1]);
        let step = Step { operator, samples, mu, tolerance };
        let left = goal.iterations - iterations;
        let (taken, ended) = step.solve(x, &mut buffers, &mut work, left, run);
        iterations += taken;
        stop = ended;
        if stop != Stop::Converged {
            break;
        }
    }
    let mut objective = objective_of(x, &mut work);
    if objective > before {
        if objective > before * (1.0 + goal.tolerance) {
            stop = stop.max(Stop::IterationLimit);
        }
        x.copy_from_slice(&first);
        objective = before;
    }
    Ending { stop, iterations, objective, distance: samples.distance(|i| x[i]) }
}

/// Moves measured pixels on the constraint.
pub fn project(samples: Samples<'_>, x: &mut [f32]) {
    let keep = samples.keep(|i| x[i]);
    let at = samples.measured.par_iter().zip(samples.values);
    x.par_iter_mut().zip(at).with_min_len(ROW).for_each(|(x, (&measured, &value))| {
        if measured {
            *x = if keep == 0.0 { value } else { value + keep * (*x - value) };
        }
    });
}

/// Images of one step.
#[derive(Clone, Debug)]
pub struct Buffers {
    centre: Vec<f32>,
    /// The weighted sum of the gradients so far.
    sum: Vec<f32>,
    gradient: Vec<f32>,
}

impl Buffers {
    /// Buffers for images of so many pixels.
    pub fn new(pixels: usize) -> Self {
        let zeros = vec![0.0; pixels];
        Self { centre: zeros.clone(), sum: zeros.clone(), gradient: zeros }
    }
}

/// One step of the continuation.
#[derive(Clone, Copy, Debug)]
pub struct Step<'a, S> {
    /// `U`.
    pub operator: &'a S,
    /// The constraint.
    pub samples: Samples<'a>,
    /// The smoothing.
    pub mu: f64,
    /// Relative variation of the smoothed objective at which it ends.
    pub tolerance: f64,
}

impl<S: Sparsity> Step<'_, S> {
    /// Improves `x`, which satisfies the constraint, in at most `limit` iterations; how many it took, and why it ended.
    pub fn solve(
        &self,
        x: &mut [f32],
        buffers: &mut Buffers,
        work: &mut S::Work,
        limit: usize,
        run: &Run<'_>,
    ) -> (usize, Stop) {
        buffers.centre.copy_from_slice(x);
        buffers.sum.fill(0.0);
        let mut settling = Settling::default();
        for k in 0..limit {
            if let Some(stop) = run.interrupted() {
                return (k, stop);
            }
            self.operator.analyse(x, work);
            let objective = self.operator.soften(work, self.mu);
            self.operator.adjoint(work, &mut buffers.gradient);
            self.advance(k, x, buffers);
            if settling.enter(objective, self.tolerance) {
                return (k + 1, Stop::Converged);
            }
        }
        (limit, Stop::IterationLimit)
    }

    /// From the gradient at `x` to the next `x`.
    fn advance(&self, k: usize, x: &mut [f32], buffers: &mut Buffers) {
        let step = (self.mu / self.operator.bound()) as f32;
        let weight = 0.5 * (k + 1) as f32;
        let sums = buffers.sum.par_iter_mut().zip(&buffers.gradient).with_min_len(ROW);
        sums.for_each(|(sum, gradient)| *sum += weight * gradient);
        let Buffers { centre, sum, gradient } = &*buffers;
        let (keep_y, keep_z) = {
            let x = &*x;
            let y = self.samples.keep(|i| x[i] - step * gradient[i]);
            (y, self.samples.keep(|i| centre[i] - step * sum[i]))
        };
        let share = 2.0 / (k + 3) as f32;
        let images = centre.par_iter().zip(sum).zip(gradient);
        let samples = self.samples.measured.par_iter().zip(self.samples.values);
        let all = x.par_iter_mut().zip(images.zip(samples)).with_min_len(ROW);
        all.for_each(|(x, (((centre, sum), gradient), (&measured, &value)))| {
            let (mut y, mut z) = (*x - step * gradient, centre - step * sum);
            if measured {
                if keep_y == 0.0 && keep_z == 0.0 {
                    // A mean of equals may round.
                    *x = value;
                    return;
                }
                y = value + keep_y * (y - value);
                z = value + keep_z * (z - value);
            }
            *x = share * z + (1.0 - share) * y;
        });
    }
}
