//! Measured pixels that were predicted without themselves, and how: by folds, which do for any method.

use std::ops::Range;
use std::sync::Arc;

use lacuna_core::parallel::prelude::*;

use super::near::Places;
use super::variance::Variance;
use crate::descriptor::Kind;
use crate::excerpt::Excerpt;
use crate::solver::holes::{self, Division};
use crate::{Error, Mask, Plane, Planes};
use lacuna_core::hash;

/// Parts into which the samples of a frame are cut.
pub const PARTS: u64 = 10;
/// Parts that make half of the samples.
pub(super) const DEEP: Range<u64> = 0..PARTS / 2;
/// Held-out pixels that are enough, where more would cost more fills.
const ENOUGH: usize = 5000;

/// How exact fills without some of the samples are, over the range of these: far below what a fill errs by.
pub const HELD_OUT: f64 = 5e-4;
/// The same where multigrid takes the whole image, which then errs by far less than its bound says: at 4e-3 figures of five renders (30 to 72 dB, pixels
/// chosen in rounds) moved by 0.23 dB at most.
const HELD_OUT_WHOLE: f64 = 4e-3;
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
    pub(super) fn deep(samples: usize) -> [Range<u64>; 2] {
        [DEEP, DEEP.start..Self::fills(samples, ENOUGH).min(DEEP.end)]
    }

    /// Parts of a mask's samples, and those of them that are looked at.
    pub fn fold(self, mask: &Mask, [parts, wanted]: [Range<u64>; 2]) -> Fold {
        let kept = Arc::new(self.without(mask, &parts));
        Fold { kept, at: self.held_out(mask, &wanted), seed: self.seed }
    }

    /// The same of tiles of a frame, by its pixels, which are told as those of the excerpt. Those that the neighbours of their tiles reach are not looked at.
    pub fn fold_of_tiles(self, tiles: &Excerpt, [parts, wanted]: [Range<u64>; 2]) -> Fold {
        let mut flags = tiles.mask.as_slice().to_vec();
        let mut at = Vec::new();
        for pixel in (0..flags.len()).filter(|&pixel| tiles.mask.as_slice()[pixel]) {
            let part = self.part(tiles.source(pixel));
            flags[pixel] = !parts.contains(&part);
            if wanted.contains(&part) && tiles.is_inner(pixel as u32) {
                at.push(pixel as u32);
            }
        }
        Fold { kept: Arc::new(Mask::of(tiles.mask.size(), flags)), at, seed: self.seed }
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

    /// How much less a mask leaves open at missing pixels than folds of it did at held-out ones, where `variances` are: the ratio of geometric
    /// means.
    pub fn emptier(self, mask: &Mask, variances: &[f32], kind: Kind) -> f64 {
        let ln = |variances: &[f32]| -> f64 {
            let finite = variances.iter().map(|v| f64::from(v.ln())).filter(|ln| ln.is_finite());
            let (sum, count) = finite.fold((0.0, 0_usize), |(sum, count), ln| (sum + ln, count + 1));
            sum / count.max(1) as f64
        };
        let missing = mask.size().pixels() - mask.count();
        let pixels = (0..).zip(mask.as_slice()).filter(|(_, flag)| !**flag).map(|(at, _)| at);
        let few: Vec<u32> = pixels.step_by(missing.div_ceil(ENOUGH).max(1)).collect();
        if few.is_empty() || variances.is_empty() {
            return 1.0;
        }
        let there = Fold { kept: Arc::new(mask.clone()), at: few, seed: self.seed }.variances(kind);
        (ln(&there) - ln(variances)).exp()
    }

    /// The masks that all of the frame is filled from to learn from it.
    pub fn kept(self, mask: &Mask) -> impl Iterator<Item = Mask> {
        let deep = Excerpt::apart(mask).is_none().then_some(DEEP);
        self.near(mask.count()).chain(deep).map(move |parts| self.without(mask, &parts))
    }

    /// The measured pixels of these parts, in the order of rows.
    pub fn held_out(self, mask: &Mask, parts: &Range<u64>) -> Vec<u32> {
        pixels_where(mask, |measured, pixel| measured && parts.contains(&self.part(pixel)))
    }
}

/// Samples that are held out together.
#[derive(Clone, Debug)]
pub struct Fold {
    /// The mask without them.
    pub kept: Arc<Mask>,
    /// Those that are looked at, in the order of rows.
    pub at: Vec<u32>,
    seed: u64,
}

