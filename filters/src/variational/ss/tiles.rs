//! The parts of the image with measured pixels everywhere near: tiles in f32.
//!
//! A tile is solved in a window that overlaps its neighbours; around the window the image keeps its values. Tiles are taken
//! one after the other, every other row of tiles first, and each finds what those before it have left: what the
//! surroundings get wrong fades within a few samples. The next sweep, whose tiles are shifted by half a tile, finds
//! out whether anything was left: a tile whose residual is within the tolerance is not touched, and when no tile
//! was, the image solves the whole problem. Rows of tiles that do not touch each other are shared out among threads.
//!
//! Source: M. Dryja, O. Widlund, "An additive variant of the Schwarz alternating method", Courant Institute 1987 (this is
//! the multiplicative one).

use std::ops::Range;

use rayon::prelude::*;

use crate::kernel::{Isa, step};
use crate::kernel::stencil::{PAD, Separable, Window};
use crate::solver::local::{self, Buffers, Target, Views};
use crate::{Mask, Plane, Run, Size};

/// Most rows and columns of a tile.
const SIDES: (usize, usize) = (120, 176);
/// Pixels that a window extends beyond its tile.
const HALO: usize = 5;
/// Steps that a tile takes at most in one sweep.
const LIMIT: usize = 60;

/// The dense part of a plan.
pub struct Tiles {
    isa: Isa,
    matrix: Separable<f32>,
    size: Size,
    /// Pixels that tiles may not change besides the measured ones: those in holes.
    held: Option<Vec<bool>>,
}

/// What a sweep is to do.
#[derive(Clone, Copy, Debug)]
pub struct Task {
    /// Whether the tiles are moved by half a tile.
    pub shifted: bool,
    /// A value in the midst of the image's. It is taken off while computing, so that a narrow range far from zero keeps
    /// its digits.
    pub middle: f32,
    /// When a tile is done.
    pub target: Target,
}

/// What a sweep over all tiles did.
#[derive(Clone, Copy, Debug)]
pub struct Sweep {
    /// Most steps that a tile took.
    pub steps: usize,
    /// Whether every tile met the tolerance.
    pub converged: bool,
    /// The residual's square, measured by the preconditioner, before and after: sums over all tiles.
    pub squares: (f64, f64),
    /// Least eigenvalue of the preconditioned matrix of any tile.
    pub least: f64,
    /// Largest error that any tile may have left, by its estimate.
    pub error: f64,
}

impl Sweep {
    const NONE: Self =
        Self { steps: 0, converged: true, squares: (0.0, 0.0), least: f64::INFINITY, error: 0.0 };

    fn and(self, other: Self) -> Self {
        Self {
            steps: self.steps.max(other.steps),
            converged: self.converged && other.converged,
            squares: (self.squares.0 + other.squares.0, self.squares.1 + other.squares.1),
            least: self.least.min(other.least),
            error: self.error.max(other.error),
        }
    }
}

/// Rows of the image that one task works on.
struct Slab<'a> {
    /// First row in the image.
    y: usize,
    rows: &'a mut [f32],
    /// First row and number of rows of its tiles.
    tiles: (usize, usize),
}

impl Tiles {
    /// `held` marks pixels that are solved elsewhere.
    pub fn new(isa: Isa, matrix: &Separable<f64>, held: Option<Vec<bool>>) -> Self {
        Self { isa, matrix: matrix.cast(), size: matrix.size(), held }
    }

    /// Solves each tile whose residual asks for it.
    pub fn sweep(&self, mask: &Mask, image: &mut Plane, task: Task, run: &Run<'_>) -> Sweep {
        let rows = cuts(self.size.height, SIDES.0, task.shifted);
        let mut total = Sweep::NONE;
        for parity in 0..2 {
            let slabs = self.slabs(image, rows.iter().skip(parity).step_by(2));
            let sweeps: Vec<Sweep> = slabs
                .into_par_iter()
                .map_init(Buffers::default, |buffers, mut slab| {
                    let mut total = Sweep::NONE;
                    for (x, width) in cuts(self.size.width, SIDES.1, task.shifted) {
                        if run.interrupted().is_some() {
                            return Sweep { converged: false, ..total };
                        }
                        let tile = Window { y: slab.tiles.0, x, height: slab.tiles.1, width };
                        total = total.and(self.solve(mask, &mut slab, tile, task, buffers));
                    }
                    total
                })
                .collect();
            total = sweeps.into_iter().fold(total, Sweep::and);
        }
        total
    }

