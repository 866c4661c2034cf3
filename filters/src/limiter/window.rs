//! Sliding minima and maxima of the measured pixels over a square, for a strip of rows.

use std::ops::Range;

use super::{least, or_infinite};
use crate::{Mask, Plane};

/// Per pixel of a strip of rows the range of the measured pixels around it.
pub(super) struct Ranges {
    low: Vec<f32>,
    /// Negated, so that both are minima; negated back at the end.
    high: Vec<f32>,
    width: usize,
    stride: usize,
}

impl Ranges {
    /// For a range of rows and columns: the range over the square from `radius` pixels before to `radius` after.
    /// Where no pixel of the square was measured, low is infinite and high minus infinity.
    pub(super) fn new(
        (mask, samples): (&Mask, &Plane),
        rows: Range<usize>,
        columns: Range<usize>,
        radius: usize,
    ) -> Self {
        let size = mask.size();
        let (width, stride) = (columns.len(), columns.len() + 2 * radius);
        let mut low = vec![f32::INFINITY; stride * (rows.len() + 2 * radius)];
        let mut high = low.clone();
        let reach = |range: &Range<usize>, end: usize| {
            range.start.saturating_sub(radius)..end.min(range.end + radius)
        };
        let from = reach(&columns, size.width);
        for y in reach(&rows, size.height) {
            let start = (y + radius - rows.start) * stride + from.start + radius - columns.start;
            let (low, high) = (&mut low[start..][..from.len()], &mut high[start..][..from.len()]);
            let pixels = samples.row(y)[from.clone()].iter().zip(&mask.row(y)[from.clone()]);
            for ((low, high), (&value, &flag)) in low.iter_mut().zip(high).zip(pixels) {
                *low = or_infinite(value, flag);
                *high = or_infinite(-value, flag);
            }
        }
        let mut scratch = vec![0.0; stride];
        for plane in [&mut low, &mut high] {
            down(plane, stride, 2 * radius + 1);
            plane.truncate(rows.len() * stride);
            plane.chunks_mut(stride).for_each(|row| along(row, &mut scratch, 2 * radius + 1));
        }
        for value in &mut high {
            *value = -*value;
        }
        Self { low, high, width, stride }
    }

    /// Smallest and largest values around the pixels of row `y` of the strip.
    pub(super) fn row_mut(&mut self, y: usize) -> (&mut [f32], &mut [f32]) {
        let start = y * self.stride;
        (&mut self.low[start..][..self.width], &mut self.high[start..][..self.width])
    }
}

/// The steps by which windows grow from one value to `length`: each is the union of two of the width before, the
/// second shifted by the step. All but the last double the width.
fn steps(length: usize) -> impl Iterator<Item = usize> {
    std::iter::successors(Some((0, 1)), move |&(_, width)| {
        let step = width.min(length - width);
        (step > 0).then_some((step, width + step))
    })
    .skip(1)
    .map(|(step, _)| step)
}

/// Minima over `length` rows from each row downwards, in place; towards the end, over fewer.
fn down(plane: &mut [f32], stride: usize, length: usize) {
    for step in steps(length) {
        for start in (0..plane.len().saturating_sub(step * stride)).step_by(stride) {
            let (upper, lower) = plane[start..].split_at_mut(step * stride);
            lower_to(&mut upper[..stride], &lower[..stride]);
        }
    }
}

/// The minima of two rows, in the first. A function of its own, so that the compiler knows that the rows are two.
#[inline(never)]
fn lower_to(row: &mut [f32], other: &[f32]) {
    for (value, &other) in row.iter_mut().zip(other) {
        *value = least(*value, other);
    }
}

/// Minima over `length` values of a row from each value onwards, in place; towards the end, over fewer.
fn along(row: &mut [f32], scratch: &mut [f32], length: usize) {
    for step in steps(length) {
        // Through a second row: in place the loop would not run in vectors.
        for ((minimum, &a), &b) in scratch.iter_mut().zip(&*row).zip(&row[step..]) {
            *minimum = least(a, b);
        }
        let count = row.len() - step;
        row[..count].copy_from_slice(&scratch[..count]);
    }
}
