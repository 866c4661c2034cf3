//! A method on a mask, run in the value domain, guided or not, and what its errors at held-out samples teach.

use std::sync::Arc;

use lacuna_core::parallel::prelude::*;

use super::{Estimate, Options, PIECE, Values};
use crate::auto::Blend;
use crate::decided::Decided;
use crate::domain::Map;
use crate::estimate::held_out;
use crate::estimate::{Evidence, Folds, Model, Repeated, Rmse, Rounds, Verdict, Why};
use crate::excerpt::Excerpt;
use crate::temporal::Carried;
use crate::variational::guided::{self, Guides};
use crate::{Error, Gradients, Mask, Method, Outcome, Plan, Plane, Planes, Problem, Run};

/// A method that is ready to run on a mask.
pub struct Task<'a> {
    pub method: &'a Method,
    pub plan: &'a dyn Plan,
    pub mask: &'a Arc<Mask>,
    pub options: &'a Options<'a>,
    /// Those that the method takes.
    pub guides: Option<&'a Guides>,
    /// Of the set's planes, in the domain.
    pub carried: &'a [Carried],
    /// What the result may be off by, over the range of the samples, where less than the usual will do.
    pub error: Option<f64>,
    pub run: &'a Run<'a>,
}

impl Task<'_> {
    /// How wrong the method is on this mask, from its own evidence where it says so itself, and else from fills without some of the samples;
    /// nothing where those would take too long, or the method smooths, so that its error at a sample is not that beside it.
    pub fn learn(
        &self,
        (samples, gradients): (&Planes, Option<&Slopes>),
        filled: &Planes,
        (map, bounds): (Map, &[(f32, f32)]),
        decided: &mut Decided,
    ) -> Result<Option<Learned>, Error> {
        let folds = Folds::default();
        let Some(kind) = self.method.descriptor().held_out.filter(|_| self.method.keeps_measured()) else {
            return Ok(None);
        };
        let mut evidence = if let Some(evidence) = decided.evidence.take() {
            evidence
        } else {
            let error = Some(held_out::exactness(self.mask));
            let mut again = |excerpt: Option<&Excerpt>, samples: &Planes, kept: &Arc<Mask>| {
                let plan = self.method.filter().plan(&Problem::fill(Arc::clone(kept)), self.run)?;
                let small = self.guides.zip(excerpt).map(|(guides, excerpt)| guides.within(excerpt));
                let guides = small.as_ref().or(self.guides);
                let task = Task { plan: plan.as_ref(), mask: kept, guides, error, ..*self };
                let mut out = Planes::zeros(samples.size(), samples.len());
                task.reconstruct((samples, gradients), map, &mut out)?;
                Ok(out)
            };
            // Samples of gradients are in no excerpt.
            let filled = Some(filled).filter(|_| gradients.is_none());
            let own = Repeated::default();
            let rounds = self.rounds(&own);
            Evidence::of_folds((samples, self.mask), filled, (folds, kind), rounds, &mut again, self.run)?
        };
        if self.run.interrupted().is_some() {
            return Ok(None);
        }
        // What guides leave of a texture hardly goes by the pattern of the samples, although it grows without half of them; a simulation shows it.
        if evidence.simulation.is_none() && evidence.repetition.is_none() {
            evidence.own *= 1.0 - decided.guided.gain.unwrap_or(0.0);
        }
        // What is beyond them does not stay so.
        evidence.map(|channel, value| value.clamp(bounds[channel].0, bounds[channel].1));
        let model =
            |evidence: &Evidence, samples: &Planes| Model::new(evidence, samples, self.mask, folds.seed);
        if self.options.values != Values::Light {
            return Ok(Some(Learned { model: model(&evidence, samples), unclipped: None }));
        }
        let peak = self.options.peak;
        let beyond = samples.as_slice().iter().any(|plane| {
            let values = plane.pixels().iter().zip(self.mask.as_slice());
            values.into_iter().any(|(value, flag)| *flag && !(0.0..=peak).contains(value))
        });
        let unclipped = beyond.then(|| model(&evidence, samples).verdict());
        evidence.map(|_, value| value.clamp(0.0, peak));
        Ok(Some(Learned { model: model(&evidence, &shown(samples, peak)), unclipped }))
    }

    /// Where groups of the frame share what rounds chose, or a place of its own.
    fn rounds<'b>(&'b self, own: &'b Repeated) -> Rounds<'b> {
        let are_colours = self.options.values == Values::Light;
        Rounds { repeated: self.options.repeated.unwrap_or(own), are_colours }
    }

    /// The method within the value domain.
    pub fn reconstruct(
        &self,
        (samples, gradients): (&Planes, Option<&Slopes>),
        map: Map,
        out: &mut Planes,
    ) -> Result<(Outcome, Decided), Error> {
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
        out.as_mut_slice().iter_mut().for_each(|plane| map.inverse_plane(plane));
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
    ) -> Result<(Outcome, Decided), Error> {
        let Self { method, plan, mask, options, guides, carried, error, run } = *self;
        match (gradients, guides) {
            (None, guides) if let Some(blend) = Blend::of(plan) => {
                let own = Repeated::default();
                let learn = (options.estimate != Estimate::No).then(|| self.rounds(&own));
                blend.choose((samples, map), (guides, carried), learn, out, run)
            }
            (Some(slopes), _) => {
                let [x, y] = &slopes.planes;
                let gradients = Gradients { planes: [x, y], mask: &slopes.mask };
                Ok((plan.reconstruct_gradients(samples, &gradients, out, run)?, Decided::default()))
            }
            (None, guides) => {
                let outcome = match error {
                    Some(error) => plan.reconstruct_roughly(samples, error, out, run)?,
                    None => plan.reconstruct(samples, out, run)?,
                };
                let Some(guides) = guides else { return Ok((outcome, Decided::default())) };
                let (second, effect) =
                    guided::steer((method.filter(), plan), mask, samples, guides, out, run)?;
                Ok((outcome.worst(second), effect.into()))
            }
        }
    }
}

/// What held-out samples teach.
pub struct Learned {
    /// Of light as it is compared.
    pub model: Model,
    /// What is said of light as it is, where that is another.
    unclipped: Option<Verdict>,
}

impl Learned {
    /// What is said of the error, and of that without clipping.
    pub fn verdicts(self) -> (Verdict, Option<Verdict>) {
        let none =
            |verdict: &Verdict| matches!(verdict, Verdict::Estimate(Rmse { high, .. }) if *high == 0.0);
        let estimate = self.model.verdict();
        let hidden = none(&estimate) && self.unclipped.as_ref().is_some_and(|verdict| !none(verdict));
        (if hidden { Verdict::CannotTell(Why::Clipped) } else { estimate }, self.unclipped)
    }
}

/// Samples of the gradients of a set: known where those of all its planes are.
pub struct Slopes {
    planes: [Planes; 2],
    mask: Mask,
}

impl Slopes {
    /// Those that were given, if the method uses them and every plane has some.
    pub fn new(options: &Options<'_>, method: &Method, places: &[usize], mask: &Mask) -> Option<Self> {
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

/// Light as it is compared: a highlight counts as what can be shown of it.
pub fn shown(samples: &Planes, peak: f32) -> Planes {
    let mut shown = samples.clone();
    for plane in shown.as_mut_slice() {
        plane.pixels_mut().par_chunks_mut(PIECE).for_each(|values| {
            for value in values {
                *value = value.clamp(0.0, peak);
            }
        });
    }
    shown
}
