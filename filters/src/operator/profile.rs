//! Energies of a sampled function of one variable: `K_k = integral of (f^(k))^2` as banded matrices.
//!
//! `f` interpolates `y_0 .. y_{n-1}` at `0 .. n-1` and is integrated over `[0, n-1]`, so nothing is invented beyond
//! the outermost samples and polynomials below degree `order` cost nothing at the ends either. On the interval
//! `[i, i+1]` the interpolant is a cubic whose four coefficients are linear in `y`; `K_k` sums their Gram matrices.
//!
//! - [`Kernel::Bspline`]: the cubic spline. Its second derivatives `g` solve `R g = Q' y` with `R` tridiagonal
//!   `(1/6, 2/3, 1/6)` and `Q'` the second difference; the ends are natural (`g = 0`) at order 2 and carry the
//!   neighbour's curvature at order 3, so that parabolas stay exact.
//! - [`Kernel::Piecewise`]: the cubic through four neighbours, which is equation 3.18 of the thesis; beyond the
//!   ends the samples go on as a polynomial of degree `order - 1`.
//!
//! Since `K_k` maps polynomials below degree `k` to zero it factors as `D_k' X_k D_k` with `D_k` the k-th difference;
//! `K_0 = diag(K_0 1) + D_1' X_0 D_1`. The spline's `X_k` decays by 0.268 an entry and is cut to a band: the result
//! stays symmetric, keeps its null space to the last bit, and is the definition of the energy from then on.
//!
//! Source: C. Reinsch, "Smoothing by spline functions", Numerische Mathematik 10, 1967, for `Q` and `R`.

use std::sync::OnceLock;

use crate::kernel::window::{REACH, WIDTH};

/// Which function passes through the samples.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Kernel {
    /// The cubic spline (a B-spline behind its inverse filter): two continuous derivatives.
    #[default]
    Bspline,
    /// Equation 3.18 read piece by piece: continuous, with jumps in the first derivative.
    Piecewise,
}

/// Rows of `X_k` at either end that differ from those inside.
const SPECIAL: usize = 3;
/// Up to this length every row is computed; beyond it the rows inside are those of this length's middle.
const SHORT: usize = 32;

/// A row of a banded matrix: entry `REACH + j - i` is that of row `i`, column `j`.
pub type Row = [f64; WIDTH];

/// The matrices `K_0 .. K_order` of one axis, all with the same classes of rows.
#[derive(Clone, Debug)]
pub struct Profile {
    /// Number of samples.
    pub len: usize,
    /// Rows at either end that differ from those inside; `len` if all are listed.
    pub ends: usize,
    /// `rows[k]`: the rows of `K_k`: `0 .. ends`, then the one inside, then the last, the last but one, and so on.
    pub rows: Vec<Vec<Row>>,
}

impl Profile {
    /// The energies of `len` samples for derivatives `0 ..= order`, with rows that reach `order + 1` to either side.
    /// `order` is 2 or 3. Computed once a process: all that are too long to be listed share their rows.
    pub fn new(kernel: Kernel, order: usize, len: usize) -> Self {
        static KNOWN: [[[OnceLock<Profile>; SHORT + 2]; 2]; 2] =
            [const { [const { [const { OnceLock::new() }; SHORT + 2] }; 2] }; 2];
        let known = &KNOWN[usize::from(kernel == Kernel::Piecewise)][order - 2][len.min(SHORT + 1)];
        let shared = known.get_or_init(|| Self::compute(kernel, order, len));
        Self { len, ..shared.clone() }
    }

