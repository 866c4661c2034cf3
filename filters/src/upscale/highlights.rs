//! Dark pixels beside highlights: where light spans octaves from one small pixel to the next, the spline of its logarithms.
//!
//! A spline of means rings by a part of each step: beside a lamp of 22 by more than all the light of a pixel of 0.3, and bounds leave
//! half to twice of what was there. The spline of logarithms rings by a factor. Given the spline `x0` of a channel with means `y`, `x1`, the
//! same within its bounds, and the light `l` of a small pixel, the mean of the channels of its group,
//!
//! ```text
//! m = exp(P log max(y, f))                    P: the spline through values at the centres of small pixels
//! m <- m B(max(R x0, 0) / R m)                PASSES times; B: straight lines between centres
//! x = (1 - B w) x1 + B w m
//! w = o(a / (RANGE b)) o(a / (DARK l)) o(a / (BRIGHT c)),    o(q) = min(max(log2 q, 0), 1)
//! ```
//!
//! `a` and `b` are the greatest and the least light of the 5 x 5 small pixels around, `c` is the mean light of all that have any: `w` is 1 for a
//! pixel that is a quarter as bright as one beside it that has six times the light of `b` and `c`. It is one number for the channels of a group, so that
//! hues do not shift. `b`, `l` and `f` are at least a 1024th of the greatest value around. What the blend changes of the means is put back by
//! `settle`. Everything is in proportion to the image, and where `w` is 0 around a pixel it keeps its bits.
//!
//! Cost: a frame whose greatest light is at most `BRIGHT c` costs one reading. Others: two windows of 5 x 5 a small pixel, an exponential,
//! the maps of four splines and the bounds once more a pixel of the result, three planes.
//! Fails: textures between highlights get the soft flanks of logarithms.

use lacuna_core::parallel::prelude::*;

use super::guided::bilinear;
use super::{Axis, Pair, Plan, Sampling, apply};
use crate::kernel::{Isa, minima};
use crate::{Plane, Planes};

/// Greatest over least light around a pixel from which on it counts.
const RANGE: f32 = 3.0;
/// The greatest light around a pixel over its own from which on it is dark.
const DARK: f32 = 2.0;
/// The greatest light around a pixel over the frame's mean from which on it is a highlight.
const BRIGHT: f32 = 3.0;
/// Values below this part of the greatest one around count as that.
const FLOOR: f32 = 1.0 / 1024.0;
/// The same, of the greatest value of all.
const BLACK: f32 = 1e-9;
/// Pixels that a window reaches to each side.
const REACH: usize = 2;
/// How often the means of `m` are made those asked for.
const PASSES: usize = 3;

/// `w` for each small pixel of a group of channels; nothing if it is 0 everywhere.
pub(crate) fn beside(group: &Planes) -> Option<Plane> {
    let light = light(group);
    let rows = light.pixels().par_chunks(light.size().width.max(1)).map(|row| {
        row.iter().filter(|value| **value > 0.0).fold((0.0, 0_u64, 0.0_f32), |(sum, count, most), value| {
            (sum + f64::from(*value), count + 1, most.max(*value))
        })
    });
    // In the order of the rows, whatever the threads.
    let whole = rows
        .into_iter()
        .fold((0.0, 0, 0.0), |all: (f64, u64, f32), row| (all.0 + row.0, all.1 + row.1, all.2.max(row.2)));
    let (sum, count, most) = whole;
    let bright = BRIGHT * (sum / count.max(1) as f64) as f32;
    if !(bright > 0.0 && most > bright && most.is_finite()) {
        return None;
    }
    let (greatest, least) = (greatest(&light), least(&light));
    let mut share = light;
    let around = greatest.pixels().iter().zip(least.pixels());
    share.pixels_mut().iter_mut().zip(around).for_each(|(value, (greatest, least))| {
        let floor = (FLOOR * greatest).max(f32::MIN_POSITIVE);
        let octaves = |limit: f32| if *greatest > limit { (greatest / limit).log2().min(1.0) } else { 0.0 };
        let dark = octaves(RANGE * least.max(floor)) * octaves(DARK * value.max(floor));
        *value = if dark > 0.0 { dark * octaves(bright) } else { 0.0 };
    });
    share.pixels().iter().any(|share| *share > 0.0).then_some(share)
}

