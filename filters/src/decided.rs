//! What filling a group decided by its samples, and what these show of the result.

use crate::estimate::Evidence;
use crate::variational::guided::Effect;

/// What was decided.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Decided {
    /// What guides did.
    pub guided: Effect,
    /// Where the method is a blend: the candidates that count, and the mean weight of each at missing pixels.
    pub shares: Vec<(&'static str, f64)>,
    /// The same: the part of the squared error that samples of other frames took away; nothing if they were not used.
    pub along: Option<f64>,
    /// The same: what held-out samples show of it, if that was asked for.
    pub evidence: Option<Evidence>,
}

impl Decided {
    /// Where one candidate of a blend has all of the weight.
    pub fn alone(name: &'static str) -> Self {
        Self { shares: vec![(name, 1.0)], ..Self::default() }
    }
}

impl From<Effect> for Decided {
    fn from(guided: Effect) -> Self {
        Self { guided, ..Self::default() }
    }
}
