//! One set of planes: into the value domain, method, back, mended, limited, bounded.

use std::sync::Arc;

use lacuna_core::parallel::prelude::*;

use super::{Estimate, Options, Set, Values};
use crate::choose::{Chosen, Given};
use crate::domain::{Domain, Map};
use crate::estimate::{Evidence, Excerpt, Folds, HELD_OUT, Model};
use crate::limiter::Moved;
use crate::noise::{self, Known, Noise, Split};
use crate::sampling::refine;
use crate::temporal::Carried;
use crate::variational::guided::{self, Effect, Guides};
use crate::variational::ss;
use crate::{
    Bounds, Error, Gradients, Mask, Method, Outcome, Plan, Plane, Planes, Plans, Problem, Run, Size, limiter,
};

/// Pixels that one task takes in loops over a plane.
const PIECE: usize = 1 << 14;

/// Solves for the missing pixels of `samples`, whose measured ones are finite; `places` are those of the planes in their group.
/// Returns the planes, per plane how many values the limiter or a bound moved, and what was decided.
pub fn solve(
    samples: &Planes,
    (mask, places): (&Arc<Mask>, Vec<usize>),
    options: &Options<'_>,
    plans: &Plans,
    run: &Run<'_>,
) -> Result<(Planes, Vec<Moved>, Set), Error> {
    let fits = options.method.planes().is_none_or(|planes| planes == samples.len());
    let mut method = if fits { options.method.clone() } else { Method::default() };
    let (weights, weightless) = match &options.weights {
        Some(weights) => weigh(weights, mask).map(|(plane, weightless)| (Some(plane), weightless))?,
        None => (None, 0),
    };
    // What counts no sample was not measured.
    let counting =
        weights.as_ref().filter(|_| weightless > 0 && options.noise != Noise::None).map(|weights| {
            let pairs = mask.as_slice().iter().zip(weights.pixels());
            Arc::new(Mask::of(mask.size(), pairs.map(|(flag, weight)| *flag && *weight > 0.0).collect()))
        });
    let mask = counting.as_ref().unwrap_or(mask);
    let light = options.values == Values::Light;
    let mut out = Planes::zeros(samples.size(), samples.len());
    let like = like(options, samples.size(), &places);
    // A method that chooses how much to smooth does so by itself.
    let found = if options.noise == Noise::None || method.is_open() {
        None
    } else {
        let known = Known { guides: options.guides, noise: like.as_ref(), weights: weights.as_ref(), light };
        noise::reconstruct(mask, samples, known, &mut out, run)?
    };
    let smoothed = found.is_some();
    let mut settled = Vec::new();
    let (map, (outcome, mut effect), model) = if let Some(found) = found {
        (Domain::Linear.map(mask, samples.as_slice()), found, None)
    } else {
        let domain = if light { options.domain } else { Domain::Linear };
        let map = domain.map(mask, samples.as_slice());
        let known = (like.as_ref(), weights.as_ref());
        let clean;
        (method, settled, clean) = settle(method, (mask, samples), known, (map, light), run)?;
        let plan = plans.filter(&method, mask, weights.as_ref(), run)?;
        let gradients = Slopes::new(options, &method, &places, mask);
        let carried: Vec<Carried> =
            options.carried.iter().map(|carried| carried.select(&places).mapped(map)).collect();
        let plan = plan.as_ref();
        let guides = options.guides.filter(|_| method.descriptor().takes.guides && method.keeps_measured());
        let task = Task { method: &method, plan, mask, options, guides, carried: &carried, error: None, run };
        let values = (clean.as_ref().unwrap_or(samples), gradients.as_ref());
        let (outcome, mut effect) = task.reconstruct(values, map, &mut out)?;
        let learned = if options.estimate == Estimate::No {
            None
        } else {
            let bounds = bounds(options, (mask, samples), &places);
            task.learn(values, &out, (map, &bounds), effect.evidence.take())?
        };
        (map, (outcome, effect), learned)
    };
    let mut predicted = effect.predicted.take().map(Planes::into_vec).unwrap_or_default().into_iter();
    let (mut mended, mut limited) = (0, Vec::with_capacity(places.len()));
    let limit = options.limit && options.values != Values::Directions;
    for ((samples, out), &place) in samples.as_slice().iter().zip(out.as_mut_slice()).zip(&places) {
        mended += mend(samples, out, || plans.nearest(mask), |nearest| nearest.as_slice())?;
        let mut moved = Moved::default();
        let predicted = predicted.next();
        if limit {
            // What was smoothed counts as it is now.
            let smooth = smoothed.then(|| out.clone());
            let around = smooth.as_ref().unwrap_or(samples);
            moved += match &predicted {
                Some(predicted) => limit_guided(mask, around, predicted, out)?,
                None => limiter::local(mask, around, out)?,
            };
        }
        let bounds = options.bounds_of(place);
        if bounds != Bounds::Free {
            moved += limiter::range(mask, samples, out, bounds == Bounds::Unit)?;
            if limit && !smoothed && predicted.is_none() && method.keeps_measured() {
                moved += limiter::on_black(mask, samples, out, || plans.nearest(mask))?;
            }
            if smoothed || !method.keeps_measured() {
                moved += bound_measured(bounds, mask, samples, out);
            }
        }
        limited.push(moved);
    }
    let Effect { guides, gain, shares, along, .. } = effect;
    let wanted = model.as_ref().filter(|_| options.estimate == Estimate::Pixels);
    let errors = wanted.map(|model| errors(model, (samples, light), mask, run)).transpose()?;
    let exponent = model.as_ref().map(Model::exponent);
    let estimate = model.map(|model| model.verdict());
    let mask = Arc::clone(mask);
    let set = Set {
        planes: places,
        mask,
        method,
        map,
        outcome,
        mended,
        guides,
        gain,
        shares,
        along,
        estimate,
        exponent,
        errors,
        weightless,
        smoothed,
        settled,
    };
    Ok((out, limited, set))
}

