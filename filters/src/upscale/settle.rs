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
//! Bounds: the range that all measured values keep (no negative light; alpha within 0 and 1), and, for boxes and grids, that of
//! [`crate::limiter`] for the 3 x 3 low-resolution pixels around: half the least to twice the greatest of them.
//!
//! Algorithm. Where the footprints share no pixel (a box at a whole factor), each is a problem of its own:
//! `x = clamp(x0 + t, low, high)`, with the one `t` that gives the mean; found by bisection, then Newton's step. A grid has
//! nothing to keep but its samples, which have their bits. Otherwise the dual: `x = clamp(x0 + R' l, low, high)` and
//! `l <- l + M (y - R x)` with `M = (R R')^-1`, accelerated, until `|R x - y|` is at most [`TOLERANCE`] of the largest
//! `|y|`. At least one of both is always kept: if no image keeps both (a Gaussian cannot have made those pixels), the bounds
//! win, the outcome is `IterationLimit`, and its residual says by how much.
//!
//! Boxes at broken factors meet that at every hard edge: a bright pixel between dark ones shares its pixels with them. Multipliers
//! then grow without end, and with them a pattern of black and white pixels. Where the steps have left more than `HOPELESS` they are
//! therefore begun anew and limited to twice the largest pixel around (an exact penalty on `|y - R x|`): where smaller ones suffice
//! `R x = y` holds as before, elsewhere the image stays near the spline.
//!
//! Source: the dual is a projection by A. Beck, M. Teboulle, "A fast iterative shrinkage-thresholding algorithm for linear
//! inverse problems", SIAM Journal on Imaging Sciences 2(1), 2009, with restarts (B. O'Donoghue, E. Candes, "Adaptive restart
//! for accelerated gradient schemes", Foundations of Computational Mathematics 15, 2015).

use std::borrow::Cow;

use lacuna_core::parallel::prelude::*;

use super::{Enlarged, Plan, Question, Sampling};
use crate::kernel::{Isa, vector};
use crate::{Outcome, Plane, Run, Size, Stop, limiter};

/// Largest `|R x - y|` over the largest `|y|` at which the dual stops.
pub const TOLERANCE: f64 = 1e-5;
/// Steps of the dual after which it gives up, or begins anew with limits.
const STEPS: usize = 1000;
/// Largest `|R x - y|` over the largest `|y|` after these steps up to which bounds and means may yet be kept together.
const HOPELESS: f64 = 1e-3;
/// Multipliers that are limited, over the largest of the 3 x 3 pixels around.
const LARGEST: f32 = 2.0;
/// By how much the largest eigenvalue of `R R'` may exceed what it makes of a constant.
const MARGIN: f64 = 1.2;
/// Bisections of a cell: to the rounding of f32 and beyond.
const BISECTIONS: usize = 40;

/// Bounds of the pixels of a footprint, by the low-resolution pixel.
struct Bounds {
    low: Plane,
    high: Plane,
}

impl Bounds {
    fn new(samples: &Plane, question: &Question<'_>, local: bool) -> Self {
        let size = samples.size();
        let [mut low, mut high] = if local && question.limit {
            limiter::around(samples)
        } else {
            [Plane::filled(size, f32::NEG_INFINITY), Plane::filled(size, f32::INFINITY)]
        };
        low.pixels_mut().iter_mut().for_each(|value| *value = value.max(question.range.0));
        high.pixels_mut().iter_mut().for_each(|value| *value = value.min(question.range.1));
        Self { low, high }
    }
}

