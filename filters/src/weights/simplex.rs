//! The weights that make the squared error of a blend least: a quadratic problem on a simplex.
//!
//! ```text
//! w = argmin  w' A w,   w_k >= 0,  sum of w_k = 1
//! ```
//!
//! by active sets: from the best candidate alone, the one that lowers the error most comes in, the least error under `sum w = 1` on the set is found, and
//! whoever would turn negative on the way there leaves. One of the set stands for `1 - sum` of the others, whose matrix is that of differences of
//! candidates: positive, even where `A` is an estimate of Stein's, which need not be.
//!
//! Source: J. Nocedal, S. Wright, "Numerical Optimization", 2nd edition, 2006, section 16.5.

use super::RIDGE;
use crate::solver::cholesky::Cholesky;

/// How much a candidate must lower the error to come in, over the error.
const LOWER: f64 = 1e-9;

/// The weights, among those candidates, that make the squared error of a neighbourhood least, and that error.
pub fn best(cell: &[f64], whole: (&[f64], f64), count: usize, among: &[usize]) -> (Vec<f64>, f64) {
    best_of(cell, whole, count, (among, among))
}

/// The same, with the image counting beside the neighbourhood as it does for all of some candidates: errors of fewer of them can be compared.
pub fn best_of(
    cell: &[f64],
    (whole, frame): (&[f64], f64),
    count: usize,
    (among, all): (&[usize], &[usize]),
) -> (Vec<f64>, f64) {
    let trace = |of: &[f64]| all.iter().map(|&k| of[k * count + k]).sum::<f64>();
    let (here, all) = (trace(cell), trace(whole));
    let n = among.len();
    if all <= 0.0 || !all.is_finite() {
        return (vec![1.0 / n as f64; n], 0.0);
    }
    // A neighbourhood without any error takes the weights of the image.
    let level = if here > 1e-12 * all { here } else { 1e-12 * all };
    let at = |k: usize, l: usize| (cell[k * count + l] + frame * level * whole[k * count + l] / all) / level;
    let mut matrix = vec![0.0; n * n];
    for i in 0..n {
        for j in 0..n {
            matrix[i * n + j] = at(among[i], among[j]) + if i == j { RIDGE } else { 0.0 };
        }
    }
    let w = on_simplex(&matrix, n);
    let error: f64 = (0..n).map(|i| (0..n).map(|j| w[i] * w[j] * at(among[i], among[j])).sum::<f64>()).sum();
    (w, error * level)
}

/// The minimum of `w' A w` on the simplex.
fn on_simplex(matrix: &[f64], n: usize) -> Vec<f64> {
    let diagonal = |k: &usize| matrix[k * n + k];
    let first = (0..n).min_by(|a, b| diagonal(a).total_cmp(&diagonal(b))).unwrap_or(0);
    let mut set = vec![first];
    let mut w = vec![0.0; n];
    w[first] = 1.0;
    for _ in 0..4 * n {
        settle(matrix, n, &mut set, &mut w);
        let slope = |k: usize| (0..n).map(|l| matrix[k * n + l] * w[l]).sum::<f64>();
        let error: f64 = set.iter().map(|&k| w[k] * slope(k)).sum();
        let open = (0..n).filter(|k| !set.contains(k)).map(|k| (slope(k), k));
        match open.min_by(|a, b| a.0.total_cmp(&b.0)) {
            Some((slope, k)) if slope < error - LOWER * error.abs() => set.push(k),
            _ => break,
        }
    }
    w
}