/// The estimated error of every pixel.
fn errors(
    model: &Model,
    (samples, light): (&Planes, bool),
    mask: &Arc<Mask>,
    run: &Run<'_>,
) -> Result<Plane, Error> {
    // The shape must count values as the model does, in one unit all over the image.
    if !light || model.is_chosen() {
        return Ok(model.plane(None));
    }
    let left_out = refine::estimate_spline(&shown(samples), mask, &ss::Settings::default(), run)?;
    Ok(model.plane(Some(&|pixel| left_out.squared_error(pixel))))
}

/// Light as it is compared: a highlight counts as what can be shown of it.
fn shown(samples: &Planes) -> Planes {
    let mut shown = samples.clone();
    for plane in shown.as_mut_slice() {
        plane.pixels_mut().par_chunks_mut(PIECE).for_each(|values| {
            for value in values {
                *value = value.clamp(0.0, 1.0);
            }
        });
    }
    shown
}

/// A method whose settings are left to the samples with those that they choose, what was chosen, and the samples without fireflies where these are
/// known and it smooths.
fn settle(
    method: Method,
    (mask, samples): (&Arc<Mask>, &Planes),
    (noise, weights): (Option<&Planes>, Option<&Arc<Plane>>),
    (map, light): (Map, bool),
    run: &Run<'_>,
) -> Result<(Method, Vec<Chosen>, Option<Planes>), Error> {
    if !method.is_open() {
        return Ok((method, Vec::new(), None));
    }
    if !light && noise.is_none() {
        return Ok((method.unsmoothed()?, Vec::new(), None));
    }
    // Neither fireflies nor lights choose.
    let split = Split::new(mask, samples, noise, light);
    let (seen, noise) = mapped(map, mask, &split.samples, split.noise.as_ref());
    let given = Given { mask, samples: &seen, noise: noise.as_ref(), weights };
    let (method, settled) = method.settled(&given, run)?;
    let clean = if method.keeps_measured() { None } else { split.without_fireflies() };
    Ok((method, settled, clean))
}

