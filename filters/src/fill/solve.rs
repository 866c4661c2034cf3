//! One set of planes: into the value domain, method, back, mended, limited, bounded.

use std::sync::Arc;

use lacuna_core::parallel::prelude::*;

use super::finish::{bound_measured, limit_guided, mend};
use super::task::{Learned, Slopes, Task, shown};
use super::{Estimate, Options, PIECE, Set, Values};
use crate::choose::{Chosen, Given};
use crate::decided::Decided;
use crate::domain::{Domain, Map};
use crate::estimate::Model;
use crate::limiter::Moved;
use crate::noise::{self, Known, Noise, Split};
use crate::sampling::refine;
use crate::temporal::Carried;
use crate::variational::guided::{self, Effect};
use crate::variational::ss;
use crate::{Bounds, Error, Mask, Method, Outcome, Plane, Planes, Plans, Run, Size, limiter};

/// Solves for the missing pixels of `samples`, whose measured ones are finite; `places` are those of the planes in their group.
/// Returns the planes, per plane how many values the limiter or a bound moved, and what was decided.
pub fn solve(
    samples: &Planes,
    (mask, places): (&Arc<Mask>, Vec<usize>),
    options: &Options<'_>,
    plans: &Plans,
    run: &Run<'_>,
) -> Result<(Planes, Vec<Moved>, Set), Error> {
    let (weights, weightless) = match &options.weights {
        Some(weights) => weigh(weights, mask).map(|(plane, weightless)| (Some(plane), weightless))?,
        None => (None, 0),
    };
    // What counts no sample was not measured.
    let counting = weights.as_ref().filter(|_| weightless > 0 && options.noise != Noise::None);
    let counting = counting.map(|weights| Arc::new(counted(mask, weights)));
    let case = Case {
        samples,
        mask: counting.as_ref().unwrap_or(mask),
        places: &places,
        options,
        weights: weights.as_ref(),
        noise: like(options, samples.size(), &places),
        plans,
        run,
    };
    let fits = options.method.planes().is_none_or(|planes| planes == samples.len());
    let method = if fits { options.method.clone() } else { Method::default() };
    let mut out = Planes::zeros(samples.size(), samples.len());
    // A method that chooses how much to smooth does so by itself.
    let smooths = options.noise != Noise::None && !method.is_open();
    let smoothed = if smooths { case.smooth(&mut out)? } else { None };
    let mut made = match smoothed {
        Some((outcome, decided)) => {
            let map = Domain::Linear.map(case.mask, samples.as_slice());
            Made { method, map, outcome, decided, learned: None, settled: Vec::new(), smoothed: true }
        }
        None => case.fill(method, &mut out)?,
    };
    let (mended, limited) = case.finish(&mut made, &mut out)?;
    let set = case.told(made, mended)?;
    Ok((out, limited, Set { weightless, ..set }))
}

/// Planes to fill, and all that says how.
struct Case<'a> {
    samples: &'a Planes,
    mask: &'a Arc<Mask>,
    /// Those of the planes in their group.
    places: &'a [usize],
    options: &'a Options<'a>,
    /// Over their mean.
    weights: Option<&'a Arc<Plane>>,
    /// Noise like that of the samples, if it is known.
    noise: Option<Planes>,
    plans: &'a Plans,
    run: &'a Run<'a>,
}

/// What was made of the planes, and how.
struct Made {
    method: Method,
    map: Map,
    outcome: Outcome,
    decided: Decided,
    learned: Option<Learned>,
    settled: Vec<Chosen>,
    /// Whether noise was smoothed, not the method run.
    smoothed: bool,
}

