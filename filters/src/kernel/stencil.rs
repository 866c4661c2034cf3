//! A sum of products of banded matrices, applied to a window of an image.
//!
//! ```text
//! q = sum over t of  V_t p H_t'      V_t: H x H, along columns;  H_t: W x W, along rows;  both banded, reach R <= 4
//! ```
//!
//! The window is a rectangle of the image. Its values stand in a buffer with [`PAD`] rows and columns around them, see
//! [`Window`]: zeros if what lies outside counts as zero, else its values. Beyond the image they may be any finite numbers.
//!
//! Roofline, per pixel and application at R = 3 with three terms: along rows 3 additions (the taps are symmetric away
//! from the borders), 3 multiplications and 9 multiply-adds, along columns 21 multiply-adds, and one for `p q`: 37
//! instructions a vector, 68 flops. A panel of 160 columns goes down row by row; its lines filtered along rows stay in
//! rings in L1 (13 kB used in f32 at 160 columns), so a window in L2 streams 4 bytes in and 4 bytes out. Two
//! arithmetic instructions a cycle would give 18 cycles a vector, 1.2 a pixel with 16 lanes of f32; memory is no limit.

use std::ops::Range;

use lacuna_core::parallel::prelude::*;

use super::interior::{self, Interior, Rows};
use super::simd::Lanes;
use super::window::{Axis, PAD, REACH, TERMS, Taps, WIDTH, Window};
use super::{Body, Isa, Real, dispatch, fma};
use crate::Size;

/// Values in a block: accumulators that stay in registers.
const BLOCK: usize = 32;
/// Lanes of a sum.
const LANES: usize = 16;
/// Blocks that are computed together, row by row: their rings stay in L1.
const PANEL: usize = 5;
/// Rows of a large window that one task computes.
const CHUNK: usize = 96;

/// A sum of products of banded matrices.
#[derive(Clone, Debug)]
pub struct Separable<T> {
    /// Along columns.
    pub vertical: Axis<T>,
    /// Along rows.
    pub horizontal: Axis<T>,
    /// Terms in use, which is also how far a row reaches to either side: 3 or 4.
    pub terms: usize,
    /// The same away from the upper and lower end.
    interior: Option<Interior<T>>,
}

impl Separable<f64> {
    /// Of matrices with so many terms.
    pub fn new(vertical: Axis<f64>, horizontal: Axis<f64>, terms: usize) -> Self {
        let interior = Interior::new(&vertical, &horizontal, terms);
        Self { vertical, horizontal, terms, interior }
    }
}

impl<T: Real> Separable<T> {
    /// The size of the image.
    pub fn size(&self) -> Size {
        Size::new(self.vertical.len, self.horizontal.len)
    }

    /// The same with other numbers.
    pub fn cast<U: Real>(&self) -> Separable<U> {
        Separable {
            vertical: self.vertical.cast(),
            horizontal: self.horizontal.cast(),
            terms: self.terms,
            interior: self.interior.as_ref().map(Interior::cast),
        }
    }

    /// Rows of a window that Horner's scheme computes.
    pub fn inside(&self, window: Window) -> Range<usize> {
        let Some(interior) = &self.interior else { return 0..0 };
        let limit = |row: usize| row.saturating_sub(window.y).min(window.height);
        let from = limit(interior.rows);
        from..limit(self.vertical.len - interior.rows).max(from)
    }

    /// The same away from the upper and lower end, if there is anything away from them.
    pub(super) fn interior(&self) -> Option<&Interior<T>> {
        self.interior.as_ref()
    }

    /// The diagonal entry of pixel `(y, x)`.
    pub fn diagonal(&self, y: usize, x: usize) -> f64 {
        let (rows, columns) = (self.vertical.row(y), self.horizontal.row(x));
        (0..self.terms).map(|t| rows[t][REACH].to_f64() * columns[t][REACH].to_f64()).sum()
    }

    /// The entry between pixels `(y, x)` and `(v, u)`.
    pub fn entry(&self, (y, x): (usize, usize), (v, u): (usize, usize)) -> f64 {
        let (dy, dx) = ((v + REACH).wrapping_sub(y), (u + REACH).wrapping_sub(x));
        if dy >= WIDTH || dx >= WIDTH {
            return 0.0;
        }
        let (rows, columns) = (self.vertical.row(y), self.horizontal.row(x));
        (0..self.terms).map(|t| rows[t][dy].to_f64() * columns[t][dx].to_f64()).sum()
    }
}

/// Rows of a tile in a larger buffer.
#[derive(Clone, Copy, Debug)]
pub struct Part<'a, T> {
    /// The buffer.
    pub values: &'a [T],
    /// Where the tile's first row begins in it.
    pub start: usize,
    /// Values from one row to the next.
    pub stride: usize,
}