/// Noise like that of the planes at these places, if it is known.
fn like(options: &Options<'_>, size: Size, places: &[usize]) -> Option<Planes> {
    match &options.noise {
        Noise::None | Noise::Unknown => None,
        Noise::Like(planes) => Some(Planes::of(size, places.par_iter().map(|&at| planes[at].clone()))),
    }
}

/// The least and the greatest value that each of the planes at these places may have.
fn bounds(options: &Options<'_>, (mask, samples): (&Mask, &Planes), places: &[usize]) -> Vec<(f32, f32)> {
    let one = |(samples, &place): (&Plane, &usize)| {
        let measured = samples.pixels().iter().zip(mask.as_slice()).filter(|(_, flag)| **flag);
        options.bounds_of(place).range(measured.map(|(value, _)| *value))
    };
    samples.as_slice().iter().zip(places).map(one).collect()
}

/// Samples and noise within the value domain, zero at missing pixels; noise is what it changes there.
fn mapped(map: Map, mask: &Mask, samples: &Planes, noise: Option<&Planes>) -> (Planes, Option<Planes>) {
    let each = |planes: &Planes, change: &(dyn Fn(f32, f32) -> f32 + Sync)| {
        let plane = |(own, samples): (&Plane, &Plane)| {
            let mut values = Plane::filled(own.size(), 0.0);
            let parts = values.pixels_mut().par_chunks_mut(PIECE).zip(own.pixels().par_chunks(PIECE));
            let parts = parts.zip(samples.pixels().par_chunks(PIECE)).zip(mask.as_slice().par_chunks(PIECE));
            parts.for_each(|(((values, own), samples), flags)| {
                for (at, _) in flags.iter().enumerate().filter(|(_, flag)| **flag) {
                    values[at] = change(own[at], samples[at]);
                }
            });
            values
        };
        let both = planes.as_slice().iter().zip(samples.as_slice());
        Planes::of(planes.size(), both.map(plane).collect())
    };
    let change = |n: f32, y: f32| 0.5 * (map.forward(y + n) - map.forward(y - n));
    (each(samples, &|y, _| map.forward(y)), noise.map(|noise| each(noise, &change)))
}

/// A method that is ready to run on a mask.
struct Task<'a> {
    method: &'a Method,
    plan: &'a dyn Plan,
    mask: &'a Arc<Mask>,
    options: &'a Options<'a>,
    /// Those that the method takes.
    guides: Option<&'a Guides>,
    /// Of the set's planes, in the domain.
    carried: &'a [Carried],
    /// What the result may be off by, over the range of the samples, where less than the usual will do.
    error: Option<f64>,
    run: &'a Run<'a>,
}

