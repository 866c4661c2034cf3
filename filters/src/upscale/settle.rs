//! Bounds as part of the solution: the nearest image that keeps them and still reduces to the input.
//!
//! Given an image `x0` with `R x0 = y` and bounds `low <= x <= high` for each pixel,
//!
//! ```text
//! min |x - x0|^2   subject to   R x = y,   low <= x <= high
//! ```
//!
//! so negative light that a clamp would cut off is taken from the pixels beside it, and the mean over each footprint stays.
//!
//! Bounds: the range that all measured values keep (no negative light; alpha within 0 and 1), and, for boxes, grids, and points in logarithms,
//! that of [`crate::limiter`] for the 3 x 3 low-resolution pixels around: half the least to twice the greatest of them, as they were before they
//! were mapped.
//!
//! Algorithm. Where the footprints share no pixel (a box at a whole factor, narrow Gaussians at some), each is a problem of its own:
//! `x = clamp(x0 + t, low, high)`, with the one `t` that gives the mean; found by bisection, then Newton's step. A grid has
//! nothing to keep but its samples, which have their bits; a spline of points is clamped, as its samples are within bounds. Otherwise
//! the dual, `x = clamp(x0 + R' l, low, high)`: of boxes footprint by footprint (`relax`), of the others all together (`dual`), until `|R x - y|` is at most `TOLERANCE` of the largest
//! `|y|`. At least one of both is always kept: if no image keeps both (a Gaussian cannot have made those pixels), the bounds
//! win, and `off_input` of the outcome says by how much. The outcome is `Converged` unless someone wanted the end.
//!
//! Means of a spline at broken factors, see [`super::Axis`], are integrals, over whole pixels say, of which `R` has shares. Beside a hard edge shares of
//! pixels within bounds cannot have them, and forcing them there makes the image worse: it is clamped, and what `R x` then lacks or has too
//! much is given to the pixels around once, to each in proportion to the room that it has within its bounds, which keeps the light in
//! all but for what a second clamp takes. Splines of other weighted means swing further: all of it is given back `FIRST` times, then what is still off
//! by more than `FAR` of the largest `|y|` (all of it from twice that on), up to `ROUNDS` times. Bars and lamps need it, edges are best left alone. What is left of the target is
//! `off_input`. The distance from the samples would say nothing: true
//! images, whose pixels straddle edges, are off theirs by a tenth to a third of the largest value at hard edges.
//! Total variation keeps shares, and points as `R` has them; multipliers of shares that would grow without end are limited to what moves a mean
//! by twice the largest `|y|` (an exact penalty on `|y - R x|`): where smaller ones suffice `R x = y` holds.
//!
//! Sources: see `relax` and `dual`.

use std::borrow::Cow;

use lacuna_core::parallel::prelude::*;

use super::bounds::{Bounds, LARGEST, TOLERANCE, by_bounds, clamp, difference, largest};
use super::guided::bilinear;
use super::relax::{Relaxed, Task};
use super::{Enlarged, Geometry, Method, Plan, Question, Sampling, apply, dual};
use crate::kernel::{Isa, vector};
use crate::limiter::Moved;
use crate::operator::taps::Taps;
use crate::{Outcome, Plane, Run, Stop};

/// Bisections of a cell: to the rounding of f32 and beyond.
const BISECTIONS: usize = 40;

/// How often all that weighted means lack is given back: as often as hard edges gain by it.
const FIRST: usize = 4;
/// What is given back after that: residuals above this part of the largest `|y|`.
const FAR: f64 = 0.02;
/// How often in all.
const ROUNDS: usize = 32;

/// Moves `plane` into its bounds, which `samples` decide; its reduction is then `target`, without that `samples`.
pub(super) fn settle(
    plan: &Plan,
    (samples, target): (&Plane, Option<&Plane>),
    mut plane: Plane,
    question: &Question<'_>,
    run: &Run<'_>,
) -> Enlarged {
    let sampling = plan.geometry.sampling;
    // A mean of values in the range is in it; other footprints weigh some pixels negatively.
    let own = if plan.cells.is_some() { within(samples, question.range) } else { Cow::Borrowed(samples) };
    let samples = own.as_ref();
    let bounds = Bounds::new(plan, samples, question);
    let (limited, outcome) = if let Some(cells) = &plan.cells {
        (in_cells(cells, samples, &bounds, &mut plane), Outcome::direct())
    } else if sampling == Sampling::Grid {
        (in_grid(plan, samples, &bounds, &mut plane), Outcome::direct())
    } else if sampling == Sampling::Point && plan.method == Method::Ss {
        (clamp(plan, &bounds, &mut plane), Outcome::direct())
    } else {
        let target = target.map(|target| between(target, &bounds));
        together(plan, (samples, target.as_ref()), (&bounds, question.range), &mut plane, run)
    };
    Enlarged { plane, limited, outcome }
}

