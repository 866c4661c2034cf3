//! Highlights: light far above that of most pixels, and what dark pixels around it become.
//!
//! The spline of a step rings by parts of it, for ten pixels and more: around a lamp of 1000 by more than all the light of a pixel of 0.1, of
//! which bounds leave a pattern of half and twice the mean. So pixels that are no highlights see highlights no brighter than themselves.
//! With the spline `S` of samples `z`, the light `l` of a small pixel, which is the mean of the channels of its group, and
//! `o(q) = min(max(log2 q, 0), 1)`,
//!
//! ```text
//! E z = S z - V S(h z) + V l S(h z / l)        h = o(l / (BRIGHT c)),   c = min(P(l), P(max(l, 1)))
//! ```
//!
//! takes the place of `S`. `P(v) = (mean v^(1/4))^4` is the power mean of what is not black ([`crate::domain`]); black counts as white in the
//! second, so that lamps on black are highlights too. At a large pixel, `l` is that of the small pixel in which its centre lies, and `V` the
//! least `1 - h` of all that it touches. At whole factors `V` is the same in all of a small pixel, which so keeps its mean. Where values are
//! mapped by a domain, `z`, `l` and `c` are mapped values; `c` is found before.
//!
//! Smoothing along edges would carry light of highlights over: of its result `x` and the spline `x'` before it,
//! `x + (1 - h) H (x' - x)` is taken, where `H` is the greatest `h` of the 5 x 5 small pixels around.
//!
//! Means right beside a highlight hold light of its flank. The spline of logarithms has flanks, and rings by a factor. Given `x0 = E y` of
//! a channel with means `y`, and `x1`, the same within its bounds,
//!
//! ```text
//! m = exp(P log max(y, f))                    P: the spline through values at the centres of small pixels
//! m <- m B(max(R x0, 0) / R m)                PASSES times; B: straight lines between centres
//! x = (1 - B w) x1 + B w m
//! w = o(a / (RANGE b)) o(a / (DARK l)) o(a / (BRIGHT c)) (1 - o(a / (FAR l)))
//! ```
//!
//! `a` and `b` are the greatest and the least light of the 5 x 5 small pixels around: `w` is 1 for a pixel that is a quarter as bright as
//! one beside it that has six times the light of `b` and `c`, and 0 for one that is a 128th as bright, where the logarithms, too, ring by
//! more than half of its light. `h` and `w` are one number for the channels of a group, so that hues do not shift. `b`, `l` and `f` are at
//! least a 1024th of the greatest value around. What the blend changes of the means is put back by `settle`. A factor to all values changes
//! nothing but what counts as black or white; where no pixel is a highlight no bit changes.
//!
//! Cost: a frame whose greatest light is at most `BRIGHT c` costs one reading. Others: two splines more a channel wherever `S` stood; for
//! means two windows of 5 x 5 a small pixel, an exponential, the maps of four splines and the bounds once more a pixel of the result,
//! three planes. Memory: four planes of the small size for a group.
//! Fails: textures right beside highlights get the soft flanks of logarithms; lamps that cover most of a black frame are no highlights.

use std::ops::Range;

use lacuna_core::parallel::prelude::*;

use super::guided::bilinear;
use super::{Axis, Geometry, Pair, Plan, Sampling, apply};
use crate::domain::{self, Map};
use crate::kernel::{Isa, minima};
use crate::{Mask, Plane, Planes, Size};

/// Greatest over least light around a pixel from which on it counts.
const RANGE: f32 = 3.0;
/// The greatest light around a pixel over its own from which on it is dark.
const DARK: f32 = 2.0;
/// Light over the frame's power mean from which on it is a highlight.
const BRIGHT: f32 = 3.0;
/// The greatest light around a pixel over its own from which on logarithms say nothing of it.
const FAR: f32 = 64.0;
/// Values below this part of the greatest one around count as that.
const FLOOR: f32 = 1.0 / 1024.0;
/// The same, of the greatest value of all.
const BLACK: f32 = 1e-9;
/// Pixels that a window reaches to each side.
const REACH: usize = 2;
/// How often the means of `m` are made those asked for.
const PASSES: usize = 3;

