//! What the steps of conjugate gradients tell of the eigenvalues of their preconditioned matrix.
//!
//! Source: C. Lanczos, "An iteration method for the solution of the eigenvalue problem of linear differential and integral
//! operators", J. Res. NBS 45, 1950.

/// The tridiagonal matrix that conjugate gradients build, whose extreme eigenvalues approach those of the preconditioned
/// matrix from inside.
#[derive(Default)]
pub struct Lanczos {
    /// Diagonal entries and the squares of those before them in the row.
    rows: Vec<(f64, f64)>,
    step: f64,
}

impl Lanczos {
    /// Takes a step: its length, and the share of the direction before.
    pub fn push(&mut self, step: f64, ratio: f64) {
        let (add, square) = if self.rows.is_empty() {
            (0.0, 0.0)
        } else {
            (ratio / self.step, ratio / (self.step * self.step))
        };
        self.rows.push((1.0 / step + add, square));
        self.step = step;
    }

    /// Whether all eigenvalues exceed `bound`: the pivots of the shifted matrix are positive.
    pub fn exceeds(&self, bound: f64) -> bool {
        let mut pivot = 1.0;
        self.rows.iter().all(|&(diagonal, square)| {
            pivot = diagonal - bound - square / pivot;
            pivot > 0.0
        })
    }

    /// Whether all eigenvalues are below `bound`.
    fn below(&self, bound: f64) -> bool {
        let mut pivot = 1.0;
        self.rows.iter().all(|&(diagonal, square)| {
            pivot = bound - diagonal - square / pivot;
            pivot > 0.0
        })
    }

    /// Whether no step was taken.
    pub fn is_empty(&self) -> bool {
        self.rows.is_empty()
    }

    /// The least eigenvalue to within 2 %, from below; infinite without a step.
    pub fn least(&self) -> f64 {
        let Some(high) = self.rows.iter().map(|row| row.0).reduce(f64::min) else { return f64::INFINITY };
        bisect(high * 1e-9, high, |bound| self.exceeds(bound)).0
    }

    /// The largest eigenvalue to within 2 %, from above; 0 without a step.
    pub fn largest(&self) -> f64 {
        let Some(low) = self.rows.iter().map(|row| row.0).reduce(f64::max) else { return 0.0 };
        bisect(low, 4.0 * low, |bound| !self.below(bound)).1
    }
}

/// Narrows an interval at whose lower end `holds` is true, and at whose upper end it is not, to 2 %.
fn bisect(mut low: f64, mut high: f64, holds: impl Fn(f64) -> bool) -> (f64, f64) {
    while high > 1.02 * low {
        let middle = (low * high).sqrt();
        if holds(middle) { low = middle } else { high = middle }
    }
    (low, high)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn lanczos_finds_the_extreme_eigenvalues() {
        // Conjugate gradients on diag(1, 4, 9) from the residual (1, 1, 1), in full.
        let matrix = [1.0, 4.0, 9.0];
        let (mut r, mut p, mut lanczos) = ([1.0_f64; 3], [0.0; 3], Lanczos::default());
        let mut before = 0.0;
        for k in 0..3 {
            let rr: f64 = r.iter().map(|r| r * r).sum();
            let ratio = if k == 0 { 0.0 } else { rr / before };
            let mut curvature = 0.0;
            for i in 0..3 {
                p[i] = r[i] + ratio * p[i];
                curvature += matrix[i] * p[i] * p[i];
            }
            lanczos.push(rr / curvature, ratio);
            for i in 0..3 {
                r[i] -= rr / curvature * matrix[i] * p[i];
            }
            before = rr;
        }
        assert!(lanczos.exceeds(0.999) && !lanczos.exceeds(1.001));
        assert!((lanczos.least() - 1.0).abs() <= 0.02, "{}", lanczos.least());
        assert!((lanczos.largest() - 9.0).abs() <= 0.18, "{}", lanczos.largest());
    }
}
