//! Eigenvalues of small symmetric matrices, by Jacobi's rotations.
//!
//! Source: G. Golub, C. Van Loan, "Matrix Computations", Johns Hopkins 2013, section 8.5.

/// Eigenvalues and eigenvectors, which are orthonormal, of the `n x n` matrix `a`, row by row; in no order.
pub fn eigenvectors(mut a: Vec<f64>, n: usize) -> Vec<(f64, Vec<f64>)> {
    let mut v: Vec<Vec<f64>> =
        (0..n).map(|i| (0..n).map(|j| if i == j { 1.0 } else { 0.0 }).collect()).collect();
    for _ in 0..40 {
        for p in 0..n {
            for q in p + 1..n {
                let off = a[p * n + q];
                if off == 0.0 {
                    continue;
                }
                let theta = (a[q * n + q] - a[p * n + p]) / (2.0 * off);
                let t = theta.signum() / (theta.abs() + (theta * theta + 1.0).sqrt());
                let c = 1.0 / (t * t + 1.0).sqrt();
                let s = t * c;
                for k in 0..n {
                    let (x, y) = (a[k * n + p], a[k * n + q]);
                    (a[k * n + p], a[k * n + q]) = (c * x - s * y, s * x + c * y);
                }
                for k in 0..n {
                    let (x, y) = (a[p * n + k], a[q * n + k]);
                    (a[p * n + k], a[q * n + k]) = (c * x - s * y, s * x + c * y);
                    let (x, y) = (v[p][k], v[q][k]);
                    (v[p][k], v[q][k]) = (c * x - s * y, s * x + c * y);
                }
            }
        }
    }
    v.into_iter().enumerate().map(|(i, vector)| (a[i * n + i], vector)).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    /// `A v = value v`, with vectors that are orthonormal.
    #[test]
    fn they_solve_what_they_should() {
        let n = 4;
        let a = vec![4.0, 1.0, -2.0, 0.5, 1.0, 3.0, 0.0, 1.0, -2.0, 0.0, 5.0, -1.0, 0.5, 1.0, -1.0, 2.0];
        let found = eigenvectors(a.clone(), n);
        for (k, (value, v)) in found.iter().enumerate() {
            for i in 0..n {
                let product: f64 = (0..n).map(|j| a[i * n + j] * v[j]).sum();
                assert!((product - value * v[i]).abs() < 64.0 * f64::EPSILON);
            }
            for (l, (_, w)) in found.iter().enumerate() {
                let product: f64 = v.iter().zip(w).map(|(v, w)| v * w).sum();
                assert!((product - if k == l { 1.0 } else { 0.0 }).abs() < 16.0 * f64::EPSILON);
            }
        }
    }
}
