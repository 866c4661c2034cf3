//! What both methods do with an operator: scale, goal, solver, outcome.

use serde::Serialize;

use crate::solver::sparsity::{Ending, Samples, Sparsity};
use crate::solver::{nesta, saddle};
use crate::{Error, Outcome, Run};

/// How the l1 problem is solved.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize)]
#[serde(rename_all = "kebab-case")]
pub enum Solver {
    /// Nesterov's method on the smoothed norm, as the thesis used it.
    #[default]
    Nesta,
    /// Primal-dual steps on the norm itself: the second opinion.
    PrimalDual,
}

impl Solver {
    /// The name that settings and options use.
    pub const fn name(self) -> &'static str {
        match self {
            Self::Nesta => "nesta",
            Self::PrimalDual => "primal-dual",
        }
    }
}

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
        if !(self.tolerance > 0.0 && self.tolerance.is_finite()) {
            return refuse("tolerance", &self.tolerance, "above 0, finite");
        }
        if self.iterations == 0 {
            return refuse("max_iterations", &self.iterations, "1 or more");
        }
        Ok(())
    }
}

/// A setting that is out of its range.
pub fn refuse<T>(name: &'static str, value: &dyn std::fmt::Display, range: &'static str) -> Result<T, Error> {
    Err(Error::Setting { name, value: value.to_string(), range })
}

/// A finite value of 0 or more.
pub fn not_negative(name: &'static str, value: f64) -> Result<(), Error> {
    if value >= 0.0 && value.is_finite() { Ok(()) } else { refuse(name, &value, "0 or more, finite") }
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
