//! What each candidate counts for at each pixel, from errors at held-out samples.

use lacuna_core::parallel::prelude::*;

use super::{FRAME, SPREAD, WORTH};
use crate::estimate::HeldOut;
use crate::solver::cholesky::Cholesky;
use crate::{Mask, Planes, Size};

/// Cells to each side of a cell that its neighbourhood takes in: three Gaussian widths.
const REACH: usize = 6;
/// What is added to the diagonal of errors, over their mean, so that candidates that agree share alike.
const RIDGE: f64 = 1e-4;

/// Weights in cells, by candidate; they sum to 1.
#[derive(Clone, Debug)]
pub struct Weights {
    size: Size,
    /// Side of a cell.
    side: usize,
    cells: Size,
    /// Of each candidate, the weight in each cell; empty for one that counts nowhere.
    of: Vec<Vec<f32>>,
    /// Of each candidate, its mean weight at missing pixels.
    shares: Vec<f64>,
}

/// Products of the errors of two candidates.
type Products = Vec<f64>;

impl Weights {
    /// From predictions at the same held-out samples, one list a candidate; nothing held out leaves all to the first.
    pub fn new(mask: &Mask, truth: &Planes, held: &[HeldOut]) -> Self {
        let size = mask.size();
        let count = held.first().map_or(0, |held| held.at.len());
        let spacing = (size.pixels() as f64 / count.max(1) as f64).sqrt();
        let side = ((0.5 * SPREAD * spacing).round() as usize).max(1);
        let cells = Size::new(size.height.div_ceil(side), size.width.div_ceil(side));
        let mut own = Self { size, side, cells, of: vec![vec![1.0; cells.pixels()]], shares: vec![1.0] };
        if count == 0 || held.len() < 2 {
            return own;
        }
        let products = own.products(truth, held);
        let whole = sum(&products);
        let around = blur(cells, &products);
        let mut counting: Vec<usize> = (0..held.len()).collect();
        while let Some(least) = Self::dispensable(&around, &whole, held.len(), &counting) {
            counting.retain(|&k| k != least);
        }
        own.of = Self::solve(&around, &whole, held.len(), &counting);
        own.shares = own.mean_at_missing(mask);
        own
    }

    /// Sums of products of errors in each cell.
    fn products(&self, truth: &Planes, held: &[HeldOut]) -> Vec<Products> {
        let count = held.len();
        let mut cells = vec![vec![0.0; count * count]; self.cells.pixels()];
        let mut errors = vec![0.0_f64; count];
        for (i, &pixel) in held[0].at.iter().enumerate() {
            let cell = &mut cells[self.cell(pixel as usize)];
            for (channel, plane) in truth.as_slice().iter().enumerate() {
                let value = f64::from(plane.pixels()[pixel as usize]);
                for (error, held) in errors.iter_mut().zip(held) {
                    *error = f64::from(held.predicted[channel][i]) - value;
                }
                for k in 0..count {
                    for l in 0..count {
                        cell[k * count + l] += errors[k] * errors[l];
                    }
                }
            }
        }
        cells
    }

    fn cell(&self, pixel: usize) -> usize {
        pixel / self.size.width / self.side * self.cells.width + pixel % self.size.width / self.side
    }

    /// The candidate whose absence costs least, if that is not worth its time.
    fn dispensable(around: &[Products], whole: &[f64], count: usize, among: &[usize]) -> Option<usize> {
        if among.len() < 2 {
            return None;
        }
        let error = |among: &[usize]| {
            let errors = around.par_iter().with_min_len(64).map(|cell| best(cell, whole, count, among).1);
            errors.iter().sum::<f64>()
        };
        let without = |&k: &usize| {
            let rest: Vec<usize> = among.iter().copied().filter(|&other| other != k).collect();
            (error(&rest), k)
        };
        let (least, k) = among.iter().map(without).min_by(|a, b| a.0.total_cmp(&b.0))?;
        (least * (1.0 - WORTH) <= error(among)).then_some(k)
    }

