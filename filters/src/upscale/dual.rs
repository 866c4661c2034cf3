//! Bounds for footprints whose weights change their sign: all multipliers at once, by accelerated steps of the dual.
//!
//! The problem is that of [`super::relax`]; one footprint after the other creeps there. A step is `(R R')^-1` times what the image lacks
//! of the samples: without bounds in the way the first one is exact. Momentum begins anew where it leads down.
//!
//! Source: Y. Nesterov, "A method of solving a convex programming problem with convergence rate O(1/k^2)", Soviet Mathematics Doklady 27,
//! 1983; B. O'Donoghue, E. Candes, "Adaptive restart for accelerated gradient schemes", Foundations of Computational Mathematics 15, 2015.

use super::Plan;
use super::bounds::{Bounds, TOLERANCE, clamp, difference, largest, sum};
use crate::kernel::{Isa, vector};
use crate::limiter::Moved;
use crate::{Plane, Run, Size, Stop};

/// Steps after which it gives up.
const STEPS: usize = 1000;

/// Moves `plane`, whose reduction is `samples`, into its bounds; how many pixels were at one, how it ended and after how many steps.
pub fn ascend(
    plan: &Plan,
    samples: &Plane,
    bounds: &Bounds,
    plane: &mut Plane,
    run: &Run<'_>,
) -> (Moved, Stop, usize) {
    let start = plane.clone();
    let peak = largest(samples).max(f64::MIN_POSITIVE);
    let mut moved = clamp(plan, bounds, plane);
    let mut dual = Dual::new(samples.size());
    for step in 0..STEPS {
        let residual = difference(samples, &plan.model.reduce(plane));
        if largest(&residual) <= TOLERANCE * peak {
            return (moved, Stop::Converged, step);
        }
        if let Some(stop) = run.interrupted() {
            return (moved, stop, step);
        }
        dual.step(plan, &residual);
        *plane = sum(&start, 1.0, &plan.model.adjoint(&dual.ahead));
        moved = clamp(plan, bounds, plane);
    }
    (moved, Stop::IterationLimit, STEPS)
}

struct Dual {
    multiplier: Plane,
    ahead: Plane,
    momentum: f64,
}

impl Dual {
    fn new(size: Size) -> Self {
        let multiplier = Plane::filled(size, 0.0);
        Self { ahead: multiplier.clone(), multiplier, momentum: 1.0 }
    }

    /// Follows what the image lacks of the samples.
    fn step(&mut self, plan: &Plan, residual: &Plane) {
        let next = sum(&self.ahead, 1.0, &plan.model.gram_inverse(residual));
        let way = difference(&next, &self.multiplier);
        if vector::dot(Isa::best(), residual.pixels(), way.pixels()) < 0.0 {
            self.momentum = 1.0;
        }
        let after = f64::midpoint(1.0, (1.0 + 4.0 * self.momentum * self.momentum).sqrt());
        self.ahead = sum(&next, (self.momentum - 1.0) / after, &way);
        (self.multiplier, self.momentum) = (next, after);
    }
}
