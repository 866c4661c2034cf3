//! A direct solver for the coarsest grid: Cholesky's factorisation of the matrix between its free unknowns.

use crate::kernel::Real;
use crate::kernel::stencil::{Separable, Window};

/// Relative size below which a pivot counts as zero: the unknown is then left at zero.
const SINGULAR: f64 = 1e-13;

/// `L` with `A = L L'`, row by row, over the free unknowns of a window.
#[derive(Clone, Debug)]
pub struct Bottom {
    places: Vec<usize>,
    lower: Vec<f64>,
}

impl Bottom {
    /// Factors `A + diag(d)` restricted to the unknowns of the window where `free` is not zero.
    pub fn new<T: Real>(a: &Separable<f64>, window: Window, free: &[T], d: Option<&[T]>) -> Self {
        let cells: Vec<(usize, usize)> = (0..window.height)
            .flat_map(|i| (0..window.width).map(move |j| (i, j)))
            .filter(|&(i, j)| free[window.at(i, j)] != T::ZERO)
            .collect();
        let n = cells.len();
        let mut lower = vec![0.0; n * n];
        let image = |(i, j): (usize, usize)| (window.y + i, window.x + j);
        for (row, &cell) in cells.iter().enumerate() {
            let own = d.map_or(0.0, |d| d[window.at(cell.0, cell.1)].to_f64());
            let whole = a.entry(image(cell), image(cell)) + own;
            for column in 0..=row {
                let mut sum = a.entry(image(cell), image(cells[column]));
                if row == column {
                    sum = whole;
                }
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
