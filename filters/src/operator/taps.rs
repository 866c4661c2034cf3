//! Linear maps of one axis whose rows have few entries: resampling, its adjoint, and inverses that decay.
//!
//! A map of `inputs` values to `outputs` values has one row an output: consecutive weights from some input on. Built and
//! combined in f64; [`crate::kernel::rows`] applies it to images in f32.

use crate::kernel::rows::Rows;

/// Inputs to either side that an inverse is solved on: what decays by 0.85 an entry has fallen to 2e-7 there.
const WINDOW: usize = 96;

/// A sparse matrix, row by row.
#[derive(Clone, Debug, PartialEq)]
pub struct Taps {
    inputs: usize,
    /// First input of each row.
    starts: Vec<usize>,
    /// Where each row's weights begin; one more for the end.
    offsets: Vec<usize>,
    weights: Vec<f64>,
}

impl Taps {
    /// Collects rows: the first input and the weights from there on, all within `inputs`.
    pub fn from_rows(inputs: usize, rows: impl IntoIterator<Item = (usize, Vec<f64>)>) -> Self {
        let mut taps = Self { inputs, starts: Vec::new(), offsets: vec![0], weights: Vec::new() };
        for (start, row) in rows {
            taps.starts.push(start);
            taps.weights.extend(row);
            taps.offsets.push(taps.weights.len());
        }
        taps
    }

    /// Number of inputs.
    pub fn inputs(&self) -> usize {
        self.inputs
    }

    /// Number of outputs.
    pub fn outputs(&self) -> usize {
        self.starts.len()
    }

    /// The first input of an output and the weights from there on.
    pub fn row(&self, output: usize) -> (usize, &[f64]) {
        (self.starts[output], &self.weights[self.offsets[output]..self.offsets[output + 1]])
    }

    /// `self * other`: first `other`, then `self`.
    pub fn after(&self, other: &Self) -> Self {
        let rows = (0..self.outputs()).map(|i| {
            let (start, weights) = self.row(i);
            let used = || (start..).zip(weights).map(|(k, weight)| (other.row(k), *weight));
            let first = used().map(|((first, _), _)| first).min().unwrap_or(0);
            let end = used().map(|((first, row), _)| first + row.len()).max().unwrap_or(0);
            let mut sum = vec![0.0; end - first];
            for ((at, row), weight) in used() {
                for (sum, value) in sum[at - first..].iter_mut().zip(row) {
                    *sum += weight * value;
                }
            }
            (first, sum)
        });
        Self::from_rows(other.inputs, rows.collect::<Vec<_>>())
    }

    /// The adjoint.
    pub fn transpose(&self) -> Self {
        let mut rows: Vec<(usize, Vec<f64>)> = vec![(0, Vec::new()); self.inputs];
        for i in 0..self.outputs() {
            let (start, weights) = self.row(i);
            for (row, &weight) in rows[start..].iter_mut().zip(weights) {
                if row.1.is_empty() {
                    row.0 = i;
                }
                // An output between that does not use the input has a zero.
                row.1.resize(i - row.0, 0.0);
                row.1.push(weight);
            }
        }
        Self::from_rows(self.outputs(), rows)
    }

    /// The inverse of a square map whose inverse decays away from the diagonal, each row found on a window around it;
    /// weights below `floor` at a row's ends are cut.
    pub fn inverse(&self, floor: f64) -> Self {
        let n = self.inputs;
        let columns = self.transpose();
        let rows = (0..n).map(|i| {
            let window = i.saturating_sub(WINDOW)..n.min(i + WINDOW + 1);
            let row = solve(&columns, window.clone(), i);
            let keep = |weight: &f64| weight.abs() > floor;
            let first = row.iter().position(keep).unwrap_or(i - window.start);
            let end = row.iter().rposition(keep).map_or(first + 1, |last| last + 1);
            (window.start + first, row[first..end].to_vec())
        });
        Self::from_rows(n, rows.collect::<Vec<_>>())
    }

    /// The map in f32, for images.
    pub fn rows(&self) -> Rows {
        Rows::new(self.inputs, (0..self.outputs()).map(|output| self.row(output)))
    }

    /// The map applied to one line, in f64.
    #[cfg(test)]
    pub fn apply(&self, line: &[f64]) -> Vec<f64> {
        let one = |i| {
            let (start, weights) = self.row(i);
            line[start..].iter().zip(weights).map(|(x, w)| x * w).sum()
        };
        (0..self.outputs()).map(one).collect()
    }
}

