//! A walk along a ray: sample after sample through the cells of a grid, leaping over empty blocks.
//!
//! Sample `i` lies at `entry + i step` in index coordinates, whatever was leapt over, so that a picture has the same
//! bits with and without leaps. A leap ends before the first sample that might lie outside the empty blocks.

use wide::f32x4;

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
    /// x, y, z and nothing.
    entry: f32x4,
    step: f32x4,
    /// Samples per index step; 0 where a face is never reached.
    per_step: f32x4,
    last: f32x4,
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
    pub within: f32x4,
}

#[inline(always)]
fn single(v: Vector) -> f32x4 {
    f32x4::new([v[0] as f32, v[1] as f32, v[2] as f32, 0.0])
}

impl<'a, K: Kernel> Walk<'a, K> {
    /// A walk along the segment in steps of `step` world units; no leaps without blocks.
    #[inline(always)]
    pub fn new(grid: &'a Grid, kernel: K, blocks: Option<&'a Blocks>, segment: &Segment, step: f64) -> Self {
        let per_sample = single(scale(segment.direction, step));
        let over = |part: f32| if part == 0.0 { 0.0 } else { 1.0 / part };
        let [x, y, z, _] = per_sample.to_array();
        let per_step = f32x4::new([over(x), over(y), over(z), 0.0]);
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
        let p = self.entry + f32x4::splat(i) * self.step;
        let p = p.fast_max(f32x4::ZERO).fast_min(self.last);
        // Not negative, so that cutting the fraction off rounds down.
        let cell = p.fast_trunc_int();
        let within = p - cell.round_float();
        let [x, y, z, _] = cell.to_array();
        Place { cell: [x as usize, y as usize, z as usize], within }
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
        let reach = (f32::from(distance) - 1.0) * EDGE as f32;
        let corner =
            f32x4::new([block[0] as f32, block[1] as f32, block[2] as f32, 0.0]) * f32x4::splat(EDGE as f32);
        let low = corner - f32x4::splat(reach - MARGIN);
        let high = corner + f32x4::splat(reach + EDGE as f32 - MARGIN);
        // The product is the larger for the face ahead. Without a direction both are 0, which is no face.
        let (back, ahead) = ((low - self.entry) * self.per_step, (high - self.entry) * self.per_step);
        let faces = back.fast_max(ahead).to_array();
        let directions = self.per_step.to_array();
        let mut end = f32::MAX;
        for axis in 0..3 {
            end = if directions[axis] != 0.0 && faces[axis] < end { faces[axis] } else { end };
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
