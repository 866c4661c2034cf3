//! Step sizes that follow how steep the image is, so that flat and steep surroundings converge alike.
//!
//! A sweep converges with `|sigma^(1/2) grad tau^(1/2)| < 1` for diagonal `tau` (a value a pixel) and `sigma` (one a gradient). As
//! `|grad|^2 < 8`, that holds if `sigma tau <= product / 8` for each gradient and each pixel that it depends on. Here `tau` is one
//! value a block of pixels and `sigma` the largest that this allows.
//!
//! Source: T. Pock, A. Chambolle, "Diagonal Preconditioning for First Order Primal-Dual Algorithms in Convex Optimization", ICCV
//! 2011, lemma 2 (with other diagonals).

use crate::Size;

/// Rows and columns of a block.
pub const BLOCK: usize = 16;

/// Step sizes of all pixels: one row for each [`BLOCK`] rows of the image.
#[derive(Clone, Debug)]
pub struct Steps {
    tau: Vec<f32>,
    sigma: Vec<f32>,
    width: usize,
}

impl Steps {
    /// The same everywhere.
    pub fn uniform(size: Size, tau: f64, product: f64) -> Self {
        let blocks = size.height.div_ceil(BLOCK) * size.width.div_ceil(BLOCK);
        Self::of_blocks(size, &vec![tau; blocks], product)
    }

    /// Primal steps `tau`, one a block, row-major.
    pub fn of_blocks(size: Size, tau: &[f64], product: f64) -> Self {
        let (rows, columns) = (size.height.div_ceil(BLOCK), size.width.div_ceil(BLOCK));
        let at = |row: usize, column: usize| tau[row.min(rows - 1) * columns + column.min(columns - 1)];
        // A gradient depends on the pixel itself, the one to its right and the one below.
        let largest = |row, column| at(row, column).max(at(row + 1, column)).max(at(row, column + 1));
        let spread = |value: &dyn Fn(usize, usize) -> f64| -> Vec<f32> {
            let places = (0..rows).flat_map(|row| (0..columns).map(move |column| (row, column)));
            let mut all = Vec::with_capacity(rows * size.width);
            for (row, column) in places {
                let pixels = BLOCK.min(size.width - column * BLOCK);
                all.resize(all.len() + pixels, value(row, column) as f32);
            }
            all
        };
        Self {
            tau: spread(&at),
            sigma: spread(&|row, column| product / 8.0 / largest(row, column)),
            width: size.width,
        }
    }

    /// Primal steps of row `y`.
    pub fn tau(&self, y: usize) -> &[f32] {
        &self.tau[y / BLOCK * self.width..][..self.width]
    }

    /// Dual steps of row `y`.
    pub fn sigma(&self, y: usize) -> &[f32] {
        &self.sigma[y / BLOCK * self.width..][..self.width]
    }
}

/// A grid of one value a block, row-major, smoothed twice by the tent (1 2 1) / 4 along both axes; its edges are repeated.
pub fn smooth(columns: usize, values: &mut [f64]) {
    let rows = values.len() / columns.max(1);
    for _ in 0..2 {
        let before = values.to_vec();
        let tent = |a: f64, b: f64, c: f64| 0.25 * (a + 2.0 * b + c);
        let at = |row: usize, column: usize| before[row * columns + column];
        for row in 0..rows {
            let (up, down) = (row.saturating_sub(1), (row + 1).min(rows - 1));
            for column in 0..columns {
                let (left, right) = (column.saturating_sub(1), (column + 1).min(columns - 1));
                let along = |row| tent(at(row, left), at(row, column), at(row, right));
                values[row * columns + column] = tent(along(up), along(row), along(down));
            }
        }
    }
}