/// What the light of a group of channels says of its small pixels; for means, and for values at points.
#[derive(Clone, Debug)]
pub struct Highlights {
    /// `l`.
    light: Plane,
    /// `h`.
    bright: Plane,
    /// `(1 - h) H`.
    held: Plane,
    /// `w`.
    pub(super) dark: Plane,
}

impl Highlights {
    /// Those of a group of finite planes of one size, which are enlarged in the domain of a map; nothing if there are none.
    pub fn of(group: &Planes, map: Map) -> Option<Self> {
        let mut light = light(group);
        let limit = BRIGHT * map.forward(typical(&light)?);
        map.forward_plane(&Mask::full(light.size()), &mut light);
        let is_bright = |value: &f32| *value > limit && value.is_finite();
        if !(limit > 0.0 && light.pixels().iter().any(is_bright)) {
            return None;
        }
        let mut bright = light.clone();
        bright.pixels_mut().iter_mut().for_each(|value| *value = octaves(*value, limit));
        let mut held = greatest(&bright, REACH);
        held.pixels_mut().iter_mut().zip(bright.pixels()).for_each(|(held, bright)| *held *= 1.0 - bright);
        Some(Self { dark: dark(&light, limit), light, bright, held })
    }

    /// Their size, that of the small image.
    pub const fn size(&self) -> Size {
        self.light.size()
    }

    /// Makes `plane`, which is `S samples`, `E samples`.
    pub(super) fn expose(&self, plan: &Plan, samples: &Plane, plane: &mut Plane) {
        let product = |factor: fn(f32, f32) -> f32| {
            let mut product = samples.clone();
            let parts = self.bright.pixels().iter().zip(self.light.pixels());
            product.pixels_mut().iter_mut().zip(parts).for_each(|(value, (bright, light))| {
                *value *= if *bright > 0.0 { factor(*bright, *light) } else { 0.0 };
            });
            plan.spline(&product)
        };
        let (own, others) = (product(|bright, _| bright), product(|bright, light| bright / light));
        let Geometry { vertical, horizontal, sampling } = plan.geometry;
        let size = plane.size();
        let columns: Vec<_> = (0..size.width).map(|x| Place::of(&horizontal, sampling, x)).collect();
        let parts = own.pixels().par_chunks(size.width).zip(others.pixels().par_chunks(size.width));
        plane.pixels_mut().par_chunks_mut(size.width).zip(parts).enumerate().for_each(
            |(y, (row, (own, others)))| {
                let place = Place::of(&vertical, sampling, y);
                let light = self.light.row(place.source);
                for (x, column) in columns.iter().enumerate() {
                    let share = self.least(&place, column);
                    // Elsewhere infinities would be no numbers.
                    if share > 0.0 {
                        row[x] += share * (light[column.source].max(0.0) * others[x] - own[x]);
                    }
                }
            },
        );
    }

    /// Takes back what smoothing along edges changed of ordinary pixels near highlights, whose light leaks into them.
    pub(super) fn hold(&self, plan: &Plan, before: &Plane, plane: &mut Plane) {
        let Geometry { vertical, horizontal, sampling } = plan.geometry;
        let width = plane.size().width;
        let columns: Vec<_> = (0..width).map(|x| horizontal.source(sampling, x)).collect();
        let rows = plane.pixels_mut().par_chunks_mut(width).zip(before.pixels().par_chunks(width));
        rows.enumerate().for_each(|(y, (row, before))| {
            let held = self.held.row(vertical.source(sampling, y));
            for ((value, before), &column) in row.iter_mut().zip(before).zip(&columns) {
                *value += held[column] * (before - *value);
            }
        });
    }