impl<'a, T> Part<'a, T> {
    /// The tile whose first pixel is row `i`, column `j` of the window that `values` belong to.
    pub fn new(values: &'a [T], window: Window, (i, j): (usize, usize)) -> Self {
        Self { values, start: window.at(i, j), stride: window.stride() }
    }
}

/// `q = (A + diag(d)) p` on a window; returns the sum of `p q`. The padding of `q` stays as it is.
pub fn apply<T: Lanes>(
    isa: Isa,
    a: &Separable<T>,
    window: Window,
    p: &[T],
    d: Option<&[T]>,
    q: &mut [T],
) -> f64 {
    let stride = window.stride();
    let rows = &mut q[PAD * stride..][..window.height * stride];
    let near_ends = |first: usize, q: &mut [T]| any_rows(isa, Apply { a, window, p, d, first, q });
    let chunk = |(index, q): (usize, &mut [T])| {
        let (first, count) = (index * CHUNK, q.len() / stride);
        let Some(interior) = &a.interior else { return near_ends(first, q) };
        // Rows of this chunk before those away from the ends, and before those after them.
        let limit = |row: usize| row.saturating_sub(window.y + first).min(count);
        let (from, to) = (limit(interior.rows), limit(a.vertical.len - interior.rows));
        let (q, below) = q.split_at_mut(to * stride);
        let (above, q) = q.split_at_mut(from.min(to) * stride);
        let mut sum = 0.0;
        if !above.is_empty() {
            sum += near_ends(first, above);
        }
        if !q.is_empty() {
            sum += interior::apply(isa, a.terms, Rows { interior, window, p, d, first: first + from, q });
        }
        if !below.is_empty() {
            sum += near_ends(first + to, below);
        }
        sum
    };
    if window.is_large() {
        let sums: Vec<f64> = rows.par_chunks_mut(CHUNK * stride).enumerate().map(chunk);
        sums.iter().sum()
    } else {
        chunk((0, rows))
    }
}

/// `q = A p` on any rows of a window, also near the ends of the image; `q` is those rows in whole strides. Returns their
/// sum of `p q`.
pub(super) fn near_ends<T: Lanes>(
    isa: Isa,
    a: &Separable<T>,
    window: Window,
    p: &[T],
    first: usize,
    q: &mut [T],
) -> f64 {
    any_rows(isa, Apply { a, window, p, d: None, first, q })
}

fn any_rows<T: Lanes>(isa: Isa, body: Apply<'_, T>) -> f64 {
    match body.a.terms {
        3 => dispatch(isa, Sized::<T, 3>(body)),
        _ => dispatch(isa, Sized::<T, 4>(body)),
    }
}

struct Apply<'a, T> {
    a: &'a Separable<T>,
    window: Window,
    p: &'a [T],
    d: Option<&'a [T]>,
    first: usize,
    q: &'a mut [T],
}

/// The body for a number of terms that the compiler knows.
struct Sized<'a, T, const R: usize>(Apply<'a, T>);

/// The latest `2R + 1` lines of [`BLOCK`] columns, filtered along rows with each term's taps.
type Ring<T> = [[[T; BLOCK]; TERMS]; WIDTH];

impl<T: Real, const R: usize> Body for Sized<'_, T, R> {
    type Output = f64;

    #[inline(always)]
    fn run<const FUSED: bool>(mut self) -> f64 {
        let mut rings = [[[[T::ZERO; BLOCK]; TERMS]; WIDTH]; PANEL];
        let blocks = self.0.window.width.div_ceil(BLOCK);
        let mut sum = 0.0;
        for start in (0..blocks).step_by(PANEL) {
            let count = PANEL.min(blocks - start);
            sum += self.0.panel::<R, FUSED>(start * BLOCK, &mut rings[..count]);
        }
        sum
    }
}

