//! Measured pixels that were predicted without themselves, and how: by folds, which do for any method.

use std::ops::Range;
use std::sync::Arc;

use lacuna_core::parallel::prelude::*;

use super::excerpt::Excerpt;
use super::near::Places;
use super::variance::{Kind, Variance};
use crate::sampling::hash;
use crate::{Error, Mask, Planes};

/// Parts into which the samples of a frame are cut.
pub const PARTS: u64 = 10;
/// Parts that make half of the samples.
pub(super) const DEEP: Range<u64> = 0..PARTS / 2;
/// Held-out pixels that are enough, where more would cost more fills.
const ENOUGH: usize = 5000;

/// Border of a tile, in spacings of its samples, beyond which its neighbours do not matter, though half of the samples are held out.
const FAR: f64 = 6.0;
/// How exact fills without some of the samples are, over the range of these: far below what a fill errs by.
pub const HELD_OUT: f64 = 5e-4;
/// Pixels that one task looks at.
const PIECE: usize = 1 << 14;

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
        Self::of_enough(samples, ENOUGH)
    }

    /// The same where fewer are enough.
    pub(super) fn of_enough(samples: usize, enough: usize) -> impl Iterator<Item = Range<u64>> {
        (0..Self::fills(samples, enough)).map(|part| part..part + 1)
    }

    fn fills(samples: usize, enough: usize) -> u64 {
        (enough * PARTS as usize).div_ceil(samples.max(1)).clamp(1, PARTS as usize) as u64
    }

    /// The parts that are half of the samples, and those of them that are also held out where few others are.
    pub(super) fn deep(self, samples: usize) -> (Self, [Range<u64>; 2]) {
        (self, [DEEP, DEEP.start..Self::fills(samples, ENOUGH).min(DEEP.end)])
    }

    /// The mask without these parts.
    pub fn without(self, mask: &Mask, parts: &Range<u64>) -> Mask {
        let mut kept = mask.as_slice().to_vec();
        kept.par_chunks_mut(PIECE).enumerate().for_each(|(piece, kept)| {
            for (pixel, kept) in (piece * PIECE..).zip(kept).filter(|(_, kept)| **kept) {
                *kept = !parts.contains(&self.part(pixel));
            }
        });
        Mask::of(mask.size(), kept)
    }

    /// The mask with the fewest samples that all of the frame is filled from to learn from it.
    pub fn thinnest(self, mask: &Mask) -> Mask {
        let few = if tiles(mask).is_some() { 0..1 } else { DEEP };
        self.without(mask, &few)
    }

    /// The measured pixels of these parts, in the order of rows.
    pub fn held_out(self, mask: &Mask, parts: &Range<u64>) -> Vec<u32> {
        pixels_where(mask, |measured, pixel| measured && parts.contains(&self.part(pixel)))
    }
}

