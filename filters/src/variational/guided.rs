//! Guided filling: complete, cheap planes (normals, depth, albedo, identifiers) steer the sparse image.
//!
//! Given samples `y` at measured pixels and complete guides `g`, the image is
//!
//! ```text
//! x = S y + t (p - S p)          S: the plain filter, from measured pixels to an image;  t: trust, 0 to 1
//! ```
//!
//! so measured pixels stay exact, and where `t` is 0 the result is the plain filter's. The prediction `p` is, at every pixel
//! by itself, the constant of a weighted first-order regression of the colour on the differences of the guides to
//! that pixel (`kernel/regress.rs` has the formula). Samples count by their distance, within the radius that holds about
//! `SAMPLES` of them (`reach`), and by the difference of their guides; across a border between labels next to nothing.
//!
//! What each guide counts for is chosen for the image by leaving single measured pixels out (`tune`). The trust is chosen
//! for each neighbourhood by leaving every `HOLD_OUT`th measured pixel out, and filling these both ways (`trust`), with what `tune` chose and
//! with what it began with, which stays where it is clearly better; where
//! guides gain less than a few percent of the squared error in all, the result is `S y` bit for bit. So it is where no guide
//! varies.
//!
//! Boundary: none; pixels at the border see fewer samples, further away.
//!
//! References: B. Bitterli, F. Rousselle, B. Moon, J. Iglesias-Guitian, D. Adler, K. Mitchell, W. Jarosz, J. Novak,
//! "Nonlinearly Weighted First-order Regression for Denoising Monte Carlo Renderings", Computer Graphics Forum 35(4),
//! 2016 (regression on auxiliary features with joint weights; theirs compare patches of complete images); W. Cleveland,
//! "Robust Locally Weighted Regression and Smoothing Scatterplots", JASA 74, 1979.
//!
//! Cost: linear in pixels. The plain filter once, three or four times more at the errors `TRIAL` and `FINAL` (samples and
//! residual, by one or two choices, to find the trust; the residual), and a regression over about 50 samples for each pixel. Memory beyond samples, guides and result: 6 planes a channel, one plane a guide, and the
//! measured pixels once more.
//!
//! Fails where no guide sees what the light does: mirrors show other surfaces than the one that they are; shadows and
//! caustics have edges that no guide has. There it is the plain filter.

use std::sync::Arc;

use lacuna_core::parallel::{join, prelude::*};

use crate::baseline::push_pull;
use crate::kernel::Isa;
use crate::kernel::regress::Scales;
use crate::variational::ss;
use crate::{Error, Filter, Mask, Outcome, Plan, Plane, Planes, Problem, Run};

mod beside;
mod fit;
mod guides;
mod nodes;
mod probe;
mod reach;
#[cfg(test)]
mod tests;
mod trust;
mod tune;
mod tuned;

pub(crate) use beside::{Beside, Regression};
pub(crate) use fit::{Field, Store, Task};
pub use guides::Guides;
pub(crate) use guides::SPREAD;
pub(crate) use nodes::predict_between;
pub(crate) use reach::Reach;
pub(crate) use trust::{Trust, WORTH};
pub(crate) use tune::Weights;
pub(crate) use tuned::Tuned;

/// Samples that a regression sees, about.
const SAMPLES: f64 = 36.0;
/// Every so manieth measured pixel is left out to find the trust.
const HOLD_OUT: usize = 5;
/// Pixels of the side of a block that stays seen.
const BLOCK: usize = 8;
/// What a choice of scales must leave of another's squared error to be taken for better; less is chance.
const CLEAR: f64 = 0.95;
/// Error of the splines that is allowed where both ways are compared, over the range of what they fill.
const TRIAL: f64 = 1e-2;
/// The same for what the fit leaves, in the result.
const FINAL: f64 = 1e-3;
/// Pixels that one task of a loop over planes takes.
const PART: usize = 1 << 16;
/// Fewer measured pixels of a frame say nothing about guides.
pub(crate) const FEWEST: usize = 256;
/// And of half of a frame's, which are held out to learn how wrong a guided fill is: what guides the fill guides these fills, too.
const FEWEST_OF_HALF: usize = FEWEST / 2;

/// What guides did.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Effect {
    /// The guides that count for something.
    pub guides: Vec<String>,
    /// The part of the squared error that they take away, by the left-out pixels; nothing if they are not used.
    pub gain: Option<f64>,
}

