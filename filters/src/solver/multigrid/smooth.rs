//! The smoother of a level: a polynomial in its matrix.
//!
//! The polynomial is Chebyshev's of the fourth kind in `B (A + D)`, which takes no lower bound and made one iteration in eight
//! unnecessary against the first kind's. Source: J. Lottes, "Optimal polynomial smoothers for multigrid V-cycles",
//! Numerical Linear Algebra with Applications 30, 2023.
//!
//! All steps are taken in one way down patches of the window ([`crate::kernel::cascade`]), so memory is passed over once for a
//! smoothing. As a polynomial in one matrix it is symmetric, and nothing is special where patches or threads meet: with tiles one
//! after the other, which took the unknowns around them as given, the slowest places were the corners of tiles.

use lacuna_core::parallel::prelude::*;

use super::Level;
use super::active::{Patch, Share, parts};
use crate::kernel::Isa;
use crate::kernel::cascade::{self, Out, Scratch, Strip, rows};
use crate::kernel::simd::Lanes;
use crate::kernel::spans::Spans;
use crate::kernel::stencil::{Part, apply};
use crate::kernel::vector;
use crate::kernel::window::Window;
use crate::solver::pool::Pool;

/// Steps of the smoother before and after the coarse correction.
const DEGREE: usize = 3;
/// Added to the middle of the smoother's blur.
const CENTRE: f64 = 1.0;
/// Most rows and columns of a tile whose largest eigenvalue is estimated.
const TILE: (usize, usize) = (64, 64);
/// Tiles of a level whose largest eigenvalues are estimated, at most.
const SAMPLES: usize = 24;

impl<T: Lanes> Level<T> {
    /// Pixels around a pixel that a smoothing of it depends on.
    pub fn reach(&self) -> usize {
        cascade::reach(self.a.terms, DEGREE)
    }

    /// Smooths what `from` (or zero) lacks to solve for `r`, into `x`, where it counts; all else is held at zero. With `rest`, this
    /// becomes what is left of `r`: times `share`, unless it is to be plain.
    pub fn smooth(
        &self,
        isa: Isa,
        (r, from): (&[T], Option<&[T]>),
        active: &Share,
        x: &mut [T],
        (rest, plain): (Option<&mut [T]>, bool),
        pool: &Pool<Scratch<T>>,
    ) {
        let factors = polynomial(self.high);
        let left = rest.map_or_else(
            || active.patches.iter().map(|_| Vec::new()).collect(),
            |rest| active.split(self.window, rest),
        );
        let outputs = active.split(self.window, x).into_iter().zip(left).map(|(x, rest)| Out { x, rest });
        let outputs: Vec<(Out<'_, T>, &Patch)> = outputs.zip(&active.patches).collect();
        let work = |(out, patch): (Out<'_, T>, &Patch)| {
            let Patch { rows, columns, around } = patch;
            let at = (around.y, around.x);
            let part = |values| Part::new(values, self.window, at);
            let strip = Strip {
                a: &self.a,
                points: self.points.as_ref().map(|points| (points, self.window, at)),
                window: Window { y: self.window.y + around.y, x: self.window.x + around.x, ..*around },
                spans: (&active.spans, at),
                e: part(&self.e),
                r: part(r),
                x: from.map(part),
                factors: &factors,
                c: CENTRE,
                rows: rows.start - around.y..rows.end - around.y,
                columns: columns.start - around.x..columns.end - around.x,
                plain,
                out,
            };
            cascade::cascade(isa, strip, &mut pool.lend());
        };
        outputs.into_par_iter().with_max_len(1).shared_if(self.window.is_large()).for_each(work);
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
    /// matrix without a mask (138 for the cardinal spline of order 2), most where few unknowns are free among held ones: the roughest tile
    /// is taken, and others at equal steps down in roughness. With tiles chosen by place a cluster of samples was missed, smoothing enlarged
    /// there what it should damp, and a solve took 308 iterations instead of 6.
    pub fn bound(&self, isa: Isa) -> f64 {
        const MARGIN: f64 = 1.2;
        let mut tiles: Vec<(f64, Window)> = parts(self.window.height, TILE.0, 1)
            .flat_map(|rows| parts(self.window.width, TILE.1, 1).map(move |columns| (rows.clone(), columns)))
            .map(|(rows, columns)| Window {
                y: self.window.y + rows.start,
                x: self.window.x + columns.start,
                height: rows.len(),
                width: columns.len(),
            })
            .map(|tile| (self.roughness(tile), tile))
            .collect();
        tiles.sort_by(|a, b| b.0.total_cmp(&a.0));
        let every = tiles.len().div_ceil(SAMPLES).max(1);
        let some: Vec<Window> = tiles.into_iter().step_by(every).map(|(_, tile)| tile).collect();
        let largest: Vec<f64> = some.into_par_iter().map(|tile| self.largest(isa, tile));
        let high = MARGIN * largest.into_iter().fold(0.0, f64::max);
        if high > 0.0 { high } else { 1.0 }
    }

    /// How much neighbours on a tile differ in how free they are, summed.
    fn roughness(&self, tile: Window) -> f64 {
        let (y, x) = self.place(tile);
        let row = |i: usize| &self.e[self.window.at(y + i, x)..][..tile.width];
        let differ =
            |a: &[T], b: &[T]| -> f64 { a.iter().zip(b).map(|(a, b)| (a.to_f64() - b.to_f64()).abs()).sum() };
        let across = (0..tile.height).map(|i| differ(row(i), &row(i)[1..])).sum::<f64>();
        across + (1..tile.height).map(|i| differ(row(i - 1), row(i))).sum::<f64>()
    }

    /// The largest eigenvalue of the preconditioned matrix of a tile by power iteration.
    fn largest(&self, isa: Isa, tile: Window) -> f64 {
        const STEPS: usize = 10;
        let at = self.place(tile);
        let factors = |norm: f64| [(0.0, -1.0 / norm)];
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
        let mut norm = vector::dot(isa, &x, &x).sqrt();
        let mut value = 0.0;
        let mut scratch = Scratch::default();
        let spans = Spans::all(tile);
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
                spans: (&spans, (0, 0)),
                e: part(&e),
                r: part(&zero),
                x: Some(part(&x)),
                factors: &factors(norm),
                c: CENTRE,
                rows: 0..tile.height,
                columns: 0..tile.width,
                plain: false,
                out: Out { x: rows(tile, &mut next), rest: Vec::new() },
            };
            cascade::cascade(isa, strip, &mut scratch);
            vector::add_scaled(isa, &mut next, -1.0, &x);
            std::mem::swap(&mut x, &mut next);
            value = vector::dot(isa, &x, &x).sqrt();
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
