//! The vectors of conjugate gradients on the part of a window that counts.
//!
//! Roofline: the sums read four streams and take six flops a pixel, a step reads six, writes four and takes eight; both from memory, a
//! row at a time. Sums are formed per row of cells and combined in order.

use std::ops::Range;

use lacuna_core::parallel::prelude::*;

use super::spans::Spans;
use super::vector::Dot;
use super::window::{PAD, Window};
use super::{Body, Isa, Real, dispatch, fma};

/// Rows that one task of a step takes.
const ROWS: usize = 16;
/// Lanes of a maximum.
const LANES: usize = 16;

/// The vectors, buffers of a window; the preconditioner returns what it leaves of the residual.
pub struct Gradients<'a, T> {
    /// The window.
    pub window: Window,
    /// The pixels that count.
    pub spans: &'a Spans,
    /// The residual.
    pub r: &'a mut [T],
    /// What the preconditioner's correction leaves of it.
    pub rest: &'a [T],
    /// The correction.
    pub z: &'a [T],
    /// The direction.
    pub p: &'a mut [T],
    /// Its product with the matrix.
    pub q: &'a mut [T],
    /// The solution.
    pub c: &'a mut [T],
}

/// Rows of two vectors.
type Two<'a, T> = (&'a mut [T], &'a mut [T]);

/// Sums over all unknowns.
#[derive(Clone, Copy, Debug, Default)]
pub struct Sums {
    /// Of `z r`.
    pub residual: f64,
    /// Of `z A z`.
    pub energy: f64,
    /// Of `z q`.
    pub before: f64,
}

impl Sums {
    fn with(self, other: Self) -> Self {
        Self {
            residual: self.residual + other.residual,
            energy: self.energy + other.energy,
            before: self.before + other.before,
        }
    }
}

impl<T: Real> Gradients<'_, T> {
    /// The sums that the next step needs, and per cell (row by row, `cell` pixels high and wide) the largest `|z|`; without a direction
    /// before, `q` is not read. Spans have to begin with cells.
    pub fn sums(&self, isa: Isa, begins: bool, cell: (usize, usize)) -> (Sums, Vec<f64>) {
        let part = |rows: Range<usize>, tops: &mut [T]| {
            let mut sums = Sums::default();
            for i in rows {
                for span in self.spans.row(i) {
                    let own = self.window.at(i, span.start)..self.window.at(i, span.end);
                    let [r, rest, z] = [&*self.r, self.rest, self.z].map(|values| &values[own.clone()]);
                    let q = if begins { None } else { Some(&self.q[own]) };
                    let tops = &mut tops[span.start / cell.1..];
                    sums = sums.with(dispatch(isa, Row { r, rest, z, q, width: cell.1, tops }));
                }
            }
            sums
        };
        let (parts, tops) = over_cells(self.window, cell, part);
        (parts.into_iter().fold(Sums::default(), Sums::with), tops)
    }

    /// `p = z + b p`, `q = A z + b q`, `c = c + a p`, `r = r - a q`. When it begins, `p` and `q` are not read.
    pub fn step(&mut self, isa: Isa, begins: bool, (a, b): (f64, f64)) {
        let factors = (T::from_f64(a), T::from_f64(b));
        let (window, spans, stride) = (self.window, self.spans, self.window.stride());
        let own = PAD * stride..(PAD + window.height) * stride;
        let [rest, z] = [self.rest, self.z].map(|values| &values[own.clone()]);
        let [r, p, q, c] =
            [&mut *self.r, &mut *self.p, &mut *self.q, &mut *self.c].map(|values| &mut values[own.clone()]);
        let chunk = |(k, ((r, p), (q, c))): (usize, (Two<'_, T>, Two<'_, T>))| {
            let first = k * ROWS;
            for i in first..window.height.min(first + ROWS) {
                for span in spans.row(i) {
                    let all = i * stride + PAD + span.start..i * stride + PAD + span.end;
                    let here = || all.start - first * stride..all.end - first * stride;
                    let (rest, z) = (&rest[all.clone()], &z[all.clone()]);
                    let (r, p, q, c) = (&mut r[here()], &mut p[here()], &mut q[here()], &mut c[here()]);
                    dispatch(isa, Step { begins, factors, r, rest, z, p, q, c });
                }
            }
        };
        let size = ROWS * stride;
        let (r, p) = (r.par_chunks_mut(size), p.par_chunks_mut(size));
        let chunks = r.zip(p).zip(q.par_chunks_mut(size).zip(c.par_chunks_mut(size))).enumerate();
        chunks.shared_if(window.is_large()).for_each(chunk);
    }

    /// The largest `|c|` of every cell, of those that do not count as well.
    pub fn tops(&self, isa: Isa, cell: (usize, usize)) -> Vec<f64> {
        let part = |rows: Range<usize>, tops: &mut [T]| {
            for i in rows {
                let row = &self.c[self.window.at(i, 0)..][..self.window.width];
                dispatch(isa, Tops { width: cell.1, row, cells: &mut *tops });
            }
        };
        over_cells(self.window, cell, part).1
    }
}

