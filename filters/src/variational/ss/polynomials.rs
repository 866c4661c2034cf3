//! Without tension an energy of order m does not see polynomials of degree below m. Those that vanish at all samples (one
//! sample, samples on a line or a conic) can then be added at no cost: the image is not determined. What is taken is
//! the limit of a vanishing harmonic term: among all minimisers the one with the least sum of squared differences
//! between neighbours.

use crate::solver::eigen::eigenvectors;
use crate::{Mask, Plane};

/// Monomials of degree 0, 1, 2 as powers of (row, column).
const POWERS: [(i32, i32); 6] = [(0, 0), (1, 0), (0, 1), (2, 0), (1, 1), (0, 2)];
/// Mean square at the samples, over that of all monomials, below which a polynomial vanishes there.
const VANISHES: f64 = 1e-11;

/// Polynomials that vanish at all samples.
pub struct Unseen {
    origin: (f64, f64),
    scale: (f64, f64),
    powers: Vec<(i32, i32)>,
    /// Coefficients, one polynomial each.
    basis: Vec<Vec<f64>>,
}

impl Unseen {
    /// Polynomials of degree below `order` that are zero at every measured pixel for which `counts`.
    pub fn new(order: usize, mask: &Mask, counts: impl Fn(usize, usize) -> bool) -> Self {
        let size = mask.size();
        let cells = || {
            (0..size.height)
                .flat_map(move |i| (0..size.width).map(move |j| (i, j)))
                .filter(|&(i, j)| mask.is_measured(i, j) && counts(i, j))
        };
        let (mut low, mut high) = ((usize::MAX, usize::MAX), (0, 0));
        for (i, j) in cells() {
            low = (low.0.min(i), low.1.min(j));
            high = (high.0.max(i), high.1.max(j));
        }
        let centre = |a: usize, b: usize| 0.5 * (a as f64 + b as f64);
        let extent = |a: usize, b: usize| (0.5 * (b as f64 - a as f64)).max(0.5);
        // Powers that an axis of so few pixels can tell from lower ones.
        let powers: Vec<(i32, i32)> = POWERS
            .into_iter()
            .filter(|&(a, b)| {
                ((a + b) as usize) < order && (a as usize) < size.height && (b as usize) < size.width
            })
            .collect();
        let mut unseen = Self {
            origin: (centre(low.0, high.0), centre(low.1, high.1)),
            scale: (extent(low.0, high.0), extent(low.1, high.1)),
            powers,
            basis: Vec::new(),
        };
        let n = unseen.powers.len();
        let mut gram = vec![0.0; n * n];
        for (i, j) in cells() {
            let values = unseen.monomials(i, j);
            for a in 0..n {
                for b in 0..n {
                    gram[a * n + b] += values[a] * values[b];
                }
            }
        }
        let trace: f64 = (0..n).map(|a| gram[a * n + a]).sum();
        unseen.basis = eigenvectors(gram, n)
            .into_iter()
            .filter(|(value, _)| *value <= VANISHES * trace)
            .map(|(_, vector)| vector)
            .collect();
        unseen
    }

    /// Whether the samples determine every polynomial.
    pub fn is_empty(&self) -> bool {
        self.basis.is_empty()
    }

    fn monomials(&self, i: usize, j: usize) -> Vec<f64> {
        let (y, x) = ((i as f64 - self.origin.0) / self.scale.0, (j as f64 - self.origin.1) / self.scale.1);
        self.powers.iter().map(|&(a, b)| y.powi(a) * x.powi(b)).collect()
    }

    fn values(&self, i: usize, j: usize) -> Vec<f64> {
        let monomials = self.monomials(i, j);
        self.basis.iter().map(|c| c.iter().zip(&monomials).map(|(c, m)| c * m).sum()).collect()
    }

    /// Adds the combination that makes the image's harmonic energy least; `free` says which pixels may change.
    pub fn settle(&self, image: &mut Plane, free: impl Fn(usize, usize) -> bool) {
        let n = self.basis.len();
        let size = image.size();
        let (mut gram, mut slope) = (vec![0.0; n * n], vec![0.0; n]);
        let mut edge = |from: (usize, usize), to: (usize, usize)| {
            let rise = f64::from(image.at(to.0, to.1)) - f64::from(image.at(from.0, from.1));
            let (a, b) = (self.values(from.0, from.1), self.values(to.0, to.1));
            let change: Vec<f64> = a.iter().zip(&b).map(|(a, b)| b - a).collect();
            for a in 0..n {
                slope[a] -= change[a] * rise;
                for b in 0..n {
                    gram[a * n + b] += change[a] * change[b];
                }
            }
        };
        for i in 0..size.height {
            for j in 0..size.width {
                if j + 1 < size.width {
                    edge((i, j), (i, j + 1));
                }
                if i + 1 < size.height {
                    edge((i, j), (i + 1, j));
                }
            }
        }
        let mut weights = vec![0.0; n];
        for (value, vector) in eigenvectors(gram, n) {
            let along: f64 = vector.iter().zip(&slope).map(|(v, s)| v * s).sum();
            if value > 0.0 {
                weights.iter_mut().zip(&vector).for_each(|(w, v)| *w += along / value * v);
            }
        }
        for i in 0..size.height {
            for j in 0..size.width {
                if free(i, j) {
                    let add: f64 = weights.iter().zip(self.values(i, j)).map(|(w, v)| w * v).sum();
                    let pixel = &mut image.row_mut(i)[j];
                    *pixel = (f64::from(*pixel) + add) as f32;
                }
            }
        }
    }
}