/// `plane` as far as it has come, clamped to its bounds.
pub(super) fn cut_short(
    plan: &Plan,
    samples: &Plane,
    mut plane: Plane,
    question: &Question<'_>,
    stop: Stop,
) -> Enlarged {
    let bounds = Bounds::new(plan, samples, question);
    let limited = in_grid(plan, samples, &bounds, &mut plane);
    Enlarged { plane, limited, outcome: Outcome { stop, ..Outcome::direct() } }
}

/// Means in the range that all must keep. Measured ones are; those that a fill has made may lie beside it by a rounding.
fn within(samples: &Plane, (low, high): (f32, f32)) -> Cow<'_, Plane> {
    if samples.pixels().iter().all(|value| (low..=high).contains(value)) {
        return Cow::Borrowed(samples);
    }
    let mut samples = samples.clone();
    samples.pixels_mut().iter_mut().for_each(|value| *value = value.max(low).min(high));
    Cow::Owned(samples)
}

/// Means in the bounds of their own pixels: those of a spline may lie beyond.
fn between(target: &Plane, bounds: &Bounds) -> Plane {
    let mut target = target.clone();
    let pairs = bounds.low.pixels().iter().zip(bounds.high.pixels());
    target.pixels_mut().iter_mut().zip(pairs).for_each(|(value, (low, high))| {
        *value = value.max(*low).min(*high);
    });
    target
}

/// A box at a whole factor, or a narrow Gaussian, whose cells may differ in height: cell by cell.
fn in_cells(
    [rows, columns]: &[Vec<std::ops::Range<usize>>; 2],
    samples: &Plane,
    bounds: &Bounds,
    plane: &mut Plane,
) -> Moved {
    let width = plane.size().width;
    let mut rest = plane.pixels_mut();
    let strips: Vec<&mut [f32]> =
        rows.iter().filter_map(|rows| rest.split_off_mut(..rows.len() * width)).collect();
    let counts = strips.into_par_iter().enumerate().map(|(i, strip)| {
        let mut values = Vec::new();
        let mut moved = Moved::default();
        for (j, range) in columns.iter().enumerate() {
            values.clear();
            values.extend(strip.chunks(width).flat_map(|row| &row[range.clone()]).map(|v| f64::from(*v)));
            moved += one_cell(&mut values, f64::from(samples.at(i, j)), bounds, (i, j));
            let places = strip.chunks_mut(width).flat_map(|row| &mut row[range.clone()]);
            places.zip(&values).for_each(|(place, value)| *place = *value as f32);
        }
        moved
    });
    counts.into_iter().sum()
}

/// Gives the values the mean `mean` within the bounds of a cell, which contain it, by the smallest change; how many left
/// the others behind at a bound.
fn one_cell(values: &mut [f64], mean: f64, bounds: &Bounds, (i, j): (usize, usize)) -> Moved {
    let (low, high) = (f64::from(bounds.low.at(i, j)), f64::from(bounds.high.at(i, j)));
    let count = values.len() as f64;
    let shift = mean - values.iter().sum::<f64>() / count;
    let outside = |value: &f64| *value + shift < low || *value + shift > high;
    if !values.iter().any(outside) {
        for value in values {
            *value += shift;
        }
        return Moved::default();
    }
    let (least, most) = values.iter().fold((f64::MAX, f64::MIN), |(a, b), v| (a.min(*v), b.max(*v)));
    // At `from` no value is above the mean, at `to` none is below.
    let (mut from, mut to) = (mean - most, mean - least);
    let sum = |t: f64| values.iter().map(|value| (value + t).clamp(low, high)).sum::<f64>();
    for _ in 0..BISECTIONS {
        let middle = 0.5 * (from + to);
        if sum(middle) < mean * count { from = middle } else { to = middle }
    }
    let free = |value: &&f64| **value + to > low && **value + to < high;
    let t = to + (mean * count - sum(to)) / values.iter().filter(free).count().max(1) as f64;
    let mut moved = Moved::default();
    for value in values {
        let free = *value + t;
        *value = free.clamp(low, high);
        if *value != free {
            moved += bounds.moved(free as f32, *value as f32);
        }
    }
    moved
}

/// Every pixel by itself, and in a grid the samples' bits where they stand.
fn in_grid(plan: &Plan, samples: &Plane, bounds: &Bounds, plane: &mut Plane) -> Moved {
    let moved = clamp(plan, bounds, plane);
    plan.restore(samples, plane);
    moved
}

