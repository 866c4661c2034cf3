//! Guided enlargement: complete planes of the larger size (normals, depth, albedo) say how colour runs within a small pixel.
//!
//! Given small pixels `y`, the plan's model `R` and guides `g` at the larger size,
//!
//! ```text
//! p = a . g + b           a, b: the regression of y on R g around each small pixel (`fit`), enlarged bilinearly
//! g = p + S (y - R p)     what the guides say, with the means of the small pixels
//! x = e + d - S R d,  d = t (g - e)       e: the image without guides; t: trust, 0 to 1
//! ```
//!
//! with `S y` the spline of the small pixels and `e` that spline, for boxes smoothed along edges. So `R x = y` holds as without guides, and
//! where `t` is 0 the result is what it is without them, bit for bit where it is 0 everywhere.
//!
//! The trust is that of [`crate::variational::guided`]: small pixels are joined two by two, the frame of a quarter of the pixels is
//! enlarged both ways, along edges as well, and both are compared with the small pixels, which neither saw. (Compared with the spline alone,
//! guides were taken that lose to its smoothing along edges.) There guides are means of many samples; at the
//! larger size they may be one a pixel, and their noise is the larger the smaller the pixels. So the same is done with pixels
//! joined four by four, and both errors are carried on to the larger size as they went from there to here. Guides that do not predict
//! end up at 0, and a frame in which they take less than a few percent of the squared error away is left to the spline.
//! Pixels whose guides are not numbers take nothing from them. Labels count for nothing: they have no slope.
//!
//! Diffuse light is close to a quadratic function of the normal, so the products of a normal's components are guides as well, where
//! the frame's held-out error is less with them.
//!
//! Cost: the regression below, three more passes of the spline, and twice the same of the small pixels; memory: three planes of the result a channel.
//! Fails: what no guide sees (shadows, mirrors) stays as soft as the small pixels.
//!
//! References: K. He, J. Sun, X. Tang, "Guided Image Filtering", IEEE Transactions on Pattern Analysis and Machine Intelligence 35(6),
//! 2013 (equations 5 and 6, here with several guides and weights); J. Kopf, M. Cohen, D. Lischinski, M. Uyttendaele, "Joint
//! Bilateral Upsampling", SIGGRAPH 2007 (the setting); R. Ramamoorthi, P. Hanrahan, "An Efficient Representation for Irradiance Environment
//! Maps", SIGGRAPH 2001 (the quadratic).

mod fit;
#[cfg(test)]
mod tests;

use lacuna_core::parallel::prelude::*;

use self::fit::{Fit, Term};
use super::bounds::difference;
use super::{Axis, Geometry, Hint, Method, Plan, Sampling, apply};
use crate::kernel::{Isa, vector};
use crate::operator::taps::Taps;
use crate::variational::guided::{Guides, Trust, WORTH, Weights};
use crate::{Error, Mask, Plane, Planes, Run};

/// Small pixels of the side of a cell in which the trust is one number.
const CELL: usize = 2;
/// Fewer small pixels along a side say nothing about guides: too few are left of them joined two by two.
pub const FEWEST: usize = 32;
/// Pixels that one task of a loop over planes takes.
const PART: usize = 1 << 16;

/// What guides do to a group of channels.
#[derive(Clone, Debug)]
pub struct Steer {
    /// What is to be added to the spline, channel by channel.
    pub changes: Vec<Plane>,
    /// The guides that are not constant.
    pub guides: Vec<String>,
    /// The part of the squared error that they take away, as small pixels show.
    pub gain: f64,
}

