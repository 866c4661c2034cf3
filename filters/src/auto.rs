//! The filter that held-out samples choose, place by place: edge-enhancing splines, corrected by a network or not, plain splines, total variation,
//! and guides where there are any.
//!
//! Given samples `y` at the measured pixels of an `H x W` image and candidates `F_k`, the image is
//!
//! ```text
//! x(p) = sum over k of w_k(p) F_k(y)(p),      w_k >= 0,  sum of w_k = 1
//! w(p) = argmin  w' (A(p) + s tr A(p) B / tr B) w,      A_kl(p) = sum over held-out samples i of g(p - i) e_k(i) e_l(i)
//! ```
//!
//! with `e_k(i)` the error of `F_k` at a sample that it did not see, `g` a Gaussian of four spacings of held-out samples, `B` the sum
//! over all of the image and `s` = 1/2: where little was held out around a pixel, or nothing differs, the image decides. Errors of all
//! channels count alike; the weights are theirs together. Light of long range, which is filled by its logarithm, is compared as displays
//! show it ([`crate::domain::Map::shown`]). Missing pixels stand nearer to samples than held-out ones did: `A_kl` is less there by
//! `(1 - l) A_0k A_0l / A_00`, what all have of the first one's error, with `l` the root of the ratio of kriging variances.
//! Where samples lie unevenly, each counts for the root of the number of missing pixels that it is the nearest of.
//!
//! A candidate that takes less than `WORTH` of the squared error away stays out, and is not computed for all of the image. Where few samples are
//! held out, weights may fit these alone: a blend that is worse than the best candidate, at samples that have not taught it, gives way to that one. Large images
//! first try the candidates on tiles that are spread over them (`trial`). Guides that take half of the squared error of `ss` away, by their own
//! left-out samples, leave `cnn` alone beside them.
//!
//! Algorithm: samples are held out in folds ([`crate::estimate::Folds`]), which also say how wrong the result is, each part of them by weights
//! that the others teach. `A` is summed in cells of half the Gaussian's width; in each the small quadratic problem is solved by active sets
//! (`weights`). Between cells weights are interpolated linearly. Measured pixels keep their bits.
//!
//! Samples of other frames ([`crate::temporal`]), where there are any, pull the blend towards them, as firmly at each place as what was held out
//! says; where brightness changes, levelled ones as well (`along`).
//!
//! Boundary: that of the candidates. No settings. The same bits for any number of threads.
//!
//! Cost: two fills of each candidate that counts; in large images one, if one counts alone and samples lie evenly (`alone`). Memory: three planes a channel beside the candidate that takes most.
//!
//! Fails: images in which a few pixels that no sample shows carry all of the error; the blend is then that of the rest.
//!
//! Sources: L. Breiman, "Stacked regressions", Machine Learning 24, 1996 (non-negative combinations by held-out errors); M. Stone,
//! "Cross-Validatory Choice and Assessment of Statistical Predictions", Journal of the Royal Statistical Society B 36, 1974.

mod alone;
mod along;
mod standing;
mod trial;
mod variates;
mod ways;

#[cfg(test)]
mod tests;

use std::any::Any;
use std::sync::{Arc, OnceLock};

use crate::decided::Decided;
use crate::descriptor::Kind;
use crate::descriptor::{Configured, Descriptor, Memory, Takes};
use crate::domain::Map;
use crate::estimate::{Evidence, Fold, Folds, HELD_OUT, HeldOut, Rounds, Voronoi};
use crate::excerpt::Excerpt;
use crate::network;
use crate::temporal::Carried;
use crate::variational::guided::{self, Effect, Guides};
use crate::variational::{edge, ss, tv};
use crate::weights::{Truth, Weights};
use crate::{Error, Filter, Mask, Outcome, Plan, Planes, Problem, Run, Stop};
use trial::Stage;

/// What guides must take away of the squared error of splines to have nothing but `cnn` beside them: more than the other candidates take away
/// anywhere.
const ENOUGH: f64 = 0.5;
/// So many held-out samples show whether a candidate counts at all; where one fold has them, the others need not be computed.
const DECIDE: usize = 1000;
/// What the squared error of one candidate must be less than a blend's, over it, to stand alone in its place: less is chance.
const BETTER: f64 = 0.02;
/// Fewer measured pixels choose nothing.
const FEWEST: usize = 64;

/// The power of the variance by which errors of candidates are taken to fall from held-out samples to missing pixels: that of edges, less than that of
/// shading.
const LESS: f64 = 0.5;

/// No settings.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Settings;