    /// First and number of the rows or columns that a window around a tile takes. Its outermost `reach` are read but
    /// not changed, unless the image ends there.
    fn span(&self, from: usize, length: usize, n: usize) -> (usize, usize) {
        let margin = HALO + self.matrix.terms;
        let start = from.saturating_sub(margin);
        (start, n.min(from + length + margin) - start)
    }

    /// Cuts the image into the rows that the windows of the given rows of tiles take.
    fn slabs<'a>(
        &self,
        image: &'a mut Plane,
        tiles: impl Iterator<Item = &'a (usize, usize)>,
    ) -> Vec<Slab<'a>> {
        let size = self.size;
        let (mut rest, mut top) = (image.pixels_mut(), 0);
        tiles
            .map(|&tiles| {
                let (y, height) = self.span(tiles.0, tiles.1, size.height);
                let here = std::mem::take(&mut rest);
                let (rows, below) = here[(y - top) * size.width..].split_at_mut(height * size.width);
                (rest, top) = (below, y + height);
                Slab { y, rows, tiles }
            })
            .collect()
    }

    /// Brings the pixels of a window into the buffers, and which of those in the given rows and columns are free. `rows` begins
    /// with the window's first row.
    fn load(
        &self,
        mask: &Mask,
        rows: &[f32],
        (window, lines, columns): (Window, &Range<usize>, &Range<usize>),
        middle: f32,
        views: &mut Views<'_>,
    ) {
        let across = self.size.width;
        for i in 0..window.height {
            let from = window.at(i, 0);
            let pixels = &rows[i * across + window.x..];
            for (value, &pixel) in views.x[from..][..window.width].iter_mut().zip(pixels) {
                *value = pixel - middle;
            }
            let whole = &mut views.w[from - PAD..][..window.stride()];
            whole.fill(0.0);
            if !lines.contains(&i) {
                continue;
            }
            let row = (window.y + i) * across + window.x;
            let free = &mut whole[PAD..][columns.clone()];
            for (free, &measured) in free.iter_mut().zip(&mask.as_slice()[row..][columns.clone()]) {
                *free = f32::from(u8::from(!measured));
            }
            if let Some(held) = &self.held {
                for (free, &held) in free.iter_mut().zip(&held[row..][columns.clone()]) {
                    *free *= f32::from(u8::from(!held));
                }
            }
        }
        step::shares(self.isa, window, views.w, views.d);
    }

    fn solve(
        &self,
        mask: &Mask,
        slab: &mut Slab<'_>,
        tile: Window,
        task: Task,
        buffers: &mut Buffers,
    ) -> Sweep {
        let (reach, size, middle) = (self.matrix.terms, self.size, task.middle);
        let (y, height) = self.span(tile.y, tile.height, size.height);
        let (x, width) = self.span(tile.x, tile.width, size.width);
        let window = Window { y, x, height, width };
        // Rows and columns that may be changed.
        let inner = |start: usize, length: usize, n: usize| {
            let first = if start == 0 { 0 } else { reach };
            first..if start + length == n { length } else { length - reach }
        };
        let (lines, columns) = (inner(y, height, size.height), inner(x, width, size.width));
        let place = |i: usize| (y - slab.y + i) * size.width + x;
        let rows = &slab.rows[(y - slab.y) * size.width..];
        let mut views = buffers.fit(window);
        self.load(mask, rows, (window, &lines, &columns), middle, &mut views);
        let ending = local::solve(self.isa, &self.matrix, window, views, task.target, LIMIT);
        if ending.steps > 0 {
            let views = buffers.views();
            for i in lines {
                let from = window.at(i, 0);
                let row = &mut slab.rows[place(i)..][..width];
                for ((pixel, &value), &free) in row.iter_mut().zip(&views.x[from..]).zip(&views.d[from..])
                {
                    // By bits: a choice would become a branch.
                    let keep = u32::from(free == 0.0).wrapping_neg();
                    *pixel = f32::from_bits(pixel.to_bits() & keep | (value + middle).to_bits() & !keep);
                }
            }
        }
        Sweep {
            steps: ending.steps,
            converged: ending.converged,
            squares: ending.squares,
            least: ending.least,
            error: ending.error,
        }
    }
}

/// Cuts `n` rows or columns into parts of about the same length, at most `side`: first and number of each. Shifted by
/// half a part, the first and the last are half as long.
fn cuts(n: usize, side: usize, shifted: bool) -> Vec<(usize, usize)> {
    let count = n.div_ceil(side);
    let mut edges = vec![0];
    if shifted {
        edges.extend((0..count).map(|k| (2 * k + 1) * n / (2 * count)));
    } else {
        edges.extend((1..count).map(|k| k * n / count));
    }
    edges.push(n);
    edges.windows(2).map(|pair| (pair[0], pair[1] - pair[0])).collect()
}