/// Does something for each row of cells, with room for a number per cell; returns the results and these numbers.
fn over_cells<T: Real, S: Send>(
    window: Window,
    cell: (usize, usize),
    part: impl Fn(Range<usize>, &mut [T]) -> S + Sync,
) -> (Vec<S>, Vec<f64>) {
    let part = |k: usize| {
        let mut numbers = vec![T::ZERO; window.width.div_ceil(cell.1)];
        (part(k * cell.0..window.height.min((k + 1) * cell.0), &mut numbers), numbers)
    };
    let parts = (0..window.height.div_ceil(cell.0)).into_par_iter();
    let parts: Vec<(S, Vec<T>)> = parts.shared_if(window.is_large()).map(part);
    let (results, numbers): (Vec<S>, Vec<Vec<T>>) = parts.into_iter().unzip();
    (results, numbers.into_iter().flatten().map(Real::to_f64).collect())
}

/// A span of a row: its sums, and the tops of its cells.
struct Row<'a, T> {
    r: &'a [T],
    rest: &'a [T],
    z: &'a [T],
    q: Option<&'a [T]>,
    width: usize,
    tops: &'a mut [T],
}

impl<T: Real> Body for Row<'_, T> {
    type Output = Sums;

    #[inline(always)]
    fn run<const FUSED: bool>(self) -> Sums {
        let Self { r, rest, z, q, width, tops } = self;
        let residual = Dot { x: r, y: z }.run::<FUSED>();
        let energy = residual - Dot { x: rest, y: z }.run::<FUSED>();
        // A closure would be compiled for other instructions.
        let before = match q {
            Some(q) => Dot { x: q, y: z }.run::<FUSED>(),
            None => 0.0,
        };
        Tops { width, row: z, cells: tops }.run::<FUSED>();
        Sums { residual, energy, before }
    }
}

/// Raises the top of each cell to the largest absolute value of its part of a row.
struct Tops<'a, T> {
    width: usize,
    row: &'a [T],
    cells: &'a mut [T],
}

impl<T: Real> Body for Tops<'_, T> {
    type Output = ();

    #[inline(always)]
    fn run<const FUSED: bool>(self) {
        for (top, values) in self.cells.iter_mut().zip(self.row.chunks(self.width)) {
            let mut tops = [*top; LANES];
            let (blocks, rest) = values.as_chunks::<LANES>();
            for block in blocks {
                for i in 0..LANES {
                    let size = block[i].magnitude();
                    tops[i] = if size > tops[i] { size } else { tops[i] };
                }
            }
            for size in tops.into_iter().chain(rest.iter().map(|value| value.magnitude())) {
                *top = if size > *top { size } else { *top };
            }
        }
    }
}

struct Step<'a, T> {
    begins: bool,
    factors: (T, T),
    r: &'a mut [T],
    rest: &'a [T],
    z: &'a [T],
    p: &'a mut [T],
    q: &'a mut [T],
    c: &'a mut [T],
}

