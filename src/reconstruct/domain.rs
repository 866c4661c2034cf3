//! Where colours are reconstructed. (Seam until the filters' crate has it.)

/// What `--domain` asks for.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Domain {
    /// Linear or log, by the measured range.
    #[default]
    Auto,
    /// As they are.
    Linear,
    /// Through a reversible logarithm.
    Log,
}

impl std::fmt::Display for Domain {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.write_str(match self {
            Self::Auto => "auto",
            Self::Linear => "linear",
            Self::Log => "log",
        })
    }
}

use lacuna_filters::{Error, Mask, Outcome, Planes};

/// A group after the filter and the limiter.
pub struct Result_ {
    /// The values.
    pub planes: Planes,
    /// Whether they went through the log.
    pub log: bool,
    /// How the solver ended.
    pub outcome: Outcome,
    /// Per plane, the values that the limiter moved.
    pub limited: Vec<usize>,
}

/// Solves in the domain asked for.
pub fn reconstruct(
    samples: &Planes,
    _mask: &Mask,
    _domain: Domain,
    _limit: bool,
    solve: impl Fn(&Planes, &mut Planes) -> Result<Outcome, Error>,
) -> Result<Result_, Error> {
    let mut out = Planes::zeros(samples.size(), samples.len());
    let outcome = solve(samples, &mut out)?;
    Ok(Result_ { limited: vec![0; samples.len()], planes: out, log: false, outcome })
}