/// Steers `out`, which holds what the plain filter makes of the samples. `plan` is that of `filter` on `mask`.
///
/// # Errors
/// Those of the plan, and [`Error::SizeMismatch`].
pub fn steer(
    (filter, plan): (&dyn Filter, &dyn Plan),
    mask: &Arc<Mask>,
    samples: &Planes,
    guides: &Guides,
    out: &mut Planes,
    run: &Run<'_>,
) -> Result<(Outcome, Effect), Error> {
    if guides.size() != mask.size() {
        return Err(Error::size(mask.size(), "guides", guides.size()));
    }
    let pointless =
        guides.is_empty() || mask.is_full() || mask.count() < FEWEST_OF_HALF || samples.is_empty();
    if pointless || run.interrupted().is_some() {
        return Ok((Outcome::direct(), Effect::default()));
    }
    let field = Field { planes: guides.planes(), more: &[], labels: guides.labels() };
    let model = Model { mask, samples, weights: None, field, isa: Isa::best() };
    let seen = model.seen();
    let Some((scales, trust, gain)) = model.judge(filter, &seen, guides, run)? else {
        return Ok((Outcome::direct(), Effect::default()));
    };
    let everywhere = Mask::from_fn(mask.size(), |_, _| true);
    let part = Part { mask, plan, seen: &seen, scales: &scales };
    let (guided, outcome) = model.fill(part, &everywhere, FINAL, run)?;
    blend(mask, guides, &trust, &guided, out);
    let guides = guides.counting(&scales);
    Ok((outcome, Effect { guides, gain: Some(gain) }))
}

struct Model<'a> {
    mask: &'a Arc<Mask>,
    samples: &'a Planes,
    /// What each sample weighs.
    weights: Option<&'a Plane>,
    field: Field<'a>,
    isa: Isa,
}

/// The measured pixels of a mask, ready for regressions.
struct Seen {
    store: Store,
    reach: Reach,
}

impl Seen {
    fn new(mask: &Mask, (samples, weights): (&Planes, Option<&Plane>), field: Field<'_>) -> Self {
        let store = || Store::new(mask, samples, field).weighted(weights);
        let (store, reach) = join(store, || Reach::new(mask, SAMPLES));
        Self { store, reach }
    }
}

/// What a fill starts from: all measured pixels, or those that were kept.
#[derive(Clone, Copy)]
struct Part<'a> {
    mask: &'a Mask,
    plan: &'a dyn Plan,
    seen: &'a Seen,
    scales: &'a Scales,
}

impl Model<'_> {
    fn seen(&self) -> Seen {
        Seen::new(self.mask, (self.samples, self.weights), self.field)
    }

    /// What guides count for, where they are trusted, and what they gain; nothing if that is not worth it.
    fn judge(
        &self,
        filter: &dyn Filter,
        seen: &Seen,
        guides: &Guides,
        run: &Run<'_>,
    ) -> Result<Option<(Scales, Plane, f64)>, Error> {
        let size = self.mask.size();
        let weights = tune::Weights::new(self.mask, self.samples);
        let Some(tuned) = self.tune(seen, weights, guides) else { return Ok(None) };
        let (kept, left_out) = hold_out(self.mask);
        let kept = Arc::new(kept);
        let plan = || filter.plan(&Problem::fill(Arc::clone(&kept)), run);
        let (plan, seen) = join(plan, || Seen::new(&kept, (self.samples, self.weights), self.field));
        let plan = plan?;
        let mut plain = Planes::zeros(size, self.samples.len());
        plan.reconstruct_roughly(self.samples, TRIAL, &mut plain, run)?;
        // Regressions are tuned by themselves, and samples that are alone with what they show can mislead them; the fill decides.
        let first = tune::Trial::first(self.field.count());
        let mut best: Option<(Scales, Trust, f64)> = None;
        for scales in [Some(tuned.clone()), (first != tuned).then_some(first)].into_iter().flatten() {
            let part = Part { mask: &kept, plan: plan.as_ref(), seen: &seen, scales: &scales };
            let (guided, ..) = self.fill(part, self.mask, TRIAL, run)?;
            if run.interrupted().is_some() {
                return Ok(None);
            }
            let trust = Trust::new(&left_out, (self.samples, weights), &plain, &guided);
            let gain = trust.worth();
            if best.as_ref().is_none_or(|best| 1.0 - gain < CLEAR * (1.0 - best.2)) {
                best = Some((scales, trust, gain));
            }
        }
        let best = best.filter(|(.., gain)| *gain >= WORTH);
        Ok(best.map(|(scales, trust, gain)| (scales, trust.plane(size), gain)))
    }

    /// What guides count for; nothing if none does.
    fn tune(&self, seen: &Seen, weights: tune::Weights, guides: &Guides) -> Option<Scales> {
        let trial = tune::Trial {
            store: &seen.store,
            mask: self.mask,
            values: self.samples,
            weights,
            field: self.field,
            reach: &seen.reach,
            isa: self.isa,
        };
        let scales = trial.choose(guides.groups());
        (scales.slopes.contains(&true) || self.field.labels.is_some()).then_some(scales)
    }

    /// The image from the samples that are seen, with splines through what the regression leaves of them; where these are held out of a mask, roughly
    /// and at its pixels. Where no sample is near enough for a regression, push-pull fills.
    fn image(
        &self,
        seen: &Seen,
        scales: &Scales,
        held_out_of: Option<&Mask>,
        run: &Run<'_>,
    ) -> Result<(Planes, Outcome), Error> {
        let plan = ss::Settings::default().plan(&Problem::fill(Arc::clone(self.mask)), run)?;
        let part = Part { mask: self.mask, plan: plan.as_ref(), seen, scales };
        let all = Mask::from_fn(self.mask.size(), |_, _| true);
        let (wanted, error) = held_out_of.map_or((&all, FINAL), |measured| (measured, TRIAL));
        let (mut image, outcome) = self.fill(part, wanted, error, run)?;
        push_pull::complete(&mut image, (self.mask, wanted), self.samples, run)?;
        Ok((image, outcome))
    }

    /// The guided image at the pixels that are wanted, from the samples of a part.
    fn fill(
        &self,
        Part { mask, plan, seen, scales }: Part<'_>,
        wanted: &Mask,
        error: f64,
        run: &Run<'_>,
    ) -> Result<(Planes, Outcome), Error> {
        let size = mask.size();
        let task = Task { field: self.field, scales, reach: &seen.reach, leave_out: false, isa: self.isa };
        let mut predicted = Planes::zeros(size, self.samples.len());
        fit::predict(&seen.store, task, wanted, &mut predicted);
        let mut residual = Planes::zeros(size, self.samples.len());
        // Where nothing is near, or the difference is beyond all numbers, nothing is left of a sample.
        merge(&mut residual, self.samples, &predicted, |sample, predicted| {
            let left = sample - predicted;
            if left.is_finite() { left } else { 0.0 }
        });
        let mut filled = Planes::zeros(size, self.samples.len());
        let outcome = plan.reconstruct_roughly(&residual, error, &mut filled, run)?;
        let mut guided = residual;
        merge(&mut guided, &filled, &predicted, |filled, predicted| filled + predicted);
        Ok((guided, outcome))
    }
}