impl Case<'_> {
    fn is_light(&self) -> bool {
        self.options.values == Values::Light
    }

    /// Fills and smooths noise at once; nothing where the samples tell of none.
    fn smooth(&self, out: &mut Planes) -> Result<Option<(Outcome, Decided)>, Error> {
        let (guides, light) = (self.options.guides, self.is_light());
        let known = Known { guides, noise: self.noise.as_ref(), weights: self.weights, light };
        noise::reconstruct(self.mask, self.samples, known, out, self.run)
    }

    /// Fills by the method, and learns how wrong it is.
    fn fill(&self, method: Method, out: &mut Planes) -> Result<Made, Error> {
        let Self { samples, mask, places, options, weights, plans, run, .. } = *self;
        let domain = if self.is_light() { options.domain } else { Domain::Linear };
        let map = domain.map(mask, samples.as_slice());
        let (method, settled, clean) = self.settle(method, map)?;
        let plan = plans.filter(&method, mask, weights, run)?;
        let gradients = Slopes::new(options, &method, places, mask);
        let carried: Vec<Carried> =
            options.carried.iter().map(|carried| carried.select(places).mapped(map)).collect();
        let plan = plan.as_ref();
        let takes = method.descriptor().takes.guides && method.keeps_measured();
        let guides = options.guides.filter(|_| takes && mask.count() >= guided::FEWEST);
        let task = Task { method: &method, plan, mask, options, guides, carried: &carried, error: None, run };
        let values = (clean.as_ref().unwrap_or(samples), gradients.as_ref());
        let (outcome, mut decided) = task.reconstruct(values, map, out)?;
        let learned = if options.estimate == Estimate::No {
            None
        } else {
            let bounds = bounds(options, (mask, samples), places);
            task.learn(values, out, (map, &bounds), &mut decided)?
        };
        Ok(Made { method, map, outcome, decided, learned, settled, smoothed: false })
    }

    /// Mends, limits and bounds the planes: how many values were mended, and per plane how many moved.
    fn finish(&self, made: &mut Made, out: &mut Planes) -> Result<(usize, Vec<Moved>), Error> {
        let Self { samples, mask, places, options, plans, .. } = *self;
        let keeps = !made.smoothed && made.method.keeps_measured();
        let (mut mended, mut limited) = (0, Vec::with_capacity(places.len()));
        let Decided { guided, along, .. } = &made.decided;
        // What other frames know may lie beyond what the samples allow, what guides know beyond what those around do.
        let limit = options.limit && options.values != Values::Directions && along.is_none();
        let guides = options.guides.filter(|_| guided.gain.is_some());
        for ((samples, out), &place) in samples.as_slice().iter().zip(out.as_mut_slice()).zip(places) {
            mended += mend(samples, out, || plans.nearest(mask), |nearest| nearest.as_slice())?;
            let mut moved = Moved::default();
            if limit {
                // What was smoothed counts as it is now.
                let smooth = made.smoothed.then(|| out.clone());
                let around = smooth.as_ref().unwrap_or(samples);
                moved += match guides {
                    Some(guides) => limit_guided(guides, mask, around, out)?,
                    None => limiter::local(mask, around, out)?,
                };
            }
            let bounds = options.bounds_of(place);
            if bounds != Bounds::Free {
                moved += limiter::range(mask, samples, out, bounds)?;
                if limit && keeps && guided.gain.is_none() {
                    moved += limiter::on_black(mask, samples, out, || plans.nearest(mask))?;
                }
                if !keeps {
                    moved += bound_measured(bounds, mask, samples, out);
                }
            }
            limited.push(moved);
        }
        Ok((mended, limited))
    }

    /// What is told of the planes: how they were made, how many of their values were mended, and how wrong they are.
    fn told(&self, made: Made, mended: usize) -> Result<Set, Error> {
        let Made { method, map, outcome, decided, learned, settled, smoothed } = made;
        let Decided { guided: Effect { guides, gain }, shares, along, .. } = decided;
        let wanted = learned.as_ref().filter(|_| self.options.estimate == Estimate::Pixels);
        let errors = wanted.map(|learned| self.errors(&learned.model)).transpose()?;
        let exponent = learned.as_ref().map(|learned| learned.model.exponent());
        let (estimate, unclipped) = learned.map(Learned::verdicts).unzip();
        Ok(Set {
            planes: self.places.to_vec(),
            mask: Arc::clone(self.mask),
            method,
            map,
            outcome,
            mended,
            guides,
            gain,
            shares,
            along,
            estimate,
            unclipped: unclipped.flatten(),
            exponent,
            errors,
            weightless: 0,
            smoothed,
            settled,
            copied: false,
        })
    }

    /// The estimated error of every pixel.
    fn errors(&self, model: &Model) -> Result<Plane, Error> {
        // The shape must count values as the model does, in one unit all over the image.
        if !self.is_light() || model.is_chosen() {
            return Ok(model.plane(None));
        }
        let settings = ss::Settings::default();
        let left_out =
            refine::estimate_spline(&shown(self.samples, self.options.peak), self.mask, &settings, self.run)?;
        Ok(model.plane(Some(&|pixel| left_out.squared_error(pixel))))
    }

    /// A method whose settings are left to the samples with those that they choose, what was chosen, and the samples without fireflies
    /// where these are known and it smooths.
    fn settle(&self, method: Method, map: Map) -> Result<(Method, Vec<Chosen>, Option<Planes>), Error> {
        let (mask, light, noise) = (self.mask, self.is_light(), self.noise.as_ref());
        if !method.is_open() {
            return Ok((method, Vec::new(), None));
        }
        if !light && noise.is_none() {
            return Ok((method.unsmoothed()?, Vec::new(), None));
        }
        // Neither fireflies nor lights choose.
        let split = Split::new(mask, self.samples, noise, light);
        let (seen, noise) = mapped(map, mask, &split.samples, split.noise.as_ref());
        let given = Given { mask, samples: &seen, noise: noise.as_ref(), weights: self.weights };
        let (method, settled) = method.settled(&given, self.run)?;
        let clean = if method.keeps_measured() { None } else { split.without_fireflies() };
        Ok((method, settled, clean))
    }
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

/// The measured pixels that count a sample.
fn counted(mask: &Mask, weights: &Plane) -> Mask {
    let pairs = mask.as_slice().iter().zip(weights.pixels());
    Mask::of(mask.size(), pairs.map(|(flag, weight)| *flag && *weight > 0.0).collect())
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