/// What is to be known of it.
pub static DESCRIPTOR: Descriptor = Descriptor {
    name: "auto",
    help: "A blend, place by place, as held-out samples choose: cnn, edge, ss, tv and, where there are guides, guided filling",
    settings: &[],
    even: Memory { image: 12, channel: 19 },
    uneven: Memory { image: 122, channel: 10 },
    takes: Takes { guides: true, ..Takes::NOTHING },
    restores: false,
    held_out: Some(Kind::Spline),
    new: || Box::new(Settings),
};

impl Configured for Settings {
    fn descriptor(&self) -> &'static Descriptor {
        &DESCRIPTOR
    }

    fn boxed(&self) -> Box<dyn Configured> {
        Box::new(*self)
    }
}

/// What is chosen from; guides come besides. The first is what the others are held against where nothing is known. They are computed from the last
/// to the first, each after what it starts from.
fn candidates() -> [(&'static Descriptor, Box<dyn Filter>); 4] {
    [
        (&network::DESCRIPTOR, Box::new(network::Settings)),
        (&edge::DESCRIPTOR, Box::new(edge::Settings::default())),
        (&ss::DESCRIPTOR, Box::new(ss::Settings::default())),
        (&tv::DESCRIPTOR, Box::new(tv::Settings::default())),
    ]
}

/// What a cell holds, made if nothing has been. Threads that miss it at the same time all make it: one that waited inside a thread pool could wait for itself.
fn once<T>(cell: &OnceLock<T>, make: impl FnOnce() -> T) -> &T {
    if let Some(found) = cell.get() {
        return found;
    }
    let made = make();
    cell.get_or_init(|| made)
}

/// How much less splines err at missing pixels than at these, which were held out, squared, if errors go by that power of the variance.
fn less(held: &HeldOut, mask: &Mask, folds: Folds, power: f64) -> f64 {
    less_by(&held.with_variance(mask, folds, Kind::Spline).variance, mask, folds, power)
}

/// The same where these are the variances of held-out samples.
fn less_by(variances: &[f32], mask: &Mask, folds: Folds, power: f64) -> f64 {
    folds.emptier(mask, variances, Kind::Spline).min(1.0).powf(power)
}

impl Filter for Settings {
    fn plan(&self, problem: &Problem, run: &Run<'_>) -> Result<Box<dyn Plan>, Error> {
        let mask = Arc::clone(&problem.mask);
        mask.require_samples()?;
        let plain = ss::Settings::default().plan(&Problem::fill(Arc::clone(&mask)), run)?;
        let (stage, first_fold) = (OnceLock::new(), OnceLock::new());
        Ok(Box::new(Blend { mask, plain, folds: Folds::default(), stage, first_fold }))
    }
}

/// Candidates on a mask.
pub struct Blend {
    mask: Arc<Mask>,
    /// Smoothness splines, which are the result where there is nothing to choose by.
    plain: Box<dyn Plan>,
    folds: Folds,
    /// Where candidates are tried, of a large mask.
    stage: OnceLock<Option<Stage>>,
    /// See [`Blend::first_fold`].
    first_fold: OnceLock<HeldOut>,
}

impl Plan for Blend {
    fn reconstruct(&self, samples: &Planes, out: &mut Planes, run: &Run<'_>) -> Result<Outcome, Error> {
        Ok(self.choose((samples, Map::Linear), (None, &[]), None, out, run)?.0)
    }

    fn reconstruct_roughly(
        &self,
        samples: &Planes,
        error: f64,
        out: &mut Planes,
        run: &Run<'_>,
    ) -> Result<Outcome, Error> {
        self.plain.reconstruct_roughly(samples, error, out, run)
    }

    fn as_any(&self) -> Option<&dyn Any> {
        Some(self)
    }
}

/// One way to fill, on any mask.
struct Candidate<'a> {
    name: &'static str,
    /// The variance that goes with it.
    kind: Kind,
    filter: Box<dyn Filter>,
    guides: Option<&'a Guides>,
    /// Its image, where that is known already.
    done: Option<(Planes, Outcome, Effect)>,
}

/// An image of the samples that another candidate may start from, and whose it is.
type Start = Option<(&'static str, Planes)>;

/// How a candidate fills.
#[derive(Clone, Copy)]
struct How<'a> {
    /// The error that will do, over the range of the samples; none for a result.
    error: Option<f64>,
    /// What it may start from, of the same samples.
    start: Option<&'a (&'static str, Planes)>,
}

