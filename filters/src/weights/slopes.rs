//! What some errors tell of others, place by place.
//!
//! ```text
//! b(p) = argmin  sum over samples i of g(p - i) |r(i) - b d(i)|^2  +  the same over all of the image, in its share
//! ```
//!
//! with `d` the errors that are known everywhere, `r` those that are wanted, at samples `i` that neither has seen, and `g` as for [`Weights`]. A ridge
//! keeps errors apart that go together.

use lacuna_core::parallel::prelude::*;

use super::{Neighbourhood, Weights, add_products};
use crate::Mask;
use crate::solver::cholesky::Cholesky;

/// Samples around a place, and what all of the image counts for.
const NEAR: Neighbourhood = Neighbourhood { spread: 4.0, frame: 0.5 };
/// What is added to the diagonal, over itself: known errors may differ by orders of magnitude.
const RIDGE: f64 = 0.01;
/// A pivot of so much of the diagonal is none.
const SINGULAR: f64 = 1e-12;

/// The slopes in cells.
#[derive(Clone, Debug)]
pub struct Slopes {
    /// Cells, and what stands in them: of each wanted error those of all known ones.
    cells: Weights,
    known: usize,
}

impl Slopes {
    /// From errors at the samples `at`: the known ones and those that are wanted, plane by plane.
    pub fn new(mask: &Mask, at: &[u32], known: &[Vec<f32>], wanted: &[Vec<f32>]) -> Self {
        let (count, all) = (known.len(), known.len() + wanted.len());
        let mut errors = vec![0.0; all];
        let (mut cells, around, whole) = Weights::summed(mask, (at, NEAR), all, |i, _, products| {
            for (error, values) in errors.iter_mut().zip(known.iter().chain(wanted)) {
                *error = f64::from(values[i]);
            }
            add_products(&errors, products);
        });
        let solved = around.par_iter().with_min_len(16).map(|own| slopes(own, &whole, count, all));
        let of = |k: usize| solved.iter().map(|slopes| slopes[k] as f32).collect();
        cells.of = (0..count * wanted.len()).map(of).collect();
        Self { cells, known: count }
    }

    /// What is told of a wanted error at a pixel where these are the known ones.
    pub fn told(&self, wanted: usize, pixel: usize, known: impl Iterator<Item = f32>) -> f32 {
        let (row, column) = (pixel / self.cells.size.width, pixel % self.cells.size.width);
        let slopes = &self.cells.of[wanted * self.known..][..self.known];
        slopes.iter().zip(known).map(|(of, known)| self.cells.at(of, row, column) * known).sum()
    }
}

/// The slopes of each wanted error, from sums of products of the known ones and those that are wanted, around a place and over the image.
fn slopes(own: &[f64], whole: &[f64], known: usize, all: usize) -> Vec<f64> {
    let trace = |sums: &[f64]| (0..known).map(|k| sums[k * all + k]).sum::<f64>();
    let (here, everywhere) = (trace(own), trace(whole));
    let share = if everywhere > 0.0 { NEAR.frame * here / everywhere } else { 0.0 };
    let at = |row: usize, column: usize| own[row * all + column] + share * whole[row * all + column];
    let matrix = |row: usize, column: usize| at(row, column) * if row == column { 1.0 + RIDGE } else { 1.0 };
    let factor = Cholesky::new(known, SINGULAR, matrix);
    let of = |wanted: usize| {
        let mut slopes: Vec<f64> = (0..known).map(|row| at(row, wanted)).collect();
        factor.solve(&mut slopes);
        slopes
    };
    (known..all).flat_map(of).collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::Size;
    use lacuna_core::hash;

    const SIZE: Size = Size::new(120, 160);

    /// Two known errors whose slopes differ between the halves of the image, and one that tells nothing.
    #[test]
    fn slopes_are_found_place_by_place() {
        let noise = |seed: u64, at: u32| (hash(seed, u64::from(at)) as f64 / u64::MAX as f64 - 0.5) as f32;
        let at: Vec<u32> =
            (0..SIZE.pixels() as u32).filter(|at| hash(9, u64::from(*at)).is_multiple_of(4)).collect();
        let known: Vec<Vec<f32>> =
            (0..3).map(|k| at.iter().map(|&at| noise(k, at)).collect::<Vec<f32>>()).collect();
        let slope =
            |at: u32| if (at as usize % SIZE.width) < SIZE.width / 2 { [2.0, 0.5] } else { [-1.0, 0.25] };
        let wanted = |i: usize| {
            let [a, b] = slope(at[i]);
            a * known[0][i] + b * known[1][i] + 0.1 * noise(7, at[i])
        };
        let wanted: Vec<f32> = (0..at.len()).map(wanted).collect();
        let mask = Mask::from_fn(SIZE, |_, _| true);
        let slopes = Slopes::new(&mask, &at, &known, &[wanted]);
        for (row, column) in [(20, 20), (100, 30), (60, 130), (110, 150)] {
            let pixel = row * SIZE.width + column;
            let [a, b] = slope(pixel as u32);
            let unit = |k: usize| (0..3).map(move |j| f32::from(u8::from(j == k)));
            let found = [0, 1, 2].map(|k| slopes.told(0, pixel, unit(k)));
            for ((found, truth), mean) in found.into_iter().zip([a, b, 0.0]).zip([0.5, 0.375, 0.0]) {
                // All of the image, over which slopes have their mean, counts in its share.
                let expected = (truth + NEAR.frame as f32 * mean) / (1.0 + NEAR.frame as f32);
                assert!((found - expected).abs() < 0.1, "{found} {expected} at {row}, {column}");
            }
        }
    }

    #[test]
    fn errors_that_are_none_tell_nothing() {
        let at: Vec<u32> = (0..SIZE.pixels() as u32).step_by(7).collect();
        let mask = Mask::from_fn(SIZE, |_, _| true);
        let none = vec![vec![0.0; at.len()]; 2];
        let wanted = vec![vec![1.0; at.len()]];
        let slopes = Slopes::new(&mask, &at, &none, &wanted);
        assert!(slopes.told(0, 500, [1.0_f32, 1.0].into_iter()) == 0.0);
    }
}