/// What `guides` of the larger size do to complete small pixels; nothing where they gain too little, or a side has less than [`FEWEST`].
///
/// # Errors
/// [`Error::SizeMismatch`].
pub fn steer(plan: &Plan, samples: &Planes, guides: &Guides, run: &Run<'_>) -> Result<Option<Steer>, Error> {
    let (low, high) = (plan.geometry.low(), plan.geometry.high());
    if guides.size() != high {
        return Err(Error::size(high, "guides", guides.size()));
    }
    if guides.planes().is_empty() || samples.is_empty() || low.height.min(low.width) < FEWEST {
        return Ok(None);
    }
    let fine = terms(guides);
    let coarse: Vec<Plane> = fine.iter().map(|term| plan.model.reduce(&term.plane())).collect();
    if run.interrupted().is_some() {
        return Ok(None);
    }
    let is_box = plan.geometry.sampling == Sampling::Box;
    let near = Joined::new(samples, &coarse, is_box, run)?;
    let far = Joined::new(&near.samples, &near.guides, is_box, run)?;
    let octaves = 0.5 * (plan.geometry.vertical.scale * plan.geometry.horizontal.scale).log2();
    let judge = |count: usize| {
        let trust = near.judge(samples, &coarse[..count]);
        trust.carried(&far.judge(&near.samples, &near.guides[..count]), octaves)
    };
    if run.interrupted().is_some() {
        return Ok(None);
    }
    let mut count = guides.planes().len();
    let mut trust = judge(count);
    if fine.len() > count {
        let other = judge(fine.len());
        if other.worth() > trust.worth() {
            (trust, count) = (other, fine.len());
        }
    }
    let gain = trust.worth();
    if gain < WORTH || run.interrupted().is_some() {
        return Ok(None);
    }
    let (fine, coarse) = (&fine[..count], &coarse[..count]);
    let geometry = &plan.geometry;
    let predicted = Fit { guides: coarse, fine, geometry }.predict(samples);
    let mut share = apply(
        &[geometry.vertical, geometry.horizontal].map(|axis| bilinear(&axis, geometry.sampling).rows()),
        &trust.plane(low),
    );
    guides.forget_unknown(&mut share);
    let change = |(predicted, samples): (Plane, &Plane)| plan.change(predicted, samples, &share, run);
    let changes = predicted.into_vec().into_iter().zip(samples.as_slice()).map(change).collect();
    if run.interrupted().is_some() {
        return Ok(None);
    }
    Ok(Some(Steer { changes, guides: guides.names().to_vec(), gain }))
}

impl Plan {
    /// What the samples become without guides, but for highlights and bounds.
    fn plain(&self, samples: &Plane, run: &Run<'_>) -> Plane {
        let mut plane = self.spline(samples);
        if self.geometry.sampling == Sampling::Box {
            // Where someone wants the end the spline stays.
            self.along_edges(samples, Hint::None, &mut plane, run).ok();
        }
        plane
    }

    /// What is to be added to the spline of samples for a share of what guides predict.
    fn change(&self, predicted: Plane, samples: &Plane, share: &Plane, run: &Run<'_>) -> Plane {
        let isa = Isa::best();
        let plain = self.plain(samples, run);
        let mut other = self.spline(&difference(&self.model.reduce(&predicted), samples));
        vector::add_scaled(isa, other.pixels_mut(), 1.0, plain.pixels());
        let mut change = predicted;
        let parts = other.pixels().par_chunks(PART).zip(share.pixels().par_chunks(PART));
        change.pixels_mut().par_chunks_mut(PART).zip(parts).for_each(|(change, (other, share))| {
            for ((change, other), share) in change.iter_mut().zip(other).zip(share) {
                let difference = share * (*change - other);
                *change = if difference.is_finite() { difference } else { 0.0 };
            }
        });
        let less = self.spline(&self.model.reduce(&change));
        for (factor, plane) in [(-1.0, less), (1.0, plain), (-1.0, self.spline(samples))] {
            vector::add_scaled(isa, change.pixels_mut(), factor, plane.pixels());
        }
        change
    }

    /// Guides of the larger size as the small pixels see them.
    pub(crate) fn smaller(&self, guides: &Guides) -> Result<Guides, Error> {
        let high = self.geometry.high();
        if guides.size() != high {
            return Err(Error::size(high, "guides", guides.size()));
        }
        Ok(guides.reduced(self.geometry.low(), |plane| self.model.reduce(plane)))
    }
}