impl<T: Real> Apply<'_, T> {
    /// Computes the columns from `from` on that the rings have room for; returns their sum of `p q`.
    #[inline(always)]
    fn panel<const R: usize, const FUSED: bool>(&mut self, from: usize, rings: &mut [Ring<T>]) -> f64 {
        let (window, stride) = (self.window, self.window.stride());
        let count = self.q.len() / stride;
        let depth = 2 * R + 1;
        let width = (rings.len() * BLOCK).min(window.width - from);
        let mut total = 0.0;
        // Row `first + step - R` of the window goes into the rings; then row `first + step - 2R` can be computed.
        for step in 0..count + 2 * R {
            let slot = step % depth;
            self.along_row::<R, FUSED>(self.first + step + PAD - R, from, slot, rings);
            let Some(output) = step.checked_sub(2 * R) else { continue };
            let i = self.first + output;
            let taps = self.a.vertical.row(window.y + i);
            // The taps in the order of the slots, so that the slots have fixed places.
            let mut turned = [[T::ZERO; TERMS]; WIDTH];
            for k in 0..depth {
                turned[(slot + 1 + k) % depth] = std::array::from_fn(|t| taps[t][REACH - R + k]);
            }
            let at = window.at(i, from);
            let d = self.d.map(|d| &d[at..][..width]);
            let q = &mut self.q[output * stride + PAD + from..][..width];
            total += along_columns::<T, R, FUSED>(rings, &turned, &self.p[at..][..width], d, q);
        }
        total
    }

    /// Filters the columns from `from` on of row `i` of the buffer with each term's taps.
    #[inline(always)]
    fn along_row<const R: usize, const FUSED: bool>(
        &self,
        i: usize,
        from: usize,
        slot: usize,
        rings: &mut [Ring<T>],
    ) {
        let (window, axis) = (self.window, &self.a.horizontal);
        let row = &self.p[i * window.stride() + from..];
        let taps = axis.row(axis.len / 2);
        if axis.ends < axis.len {
            for (b, ring) in rings.iter_mut().enumerate() {
                if let Some(near) = row[b * BLOCK..].first_chunk() {
                    symmetric::<T, R, FUSED>(taps, near, &mut ring[slot]);
                }
            }
        }
        // Columns near the image's borders have rows of their own.
        let end = (from + rings.len() * BLOCK).min(window.width);
        let left = axis.ends.saturating_sub(window.x).clamp(from, end);
        let right = (axis.len - axis.ends).saturating_sub(window.x).clamp(left, end);
        for j in (from..left).chain(right..end) {
            let taps = axis.row(window.x + j);
            let j = j - from;
            for (t, term) in taps.iter().enumerate().take(R) {
                let mut sum = T::ZERO;
                for k in 0..=2 * R {
                    sum = fma::<T, FUSED>(term[REACH - R + k], row[PAD - R + j + k], sum);
                }
                rings[j / BLOCK][slot][t][j % BLOCK] = sum;
            }
        }
    }
}

/// Filters a block with taps that are the same to either side.
#[inline(always)]
fn symmetric<T: Real, const R: usize, const FUSED: bool>(
    taps: &Taps<T>,
    near: &[T; BLOCK + 2 * PAD],
    lines: &mut [[T; BLOCK]; TERMS],
) {
    let mut sums = [[T::ZERO; BLOCK]; TERMS];
    for j in 0..BLOCK {
        for t in 0..R {
            sums[t][j] = taps[t][REACH] * near[PAD + j];
        }
    }
    for k in 1..=R {
        for j in 0..BLOCK {
            let pair = near[PAD + j - k] + near[PAD + j + k];
            for t in 0..R {
                sums[t][j] = fma::<T, FUSED>(taps[t][REACH + k], pair, sums[t][j]);
            }
        }
    }
    *lines = sums;
}

/// Sums the lines around a row, each with its tap, into `q`; returns the sum of `p q`.
#[inline(always)]
fn along_columns<T: Real, const R: usize, const FUSED: bool>(
    rings: &[Ring<T>],
    taps: &[[T; TERMS]; WIDTH],
    p: &[T],
    d: Option<&[T]>,
    q: &mut [T],
) -> f64 {
    for (b, (ring, q)) in rings.iter().zip(q.chunks_mut(BLOCK)).enumerate() {
        let mut sums = [T::ZERO; BLOCK];
        for k in 0..=2 * R {
            for t in 0..R {
                for j in 0..BLOCK {
                    sums[j] = fma::<T, FUSED>(taps[k][t], ring[k][t][j], sums[j]);
                }
            }
        }
        match q.first_chunk_mut() {
            Some(whole) => *whole = sums,
            None => q.copy_from_slice(&sums[..q.len()]),
        }
        if let Some(d) = d {
            for ((q, &d), &p) in q.iter_mut().zip(&d[b * BLOCK..]).zip(&p[b * BLOCK..]) {
                *q = fma::<T, FUSED>(d, p, *q);
            }
        }
    }
    lanes_dot::<T, FUSED>(p, q)
}

/// The sum of `p q`, in lanes and then in f64.
#[inline(always)]
pub fn lanes_dot<T: Real, const FUSED: bool>(p: &[T], q: &[T]) -> f64 {
    let mut lanes = [T::ZERO; LANES];
    let (p_blocks, q_blocks) = (p.as_chunks::<LANES>(), q.as_chunks::<LANES>());
    for (p, q) in p_blocks.0.iter().zip(q_blocks.0) {
        for i in 0..LANES {
            lanes[i] = fma::<T, FUSED>(p[i], q[i], lanes[i]);
        }
    }
    for (lane, (&p, &q)) in lanes.iter_mut().zip(p_blocks.1.iter().zip(q_blocks.1)) {
        *lane = fma::<T, FUSED>(p, q, *lane);
    }
    lanes.iter().map(|x| x.to_f64()).sum()
}

#[cfg(test)]
mod tests;
