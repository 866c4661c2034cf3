//! Samples of other frames on top of what a frame makes of its own: how much they count where, by held-out samples.
//!
//! A held-out sample is not where a missing pixel is: it stands in an emptier place, where the frame alone errs more (`less`), and where nothing is carried
//! anywhere it lacks the sample of another frame that a missing pixel has (`standing`). Both are made up for before anything is chosen.
//!
//! Samples of all frames also pull the frames beside this one, and what these become is seen from it (`temporal/view.rs`): its errors have little in common
//! with those of the frame's own image. Images much larger than the tiles of an excerpt go without: there it gained 0.2 and 0.4 dB for 2.4 times the time (engine and aneurism,
//! 1200 x 1200, 20 %).
//!
//! Where guides gain, samples of other frames are also taken in further ways (`ways`), whose errors have little in common with those of the first. What the same
//! fill misses of guides then corrects the result (`variates`).

use std::borrow::Cow;
use std::sync::Arc;

use super::standing::Standing;
use super::variates::Variates;
use super::ways::{Given, On, Way, plain};
use super::{Blend, Candidate, How, blend, less};
use crate::decided::Decided;
use crate::domain::Map;
use crate::estimate::{Folds, HeldOut, PARTS, Voronoi};
use crate::excerpt::Excerpt;
use crate::temporal::{self, Beside, Carried, Changes, First, Pull, Usual};
use crate::variational::guided::{Guides, Regression};
use crate::variational::ss;
use crate::weights::{Preferred, Truth, Weights};
use crate::{Error, Filter, Mask, Outcome, Planes, Problem, Run, Stop};
use lacuna_core::hash;

/// How samples of other frames may pull.
pub(super) const PULLS: [Pull; 3] = [
    Pull { weight: 10.0, changes: Changes::Linear },
    Pull { weight: 60.0, changes: Changes::Linear },
    Pull { weight: 100.0, changes: Changes::Levelled },
];
/// Takes them as they are, where nothing moves.
const FIRM: Pull = Pull { weight: 1e6, changes: Changes::Kept };
/// About what the energy weighs at a pixel with pulled ones around it.
const STIFF: f64 = 30.0;
/// What reports call them.
const NAME: &str = "neighbours";
/// What other frames must take away of the squared error to be used.
const WORTH: f64 = 0.05;
/// The share of the squared error that taking them as they are may cost by held-out samples.
const LOSS: f64 = 0.5;
/// The power of the variance that errors go by, between that of edges and that of shading.
const LESS: f64 = 0.8;
/// Makes halves that are independent of the folds.
pub(super) const HALVES: u64 = 0x51;

/// What came of it.
pub struct Along {
    /// How the solvers ended.
    pub outcome: Outcome,
    /// The mean weight at missing pixels of what other frames pulled.
    pub share: f64,
    /// The part of the squared error that they took away, by held-out samples.
    pub gain: Option<f64>,
    /// What was predicted at held-out samples.
    pub held: HeldOut,
    /// The part of its squared error that is the frame's alone, by held-out samples: the squared correlation of both errors.
    pub own: f64,
}

impl Along {
    /// Says what other frames did to a blend; returns what was predicted at the held-out samples of both.
    pub fn tell(self, near: &HeldOut, guides: Option<&Guides>, decided: &mut Decided) -> HeldOut {
        decided.along = self.gain;
        self.join(&mut decided.shares);
        if let (Some(guides), true) = (guides, decided.guided.guides.is_empty()) {
            decided.guided.guides = guides.all_names().cloned().collect();
        }
        let held = self.held.sorted(|_| true);
        let near = near.sorted(|pixel| held.at.binary_search(&pixel).is_ok());
        HeldOut { predicted: held.predicted, ..near }
    }

    /// Joins the shares of a blend that is pulled in part.
    fn join(&self, shares: &mut Vec<(&'static str, f64)>) {
        for (_, share) in shares.iter_mut() {
            *share *= 1.0 - self.share;
        }
        shares.push((NAME, self.share));
    }
}

/// Other frames, and what is to be known of them.
struct Others<'a> {
    carried: &'a [Carried],
    /// How their samples may be taken.
    ways: Vec<Way>,
    /// The guided regression over them.
    regression: Option<Regression<'a>>,
    /// What each makes of its own, where all stand on the pixels of this frame.
    fills: Vec<Planes>,
    /// Whether they do.
    whole: bool,
    /// Their samples as far as held-out ones may judge them.
    judged: Vec<Carried>,
    /// The nearest on either side, of these samples.
    beside: Vec<Beside>,
}