impl Task<'_> {
    /// How wrong the method is on this mask, from `evidence` where it says so itself, and else from fills without some of the samples;
    /// nothing where those would take too long, or the method smooths, so that its error at a sample is not that beside it.
    fn learn(
        &self,
        (samples, gradients): (&Planes, Option<&Slopes>),
        filled: &Planes,
        (map, bounds): (Map, &[(f32, f32)]),
        evidence: Option<Evidence>,
    ) -> Result<Option<Model>, Error> {
        let folds = Folds::default();
        let Some(kind) = self.method.descriptor().held_out.filter(|_| self.method.keeps_measured()) else {
            return Ok(None);
        };
        let mut evidence = if let Some(evidence) = evidence {
            evidence
        } else {
            let mut again = |excerpt: Option<&Excerpt>, samples: &Planes, kept: &Arc<Mask>| {
                let plan = self.method.filter().plan(&Problem::fill(Arc::clone(kept)), self.run)?;
                let small = self.guides.zip(excerpt).map(|(guides, excerpt)| guides.within(excerpt));
                let guides = small.as_ref().or(self.guides);
                let task = Task { plan: plan.as_ref(), mask: kept, guides, error: Some(HELD_OUT), ..*self };
                let mut out = Planes::zeros(samples.size(), samples.len());
                task.reconstruct((samples, gradients), map, &mut out)?;
                Ok(out)
            };
            // Samples of gradients are in no excerpt.
            let filled = Some(filled).filter(|_| gradients.is_none());
            Evidence::of_folds((samples, self.mask), filled, (folds, kind), &mut again, self.run)?
        };
        if self.run.interrupted().is_some() {
            return Ok(None);
        }
        // What is beyond them does not stay so.
        evidence.map(|channel, value| value.clamp(bounds[channel].0, bounds[channel].1));
        if self.options.values != Values::Light {
            return Ok(Some(Model::new(&evidence, samples, self.mask, folds.seed)));
        }
        evidence.map(|_, value| value.clamp(0.0, 1.0));
        Ok(Some(Model::new(&evidence, &shown(samples), self.mask, folds.seed)))
    }

    /// The method within the value domain.
    fn reconstruct(
        &self,
        (samples, gradients): (&Planes, Option<&Slopes>),
        map: Map,
        out: &mut Planes,
    ) -> Result<(Outcome, Effect), Error> {
        if map.is_linear() {
            return self.mapped((samples, map), gradients, out);
        }
        let mut mapped = samples.clone();
        mapped.as_mut_slice().iter_mut().for_each(|plane| map.forward_plane(self.mask, plane));
        let slopes = gradients.map(|found| found.mapped(map, samples, self.mask));
        let mut found = self.mapped((&mapped, map), slopes.as_ref(), out)?;
        if let Some(evidence) = &mut found.1.evidence {
            evidence.map(|_, value| map.inverse(value));
        }
        let predicted = found.1.predicted.as_mut().map(Planes::as_mut_slice).into_iter().flatten();
        predicted.chain(out.as_mut_slice()).for_each(|plane| map.inverse_plane(plane));
        if self.method.keeps_measured() {
            for (samples, out) in samples.as_slice().iter().zip(out.as_mut_slice()) {
                self.mask.restore(samples, out);
            }
        }
        Ok(found)
    }

    /// The method on values that are mapped already.
    fn mapped(
        &self,
        (samples, map): (&Planes, Map),
        gradients: Option<&Slopes>,
        out: &mut Planes,
    ) -> Result<(Outcome, Effect), Error> {
        let Self { method, plan, mask, options, guides, carried, error, run } = *self;
        match (gradients, guides) {
            (None, guides) if let Some(blend) = plan.blend() => {
                let learn = options.estimate != Estimate::No;
                blend.choose((samples, map), (guides, carried), learn, out, run)
            }
            (Some(slopes), _) => {
                let [x, y] = &slopes.planes;
                let gradients = Gradients { planes: [x, y], mask: &slopes.mask };
                Ok((plan.reconstruct_gradients(samples, &gradients, out, run)?, Effect::default()))
            }
            (None, guides) => {
                let outcome = match error {
                    Some(error) => plan.reconstruct_roughly(samples, error, out, run)?,
                    None => plan.reconstruct(samples, out, run)?,
                };
                let Some(guides) = guides else { return Ok((outcome, Effect::default())) };
                let (second, effect) =
                    guided::steer((method.filter(), plan), mask, samples, guides, out, run)?;
                Ok((outcome.worst(second), effect))
            }
        }
    }
}

/// Samples of the gradients of a set: known where those of all its planes are.
struct Slopes {
    planes: [Planes; 2],
    mask: Mask,
}

impl Slopes {
    /// Those that were given, if the method uses them and every plane has some.
    fn new(options: &Options<'_>, method: &Method, places: &[usize], mask: &Mask) -> Option<Self> {
        if !method.descriptor().takes.gradients {
            return None;
        }
        let all: Vec<&[Plane; 2]> =
            places.iter().map(|&at| options.gradients.get(at)?.as_ref()).collect::<Option<_>>()?;
        let mut flags = vec![true; mask.size().pixels()];
        for plane in all.iter().copied().flatten() {
            flags.iter_mut().zip(plane.pixels()).for_each(|(flag, slope)| *flag &= slope.is_finite());
        }
        let known = |plane: &Plane| {
            let slopes = plane.pixels().iter().zip(&flags);
            Plane::of(mask.size(), slopes.map(|(&slope, &flag)| if flag { slope } else { 0.0 }).collect())
        };
        let axis =
            |axis: usize| Planes::of(mask.size(), all.iter().map(|planes| known(&planes[axis])).collect());
        let planes = [axis(0), axis(1)];
        Some(Self { planes, mask: Mask::of(mask.size(), flags) })
    }

