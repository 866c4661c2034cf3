//! Solvers: they know vectors on a grid and linear maps, no images and no settings.

pub mod primal_dual;