impl<'a> Others<'a> {
    fn new(
        samples: &Planes,
        (carried, judged): (&'a [Carried], Vec<Carried>),
        beside: Vec<Beside>,
        guides: Option<&'a Guides>,
        run: &Run<'_>,
    ) -> Result<Self, Error> {
        let mut ways = PULLS.map(Way::Pulled).to_vec();
        let whole = carried.iter().all(Carried::is_still);
        if whole {
            ways.push(Way::Pulled(FIRM));
        }
        if !beside.is_empty() {
            ways.push(Way::Seen(PULLS[1]));
        }
        if let Some(guides) = guides {
            ways.extend([Way::Regressed(On::Ours), Way::Plain(PULLS[1])]);
            if Carried::are_guided(carried, guides.planes().len()) {
                ways.push(Way::Regressed(On::Theirs));
            }
        }
        let fills = if whole { fills(samples, carried, run)? } else { Vec::new() };
        Ok(Self { carried, ways, regression: guides.map(Regression::new), fills, whole, judged, beside })
    }

    /// What the ways start from.
    fn given<'b>(
        &'b self,
        (samples, mask): (&'b Planes, &'b Arc<Mask>),
        alone: &'b Planes,
        (carried, held_out_of): (&'b [Carried], Option<&'b Mask>),
    ) -> Given<'b> {
        let (fills, beside, regression) =
            (self.fills.as_slice(), self.beside.as_slice(), self.regression.as_ref());
        Given { samples, mask, alone, carried, fills, beside, regression, held_out_of, first: None }
    }
}

