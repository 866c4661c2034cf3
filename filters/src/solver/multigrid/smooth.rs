//! The smoother of a level: a polynomial in its matrix.
//!
//! The polynomial is Chebyshev's of the fourth kind in `B (A + D)`, which takes no lower bound and made one iteration in eight
//! unnecessary against the first kind's. Source: J. Lottes, "Optimal polynomial smoothers for multigrid V-cycles",
//! Numerical Linear Algebra with Applications 30, 2023.
//!
//! All steps are taken in one way down strips of the window ([`crate::kernel::cascade`]), so memory is passed over once for a
//! smoothing. As a polynomial in one matrix it is symmetric, and nothing is special where strips or threads meet: with tiles one
//! after the other, which took the unknowns around them as given, the slowest places were the corners of tiles.

use std::ops::Range;

use rayon::prelude::*;

use super::Level;
use crate::kernel::Isa;
use crate::kernel::cascade::{self, Out, Scratch, Strip};
use crate::kernel::simd::{Lanes, MOST};
use crate::kernel::stencil::{PAD, Part, Window, apply};
use crate::kernel::vector;
use crate::solver::pool::Pool;

/// Steps of the smoother before and after the coarse correction.
const DEGREE: usize = 3;
/// Added to the middle of the smoother's blur.
const CENTRE: f64 = 1.0;
/// Most rows of a band, which is a task, and columns of a strip, whose rings of rows (300 kB in f32) are to be in L2.
const SIDES: (usize, usize) = (240, 400);
/// Most rows and columns of a tile whose largest eigenvalue is estimated.
const TILE: (usize, usize) = (64, 640);
/// Tiles of a level whose largest eigenvalues are estimated, at most.
const SAMPLES: usize = 12;
/// Columns of them that are taken.
const SAMPLE: usize = 128;

impl<T: Lanes> Level<T> {
    /// Smooths what `from` (or zero) lacks to solve for `r`, into `x`. With `rest`, this becomes `share` times what is left of `r`.
    pub fn smooth(
        &self,
        isa: Isa,
        (r, from): (&[T], Option<&[T]>),
        x: &mut [T],
        rest: Option<&mut [T]>,
        pool: &Pool<Scratch<T>>,
    ) {
        let (window, stride) = (self.window, self.window.stride());
        let bands = bands(window.height, SIDES.0);
        let factors = polynomial(self.high);
        let mut outputs = Vec::new();
        let (mut x, mut rest) = (&mut x[PAD * stride..], rest.map(|rest| &mut rest[PAD * stride..]));
        for band in bands {
            let length = band.len() * stride;
            let own = x.split_off_mut(..length).unwrap_or_default();
            let left = rest.as_mut().map(|rest| rest.split_off_mut(..length).unwrap_or_default());
            outputs.push((band, own, left));
        }
        let work = |(rows, x, mut rest): (Range<usize>, &mut [T], Option<&mut [T]>)| {
            let mut scratch = pool.lend();
            for columns in strips(window.width) {
                let reach = cascade::reach(self.a.terms, DEGREE);
                let (top, bottom) = (rows.start.saturating_sub(reach), window.height.min(rows.end + reach));
                let aside = reach.next_multiple_of(MOST);
                let (left, right) =
                    (columns.start.saturating_sub(aside), window.width.min(columns.end + aside));
                let strip = Window {
                    y: window.y + top,
                    x: window.x + left,
                    height: bottom - top,
                    width: right - left,
                };
                let part = |values| Part::new(values, window, (top, left));
                let out = Out { stride, first: PAD + columns.start, x: &mut *x, rest: rest.as_deref_mut() };
                let strip = Strip {
                    a: &self.a,
                    points: self.points.as_ref().map(|points| (points, window, (top, left))),
                    window: strip,
                    e: part(&self.e),
                    r: part(r),
                    x: from.map(part),
                    factors: &factors,
                    c: CENTRE,
                    rows: rows.start - top..rows.end - top,
                    columns: columns.start - left..columns.end - left,
                    out,
                };
                cascade::cascade(isa, strip, &mut scratch);
            }
        };
        if window.is_large() {
            outputs.into_par_iter().for_each(work);
        } else {
            outputs.into_iter().for_each(work);
        }
    }

    /// The tile of some rows that is the `k`-th from the left.
    fn part(&self, first: usize, height: usize, k: usize) -> Window {
        let left = k * TILE.1;
        let width = TILE.1.min(self.window.width - left);
        Window { y: self.window.y + first, x: self.window.x + left, height, width }
    }

    /// Where a tile begins in the window.
    fn place(&self, tile: Window) -> (usize, usize) {
        (tile.y - self.window.y, tile.x - self.window.x)
    }

