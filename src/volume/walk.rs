//! A walk along a ray: sample after sample through the cells of a grid, leaping over empty blocks.
//!
//! Sample `i` lies at `entry + i step` in index coordinates, whatever was leapt over, so that a picture has the same
//! bits with and without leaps. A leap ends before the first sample that might lie outside the empty blocks.

use super::blocks::{Blocks, EDGE};
use super::camera::Segment;
use super::grid::Grid;
use super::kernel::Kernel;
use super::vector::{Vector, scale};

/// Room at the faces of empty blocks for the rounding of positions, in cells.
const MARGIN: f32 = 1.0 / 512.0;

/// A walk along one ray.
pub struct Walk<'a, K: Kernel> {
    grid: &'a Grid,
    kernel: K,
    blocks: Option<&'a Blocks>,
    entry: [f32; 3],
    step: [f32; 3],
    per_step: [f32; 3],
    last: [f32; 3],
    /// Number of samples.
    pub count: u32,
    /// The cell whose voxels are gathered.
    cell: usize,
    taps: K::Taps,
}

/// Where a sample lies.
#[derive(Clone, Copy, Debug)]
pub struct Place {
    cell: [usize; 3],
    /// Within the cell.
    pub within: [f32; 3],
}

#[inline(always)]
fn single(v: Vector) -> [f32; 3] {
    [v[0] as f32, v[1] as f32, v[2] as f32]
}

impl<'a, K: Kernel> Walk<'a, K> {
    /// A walk along the segment in steps of `step` world units; no leaps without blocks.
    #[inline(always)]
    pub fn new(grid: &'a Grid, kernel: K, blocks: Option<&'a Blocks>, segment: &Segment, step: f64) -> Self {
        let per_sample = single(scale(segment.direction, step));
        let mut per_step = [f32::MAX; 3];
        for axis in 0..3 {
            if per_sample[axis] != 0.0 {
                per_step[axis] = 1.0 / per_sample[axis];
            }
        }
        Self {
            grid,
            kernel,
            blocks,
            entry: single(segment.entry),
            step: per_sample,
            per_step,
            last: single(grid.last()),
            count: (segment.length / step).min(1e9) as u32 + 1,
            cell: usize::MAX,
            taps: K::zero(),
        }
    }

    /// The place of sample `i`, which may be a fraction.
    #[inline(always)]
    pub fn place(&self, i: f32) -> Place {
        let (mut cell, mut within) = ([0; 3], [0.0; 3]);
        for axis in 0..3 {
            let p = self.entry[axis] + i * self.step[axis];
            let p = if p > 0.0 { p } else { 0.0 };
            let p = if p < self.last[axis] { p } else { self.last[axis] };
            let whole = p as i32;
            cell[axis] = whole as usize;
            within[axis] = p - whole as f32;
        }
        Place { cell, within }
    }

    /// Whether empty space is skipped at all.
    #[inline(always)]
    pub fn skips(&self) -> bool {
        self.blocks.is_some()
    }

    /// If sample `i` lies in an empty block, the next one that may not.
    #[inline(always)]
    pub fn leap(&self, i: u32, place: &Place) -> Option<u32> {
        let blocks = self.blocks?;
        let block = [place.cell[0] / EDGE, place.cell[1] / EDGE, place.cell[2] / EDGE];
        let distance = blocks.distance(block);
        if distance == 0 {
            return None;
        }
        let reach = f32::from(distance) - 1.0;
        let mut end = f32::MAX;
        for axis in 0..3 {
            let low = (block[axis] as f32 - reach) * EDGE as f32 + MARGIN;
            let high = (block[axis] as f32 + 1.0 + reach) * EDGE as f32 - MARGIN;
            let face = if self.step[axis] > 0.0 { high } else { low };
            let at = (face - self.entry[axis]) * self.per_step[axis];
            // No face is reached along a direction of 0, where `at` has any sign.
            let at = if self.step[axis] == 0.0 { f32::MAX } else { at };
            end = if at < end { at } else { end };
        }
        // Sample floor(end) is still inside.
        let next = if end > 0.0 { (end as u32).saturating_add(1) } else { 0 };
        Some(next.max(i + 1).min(self.count))
    }

    /// Gathers the voxels around a place; whether the cell is another than before.
    #[inline(always)]
    pub fn enter(&mut self, place: &Place) -> bool {
        let at = self.grid.at(place.cell);
        if at == self.cell {
            return false;
        }
        self.cell = at;
        self.kernel.gather(self.grid, at, &mut self.taps);
        true
    }

    /// Bounds of the values in the cell that was entered.
    #[inline(always)]
    pub fn bounds(&self) -> (f32, f32) {
        self.kernel.bounds(&self.taps)
    }

    /// The value at a place in the cell that was entered.
    #[inline(always)]
    pub fn value(&self, place: &Place) -> (f32, K::Partial) {
        self.kernel.value(&self.taps, place.within)
    }

    /// The gradient at a place in the cell that was entered, per index step.
    #[inline(always)]
    pub fn gradient(&self, place: &Place, partial: &K::Partial) -> [f32; 3] {
        self.kernel.gradient(&self.taps, place.within, partial)
    }

    /// Value and gradient at sample `i`, which may be a fraction.
    #[inline(always)]
    pub fn sample(&mut self, i: f32) -> (f32, [f32; 3]) {
        let place = self.place(i);
        self.enter(&place);
        let (value, partial) = self.value(&place);
        (value, self.gradient(&place, &partial))
    }
}
