//! How a reconstruction ended: stopping early is an outcome, not an error.

use serde::Serialize;

/// Why a solver stopped. Ordered from best to worst.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Serialize)]
#[serde(rename_all = "kebab-case")]
pub enum Stop {
    /// The tolerance was met (or the method is direct).
    Converged,
    /// The largest allowed number of iterations was reached first.
    IterationLimit,
    /// The caller's time was up.
    TimeLimit,
    /// The caller asked to stop.
    Cancelled,
}

/// How a reconstruction ended; for a group of channels, the worst of them.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct Outcome {
    /// Why the solver stopped.
    pub stop: Stop,
    /// Iterations taken; 0 for direct methods.
    pub iterations: usize,
    /// What is left of the residual over what it was, for linear methods; each says in which norm.
    pub residual: Option<f64>,
    /// Relative duality gap, for convex methods: the objective is at most this far above its minimum.
    pub gap: Option<f64>,
    /// The objective reached, for methods that minimise an l1 norm.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub objective: Option<f64>,
    /// Distance from the samples, a Euclidean norm, for the same methods.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub constraint: Option<f64>,
    /// Of an enlarged image that bounds had to be settled for: the most that its reduction is off what it should be, over the largest of
    /// that. It is the small image, or for boxes at broken factors what the spline over whole pixels reduces to.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub off_input: Option<f64>,
}

impl Outcome {
    /// The outcome of a method without iterations.
    pub const fn direct() -> Self {
        Self {
            stop: Stop::Converged,
            iterations: 0,
            residual: None,
            gap: None,
            objective: None,
            constraint: None,
            off_input: None,
        }
    }

    /// The worse of two outcomes, field by field.
    #[must_use]
    pub fn worst(self, other: Self) -> Self {
        let larger = |a: Option<f64>, b: Option<f64>| match (a, b) {
            (Some(a), Some(b)) => Some(a.max(b)),
            (a, b) => a.or(b),
        };
        Self {
            stop: self.stop.max(other.stop),
            iterations: self.iterations.max(other.iterations),
            residual: larger(self.residual, other.residual),
            gap: larger(self.gap, other.gap),
            objective: larger(self.objective, other.objective),
            constraint: larger(self.constraint, other.constraint),
            off_input: larger(self.off_input, other.off_input),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_worst_is_taken_field_by_field() {
        let direct = Outcome::direct();
        let a = Outcome {
            stop: Stop::IterationLimit,
            iterations: 3,
            residual: Some(0.5),
            objective: Some(7.0),
            off_input: Some(1e-3),
            ..direct
        };
        let b =
            Outcome { iterations: 9, residual: Some(0.25), gap: Some(0.1), constraint: Some(0.2), ..direct };
        let worst = Outcome {
            stop: Stop::IterationLimit,
            iterations: 9,
            residual: Some(0.5),
            gap: Some(0.1),
            objective: Some(7.0),
            constraint: Some(0.2),
            off_input: Some(1e-3),
        };
        assert_eq!(a.worst(b), worst);
        assert_eq!(b.worst(a), worst);
        assert_eq!(Outcome::direct().worst(Outcome::direct()), Outcome::direct());
    }

    #[test]
    fn stops_are_ordered_from_best_to_worst() {
        let order = [Stop::Converged, Stop::IterationLimit, Stop::TimeLimit, Stop::Cancelled];
        assert!(order.is_sorted_by(|a, b| a < b));
    }
}