    fn compute(kernel: Kernel, order: usize, len: usize) -> Self {
        let reach = order + 1;
        let short = len.min(SHORT);
        let pieces = pieces(kernel, order, short);
        let dense: Vec<Matrix> =
            (0..=order).map(|k| banded(&gram(&pieces, k, short), k, reach, len > SHORT)).collect();
        if len <= SHORT {
            let rows = dense.iter().map(|matrix| (0..len).map(|i| row(matrix, i)).collect()).collect();
            return Self { len, ends: len, rows };
        }
        let ends = SPECIAL + reach;
        let rows = dense
            .iter()
            .map(|matrix| {
                let head = (0..ends).map(|i| row(matrix, i));
                let inside = std::iter::once(row(matrix, short / 2));
                head.chain(inside).chain((0..ends).map(|i| row(matrix, short - 1 - i))).collect()
            })
            .collect();
        Self { len, ends, rows }
    }
}

/// A square matrix, row by row.
struct Matrix {
    n: usize,
    entries: Vec<f64>,
}

impl Matrix {
    fn zeros(n: usize) -> Self {
        Self { n, entries: vec![0.0; n * n] }
    }
    fn at(&self, i: usize, j: usize) -> f64 {
        self.entries[i * self.n + j]
    }
    fn add(&mut self, i: usize, j: usize, value: f64) {
        self.entries[i * self.n + j] += value;
    }
}

/// Per interval the coefficients of `1, s, s^2, s^3` as rows over the samples.
fn pieces(kernel: Kernel, order: usize, n: usize) -> Vec<[Vec<f64>; 4]> {
    match kernel {
        Kernel::Bspline => spline_pieces(order, n),
        Kernel::Piecewise => lagrange_pieces(order, n),
    }
}

fn spline_pieces(order: usize, n: usize) -> Vec<[Vec<f64>; 4]> {
    let curvature = curvatures(order, n);
    (0..n.saturating_sub(1))
        .map(|i| {
            let (here, next) = (&curvature[i], &curvature[i + 1]);
            let mut piece = [const { Vec::new() }; 4];
            for t in 0..n {
                let unit = |j: usize| if t == j { 1.0 } else { 0.0 };
                piece[0].push(unit(i));
                piece[1].push(unit(i + 1) - unit(i) - (2.0 * here[t] + next[t]) / 6.0);
                piece[2].push(here[t] / 2.0);
                piece[3].push((next[t] - here[t]) / 6.0);
            }
            piece
        })
        .collect()
}

/// Second derivatives of the spline at each sample, as rows over the samples.
fn curvatures(order: usize, n: usize) -> Vec<Vec<f64>> {
    let mut result = vec![vec![0.0; n]; n];
    if n < 3 {
        return result;
    }
    let inner = n - 2;
    let carried = order == 3;
    // Gaussian elimination of the tridiagonal system, for all right-hand sides at once.
    let mut diagonal = vec![2.0 / 3.0; inner];
    if carried {
        diagonal[0] += 1.0 / 6.0;
        diagonal[inner - 1] += 1.0 / 6.0;
    }
    let mut right: Vec<Vec<f64>> = (0..inner)
        .map(|i| (0..n).map(|t| [1.0, -2.0, 1.0].get(t.wrapping_sub(i)).copied().unwrap_or(0.0)).collect())
        .collect();
    for i in 1..inner {
        let factor = 1.0 / 6.0 / diagonal[i - 1];
        diagonal[i] -= factor / 6.0;
        let (before, after) = right.split_at_mut(i);
        for (value, above) in after[0].iter_mut().zip(&before[i - 1]) {
            *value -= factor * above;
        }
    }
    for i in (0..inner).rev() {
        for t in 0..n {
            let below = if i + 1 < inner { result[i + 2][t] / 6.0 } else { 0.0 };
            result[i + 1][t] = (right[i][t] - below) / diagonal[i];
        }
    }
    if carried {
        let (first, last) = (result[1].clone(), result[n - 2].clone());
        result[0] = first;
        result[n - 1] = last;
    }
    result
}

