//! Conjugate gradients with a multigrid cycle as preconditioner.
//!
//! All of it is in the numbers of the cycle. In f32 rounding makes that a slightly different map at every iteration, which the
//! flexible form allows for, and the residual drifts from the true one: whoever calls takes a few digits at a time
//! ([`Goal::gain`]) and comes again with a residual computed in f64.
//!
//! Corrections become small in most places long before they do so in all: cells where they are small are left out ([`Goal::spare`]),
//! as if they were held, and the directions of the others begin anew.
//!
//! Source: M. Hestenes, E. Stiefel, "Methods of conjugate gradients for solving linear systems", J. Res. NBS 49, 1952;
//! Y. Notay, "Flexible conjugate gradients", SIAM J. Sci. Comput. 22, 2000.

use super::lanczos::Lanczos;
use super::multigrid::{CELL, Multigrid, Workspace};
use crate::kernel::gradients::Sums;
use crate::kernel::simd::Lanes;
use crate::kernel::vector;
use crate::{Run, Stop};

/// How a solve ended.
#[derive(Clone, Copy, Debug)]
pub struct Ending {
    /// Why it stopped.
    pub stop: Stop,
    /// Iterations taken.
    pub iterations: usize,
    /// The residual's norm, measured by the preconditioner, over that of the start; without cells that were left out.
    pub residual: f64,
    /// Largest error left, by the last correction and the least eigenvalue.
    pub left: f64,
    /// Least eigenvalue of the preconditioned matrix as far as it has shown or was known; infinite if neither, as after a few
    /// iterations.
    pub least: f64,
}

/// Iterations before the least eigenvalue that they show is believed.
const FEW: usize = 3;
/// The least eigenvalue of the preconditioned matrix where nothing is known of it.
const UNKNOWN: f64 = 0.4;
/// Iterations after which the solver gives up.
const LIMIT: usize = 2000;

/// When to stop, in the units of the residual's correction.
#[derive(Clone, Copy, Debug)]
pub struct Goal {
    /// Largest entry of a cycle's correction that may be left.
    pub tolerance: f64,
    /// Largest error that may be left once the last correction is added, by the least eigenvalue of the preconditioned matrix.
    pub error: f64,
    /// What is known of that eigenvalue.
    pub least: Option<f64>,
    /// The tolerance over the largest entry of the first cycle's correction: what the numbers can hold.
    pub gain: f64,
    /// The error up to which a cell may be left out, by the same eigenvalue; zero to keep all.
    pub spare: f64,
    /// Iterations without a new smallest correction after which rounding has the upper hand.
    pub patience: usize,
}

impl Goal {
    /// The error that a correction leaves, over its largest entry.
    fn left(&self, lanczos: &Lanczos, steps: usize) -> f64 {
        let seen = lanczos.least();
        let least = match self.least {
            Some(known) => known.min(seen),
            None if steps < FEW => UNKNOWN,
            None => seen,
        };
        // A correction leaves `1 - least` of the error, or what the largest eigenvalues (up to 1.5) overshoot.
        (1.0 - least).max(0.5) / least
    }

    /// Whether it is met by a correction with this largest entry, which leaves this error, the first one's entry being `first`.
    fn met(&self, top: f64, left: f64, first: f64) -> bool {
        top <= self.tolerance.max(self.gain * first) || left <= self.error
    }
}

/// Solves for the correction of the residual that stands in the workspace, and leaves it there, until no entry of a cycle's
/// correction exceeds what the goal says. The last cycle's correction is added as it is.
pub fn solve<T: Lanes>(
    grids: &Multigrid<T>,
    workspace: &mut Workspace<T>,
    mut goal: Goal,
    run: &Run<'_>,
) -> Ending {
    let isa = grids.isa();
    let (mut before, mut curvature, mut first, mut step) = (0.0, 0.0, (0.0, 0.0), 0.0);
    let (mut smallest, mut age) = (f64::INFINITY, 0);
    // `steps`: those since the directions began.
    let (mut iterations, mut steps) = (0, 0);
    let mut lanczos = Lanczos::default();
    workspace.vectors().c.fill(T::ZERO);
    let (stop, rz, left) = loop {
        grids.cycle(workspace);
        let mut vectors = workspace.vectors();
        let begins = steps == 0;
        let (Sums { residual: rz, energy, before: zq }, tops) = vectors.sums(isa, begins, CELL);
        let top = tops.iter().copied().fold(0.0, f64::max);
        if iterations == 0 {
            first = (rz, top);
        }
        (smallest, age) = if top < smallest { (top, 0) } else { (smallest, age + 1) };
        let share = goal.left(&lanczos, steps);
        let left = share * top;
        let stop = if goal.met(top, left, first.1) {
            Some(Stop::Converged)
        } else if age > goal.patience || rz.is_nan() || rz <= 0.0 || iterations == LIMIT {
            Some(Stop::IterationLimit)
        } else {
            run.interrupted()
        };
        if let Some(stop) = stop {
            if stop == Stop::Converged {
                vector::add_scaled(isa, vectors.c, 1.0, vectors.z);
            }
            break (stop, rz, left);
        }
        // `z' (r - r_before) = -step z' q`.
        let ratio = if begins { 0.0 } else { -step * zq / before };
        before = rz;
        // `p' A p` of the new direction.
        curvature = energy + ratio * (2.0 * zq + ratio * curvature);
        if curvature.is_nan() || curvature <= 0.0 {
            break (Stop::IterationLimit, rz, left);
        }
        // `p' r = r' z`, as the step before has left nothing along the direction before.
        step = rz / curvature;
        lanczos.push(step, ratio.max(0.0));
        vectors.step(isa, begins, (step, ratio));
        (iterations, steps) = (iterations + 1, steps + 1);
        if goal.spare > 0.0 && grids.leave_out(workspace, &tops, goal.spare / share) {
            goal.least = known(goal.least, &lanczos, steps);
            (lanczos, steps, smallest, age) = (Lanczos::default(), 0, f64::INFINITY, 0);
        }
    };
    let residual = if first.0 > 0.0 { (rz.max(0.0) / first.0).sqrt() } else { 0.0 };
    let least = known(goal.least, &lanczos, steps).unwrap_or(f64::INFINITY);
    Ending { stop, iterations, residual, left, least }
}

/// What is known of the least eigenvalue after so many steps.
fn known(before: Option<f64>, lanczos: &Lanczos, steps: usize) -> Option<f64> {
    let seen = Some(lanczos.least()).filter(|_| steps >= FEW);
    before.into_iter().chain(seen).reduce(f64::min)
}