impl<T: Real> Body for Step<'_, T> {
    type Output = ();

    #[inline(always)]
    fn run<const FUSED: bool>(self) {
        let (a, b) = self.factors;
        let Self { r, rest, z, p, q, c, .. } = self;
        if self.begins {
            p.fill(T::ZERO);
            q.fill(T::ZERO);
        }
        let inputs = r.iter_mut().zip(rest).zip(z);
        for ((((r, &rest), &z), p), (q, c)) in inputs.zip(p).zip(q.iter_mut().zip(c)) {
            *p = fma::<T, FUSED>(b, *p, z);
            *q = fma::<T, FUSED>(b, *q, *r - rest);
            *c = fma::<T, FUSED>(a, *p, *c);
            *r = fma::<T, FUSED>(-a, *q, *r);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn values(window: Window, seed: f64) -> Vec<f64> {
        (0..window.len()).map(|k| (k as f64 * seed).sin()).collect()
    }

    /// What counts is as the formulas say, entry by entry; nothing else is touched.
    #[test]
    fn sums_and_steps_are_those_of_what_counts() {
        let cell = (4, 8);
        for (height, width) in [(1, 1), (9, 21), (300, 310)] {
            let window = Window { y: 0, x: 0, height, width };
            let counts: Vec<bool> =
                (0..height.div_ceil(4) * width.div_ceil(8)).map(|k| k % 3 != 1 || k == 0).collect();
            let spans = Spans::of_cells(window, cell, &counts);
            let places: Vec<(usize, usize)> = (0..height)
                .flat_map(|i| (0..width).map(move |j| (i, j)))
                .map(|(i, j)| (window.at(i, j), i / cell.0 * width.div_ceil(cell.1) + j / cell.1))
                .filter(|&(_, cell)| counts[cell])
                .collect();
            for isa in Isa::all() {
                for begins in [true, false] {
                    let [before_r, rest, z] = [0.7, 0.3, 0.5].map(|seed| values(window, seed));
                    let [before_p, before_q, before_c] = [0.9, 0.2, 0.4].map(|seed| values(window, seed));
                    let (mut r, mut p) = (before_r.clone(), before_p.clone());
                    let (mut q, mut c) = (before_q.clone(), before_c.clone());
                    let mut vectors = Gradients {
                        window,
                        spans: &spans,
                        r: &mut r,
                        rest: &rest,
                        z: &z,
                        p: &mut p,
                        q: &mut q,
                        c: &mut c,
                    };
                    let sum =
                        |term: &dyn Fn(usize) -> f64| places.iter().map(|place| term(place.0)).sum::<f64>();
                    let (sums, tops) = vectors.sums(isa, begins, cell);
                    let close = |a: f64, b: f64| (a - b).abs() <= 1e-13 * places.len() as f64;
                    assert!(close(sums.residual, sum(&|k| z[k] * before_r[k])));
                    assert!(close(sums.energy, sum(&|k| z[k] * (before_r[k] - rest[k]))));
                    assert!(close(sums.before, if begins { 0.0 } else { sum(&|k| z[k] * before_q[k]) }));
                    let mut expected = vec![0.0_f64; counts.len()];
                    for &(place, cell) in &places {
                        expected[cell] = expected[cell].max(z[place].abs());
                    }
                    assert_eq!(tops, expected);
                    let (a, b) = (0.3, 0.6);
                    vectors.step(isa, begins, (a, b));
                    let all = vectors.tops(isa, cell);
                    let mut counts = vec![false; window.len()];
                    for place in &places {
                        counts[place.0] = true;
                    }
                    for k in 0..window.len() {
                        let old = |x: f64| if begins { 0.0 } else { x };
                        let (ep, eq) =
                            (z[k] + b * old(before_p[k]), before_r[k] - rest[k] + b * old(before_q[k]));
                        let new = [ep, eq, before_c[k] + a * ep, before_r[k] - a * eq];
                        let kept = [before_p[k], before_q[k], before_c[k], before_r[k]];
                        let bound = if counts[k] { 1e-14 } else { 0.0 };
                        let expected = if counts[k] { new } else { kept };
                        for (found, expected) in [p[k], q[k], c[k], r[k]].into_iter().zip(expected) {
                            assert!((found - expected).abs() <= bound, "{isa:?} {k}");
                        }
                    }
                    let largest = (0..height).flat_map(|i| (0..width).map(move |j| window.at(i, j)));
                    let largest = largest.map(|k| c[k].abs()).fold(0.0, f64::max);
                    assert_eq!(all.into_iter().fold(0.0, f64::max), largest);
                }
            }
        }
    }
}