    /// The means of `exposed`, those of `spline` where highlights are beside a pixel: large pixels there hold light of both.
    pub(super) fn means(&self, spline: &Plane, mut exposed: Plane) -> Plane {
        let beside = greatest(&self.bright, 1);
        let parts = spline.pixels().iter().zip(beside.pixels());
        for (mean, (spline, bright)) in exposed.pixels_mut().iter_mut().zip(parts) {
            *mean = if *bright > 0.0 { *spline } else { *mean };
        }
        exposed
    }

    /// `V`.
    fn least(&self, row: &Place, column: &Place) -> f32 {
        let rows = row.touched.clone().map(|y| &self.bright.row(y)[column.touched.clone()]);
        1.0 - rows.flatten().fold(0.0, |most: f32, value| most.max(*value))
    }
}

/// Where a large pixel lies along an axis.
struct Place {
    source: usize,
    touched: Range<usize>,
}

impl Place {
    fn of(axis: &Axis, sampling: Sampling, output: usize) -> Self {
        Self { source: axis.source(sampling, output), touched: axis.touched(sampling, output) }
    }
}

/// `c`.
fn typical(light: &Plane) -> Option<f32> {
    let full = Mask::full(light.size());
    let mean = |least: f32| {
        let mut lit = light.clone();
        lit.pixels_mut().iter_mut().for_each(|value| *value = value.max(least));
        let (scale, _) = domain::lit(&full, &[lit]);
        (scale > 0.0).then_some(scale as f32)
    };
    let lit = mean(0.0)?;
    if lit > 1.0 { Some(lit.min(mean(1.0)?)) } else { Some(lit) }
}

/// `o(value / limit)`.
fn octaves(value: f32, limit: f32) -> f32 {
    if value > limit { (value / limit).log2().min(1.0) } else { 0.0 }
}

/// `w` for each small pixel of that light.
fn dark(light: &Plane, limit: f32) -> Plane {
    let (greatest, least) = (greatest(light, REACH), least(light, REACH));
    let mut share = light.clone();
    let around = greatest.pixels().iter().zip(least.pixels());
    share.pixels_mut().iter_mut().zip(around).for_each(|(value, (greatest, least))| {
        let floor = (FLOOR * greatest).max(f32::MIN_POSITIVE);
        let own = value.max(floor);
        let dark = octaves(*greatest, RANGE * least.max(floor)) * octaves(*greatest, DARK * own);
        *value = dark * octaves(*greatest, limit) * (1.0 - octaves(*greatest, FAR * own));
    });
    share
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
    let mut logarithms = greatest(samples, REACH);
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

/// The greatest of the pixels around each, up to `reach` of them away (1 or 2), those beyond the border left out.
fn greatest(image: &Plane, reach: usize) -> Plane {
    let mut negative = image.clone();
    negative.pixels_mut().iter_mut().for_each(|value| *value = -*value);
    let mut greatest = least(&negative, reach);
    greatest.pixels_mut().iter_mut().for_each(|value| *value = -*value);
    greatest
}

/// The least of them.
fn least(image: &Plane, reach: usize) -> Plane {
    let (isa, size) = (Isa::best(), image.size());
    let mut out = image.clone();
    out.pixels_mut().par_chunks_mut(size.width).enumerate().for_each(|(y, out)| {
        let mut line = vec![f32::INFINITY; size.width + 2 * reach];
        for near in y.saturating_sub(reach)..size.height.min(y + reach + 1) {
            minima::lower_to(isa, &mut line[reach..reach + size.width], image.row(near));
        }
        for times in (1..reach).rev() {
            let mut threes = vec![0.0; size.width + 2 * times];
            minima::of_three(isa, &line, &mut threes);
            line = threes;
        }
        minima::of_three(isa, &line, out);
    });
    out
}

#[cfg(test)]
#[path = "highlights/tests.rs"]
mod tests;