/// The pixels that `wanted` takes, by whether they were measured and by index, in the order of rows.
pub(super) fn pixels_where(mask: &Mask, wanted: impl Fn(bool, usize) -> bool + Sync) -> Vec<u32> {
    let pieces = mask.as_slice().par_chunks(PIECE).enumerate().map(|(piece, flags)| {
        let pixels = (piece * PIECE..).zip(flags).filter(|(pixel, flag)| wanted(**flag, *pixel));
        pixels.map(|(pixel, _)| pixel as u32).collect::<Vec<u32>>()
    });
    pieces.concat()
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

    /// Holds half of the samples out: of a large frame in tiles that are spread over it, unless `whole` is asked for.
    ///
    /// # Errors
    /// Those of the method.
    pub fn deep(
        (samples, mask): (&Planes, &Mask),
        folds: Folds,
        kind: Kind,
        whole: bool,
        reconstruct: &mut ReconstructPart<'_>,
    ) -> Result<Self, Error> {
        let (folds, [parts, wanted]) = folds.deep(mask.count());
        let Some(tiles) = tiles(mask).filter(|_| !whole) else {
            let mut all = |samples: &Planes, kept: &Arc<Mask>| reconstruct(None, samples, kept);
            return Self::new((samples, mask), (folds, [parts, wanted]), Some(kind), &mut all);
        };
        let all = tiles.mask.as_slice();
        let part = |pixel: usize| folds.part(tiles.source(pixel));
        let flags = (0..).zip(all).map(|(pixel, flag)| *flag && !parts.contains(&part(pixel))).collect();
        let kept = Arc::new(Mask::of(tiles.mask.size(), flags));
        let is_wanted =
            |&pixel: &usize| all[pixel] && wanted.contains(&part(pixel)) && tiles.is_inner(pixel as u32);
        let at: Vec<u32> = (0..all.len()).filter(is_wanted).map(|pixel| pixel as u32).collect();
        let filled = reconstruct(Some(&tiles), &tiles.planes(samples), &kept)?;
        let places = Places::new(&kept, |_| true);
        let variance = Variance::new(kind, &kept, &places, folds.seed).all(&places, &at);
        let predicted = pick(&filled, &at);
        Ok(Self {
            at: at.iter().map(|&pixel| tiles.source(pixel as usize) as u32).collect(),
            predicted,
            variance,
        })
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

    /// How much less the pattern of samples leaves open at missing pixels than at these, held out one fold at a time: the ratio of the
    /// geometric means of variances.
    pub fn emptier(&self, mask: &Mask, folds: Folds, kind: Kind) -> f64 {
        let ln = |variances: &[f32]| -> f64 {
            let finite = variances.iter().map(|v| f64::from(v.ln())).filter(|ln| ln.is_finite());
            let (sum, count) = finite.fold((0.0, 0_usize), |(sum, count), ln| (sum + ln, count + 1));
            sum / count.max(1) as f64
        };
        let places = Places::new(mask, |_| true);
        let missing: Vec<u32> =
            mask.as_slice().iter().enumerate().filter(|(_, flag)| !**flag).map(|(at, _)| at as u32).collect();
        let few: Vec<u32> = missing.iter().copied().step_by(missing.len().div_ceil(ENOUGH).max(1)).collect();
        if few.is_empty() || self.at.is_empty() {
            return 1.0;
        }
        let there = Variance::new(kind, mask, &places, folds.seed).all(&places, &few);
        (ln(&there) - ln(&self.with_variance(mask, folds, kind).variance)).exp()
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

    /// The sum over samples and channels of the products of the errors of two predictions at the same samples.
    pub fn products(&self, other: &Self, truth: &Planes) -> f64 {
        let planes = truth.as_slice().iter().zip(self.predicted.iter().zip(&other.predicted));
        let plane = |(plane, (own, other)): (&crate::Plane, (&Vec<f32>, &Vec<f32>))| -> f64 {
            let error = |at: &u32, value: f32| f64::from(value) - f64::from(plane.pixels()[*at as usize]);
            self.at.iter().zip(own.iter().zip(other)).map(|(at, (a, b))| error(at, *a) * error(at, *b)).sum()
        };
        planes.map(plane).sum()
    }

    pub(super) fn map(&mut self, f: &impl Fn(usize, f32) -> f32) {
        for (channel, values) in self.predicted.iter_mut().enumerate() {
            for value in values {
                *value = f(channel, *value);
            }
        }
    }
}

/// Tiles of a frame that show what half of its samples make of it, if the samples of each are dense enough.
fn tiles(mask: &Mask) -> Option<Excerpt> {
    Excerpt::tiles(mask).filter(|tiles| tiles.border() >= FAR)
}

/// The values of pixels, by channel.
pub(super) fn pick(planes: &Planes, at: &[u32]) -> Vec<Vec<f32>> {
    let of = |plane: &crate::Plane| at.iter().map(|&pixel| plane.pixels()[pixel as usize]).collect();
    planes.as_slice().iter().map(of).collect()
}

/// A fill from the samples of a mask.
pub type Reconstruct<'a> = dyn FnMut(&Planes, &Arc<Mask>) -> Result<Planes, Error> + 'a;

/// The same of an excerpt of the frame, or of all of it.
pub type ReconstructPart<'a> = dyn FnMut(Option<&Excerpt>, &Planes, &Arc<Mask>) -> Result<Planes, Error> + 'a;

/// The squared error (0 if not known) and the logarithm of the variance of a pixel.
#[derive(Clone, Copy, Debug)]
pub struct PixelError {
    pub pixel: u32,
    pub squared: f32,
    pub ln_variance: f32,
    /// What it counts for.
    pub weight: f32,
}