/// Moves `plane`, whose reduction is `samples`, into its bounds.
pub(super) fn settle(
    plan: &Plan,
    samples: &Plane,
    mut plane: Plane,
    question: &Question<'_>,
    run: &Run<'_>,
) -> Enlarged {
    let sampling = plan.geometry.sampling;
    // A mean of values in the range is in it; other footprints weigh some pixels negatively.
    let own = if plan.cells.is_some() { within(samples, question.range) } else { Cow::Borrowed(samples) };
    let samples = own.as_ref();
    let bounds = Bounds::new(samples, question, matches!(sampling, Sampling::Box | Sampling::Grid));
    let (limited, outcome) = if let Some(cells) = &plan.cells {
        (in_cells(cells, samples, &bounds, &mut plane), Outcome::direct())
    } else if sampling == Sampling::Grid {
        (in_grid(plan, samples, &bounds, &mut plane), Outcome::direct())
    } else {
        together(plan, samples, &bounds, &mut plane, run)
    };
    Enlarged { plane, limited, outcome }
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

/// A box at a whole factor: cell by cell.
fn in_cells(
    [rows, columns]: &[Vec<std::ops::Range<usize>>; 2],
    samples: &Plane,
    bounds: &Bounds,
    plane: &mut Plane,
) -> usize {
    let width = plane.size().width;
    let tall = rows.first().map_or(1, std::ops::Range::len);
    let strips = plane.pixels_mut().par_chunks_mut(tall * width).enumerate();
    let counts = strips.map(|(i, strip)| {
        let mut values = Vec::new();
        let mut moved = 0;
        for (j, range) in columns.iter().enumerate() {
            values.clear();
            values.extend(strip.chunks(width).flat_map(|row| &row[range.clone()]).map(|v| f64::from(*v)));
            let cell = (f64::from(bounds.low.at(i, j)), f64::from(bounds.high.at(i, j)));
            moved += one_cell(&mut values, f64::from(samples.at(i, j)), cell);
            let places = strip.chunks_mut(width).flat_map(|row| &mut row[range.clone()]);
            places.zip(&values).for_each(|(place, value)| *place = *value as f32);
        }
        moved
    });
    counts.into_iter().sum()
}

/// Gives the values the mean `mean` within `low..=high`, which contains it, by the smallest change; how many left
/// the others behind at a bound.
fn one_cell(values: &mut [f64], mean: f64, (low, high): (f64, f64)) -> usize {
    let count = values.len() as f64;
    let shift = mean - values.iter().sum::<f64>() / count;
    let outside = |value: &f64| *value + shift < low || *value + shift > high;
    if !values.iter().any(outside) {
        for value in values {
            *value += shift;
        }
        return 0;
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
    let moved = values.iter().filter(|value| **value + t < low || **value + t > high).count();
    for value in values {
        *value = (*value + t).clamp(low, high);
    }
    moved
}

/// A grid: every pixel by itself, and the samples' bits where they stand.
fn in_grid(plan: &Plan, samples: &Plane, bounds: &Bounds, plane: &mut Plane) -> usize {
    let moved = clamp(plan, bounds, plane);
    plan.restore(samples, plane);
    moved
}

/// Moves every pixel into the bounds of its low-resolution pixel; how many were outside.
fn clamp(plan: &Plan, bounds: &Bounds, plane: &mut Plane) -> usize {
    let geometry = &plan.geometry;
    let columns: Vec<usize> =
        (0..geometry.high().width).map(|x| geometry.horizontal.source(geometry.sampling, x)).collect();
    let rows = plane.pixels_mut().par_chunks_mut(columns.len()).enumerate();
    let counts = rows.map(|(y, row)| {
        let source = geometry.vertical.source(geometry.sampling, y);
        let (low, high) = (bounds.low.row(source), bounds.high.row(source));
        let mut moved = 0;
        for (value, &column) in row.iter_mut().zip(&columns) {
            let inside = value.clamp(low[column], high[column].max(low[column]));
            moved += usize::from(inside != *value);
            *value = inside;
        }
        moved
    });
    counts.into_iter().sum()
}

/// Footprints that share pixels: all together, by the dual.
fn together(
    plan: &Plan,
    samples: &Plane,
    bounds: &Bounds,
    plane: &mut Plane,
    run: &Run<'_>,
) -> (usize, Outcome) {
    let start = plane.clone();
    let peak = largest(samples).max(f64::MIN_POSITIVE);
    let mut outcome = Outcome { stop: Stop::IterationLimit, ..Outcome::direct() };
    let mut moved = clamp(plan, bounds, plane);
    let mut dual = Dual::new(samples.size());
    loop {
        let residual = difference(samples, &plan.model.reduce(plane));
        let off = largest(&residual) / peak;
        outcome.residual = Some(off);
        if off <= TOLERANCE {
            outcome.stop = Stop::Converged;
        } else if let Some(stop) = run.interrupted() {
            outcome.stop = stop;
        } else if dual.steps < STEPS && !dual.rests(TOLERANCE * peak) {
            dual.step(plan, &residual);
            outcome.iterations += 1;
            *plane = sum(&start, 1.0, &plan.model.adjoint(&dual.ahead));
            moved = clamp(plan, bounds, plane);
            continue;
        } else if dual.limits.is_none() && plan.geometry.sampling == Sampling::Box && off > HOPELESS {
            dual = Dual::limited(plan, samples);
            plane.clone_from(&start);
            moved = clamp(plan, bounds, plane);
            continue;
        }
        return (moved, outcome);
    }
}

/// The dual's way up: accelerated steps, begun anew where they go down.
struct Dual {
    multiplier: Plane,
    ahead: Plane,
    momentum: f64,
    steps: usize,
    /// The largest change of the last step.
    change: f64,
    /// What multipliers may not exceed, and the length of a step.
    limits: Option<(Plane, f64)>,
}

impl Dual {
    fn new(size: Size) -> Self {
        let multiplier = Plane::filled(size, 0.0);
        Self {
            ahead: multiplier.clone(),
            multiplier,
            momentum: 1.0,
            steps: 0,
            change: f64::INFINITY,
            limits: None,
        }
    }

    /// Limits as large as the pixels around allow for.
    fn limited(plan: &Plan, samples: &Plane) -> Self {
        let size = samples.size();
        let most = Plane::from_fn(size, |y, x| {
            let near = |at: usize, n: usize| at.saturating_sub(1)..(at + 2).min(n);
            let rows = near(y, size.height).map(|y| &samples.row(y)[near(x, size.width)]);
            LARGEST * rows.flatten().fold(0.0, |most: f32, value| most.max(value.abs()))
        });
        // A mean lets pass most of what does not vary.
        let gain = largest(&plan.model.reduce(&plan.model.adjoint(&Plane::filled(size, 1.0))));
        Self { limits: Some((most, 1.0 / (MARGIN * gain))), ..Self::new(size) }
    }

    /// Whether limited multipliers no longer change.
    fn rests(&self, tolerance: f64) -> bool {
        self.limits.is_some() && self.change <= tolerance
    }

    /// Follows what the image lacks of the samples.
    fn step(&mut self, plan: &Plan, residual: &Plane) {
        let mut next = match &self.limits {
            // Without bounds in the way the first step would be exact, so that the step is 1.
            None => sum(&self.ahead, 1.0, &plan.model.gram_inverse(residual)),
            Some((_, length)) => sum(&self.ahead, *length, residual),
        };
        self.limit(&mut next);
        let way = difference(&next, &self.multiplier);
        if vector::dot(Isa::best(), residual.pixels(), way.pixels()) < 0.0 {
            self.momentum = 1.0;
        }
        let after = f64::midpoint(1.0, (1.0 + 4.0 * self.momentum * self.momentum).sqrt());
        let mut ahead = sum(&next, (self.momentum - 1.0) / after, &way);
        self.limit(&mut ahead);
        (self.multiplier, self.ahead) = (next, ahead);
        (self.momentum, self.change) = (after, largest(&way));
        self.steps += 1;
    }

    fn limit(&self, multiplier: &mut Plane) {
        if let Some((most, _)) = &self.limits {
            let pairs = multiplier.pixels_mut().par_iter_mut().zip(most.pixels());
            pairs.for_each(|(value, most)| *value = value.clamp(-most, *most));
        }
    }
}

/// `a - b`.
fn difference(a: &Plane, b: &Plane) -> Plane {
    sum(a, -1.0, b)
}

/// `a + factor b`.
fn sum(a: &Plane, factor: f64, b: &Plane) -> Plane {
    let mut out = a.clone();
    vector::add_scaled(Isa::best(), out.pixels_mut(), factor, b.pixels());
    out
}

fn largest(plane: &Plane) -> f64 {
    let rows = plane.pixels().par_chunks(plane.size().width);
    let largest = rows.map(|row| row.iter().fold(0.0, |top: f32, value| top.max(value.abs())));
    f64::from(largest.into_iter().fold(0.0, f32::max))
}
