//! Compressed sensing: the image, or its gradient, is sparse in another basis, and the sparsest one that agrees with the
//! samples is found by l1 minimisation. Baselines for comparisons; see `docs/methods.md` for what they are worth.

pub mod cs_gradient;
pub mod cs_wavelet;
mod recover;
#[cfg(test)]
mod tests;

use crate::descriptor::{plain, words};
pub use crate::operator::wavelet;
pub use crate::solver::Solver;
use wavelet::Wavelet;

words!(Solver {
    Nesta: "nesta", "Nesterov's method on the smoothed norm";
    PrimalDual: "primal-dual", "Primal-dual steps on the norm itself";
});
plain!(Wavelet);
