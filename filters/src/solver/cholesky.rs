//! Cholesky's factorisation of a small symmetric matrix, dense and in f64; unknowns that others determine are left at zero.
//!
//! Source: G. Golub, C. Van Loan, "Matrix Computations", 4th edition, 2013, section 4.2.

use crate::kernel::stencil::lanes_dot;

/// `L` with `A = L L'`, row by row.
#[derive(Clone, Debug)]
pub struct Cholesky {
    n: usize,
    lower: Vec<f64>,
}

impl Cholesky {
    /// Factors the matrix of `n` unknowns with these entries. A pivot of at most `singular` times the diagonal counts as zero.
    pub fn new(n: usize, singular: f64, entry: impl Fn(usize, usize) -> f64) -> Self {
        let mut lower = vec![0.0; n * n];
        for row in 0..n {
            let (above, here) = lower.split_at_mut(row * n);
            let whole = entry(row, row);
            for column in 0..=row {
                let (done, rest) = here.split_at_mut(column);
                if row == column {
                    let left = whole - lanes_dot::<f64, false>(done, done);
                    rest[0] = if left > singular * whole { left.sqrt() } else { 0.0 };
                } else {
                    let other = &above[column * n..][..=column];
                    let pivot = other[column];
                    let left = entry(row, column) - lanes_dot::<f64, false>(done, &other[..column]);
                    rest[0] = if pivot > 0.0 { left / pivot } else { 0.0 };
                }
            }
        }
        Self { n, lower }
    }

    /// Replaces a right-hand side by the solution.
    pub fn solve(&self, y: &mut [f64]) {
        let Self { n, lower } = self;
        let divide = |value: f64, i: usize| {
            let pivot = lower[i * n + i];
            if pivot > 0.0 { value / pivot } else { 0.0 }
        };
        for i in 0..*n {
            let sum = lanes_dot::<f64, false>(&lower[i * n..][..i], &y[..i]);
            y[i] = divide(y[i] - sum, i);
        }
        // Row by row, which are columns of `L'`.
        for i in (0..*n).rev() {
            let value = divide(y[i], i);
            y[i] = value;
            for (y, weight) in y[..i].iter_mut().zip(&lower[i * n..][..i]) {
                *y -= weight * value;
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// `B B'` of some numbers, for which the solution is known; the last unknown may repeat the first.
    #[test]
    fn it_solves_and_leaves_what_others_determine_at_zero() {
        let n = 29;
        for repeated in [false, true] {
            let row = |i: usize| if repeated && i + 1 == n { 0 } else { i };
            let b = |i: usize, k: usize| {
                ((row(i) * 7919 + k * 3571 + row(i) * k * 311) % 1009) as f64 / 1009.0 - 0.5
            };
            let entry = |i: usize, j: usize| (0..2 * n).map(|k| b(i, k) * b(j, k)).sum::<f64>();
            let known = |i: usize| if repeated && i + 1 == n { 0.0 } else { 1.0 + i as f64 };
            let mut y: Vec<f64> =
                (0..n).map(|i| (0..n).map(|j| entry(i, j) * known(j)).sum::<f64>()).collect();
            Cholesky::new(n, 1e-10, entry).solve(&mut y);
            for (i, y) in y.into_iter().enumerate() {
                assert!((y - known(i)).abs() <= 1e-9 * n as f64, "{repeated} {i}: {y}");
            }
        }
    }
}
