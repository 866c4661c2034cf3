//! Measured pixels that were predicted without themselves, and how: by folds for any method, by an identity for splines.

use std::ops::Range;
use std::sync::Arc;

use super::near::Places;
use super::variance::{Kind, Variance};
use crate::sampling::hash;
use crate::{Error, Mask, Planes};

/// Parts into which the samples of a frame are cut.
pub const PARTS: u64 = 10;
/// Held-out pixels that are enough, where more would cost more fills.
const ENOUGH: usize = 5000;

/// How the samples of a frame are cut: one cut for all that learn from held-out samples.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Folds {
    /// Another cut of the same kind.
    pub seed: u64,
}

impl Folds {
    /// The part, below [`PARTS`], of the pixel with this index row by row.
    pub const fn part(self, pixel: usize) -> u64 {
        hash(self.seed, pixel as u64) % PARTS
    }

    /// The mask without these parts.
    pub fn without(self, mask: &Mask, parts: &Range<u64>) -> Mask {
        let width = mask.size().width;
        let kept =
            |row, column| mask.is_measured(row, column) && !parts.contains(&self.part(row * width + column));
        Mask::from_fn(mask.size(), kept)
    }

    /// The measured pixels of these parts, in the order of rows.
    pub fn held_out(self, mask: &Mask, parts: &Range<u64>) -> Vec<u32> {
        let measured = mask.as_slice().iter().enumerate().filter(|(_, flag)| **flag);
        measured
            .map(|(pixel, _)| pixel)
            .filter(|&pixel| parts.contains(&self.part(pixel)))
            .map(|pixel| pixel as u32)
            .collect()
    }
}

/// Measured pixels that were held out, and what was predicted there.
#[derive(Clone, Debug, Default)]
pub struct HeldOut {
    /// Their indices row by row.
    pub at: Vec<u32>,
    /// By channel what was predicted at each.
    pub predicted: Vec<Vec<f32>>,
    /// How uncertain the pattern of the others left each.
    pub variance: Vec<f32>,
}

impl HeldOut {
    /// Holds parts of the samples out of a method's fill. `reconstruct` gets the samples and the mask that is left, and reads no others.
    ///
    /// # Errors
    /// Those of the method.
    pub fn new(
        (samples, mask): (&Planes, &Mask),
        (folds, parts): (Folds, Range<u64>),
        kind: Kind,
        reconstruct: &mut Reconstruct<'_>,
    ) -> Result<Self, Error> {
        let kept = Arc::new(folds.without(mask, &parts));
        let at = folds.held_out(mask, &parts);
        if at.is_empty() || kept.is_empty() {
            return Ok(Self { predicted: vec![Vec::new(); samples.len()], ..Self::default() });
        }
        let filled = reconstruct(samples, &kept)?;
        let places = Places::new(&kept, |_| true);
        let variance = Variance::new(kind, &kept, &places, folds.seed).all(&places, &at);
        Ok(Self { predicted: pick(&filled, &at), at, variance })
    }

    /// Adds what was predicted elsewhere.
    fn extend(&mut self, other: Self) {
        self.at.extend(other.at);
        self.variance.extend(other.variance);
        self.predicted.resize(other.predicted.len(), Vec::new());
        for (own, other) in self.predicted.iter_mut().zip(other.predicted) {
            own.extend(other);
        }
    }

    /// In the order of rows, and only those for which `wanted` holds.
    fn sorted(&self, wanted: impl Fn(u32) -> bool) -> Self {
        let mut order: Vec<usize> = (0..self.at.len()).filter(|&k| wanted(self.at[k])).collect();
        order.sort_unstable_by_key(|&k| self.at[k]);
        let take = |values: &[f32]| order.iter().map(|&k| values[k]).collect();
        Self {
            at: order.iter().map(|&k| self.at[k]).collect(),
            predicted: self.predicted.iter().map(|values| take(values)).collect(),
            variance: take(&self.variance),
        }
    }

    /// The squared error at each, the mean over the channels.
    pub fn squared_errors(&self, truth: &Planes) -> Vec<f32> {
        let mut sums = vec![0.0_f64; self.at.len()];
        for (plane, predicted) in truth.as_slice().iter().zip(&self.predicted) {
            for ((sum, &at), &value) in sums.iter_mut().zip(&self.at).zip(predicted) {
                *sum += (f64::from(plane.pixels()[at as usize]) - f64::from(value)).powi(2);
            }
        }
        sums.into_iter().map(|sum| (sum / truth.len().max(1) as f64) as f32).collect()
    }