/// Solves `matrix z = e` on a window, where `e` is 1 at `unit` and 0 elsewhere, by banded elimination. No pivots: the
/// matrices that come here are collocation matrices of splines, which need none (C. de Boor, A. Pinkus, "Backward error analysis
/// for totally positive linear systems", Numerische Mathematik 27, 1977).
fn solve(matrix: &Taps, window: std::ops::Range<usize>, unit: usize) -> Vec<f64> {
    let n = window.len();
    let entry = |i: usize, j: usize| {
        let (start, weights) = matrix.row(window.start + i);
        (window.start + j).checked_sub(start).and_then(|k| weights.get(k)).copied().unwrap_or(0.0)
    };
    let band = window.clone().fold(0, |band, i| {
        let (start, weights) = matrix.row(i);
        let end = (start + weights.len()).saturating_sub(1);
        band.max(i.saturating_sub(start)).max(end.saturating_sub(i))
    });
    let width = 2 * band + 1;
    // Entry (i, j) stands at place i * width + band + j - i.
    let mut a = vec![0.0; n * width];
    for i in 0..n {
        for j in i.saturating_sub(band)..n.min(i + band + 1) {
            a[i * width + band + j - i] = entry(i, j);
        }
    }
    let mut z = vec![0.0; n];
    z[unit - window.start] = 1.0;
    for k in 0..n {
        let pivot = a[k * width + band];
        for i in k + 1..n.min(k + band + 1) {
            let factor = a[i * width + band + k - i] / pivot;
            if factor != 0.0 {
                for j in k..n.min(k + band + 1) {
                    a[i * width + band + j - i] -= factor * a[k * width + band + j - k];
                }
                z[i] -= factor * z[k];
            }
        }
    }
    for k in (0..n).rev() {
        let sum: f64 = (k + 1..n.min(k + band + 1)).map(|j| a[k * width + band + j - k] * z[j]).sum();
        z[k] = (z[k] - sum) / a[k * width + band];
    }
    z
}

#[cfg(test)]
mod tests {
    use super::*;

    fn example(inputs: usize, outputs: usize) -> Taps {
        let row = |i: usize| {
            let start = (i * inputs / outputs).min(inputs - 1);
            let count = (1 + i % 3).min(inputs - start);
            (start, (0..count).map(|k| ((i * 7 + k * 3) as f64).sin()).collect())
        };
        Taps::from_rows(inputs, (0..outputs).map(row))
    }

    fn dot(a: &[f64], b: &[f64]) -> f64 {
        a.iter().zip(b).map(|(a, b)| a * b).sum()
    }

    fn noise(n: usize, seed: f64) -> Vec<f64> {
        (0..n).map(|k| ((k + 1) as f64 * seed).sin()).collect()
    }

    #[test]
    fn the_transpose_is_the_adjoint() {
        for (inputs, outputs) in [(1, 1), (1, 5), (5, 1), (7, 12), (12, 7)] {
            let taps = example(inputs, outputs);
            let (x, y) = (noise(inputs, 0.7), noise(outputs, 1.3));
            let (left, right) = (dot(&taps.apply(&x), &y), dot(&x, &taps.transpose().apply(&y)));
            assert!((left - right).abs() < 1e-13, "{left} {right}");
        }
    }

    #[test]
    fn a_product_is_one_after_the_other() {
        let (first, second) = (example(9, 14), example(14, 6));
        let x = noise(9, 0.4);
        let (both, twice) = (second.after(&first).apply(&x), second.apply(&first.apply(&x)));
        assert!(both.iter().zip(&twice).all(|(a, b)| (a - b).abs() < 1e-14));
    }

    #[test]
    fn an_inverse_undoes() {
        for n in [1, 2, 3, 40, 400] {
            let row = |i: usize| {
                let start = i.saturating_sub(1);
                let end = n.min(i + 2);
                (start, (start..end).map(|j| if i == j { 4.0 / 6.0 } else { 1.0 / 6.0 }).collect())
            };
            let taps = Taps::from_rows(n, (0..n).map(row));
            let x = noise(n, 0.9);
            let back = taps.inverse(1e-15).apply(&taps.apply(&x));
            assert!(back.iter().zip(&x).all(|(a, b)| (a - b).abs() < 1e-13), "{n}");
        }
    }
}
