//! What the l1 solvers know of a problem: `min |U x|_1 subject to |S x - y|_2 <= epsilon`, by the actions of `U` and `S`.
//!
//! The entries of `U x` are real numbers, complex ones or pairs; `|.|_1` is the sum of their magnitudes. Sums run over
//! rows of a fixed length in f64, each in order, then over the rows in order: no thread changes a bit.

use lacuna_core::parallel::prelude::*;
use lacuna_transforms::Complex;

use crate::prox::L2Ball;

/// Entries of a row where the operator has none of its own.
pub const ROW: usize = 4096;

/// An entry of `U x`.
pub trait Entry: Copy + Send + Sync {
    /// Its magnitude.
    fn magnitude(self) -> f32;
    /// The nearest entry whose dual magnitude is at most 1.
    fn clip(self) -> Self;
    /// The inner product of two entries as real vectors.
    fn dot(self, other: Self) -> f32;
    /// The entry times a factor.
    fn times(self, factor: f32) -> Self;
    /// The entry plus another times a factor.
    fn plus(self, other: Self, factor: f32) -> Self;
}

impl Entry for f32 {
    fn magnitude(self) -> f32 {
        self.abs()
    }
    fn clip(self) -> Self {
        self.clamp(-1.0, 1.0)
    }
    fn dot(self, other: Self) -> f32 {
        self * other
    }
    fn times(self, factor: f32) -> Self {
        self * factor
    }
    fn plus(self, other: Self, factor: f32) -> Self {
        self + factor * other
    }
}

impl Entry for Complex<f32> {
    fn magnitude(self) -> f32 {
        self.norm_sqr().sqrt()
    }
    fn clip(self) -> Self {
        self * (1.0 / self.norm_sqr().sqrt().max(1.0))
    }
    fn dot(self, other: Self) -> f32 {
        self.re * other.re + self.im * other.im
    }
    fn times(self, factor: f32) -> Self {
        self * factor
    }
    fn plus(self, other: Self, factor: f32) -> Self {
        self + other * factor
    }
}

/// A linear map `U` whose image is to be sparse.
pub trait Sparsity: Sync {
    /// An entry of `U x`.
    type Entry: Entry;
    /// Buffers for one map at a time, with the entries among them.
    type Work: Send;

    /// Buffers.
    fn work(&self) -> Self::Work;
    /// The entries `U x`.
    fn analyse(&self, x: &[f32], work: &mut Self::Work);
    /// `x = U^T c` for the entries `c`, which are destroyed.
    fn adjoint(&self, work: &mut Self::Work, x: &mut [f32]);
    /// The entries.
    fn entries<'a>(&self, work: &'a mut Self::Work) -> &'a mut [Self::Entry];
    /// Length of a row of entries.
    fn row(&self) -> usize {
        ROW
    }
    /// How often an entry of a row counts.
    fn weight(&self, _row: usize) -> f64 {
        1.0
    }
    /// At least the square of the largest singular value of `U`.
    fn bound(&self) -> f64;

    /// The sum of the magnitudes.
    fn norm(&self, work: &mut Self::Work) -> f64 {
        self.sum(work, |entry| {
            let magnitude = entry.magnitude();
            (*entry, magnitude)
        })
    }

    /// The largest magnitude that `U x` has without the level of `x`, where that has entries of its own.
    fn peak(&self, x: &[f32], work: &mut Self::Work) -> f64 {
        self.analyse(x, work);
        self.largest(work)
    }

    /// The largest magnitude.
    fn largest(&self, work: &mut Self::Work) -> f64 {
        let largest = |row: &[Self::Entry]| row.iter().map(|entry| entry.magnitude()).fold(0.0, f32::max);
        f64::from(self.entries(work).par_chunks(ROW).map(largest).into_iter().fold(0.0, f32::max))
    }

    /// Replaces the entries `c` by those `u` of the dual ball at which `<u, c> - mu/2 |u|^2` is largest, and returns the sum of
    /// these maxima: the smoothed norm, whose gradient is `U^T u`.
    fn soften(&self, work: &mut Self::Work, mu: f64) -> f64 {
        let (half, inverse) = (0.5 * mu as f32, (1.0 / mu) as f32);
        self.sum(work, move |entry| {
            let u = entry.times(inverse).clip();
            (u, u.dot(*entry) - half * u.dot(u))
        })
    }

    /// Replaces every entry, and adds up values beside them.
    fn sum(&self, work: &mut Self::Work, each: impl Fn(&Self::Entry) -> (Self::Entry, f32) + Sync) -> f64 {
        let rows = self.entries(work).par_chunks_mut(self.row());
        let sums = rows.map(|row| {
            let mut sum = 0.0;
            for entry in row {
                let (new, value) = each(entry);
                *entry = new;
                sum += f64::from(value);
            }
            sum
        });
        sums.into_iter().enumerate().map(|(row, sum)| self.weight(row) * sum).sum()
    }
}

/// `|S x - y|_2 <= radius`.
#[derive(Clone, Copy, Debug)]
pub struct Samples<'a> {
    /// `y` at measured pixels; not read elsewhere.
    pub values: &'a [f32],
    /// Which pixels `S` picks.
    pub measured: &'a [bool],
    /// The distance allowed; 0 fixes measured pixels.
    pub radius: f64,
}

impl Samples<'_> {
    /// What the differences from the samples are multiplied by to project `x(i)` on the ball.
    pub fn keep(&self, x: impl Fn(usize) -> f32 + Sync) -> f32 {
        if self.radius == 0.0 {
            return 0.0;
        }
        L2Ball { radius: self.radius }.keep(self.distance(x)) as f32
    }

    /// `|S x - y|_2`.
    pub fn distance(&self, x: impl Fn(usize) -> f32 + Sync) -> f64 {
        let rows = self.values.par_chunks(ROW).zip(self.measured.par_chunks(ROW)).enumerate();
        let squares = rows.map(|(row, (values, measured))| -> f64 {
            let both = values.iter().zip(measured).enumerate().filter(|(_, (_, measured))| **measured);
            both.map(|(i, (value, _))| f64::from(x(row * ROW + i) - value).powi(2)).sum()
        });
        squares.into_iter().sum::<f64>().sqrt()
    }
}

/// How a solver ended.
#[derive(Clone, Copy, Debug)]
pub struct Ending {
    /// Why it stopped.
    pub stop: crate::Stop,
    /// Iterations taken.
    pub iterations: usize,
    /// `|U x|_1`.
    pub objective: f64,
    /// `|S x - y|_2`.
    pub distance: f64,
}

/// The objective over the last iterations: it has settled when it is twice near their mean.
///
/// Source: S. Becker, J. Bobin, E. Candes, "NESTA: A Fast and Accurate First-Order Method for Sparse Recovery", SIAM Journal
/// on Imaging Sciences 4(1), 2011, section 3.4 (the relative variation of the objective from its mean over ten iterations).
#[derive(Clone, Debug, Default)]
pub struct Settling {
    last: std::collections::VecDeque<f64>,
    near: bool,
}

impl Settling {
    /// Iterations of the mean.
    const OVER: usize = 10;

    /// Enters an objective; whether it has settled within `tolerance`.
    pub fn enter(&mut self, objective: f64, tolerance: f64) -> bool {
        if self.last.len() == Self::OVER {
            let mean = self.last.iter().sum::<f64>() / Self::OVER as f64;
            if (objective - mean).abs() <= tolerance * mean.abs() {
                if self.near {
                    return true;
                }
                self.near = true;
            } else {
                self.near = false;
            }
            self.last.pop_front();
        }
        self.last.push_back(objective);
        false
    }
}
