//! Conjugate gradients with a multigrid cycle as preconditioner.
//!
//! Source: M. Hestenes, E. Stiefel, "Methods of conjugate gradients for solving linear systems", J. Res. NBS 49, 1952;
//! the flexible form of Y. Notay, "Flexible conjugate gradients", SIAM J. Sci. Comput. 22, 2000, would allow for a cycle
//! in lower precision; here the cycle is symmetric and has the precision of the vectors.

use super::multigrid::{Multigrid, Workspace};
use crate::kernel::{Real, vector};
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
}

/// Iterations after which the solver gives up.
const LIMIT: usize = 2000;
/// Iterations without a new smallest correction after which rounding has the upper hand.
const PATIENCE: usize = 200;

/// Solves for the correction `c` of the residual `r` until no entry of a cycle's correction exceeds `tolerance`.
/// `r` becomes the residual that is left.
pub fn solve<T: Real>(
    grids: &Multigrid<T>,
    workspace: &mut Workspace<T>,
    r: &mut [T],
    c: &mut [T],
    tolerance: f64,
    run: &Run<'_>,
) -> Ending {
    let isa = grids.isa();
    let mut p: Vec<T> = Vec::new();
    let mut q: Vec<T> = grids.window().zeros();
    let (mut before, mut first) = (0.0, 0.0);
    let (mut smallest, mut age) = (f64::INFINITY, 0);
    for iterations in 0..=LIMIT {
        let z = grids.cycle(r, workspace);
        let (rz, top) = vector::dot(isa, r, z);
        if iterations == 0 {
            first = rz;
        }
        let residual = if first > 0.0 { (rz.max(0.0) / first).sqrt() } else { 0.0 };
        let end = |stop| Ending { stop, iterations, residual };
        if top <= tolerance {
            return end(Stop::Converged);
        }
        if let Some(stop) = run.interrupted() {
            return end(stop);
        }
        (smallest, age) = if top < smallest { (top, 0) } else { (smallest, age + 1) };
        if age > PATIENCE || rz.is_nan() || rz <= 0.0 || iterations == LIMIT {
            return end(Stop::IterationLimit);
        }
        if iterations == 0 {
            p = z.to_vec();
        } else {
            vector::scale_add(isa, &mut p, rz / before, z);
        }
        before = rz;
        let curvature = grids.apply(&p, &mut q);
        if curvature.is_nan() || curvature <= 0.0 {
            return end(Stop::IterationLimit);
        }
        let step = rz / curvature;
        vector::add_scaled(isa, c, step, &p);
        vector::add_scaled(isa, r, -step, &q);
    }
    Ending { stop: Stop::IterationLimit, iterations: LIMIT, residual: 1.0 }
}