fn lagrange_pieces(order: usize, n: usize) -> Vec<[Vec<f64>; 4]> {
    const CUBIC: [[f64; 4]; 4] = [
        [0.0, 1.0, 0.0, 0.0],
        [-1.0 / 3.0, -0.5, 1.0, -1.0 / 6.0],
        [0.5, -1.0, 0.5, 0.0],
        [-1.0 / 6.0, 0.5, -0.5, 1.0 / 6.0],
    ];
    // The sample at `t`, which may lie one beyond either end, as a row over the samples.
    let sample = |t: isize| -> Vec<(usize, f64)> {
        let last = n as isize - 1;
        let inward = |k: usize| if t < 0 { k } else { n - 1 - k };
        if (0..=last).contains(&t) {
            vec![(t as usize, 1.0)]
        } else if order == 3 && n >= 3 {
            vec![(inward(0), 3.0), (inward(1), -3.0), (inward(2), 1.0)]
        } else {
            vec![(inward(0), 2.0), (inward(1), -1.0)]
        }
    };
    (0..n.saturating_sub(1))
        .map(|i| {
            CUBIC.map(|weights| {
                let mut line = vec![0.0; n];
                for (k, weight) in weights.into_iter().enumerate() {
                    for (t, share) in sample(i as isize + k as isize - 1) {
                        line[t] += weight * share;
                    }
                }
                line
            })
        })
        .collect()
}

/// The integral of the squared k-th derivative as a full matrix. One sample stands for a unit of length.
fn gram(pieces: &[[Vec<f64>; 4]], k: usize, n: usize) -> Matrix {
    let mut matrix = Matrix::zeros(n);
    if n == 1 && k == 0 {
        matrix.add(0, 0, 1.0);
    }
    // d^k/ds^k s^a = falling(a) s^(a-k)
    let falling = |a: usize| (0..k).map(|j| a as f64 - j as f64).product::<f64>();
    for piece in pieces {
        for a in k..4 {
            for b in k..4 {
                let weight = falling(a) * falling(b) / (a + b + 1 - 2 * k) as f64;
                for i in 0..n {
                    for j in 0..n {
                        matrix.add(i, j, weight * piece[a][i] * piece[b][j]);
                    }
                }
            }
        }
    }
    matrix
}

/// `n` choose `k` for small `k`; 0 for negative `n`.
fn binomial(n: isize, k: usize) -> f64 {
    if n < 0 { 0.0 } else { (0..k).map(|j| (n - j as isize) as f64 / (j + 1) as f64).product() }
}

/// Cuts `K_k` to rows that reach `reach` to either side, by way of its factor `X_k`. With `repeat`, the rows of the
/// factor away from the ends become equal.
fn banded(full: &Matrix, k: usize, reach: usize, repeat: bool) -> Matrix {
    let n = full.n;
    let order = k.max(1);
    let mut result = Matrix::zeros(n);
    if k == 0 {
        for i in 0..n {
            let sum: f64 = (0..n).map(|j| full.at(i, j)).sum();
            let inside = repeat && (SPECIAL..n - SPECIAL).contains(&i);
            result.add(i, i, if inside { 1.0 } else { sum });
        }
    }
    if n <= order {
        return result;
    }
    let weights: Vec<f64> = (0..n).map(|i| result.at(i, i)).collect();
    let reduced = |i: usize, j: usize| full.at(i, j) - if k == 0 && i == j { weights[i] } else { 0.0 };
    let factor = factor(reduced, n, order);
    let size = n - order;
    let difference: Vec<f64> = (0..=order)
        .map(|j| binomial(order as isize, j) * if (order - j).is_multiple_of(2) { 1.0 } else { -1.0 })
        .collect();
    let band = reach - order;
    for i in 0..size {
        for j in i.saturating_sub(band)..size.min(i + band + 1) {
            let inside = (SPECIAL..size - SPECIAL.min(size)).contains(&i.min(j)) && i.max(j) + SPECIAL < size;
            let value = if repeat && inside {
                factor.at(size / 2, size / 2 + i.abs_diff(j))
            } else {
                0.5 * (factor.at(i, j) + factor.at(j, i))
            };
            for (a, da) in difference.iter().enumerate() {
                for (b, db) in difference.iter().enumerate() {
                    result.add(i + a, j + b, value * da * db);
                }
            }
        }
    }
    result
}

