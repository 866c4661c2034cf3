//! The parts of the image with measured pixels everywhere near: independent tiles in f32.
//!
//! A tile is solved in a window that overlaps its neighbours; around the window the image keeps its values. What the
//! surroundings get wrong fades within a few samples, and the next sweep, whose tiles are shifted by half a tile, finds
//! out whether anything was left: a tile whose residual is within the tolerance is not touched, and when no tile
//! was, the image solves the whole problem.
//!
//! Source: M. Dryja, O. Widlund, "An additive variant of the Schwarz alternating method", Courant Institute 1987.

use rayon::prelude::*;

use crate::kernel::Isa;
use crate::kernel::stencil::{Separable, Window};
use crate::solver::local::{self, Buffers};
use crate::{Mask, Plane, Run, Size};

/// Rows and columns of a tile.
const SIDE: usize = 120;
/// Pixels that a window extends beyond its tile.
const HALO: usize = 9;
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

/// What a sweep over all tiles did.
#[derive(Clone, Copy, Debug)]
pub struct Sweep {
    /// Most steps that a tile took.
    pub steps: usize,
    /// Whether every tile met the tolerance.
    pub converged: bool,
    /// Largest relative residual of a tile that was changed.
    pub residual: f64,
}

impl Tiles {
    /// `held` marks pixels that are solved elsewhere.
    pub fn new(isa: Isa, matrix: &Separable<f64>, held: Option<Vec<bool>>) -> Self {
        Self { isa, matrix: matrix.cast(), size: matrix.size(), held }
    }

    /// Solves each tile whose residual asks for it. `middle` is a value in the midst of the image's: it is taken off while
    /// computing, so that a narrow range far from zero keeps its digits. `shifted` moves the tiles by half a tile.
    pub fn sweep(
        &self,
        mask: &Mask,
        image: &mut Plane,
        shifted: bool,
        middle: f32,
        tolerance: f64,
        run: &Run<'_>,
    ) -> Sweep {
        let tiles = self.tiles(shifted);
        let source: &Plane = image;
        let results: Vec<_> = tiles
            .par_iter()
            .map_init(Buffers::default, |buffers, &tile| {
                if run.interrupted().is_some() {
                    return (None, Sweep { steps: 0, converged: false, residual: 1.0 });
                }
                self.solve(mask, source, tile, middle, tolerance, buffers)
            })
            .collect();
        let mut total = Sweep { steps: 0, converged: true, residual: 0.0 };
        for (tile, (values, sweep)) in tiles.iter().zip(results) {
            total.steps = total.steps.max(sweep.steps);
            total.converged &= sweep.converged;
            total.residual = total.residual.max(sweep.residual);
            let Some(values) = values else { continue };
            for (i, values) in values.chunks_exact(tile.width).enumerate() {
                image.row_mut(tile.y + i)[tile.x..][..tile.width].copy_from_slice(values);
            }
        }
        total
    }

    /// Rectangles that cover the image, in order.
    fn tiles(&self, shifted: bool) -> Vec<Window> {
        let cuts = |n: usize| -> Vec<(usize, usize)> {
            let first = if shifted { SIDE / 2 } else { SIDE };
            let mut edges = vec![0];
            edges.extend((first..n).step_by(SIDE));
            edges.push(n);
            edges.windows(2).map(|pair| (pair[0], pair[1] - pair[0])).collect()
        };
        let columns = cuts(self.size.width);
        cuts(self.size.height)
            .into_iter()
            .flat_map(|(y, height)| columns.iter().map(move |&(x, width)| Window { y, x, height, width }))
            .collect()
    }

    fn solve(
        &self,
        mask: &Mask,
        image: &Plane,
        tile: Window,
        middle: f32,
        tolerance: f64,
        buffers: &mut Buffers,
    ) -> (Option<Vec<f32>>, Sweep) {
        let (reach, size) = (self.matrix.terms, self.size);
        // The window's outermost `reach` pixels are read but not changed, unless the image ends there.
        let span = |from: usize, length: usize, n: usize| {
            let start = from.saturating_sub(HALO + reach);
            (start, n.min(from + length + HALO + reach) - start)
        };
        let ((y, height), (x, width)) =
            (span(tile.y, tile.height, size.height), span(tile.x, tile.width, size.width));
        let window = Window { y, x, height, width };
        let inside = |i: usize, start: usize, length: usize, n: usize| {
            (start == 0 || i >= reach) && (start + length == n || i + reach < length)
        };
        buffers.reset(window);
        let mut any = false;
        for i in 0..height {
            let from = window.at(i, 0);
            for (value, pixel) in buffers.x[from..][..width].iter_mut().zip(&image.row(y + i)[x..]) {
                *value = pixel - middle;
            }
            if !inside(i, y, height, size.height) {
                continue;
            }
            let row = (y + i) * size.width + x;
            let measured = &mask.as_slice()[row..][..width];
            let held = self.held.as_ref().map(|held| &held[row..][..width]);
            for (j, (free, &measured)) in buffers.e[from..][..width].iter_mut().zip(measured).enumerate() {
                if !measured && held.is_none_or(|held| !held[j]) && inside(j, x, width, size.width) {
                    *free = 1.0;
                    any = true;
                }
            }
        }
        if !any {
            return (None, Sweep { steps: 0, converged: true, residual: 0.0 });
        }
        let ending = local::solve(self.isa, &self.matrix, window, buffers, tolerance, LIMIT);
        let sweep = Sweep { steps: ending.steps, converged: ending.converged, residual: ending.residual };
        if ending.steps == 0 {
            return (None, Sweep { residual: 0.0, ..sweep });
        }
        let mut values = Vec::with_capacity(tile.pixels());
        for i in 0..tile.height {
            let from = window.at(tile.y - y + i, tile.x - x);
            let old = &image.row(tile.y + i)[tile.x..][..tile.width];
            for ((&old, &value), &free) in old.iter().zip(&buffers.x[from..]).zip(&buffers.e[from..]) {
                values.push(if free == 0.0 { old } else { value + middle });
            }
        }
        (Some(values), sweep)
    }
}