    /// The weights of all cells, by candidate.
    fn solve(around: &[Products], whole: &[f64], count: usize, among: &[usize]) -> Vec<Vec<f32>> {
        let cells = around.par_iter().with_min_len(64).map(|cell| best(cell, whole, count, among).0);
        let of = |k: usize| match among.iter().position(|&other| other == k) {
            Some(at) => cells.iter().map(|weights| weights[at] as f32).collect(),
            None => Vec::new(),
        };
        (0..count).map(of).collect()
    }

    fn mean_at_missing(&self, mask: &Mask) -> Vec<f64> {
        let mut missing = vec![0_usize; self.cells.pixels()];
        for (pixel, _) in mask.as_slice().iter().enumerate().filter(|(_, flag)| !**flag) {
            missing[self.cell(pixel)] += 1;
        }
        let all = (mask.size().pixels() - mask.count()).max(1) as f64;
        let share = |of: &Vec<f32>| {
            of.iter().zip(&missing).map(|(&w, &n)| f64::from(w) * n as f64).sum::<f64>() / all
        };
        self.of.iter().map(share).collect()
    }

    /// Whether a candidate counts anywhere.
    pub fn counts(&self, candidate: usize) -> bool {
        self.of.get(candidate).is_some_and(|of| !of.is_empty())
    }

    /// The only candidate that counts, if there is one.
    pub fn alone(&self) -> Option<usize> {
        let mut counting = (0..self.of.len()).filter(|&k| self.counts(k));
        counting.next().filter(|_| counting.next().is_none())
    }

    /// The mean weight of a candidate at missing pixels.
    pub fn share(&self, candidate: usize) -> f64 {
        self.shares.get(candidate).copied().unwrap_or(0.0)
    }

    /// Adds a candidate's image, weighted, to the blend.
    pub fn add(&self, candidate: usize, image: &Planes, out: &mut Planes) {
        let of = &self.of[candidate];
        let width = self.size.width;
        for (out, image) in out.as_mut_slice().iter_mut().zip(image.as_slice()) {
            let rows =
                out.pixels_mut().par_chunks_mut(width).zip(image.pixels().par_chunks(width)).enumerate();
            rows.for_each(|(row, (out, image))| {
                for (column, (out, &value)) in out.iter_mut().zip(image).enumerate() {
                    *out += self.at(of, row, column) * value;
                }
            });
        }
    }

    /// Linearly between the centres of cells.
    fn at(&self, of: &[f32], row: usize, column: usize) -> f32 {
        let between = |at: usize, count: usize| {
            let place = ((at as f32 + 0.5) / self.side as f32 - 0.5).clamp(0.0, (count - 1) as f32);
            let low = (place as usize).min(count.saturating_sub(2));
            (low, (low + 1).min(count - 1), place - low as f32)
        };
        let (top, bottom, y) = between(row, self.cells.height);
        let (left, right, x) = between(column, self.cells.width);
        let line = |row: usize| {
            let (a, b) = (of[row * self.cells.width + left], of[row * self.cells.width + right]);
            a + x * (b - a)
        };
        let (a, b) = (line(top), line(bottom));
        a + y * (b - a)
    }

    /// The blend of what was predicted at held-out samples.
    pub fn of_held_out(&self, held: &[HeldOut]) -> HeldOut {
        let mut blend = held.first().cloned().unwrap_or_default();
        if self.alone() == Some(0) {
            return blend;
        }
        for (channel, values) in blend.predicted.iter_mut().enumerate() {
            for (i, (value, &pixel)) in values.iter_mut().zip(&blend.at).enumerate() {
                let place = (pixel as usize / self.size.width, pixel as usize % self.size.width);
                let counting = held.iter().enumerate().filter(|(k, _)| self.counts(*k));
                *value = counting
                    .map(|(k, held)| self.at(&self.of[k], place.0, place.1) * held.predicted[channel][i])
                    .sum();
            }
        }
        blend
    }
}

fn sum(cells: &[Products]) -> Products {
    let mut whole = vec![0.0; cells.first().map_or(0, Vec::len)];
    for cell in cells {
        whole.iter_mut().zip(cell).for_each(|(sum, value)| *sum += value);
    }
    whole
}

