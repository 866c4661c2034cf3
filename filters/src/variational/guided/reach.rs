//! How far a pixel looks for samples: as far as it takes to see a given number of them.
//!
//! Counted in squares around the nodes of a grid of [`STEP`] pixels by a summed-area table, turned into the radius of a
//! disc, averaged over 3 x 3 nodes and interpolated linearly in between, so that it changes slowly.

use std::ops::Range;

use lacuna_core::parallel::prelude::*;

use crate::{Mask, Size};

/// Pixels between nodes.
const STEP: usize = 8;
/// The largest radius; what lies further from every sample is left to the splines.
pub const FARTHEST: f32 = 64.0;
/// The smallest radius.
const NEAREST: f32 = 2.5;

/// A radius for each pixel.
#[derive(Clone, Debug)]
pub struct Reach {
    nodes: Vec<f32>,
    columns: usize,
    rows: usize,
}

impl Reach {
    /// The radii in which about `wanted` measured pixels lie.
    pub fn new(mask: &Mask, wanted: f64) -> Self {
        let size = mask.size();
        let table = sums(mask);
        let (rows, columns) = (size.height.div_ceil(STEP) + 1, size.width.div_ceil(STEP) + 1);
        let mut raw = vec![0.0; rows * columns];
        raw.par_chunks_mut(columns).enumerate().for_each(|(row, radii)| {
            for (column, radius) in radii.iter_mut().enumerate() {
                *radius = radius_at(&table, size, (row * STEP, column * STEP), wanted);
            }
        });
        let mut nodes = vec![0.0; raw.len()];
        nodes.par_chunks_mut(columns).enumerate().for_each(|(row, means)| {
            for (column, mean) in means.iter_mut().enumerate() {
                let (mut sum, mut count) = (0.0_f32, 0.0_f32);
                for y in row.saturating_sub(1)..(row + 2).min(rows) {
                    for x in column.saturating_sub(1)..(column + 2).min(columns) {
                        sum += raw[y * columns + x];
                        count += 1.0;
                    }
                }
                *mean = sum / count;
            }
        });
        Self { nodes, columns, rows }
    }

    /// The largest radius of the pixels in some rows and columns, or a little more.
    pub fn most(&self, rows: &Range<usize>, columns: &Range<usize>) -> f32 {
        let nodes = |span: &Range<usize>, count: usize| {
            (span.start / STEP).min(count - 1)..(span.end.div_ceil(STEP) + 1).min(count)
        };
        let all = nodes(rows, self.rows)
            .flat_map(|row| self.nodes[row * self.columns..][nodes(columns, self.columns)].iter());
        all.fold(0.0, |most, radius| most.max(*radius))
    }

    /// The smallest radius.
    pub fn least(&self) -> f32 {
        self.nodes.iter().copied().fold(FARTHEST, f32::min)
    }

    /// The radius at a pixel.
    pub fn at(&self, row: usize, column: usize) -> f32 {
        let (y, x) = (row / STEP, column / STEP);
        let (v, u) = ((row % STEP) as f32 / STEP as f32, (column % STEP) as f32 / STEP as f32);
        let node =
            |y: usize, x: usize| self.nodes[y.min(self.rows - 1) * self.columns + x.min(self.columns - 1)];
        let line = |y: usize| node(y, x) + u * (node(y, x + 1) - node(y, x));
        line(y) + v * (line(y + 1) - line(y))
    }
}

/// Measured pixels above and left of each corner.
fn sums(mask: &Mask) -> Vec<u32> {
    let Size { height, width } = mask.size();
    let mut table = vec![0; (height + 1) * (width + 1)];
    for row in 0..height {
        let (above, below) = table[row * (width + 1)..].split_at_mut(width + 1);
        let mut sum = 0;
        for (column, &measured) in mask.row(row).iter().enumerate() {
            sum += u32::from(measured);
            below[column + 1] = above[column + 1] + sum;
        }
    }
    table
}

/// Grows a square until it holds enough and interpolates between the last two. Near borders the part inside counts in
/// proportion.
fn radius_at(table: &[u32], size: Size, (row, column): (usize, usize), wanted: f64) -> f32 {
    let count = |half: usize| {
        let (top, bottom) = (row.saturating_sub(half), (row + half).min(size.height));
        let (left, right) = (column.saturating_sub(half), (column + half).min(size.width));
        let (top, left) = (top.min(bottom), left.min(right));
        let at = |y: usize, x: usize| i64::from(table[y * (size.width + 1) + x]);
        let inside = (bottom - top) * (right - left);
        let found = at(bottom, right) - at(top, right) - at(bottom, left) + at(top, left);
        let whole = 4 * half * half;
        if inside == 0 { 0.0 } else { found as f64 * (whole as f64 / inside as f64).min(2.0) }
    };
    let (mut low, mut half) = (0, 2_usize);
    while count(half) < wanted && half < FARTHEST as usize {
        low = half;
        half = (half + 1 + half / 4).min(FARTHEST as usize);
    }
    // Within the last step the count grows like an area.
    let (few, many) = (count(low), count(half));
    let part = if many > few { ((wanted - few) / (many - few)).clamp(0.0, 1.0) } else { 1.0 };
    let (a, b) = ((low * low) as f64, (half * half) as f64);
    let side = (a + part * (b - a)).sqrt();
    ((side * (4.0 / std::f64::consts::PI).sqrt()) as f32).clamp(NEAREST, FARTHEST)
}
