//! Nearest: each missing pixel takes the measured pixel that lies closest, bit for bit.
//!
//! For the mask `m` (`H x W`, row-major) with measured pixels `M`, the pixel (y, x) copies
//! `argmin over (v, u) in M of (y - v)^2 + (x - u)^2`; of several the first in row-major order.
//!
//! Algorithm: the distance transform of sampled functions, with the place of the minimum kept. Rows first: each pixel
//! finds the nearest measured column of its row. Then columns: the lower envelope of the parabolas
//! `(y - v)^2 + d(v)^2`, one for each row v that has a measured pixel. All in integers, thus exact.
//! Cost: O(H W), independent of the density; rows and columns in parallel; four planes of u32 while planning, one kept.
//! No settings, no iterations. [`NearestMap`] serves every type of pixel: identifiers, halfs, f32.
//! Fails: on everything smooth; it is meant for identifiers and as a floor in comparisons.
//!
//! Sources: P. Felzenszwalb, D. Huttenlocher, "Distance Transforms of Sampled Functions", Theory of Computing 8, 2012
//! (section 2, the envelope); A. Meijster, J. Roerdink, W. Hesselink, "A General Algorithm for Computing Distance
//! Transforms in Linear Time", Mathematical Morphology and its Applications, 2000 (integer separators).

mod cells;

use std::sync::Arc;

use lacuna_core::parallel::prelude::*;

use crate::descriptor::Kind;
use crate::descriptor::{Configured, Descriptor, Memory, Takes};
use crate::{Error, Filter, Mask, Outcome, Plan, Planes, Problem, Run, Size, check};

pub(crate) use cells::{Cells, UNEVEN};

/// No settings.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Settings;

/// What is to be known of it.
pub static DESCRIPTOR: Descriptor = Descriptor {
    name: "nearest",
    help: "The nearest measured pixel",
    settings: &[],
    even: Memory { image: 30, channel: 2 },
    uneven: Memory { image: 106, channel: 2 },
    takes: Takes::NOTHING,
    restores: false,
    held_out: Some(Kind::Distance),
    new: || Box::new(Settings),
};

impl Configured for Settings {
    fn descriptor(&self) -> &'static Descriptor {
        &DESCRIPTOR
    }

    fn boxed(&self) -> Box<dyn Configured> {
        Box::new(*self)
    }
}

impl Filter for Settings {
    fn plan(&self, problem: &Problem, _run: &Run<'_>) -> Result<Box<dyn Plan>, Error> {
        Ok(Box::new(Planned { map: NearestMap::new(&problem.mask)?, mask: problem.mask.clone() }))
    }
}

struct Planned {
    mask: Arc<Mask>,
    map: NearestMap,
}

impl Plan for Planned {
    fn reconstruct(&self, samples: &Planes, out: &mut Planes, _run: &Run<'_>) -> Result<Outcome, Error> {
        check::group(&self.mask, samples, out)?;
        for (samples, out) in samples.as_slice().iter().zip(out.as_mut_slice()) {
            self.map.copy(samples.pixels(), out.pixels_mut())?;
        }
        Ok(Outcome::direct())
    }
}

/// For each pixel the measured pixel whose bits it takes; a measured pixel is its own.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct NearestMap {
    size: Size,
    source: Vec<u32>,
}

impl NearestMap {
    /// The nearest measured pixel by Euclidean distance; of several the first in row-major order.
    ///
    /// # Errors
    /// [`Error::EmptyMask`]; [`Error::TooLarge`] if the image has 2^32 pixels or more.
    pub fn new(mask: &Mask) -> Result<Self, Error> {
        let size = mask.size();
        mask.require_samples()?;
        if u32::try_from(size.pixels()).is_err() {
            return Err(Error::TooLarge { size });
        }
        let mut columns = vec![NONE; size.pixels()];
        columns.par_chunks_mut(size.width).zip(mask.as_slice().par_chunks(size.width)).for_each(
            |(columns, flags)| {
                nearest_in_row(flags, columns);
            },
        );
        Ok(Self { size, source: nearest_in_columns(size, &columns) })
    }

    /// A map of any other origin; each index is that of a pixel of the image.
    pub(super) fn from_source(size: Size, source: Vec<u32>) -> Self {
        Self { size, source }
    }

    /// Height and width of the image.
    pub const fn size(&self) -> Size {
        self.size
    }

    /// Per pixel, row-major, the row-major index of the measured pixel to copy.
    pub fn as_slice(&self) -> &[u32] {
        &self.source
    }

    /// Squared distance of each pixel to the one that the map points at; at most `u32::MAX`.
    pub fn squared_distances(&self) -> Vec<u32> {
        let width = self.size.width;
        let squared = |(pixel, &source): (usize, &u32)| {
            let source = source as usize;
            let (dy, dx) =
                ((pixel / width).abs_diff(source / width), (pixel % width).abs_diff(source % width));
            u32::try_from(dy * dy + dx * dx).unwrap_or(u32::MAX)
        };
        self.source.iter().enumerate().map(squared).collect()
    }

