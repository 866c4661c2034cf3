//! Samples of other frames on top of what a frame makes of its own: how much they count where, by held-out samples.

use std::sync::Arc;

use super::{Blend, Candidate, blend};
use crate::estimate::{Folds, HeldOut};
use crate::sampling::hash;
use crate::temporal::{self, Carried};
use crate::weights::Weights;
use crate::{Error, Mask, Outcome, Planes, Run};

/// What samples of other frames may weigh.
const MOVING: [f64; 2] = [10.0, 100.0];
/// The same where nothing moves: the last one takes them as they are.
const STILL: [f64; 2] = [10.0, 1e6];
/// What reports call them.
const NAME: &str = "neighbours";
/// What other frames must take away of the squared error to be used.
const WORTH: f64 = 0.05;
/// The share of the squared error that taking them as they are may cost by held-out samples.
const LOSS: f64 = 0.5;
/// Makes halves that are independent of the folds.
const HALVES: u64 = 0x51;

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
}

impl Along {
    /// Joins the shares of a blend that is pulled in part.
    pub fn join(&self, shares: &mut Vec<(&'static str, f64)>) {
        for (_, share) in shares.iter_mut() {
            *share *= 1.0 - self.share;
        }
        shares.push((NAME, self.share));
    }
}

/// Pulls the blend `out` towards samples of other frames, where held-out samples show that this helps; nothing if it does so nowhere.
pub fn pulled(
    own: &Blend,
    (all, weights): (&mut [Candidate<'_>], &Weights),
    (samples, carried): (&Planes, &[Carried]),
    out: &mut Planes,
    run: &Run<'_>,
) -> Result<Option<Along>, Error> {
    let pulls = if carried.iter().all(Carried::is_still) { STILL } else { MOVING };
    let judged: Vec<Carried> = carried.iter().map(|carried| carried.to_judge().clone()).collect();
    let thinned = temporal::thinned(&own.mask, &judged);
    let mut held = vec![HeldOut::default(); 1 + pulls.len()];
    for parts in own.folds.near(own.mask.count()).take(temporal::JUDGES) {
        let (folds, given) = ((own.folds, [parts.clone(), parts]), (samples, &*own.mask));
        let mut alone = Planes::zeros(samples.size(), 0);
        let mut fill = |samples: &Planes, kept: &Arc<Mask>| {
            alone = Planes::zeros(samples.size(), samples.len());
            blend(all, weights, (samples, kept), &mut alone, run)?;
            Ok(alone.clone())
        };
        held[0].extend(HeldOut::new(given, folds.clone(), None, &mut fill)?);
        if alone.is_empty() {
            continue;
        }
        for (pull, held) in pulls.iter().zip(&mut held[1..]) {
            let mut fill = |_: &Planes, kept: &Arc<Mask>| {
                let mut image = alone.clone();
                temporal::pull(kept, &thinned, *pull, &mut image, run);
                Ok(image)
            };
            held.extend(HeldOut::new(given, folds.clone(), None, &mut fill)?);
        }
    }
    if run.interrupted().is_some() || held[0].at.is_empty() {
        return Ok(None);
    }
    let learn = |held: &[HeldOut]| {
        if pulls == STILL {
            // What is held out sees less of other frames than missing pixels do, as the frames' masks differ.
            Weights::preferring(&own.mask, samples, held, (held.len() - 1, LOSS))
        } else {
            Weights::new(&own.mask, samples, held)
        }
    };
    let gain = gain(own.folds, samples, &held, &learn);
    let weights = learn(&held);
    if gain < WORTH || weights.alone() == Some(0) {
        return Ok(None);
    }
    let alone = out.clone();
    out.as_mut_slice().iter_mut().for_each(|plane| plane.pixels_mut().fill(0.0));
    let mut outcome = Outcome::direct();
    for k in (0..held.len()).filter(|k| weights.counts(*k)) {
        let mut image = alone.clone();
        if k > 0 {
            outcome = outcome.worst(temporal::pull(&own.mask, carried, pulls[k - 1], &mut image, run));
        }
        weights.add(k, &image, out);
    }
    for (samples, out) in samples.as_slice().iter().zip(out.as_mut_slice()) {
        own.mask.restore(samples, out);
    }
    let share = 1.0 - weights.share(0);
    Ok(Some(Along { outcome, share, gain: Some(gain), held: Weights::crossed(&held, &learn) }))
}

/// The part of the squared error that a blend takes away, whose weights half of what was held out learns for the other half: what chance alone
/// would choose gains nothing.
fn gain(folds: Folds, samples: &Planes, held: &[HeldOut], learn: &dyn Fn(&[HeldOut]) -> Weights) -> f64 {
    let half = |odd: bool| -> Vec<HeldOut> {
        let is = |pixel: u32| (hash(folds.seed ^ HALVES, u64::from(pixel)) % 2 == 1) == odd;
        held.iter().map(|held| held.sorted(is)).collect()
    };
    let sum = |held: &HeldOut| held.squared_errors(samples).iter().map(|e| f64::from(*e)).sum::<f64>();
    let halves = [half(false), half(true)];
    let (mut before, mut after) = (0.0, 0.0);
    for (own, other) in [(&halves[0], &halves[1]), (&halves[1], &halves[0])] {
        before += sum(&other[0]);
        after += sum(&learn(own).of_held_out(other));
    }
    if before > 0.0 { 1.0 - after / before } else { 0.0 }
}
