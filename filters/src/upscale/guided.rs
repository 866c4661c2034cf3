//! Guided enlargement: complete planes of the larger size (normals, depth, albedo) say how colour runs within a small pixel.
//!
//! Given small pixels `y`, the plan's model `R` and guides `g` at the larger size,
//!
//! ```text
//! p = a . g + b           a, b: the regression of y on R g around each small pixel (`fit`), enlarged bilinearly
//! d = p - S R p           what the guides know beyond the spline S y of the small pixels
//! x = S (y - R t d) + t d                 t: trust, 0 to 1
//! ```
//!
//! so `R x = y` holds as without guides, and where `t` is 0 the result is the spline's, bit for bit where it is 0 everywhere.
//!
//! The trust is that of [`crate::variational::guided`]: small pixels are joined two by two, the frame of a quarter of the pixels is
//! enlarged both ways, and both are compared with the small pixels, which neither saw. Guides that do not predict
//! end up at 0 there, and a frame in which they take less than a few percent of the squared error away is left to the spline.
//! Pixels whose guides are not numbers take nothing from them. Labels count for nothing: they have no slope.
//!
//! Cost: the regression below, three more passes of the spline; memory: three planes of the result a channel.
//! Fails: what no guide sees (shadows, mirrors) stays as soft as the small pixels.
//!
//! References: K. He, J. Sun, X. Tang, "Guided Image Filtering", IEEE Transactions on Pattern Analysis and Machine Intelligence 35(6),
//! 2013 (equations 5 and 6, here with several guides and weights); J. Kopf, M. Cohen, D. Lischinski, M. Uyttendaele, "Joint
//! Bilateral Upsampling", SIGGRAPH 2007 (the setting).

mod fit;
#[cfg(test)]
mod tests;

use lacuna_core::parallel::prelude::*;

use self::fit::Fit;
use super::{Axis, Geometry, Method, Plan, Sampling, apply};
use crate::variational::guided::{Guides, Trust, WORTH, Weights};
use crate::{Error, Mask, Plane, Planes, Run, Size};

/// Small pixels of the side of a cell in which the trust is one number.
const CELL: usize = 2;
/// Fewer small pixels along a side say nothing about guides.
const FEWEST: usize = 16;
/// Pixels that one task of a loop over planes takes.
const PART: usize = 1 << 16;

/// What guides do to a group of channels.
#[derive(Clone, Debug)]
pub struct Steer {
    /// What is to be added to the spline, channel by channel, before its own reduction is taken off.
    pub changes: Vec<Plane>,
    /// The guides that are not constant.
    pub guides: Vec<String>,
    /// The part of the squared error that they take away, as small pixels show.
    pub gain: f64,
}

/// What `guides` of the larger size do to complete small pixels; nothing where they gain too little.
///
/// # Errors
/// [`Error::SizeMismatch`].
pub fn steer(plan: &Plan, samples: &Planes, guides: &Guides, run: &Run<'_>) -> Result<Option<Steer>, Error> {
    let (low, high) = (plan.geometry.low(), plan.geometry.high());
    if guides.size() != high {
        return Err(Error::SizeMismatch { expected: high, found: guides.size().to_string() });
    }
    let fine = guides.planes();
    if fine.is_empty() || samples.is_empty() || low.height.min(low.width) < FEWEST {
        return Ok(None);
    }
    let coarse: Vec<Plane> = fine.iter().map(|plane| plan.model.reduce(plane)).collect();
    let (trust, gain) = judge(low, samples, &coarse)?;
    if gain < WORTH || run.interrupted().is_some() {
        return Ok(None);
    }
    let geometry = &plan.geometry;
    let predicted = Fit { guides: &coarse, fine, geometry }.predict(samples);
    let mut share = apply(
        &[geometry.vertical, geometry.horizontal].map(|axis| bilinear(&axis, geometry.sampling)),
        &trust,
    );
    guides.forget_unknown(&mut share);
    let change = |predicted: Plane| {
        let spline = plan.spline(&plan.model.reduce(&predicted));
        let mut change = predicted;
        let parts = spline.pixels().par_chunks(PART).zip(share.pixels().par_chunks(PART));
        change.pixels_mut().par_chunks_mut(PART).zip(parts).for_each(|(change, (spline, share))| {
            for ((change, spline), share) in change.iter_mut().zip(spline).zip(share) {
                let difference = share * (*change - spline);
                *change = if difference.is_finite() { difference } else { 0.0 };
            }
        });
        change
    };
    let changes = predicted.into_vec().into_iter().map(change).collect();
    Ok(Some(Steer { changes, guides: guides.names().to_vec(), gain }))
}

impl Plan {
    /// Guides of the larger size as the small pixels see them.
    pub(crate) fn smaller(&self, guides: &Guides) -> Result<Guides, Error> {
        let high = self.geometry.high();
        if guides.size() != high {
            return Err(Error::SizeMismatch { expected: high, found: guides.size().to_string() });
        }
        Ok(guides.reduced(self.geometry.low(), |plane| self.model.reduce(plane)))
    }
}

/// How far guides are trusted at each small pixel, and what that takes of the squared error: both ways from joined pixels.
fn judge(low: Size, samples: &Planes, guides: &[Plane]) -> Result<(Plane, f64), Error> {
    let half = |pixels: usize| Axis { inputs: pixels.div_ceil(2), outputs: pixels, scale: 2.0, shift: 0.0 };
    let geometry =
        Geometry { vertical: half(low.height), horizontal: half(low.width), sampling: Sampling::Box };
    let plan = Plan::new(geometry, Method::Ss)?;
    let reduce = |planes: &[Plane]| planes.iter().map(|plane| plan.model.reduce(plane)).collect::<Vec<_>>();
    let joined = Planes::of(geometry.low(), reduce(samples.as_slice()));
    let coarse = reduce(guides);
    let plain: Vec<Plane> = joined.as_slice().iter().map(|plane| plan.spline(plane)).collect();
    let predicted = Fit { guides: &coarse, fine: guides, geometry: &geometry }.predict(&joined);
    let guided = predicted.into_vec().into_iter().zip(joined.as_slice()).map(|(mut predicted, joined)| {
        let mut left = joined.clone();
        let seen = plan.model.reduce(&predicted);
        left.pixels_mut().iter_mut().zip(seen.pixels()).for_each(|(left, seen)| *left -= seen);
        let spline = plan.spline(&left);
        predicted.pixels_mut().iter_mut().zip(spline.pixels()).for_each(|(value, more)| *value += more);
        predicted
    });
    let (plain, guided) = (Planes::of(low, plain), Planes::of(low, guided.collect()));
    let all = Mask::from_fn(low, |_, _| true);
    let pixels = (0..low.height).flat_map(|row| (0..low.width).map(move |column| (row, column)));
    let trust = Trust::in_cells(CELL, pixels, (samples, Weights::new(&all, samples)), &plain, &guided);
    Ok((trust.plane(low), trust.worth()))
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
fn bilinear(axis: &Axis, sampling: Sampling) -> crate::kernel::rows::Rows {
    let row = |output| {
        let (first, share) = between(axis, sampling, output);
        (first, if axis.inputs == 1 { vec![1.0] } else { vec![1.0 - share, share] })
    };
    crate::operator::taps::Taps::from_rows(axis.inputs, (0..axis.outputs).map(row)).rows()
}