/// The guides, then the products of the components of each normal.
fn terms(guides: &Guides) -> Vec<Term<'_>> {
    let planes = guides.planes();
    let mut terms: Vec<Term<'_>> = planes.iter().map(Term::Plane).collect();
    let component = |at: usize| (&planes[at], guides.centres()[at]);
    for normal in guides.normals() {
        for (at, &one) in normal.iter().enumerate() {
            terms.extend(normal[at..].iter().map(|&other| Term::product(component(one), component(other))));
        }
    }
    terms
}

/// Pixels joined two by two: the frame that is enlarged both ways to judge guides.
struct Joined {
    plan: Plan,
    samples: Planes,
    /// What the joined samples become without guides.
    plain: Planes,
    guides: Vec<Plane>,
}

impl Joined {
    fn new(samples: &Planes, guides: &[Plane], along_edges: bool, run: &Run<'_>) -> Result<Self, Error> {
        let size = samples.size();
        let half =
            |pixels: usize| Axis { inputs: pixels.div_ceil(2), outputs: pixels, scale: 2.0, shift: 0.0 };
        let geometry =
            Geometry { vertical: half(size.height), horizontal: half(size.width), sampling: Sampling::Box };
        let plan = Plan::new(geometry, Method::Ss)?;
        let reduce = |planes: &[Plane]| planes.iter().map(|plane| plan.model.reduce(plane)).collect();
        let joined = Planes::of(geometry.low(), reduce(samples.as_slice()));
        let plain = |plane| if along_edges { plan.plain(plane, run) } else { plan.spline(plane) };
        let plain = Planes::of(size, joined.as_slice().iter().map(plain).collect());
        let guides = reduce(guides);
        Ok(Self { plan, samples: joined, plain, guides })
    }

    /// Compares the plain and the guided image with the pixels that were joined, by the first guides.
    fn judge(&self, truth: &Planes, fine: &[Plane]) -> Trust {
        let (plan, size) = (&self.plan, truth.size());
        let terms: Vec<Term<'_>> = fine.iter().map(Term::Plane).collect();
        let fit = Fit { guides: &self.guides[..fine.len()], fine: &terms, geometry: &plan.geometry };
        let predicted = fit.predict(&self.samples).into_vec().into_iter().zip(self.samples.as_slice());
        let guided = predicted.map(|(mut predicted, joined)| {
            let mut left = joined.clone();
            let seen = plan.model.reduce(&predicted);
            left.pixels_mut().iter_mut().zip(seen.pixels()).for_each(|(left, seen)| *left -= seen);
            let spline = plan.spline(&left);
            predicted.pixels_mut().iter_mut().zip(spline.pixels()).for_each(|(value, more)| *value += more);
            predicted
        });
        let guided = Planes::of(size, guided.collect());
        let all = Mask::from_fn(size, |_, _| true);
        let pixels = (0..size.height).flat_map(|row| (0..size.width).map(move |column| (row, column)));
        Trust::in_cells(CELL, pixels, (truth, Weights::new(&all, truth)), &self.plain, &guided)
    }
}

/// Where a high-resolution pixel lies between two low-resolution ones: the first of them, and the share of the second.
fn between(axis: &Axis, sampling: Sampling, output: usize) -> (usize, f64) {
    let at = match sampling {
        Sampling::Grid => output as f64 / axis.scale,
        _ => axis.centre(output) - 0.5,
    };
    let at = at.clamp(0.0, axis.inputs as f64 - 1.0);
    let first = (at as usize).min(axis.inputs.saturating_sub(2));
    (first, at - first as f64)
}

/// Straight lines between the centres of low-resolution pixels.
pub(super) fn bilinear(axis: &Axis, sampling: Sampling) -> Taps {
    let row = |output| {
        let (first, share) = between(axis, sampling, output);
        (first, if axis.inputs == 1 { vec![1.0] } else { vec![1.0 - share, share] })
    };
    Taps::from_rows(axis.inputs, (0..axis.outputs).map(row))
}