    /// `q = (A + D) x` on a tile.
    pub fn product(&self, isa: Isa, tile: Window, x: &[T], q: &mut [T]) {
        apply(isa, &self.a, tile, x, None, q);
        if let Some(points) = &self.points {
            points.add(isa, self.window, self.place(tile), tile, x, q);
        }
    }

    /// A bound of the preconditioned matrix's eigenvalues on any tile, by power iteration on some of them. It exceeds that of the
    /// matrix without a mask (138 for the cardinal spline of order 2).
    pub fn bound(&self, isa: Isa) -> f64 {
        const MARGIN: f64 = 1.2;
        let across = self.window.width.div_ceil(TILE.1);
        let tiles: Vec<Window> = bands(self.window.height, TILE.0)
            .into_iter()
            .flat_map(|rows| (0..across).map(move |k| (rows.start, rows.len(), k)))
            .map(|(first, height, k)| self.part(first, height, k))
            .map(|tile| Window { width: tile.width.min(SAMPLE), ..tile })
            .collect();
        let every = tiles.len().div_ceil(SAMPLES);
        let some: Vec<Window> = tiles.into_iter().step_by(every).collect();
        let largest: Vec<f64> = some.into_par_iter().map(|tile| self.largest(isa, tile)).collect();
        let high = MARGIN * largest.into_iter().fold(0.0, f64::max);
        if high > 0.0 { high } else { 1.0 }
    }

    /// The largest eigenvalue of the preconditioned matrix of a tile by power iteration.
    fn largest(&self, isa: Isa, tile: Window) -> f64 {
        const STEPS: usize = 10;
        let at = self.place(tile);
        let (stride, factors) = (tile.stride(), |norm: f64| [(0.0, -1.0 / norm)]);
        let [mut x, mut next, mut e, zero] = std::array::from_fn(|_| tile.zeros::<T>());
        // A start that is rough and has a share in every free unknown.
        for i in 0..tile.height {
            let own = &self.e[self.window.at(at.0 + i, at.1)..][..tile.width];
            e[tile.at(i, 0)..][..tile.width].copy_from_slice(own);
            for (j, &e) in own.iter().enumerate() {
                let sign = if (i + j) % 2 == 0 { 1.0 } else { -1.0 };
                let rough = T::from_f64(sign * (1.0 + 0.2 * ((i * 7 + j * 3) % 5) as f64));
                x[tile.at(i, j)] = e * rough;
            }
        }
        let mut norm = vector::dot(isa, &x, &x).0.sqrt();
        let mut value = 0.0;
        let mut scratch = Scratch::default();
        for _ in 0..STEPS {
            if norm.is_nan() || norm <= 0.0 {
                break;
            }
            // A step from `x` for a right-hand side of zero: `x + E (B + c) E (A + D) x / norm`.
            let part = |values| Part::new(values, tile, (0, 0));
            let strip = Strip {
                a: &self.a,
                points: self.points.as_ref().map(|points| (points, self.window, at)),
                window: tile,
                e: part(&e),
                r: part(&zero),
                x: Some(part(&x)),
                factors: &factors(norm),
                c: CENTRE,
                rows: 0..tile.height,
                columns: 0..tile.width,
                out: Out { stride, first: PAD, x: &mut next[PAD * stride..], rest: None },
            };
            cascade::cascade(isa, strip, &mut scratch);
            vector::add_scaled(isa, &mut next, -1.0, &x);
            std::mem::swap(&mut x, &mut next);
            value = vector::dot(isa, &x, &x).0.sqrt();
            norm = value;
        }
        value
    }
}

/// Per step the share of the step before, and the factor of the preconditioned residual, for eigenvalues up to `high`.
fn polynomial(high: f64) -> [(f64, f64); DEGREE] {
    std::array::from_fn(|step| {
        let k = (step + 1) as f64;
        let share = if step > 0 { (2.0 * k - 3.0) / (2.0 * k + 1.0) } else { 0.0 };
        (share, (8.0 * k - 4.0) / ((2.0 * k + 1.0) * high))
    })
}

/// Rows of bands of about the same height, at most `most`.
fn bands(height: usize, most: usize) -> Vec<Range<usize>> {
    let count = height.div_ceil(most);
    (0..count).map(|k| k * height / count..(k + 1) * height / count).collect()
}

/// Columns of strips of about the same width, each beginning at a multiple of the longest vector.
fn strips(width: usize) -> impl Iterator<Item = Range<usize>> {
    let count = width.div_ceil(SIDES.1);
    let side = width.div_ceil(count).next_multiple_of(MOST);
    (0..width).step_by(side).map(move |left| left..width.min(left + side))
}