/// `X` with `K = D' X D`: the energies of the truncated powers, each of which has a single non-zero difference.
fn factor(matrix: impl Fn(usize, usize) -> f64, n: usize, order: usize) -> Matrix {
    let size = n - order;
    let power = |i: usize, t: usize| binomial(t as isize - i as isize - 1, order - 1);
    let mut result = Matrix::zeros(size);
    for j in 0..size {
        let image: Vec<f64> = (0..n).map(|s| (0..n).map(|t| matrix(s, t) * power(j, t)).sum()).collect();
        for i in 0..size {
            result.add(i, j, image.iter().enumerate().map(|(s, value)| value * power(i, s)).sum());
        }
    }
    result
}

fn row(matrix: &Matrix, i: usize) -> Row {
    std::array::from_fn(|k| {
        let j = (i + k).wrapping_sub(REACH);
        if j < matrix.n { matrix.at(i, j) } else { 0.0 }
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    fn apply(profile: &Profile, k: usize, y: impl Fn(usize) -> f64) -> Vec<f64> {
        (0..profile.len)
            .map(|i| {
                let class = if i < profile.ends {
                    i
                } else if i + profile.ends < profile.len {
                    profile.ends
                } else {
                    profile.ends + profile.len - i
                };
                let row = &profile.rows[k][class];
                (0..WIDTH)
                    .filter(|j| (REACH..profile.len + REACH).contains(&(i + j)))
                    .map(|j| row[j] * y(i + j - REACH))
                    .sum()
            })
            .collect()
    }

    #[test]
    fn the_piecewise_taps_are_those_of_the_closed_form() {
        let profile = Profile::new(Kernel::Piecewise, 2, 64);
        let expected = [
            [0.775_661, 0.152_976, -0.042_857, 0.002_050],
            [2.111_111, -1.041_667, -0.033_333, 0.019_444],
            [8.0 / 3.0, -1.5, 0.0, 1.0 / 6.0],
        ];
        for (rows, expected) in profile.rows.iter().zip(expected) {
            for (shift, value) in expected.into_iter().enumerate() {
                assert!((rows[profile.ends][REACH + shift] - value).abs() < 1e-6, "{rows:?}");
            }
        }
    }

    #[test]
    fn polynomials_below_the_derivative_cost_nothing() {
        for kernel in [Kernel::Bspline, Kernel::Piecewise] {
            for order in [2, 3] {
                for len in [1, 2, 3, 4, 5, 17, 32, 33, 90] {
                    let profile = Profile::new(kernel, order, len);
                    for k in 1..=order {
                        for degree in 0..k {
                            let image = apply(&profile, k, |t| (t as f64 / 10.0).powi(degree as i32));
                            assert!(
                                image.iter().all(|x| x.abs() < 1e-9),
                                "{kernel:?} {order} {len} {k} {degree}"
                            );
                        }
                    }
                    // The integral of 1 is the length, or a unit for a single sample.
                    let length: f64 = apply(&profile, 0, |_| 1.0).iter().sum();
                    assert!(
                        (length - (len as f64 - 1.0).max(f64::from(u8::from(len == 1)))).abs() < 5e-2,
                        "{length}"
                    );
                }
            }
        }
    }

    #[test]
    fn energies_are_those_of_the_function() {
        // A slow parabola, far from the ends' curvature: f'' = 2 a.
        let profile = Profile::new(Kernel::Bspline, 3, 60);
        let y = |t: usize| 0.01 * (t as f64).powi(2);
        let energy = |k: usize| apply(&profile, k, y).iter().enumerate().map(|(t, x)| x * y(t)).sum::<f64>();
        assert!((energy(2) / (0.02_f64.powi(2) * 59.0) - 1.0).abs() < 0.05, "{}", energy(2));
        assert!(energy(3).abs() < 1e-9);
    }
}
