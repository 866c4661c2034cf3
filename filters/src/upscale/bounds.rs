//! Bounds of the pixels of the result, and what the methods that keep them measure planes by.

use std::borrow::Cow;

use lacuna_core::parallel::prelude::*;

use super::{Plan, Question, Sampling};
use crate::domain::Map;
use crate::kernel::{Isa, vector};
use crate::limiter::{self, Moved};
use crate::{Mask, Plane};

/// Largest `|R x - y|` over the largest `|y|` at which the dual stops.
pub const TOLERANCE: f64 = 1e-5;
/// How far a multiplier may move the mean of its own footprint, over the largest `|y|`.
pub const LARGEST: f64 = 2.0;

/// Bounds of the pixels of a footprint, by the low-resolution pixel, as mapped values.
pub(super) struct Bounds {
    /// The least value.
    pub low: Plane,
    /// The greatest.
    pub high: Plane,
    /// What they were mapped by.
    pub map: Map,
}

impl Bounds {
    /// The limiter's are found in the values before they were mapped: twice a logarithm is not twice the light. It holds for boxes and grids,
    /// and for points where they are logarithms, whose spline overshoots by factors.
    pub fn new(plan: &Plan, samples: &Plane, question: &Question<'_>) -> Self {
        let (size, map) = (samples.size(), question.map);
        let local = match plan.geometry.sampling {
            Sampling::Box | Sampling::Grid => true,
            Sampling::Point => map.is_log(),
            Sampling::Gaussian(_) | Sampling::Mitchell => false,
        };
        let [mut low, mut high] = if local && question.limit {
            let mut values = Cow::Borrowed(samples);
            if !map.is_linear() {
                map.inverse_plane(values.to_mut());
            }
            limiter::around(&values).map(|mut plane| {
                map.forward_plane(&Mask::full(size), &mut plane);
                plane
            })
        } else {
            [Plane::filled(size, f32::NEG_INFINITY), Plane::filled(size, f32::INFINITY)]
        };
        low.pixels_mut().iter_mut().for_each(|value| *value = value.max(question.range.0));
        high.pixels_mut().iter_mut().for_each(|value| *value = value.min(question.range.1));
        Self { low, high, map }
    }

    /// One value that was moved, in the units that it had before it was mapped.
    pub fn moved(&self, from: f32, to: f32) -> Moved {
        Moved::from_to(self.map.inverse(from), self.map.inverse(to))
    }
}

/// Moves every pixel into the bounds of its low-resolution pixel; how many were outside.
pub(super) fn clamp(plan: &Plan, bounds: &Bounds, plane: &mut Plane) -> Moved {
    by_bounds(plan, bounds, plane, |value, low, high| {
        let inside = value.clamp(low, high);
        let moved = if *value == inside { Moved::default() } else { bounds.moved(*value, inside) };
        *value = inside;
        moved
    })
}

/// Does something to every pixel by its bounds, lower and upper; the sum of what that returns.
pub(super) fn by_bounds(
    plan: &Plan,
    bounds: &Bounds,
    plane: &mut Plane,
    each: impl Fn(&mut f32, f32, f32) -> Moved + Sync,
) -> Moved {
    let geometry = &plan.geometry;
    let columns: Vec<usize> =
        (0..geometry.high().width).map(|x| geometry.horizontal.source(geometry.sampling, x)).collect();
    let rows = plane.pixels_mut().par_chunks_mut(columns.len()).enumerate();
    let counts = rows.map(|(y, row)| {
        let source = geometry.vertical.source(geometry.sampling, y);
        let (low, high) = (bounds.low.row(source), bounds.high.row(source));
        let mut moved = Moved::default();
        for (value, &column) in row.iter_mut().zip(&columns) {
            moved += each(value, low[column], high[column].max(low[column]));
        }
        moved
    });
    counts.into_iter().sum()
}

/// `a - b`.
pub(super) fn difference(a: &Plane, b: &Plane) -> Plane {
    sum(a, -1.0, b)
}

/// `a + factor b`.
pub(super) fn sum(a: &Plane, factor: f64, b: &Plane) -> Plane {
    let mut out = a.clone();
    vector::add_scaled(Isa::best(), out.pixels_mut(), factor, b.pixels());
    out
}

/// The largest absolute value.
pub(super) fn largest(plane: &Plane) -> f64 {
    let rows = plane.pixels().par_chunks(plane.size().width);
    let largest = rows.map(|row| row.iter().fold(0.0, |top: f32, value| top.max(value.abs())));
    f64::from(largest.into_iter().fold(0.0, f32::max))
}