impl<'a> How<'a> {
    /// As a result.
    const EXACTLY: Self = Self { error: None, start: None };
    /// As exactly as what is compared at held-out samples asks for.
    const ROUGHLY: Self = Self { error: Some(HELD_OUT), start: None };

    fn after(self, start: &'a Start) -> Self {
        Self { start: start.as_ref(), ..self }
    }
}

impl Candidate<'_> {
    fn of((descriptor, filter): (&'static Descriptor, Box<dyn Filter>)) -> Self {
        let kind = descriptor.held_out.unwrap_or(Kind::Spline);
        Self { name: descriptor.name, kind, filter, guides: None, done: None }
    }

    fn fill(
        &self,
        (samples, mask): (&Planes, &Arc<Mask>),
        how: How<'_>,
        out: &mut Planes,
        run: &Run<'_>,
    ) -> Result<(Outcome, Effect), Error> {
        self.fill_guided(self.guides, (samples, mask), how, out, run)
    }

    /// The same with other guides.
    fn fill_guided(
        &self,
        guides: Option<&Guides>,
        (samples, mask): (&Planes, &Arc<Mask>),
        how: How<'_>,
        out: &mut Planes,
        run: &Run<'_>,
    ) -> Result<(Outcome, Effect), Error> {
        let plan = self.filter.plan(&Problem::fill(Arc::clone(mask)), run)?;
        let plan = plan.as_ref();
        let start = how.start.filter(|(name, _)| self.filter.start() == Some(name));
        let outcome = match (start, how.error) {
            (Some((_, image)), error) => {
                out.clone_from(image);
                plan.reconstruct_from_start(samples, error, out, run)?
            }
            (None, Some(error)) => plan.reconstruct_roughly(samples, error, out, run)?,
            (None, None) => plan.reconstruct(samples, out, run)?,
        };
        let Some(guides) = guides else { return Ok((outcome, Effect::default())) };
        let (second, effect) = guided::steer((self.filter.as_ref(), plan), mask, samples, guides, out, run)?;
        Ok((outcome.worst(second), effect))
    }

    /// Leaves its image to those that start from it.
    fn lead(&self, image: &Planes, start: &mut Start) {
        if candidates().iter().any(|(_, filter)| filter.start() == Some(self.name)) {
            *start = Some((self.name, image.clone()));
        }
    }

    /// What it predicts at the samples of a fold; `start` is of the same fold.
    fn held_out(
        &self,
        samples: &Planes,
        fold: &Fold,
        start: &mut Start,
        run: &Run<'_>,
    ) -> Result<HeldOut, Error> {
        let mut fill = |samples: &Planes, kept: &Arc<Mask>| {
            let mut out = Planes::zeros(samples.size(), samples.len());
            self.fill((samples, kept), How::ROUGHLY.after(start), &mut out, run)?;
            self.lead(&out, start);
            Ok(out)
        };
        HeldOut::new(samples, fold, None, &mut fill)
    }
}

impl Blend {
    /// The plan as a blend, if it is one.
    pub(crate) fn of(plan: &dyn Plan) -> Option<&Self> {
        plan.as_any()?.downcast_ref()
    }

