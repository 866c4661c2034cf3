//! Solvers: they know matrices, vectors on a grid and which unknowns are free, but no images and no settings.

pub mod anchored;
pub mod bottom;
pub mod cholesky;
pub mod conjugate;
pub mod factor;
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
