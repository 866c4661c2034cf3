//! Measured pixels that were predicted without themselves, and how: by folds, which do for any method.

use std::ops::Range;
use std::sync::Arc;

use super::near::Places;
use super::simulation::Simulation;
use super::variance::{Kind, Variance};
use crate::sampling::hash;
use crate::{Error, Mask, Planes};

/// Parts into which the samples of a frame are cut.
pub const PARTS: u64 = 10;
/// Parts that make half of the samples.
const DEEP: Range<u64> = 0..PARTS / 2;
/// Held-out pixels that are enough, where more would cost more fills.
const ENOUGH: usize = 5000;

/// How the samples of a frame are cut: one cut for all that learn from held-out samples.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Folds {
    /// Another cut of the same kind.
    pub seed: u64,
}

impl Folds {
    /// The part, below [`PARTS`], of the pixel with this index row by row.
    pub const fn part(self, pixel: usize) -> u64 {
        hash(self.seed, pixel as u64) % PARTS
    }

    /// The parts to hold out, one range a fill, so that enough of so many samples are seen without themselves.
    pub fn near(self, samples: usize) -> impl Iterator<Item = Range<u64>> {
        (0..Self::fills(samples)).map(|part| part..part + 1)
    }

    fn fills(samples: usize) -> u64 {
        (ENOUGH * PARTS as usize).div_ceil(samples.max(1)).clamp(1, PARTS as usize) as u64
    }

    /// The parts that are half of the samples, and those of them that are also held out where few others are: with the folds, what
    /// [`HeldOut::new`] takes.
    pub fn deep(self, samples: usize) -> (Self, [Range<u64>; 2]) {
        (self, [DEEP, DEEP.start..Self::fills(samples).min(DEEP.end)])
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
#[derive(Clone, Debug, Default, PartialEq)]
pub struct HeldOut {
    /// Their indices row by row.
    pub at: Vec<u32>,
    /// By channel what was predicted at each.
    pub predicted: Vec<Vec<f32>>,
    /// How uncertain the pattern of the others left each.
    pub variance: Vec<f32>,
}

impl HeldOut {
    /// Holds parts of the samples out of a method's fill, and looks at those of them that are `wanted`. `reconstruct` gets the samples and
    /// the mask that is left, and reads no others. Without a kind of variance there is none.
    ///
    /// # Errors
    /// Those of the method.
    pub fn new(
        (samples, mask): (&Planes, &Mask),
        (folds, [parts, wanted]): (Folds, [Range<u64>; 2]),
        kind: Option<Kind>,
        reconstruct: &mut Reconstruct<'_>,
    ) -> Result<Self, Error> {
        let kept = Arc::new(folds.without(mask, &parts));
        let at = folds.held_out(mask, &wanted);
        if at.is_empty() || kept.is_empty() {
            return Ok(Self { predicted: vec![Vec::new(); samples.len()], ..Self::default() });
        }
        let filled = reconstruct(samples, &kept)?;
        let variance = kind.map_or_else(Vec::new, |kind| {
            let places = Places::new(&kept, |_| true);
            Variance::new(kind, &kept, &places, folds.seed).all(&places, &at)
        });
        Ok(Self { predicted: pick(&filled, &at), at, variance })
    }

    /// The same, in the order of rows, with the variances that go with folds that are held out one at a time.
    #[must_use]
    pub fn with_variance(&self, mask: &Mask, folds: Folds, kind: Kind) -> Self {
        let mut own = self.sorted(|_| true);
        own.variance = vec![f32::NAN; own.at.len()];
        for parts in folds.near(mask.count()) {
            let of = |k: &usize| parts.contains(&folds.part(own.at[*k] as usize));
            let which: Vec<usize> = (0..own.at.len()).filter(of).collect();
            let pixels: Vec<u32> = which.iter().map(|&k| own.at[k]).collect();
            let kept = folds.without(mask, &parts);
            let places = Places::new(&kept, |_| true);
            let variance = Variance::new(kind, &kept, &places, folds.seed).all(&places, &pixels);
            which.into_iter().zip(variance).for_each(|(k, v)| own.variance[k] = v);
        }
        own
    }

    /// Adds what was predicted elsewhere.
    pub fn extend(&mut self, other: Self) {
        self.at.extend(other.at);
        self.variance.extend(other.variance);
        self.predicted.resize(other.predicted.len(), Vec::new());
        for (own, other) in self.predicted.iter_mut().zip(other.predicted) {
            own.extend(other);
        }
    }

    /// In the order of rows, and only those for which `wanted` holds.
    #[must_use]
    pub fn sorted(&self, wanted: impl Fn(u32) -> bool) -> Self {
        let mut order: Vec<usize> = (0..self.at.len()).filter(|&k| wanted(self.at[k])).collect();
        order.sort_unstable_by_key(|&k| self.at[k]);
        let take = |values: &[f32]| order.iter().filter_map(|&k| values.get(k).copied()).collect();
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

    pub(super) fn map(&mut self, f: &impl Fn(usize, f32) -> f32) {
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
#[derive(Clone, Debug, PartialEq)]
pub struct Evidence {
    /// The variance that goes with the method.
    pub kind: Kind,
    /// Few samples held out at a time.
    pub near: HeldOut,
    /// Pixels that were held out at two depths: with few others, and with half of them. Empty where there are too few samples.
    pub pairs: [HeldOut; 2],
    /// What both errors are on an image that is known.
    pub simulation: Option<Simulation>,
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
        let mut near = HeldOut::default();
        for parts in folds.near(mask.count()) {
            near.extend(HeldOut::new(
                (samples, mask),
                (folds, [parts.clone(), parts]),
                Some(kind),
                reconstruct,
            )?);
        }
        let deep = HeldOut::new((samples, mask), folds.deep(mask.count()), Some(kind), reconstruct)?;
        Ok(Self::new(kind, folds, &near, &near, &deep))
    }

    /// Of predictions from the folds [`Folds::near`], and of a method of the same kind at both depths.
    pub fn new(kind: Kind, folds: Folds, near: &HeldOut, shallow: &HeldOut, deep: &HeldOut) -> Self {
        let near = near.sorted(|_| true);
        let mut pairs =
            [shallow, deep].map(|held| held.sorted(|pixel| DEEP.contains(&folds.part(pixel as usize))));
        let wanted = pairs[0].at.clone();
        pairs[1] = pairs[1].sorted(|pixel| wanted.binary_search(&pixel).is_ok());
        if pairs[0].at != pairs[1].at {
            pairs = Default::default();
        }
        Self { kind, near, pairs, simulation: None }
    }

    /// Takes predictions from the domain in which they were made to that of the result: `f(channel, value)`.
    pub fn map(&mut self, f: impl Fn(usize, f32) -> f32) {
        self.near.map(&f);
        self.pairs.iter_mut().for_each(|held| held.map(&f));
        self.simulation.iter_mut().for_each(|simulation| simulation.map(&f));
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
        let [near, deep] = &evidence.pairs;
        assert_eq!(near.at, deep.at);
        for held in [&evidence.near, near, deep] {
            assert!(held.predicted[0].iter().all(|&value| value == -1.0));
        }
        let farther = near.variance.iter().zip(&deep.variance).filter(|(a, b)| a <= b).count();
        assert!(farther > near.at.len() * 9 / 10);
    }
}
