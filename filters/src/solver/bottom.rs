//! A direct solver for the coarsest grid: Cholesky's factorisation of the matrix between its free unknowns.

use crate::kernel::Real;
use crate::kernel::stencil::Window;

/// Relative size below which a pivot counts as zero: the unknown is then left at zero.
const SINGULAR: f64 = 1e-13;

/// `L` with `A = L L'`, row by row, over the free unknowns of a window.
#[derive(Clone, Debug)]
pub struct Bottom {
    places: Vec<usize>,
    lower: Vec<f64>,
}

impl Bottom {
    /// Factors the matrix with these entries between cells (row, column) of the window: those that are free.
    pub fn new(
        window: Window,
        cells: Vec<(usize, usize)>,
        entry: impl Fn((usize, usize), (usize, usize)) -> f64,
    ) -> Self {
        let n = cells.len();
        let mut lower = vec![0.0; n * n];
        for (row, &cell) in cells.iter().enumerate() {
            let whole = entry(cell, cell);
            for column in 0..=row {
                let mut sum = entry(cell, cells[column]);
                for k in 0..column {
                    sum -= lower[row * n + k] * lower[column * n + k];
                }
                let pivot = lower[column * n + column];
                lower[row * n + column] = if row == column {
                    if sum > SINGULAR * whole { sum.sqrt() } else { 0.0 }
                } else if pivot > 0.0 {
                    sum / pivot
                } else {
                    0.0
                };
            }
        }
        Self { places: cells.into_iter().map(|(i, j)| window.at(i, j)).collect(), lower }
    }

    /// Solves for `x`; values of `r` at unknowns that are not free are not read.
    pub fn solve<T: Real>(&self, r: &[T], x: &mut [T]) {
        let n = self.places.len();
        let mut y: Vec<f64> = self.places.iter().map(|&place| r[place].to_f64()).collect();
        for i in 0..n {
            let sum: f64 = (0..i).map(|k| self.lower[i * n + k] * y[k]).sum();
            let pivot = self.lower[i * n + i];
            y[i] = if pivot > 0.0 { (y[i] - sum) / pivot } else { 0.0 };
        }
        for i in (0..n).rev() {
            let sum: f64 = (i + 1..n).map(|k| self.lower[k * n + i] * y[k]).sum();
            let pivot = self.lower[i * n + i];
            y[i] = if pivot > 0.0 { (y[i] - sum) / pivot } else { 0.0 };
        }
        for (&place, value) in self.places.iter().zip(y) {
            x[place] = T::from_f64(value);
        }
    }
}