    /// Fills `out` from samples in the domain of a map; also says what was chosen and, if asked for, what held-out samples show of the result.
    pub(crate) fn choose(
        &self,
        (samples, map): (&Planes, Map),
        (guides, carried): (Option<&Guides>, &[Carried]),
        learn: Option<Rounds<'_>>,
        out: &mut Planes,
        run: &Run<'_>,
    ) -> Result<(Outcome, Decided), Error> {
        crate::check::group(&self.mask, samples, out)?;
        if self.mask.count() < FEWEST || samples.is_empty() || self.mask.is_full() {
            return Ok((self.plain.reconstruct(samples, out, run)?, Decided::alone(ss::DESCRIPTOR.name)));
        }
        let (guided, guides) = self.guided(samples, guides, run)?;
        // What other frames know is learned from all of the image.
        let tiles_do = learn.is_some() && carried.iter().all(Carried::is_empty);
        let (mut all, on_tiles) = self.worth_trying(guided, (samples, map), tiles_do, run)?;
        if let (Some(held), [only], Some(rounds)) = (on_tiles, &all[..], learn)
            && let Some(done) = self.alone((only, held), samples, rounds, out, run)?
        {
            return Ok(done);
        }
        let mut held = Vec::new();
        let voronoi = (all.len() > 1).then(|| Voronoi::new(&self.mask));
        if all.len() > 1 || learn.is_some() {
            held = self.held_out((&mut all, voronoi.as_ref()), (samples, map), run)?;
        }
        if run.interrupted().is_some() {
            return Ok((self.in_haste(samples, out, run)?, Decided::alone(ss::DESCRIPTOR.name)));
        }
        let less = if all.len() > 1 { less(&held[0], &self.mask, self.folds, LESS) } else { 1.0 };
        let truth = Truth { mask: &self.mask, voronoi: voronoi.as_ref(), samples, map, less };
        let (weights, mut near) = blend_or_best(&truth, &held, BETTER);
        let (mut outcome, mut decided) = blend(&mut all, &weights, (samples, &self.mask), out, run)?;
        if outcome.stop > Stop::IterationLimit {
            return Ok((self.in_haste(samples, out, run)?, Decided::alone(ss::DESCRIPTOR.name)));
        }
        let mut own = 1.0;
        if carried.iter().any(|carried| !carried.is_empty()) {
            let along = along::pulled(self, (&mut all, &weights), (samples, carried, guides), out, run)?;
            if let Some(along) = along {
                outcome = outcome.worst(along.outcome);
                own = along.own;
                near = along.tell(&near, guides, &mut decided);
            } else if let Some(stop) = run.interrupted() {
                outcome.stop = stop;
            }
        }
        if let Some(rounds) = learn {
            // What other frames know is not in the simulation.
            let known = decided.along.is_none().then_some(&*out);
            let share = |&k: &usize| weights.share(k);
            let most = (0..all.len()).max_by(|a, b| share(a).total_cmp(&share(b))).unwrap_or(0);
            let evidence =
                self.evidence(&all[most], (held.swap_remove(most), near), (samples, known), rounds, run)?;
            decided.evidence = Some(Evidence { own, ..evidence });
        }
        Ok((outcome, decided))
    }

    /// Plain splines, where there is no time for more: to their end when the time is up, as what they begin from is no image to keep.
    fn in_haste(&self, samples: &Planes, out: &mut Planes, run: &Run<'_>) -> Result<Outcome, Error> {
        let stop = run.interrupted();
        let to_end = Run::default();
        let run = if stop == Some(Stop::TimeLimit) { &to_end } else { run };
        let outcome = self.plain.reconstruct(samples, out, run)?;
        Ok(Outcome { stop: stop.unwrap_or(outcome.stop), ..outcome })
    }

    /// What the candidates predict at held-out samples; nothing if the run is interrupted. Those that a first fold of many shows to count for nothing
    /// are left out.
    fn held_out(
        &self,
        (all, voronoi): (&mut Vec<Candidate<'_>>, Option<&Voronoi>),
        (samples, map): (&Planes, Map),
        run: &Run<'_>,
    ) -> Result<Vec<HeldOut>, Error> {
        let mut held = vec![HeldOut::default(); all.len()];
        for parts in self.folds.near(self.mask.count()) {
            let fold = self.folds.fold(&self.mask, [parts.clone(), parts.clone()]);
            let mut start = None;
            for (candidate, held) in all.iter().zip(&mut held).rev() {
                held.extend(candidate.held_out(samples, &fold, &mut start, run)?);
                if run.interrupted().is_some() {
                    return Ok(Vec::new());
                }
            }
            drop(start);
            if parts.start == 0 && all.len() > 1 && held[0].at.len() >= DECIDE {
                let less = less(&held[0], &self.mask, self.folds, LESS);
                let truth = Truth { mask: &self.mask, voronoi, samples, map, less };
                let weights = Weights::new(&truth, &held, None);
                let both = std::mem::take(all).into_iter().zip(std::mem::take(&mut held)).enumerate();
                (*all, held) = both.filter(|(k, _)| weights.counts(*k)).map(|(_, both)| both).unzip();
            }
        }
        Ok(held)
    }

    /// Guided filling by splines, done, and its guides; nothing if there are none, or it gains nothing, which left the image of splines.
    fn guided<'a>(
        &self,
        samples: &Planes,
        guides: Option<&'a Guides>,
        run: &Run<'_>,
    ) -> Result<(Option<Candidate<'a>>, Option<&'a Guides>), Error> {
        let Some(guides) = guides.filter(|guides| !guides.is_empty()) else { return Ok((None, None)) };
        let filter = Box::new(ss::Settings::default());
        let mut guided =
            Candidate { name: "guided", kind: Kind::Spline, filter, guides: Some(guides), done: None };
        let mut out = Planes::zeros(samples.size(), samples.len());
        let (outcome, effect) = guided.fill((samples, &self.mask), How::EXACTLY, &mut out, run)?;
        let gains = effect.gain.is_some();
        guided.done = Some((out, outcome, effect));
        Ok(if gains { (Some(guided), Some(guides)) } else { (None, None) })
    }

