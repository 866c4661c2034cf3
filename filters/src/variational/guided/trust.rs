//! Where the guided image is better than the plain one, found by leaving a part of the samples out.
//!
//! At every left-out pixel both errors are known: `s` of the plain filter, `g` of the guided one, weighted as in `tune`.
//! In a neighbourhood the blend `plain + t (guided - plain)` has the least error for `t = sum s (s - g) / sum (s - g)^2`.
//! How much of the error it
//! takes away, `rho = (sum s (s - g))^2 / (sum (s - g)^2 sum s^2)`, is compared with what chance would: of `n` pixels
//! about `1 / n`, so `t` is shrunk by `1 - CHANCE / (n rho)`, down to zero. A frame in which blending takes away less
//! than [`WORTH`] of the error is left to the plain filter altogether.

use lacuna_core::parallel::prelude::*;

use super::tune::Weights;
use crate::{Plane, Planes, Size};

/// Pixels of a cell's side.
const CELL: usize = 8;
/// Cells to each side that a mean takes in; three means follow each other.
const RADIUS: usize = 2;
/// Shrinkage, in units of what chance explains.
const CHANCE: f64 = 3.0;
/// What blending must take away of the squared error.
pub const WORTH: f64 = 0.03;

/// Sums over the left-out pixels of a cell.
#[derive(Clone, Copy, Debug, Default)]
struct Cell {
    /// Left-out pixels.
    count: f64,
    /// `s^2`, over all channels.
    plain: f64,
    /// `s (s - g)`.
    cross: f64,
    /// `(s - g)^2`.
    change: f64,
}

impl Cell {
    /// `g^2`.
    fn guided(&self) -> f64 {
        (self.change + self.plain - 2.0 * self.cross).max(0.0)
    }
}

/// How much of the guided image each pixel takes, 0 to 1.
#[derive(Clone, Debug)]
pub struct Trust {
    /// Pixels of a cell's side.
    side: usize,
    cells: Vec<Cell>,
    rows: usize,
    columns: usize,
}

impl Trust {
    /// Compares two images at left-out pixels: `(row, column)` each.
    pub fn new(
        left_out: &[(usize, usize)],
        truth: (&Planes, Weights),
        plain: &Planes,
        guided: &Planes,
    ) -> Self {
        Self::in_cells(CELL, left_out.iter().copied(), truth, plain, guided)
    }

    /// The same in cells of another side.
    pub fn in_cells(
        side: usize,
        left_out: impl Iterator<Item = (usize, usize)>,
        (truth, weights): (&Planes, Weights),
        plain: &Planes,
        guided: &Planes,
    ) -> Self {
        let size = truth.size();
        let (rows, columns) = (size.height.div_ceil(side), size.width.div_ceil(side));
        let mut cells = vec![Cell::default(); rows * columns];
        for (row, column) in left_out {
            let cell = &mut cells[row / side * columns + column / side];
            cell.count += 1.0;
            let weight = weights.at(truth, row * size.width + column);
            for ((truth, plain), guided) in
                truth.as_slice().iter().zip(plain.as_slice()).zip(guided.as_slice())
            {
                let at = |plane: &Plane| f64::from(plane.at(row, column));
                let s = at(plain) - at(truth);
                // Where guides predict nothing, nothing would change.
                let difference = Some(at(plain) - at(guided)).filter(|d| d.is_finite()).unwrap_or(0.0);
                cell.plain += weight * s * s;
                cell.cross += weight * s * difference;
                cell.change += weight * difference * difference;
            }
        }
        for _ in 0..3 {
            cells = mean(&cells, rows, columns, true);
            cells = mean(&cells, rows, columns, false);
        }
        Self { side, cells, rows, columns }
    }

    /// What it would be `octaves` finer, if both errors go on as they went from a coarser scale by an octave to this one, and their
    /// correlation stays.
    pub fn carried(mut self, coarser: &Self, octaves: f64) -> Self {
        let (now, before) = (self.errors(), coarser.errors());
        let part = |now: f64, before: f64| if before > 0.0 { (now / before).powf(octaves) } else { 1.0 };
        let plain = part(now.0, before.0);
        // Guides gain no trust by being carried on.
        let guided = part(now.1, before.1).max(plain);
        for cell in &mut self.cells {
            let (s, product, g) = (cell.plain, cell.plain - cell.cross, cell.guided());
            let product = product * (plain * guided).sqrt();
            cell.plain = s * plain;
            cell.cross = cell.plain - product;
            cell.change = (cell.plain + g * guided - 2.0 * product).max(0.0);
        }
        self
    }