/// Replaces pixels of `plane`, the spline of `samples`, where `share` is not 0: by the blend of `bounded`, the same within its bounds, with the
/// spline of logarithms; `means` are those of `plane`.
pub(super) fn soften(
    plan: &Plan,
    share: &Plane,
    (samples, means): (&Plane, &Plane),
    bounded: &Plane,
    plane: &mut Plane,
) {
    let axes = [plan.geometry.vertical, plan.geometry.horizontal];
    let lines = axes.map(|axis| bilinear(&axis, Sampling::Box).rows());
    let model = logarithmic(plan, (samples, means), &lines);
    let share = apply(&lines, share);
    let width = plane.size().width;
    let parts = model.pixels().par_chunks(width).zip(share.pixels().par_chunks(width));
    let parts = bounded.pixels().par_chunks(width).zip(parts);
    plane.pixels_mut().par_chunks_mut(width).zip(parts).for_each(|(plane, (bounded, (model, share)))| {
        for ((value, bounded), (model, share)) in plane.iter_mut().zip(bounded).zip(model.iter().zip(share)) {
            let blend = bounded + share * (model - bounded);
            // What overflows in between stays as it was.
            if *share > 0.0 && blend.is_finite() {
                *value = blend;
            }
        }
    });
}

/// `m`.
fn logarithmic(plan: &Plan, (samples, means): (&Plane, &Plane), lines: &Pair) -> Plane {
    let mut logarithms = greatest(samples);
    let black = logarithms.pixels().iter().fold(0.0, |most: f32, value| most.max(*value)) * BLACK;
    let pairs = logarithms.pixels_mut().iter_mut().zip(samples.pixels());
    pairs.for_each(|(most, value)| {
        *most = value.max(FLOOR * *most).max(black).max(f32::MIN_POSITIVE).ln();
    });
    let axes = [plan.geometry.vertical, plan.geometry.horizontal];
    let through = axes.map(|axis| Axis::whole(axis.inputs, axis.inputs).prefilter(Sampling::Point).rows());
    let onto = axes.map(|axis| axis.spline(Sampling::Point).rows());
    let mut model = apply(&onto, &apply(&through, &logarithms));
    let width = model.size().width;
    model.pixels_mut().par_chunks_mut(width).for_each(|row| row.iter_mut().for_each(|v| *v = v.exp()));
    for _ in 0..PASSES {
        let mut factors = plan.model.reduce(&model);
        factors.pixels_mut().iter_mut().zip(means.pixels()).for_each(|(factor, mean)| {
            *factor = mean.max(0.0) / factor.max(f32::MIN_POSITIVE);
        });
        let factors = apply(lines, &factors);
        let rows = model.pixels_mut().par_chunks_mut(width).zip(factors.pixels().par_chunks(width));
        rows.for_each(|(row, factors)| row.iter_mut().zip(factors).for_each(|(v, factor)| *v *= factor));
    }
    model
}

/// The mean of the channels.
fn light(group: &Planes) -> Plane {
    let part = 1.0 / group.len().max(1) as f32;
    let width = group.size().width.max(1);
    let mut light = Plane::filled(group.size(), 0.0);
    light.pixels_mut().par_chunks_mut(width).enumerate().for_each(|(y, row)| {
        for plane in group.as_slice() {
            row.iter_mut().zip(plane.row(y)).for_each(|(sum, value)| *sum += part * value);
        }
    });
    light
}

/// The greatest of the 5 x 5 pixels around each, those beyond the border left out.
fn greatest(image: &Plane) -> Plane {
    let mut negative = image.clone();
    negative.pixels_mut().iter_mut().for_each(|value| *value = -*value);
    let mut greatest = least(&negative);
    greatest.pixels_mut().iter_mut().for_each(|value| *value = -*value);
    greatest
}

/// The least of them.
fn least(image: &Plane) -> Plane {
    let (isa, size) = (Isa::best(), image.size());
    let mut out = image.clone();
    out.pixels_mut().par_chunks_mut(size.width).enumerate().for_each(|(y, out)| {
        let mut line = vec![f32::INFINITY; size.width + 2 * REACH];
        for near in y.saturating_sub(REACH)..size.height.min(y + REACH + 1) {
            minima::lower_to(isa, &mut line[REACH..REACH + size.width], image.row(near));
        }
        let mut threes = vec![0.0; size.width + REACH];
        minima::of_three(isa, &line, &mut threes);
        minima::of_three(isa, &threes, out);
    });
    out
}

#[cfg(test)]
#[path = "highlights/tests.rs"]
mod tests;