    /// What was predicted by the same blend is `near`; how error grows with depth, the candidate shows that counts most.
    fn evidence(
        &self,
        most: &Candidate<'_>,
        (held, mut near): (HeldOut, HeldOut),
        (samples, filled): (&Planes, Option<&Planes>),
        rounds: Rounds<'_>,
        run: &Run<'_>,
    ) -> Result<Evidence, Error> {
        let kind = most.kind;
        if near.variance.is_empty() {
            near = near.with_variance(&self.mask, self.folds, kind);
        }
        let mut shallow = held.sorted(|_| true);
        // Mostly at the same pixels, or at some of them.
        let of = |pixel| near.at.binary_search(pixel).ok().map(|k| near.variance[k]);
        match shallow.at.iter().map(of).collect() {
            Some(variance) => shallow.variance = variance,
            None => shallow = shallow.with_variance(&self.mask, self.folds, kind),
        }
        let mut again = |excerpt: Option<&Excerpt>, samples: &Planes, kept: &Arc<Mask>| {
            let mut out = Planes::zeros(samples.size(), samples.len());
            let guides = most.guides;
            let small = guides.zip(excerpt).map(|(guides, excerpt)| guides.within(excerpt));
            most.fill_guided(small.as_ref().or(guides), (samples, kept), How::ROUGHLY, &mut out, run)?;
            Ok(out)
        };
        let deep = HeldOut::deep((samples, &self.mask), self.folds, kind, false, &mut again)?;
        let mut evidence = Evidence::new(kind, self.folds, &near, &shallow, &deep);
        if let Some(filled) = filled {
            evidence.known((samples, &self.mask), filled, (self.folds, rounds), &mut again, run)?;
        }
        Ok(evidence)
    }
}

/// Weights, and what the blend predicts at held-out samples; of the best candidate alone if a blend by weights that
/// others of them have taught is worse: its squared error is `better` less, over the blend's.
fn blend_or_best(truth: &Truth<'_>, held: &[HeldOut], better: f64) -> (Weights, HeldOut) {
    let learned = |held: &[HeldOut]| Weights::new(truth, held, None);
    let weights = learned(held);
    if weights.alone().is_some() {
        let near = weights.of_held_out(held);
        return (weights, near);
    }
    let near = Weights::crossed(held, &learned);
    let single = held.iter().enumerate().filter(|(k, _)| weights.counts(*k));
    let best = single.map(|(k, held)| (Weights::error(truth, held), k)).min_by(|a, b| a.0.total_cmp(&b.0));
    match best {
        Some((error, k)) if error <= (1.0 - better) * Weights::error(truth, &near) => {
            (weights.only(k), held[k].clone())
        }
        _ => (weights, near),
    }
}

/// The blend of those candidates that count, from the samples of a mask. An image that a candidate has already is of all samples, and is taken
/// the first time.
fn blend(
    all: &mut [Candidate<'_>],
    weights: &Weights,
    (samples, mask): (&Planes, &Arc<Mask>),
    out: &mut Planes,
    run: &Run<'_>,
) -> Result<(Outcome, Decided), Error> {
    let (mut outcome, mut decided) = (None::<Outcome>, Decided::default());
    let mut one = Planes::zeros(samples.size(), samples.len());
    if weights.alone().is_none() {
        out.as_mut_slice().iter_mut().for_each(|plane| plane.pixels_mut().fill(0.0));
    }
    let mut start = None;
    for (k, candidate) in all.iter_mut().enumerate().filter(|(k, _)| weights.counts(*k)).rev() {
        let alone = weights.alone() == Some(k);
        let image = if alone { &mut *out } else { &mut one };
        let (ended, found) = if let Some((done, ended, found)) = candidate.done.take() {
            *image = done;
            (ended, found)
        } else {
            candidate.fill((samples, mask), How::EXACTLY.after(&start), image, run)?
        };
        if !alone {
            candidate.lead(image, &mut start);
        }
        outcome = Some(outcome.map_or(ended, |outcome| outcome.worst(ended)));
        decided.shares.push((candidate.name, weights.share(k)));
        if candidate.guides.is_some() {
            decided.guided = found;
        }
        if !alone {
            weights.add(k, &one, out);
        }
    }
    decided.shares.reverse();
    for (samples, out) in samples.as_slice().iter().zip(out.as_mut_slice()) {
        mask.restore(samples, out);
    }
    Ok((outcome.unwrap_or(Outcome::direct()), decided))
}
