//! Conjugate gradients with a multigrid cycle as preconditioner.
//!
//! The system is in f64; the cycle may be in f32, whose rounding makes it a slightly different map at every iteration.
//! The flexible form allows for that.
//!
//! Source: M. Hestenes, E. Stiefel, "Methods of conjugate gradients for solving linear systems", J. Res. NBS 49, 1952;
//! Y. Notay, "Flexible conjugate gradients", SIAM J. Sci. Comput. 22, 2000.

use super::multigrid::{Multigrid, Workspace};
use crate::kernel::simd::Lanes;
use crate::kernel::stencil::{Separable, apply};
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
}

/// Iterations after which the solver gives up.
const LIMIT: usize = 2000;
/// Iterations without a new smallest correction after which rounding has the upper hand.
const PATIENCE: usize = 200;

/// `A + diag(d)`.
#[derive(Clone, Copy, Debug)]
pub struct System<'a> {
    /// The energy.
    pub a: &'a Separable<f64>,
    /// Added to its diagonal, if anything.
    pub d: Option<&'a [f64]>,
}

/// Solves for the correction `c` of the residual `r` until no entry of a cycle's correction exceeds `tolerance`.
/// `r` becomes the residual that is left.
pub fn solve<T: Lanes>(
    system: System<'_>,
    grids: &Multigrid<T>,
    workspace: &mut Workspace<T>,
    r: &mut [f64],
    c: &mut [f64],
    tolerance: f64,
    run: &Run<'_>,
) -> Ending {
    let (isa, window) = (grids.isa(), grids.window());
    let (mut p, mut q, mut z) = (window.zeros::<f64>(), window.zeros::<f64>(), window.zeros::<f64>());
    let (mut before, mut first, mut step) = (0.0, 0.0, 0.0);
    let (mut smallest, mut age) = (f64::INFINITY, 0);
    for iterations in 0..=LIMIT {
        // In units of the tolerance, which suit f32 whatever the range of the image.
        grids.cycle(r, 1.0 / tolerance, workspace, &mut z);
        let (rz, top) = vector::dot(isa, r, &z);
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
        // `z' (r - r_before) = -step z' q`.
        let ratio = if iterations == 0 { 0.0 } else { -step * vector::dot(isa, &q, &z).0 / before };
        vector::scale_add(isa, &mut p, ratio, &z);
        before = rz;
        let curvature = apply(isa, system.a, window, &p, system.d, &mut q);
        if curvature.is_nan() || curvature <= 0.0 {
            return end(Stop::IterationLimit);
        }
        // `p' r` is `r' z` only as long as the cycle is the same map every time.
        step = vector::dot(isa, &p, r).0 / curvature;
        vector::add_scaled(isa, c, step, &p);
        vector::add_scaled(isa, r, -step, &q);
    }
    Ending { stop: Stop::IterationLimit, iterations: LIMIT, residual: 1.0 }
}
