//! Sliding minima and maxima of the measured pixels over a square, for a strip of rows.

use super::least;
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
    /// For `rows` rows from row `first`: the range over the square from `radius` pixels before to `radius` after.
    /// Where no pixel of the square was measured, low is infinite and high minus infinity.
    pub(super) fn new(mask: &Mask, samples: &Plane, first: usize, rows: usize, radius: usize) -> Self {
        let width = mask.size().width;
        let (stride, count) = (width + 2 * radius, rows + 2 * radius);
        let mut low = vec![f32::INFINITY; stride * count];
        let mut high = low.clone();
        for row in 0..count {
            let Some(y) = (first + row).checked_sub(radius).filter(|&y| y < mask.size().height) else {
                continue;
            };
            let start = row * stride + radius;
            let (low, high) = (&mut low[start..][..width], &mut high[start..][..width]);
            for (((low, high), &value), &flag) in
                low.iter_mut().zip(high).zip(samples.row(y)).zip(mask.row(y))
            {
                *low = if flag { value } else { f32::INFINITY };
                *high = if flag { -value } else { f32::INFINITY };
            }
        }
        let mut scratch = vec![0.0; stride];
        for plane in [&mut low, &mut high] {
            down(plane, stride, 2 * radius + 1);
            plane.truncate(rows * stride);
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
