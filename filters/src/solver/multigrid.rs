//! A multigrid cycle on a window, as a preconditioner: symmetric, positive definite, one smoothing down and one up.
//!
//! The system is `(A_l + D_l) x = r` over the free unknowns of each level. Level 0 is the caller's; each coarser
//! grid has half the resolution and its own `A_l` (the same energy at twice the spacing), and all its cells are free. What
//! holds it is `D_l`: every measured pixel of level 0 asks for a zero at the place where it lies, by the bilinear
//! weights of the four cells around it ([`crate::kernel::points`]) and as firmly as a cell is held by its neighbours, as more would
//! be undone by the finer grids. Cells that are held where a sample only lies somewhere inside took twice the iterations at
//! 1 % density (16 instead of 8).
//!
//! Smoother: a polynomial in `B (A + D)`, with `B` a masked blur ([`smooth`]), which also tells what it leaves of the right-hand
//! side: coarse grids take it from there, and conjugate gradients have their product. Transfer: [`crate::operator::resample`].
//! The coarsest grid is solved directly. All grids leave out cells where nothing is left to correct ([`active`]). With the
//! samples instead of zeros asked for, the coarse grids make a start for the whole image, too ([`Multigrid::start`]).
//!
//! Source: W. Briggs, V. Henson, S. Mc Cormick, "A Multigrid Tutorial", SIAM 2000; M. Adams, M. Brezina, J. Hu,
//! R. Tuminaro, "Parallel multigrid smoothing: polynomial versus Gauss-Seidel", J. Comput. Phys. 188, 2003.
//!
//! Cost: `2 DEGREE` applications of `A` a level, one more at level 0, and a fifth more where patches overlap. Memory: six buffers
//! at level 0, eleven at the others, which together have a third of its cells, and three of conjugate gradients: 13 windows in all.

use std::sync::Arc;

use lacuna_core::parallel::prelude::*;

use super::bottom::Bottom;
use super::pool::{Lent, Pool};
use crate::kernel::cascade::Scratch;
use crate::kernel::gradients::Gradients;
use crate::kernel::points::{self, Point, Points};
use crate::kernel::simd::Lanes;
use crate::kernel::spans::Spans;
use crate::kernel::stencil::Separable;
use crate::kernel::window::{PAD, Window};
use crate::kernel::{Isa, Real, vector};
use crate::operator::resample::Resample;

mod active;
mod smooth;
#[cfg(test)]
mod tests;

pub use active::CELL;
use active::{Active, Share};

/// Grids with at most this many cells are solved directly.
const DIRECT: usize = 144;
/// Rows of a coarse grid whose right-hand sides are computed together: what they need of a wide fine grid is in L2.
const CHUNK: usize = 20;
/// Cells left over those worked on where leaving out the others pays, as conjugate gradients begin anew.
const FEWER: f64 = 0.8;
/// How firmly a measured pixel holds the coarse cells around it, over the diagonal of their operator.
const FIRM: f64 = 1.0;

/// One grid.
struct Level<T> {
    a: Arc<Separable<T>>,
    window: Window,
    /// What is added to it.
    points: Option<Points<T>>,
    /// The share of `A` in the diagonal at free unknowns, zero at others: what a coarse correction is multiplied by. It
    /// keeps corrections away from unknowns that are held, as it does from those that are not free.
    share: Vec<T>,
    /// Its square root, `E` of the smoother.
    e: Vec<T>,
    /// Largest eigenvalue that the smoother damps.
    high: f64,
    /// To the next coarser grid.
    down: Option<Resample<T>>,
}

/// The grids of a window.
pub struct Multigrid<T: Real> {
    isa: Isa,
    levels: Vec<Level<T>>,
    bottom: Option<Bottom>,
    /// Everything.
    all: Active,
    workspaces: Pool<Workspace<T>>,
}

/// Buffers for one cycle at a time.
#[derive(Default)]
pub struct Workspace<T: Real> {
    window: Window,
    levels: Vec<Buffers<T>>,
    /// What is worked on; what is not has no correction.
    active: Active,
    pool: Pool<Scratch<T>>,
    /// Of conjugate gradients: direction, its product with the matrix, solution.
    p: Vec<T>,
    q: Vec<T>,
    c: Vec<T>,
}

struct Buffers<T> {
    /// The right-hand side.
    r: Vec<T>,
    /// The correction.
    x: Vec<T>,
    /// The correction before the second smoothing.
    y: Vec<T>,
    /// What it leaves of the right-hand side, times `share`.
    rest: Vec<T>,
}

