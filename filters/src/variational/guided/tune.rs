//! What each guide counts for, chosen by leaving measured pixels out.
//!
//! A measured pixel is predicted from all others; the sum of the squared errors over some thousand pixels, more of them where the image varies and
//! each over the size of the pixel or of the prediction so that neither highlights nor dark pixels decide alone ([`Weights`]), is the score. Group by group the bandwidth is
//! narrowed, widened and taken out, and the group dropped; a change that scores better stays. Two
//! rounds. A guide that does not predict ends up dropped.

use super::fit::{Field, Store, Task};
use super::probe::{Probe, probe, probes};
use super::reach::Reach;
use crate::kernel::Isa;
use crate::kernel::regress::{RIDGE, Scales};
use crate::{Mask, Planes};

/// Cells whose measured pixels are left out, about.
const PROBES: f64 = 400.0;
/// Factor of a guide's difference to begin with.
const BANDWIDTH: f32 = 1.6;
/// What a change of the bandwidth must gain.
const GAIN: f64 = 0.98;

/// A store of samples with what is needed to try scales on it.
pub struct Trial<'a> {
    /// The samples.
    pub store: &'a Store,
    /// Which pixels they are.
    pub mask: &'a Mask,
    /// Their values.
    pub values: &'a Planes,
    /// What errors count for.
    pub weights: Weights,
    /// The guides.
    pub field: Field<'a>,
    /// How far pixels look.
    pub reach: &'a Reach,
    /// The instruction set.
    pub isa: Isa,
}

impl Trial<'_> {
    fn score(&self, scales: &Scales, cells: &[Probe]) -> f64 {
        let task = Task { field: self.field, scales, reach: self.reach, leave_out: true, isa: self.isa };
        let found = probe(self.store, task, self.mask, cells);
        let error = |((&index, weight), values): ((&usize, &f64), &[f32])| {
            let truth = self.values.as_slice().iter().map(|plane| plane.pixels()[index]);
            let squares = values.iter().zip(truth).map(|(a, b)| f64::from(a - b).powi(2));
            // Over the larger of both, or a single dark pixel that is predicted bright decides.
            let most = values.iter().map(|value| f64::from(*value).abs()).fold(0.0, f64::max);
            squares.sum::<f64>() * self.weights.beside(most, self.values, index) * weight
        };
        let predicted = found.values.chunks_exact(self.values.len());
        found.at.iter().zip(&found.weights).zip(predicted).map(error).sum()
    }

    /// The scales to begin with, at which every guide counts.
    pub fn first(guides: usize) -> Scales {
        Scales { bandwidths: vec![BANDWIDTH; guides], slopes: vec![true; guides], ridge: RIDGE }
    }

    /// The best scales that were tried.
    pub fn choose(&self, groups: &[Vec<usize>]) -> Scales {
        let weight = |index| self.weights.at(self.values, index);
        let cells = probes(self.mask, self.values, weight, PROBES);
        let mut best = Self::first(self.field.count());
        let mut score = self.score(&best, &cells);
        for _ in 0..2 {
            let before = best.clone();
            for group in groups {
                for change in [Change::Drop, Change::Ignore, Change::Factor(0.5), Change::Factor(2.0)] {
                    let trial = change.of(&best, group);
                    if trial == best {
                        continue;
                    }
                    let new = self.score(&trial, &cells);
                    let gain = if matches!(change, Change::Drop) { 1.0 } else { GAIN };
                    if new < gain * score {
                        (best, score) = (trial, new);
                    }
                }
            }
            if best == before {
                break;
            }
        }
        best
    }
}

/// What a squared error counts for: one over the mean square of the image plus the pixel's own square.
#[derive(Clone, Copy, Debug)]
pub struct Weights {
    level: f64,
}

impl Weights {
    /// The level is the square of the mean absolute value.
    pub fn new(mask: &Mask, values: &Planes) -> Self {
        let (mut sum, mut count) = (0.0, 0.0_f64);
        for plane in values.as_slice() {
            for (value, _) in plane.pixels().iter().zip(mask.as_slice()).filter(|(_, measured)| **measured) {
                sum += f64::from(*value).abs();
                count += 1.0;
            }
        }
        let mean = sum / count.max(1.0);
        Self { level: (mean * mean).max(f64::MIN_POSITIVE) }
    }

    /// At a pixel, by its largest channel.
    pub fn at(self, values: &Planes, index: usize) -> f64 {
        self.beside(0.0, values, index)
    }

    /// The same beside another size of the pixel, of which the larger counts.
    pub fn beside(self, other: f64, values: &Planes, index: usize) -> f64 {
        let sizes = values.as_slice().iter().map(|plane| f64::from(plane.pixels()[index]).abs());
        let most = sizes.fold(other, f64::max);
        1.0 / (self.level + most * most)
    }
}

/// A change of one group.
#[derive(Clone, Copy)]
enum Change {
    /// Neither weight nor slope.
    Drop,
    /// No weight.
    Ignore,
    /// A wider or narrower weight.
    Factor(f32),
}

impl Change {
    fn of(self, scales: &Scales, group: &[usize]) -> Scales {
        let mut new = scales.clone();
        for &guide in group {
            match self {
                Self::Drop => (new.bandwidths[guide], new.slopes[guide]) = (0.0, false),
                Self::Ignore => new.bandwidths[guide] = 0.0,
                Self::Factor(factor) => new.bandwidths[guide] *= factor,
            }
        }
        new
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{Plane, Size};

    #[test]
    fn a_dark_pixel_that_is_predicted_bright_counts_like_a_bright_one_that_is_predicted_dark() {
        let size = Size::new(1, 100);
        let values =
            Planes::new(size, vec![Plane::from_fn(size, |_, x| if x == 7 { 1.0 } else { 0.0 })]).unwrap();
        let weights = Weights::new(&Mask::from_fn(size, |_, _| true), &values);
        let (dark, bright) = (weights.beside(1.0, &values, 3), weights.beside(0.0, &values, 7));
        assert!((dark - bright).abs() < 1e-12 && weights.at(&values, 3) > 1000.0 * dark);
    }
}
