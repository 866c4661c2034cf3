//! Solvers: they know matrices, vectors on a grid and which unknowns are free, but no images and no settings.

pub mod anchored;
pub mod bottom;
pub mod cholesky;
pub mod conjugate;
pub mod eigen;
pub mod factor;
pub mod holes;
pub mod lanczos;
pub mod local;
pub mod multigrid;
pub mod nesta;
pub mod poisson;
pub mod pool;
pub mod primal_dual;
pub mod regression;
pub mod saddle;
pub mod sparsity;

use serde::Serialize;

/// Which solver minimises a norm that is not smooth.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize)]
#[serde(rename_all = "kebab-case")]
pub enum Solver {
    /// Nesterov's method on the smoothed norm (`solver/nesta.rs`), as the thesis used it.
    #[default]
    Nesta,
    /// Primal-dual steps on the norm itself (`solver/saddle.rs`; of total variation `solver/primal_dual.rs`).
    PrimalDual,
}
