//! Why a command line cannot be carried out.

/// Why there is nothing to run.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
pub enum PlanError {
    /// The command line contradicts itself or the files there are: exit status 2.
    #[error("{0}")]
    Usage(String),
    /// What was named cannot be had: exit status 1.
    #[error("{0}")]
    Failed(String),
}
