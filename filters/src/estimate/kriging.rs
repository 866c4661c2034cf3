//! Kriging from a few samples: the variance of a value that is predicted from its neighbours.
//!
//! Of neighbours at offsets `q_k` from the pixel, with the generalised covariance `phi(r) = r^2 ln r` and a linear drift, the
//! weights `w` and multipliers `m` solve
//!
//! ```text
//! sum over l of phi(|q_k - q_l|) w_l + m_0 + m_1 q_k,y + m_2 q_k,x = phi(|q_k|),    sum w = 1,    sum w q = 0
//! ```
//!
//! and the variance is `sum w_k phi(|q_k|) + m_0`. It is that of the spline of least second derivatives through all
//! samples, as far as these few decide: kriging with this covariance and that spline are one.
//!
//! Source: G. Matheron, "Splines and kriging: their formal equivalence", 1981; N. Cressie, "Statistics for Spatial Data",
//! 1993, sections 3.4 and 5.4.

use super::near::Near;

/// Neighbours that are taken.
pub const NEIGHBOURS: usize = 16;
/// Unknowns: weights and multipliers.
const N: usize = NEIGHBOURS + 3;
/// A pivot below this, at offsets of about 1, is none.
const SINGULAR: f64 = 1e-9;

/// The variance of a pixel given its neighbours, in units of the covariance. Nothing if there are too few, or they lie on a line.
pub fn variance((row, column): (usize, usize), near: &[Near]) -> Option<f64> {
    let count = near.len();
    if !(4..=NEIGHBOURS).contains(&count) {
        return None;
    }
    let scale = f64::from(near[count - 1].squared).sqrt();
    let mut at = [(0.0, 0.0); NEIGHBOURS];
    for (at, near) in at.iter_mut().zip(near) {
        let offset = |a: u32, b: usize| (f64::from(a) - b as f64) / scale;
        *at = (offset(near.row, row), offset(near.column, column));
    }
    let n = count + 3;
    let mut a = [[0.0; N + 1]; N];
    for k in 0..count {
        for l in 0..k {
            let value = phi((at[k].0 - at[l].0).powi(2) + (at[k].1 - at[l].1).powi(2));
            (a[k][l], a[l][k]) = (value, value);
        }
        for (m, value) in [1.0, at[k].0, at[k].1].into_iter().enumerate() {
            (a[k][count + m], a[count + m][k]) = (value, value);
        }
        a[k][N] = phi(at[k].0.powi(2) + at[k].1.powi(2));
    }
    a[count][N] = 1.0;
    let right: [f64; N] = std::array::from_fn(|k| a[k][N]);
    let x = eliminate(&mut a, n)?;
    // With a covariance that is only conditionally positive the sign is the other one.
    let variance = -(0..n).map(|k| x[k] * right[k]).sum::<f64>() * scale * scale;
    (variance.is_finite() && variance.abs() > 0.0).then_some(variance.abs())
}

/// `r^2 ln r` of a squared distance.
fn phi(squared: f64) -> f64 {
    if squared > 0.0 { 0.5 * squared * squared.ln() } else { 0.0 }
}

/// Gauss's elimination with row pivots, the right side in the last column.
fn eliminate(a: &mut [[f64; N + 1]; N], n: usize) -> Option<[f64; N]> {
    for k in 0..n {
        let mut best = k;
        for i in k + 1..n {
            if a[i][k].abs() > a[best][k].abs() {
                best = i;
            }
        }
        if a[best][k].abs() < SINGULAR {
            return None;
        }
        a.swap(k, best);
        let (above, below) = a.split_at_mut(k + 1);
        let pivot = &above[k];
        for row in &mut below[..n - k - 1] {
            let factor = row[k] / pivot[k];
            for (value, other) in row[k + 1..].iter_mut().zip(&pivot[k + 1..]) {
                *value -= factor * other;
            }
        }
    }
    let mut x = [0.0; N];
    for k in (0..n).rev() {
        let sum: f64 = (k + 1..n).map(|l| a[k][l] * x[l]).sum();
        x[k] = (a[k][N] - sum) / a[k][k];
    }
    Some(x)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn near(row: u32, column: u32, at: (u32, u32)) -> Near {
        Near { squared: row.abs_diff(at.0).pow(2) + column.abs_diff(at.1).pow(2), row, column }
    }

    #[test]
    fn variance_grows_with_the_square_of_distance() {
        let places = [(9, 8), (8, 11), (12, 9), (11, 12), (7, 9), (13, 13), (6, 12)];
        let mut found: Vec<Near> = places.iter().map(|&(y, x)| near(y, x, (10, 10))).collect();
        found.sort_by_key(|near| near.squared);
        let close = variance((10, 10), &found).unwrap();
        // All offsets three times as far.
        let mut far: Vec<Near> = places.iter().map(|&(y, x)| near(3 * y, 3 * x, (30, 30))).collect();
        far.sort_by_key(|near| near.squared);
        let wide = variance((30, 30), &far).unwrap();
        assert!((wide / close - 9.0).abs() < 1e-9);
    }

    #[test]
    fn samples_on_a_line_predict_nothing() {
        let found: Vec<Near> = (1..9).map(|k| near(10, 10 + k, (10, 10))).collect();
        assert!(variance((10, 10), &found).is_none());
        assert!(variance((10, 10), &found[..3]).is_none());
    }
}
