//! A cheap look at a strip of rows: which ranges of its columns can hold a pixel that has to be moved at all.
//!
//! The disc around any pixel of a small block holds the whole block, so that the bounds of the pixel enclose those that
//! follow from the measured pixels of the block alone. If the missing pixels of the block are within those, none of them is
//! moved, and the discs need not be searched. The result is the same with and without.

use std::ops::Range;

use super::{Bounds, least};
use crate::kernel::Isa;
use crate::kernel::minima::{poison, take};
use crate::{Mask, Plane};

/// Per column of a strip, what its pixels range over; maxima negated, so that all are minima.
struct Columns {
    measured: [Vec<f32>; 2],
    missing: [Vec<f32>; 2],
    /// Zero, or NaN if a missing pixel of the column is not finite.
    poison: Vec<f32>,
}

/// The side of the largest block whose diagonal fits a disc of this radius.
pub(super) fn side(radius: usize) -> usize {
    1 + (radius * radius / 2).isqrt()
}

/// Ranges of columns of some rows from row `first` on, in which all pixels lie that may be out of bounds; `out` holds those
/// rows of the reconstruction. Blocks have `side` columns and at most as many rows; ranges that are nearer to each other
/// than `gap` become one, as searching them would look at the pixels between twice.
pub(super) fn suspects(
    bounds: &Bounds,
    (mask, samples): (&Mask, &Plane),
    first: usize,
    out: &[f32],
    (side, gap): (usize, usize),
) -> Vec<Range<usize>> {
    let width = mask.size().width;
    let mut suspect = vec![false; width.div_ceil(side)];
    for (block, out) in out.chunks(width * side).enumerate() {
        let columns = Columns::new((mask, samples), first + block * side, out);
        for (index, suspect) in suspect.iter_mut().enumerate() {
            let left = index * side;
            *suspect = *suspect || !columns.within(bounds, left..width.min(left + side));
        }
    }
    let mut ranges: Vec<Range<usize>> = Vec::new();
    for (index, _) in suspect.iter().enumerate().filter(|(_, suspect)| **suspect) {
        let (left, right) = (index * side, width.min(index * side + side));
        match ranges.last_mut().filter(|last| left < last.end + gap) {
            Some(last) => last.end = right,
            None => ranges.push(left..right),
        }
    }
    ranges
}

impl Columns {
    fn new((mask, samples): (&Mask, &Plane), first: usize, out: &[f32]) -> Self {
        let width = mask.size().width;
        let none = || [vec![f32::INFINITY; width], vec![f32::INFINITY; width]];
        let mut columns = Self { measured: none(), missing: none(), poison: vec![0.0; width] };
        for (y, out) in out.chunks(width).enumerate() {
            columns.add(mask.row(first + y), samples.row(first + y), out);
        }
        columns
    }

    /// Takes in one row.
    fn add(&mut self, flags: &[bool], samples: &[f32], out: &[f32]) {
        let ([low, high], [from, to]) = (&mut self.measured, &mut self.missing);
        let isa = Isa::best();
        take(isa, [low, high], flags, samples, true);
        take(isa, [from, to], flags, out, false);
        poison(isa, &mut self.poison, flags, out);
    }

    /// Whether the missing pixels of a block are within the bounds that its measured ones give.
    fn within(&self, bounds: &Bounds, block: Range<usize>) -> bool {
        let smallest = |values: &[f32]| values[block.clone()].iter().copied().fold(f32::INFINITY, least);
        let [low, high] = [smallest(&self.measured[0]), -smallest(&self.measured[1])];
        let [from, to] = [smallest(&self.missing[0]), -smallest(&self.missing[1])];
        let finite = !self.poison[block.clone()].iter().any(|poison| poison.is_nan());
        let (mut bottom, mut top) = ([low], [high]);
        bounds.widen(&mut bottom, &mut top);
        // A block without measured pixels says nothing: its discs may reach some.
        finite && (from > to || (low <= high && from >= bottom[0] && to <= top[0]))
    }
}
