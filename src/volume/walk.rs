//! A walk along a ray: bundles of samples in the cells of a grid, leaping over empty blocks.
//!
//! Sample `i` lies at `entry + i step` in index coordinates, whatever was leapt over, so that a picture has the same
//! bits with and without leaps. A leap ends before the first sample that might lie outside the empty blocks. Samples that
//! may be seen wait in a queue until they are a bundle, so that lanes stay full.

use super::blocks::{Blocks, EDGE};
use super::camera::Segment;
use super::grid::Grid;
use super::kernel::{Cells, Kernel};
use super::lanes::{LANES, Lanes, all};
use super::vector::{Vector, scale};

/// Room at the faces of empty blocks for the rounding of positions, in cells.
const MARGIN: f32 = 1.0 / 512.0;
/// A queue holds less than a bundle before a scan, which adds a bundle and one sample at most.
const QUEUE: usize = 2 * LANES;

/// A walk along one ray.
pub struct Walk<'a, K: Kernel> {
    grid: &'a Grid,
    kernel: K,
    blocks: Option<&'a Blocks>,
    /// Whether samples count by pairs: both of a pair are given if one may be seen.
    pairs: bool,
    entry: [f32; 3],
    step: [f32; 3],
    /// Samples per index step; 0 where a face is never reached.
    per_step: [f32; 3],
    last: [f32; 3],
    /// Number of samples.
    count: u32,
    /// The first sample that was not scanned.
    next: u32,
    queue: [u32; QUEUE],
    queued: usize,
    /// The last sample that was queued, and whether it may be seen itself.
    newest: Option<(u32, bool)>,
    /// Values up to this one are of no interest; see [`Walk::beat`].
    least: f32,
    /// Voxels of the last cells: a ring.
    cells: Cells<K>,
    /// The cell gathered last, and where.
    cell: usize,
    slot: usize,
}

/// Samples side by side.
pub struct Bundle {
    /// How many; the lanes behind repeat the last one.
    pub count: usize,
    /// Their numbers from the entry.
    pub samples: [f32; LANES],
    /// x, y, z within the cell, 0 to 1.
    within: [Lanes; 3],
    /// Which cell of the ring.
    slots: [u8; LANES],
}

/// Cells and places in them.
struct Places {
    cells: [[i32; LANES]; 3],
    within: [Lanes; 3],
}

fn single(v: Vector) -> [f32; 3] {
    v.map(|part| part as f32)
}

