//! Solvers: they know matrices, vectors on a grid and which unknowns are free, but no images and no settings.

pub mod bottom;
pub mod conjugate;
pub mod local;
pub mod multigrid;
pub mod primal_dual;
