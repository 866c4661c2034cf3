//! The smoother of a level: the same polynomial on every tile, one tile after the other.
//!
//! The polynomial is Chebyshev's of the fourth kind in `B (A + D)`, which takes no lower bound and made one iteration in eight
//! unnecessary against the first kind's. Source: J. Lottes, "Optimal polynomial smoothers for multigrid V-cycles",
//! Numerical Linear Algebra with Applications 30, 2023.
//!
//! A tile and what its steps need are in L2 (five buffers of 190 kB), so that they cost arithmetic and not memory: wide tiles, as
//! the hardware reads ahead along rows (64 x 256 took 1.2 times as long). Around a tile the unknowns keep
//! their values for its steps; rows of tiles take turns, even and odd, and rows of the same turn are shared out among threads.
//! Going up the order is reversed, which makes a cycle symmetric.

use rayon::prelude::*;

use super::Level;
use crate::kernel::Isa;
use crate::kernel::relax::{self, Part, relax};
use crate::kernel::simd::Lanes;
use crate::kernel::stencil::{PAD, Window, apply};
use crate::kernel::vector;
use crate::solver::pool::Pool;

/// Steps of the smoother before and after the coarse correction.
const DEGREE: usize = 3;
/// Added to the middle of the smoother's blur.
const CENTRE: f64 = 1.0;
/// Most rows of a tile, and columns of all but the last, a multiple of the lanes of any vector.
const SIDES: (usize, usize) = (64, 640);
/// Tiles of a level whose largest eigenvalues are estimated, at most.
const SAMPLES: usize = 12;
/// Columns of them that are taken.
const SAMPLE: usize = 128;

impl<T: Lanes> Level<T> {
    /// Smooths what `x` lacks to solve for `r`.
    pub fn smooth(&self, isa: Isa, r: &[T], x: &mut [T], up: bool, pool: &Pool<Vec<T>>) {
        let stride = self.window.stride();
        let rows = rows(self.window.height);
        for turn in 0..2 {
            let parity = if up { 1 - turn } else { turn };
            let (mut rest, mut top) = (&mut x[..], 0);
            let slabs: Vec<_> = rows
                .iter()
                .skip(parity)
                .step_by(2)
                .map(|&(first, height)| {
                    let here = std::mem::take(&mut rest);
                    let length = (height + 2 * PAD) * stride;
                    let (slab, below) = here[(first - top) * stride..].split_at_mut(length);
                    (rest, top) = (below, first + height + 2 * PAD);
                    (first, height, slab)
                })
                .collect();
            let work = |(first, height, slab): (usize, usize, &mut [T])| {
                let across = self.window.width.div_ceil(SIDES.1);
                for k in 0..across {
                    let k = if up { across - 1 - k } else { k };
                    self.tile(isa, r, slab, self.part(first, height, k), pool);
                }
            };
            if self.window.is_large() {
                slabs.into_par_iter().for_each(work);
            } else {
                slabs.into_iter().for_each(work);
            }
        }
    }

    /// The tile of some rows that is the `k`-th from the left.
    fn part(&self, first: usize, height: usize, k: usize) -> Window {
        let left = k * SIDES.1;
        let width = SIDES.1.min(self.window.width - left);
        Window { y: self.window.y + first, x: self.window.x + left, height, width }
    }

    /// Where a tile begins in the window.
    fn place(&self, tile: Window) -> (usize, usize) {
        (tile.y - self.window.y, tile.x - self.window.x)
    }

    fn tile(&self, isa: Isa, r: &[T], slab: &mut [T], tile: Window, pool: &Pool<Vec<T>>) {
        let (window, at) = (self.window, self.place(tile));
        let [mut x, mut q, mut s] = std::array::from_fn(|_| pool.lend_long(tile.len()));
        relax::load(slab, window, (0, at.1), tile, &mut x);
        for step in 1..=DEGREE {
            let k = step as f64;
            let before = if step > 1 { (2.0 * k - 3.0) / (2.0 * k + 1.0) } else { 0.0 };
            let factors = ((8.0 * k - 4.0) / ((2.0 * k + 1.0) * self.high), before);
            self.product(isa, tile, &x, &mut q);
            let (e, r) = (Part::new(&self.e, window, at), Part::new(r, window, at));
            relax(isa, tile, factors, CENTRE, relax::Buffers { e, r, q: &q, s: &mut s, x: &mut x });
        }
        let stride = window.stride();
        for i in 0..tile.height {
            let own = &x[tile.at(i, 0)..][..tile.width];
            slab[(i + PAD) * stride + PAD + at.1..][..tile.width].copy_from_slice(own);
        }
    }

    /// `q = (A + D) x` on a tile.
    fn product(&self, isa: Isa, tile: Window, x: &[T], q: &mut [T]) {
        apply(isa, &self.a, tile, x, None, q);
        if let Some(points) = &self.points {
            points.add(isa, self.window, self.place(tile), tile, x, q);
        }
    }

    /// A bound of the preconditioned matrix's eigenvalues on any tile, by power iteration on some of them. It exceeds that of the
    /// matrix without a mask (138 for the cardinal spline of order 2).
    pub fn bound(&self, isa: Isa) -> f64 {
        const MARGIN: f64 = 1.2;
        let across = self.window.width.div_ceil(SIDES.1);
        let tiles: Vec<Window> = rows(self.window.height)
            .into_iter()
            .flat_map(|(first, height)| (0..across).map(move |k| (first, height, k)))
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
        let [mut x, mut q, mut s, zero] = std::array::from_fn(|_| tile.zeros::<T>());
        // A start that is rough and has a share in every free unknown.
        for i in 0..tile.height {
            for j in 0..tile.width {
                let sign = if (i + j) % 2 == 0 { 1.0 } else { -1.0 };
                let rough = T::from_f64(sign * (1.0 + 0.2 * ((i * 7 + j * 3) % 5) as f64));
                x[tile.at(i, j)] = self.e[self.window.at(at.0 + i, at.1 + j)] * rough;
            }
        }
        let mut norm = vector::dot(isa, &x, &x).0.sqrt();
        let mut value = 0.0;
        for _ in 0..STEPS {
            if norm.is_nan() || norm <= 0.0 {
                break;
            }
            self.product(isa, tile, &x, &mut q);
            x.fill(T::ZERO);
            let (e, r) = (Part::new(&self.e, self.window, at), Part::new(&zero, tile, (0, 0)));
            // The step begins at zero: `x = E (B + c) E q / norm`.
            relax(
                isa,
                tile,
                (-1.0 / norm, 0.0),
                CENTRE,
                relax::Buffers { e, r, q: &q, s: &mut s, x: &mut x },
            );
            value = vector::dot(isa, &x, &x).0.sqrt();
            norm = value;
        }
        value
    }
}

/// First and number of the rows of each row of tiles, all of about the same height.
fn rows(height: usize) -> Vec<(usize, usize)> {
    let count = height.div_ceil(SIDES.0);
    (0..count).map(|k| (k * height / count, (k + 1) * height / count - k * height / count)).collect()
}