/// Footprints that share pixels, by the dual: boxes one after the other, those whose weights change their sign together. Means that are not
/// the samples, the `target`, are kept as far as `give_back` does.
fn together(
    plan: &Plan,
    (samples, target): (&Plane, Option<&Plane>),
    (bounds, range): (&Bounds, (f32, f32)),
    plane: &mut Plane,
    run: &Run<'_>,
) -> (Moved, Outcome) {
    let asked = target.unwrap_or(samples);
    let peak = largest(asked).max(f64::MIN_POSITIVE);
    let mut free = plane.clone();
    let mut moved = clamp(plan, bounds, plane);
    let mut reduced = plan.model.reduce(plane);
    let mut residual = difference(asked, &reduced);
    let mut outcome = Outcome::direct();
    if largest(&residual) > TOLERANCE * peak {
        if target.is_some() {
            moved = give_back(plan, &residual, bounds, plane, LARGEST * peak);
            if plan.geometry.sampling != Sampling::Box {
                (outcome.stop, outcome.iterations) = give_on(plan, asked, (bounds, peak), plane, run);
            }
        } else if plan.geometry.sampling != Sampling::Box {
            plane.clone_from(&free);
            (moved, outcome.stop, outcome.iterations) =
                dual::ascend(plan, asked, (bounds, range), plane, run);
        } else {
            let task = Task { target: asked, peak, bounds, limit: LARGEST * peak };
            let mut relaxed = Relaxed::new(plan, task, &residual, &mut free);
            (outcome.stop, outcome.iterations) = relaxed.run(run);
            plane.clone_from(&free);
            moved = clamp(plan, bounds, plane);
        }
        reduced = plan.model.reduce(plane);
        residual = difference(asked, &reduced);
    }
    outcome.off_input = Some(largest(&residual) / peak);
    // The dual's own limits are nobody's to raise: what counts is how far off it is.
    if outcome.stop == Stop::IterationLimit {
        outcome.stop = Stop::Converged;
    }
    (moved, outcome)
}

/// Gives back what the first time has left; how that ended, and after how many times more.
fn give_on(
    plan: &Plan,
    asked: &Plane,
    (bounds, peak): (&Bounds, f64),
    plane: &mut Plane,
    run: &Run<'_>,
) -> (Stop, usize) {
    for round in 1..ROUNDS {
        let mut residual = difference(asked, &plan.model.reduce(plane));
        let near = peak * if round < FIRST { TOLERANCE } else { FAR };
        // A share that begins at nothing: by a threshold alone rounding would decide.
        let share = |value: f32| (f64::from(value.abs()) / near - 1.0).clamp(0.0, 1.0) as f32;
        residual.pixels_mut().iter_mut().for_each(|value| *value *= share(*value));
        if largest(&residual) <= TOLERANCE * peak {
            return (Stop::Converged, round - 1);
        }
        if let Some(stop) = run.interrupted() {
            return (stop, round - 1);
        }
        give_back(plan, &residual, bounds, plane, LARGEST * peak);
    }
    (Stop::IterationLimit, ROUNDS - 1)
}

/// Gives the pixels around what the means lack, and takes what they have too much, by the room that each pixel has within its bounds
/// and `most`, and clamps them.
fn give_back(plan: &Plan, residual: &Plane, bounds: &Bounds, plane: &mut Plane, most: f64) -> Moved {
    let Geometry { vertical, horizontal, sampling } = plan.geometry;
    let lines = [vertical, horizontal].map(|axis| bilinear(&axis, sampling));
    let [onto, back] = [lines.each_ref().map(Taps::rows), lines.map(|taps| taps.transpose().rows())];
    let pixels = apply(&back, &Plane::filled(plane.size(), 1.0));
    for sign in [-1.0_f32, 1.0] {
        let mut room = plane.clone();
        by_bounds(plan, bounds, &mut room, |value, low, high| {
            *value = if sign < 0.0 { *value - low } else { high - *value }.clamp(0.0, most as f32);
            Moved::default()
        });
        let mut parts = apply(&back, &room);
        let asked = residual.pixels().iter().zip(pixels.pixels());
        parts.pixels_mut().iter_mut().zip(asked).for_each(|(part, (residual, pixels))| {
            let asked = (sign * residual).max(0.0) * pixels;
            *part = if *part > 0.0 { asked / *part } else { 0.0 };
        });
        let parts = apply(&onto, &parts);
        room.pixels_mut().iter_mut().zip(parts.pixels()).for_each(|(room, part)| *room *= part);
        vector::add_scaled(Isa::best(), plane.pixels_mut(), f64::from(sign), room.pixels());
    }
    clamp(plan, bounds, plane)
}

#[cfg(test)]
#[path = "settle/tests.rs"]
mod tests;