impl<'a, K: Kernel> Walk<'a, K> {
    /// A walk along the segment in steps of `step` world units; no leaps without blocks.
    #[inline(always)]
    pub fn new(
        grid: &'a Grid,
        kernel: K,
        (blocks, pairs): (Option<&'a Blocks>, bool),
        segment: &Segment,
        step: f64,
    ) -> Self {
        let per_sample = single(scale(segment.direction, step));
        Self {
            grid,
            kernel,
            blocks,
            pairs,
            entry: single(segment.entry),
            step: per_sample,
            per_step: per_sample.map(|part| if part == 0.0 { 0.0 } else { 1.0 / part }),
            last: single(grid.last()),
            count: segment.samples(step),
            next: 0,
            queue: [0; QUEUE],
            queued: 0,
            newest: None,
            least: f32::NEG_INFINITY,
            cells: K::cells(),
            cell: usize::MAX,
            slot: 0,
        }
    }

    /// How many samples there are.
    #[inline(always)]
    pub const fn count(&self) -> u32 {
        self.count
    }

    /// The next samples that may be seen, in order; nothing at the end.
    #[inline(always)]
    pub fn next(&mut self) -> Option<Bundle> {
        while self.queued < LANES && self.next < self.count {
            self.scan();
        }
        if self.queued == 0 {
            return None;
        }
        let count = self.queued.min(LANES);
        let samples = std::array::from_fn(|k| self.queue[k.min(count - 1)] as f32);
        for k in 0..LANES {
            self.queue[k] = self.queue[k + LANES];
        }
        self.queued -= count;
        Some(self.bundle(samples, count))
    }

    /// From now on only values above this one are of interest.
    #[inline(always)]
    pub fn beat(&mut self, value: f32) {
        self.least = value;
    }

    #[inline(always)]
    fn push(&mut self, sample: u32, seen: bool) {
        // Always within the queue: see its length.
        self.queue[self.queued % QUEUE] = sample;
        self.queued += 1;
        self.newest = Some((sample, seen));
    }

    /// Queues those of the next samples that may be seen, and finds where to go on.
    #[inline(always)]
    fn scan(&mut self) {
        let first = self.next;
        let end = (first + LANES as u32).min(self.count);
        self.next = end;
        let Some(blocks) = self.blocks else {
            for sample in first..end {
                self.push(sample, true);
            }
            return;
        };
        let places = self.places(Lanes::new(std::array::from_fn(|k| (first + k as u32) as f32)));
        let numbers = blocks.numbers(&places.cells);
        let mut sample = first;
        while sample < end {
            let lane = (sample - first) as usize;
            let distance = blocks.distance(numbers[lane]);
            if distance == 0 && blocks.may_beat(numbers[lane], self.least) {
                if self.pairs && sample > 0 && self.newest.is_none_or(|(newest, _)| newest + 1 < sample) {
                    self.push(sample - 1, false);
                }
                self.push(sample, true);
                sample += 1;
                continue;
            }
            if self.pairs && self.newest.is_some_and(|(newest, seen)| seen && newest + 1 == sample) {
                self.push(sample, false);
            }
            let [x, y, z] = &places.cells;
            let cell = [x[lane], y[lane], z[lane]];
            sample = if distance == 0 { sample + 1 } else { self.leap(sample, cell, distance) };
        }
        self.next = sample;
    }

    /// From a sample in that cell of an empty block of that distance, the next one that may not lie in an empty block.
    #[inline(always)]
    fn leap(&self, sample: u32, cell: [i32; 3], distance: u8) -> u32 {
        let reach = (f32::from(distance) - 1.0) * EDGE as f32;
        let mut end = f32::MAX;
        for axis in 0..3 {
            let corner = (cell[axis] as usize / EDGE * EDGE) as f32;
            let (entry, per_step) = (self.entry[axis], self.per_step[axis]);
            let (low, high) = (corner - (reach - MARGIN), corner + (reach + EDGE as f32 - MARGIN));
            // The product is the larger for the face ahead. Without a direction there is no face.
            let face = if per_step > 0.0 { (high - entry) * per_step } else { (low - entry) * per_step };
            end = if per_step != 0.0 && face < end { face } else { end };
        }
        // Sample floor(end) is still inside.
        let next = if end > 0.0 { (end as u32).saturating_add(1) } else { 0 };
        next.max(sample + 1).min(self.count)
    }

    /// The places of samples, which may be fractions.
    #[inline(always)]
    fn places(&self, samples: Lanes) -> Places {
        let mut places = Places { cells: [[0; LANES]; 3], within: [Lanes::ZERO; 3] };
        for axis in 0..3 {
            let p = all(self.entry[axis]) + samples * all(self.step[axis]);
            let p = p.fast_max(Lanes::ZERO).fast_min(all(self.last[axis]));
            // Not negative, so that cutting the fraction off rounds down.
            let cell = p.fast_trunc_int();
            places.within[axis] = p - cell.round_float();
            places.cells[axis] = cell.to_array();
        }
        places
    }

    /// A bundle of samples in order, which may be fractions: their voxels are gathered.
    #[inline(always)]
    pub fn bundle(&mut self, samples: [f32; LANES], count: usize) -> Bundle {
        let Places { cells: [x, y, z], within } = self.places(Lanes::new(samples));
        let mut slots = [0; LANES];
        for lane in 0..count {
            let at = self.grid.at([x[lane] as usize, y[lane] as usize, z[lane] as usize]);
            if at != self.cell {
                self.cell = at;
                self.slot = (self.slot + 1) % LANES;
                self.kernel.gather(self.grid, at, &mut self.cells[self.slot]);
            }
            slots[lane] = self.slot as u8;
        }
        Bundle { count, samples, within, slots }
    }

    /// The values of a bundle's samples.
    #[inline(always)]
    pub fn values(&self, bundle: &Bundle) -> (Lanes, K::Partial) {
        self.kernel.values(&self.cells, &bundle.slots[..bundle.count], &bundle.within)
    }

    /// The gradients per index step of those samples whose bit is set; others are anything.
    #[inline(always)]
    pub fn gradients(&self, bundle: &Bundle, partial: &K::Partial, wanted: u32) -> [Lanes; 3] {
        self.kernel.gradients(&self.cells, &bundle.slots[..bundle.count], &bundle.within, partial, wanted)
    }
}