    fn map(&mut self, f: &impl Fn(usize, f32) -> f32) {
        for (channel, values) in self.predicted.iter_mut().enumerate() {
            for value in values {
                *value = f(channel, *value);
            }
        }
    }
}

/// The values of pixels, by channel.
pub(super) fn pick(planes: &Planes, at: &[u32]) -> Vec<Vec<f32>> {
    let of = |plane: &crate::Plane| at.iter().map(|&pixel| plane.pixels()[pixel as usize]).collect();
    planes.as_slice().iter().map(of).collect()
}

/// A fill from the samples of a mask.
pub type Reconstruct<'a> = dyn FnMut(&Planes, &Arc<Mask>) -> Result<Planes, Error> + 'a;

/// What held-out samples show of a method on a frame.
#[derive(Clone, Debug)]
pub struct Evidence {
    /// The variance that goes with the method.
    pub kind: Kind,
    /// Few samples held out at a time.
    pub near: HeldOut,
    /// Pixels that were held out at two depths: what each counts for, with few others held out, and with half of them.
    pub pairs: (Vec<f32>, HeldOut, HeldOut),
}

impl Evidence {
    /// Holds out a tenth of the samples, several times where the frame has few, and half of them.
    ///
    /// # Errors
    /// Those of the method.
    pub fn of_folds(
        (samples, mask): (&Planes, &Mask),
        folds: Folds,
        kind: Kind,
        reconstruct: &mut Reconstruct<'_>,
    ) -> Result<Self, Error> {
        let parts = (ENOUGH * PARTS as usize).div_ceil(mask.count().max(1)).clamp(1, PARTS as usize) as u64;
        let (mut near, mut deep) = (HeldOut::default(), HeldOut::default());
        for part in 0..parts {
            near.extend(HeldOut::new((samples, mask), (folds, part..part + 1), kind, reconstruct)?);
        }
        for half in [0..PARTS / 2, PARTS / 2..PARTS] {
            if half.start < parts {
                deep.extend(HeldOut::new((samples, mask), (folds, half), kind, reconstruct)?);
            }
        }
        let both = |pixel: u32| folds.part(pixel as usize) < parts;
        let near = near.sorted(|_| true);
        // Without a sample left for one depth there are no pairs.
        let deep = deep.sorted(both);
        let pairs = if deep.at == near.at {
            (vec![1.0; near.at.len()], near.clone(), deep)
        } else {
            (Vec::new(), HeldOut::default(), HeldOut::default())
        };
        Ok(Self { kind, near, pairs })
    }

    /// Takes predictions from the domain in which they were made to that of the result: `f(channel, value)`.
    pub fn map(&mut self, f: impl Fn(usize, f32) -> f32) {
        self.near.map(&f);
        self.pairs.1.map(&f);
        self.pairs.2.map(&f);
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{Plane, Size};

    #[test]
    fn no_prediction_sees_its_own_sample() {
        let size = Size::new(30, 40);
        let mask = Mask::from_fn(size, |row, column| (row + 2 * column) % 3 == 0);
        let samples = Planes::new(size, vec![Plane::from_fn(size, |y, x| (y * 40 + x) as f32)]).unwrap();
        // A method that shows what it was given: the sample itself, or -1 at missing pixels.
        let mut fill = |samples: &Planes, kept: &Arc<Mask>| {
            let plane = &samples.as_slice()[0];
            Planes::new(
                size,
                vec![Plane::from_fn(size, |y, x| if kept.is_measured(y, x) { plane.at(y, x) } else { -1.0 })],
            )
        };
        let evidence =
            Evidence::of_folds((&samples, &mask), Folds { seed: 3 }, Kind::Distance, &mut fill).unwrap();
        assert_eq!(evidence.near.at.len(), mask.count());
        assert!(evidence.near.at.is_sorted());
        let (_, near, deep) = &evidence.pairs;
        assert_eq!(near.at, deep.at);
        for held in [&evidence.near, near, deep] {
            assert!(held.predicted[0].iter().all(|&value| value == -1.0));
        }
        let farther = near.variance.iter().zip(&deep.variance).filter(|(a, b)| a <= b).count();
        assert!(farther > near.at.len() * 9 / 10);
    }
}