impl Fold {
    /// How uncertain the mask leaves those that are looked at.
    pub fn variances(&self, kind: Kind) -> Vec<f32> {
        let places = Places::new(&self.kept, |_| true);
        Variance::new(kind, &self.kept, &places, self.seed).all(&places, &self.at)
    }
}

/// How exact fills without some samples of this mask are.
pub fn exactness(mask: &Mask) -> f64 {
    if matches!(holes::divide(mask), Division::Sparse) { HELD_OUT_WHOLE } else { HELD_OUT }
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
    /// What a method makes of the samples that a fold holds out. `reconstruct` gets the samples and the mask that is left, and reads no others.
    /// Without a kind of variance there is none.
    ///
    /// # Errors
    /// Those of the method.
    pub fn new(
        samples: &Planes,
        fold: &Fold,
        kind: Option<Kind>,
        reconstruct: &mut Reconstruct<'_>,
    ) -> Result<Self, Error> {
        if fold.at.is_empty() || fold.kept.is_empty() {
            return Ok(Self { predicted: vec![Vec::new(); samples.len()], ..Self::default() });
        }
        let filled = reconstruct(samples, &fold.kept)?;
        let variance = kind.map_or_else(Vec::new, |kind| fold.variances(kind));
        Ok(Self { predicted: pick(&filled, &fold.at), variance, at: fold.at.clone() })
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
        let Some(tiles) = Excerpt::apart(mask).filter(|_| !whole) else {
            let mut all = |samples: &Planes, kept: &Arc<Mask>| reconstruct(None, samples, kept);
            return Self::new(samples, &folds.fold(mask, Folds::deep(mask.count())), Some(kind), &mut all);
        };
        let mut part = |samples: &Planes, kept: &Arc<Mask>| reconstruct(Some(&tiles), samples, kept);
        let fold = folds.fold_of_tiles(&tiles, Folds::deep(tiles.mask.count()));
        Ok(Self::new(&tiles.planes(samples), &fold, Some(kind), &mut part)?.of_frame(&tiles))
    }

    /// What was held out of an excerpt, as of the frame.
    #[must_use]
    pub fn of_frame(mut self, excerpt: &Excerpt) -> Self {
        self.at.iter_mut().for_each(|pixel| *pixel = excerpt.source(*pixel as usize) as u32);
        self
    }

    /// The same, in the order of rows, with the variances that go with folds that are held out one at a time.
    #[must_use]
    pub fn with_variance(&self, mask: &Mask, folds: Folds, kind: Kind) -> Self {
        let mut own = self.sorted(|_| true);
        own.variance = vec![f32::NAN; own.at.len()];
        for part in 0..PARTS {
            let of = |k: &usize| folds.part(own.at[*k] as usize) == part;
            let which: Vec<usize> = (0..own.at.len()).filter(of).collect();
            if which.is_empty() {
                continue;
            }
            let pixels: Vec<u32> = which.iter().map(|&k| own.at[k]).collect();
            let kept = Arc::new(folds.without(mask, &(part..part + 1)));
            let variance = Fold { kept, at: pixels, seed: folds.seed }.variances(kind);
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

    /// The error at each, channel by channel: what the truth is more.
    pub fn errors(&self, truth: &Planes) -> Vec<Vec<f32>> {
        let of = |(plane, predicted): (&Plane, &Vec<f32>)| {
            self.at.iter().zip(predicted).map(|(&at, value)| plane.pixels()[at as usize] - value).collect()
        };
        truth.as_slice().iter().zip(&self.predicted).map(of).collect()
    }

    /// The squared error at each, the mean over the channels.
    pub fn squared_errors(&self, truth: &Planes) -> Vec<f64> {
        let mut sums = vec![0.0_f64; self.at.len()];
        for (plane, predicted) in truth.as_slice().iter().zip(&self.predicted) {
            for ((sum, &at), &value) in sums.iter_mut().zip(&self.at).zip(predicted) {
                *sum += (f64::from(plane.pixels()[at as usize]) - f64::from(value)).powi(2);
            }
        }
        let planes = truth.len().max(1) as f64;
        sums.into_iter().map(|sum| sum / planes).collect()
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
    pub squared: f64,
    pub ln_variance: f32,
    /// What it counts for.
    pub weight: f32,
}