    /// Fills `out` with the values of `samples` that the map points at. Values at missing pixels are not used.
    ///
    /// # Errors
    /// [`Error::SizeMismatch`] if either has another number of pixels than the map.
    pub fn copy<T: Copy + Send + Sync>(&self, samples: &[T], out: &mut [T]) -> Result<(), Error> {
        for len in [samples.len(), out.len()] {
            if len != self.source.len() {
                return Err(Error::SizeMismatch { expected: self.size, found: format!("{len} values") });
            }
        }
        let task = 1 << 14;
        out.par_chunks_mut(task).zip(self.source.par_chunks(task)).for_each(|(out, source)| {
            for (out, &source) in out.iter_mut().zip(source) {
                *out = samples[source as usize];
            }
        });
        Ok(())
    }
}

/// In a table of columns: the row has no measured pixel.
const NONE: u32 = u32::MAX;

/// Columns that one task handles: one cache line of indices.
const COLUMNS: usize = 16;

/// The nearest measured column of each pixel of one row, the left one of two; [`NONE`] in a row without any.
fn nearest_in_row(flags: &[bool], columns: &mut [u32]) {
    let mut last = NONE;
    for (x, (flag, column)) in flags.iter().zip(columns.iter_mut()).enumerate() {
        last = if *flag { x as u32 } else { last };
        *column = last;
    }
    let mut next = NONE;
    for (x, column) in columns.iter_mut().enumerate().rev() {
        let x = x as u32;
        next = if *column == x { x } else { next };
        if *column == NONE || (next != NONE && next - x < x - *column) {
            *column = next;
        }
    }
}

/// The nearest measured pixel, as an index, from the nearest measured column in each row.
fn nearest_in_columns(size: Size, columns: &[u32]) -> Vec<u32> {
    let blocks: Vec<Vec<u32>> = (0..size.width.div_ceil(COLUMNS)).into_par_iter().map(|block| {
        let first = block * COLUMNS;
        let count = COLUMNS.min(size.width - first);
        let mut found = vec![0; size.height * count];
        let mut gathered = vec![NONE; size.height * count];
        for (y, row) in columns.chunks(size.width).enumerate() {
            for (x, &column) in row[first..first + count].iter().enumerate() {
                gathered[x * size.height + y] = column;
            }
        }
        let mut envelope = Envelope::default();
        for (x, column) in gathered.chunks(size.height).enumerate() {
            envelope.build((first + x) as i64, column);
            envelope.lookup(column, size.width, |y, index| found[y * count + x] = index);
        }
        found
    });
    let mut source = vec![0; size.pixels()];
    source.par_chunks_mut(size.width).enumerate().for_each(|(y, row)| {
        for (row, block) in row.chunks_mut(COLUMNS).zip(&blocks) {
            row.copy_from_slice(&block[y * row.len()..][..row.len()]);
        }
    });
    source
}

/// The lower envelope of a column's parabolas, from the top of the image downwards.
#[derive(Default)]
struct Envelope {
    pieces: Vec<Piece>,
}

/// A parabola and the first row where it is the lowest.
#[derive(Clone, Copy)]
struct Piece {
    /// Row of the vertex.
    row: i64,
    /// Squared horizontal distance: the value at the vertex.
    base: i64,
    /// First row of this piece.
    from: i64,
}

impl Piece {
    fn at(&self, y: i64) -> i64 {
        (y - self.row).pow(2) + self.base
    }
}

impl Envelope {
    /// `columns[v]` is the nearest measured column of row v, seen from column `x`.
    fn build(&mut self, x: i64, columns: &[u32]) {
        self.pieces.clear();
        let height = columns.len() as i64;
        for (row, &column) in columns.iter().enumerate().filter(|(_, column)| **column != NONE) {
            let mut next = Piece { row: row as i64, base: (x - i64::from(column)).pow(2), from: 0 };
            // On equal height the upper parabola stays: that breaks ties in row-major order.
            while self.pieces.last().is_some_and(|last| last.at(last.from) > next.at(last.from)) {
                self.pieces.pop();
            }
            if let Some(last) = self.pieces.last() {
                // The last row where the upper of the two is not the higher one.
                let rise = next.row.pow(2) - last.row.pow(2) + next.base - last.base;
                next.from = rise.div_euclid(2 * (next.row - last.row)) + 1;
            }
            if next.from < height {
                self.pieces.push(next);
            }
        }
    }

    /// Calls `put` with each row and the index of its nearest measured pixel.
    fn lookup(&self, columns: &[u32], width: usize, mut put: impl FnMut(usize, u32)) {
        for (i, piece) in self.pieces.iter().enumerate() {
            let end = self.pieces.get(i + 1).map_or(columns.len(), |next| next.from as usize);
            let row = piece.row as usize;
            let index = (row * width) as u32 + columns[row];
            (piece.from as usize..end).for_each(|y| put(y, index));
        }
    }
}

#[cfg(test)]
mod tests;