/// Sets each pixel to a function of those of two other groups of planes.
fn merge(to: &mut Planes, a: &Planes, b: &Planes, value: impl Fn(f32, f32) -> f32 + Sync) {
    for ((to, a), b) in to.as_mut_slice().iter_mut().zip(a.as_slice()).zip(b.as_slice()) {
        let parts = a.pixels().par_chunks(PART).zip(b.pixels().par_chunks(PART));
        to.pixels_mut().par_chunks_mut(PART).zip(parts).for_each(|(to, (a, b))| {
            to.iter_mut().zip(a.iter().zip(b)).for_each(|(to, (&a, &b))| *to = value(a, b));
        });
    }
}

/// The mask without about every [`HOLD_OUT`]th measured pixel, and these. They are scattered, and no block of
/// [`BLOCK`] x [`BLOCK`] pixels loses its last one: the plain filter would have to fill a hole that is not there.
fn hold_out(mask: &Mask) -> (Mask, Vec<(usize, usize)>) {
    let size = mask.size();
    let mut flags = mask.as_slice().to_vec();
    let mut left_out = Vec::new();
    let mut block = Vec::with_capacity(BLOCK * BLOCK);
    for top in (0..size.height).step_by(BLOCK) {
        for left in (0..size.width).step_by(BLOCK) {
            block.clear();
            for row in top..(top + BLOCK).min(size.height) {
                let columns = left..(left + BLOCK).min(size.width);
                block.extend(
                    columns.filter(|&column| mask.is_measured(row, column)).map(|column| (row, column)),
                );
            }
            let key = (((top as u64) << 32) | left as u64).wrapping_add(1);
            let mixed = (key ^ (key >> 29)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
            let mixed = ((mixed ^ (mixed >> 32)).wrapping_mul(0x94d0_49bb_1331_11eb) >> 32) as usize;
            let count = ((block.len() + mixed % HOLD_OUT) / HOLD_OUT).min(block.len().saturating_sub(1));
            for part in 0..count {
                let (row, column) = block[(mixed / HOLD_OUT + part * block.len() / count) % block.len()];
                left_out.push((row, column));
                flags[row * size.width + column] = false;
            }
        }
    }
    (Mask::from_fn(size, |row, column| flags[row * size.width + column]), left_out)
}

/// Mixes the guided image into the missing pixels of the plain one.
fn blend(mask: &Mask, guides: &Guides, trust: &Plane, guided: &Planes, out: &mut Planes) {
    let known = |index: usize| guides.labels().is_none_or(|labels| labels[index] != guides::UNKNOWN);
    for (out, guided) in out.as_mut_slice().iter_mut().zip(guided.as_slice()) {
        let parts = out.pixels_mut().par_chunks_mut(PART).zip(guided.pixels().par_chunks(PART)).enumerate();
        parts.for_each(|(part, (out, guided))| {
            for (index, (out, &guided)) in (part * PART..).zip(out.iter_mut().zip(guided)) {
                let trust = trust.pixels()[index];
                let share = trust * (guided - *out);
                if trust > 0.0 && share.is_finite() && !mask.as_slice()[index] && known(index) {
                    *out += share;
                }
            }
        });
    }
}