impl<T: Real> Workspace<T> {
    /// The pixels that are worked on, and the residual that [`Multigrid::cycle`] reads.
    pub fn residual(&mut self) -> (&Spans, &mut [T]) {
        (&self.active.grids[0].spans, &mut self.levels[0].r)
    }

    /// The correction that conjugate gradients have found, or the start.
    pub fn correction(&self) -> &[T] {
        &self.c
    }

    /// The vectors of conjugate gradients.
    pub fn vectors(&mut self) -> Gradients<'_, T> {
        let Buffers { r, x, rest, .. } = &mut self.levels[0];
        let (window, spans) = (self.window, &self.active.grids[0].spans);
        Gradients { window, spans, r, rest, z: x, p: &mut self.p, q: &mut self.q, c: &mut self.c }
    }
}

impl<T: Lanes> Multigrid<T> {
    /// Sets up the grids below `window`. `matrix(l)` is the operator of level `l` on the whole image, in f64 and in the grids' numbers; `free` is 1 at free
    /// unknowns and 0 elsewhere, padding included; `d` is added to the diagonal. The window begins at multiples of `2^l` for as
    /// many levels as it is to have.
    pub fn new(
        isa: Isa,
        window: Window,
        matrix: &dyn Fn(usize) -> (Arc<Separable<f64>>, Arc<Separable<T>>),
        free: Vec<T>,
        d: Option<Vec<T>>,
    ) -> Self {
        let held = held(window, &free, d.as_deref());
        let finest = window;
        let mut steps = Vec::new();
        let mut at = window;
        loop {
            let a = matrix(steps.len());
            let size = a.0.size();
            let even = at.y.is_multiple_of(2) && at.x.is_multiple_of(2);
            let splits = even && at.pixels() > DIRECT;
            let down = splits.then(|| Resample::new(isa, at, size.height, size.width));
            let next = down.as_ref().map(Resample::coarse);
            steps.push((a, at, down));
            let Some(next) = next else { break };
            at = next;
        }
        // Each grid takes all points: they are added side by side.
        let coarser: Vec<(Window, f64)> =
            steps.iter().skip(1).map(|((a, _), window, _)| (*window, FIRM * middle(a))).collect();
        let coarser = coarser
            .into_par_iter()
            .map(|(window, firm)| Points::new(window, cell(finest, window), &held, firm));
        let points = std::iter::once(d.map(Points::diagonal)).chain(coarser.into_iter().map(Some));
        let all = Active::default();
        let mut grids = Self { isa, levels: Vec::new(), bottom: None, all, workspaces: Pool::default() };
        let mut free = Some(free);
        for (((a, own), window, down), points) in steps.into_iter().zip(points) {
            if window.pixels() <= DIRECT {
                grids.bottom = Some(bottom(&a, window, points.as_ref(), free.as_deref()));
            }
            grids.levels.push(Level::new(isa, (&a, own), window, points, free.take(), down));
        }
        grids.all = Active::all(&grids.shapes());
        grids
    }

    /// Per level its window and what a smoothing reaches.
    fn shapes(&self) -> Vec<(Window, usize)> {
        self.levels.iter().map(|level| (level.window, level.reach())).collect()
    }