    /// The mean squared errors of the plain and of the guided image, weighted.
    fn errors(&self) -> (f64, f64) {
        let sum = |value: fn(&Cell) -> f64| self.cells.iter().map(value).sum::<f64>();
        let count = sum(|cell| cell.count);
        (sum(|cell| cell.plain) / count, sum(Cell::guided) / count)
    }

    /// What blending takes away of the squared error, 0 to 1.
    pub fn worth(&self) -> f64 {
        let (mut before, mut gain) = (0.0, 0.0);
        for cell in &self.cells {
            let t = share(cell);
            before += cell.plain;
            gain += 2.0 * t * cell.cross - t * t * cell.change;
        }
        if before > 0.0 { gain / before } else { 0.0 }
    }

    /// The share of the guided image at every pixel, linear between the middles of cells.
    pub fn plane(&self, size: Size) -> Plane {
        let shares: Vec<f32> = self.cells.iter().map(|cell| share(cell) as f32).collect();
        let place = |at: usize, count: usize| {
            let at = ((at as f32 + 0.5) / self.side as f32 - 0.5).clamp(0.0, (count - 1) as f32);
            let low = at as usize;
            (low, (low + 1).min(count - 1), at - low as f32)
        };
        let across: Vec<_> = (0..size.width).map(|column| place(column, self.columns)).collect();
        let mut plane = Plane::filled(size, 0.0);
        plane.pixels_mut().par_chunks_mut(size.width).enumerate().for_each(|(row, pixels)| {
            let (top, bottom, v) = place(row, self.rows);
            let line = |row: usize| &shares[row * self.columns..][..self.columns];
            let (top, bottom) = (line(top), line(bottom));
            for (pixel, &(left, right, u)) in pixels.iter_mut().zip(&across) {
                let along = |line: &[f32]| line[left] + u * (line[right] - line[left]);
                *pixel = along(top) + v * (along(bottom) - along(top));
            }
        });
        plane
    }
}

/// The shrunk best share of a neighbourhood.
fn share(cell: &Cell) -> f64 {
    // Pixels that the three means take in, about.
    let pixels = cell.count * ((2 * RADIUS + 1) * (2 * RADIUS + 1)) as f64;
    if cell.change <= 0.0 || cell.plain <= 0.0 || cell.cross <= 0.0 || pixels <= 0.0 {
        return 0.0;
    }
    let explained = (cell.cross / cell.change) * (cell.cross / cell.plain);
    let best = (cell.cross / cell.change).min(1.0);
    best * (1.0 - CHANCE / (pixels * explained)).max(0.0)
}

/// Means over `2 RADIUS + 1` cells along columns or rows; at borders over those that exist, in proportion.
fn mean(cells: &[Cell], rows: usize, columns: usize, along_row: bool) -> Vec<Cell> {
    let (lines, length) = if along_row { (rows, columns) } else { (columns, rows) };
    let index = |line: usize, at: usize| if along_row { line * columns + at } else { at * columns + line };
    let mut out = vec![Cell::default(); cells.len()];
    for line in 0..lines {
        for at in 0..length {
            let span = at.saturating_sub(RADIUS)..(at + RADIUS + 1).min(length);
            let part = 1.0 / span.len() as f64;
            let sum = span.fold(Cell::default(), |sum, other| {
                let cell = &cells[index(line, other)];
                Cell {
                    count: sum.count + cell.count,
                    plain: sum.plain + cell.plain,
                    cross: sum.cross + cell.cross,
                    change: sum.change + cell.change,
                }
            });
            out[index(line, at)] = Cell {
                count: sum.count * part,
                plain: sum.plain * part,
                cross: sum.cross * part,
                change: sum.change * part,
            };
        }
    }
    out
}