    /// The gradients of mapped values, by the chain rule; known only where the values themselves are.
    fn mapped(&self, map: Map, samples: &Planes, measured: &Mask) -> Self {
        let both = self.mask.as_slice().iter().zip(measured.as_slice()).map(|(a, b)| *a && *b).collect();
        let mut planes = self.planes.clone();
        for planes in &mut planes {
            for (plane, samples) in planes.as_mut_slice().iter_mut().zip(samples.as_slice()) {
                for (slope, value) in plane.pixels_mut().iter_mut().zip(samples.pixels()) {
                    *slope *= map.slope(*value);
                }
            }
        }
        Self { planes, mask: Mask::of(self.mask.size(), both) }
    }
}

/// Weights over their mean over the measured pixels that have any, so that the settings mean what they mean without weights; and how
/// many measured pixels have none.
fn weigh(weights: &Plane, mask: &Mask) -> Result<(Arc<Plane>, usize), Error> {
    let usable = |weight: f32| if weight.is_finite() && weight > 0.0 { weight } else { 0.0 };
    let pairs = || weights.pixels().iter().zip(mask.as_slice());
    let measured = || pairs().filter(|(_, flag)| **flag).map(|(&weight, _)| usable(weight));
    let sum: f64 = measured().map(f64::from).sum();
    if sum <= 0.0 {
        return Err(Error::NothingWeighs);
    }
    let weightless = measured().filter(|&weight| weight == 0.0).count();
    let mean = sum / (mask.count() - weightless) as f64;
    let relative = weights.pixels().iter().map(|&weight| (f64::from(usable(weight)) / mean) as f32).collect();
    Ok((Arc::new(Plane::of(mask.size(), relative)), weightless))
}

/// The limiter, except that values may go as far as the guides predict; returns how many were moved, and how far.
fn limit_guided(mask: &Mask, samples: &Plane, predicted: &Plane, out: &mut Plane) -> Result<Moved, Error> {
    let free = out.clone();
    limiter::local(mask, samples, out)?;
    let mut moved = Moved::default();
    for ((value, &free), &predicted) in out.pixels_mut().iter_mut().zip(free.pixels()).zip(predicted.pixels())
    {
        if predicted.is_finite() {
            *value = free.clamp(value.min(predicted), value.max(predicted));
        }
        moved += Moved::between(free, *value);
    }
    Ok(moved)
}

/// A method that smooths may take measured pixels out of the bounds as well; returns how many were moved back, and how far.
fn bound_measured(bounds: Bounds, mask: &Mask, samples: &Plane, out: &mut Plane) -> Moved {
    let measured = samples.pixels().iter().zip(mask.as_slice()).filter(|(_, flag)| **flag);
    let (low, high) = bounds.range(measured.map(|(value, _)| *value));
    let mut moved = Moved::default();
    for (value, _) in out.pixels_mut().iter_mut().zip(mask.as_slice()).filter(|(_, flag)| **flag) {
        let free = *value;
        *value = free.clamp(low, high);
        moved += Moved::between(free, *value);
    }
    moved
}

/// Values near the end of a float's range can overflow inside a method; such pixels take the nearest one of `samples`, whose
/// place `of` tells for every pixel of `out`. Returns how many did.
pub(crate) fn mend<N>(
    samples: &Plane,
    out: &mut Plane,
    nearest: impl FnOnce() -> Result<N, Error>,
    of: impl Fn(&N) -> &[u32],
) -> Result<usize, Error> {
    let count = |piece: &[f32]| piece.iter().filter(|value| !value.is_finite()).count();
    let bad: usize = out.pixels().par_chunks(PIECE).map(count).into_iter().sum();
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