    /// Buffers for [`Self::cycle`], which one solve after another may use; everything is to be worked on.
    pub fn workspace(&self) -> Lent<'_, Workspace<T>> {
        let mut workspace = self.workspaces.lend();
        if workspace.levels.is_empty() {
            let buffers = |level: &Level<T>| {
                let zeros = || level.window.zeros();
                Buffers { r: zeros(), x: zeros(), y: zeros(), rest: zeros() }
            };
            workspace.levels = self.levels.iter().map(buffers).collect();
            let zeros = || self.window().zeros();
            (workspace.p, workspace.q, workspace.c) = (zeros(), zeros(), zeros());
            workspace.window = self.window();
        }
        workspace.active = self.all.clone();
        workspace
    }

    /// Leaves out the cells whose `tops`, the largest corrections, are at most `bound`, if that spares enough work. Returns whether it
    /// does; the residual of the others stays.
    pub fn leave_out(&self, workspace: &mut Workspace<T>, tops: &[f64], bound: f64) -> bool {
        let cells: Vec<bool> = tops.iter().map(|top| *top > bound).collect();
        let count = |cells: &[bool]| cells.iter().filter(|cell| **cell).count() as f64;
        let spares = count(&cells) < FEWER * count(&workspace.active.cells);
        if spares {
            self.work_on(workspace, cells);
        }
        spares
    }

    /// For another solution that corrects this one: works on the cells where this exceeds `bound`, and if `others` also on those that
    /// were not left out. Returns whether there are any.
    pub fn take_up(&self, workspace: &mut Workspace<T>, bound: f64, others: bool) -> bool {
        let tops = workspace.vectors().tops(self.isa, CELL);
        let own = tops.iter().zip(&workspace.active.cells);
        let cells: Vec<bool> = own.map(|(top, active)| *top > bound || (others && *active)).collect();
        let any = cells.contains(&true);
        if any {
            self.work_on(workspace, cells);
        }
        any
    }

    fn work_on(&self, workspace: &mut Workspace<T>, cells: Vec<bool>) {
        workspace.active = Active::new(&self.shapes(), cells);
        for ((level, buffers), share) in
            self.levels.iter().zip(&mut workspace.levels).zip(&workspace.active.grids)
        {
            share.spans.clear(level.window, &mut buffers.x);
            share.spans.clear(level.window, &mut buffers.rest);
        }
    }

    /// The instruction set in use.
    pub fn isa(&self) -> Isa {
        self.isa
    }

    /// The finest window.
    pub fn window(&self) -> Window {
        self.levels[0].window
    }

    /// Not zero at the free unknowns of the finest window.
    pub fn free(&self) -> &[T] {
        &self.levels[0].share
    }

    /// Sets the workspace's correction to a start for the samples' image: from the coarsest grid up to the one below the finest, each
    /// takes what the coarser one has found and a cycle for what it lacks. The image is not held to the samples, and takes the window
    /// for the whole image. Returns false, and does nothing, if there is but one grid.
    pub fn start(&self, workspace: &mut Workspace<T>, samples: &dyn Fn(usize, usize) -> f64) -> bool {
        if self.levels.len() == 1 {
            return false;
        }
        let Workspace { levels, active, pool, c, .. } = workspace;
        let shares = active.grids.as_slice();
        let finest = &self.levels[0];
        let held = held(finest.window, &finest.share, finest.points.as_ref().map(Points::middle));
        let values: Vec<f64> = held.iter().map(|&(y, x, _)| samples(y, x)).collect();
        let coarser: Vec<_> = self.levels.iter().zip(levels.iter_mut()).skip(1).collect();
        coarser.into_par_iter().for_each(|(level, buffers)| {
            let (cell, firm) = (cell(finest.window, level.window), FIRM * middle(&level.a));
            points::pull(level.window, cell, &held, &values, firm, &mut buffers.r);
        });
        for index in (1..self.levels.len()).rev() {
            let level = &self.levels[index];
            let own = &mut c[..level.window.len()];
            let coarser = index + 1 < self.levels.len();
            if coarser {
                self.raise(index, levels, shares, own);
            }
            self.descend(index, coarser.then_some(&*own), &mut levels[index..], shares, pool);
        }
        self.raise(0, levels, shares, c);
        true
    }

    /// Sets `fine` to what the grid below one has found, on this one.
    fn raise(&self, index: usize, buffers: &[Buffers<T>], shares: &[Share], fine: &mut [T]) {
        fine.fill(T::ZERO);
        if let (Some(down), Some(coarse)) = (&self.levels[index].down, buffers.get(index + 1)) {
            down.prolong_add(&coarse.x, None, &shares[index].spans, fine);
        }
    }

    /// Computes the workspace's correction for its residual, and what is left of this: both are zero at unknowns that are not
    /// free, where the residual has to be so.
    pub fn cycle(&self, workspace: &mut Workspace<T>) {
        let Workspace { levels, active, pool, .. } = workspace;
        self.descend(0, None, levels, &active.grids, pool);
        if self.levels.len() == 1 {
            let (level, Buffers { r, x, rest, .. }) = (&self.levels[0], &mut levels[0]);
            level.product(self.isa, level.window, x, rest);
            vector::rest(self.isa, &level.share, r, rest);
        }
    }

    /// Sets the unknowns of a level to what a cycle makes of `from`, or of zero, for its right-hand side.
    fn descend(
        &self,
        index: usize,
        from: Option<&[T]>,
        buffers: &mut [Buffers<T>],
        shares: &[Share],
        pool: &Pool<Scratch<T>>,
    ) {
        let Some((here, below)) = buffers.split_first_mut() else { return };
        let (level, active) = (&self.levels[index], &shares[index]);
        if let Some(bottom) = self.bottom.as_ref().filter(|_| index + 1 == self.levels.len()) {
            active.spans.clear(level.window, &mut here.r);
            bottom.solve(&here.r, &mut here.x);
            active.spans.clear(level.window, &mut here.x);
            return;
        }
        let Buffers { r, x, y, rest } = here;
        level.smooth(self.isa, (r, from), active, y, (Some(rest), false), pool);
        if let (Some(down), Some(coarse)) = (&level.down, below.first_mut()) {
            level.restrict(down, rest, &shares[index + 1].spans, &mut coarse.r);
            self.descend(index + 1, None, below, shares, pool);
            down.prolong_add(&below[0].x, Some(&level.share), &active.spans, y);
        }
        level.smooth(self.isa, (r, Some(y)), active, x, ((index == 0).then_some(rest), true), pool);
    }
}

