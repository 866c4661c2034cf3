//! Compressed sensing: the image, or its gradient, is sparse in another basis, and the sparsest one that agrees with the
//! samples is found by l1 minimisation. Baselines for comparisons; see `docs/methods.md` for what they are worth.

pub mod cs_gradient;
pub mod cs_wavelet;
mod recover;
#[cfg(test)]
mod tests;

pub use crate::operator::wavelet;
pub use crate::solver::Solver;
