//! A direct solver for the coarsest grid: Cholesky's factorisation of the matrix between its free unknowns.

use super::cholesky::Cholesky;
use crate::kernel::Real;
use crate::kernel::window::Window;

/// Relative size below which a pivot counts as zero: the unknown is then left at zero.
const SINGULAR: f64 = 1e-13;

/// The factored matrix, and where its unknowns stand.
#[derive(Clone, Debug)]
pub struct Bottom {
    places: Vec<usize>,
    factor: Cholesky,
}

impl Bottom {
    /// Factors the matrix with these entries between cells (row, column) of the window: those that are free.
    pub fn new(
        window: Window,
        cells: Vec<(usize, usize)>,
        entry: impl Fn((usize, usize), (usize, usize)) -> f64,
    ) -> Self {
        let factor = Cholesky::new(cells.len(), SINGULAR, |k, l| entry(cells[k], cells[l]));
        Self { places: cells.into_iter().map(|(i, j)| window.at(i, j)).collect(), factor }
    }

    /// Solves for `x`; values of `r` at unknowns that are not free are not read.
    pub fn solve<T: Real>(&self, r: &[T], x: &mut [T]) {
        let mut y: Vec<f64> = self.places.iter().map(|&place| r[place].to_f64()).collect();
        self.factor.solve(&mut y);
        for (&place, value) in self.places.iter().zip(y) {
            x[place] = T::from_f64(value);
        }
    }
}
