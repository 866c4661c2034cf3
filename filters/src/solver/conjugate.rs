//! Conjugate gradients with a multigrid cycle as preconditioner.
//!
//! All of it is in the numbers of the cycle. In f32 rounding makes that a slightly different map at every iteration, which the
//! flexible form allows for, and the residual drifts from the true one: whoever calls takes a few digits at a time
//! ([`Goal::gain`]) and comes again with a residual computed in f64.
//!
//! Source: M. Hestenes, E. Stiefel, "Methods of conjugate gradients for solving linear systems", J. Res. NBS 49, 1952;
//! Y. Notay, "Flexible conjugate gradients", SIAM J. Sci. Comput. 22, 2000.

use super::lanczos::Lanczos;
use super::multigrid::{Multigrid, Workspace};
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
    /// The residual's norm, measured by the preconditioner, over that of the start.
    pub residual: f64,
    /// Largest entry of the first cycle's correction.
    pub first: f64,
    /// Least eigenvalue of the preconditioned matrix as far as it has shown or was known; infinite if neither.
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
    /// Iterations without a new smallest correction after which rounding has the upper hand.
    pub patience: usize,
}

impl Goal {
    /// Whether it is met by a correction with this largest entry, the first one's being `first`.
    fn met(&self, top: f64, first: f64, lanczos: &Lanczos, steps: usize) -> bool {
        let seen = lanczos.least();
        let least = match self.least {
            Some(known) => known.min(seen),
            None if steps < FEW => UNKNOWN,
            None => seen,
        };
        // A correction leaves `1 - least` of the error, or what the largest eigenvalues (up to 1.5) overshoot.
        let left = top * (1.0 - least).max(0.5) / least;
        top <= self.tolerance.max(self.gain * first) || left <= self.error
    }
}

/// Solves for the correction `c` of the residual that stands in the workspace, until no entry of a cycle's correction exceeds
/// what the goal says. The last cycle's correction is added as it is.
pub fn solve<T: Lanes>(
    grids: &Multigrid<T>,
    workspace: &mut Workspace<T>,
    c: &mut [T],
    goal: Goal,
    run: &Run<'_>,
) -> Ending {
    let (isa, window) = (grids.isa(), grids.window());
    let (mut p, mut q) = (window.zeros::<T>(), window.zeros::<T>());
    let (mut before, mut first, mut step) = (0.0, (0.0, 0.0), 0.0);
    let (mut smallest, mut age) = (f64::INFINITY, 0);
    let mut iterations = 0;
    let mut lanczos = Lanczos::default();
    let stop = loop {
        grids.cycle(workspace);
        let (r, z) = workspace.finest();
        let (rz, top) = vector::dot(isa, r, z);
        if iterations == 0 {
            first = (rz, top);
        }
        (smallest, age) = if top < smallest { (top, 0) } else { (smallest, age + 1) };
        let stop = if goal.met(top, first.1, &lanczos, iterations) {
            Some(Stop::Converged)
        } else if age > goal.patience || rz.is_nan() || rz <= 0.0 || iterations == LIMIT {
            Some(Stop::IterationLimit)
        } else {
            run.interrupted()
        };
        if stop == Some(Stop::Converged) {
            vector::add_scaled(isa, c, 1.0, z);
        }
        if let Some(stop) = stop {
            break (stop, rz);
        }
        // `z' (r - r_before) = -step z' q`.
        let ratio = if iterations == 0 { 0.0 } else { -step * vector::dot(isa, &q, z).0 / before };
        vector::scale_add(isa, &mut p, ratio, z);
        before = rz;
        let curvature = grids.apply(&p, &mut q);
        if curvature.is_nan() || curvature <= 0.0 {
            break (Stop::IterationLimit, rz);
        }
        // `p' r = r' z`, as the step before has left nothing along the direction before.
        step = rz / curvature;
        lanczos.push(step, ratio.max(0.0));
        vector::add_scaled(isa, c, step, &p);
        vector::add_scaled(isa, r, -step, &q);
        iterations += 1;
    };
    let residual = if first.0 > 0.0 { (stop.1.max(0.0) / first.0).sqrt() } else { 0.0 };
    let least = goal.least.unwrap_or(f64::INFINITY).min(lanczos.least());
    Ending { stop: stop.0, iterations, residual, first: first.1, least }
}
