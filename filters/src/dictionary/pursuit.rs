//! Orthogonal matching pursuit where many blocks have the same measured values: one Gram matrix serves them all.
//!
//! Of `min |x|_0 subject to S D x = y` (equation 4.2 of the thesis; `S` picks the measured values) it takes, greedily, one atom
//! after another: the one with the largest `|d_S . r| / |d_S|` for the residual `r`, which is made orthogonal to all atoms taken.
//!
//! With `G = D_S^T D_S` and `a = D_S^T y`, no step touches the block itself. Atom `j` taken as the k-th is orthogonalised by the
//! next row of the Cholesky factor of the taken atoms' part of `G`,
//!
//! ```text
//! R_ik = p_i(j),   R_kk = sqrt(G_jj - sum_i R_ik^2),   p_k = (G_j - sum_i R_ik p_i) / R_kk,   c_k = a(j) / R_kk,   a -= c_k p_k
//! ```
//!
//! where `p_k` holds the products of all atoms with the k-th direction; at the end `R x = c`.
//!
//! Stops after `sparsity` atoms, at an error bound, where no atom has more than 1e-6 of the block's length in common with what is left,
//! or where the next atom depends on those taken (`R_kk^2` below 1e-5 of its squared length): in f32 `R_kk` is rounding there. So atoms
//! that are nearly collinear, as blocks of little contrast on a bright level are, give a code of one atom. Atoms with less than [`Selection::floor`] of their squared
//! length on measured values are not taken.
//! Cost: `K (k + 1)` multiplications in step k; memory `K` numbers a step. Direct, deterministic, single-threaded per block.
//!
//! Sources: R. Rubinstein, M. Zibulevsky, M. Elad, "Efficient Implementation of the K-SVD Algorithm using Batch Orthogonal
//! Matching Pursuit", Technion 2008; B. Sturm, M. Christensen, "Comparison of orthogonal matching pursuit implementations",
//! EUSIPCO 2012 (the factor's recursion).

use ndarray::Array2;

use super::atoms::gram;
use crate::kernel::dense::{add_multiple, strongest};

/// The atoms of a block with their factors, in the order in which they were taken.
pub type Code = Vec<(u32, f32)>;

/// Below this part of the squared length of a block, its residual is rounding.
pub(super) const NOTHING_LEFT: f64 = 1e-12;
/// Below this part of its squared length, an atom depends on those taken.
pub(super) const DEPENDENT: f32 = 1e-5;

/// How many atoms a block gets.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Selection {
    /// Atoms at most.
    pub sparsity: usize,
    /// The squared distance from the block's values at which no more are taken; 0 takes all.
    pub error: f64,
    /// The least part of an atom's squared length that must lie on measured values, 0 to 1.
    pub floor: f32,
}

impl Selection {
    /// So many atoms of a block without a missing value.
    pub const fn atoms(sparsity: usize) -> Self {
        Self { sparsity, error: 0.0, floor: 0.0 }
    }
}

/// The weights by which atoms are compared: one over their length on measured values; 0 keeps an atom out.
pub(super) fn weights(squared: impl Iterator<Item = f32>, floor: f32) -> Vec<f32> {
    let least = floor.max(1e-6);
    squared.map(|squared| if squared >= least { squared.sqrt().recip() } else { 0.0 }).collect()
}

/// What blocks with the same measured values share.
#[derive(Clone, Debug)]
pub struct Shared {
    gram: Array2<f32>,
    weights: Vec<f32>,
}

/// Memory of one pursuit, to be used again.
#[derive(Clone, Debug, Default)]
pub struct Scratch {
    /// `p_k`, one after another.
    products: Vec<f32>,
    /// `R`, row by row of its transpose: row k holds `R_0k .. R_kk`.
    factor: Vec<f32>,
    /// `c`.
    along: Vec<f32>,
}

impl Shared {
    /// Of atoms, one a row, which are 0 where nothing was measured.
    pub fn new(atoms: &Array2<f32>, floor: f32) -> Self {
        let gram = gram(atoms);
        let weights = weights(gram.diag().iter().copied(), floor);
        Self { gram, weights }
    }

    /// Products of all pairs of atoms.
    pub fn gram(&self) -> &Array2<f32> {
        &self.gram
    }

    /// The code of a block of squared length `energy` whose products with all atoms are `products`, which are used up.
    pub fn code(
        &self,
        products: &mut [f32],
        energy: f64,
        selection: &Selection,
        scratch: &mut Scratch,
    ) -> Code {
        let count = products.len();
        scratch.products.clear();
        scratch.factor.clear();
        scratch.along.clear();
        let sparsity = selection.sparsity.min(count);
        let mut code = Code::with_capacity(sparsity);
        let mut left = energy;
        while code.len() < sparsity && left > selection.error {
            let Some((atom, top)) = strongest(products, &self.weights) else { break };
            if f64::from(top).powi(2) <= NOTHING_LEFT * energy || !self.direction(atom, &code, scratch) {
                break;
            }
            let k = code.len();
            let length = scratch.factor.last().copied().unwrap_or(1.0);
            let along = products[atom] / length;
            scratch.along.push(along);
            add_multiple(-along, &scratch.products[k * count..], products);
            left = (left - f64::from(along).powi(2)).max(0.0);
            code.push((atom as u32, 0.0));
            // Products with atoms that were taken are zero but for rounding.
            for &(taken, _) in &code {
                products[taken as usize] = 0.0;
            }
        }
        back_substitute(&scratch.factor, &scratch.along, &mut code);
        code
    }

    /// Adds an atom's row of the factor and its direction's products; false if it depends on those taken.
    fn direction(&self, atom: usize, code: &Code, scratch: &mut Scratch) -> bool {
        let count = self.weights.len();
        let Some(row) = self.gram.row(atom).to_slice() else { return false };
        let start = scratch.factor.len();
        let mut squared = row[atom];
        for k in 0..code.len() {
            let entry = scratch.products[k * count + atom];
            squared -= entry * entry;
            scratch.factor.push(entry);
        }
        if squared <= DEPENDENT * row[atom] {
            scratch.factor.truncate(start);
            return false;
        }
        let length = squared.sqrt();
        scratch.products.extend_from_slice(row);
        let (before, new) = scratch.products.split_at_mut(code.len() * count);
        for (taken, entry) in before.chunks_exact(count).zip(&scratch.factor[start..]) {
            add_multiple(-entry, taken, new);
        }
        let scale = length.recip();
        for product in new {
            *product *= scale;
        }
        scratch.factor.push(length);
        true
    }
}

/// Solves `R x = c` for the factors of a code; `factor` holds the columns of R, each to its diagonal.
pub(super) fn back_substitute(factor: &[f32], along: &[f32], code: &mut Code) {
    let column = |k: usize| &factor[k * (k + 1) / 2..][..=k];
    let mut right: Vec<f64> = along.iter().map(|along| f64::from(*along)).collect();
    for k in (0..code.len()).rev() {
        let column = column(k);
        let x = right[k] / f64::from(column[k]);
        code[k].1 = x as f32;
        for (right, entry) in right[..k].iter_mut().zip(column) {
            *right -= f64::from(*entry) * x;
        }
    }
}

#[cfg(test)]
#[path = "pursuit/tests.rs"]
pub(super) mod tests;