/// Pulls the blend `out` towards samples of other frames, where held-out samples show that this helps; nothing if it does so nowhere.
pub fn pulled(
    own: &Blend,
    (all, alone): (&mut [Candidate<'_>], &Weights),
    (samples, carried, guides): (&Planes, &[Carried], Option<&Guides>),
    out: &mut Planes,
    run: &Run<'_>,
) -> Result<Option<Along>, Error> {
    let judged: Vec<&Carried> = carried.iter().map(Carried::to_judge).collect();
    // Where all stands still, what other frames know of measured pixels is counted over all of them (`standing`).
    let is_still = judged.iter().all(|carried| carried.is_still());
    let parts = if is_still { 0..PARTS } else { temporal::judges(own.folds, own.mask.count()) };
    let judged = temporal::thinned((&own.mask, &own.folds.held_out(&own.mask, &parts)), &judged);
    // Guides are those of this frame.
    let beside = |all: &mut [Candidate<'_>], carried: &[Carried]| {
        temporal::beside(carried, |samples, mask, corner| match guides {
            Some(_) => Ok(plain((samples, mask), How::EXACTLY, run)?.0),
            None => blended_alone((&mut *all, &alone.at_corner(corner)), (samples, mask), run),
        })
    };
    let is_small = Excerpt::tiles(&own.mask).is_none();
    let others = if is_small { beside(all, &judged)? } else { Vec::new() };
    let mut others = Others::new(samples, (carried, judged), others, guides, run)?;
    let held = held_out(own, (all, alone), (samples, &mut others), out, run)?;
    if run.interrupted().is_some() || held[0].at.is_empty() {
        return Ok(None);
    }
    let less = less(&held[0], &own.mask, own.folds, LESS);
    let misses = if others.whole { misses(&own.mask, carried, out) } else { Vec::new() };
    let voronoi = Voronoi::new(&own.mask);
    // Errors as they are, as misses are.
    // Of few samples that are far from all others nothing is learned.
    let usual = temporal::usual_of(samples, &own.mask);
    let tamed = temporal::within(samples, &usual);
    let truth = Truth { mask: &own.mask, voronoi: Some(&voronoi), samples: &tamed, map: Map::Linear, less };
    let learn = |held: &[HeldOut]| {
        let held = predicted_within(held, &usual);
        let firm = others.ways.iter().position(|way| *way == Way::Pulled(FIRM));
        let firm = firm.map(|way| Preferred { candidate: 1 + way, loss: LOSS, misses: &misses });
        Weights::new(&truth, &held, firm)
    };
    let within = predicted_within(&held, &usual);
    let Gain { gain, own: part } = Gain::new(own.folds, &tamed, (&within, less), &learn);
    let weights = learn(&held);
    if gain < WORTH || weights.alone() == Some(0) {
        return Ok(None);
    }
    let mut crossed = Weights::crossed(&held, &learn);
    let correction = match Variates::new(own, guides, (carried, &others.judged)) {
        Some(variates) => variates.learn(&tamed, &crossed, run)?,
        None => None,
    };
    // What only judges goes, before the fill takes its memory.
    drop(voronoi);
    others.judged = Vec::new();
    let is_seen = |way: &Way| matches!(way, Way::Seen(_));
    if others.ways.iter().position(is_seen).is_some_and(|way| weights.counts(1 + way)) {
        others.beside = beside(all, carried)?;
    }
    let Some(outcome) = blended((samples, &own.mask), &others, &weights, out, run)? else { return Ok(None) };
    for (samples, out) in samples.as_slice().iter().zip(out.as_mut_slice()) {
        own.mask.restore(samples, out);
    }
    if let Some(correction) = correction {
        correction.correct(&own.mask, out, run)?;
        crossed = correction.held;
    }
    let share = 1.0 - weights.share(0);
    Ok(Some(Along { outcome, share, gain: Some(gain), held: crossed, own: part }))
}

/// Makes `out`, the blend alone, what all ways make of it by their weights. Those that differ in what the samples weigh are one, whose
/// samples weigh between them: where the energy weighs `h` at a pixel, it comes nearer to them by about `w / (h + w)`. Nothing, and `out` as it was,
/// if the run is interrupted.
fn blended(
    (samples, mask): (&Planes, &Arc<Mask>),
    others: &Others<'_>,
    weights: &Weights,
    out: &mut Planes,
    run: &Run<'_>,
) -> Result<Option<Outcome>, Error> {
    let alone = std::mem::replace(out, Planes::zeros(out.size(), out.len()));
    let given = others.given((samples, mask), &alone, (others.carried, None));
    let joined = |k: usize| match k.checked_sub(1).map(|way| others.ways[way]) {
        None => Some(0.0),
        Some(Way::Pulled(pull)) if pull.changes == Changes::Linear => Some(pull.weight),
        Some(_) => None,
    };
    let of = |value: &dyn Fn(f64) -> f64| {
        let values = (0..=others.ways.len()).map(|k| joined(k).map_or(0.0, value));
        weights.mean(&values.collect::<Vec<_>>())
    };
    let (share, mut local) = (of(&|_| 1.0), of(&|weight| weight / (STIFF + weight)));
    for (local, share) in local.pixels_mut().iter_mut().zip(share.pixels()) {
        let nearer = if *share > 0.0 { f64::from(*local) / f64::from(*share) } else { 0.0 };
        *local = (STIFF * nearer / (1.0 - nearer)) as f32;
    }
    let is_pulled = local.pixels().iter().any(|weight| *weight > 0.0);
    let (image, mut outcome) = if is_pulled {
        given.pulled(&alone, PULLS[1], Some(&local), run)
    } else {
        (alone.clone(), Outcome::direct())
    };
    for (out, image) in out.as_mut_slice().iter_mut().zip(image.as_slice()) {
        let pixels = out.pixels_mut().iter_mut().zip(image.pixels().iter().zip(share.pixels()));
        pixels.for_each(|(out, (image, share))| *out = share * image);
    }
    for k in (1..=others.ways.len()).filter(|&k| weights.counts(k) && joined(k).is_none()) {
        let (image, ended) = others.ways[k - 1].image(&given, run)?;
        outcome = outcome.worst(ended);
        weights.add(k, &image, out);
    }
    if outcome.stop > Stop::IterationLimit {
        *out = alone;
        return Ok(None);
    }
    Ok(Some(outcome))
}

/// What the blend alone and each way, in this order, predict at held-out samples; `filled` is the blend of all samples.
fn held_out(
    own: &Blend,
    (all, weights): (&mut [Candidate<'_>], &Weights),
    (samples, others): (&Planes, &mut Others<'_>),
    filled: &Planes,
    run: &Run<'_>,
) -> Result<Vec<HeldOut>, Error> {
    let mut held = vec![HeldOut::default(); 1 + others.ways.len()];
    for parts in temporal::judging(own.folds, own.mask.count()) {
        let out = own.folds.fold(&own.mask, [parts.clone(), parts]);
        let mut alone = Planes::zeros(samples.size(), 0);
        let mut keep = |samples: &Planes, kept: &Arc<Mask>| {
            alone = blended_alone((all, weights), (samples, kept), run)?;
            Ok(alone.clone())
        };
        let fold = HeldOut::new(samples, &out, None, &mut keep)?;
        if alone.is_empty() {
            continue;
        }
        let mut known = Cow::Borrowed(&others.judged);
        if others.whole && !fold.at.is_empty() {
            let less = less(&fold, &own.mask, own.folds, LESS);
            let standing = Standing { samples, mask: &own.mask, filled, held: &fold, less };
            standing.complete(known.to_mut(), &others.fills);
        }
        held[0].extend(fold);
        // Levelling costs as much as all else.
        if held[1].at.is_empty()
            && !others.whole
            && !temporal::brightness_changes(&known, (&alone, &own.mask))
        {
            others.ways.retain(|way| !way.is_levelled());
            held.truncate(1 + others.ways.len());
        }
        let first = First::default();
        for (way, held) in others.ways.iter().zip(&mut held[1..]) {
            let mut fill = |samples: &Planes, kept: &Arc<Mask>| {
                let given = others.given((samples, kept), &alone, (&known, Some(&own.mask)));
                Ok(way.image(&Given { first: Some(&first), ..given }, run)?.0)
            };
            held.extend(HeldOut::new(samples, &out, None, &mut fill)?);
        }
    }
    Ok(held)
}

/// What the candidates make of samples without other frames.
fn blended_alone(
    (all, weights): (&mut [Candidate<'_>], &Weights),
    (samples, mask): (&Planes, &Arc<Mask>),
    run: &Run<'_>,
) -> Result<Planes, Error> {
    let mut image = Planes::zeros(samples.size(), samples.len());
    blend(all, weights, (samples, mask), &mut image, run)?;
    Ok(image)
}

/// Predictions within these ranges.
fn predicted_within(held: &[HeldOut], usual: &[Usual]) -> Vec<HeldOut> {
    let mut held = held.to_vec();
    for (values, usual) in held.iter_mut().flat_map(|held| held.predicted.iter_mut().zip(usual)) {
        for value in values {
            *value = usual.clamp(*value);
        }
    }
    held
}

/// The fill of each other frame by itself, where nothing moves.
fn fills(samples: &Planes, carried: &[Carried], run: &Run<'_>) -> Result<Vec<Planes>, Error> {
    let one = |carried: &Carried| {
        let (own, mask) = carried.on_grid(samples.size());
        let mut out = Planes::zeros(samples.size(), samples.len());
        if !mask.is_empty() {
            let plan = ss::Settings::default().plan(&Problem::fill(Arc::new(mask)), run)?;
            plan.reconstruct(&own, &mut out, run)?;
        }
        Ok(out)
    };
    carried.iter().map(one).collect()
}

/// By how much samples of other frames in missing pixels miss the image that this frame makes of its own, squared: pixel by pixel.
fn misses(mask: &Mask, carried: &[Carried], image: &Planes) -> Vec<(u32, f64)> {
    let of = |carried: &Carried| {
        let errors: Vec<f64> = temporal::off(carried, image).collect();
        let all = carried.pixels(mask.size()).zip(errors);
        all.filter(|(at, _)| !mask.as_slice()[*at])
            .map(|(at, error)| (at as u32, error * image.len() as f64))
            .collect::<Vec<_>>()
    };
    carried.iter().flat_map(of).collect()
}

/// What a blend is worth whose weights half of what was held out learns for the other half: what chance alone would choose gains nothing.
struct Gain {
    /// The part of the squared error that it takes away.
    gain: f64,
    /// The part of what is left that is the frame's alone.
    own: f64,
}

impl Gain {
    fn new(
        folds: Folds,
        samples: &Planes,
        (held, less): (&[HeldOut], f64),
        learn: &dyn Fn(&[HeldOut]) -> Weights,
    ) -> Self {
        let half = |odd: bool| -> Vec<HeldOut> {
            let is = |pixel: u32| (hash(folds.seed ^ HALVES, u64::from(pixel)) % 2 == 1) == odd;
            held.iter().map(|held| held.sorted(is)).collect()
        };
        let products = |a: &HeldOut, b: &HeldOut| a.products(b, samples);
        let halves = [half(false), half(true)];
        let mut sums = [0.0; 3];
        for (own, other) in [(&halves[0], &halves[1]), (&halves[1], &halves[0])] {
            let after = learn(own).of_held_out(other);
            sums[0] += products(&other[0], &other[0]);
            sums[1] += products(&other[0], &after);
            sums[2] += products(&after, &after);
        }
        let [before, both, after] = sums;
        if before <= 0.0 || after <= 0.0 {
            return Self { gain: if before > 0.0 { 1.0 } else { 0.0 }, own: 1.0 };
        }
        let own = (both * both / (before * after)).min(1.0);
        Self { gain: 1.0 - after * (1.0 - (1.0 - less) * own) / (less * before), own }
    }
}
