//! What both methods do with an operator: scale, goal, solver, outcome.

use crate::solver::sparsity::{Ending, Samples, Sparsity};
use crate::solver::{Solver, nesta, saddle};
use crate::{Error, Outcome, Run, check};

/// When a solver stops, in the units of the settings.
#[derive(Clone, Copy, Debug)]
pub struct Rule {
    /// Which solver.
    pub solver: Solver,
    /// Relative variation of the objective, and smoothing over the range of the samples.
    pub tolerance: f64,
    /// Iterations at most.
    pub iterations: usize,
}

impl Rule {
    /// Improves `x`, for samples whose range is `scale`.
    pub fn solve<S: Sparsity>(
        self,
        operator: &S,
        samples: Samples<'_>,
        scale: f64,
        x: &mut [f32],
        run: &Run<'_>,
    ) -> Ending {
        let Self { solver, tolerance, iterations } = self;
        let goal = nesta::Goal { mu: tolerance * scale, tolerance, iterations };
        match solver {
            Solver::Nesta => nesta::solve(operator, samples, goal, x, run),
            Solver::PrimalDual => saddle::solve(operator, samples, goal, scale, x, run),
        }
    }

    /// Its settings are in their ranges.
    pub fn validate(self) -> Result<(), Error> {
        check::positive("tolerance", self.tolerance)?;
        check::at_least_one("max_iterations", self.iterations)
    }
}

impl From<Ending> for Outcome {
    fn from(ending: Ending) -> Self {
        Self {
            stop: ending.stop,
            iterations: ending.iterations,
            objective: Some(ending.objective),
            constraint: Some(ending.distance),
            ..Self::direct()
        }
    }
}
