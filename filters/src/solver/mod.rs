//! Solvers of linear systems. They know matrices, windows and which unknowns are free, but no images.

pub mod bottom;
pub mod conjugate;
pub mod local;
pub mod multigrid;