/// Goes to the least error on the set, which loses those whose weight comes to zero on the way.
fn settle(matrix: &[f64], n: usize, set: &mut Vec<usize>, w: &mut [f64]) {
    while set.len() > 1 {
        let at = |i: usize, j: usize| matrix[set[i] * n + set[j]];
        let differences = |i: usize, j: usize| at(i + 1, j + 1) - at(i + 1, 0) - at(0, j + 1) + at(0, 0);
        let mut rest: Vec<f64> = (1..set.len()).map(|i| at(0, 0) - at(i, 0)).collect();
        Cholesky::new(rest.len(), 1e-12, differences).solve(&mut rest);
        let to: Vec<f64> = std::iter::once(1.0 - rest.iter().sum::<f64>()).chain(rest).collect();
        let far = |(&k, &to): (&usize, &f64)| if to < 0.0 { w[k] / (w[k] - to) } else { 1.0 };
        let step = set.iter().zip(&to).map(far).fold(1.0, f64::min);
        set.iter().zip(&to).for_each(|(&k, to)| w[k] += step * (to - w[k]));
        if step >= 1.0 {
            return;
        }
        let gone = (0..set.len()).filter(|&i| to[i] < 0.0).min_by(|&a, &b| w[set[a]].total_cmp(&w[set[b]]));
        if let Some(gone) = gone {
            w[set.remove(gone)] = 0.0;
        }
    }
    w.fill(0.0);
    w[set[0]] = 1.0;
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn two_candidates_have_the_weights_of_the_closed_form() {
        // e1, e2 of variances 1 and 4, covariance 0.5: w1 = (4 - 0.5) / (1 + 4 - 1).
        let a = [1.0, 0.5, 0.5, 4.0];
        let (w, _) = best(&a, (&a, 0.5), 2, &[0, 1]);
        assert!((w[0] - 0.875).abs() < 10.0 * RIDGE && (w[0] + w[1] - 1.0).abs() < 1e-12, "{w:?}");
        // A covariance above the lesser variance would ask for a negative weight.
        let a = [1.0, 1.5, 1.5, 4.0];
        assert_eq!(best(&a, (&a, 0.5), 2, &[0, 1]).0, [1.0, 0.0]);
        assert_eq!(best(&a, (&a, 0.5), 2, &[1]).0, [1.0]);
        assert_eq!(best(&[0.0; 4], (&[0.0; 4], 0.5), 2, &[0, 1]).0, [0.5, 0.5]);
    }

    #[test]
    fn no_other_weights_do_better() {
        let mut state = 1_u64;
        let mut random = || {
            state = state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1);
            (state >> 40) as f64 / (1 << 24) as f64 - 0.5
        };
        for _ in 0..50 {
            let errors: Vec<[f64; 3]> = (0..12).map(|_| [random(), random(), random()]).collect();
            let a: Vec<f64> =
                (0..9).map(|at| errors.iter().map(|e| e[at / 3] * e[at % 3]).sum::<f64>()).collect();
            let error = |w: &[f64]| {
                errors.iter().map(|e| (0..3).map(|k| w[k] * e[k]).sum::<f64>().powi(2)).sum::<f64>()
            };
            let found = error(&best(&a, (&a, 0.5), 3, &[0, 1, 2]).0);
            for i in 0..=40 {
                for j in 0..=40 - i {
                    let w = [f64::from(i) / 40.0, f64::from(j) / 40.0, f64::from(40 - i - j) / 40.0];
                    assert!(found <= error(&w) + 10.0 * RIDGE * error(&[1.0 / 3.0; 3]), "{w:?}");
                }
            }
        }
    }

    /// Against all sets of candidates, each solved by itself.
    #[test]
    fn it_is_the_best_of_all_sets() {
        let mut state = 7_u64;
        let mut random = || {
            state = state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1);
            (state >> 40) as f64 / (1 << 24) as f64 - 0.5
        };
        for n in [2, 3, 5, 8] {
            for _ in 0..30 {
                let common = 2.0 * random();
                let errors: Vec<Vec<f64>> =
                    (0..2 * n).map(|_| (0..n).map(|_| common + random()).collect()).collect();
                let ridge = |i: usize, j: usize| if i == j { 1e-4 } else { 0.0 };
                let matrix: Vec<f64> = (0..n * n)
                    .map(|at| {
                        errors.iter().map(|e| e[at / n] * e[at % n]).sum::<f64>() + ridge(at / n, at % n)
                    })
                    .collect();
                let value = |w: &[f64]| (0..n * n).map(|at| w[at / n] * w[at % n] * matrix[at]).sum::<f64>();
                let found = on_simplex(&matrix, n);
                assert!(found.iter().all(|&w| w >= 0.0) && (found.iter().sum::<f64>() - 1.0).abs() < 1e-9);
                let mut least = f64::INFINITY;
                for set in 1_usize..1 << n {
                    let chosen: Vec<usize> = (0..n).filter(|k| set >> k & 1 == 1).collect();
                    let mut part = vec![1.0; chosen.len()];
                    Cholesky::new(chosen.len(), 1e-12, |i, j| matrix[chosen[i] * n + chosen[j]])
                        .solve(&mut part);
                    let total: f64 = part.iter().sum();
                    let mut w = vec![0.0; n];
                    chosen.iter().zip(part).for_each(|(&k, part)| w[k] = part / total);
                    if w.iter().all(|&w| w >= 0.0) {
                        least = least.min(value(&w));
                    }
                }
                assert!(value(&found) <= least * (1.0 + 1e-7), "{n}: {} {least}", value(&found));
            }
        }
    }
}
