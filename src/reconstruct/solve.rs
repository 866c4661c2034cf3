//! One group of channels through the filter: into the value domain, filter, back, mended, limited, bounded.

use std::sync::Arc;

use lacuna_core::parallel::prelude::*;
use lacuna_filters::domain::{Domain, Map};
use lacuna_filters::variational::guided::{self, Guides};
use lacuna_filters::{Error, Mask, Outcome, Plane, Planes, Run, limiter};

use super::bounds::Bounds;
use super::gradients::GradientSamples;
use super::{Job, PIECE, Plans};

/// What a group is and what is asked of it.
#[derive(Clone, Debug)]
pub struct Question<'a> {
    /// The values that count as measured.
    pub mask: &'a Arc<Mask>,
    /// How much each counts, if not all alike.
    pub weights: Option<Arc<Plane>>,
    /// Whether the values are light, which may need the logarithmic domain.
    pub light: bool,
    /// Whether overshoot is limited, if the job does so: not for directions.
    pub limit: bool,
    /// The bounds of each plane.
    pub bounds: Vec<Bounds>,
    /// Samples of the gradient, if the method uses them.
    pub gradients: Option<GradientSamples>,
    /// Complete planes that may steer the values.
    pub guides: Option<&'a Guides>,
}

/// A group that has been solved.
#[derive(Clone, Debug)]
pub struct Answer {
    /// The values, finite everywhere; at measured pixels they are the filter's.
    pub planes: Planes,
    /// The domain it was solved in.
    pub map: Map,
    /// How the solver ended.
    pub outcome: Outcome,
    /// Per plane, the values that the limiter or a bound moved.
    pub limited: Vec<usize>,
    /// Values that overflowed in the filter and took the nearest measured one.
    pub mended: usize,
    /// The guides that steered it.
    pub guides: Vec<String>,
    /// The part of the squared error that they took away, estimated.
    pub gain: Option<f64>,
}

/// Solves for the missing pixels of `samples`, which are finite.
pub fn solve(
    question: &Question<'_>,
    samples: &Planes,
    job: &Job,
    plans: &Plans,
    run: &Run<'_>,
) -> Result<Answer, Error> {
    let mask = question.mask;
    let plan = plans.filter(&job.method, mask, question.weights.as_ref(), run)?;
    let map =
        if question.light { job.domain.map(mask, samples.as_slice()) } else { Domain::Linear.map(mask, &[]) };
    let mut out = Planes::zeros(samples.size(), samples.len());
    let reconstruct = |samples: &Planes, gradients: Option<&GradientSamples>, out: &mut Planes| {
        let plain = |outcome| Ok((outcome, guided::Effect::default()));
        match (gradients, question.guides) {
            (Some(gradients), _) => {
                plain(plan.reconstruct_gradients(samples, &gradients.view(), out, run)?)
            }
            (None, Some(guides)) => {
                guided::reconstruct((&job.method, plan.as_ref()), mask, samples, guides, out, run)
            }
            (None, None) => plain(plan.reconstruct(samples, out, run)?),
        }
    };
    let gradients = question.gradients.as_ref();
    let (outcome, mut effect) = if map.is_linear() {
        reconstruct(samples, gradients, &mut out)?
    } else {
        let mut mapped = samples.clone();
        mapped.as_mut_slice().iter_mut().for_each(|plane| map.forward_plane(mask, plane));
        let gradients = gradients.map(|found| found.mapped(map, samples, mask)).transpose()?;
        let mut found = reconstruct(&mapped, gradients.as_ref(), &mut out)?;
        let predicted = found.1.predicted.as_mut().map(Planes::as_mut_slice).into_iter().flatten();
        predicted.chain(out.as_mut_slice()).for_each(|plane| map.inverse_plane(plane));
        found
    };
    let (guides, gain, predicted) = (effect.guides, effect.gain, effect.predicted.take());
    let mut predicted = predicted.map(Planes::into_vec).unwrap_or_default().into_iter();
    let mut answer = Answer { planes: out, map, outcome, limited: Vec::new(), mended: 0, guides, gain };
    let planes = samples.as_slice().iter().zip(answer.planes.as_mut_slice()).zip(&question.bounds);
    for ((samples, out), bounds) in planes {
        answer.mended += mend(samples, out, || plans.nearest(mask), |nearest| nearest.as_slice())?;
        let mut moved = 0;
        if job.limit && question.limit {
            moved += match predicted.next() {
                Some(predicted) => limit_guided(mask, samples, &predicted, out)?,
                None => limiter::local(mask, samples, out)?,
            };
        }
        if *bounds != Bounds::Free {
            moved += limiter::range(mask, samples, out, *bounds == Bounds::Unit)?;
            if !job.method.keeps_measured() {
                moved += bound_measured(*bounds, mask, samples, out);
            }
        }
        answer.limited.push(moved);
    }
    Ok(answer)
}

/// The limiter, except that values may go as far as the guides predict; returns how many were moved.
fn limit_guided(mask: &Mask, samples: &Plane, predicted: &Plane, out: &mut Plane) -> Result<usize, Error> {
    let free = out.clone();
    limiter::local(mask, samples, out)?;
    let mut moved = 0;
    for ((value, &free), &predicted) in out.pixels_mut().iter_mut().zip(free.pixels()).zip(predicted.pixels())
    {
        if predicted.is_finite() {
            *value = free.clamp(value.min(predicted), value.max(predicted));
        }
        moved += usize::from(*value != free);
    }
    Ok(moved)
}

/// A method that smooths may take measured pixels out of the bounds as well; returns how many were moved back.
fn bound_measured(bounds: Bounds, mask: &Mask, samples: &Plane, out: &mut Plane) -> usize {
    let measured = samples.pixels().iter().zip(mask.as_slice()).filter(|(_, flag)| **flag);
    let (low, high) = bounds.range(measured.map(|(value, _)| *value));
    let mut moved = 0;
    for (value, _) in out.pixels_mut().iter_mut().zip(mask.as_slice()).filter(|(_, flag)| **flag) {
        if *value < low || *value > high {
            *value = value.clamp(low, high);
            moved += 1;
        }
    }
    moved
}

/// What is told of values that [`mend`] has found, if it found any.
pub fn overflow_note(names: &[String], count: usize) -> Option<String> {
    let names = names.join(", ");
    (count > 0)
        .then(|| format!("{names}: {count} values overflowed in the filter and took the nearest known one"))
}

/// Values near the end of a float's range can overflow inside a filter; such pixels take the nearest one of `samples`, whose
/// place `of` tells for every pixel of `out`. Returns how many did.
pub fn mend<N, E>(
    samples: &Plane,
    out: &mut Plane,
    nearest: impl FnOnce() -> Result<N, E>,
    of: impl Fn(&N) -> &[u32],
) -> Result<usize, E> {
    let pieces = out.pixels().par_chunks(PIECE);
    let bad = pieces.map(|piece| piece.iter().filter(|value| !value.is_finite()).count());
    let bad: usize = bad.into_iter().sum();
    if bad > 0 {
        let nearest = nearest()?;
        for (value, &source) in out.pixels_mut().iter_mut().zip(of(&nearest)) {
            if !value.is_finite() {
                *value = samples.pixels()[source as usize];
            }
        }
    }
    Ok(bad)
}