impl<T: Lanes> Level<T> {
    /// Without `free`, all of the window is.
    fn new(
        isa: Isa,
        (a, own): (&Separable<f64>, Arc<Separable<T>>),
        window: Window,
        points: Option<Points<T>>,
        free: Option<Vec<T>>,
        down: Option<Resample<T>>,
    ) -> Self {
        let mut share = free.unwrap_or_else(|| {
            let mut all = window.zeros();
            for i in 0..window.height {
                all[window.at(i, 0)..][..window.width].fill(T::from_f64(1.0));
            }
            all
        });
        let mut e = share.clone();
        if let Some(points) = &points {
            let middle = middle(a);
            let rows = |values| <[T]>::par_chunks_mut(values, window.stride());
            let lines = rows(&mut share).zip(rows(&mut e)).zip(points.middle().par_chunks(window.stride()));
            lines.shared_if(window.is_large()).for_each(|((share, e), own)| {
                for ((share, e), own) in share.iter_mut().zip(e).zip(own) {
                    let part = share.to_f64() * middle / (middle + own.to_f64());
                    (*share, *e) = (T::from_f64(part), T::from_f64(part.sqrt()));
                }
            });
        }
        let mut level = Self { a: own, window, points, share, e, high: 1.0, down };
        level.high = level.bound(isa);
        level
    }

    /// Sets `coarse` to the restriction of `rest`, what is left of the residual, where it counts there.
    fn restrict(&self, down: &Resample<T>, rest: &[T], spans: &Spans, coarse: &mut [T]) {
        // The first coarse row takes fine ones from three before it.
        down.coarse().in_chunks(coarse, CHUNK, |first, rows| {
            down.restrict(first, &rest[(2 * first + PAD - 3) * self.window.stride()..], spans, rows);
        });
    }
}

/// Measured pixels of a window, or pulls on it.
fn held<T: Lanes>(window: Window, free: &[T], d: Option<&[T]>) -> Vec<Point> {
    let row = |i: usize| -> Vec<Point> {
        let point = |j: usize| {
            let at = window.at(i, j);
            if free[at] == T::ZERO {
                return Some((i, j, f64::INFINITY));
            }
            d.map(|d| d[at].to_f64()).filter(|&pull| pull > 0.0).map(|pull| (i, j, pull))
        };
        (0..window.width).filter_map(point).collect()
    };
    let rows: Vec<Vec<Point>> = (0..window.height).into_par_iter().map(row);
    rows.concat()
}

/// Pixels of the finest grid along the sides of a cell.
fn cell(finest: Window, coarse: Window) -> (usize, usize) {
    let ratio = |fine: usize, coarse: usize| fine.div_ceil(coarse).next_power_of_two();
    (ratio(finest.height, coarse.height), ratio(finest.width, coarse.width))
}

/// The diagonal away from the ends of the image.
fn middle<T: Real>(a: &Separable<T>) -> f64 {
    a.diagonal(a.vertical.len / 2, a.horizontal.len / 2)
}

fn bottom<T: Lanes>(
    a: &Separable<f64>,
    window: Window,
    points: Option<&Points<T>>,
    free: Option<&[T]>,
) -> Bottom {
    let cells = (0..window.height).flat_map(|i| (0..window.width).map(move |j| (i, j)));
    let cells = cells.filter(|&(i, j)| free.is_none_or(|free| free[window.at(i, j)] != T::ZERO));
    let image = |(i, j): (usize, usize)| (window.y + i, window.x + j);
    Bottom::new(window, cells.collect(), |k, l| {
        let own = points
            .map_or(0.0, |points| points.entry(window.stride(), window.at(k.0, k.1), window.at(l.0, l.1)));
        a.entry(image(k), image(l)) + own
    })
}