/// Convolves with a Gaussian whose standard deviation is two cells, along rows and columns.
fn blur(size: Size, cells: &[Products]) -> Vec<Products> {
    let gauss = |k: usize| (-0.125 * (k * k) as f64).exp();
    let pass = |from: &[Products], step: usize, length: usize, place: &(dyn Fn(usize) -> usize + Sync)| {
        (0..from.len()).into_par_iter().with_min_len(64).map(|at| {
            let here = place(at);
            let mut sum = vec![0.0; from[at].len()];
            for other in here.saturating_sub(REACH)..(here + REACH + 1).min(length) {
                let weight = gauss(other.abs_diff(here));
                let from = &from[at + other * step - here * step];
                sum.iter_mut().zip(from).for_each(|(sum, value)| *sum += weight * value);
            }
            sum
        })
    };
    let rows = pass(cells, 1, size.width, &|at| at % size.width);
    pass(&rows, size.width, size.height, &|at| at / size.width)
}

/// The weights, among those candidates, that make the squared error of a neighbourhood least, and that error.
///
/// Every set of candidates is tried: on it the least error under `sum w = 1` is that of `w ~ A^-1 1`, and the best one that has no negative
/// weight is the answer.
fn best(cell: &[f64], whole: &[f64], count: usize, among: &[usize]) -> (Vec<f64>, f64) {
    let trace = |of: &[f64]| among.iter().map(|&k| of[k * count + k]).sum::<f64>();
    let (here, all) = (trace(cell), trace(whole));
    let equal = || (vec![1.0 / among.len() as f64; among.len()], 0.0);
    if all <= 0.0 || !all.is_finite() {
        return equal();
    }
    // A neighbourhood without any error takes the weights of the image.
    let level = if here > 1e-12 * all { here } else { 1e-12 * all };
    let at = |k: usize, l: usize| (cell[k * count + l] + FRAME * level * whole[k * count + l] / all) / level;
    let mut found = equal();
    found.1 = f64::INFINITY;
    for set in 1_usize..1 << among.len() {
        let chosen: Vec<usize> = (0..among.len()).filter(|k| set >> k & 1 == 1).collect();
        let entry =
            |i: usize, j: usize| at(among[chosen[i]], among[chosen[j]]) + if i == j { RIDGE } else { 0.0 };
        let mut w = vec![1.0; chosen.len()];
        Cholesky::new(chosen.len(), 1e-12, entry).solve(&mut w);
        let total: f64 = w.iter().sum();
        if total <= 0.0 || !total.is_finite() || w.iter().any(|&w| w < 0.0) {
            continue;
        }
        for w in &mut w {
            *w /= total;
        }
        let error: f64 = (0..w.len())
            .map(|i| (0..w.len()).map(|j| w[i] * w[j] * at(among[chosen[i]], among[chosen[j]])).sum::<f64>())
            .sum();
        if error < found.1 {
            let mut weights = vec![0.0; among.len()];
            chosen.iter().zip(w).for_each(|(&k, w)| weights[k] = w);
            found = (weights, error);
        }
    }
    (found.0, found.1 * level)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn two_candidates_have_the_weights_of_the_closed_form() {
        // e1, e2 of variances 1 and 4, covariance 0.5: w1 = (4 - 0.5) / (1 + 4 - 1).
        let a = [1.0, 0.5, 0.5, 4.0];
        let (w, _) = best(&a, &a, 2, &[0, 1]);
        assert!((w[0] - 0.875).abs() < 10.0 * RIDGE && (w[0] + w[1] - 1.0).abs() < 1e-12, "{w:?}");
        // A covariance above the lesser variance would ask for a negative weight.
        let a = [1.0, 1.5, 1.5, 4.0];
        assert_eq!(best(&a, &a, 2, &[0, 1]).0, [1.0, 0.0]);
        assert_eq!(best(&a, &a, 2, &[1]).0, [1.0]);
        assert_eq!(best(&[0.0; 4], &[0.0; 4], 2, &[0, 1]).0, [0.5, 0.5]);
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
            let found = error(&best(&a, &a, 3, &[0, 1, 2]).0);
            for i in 0..=40 {
                for j in 0..=40 - i {
                    let w = [f64::from(i) / 40.0, f64::from(j) / 40.0, f64::from(40 - i - j) / 40.0];
                    assert!(found <= error(&w) + 10.0 * RIDGE * error(&[1.0 / 3.0; 3]), "{w:?}");
                }
            }
        }
    }
}
