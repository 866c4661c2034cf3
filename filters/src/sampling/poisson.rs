//! Poisson disk: pixels in random order, each taken unless one within a radius has been, the radius shrinking.
//!
//! Every pixel of the field is a dart, thrown once a pass, in a random order: what a pass leaves is a maximal Poisson-disk
//! set of the pixel grid, without the misses of dart throwing in the plane. Squared distances of pixels are sums of two
//! squares; the first pass takes the next one above 0.75 / D as squared radius, which leaves too few, and each further pass
//! the next smaller one and adds to what is there, until there are enough. Of the last pass' samples as many as
//! needed stay, drawn at random: exactly `round(D N)` samples, no two closer than the radius of the last pass, and all but
//! the last pass' ones at least as far apart as the radius before. So the radius is solved for the density.
//!
//! Then each sample, in two sweeps, moves to that of the eight pixels around it from which the nearest other sample is
//! farthest, if it gains by that; no distance below the radius can arise.
//!
//! The order of a pass: tiles of at least 64 pixels and eight radii in four rounds (even and odd columns and rows of tiles),
//! random within. The tiles of a round are too far apart to meet, so that threads take a row of them each.
//!
//! Properties: blue noise, isotropic, irregular. NOT progressive: the mask of a smaller density is no part of a larger
//! one, hence no rank. Depends on the field, not on absolute coordinates. Cost: a hash
//! a pixel, pass and sweep; a byte a pixel, one more in the rows at work, four for each sample after the first pass.
//!
//! Sources: R. Cook, "Stochastic Sampling in Computer Graphics", ACM Transactions on Graphics 5(1), 1986 (dart
//! throwing); M. `McCool`, E. Fiume, "Hierarchical Poisson Disk Sampling Distributions", Graphics Interface 1992 (the shrinking
//! radius); R. Bridson, "Fast Poisson Disk Sampling in Arbitrary Dimensions", SIGGRAPH sketches 2007 (the grid that makes a
//! dart cost constant time); L.-Y. Wei, "Parallel Poisson Disk Sampling", SIGGRAPH 2008 (rounds of tiles).

use lacuna_core::parallel::prelude::*;

use super::random::Permutation;
use super::{Field, checked, hash};
use crate::{Error, Mask, Size};

/// The squared radius of the first pass, times the density. Random packing covers 0.547 of the plane with disks of half
/// the radius, which is a density of 0.7 over the squared radius; on the pixel grid somewhat more.
const START: f64 = 0.75;

/// Sweeps of relaxation.
const SWEEPS: usize = 2;

/// The mask: exactly `round(density N)` of the N pixels (halves go up).
///
/// # Errors
/// [`Error::Setting`] if the density is outside 0 to 1.
pub fn mask(field: Field, density: f64, seed: u64) -> Result<Mask, Error> {
    let wanted = (checked(density)? * field.size.pixels() as f64).round() as usize;
    if wanted == 0 || wanted == field.size.pixels() {
        return Ok(field.mask(|_, _| wanted > 0));
    }
    Mask::new(field.size, throw(field.size, wanted, seed))
}

/// Exactly `wanted` samples, more than none and less than all.
fn throw(size: Size, wanted: usize, seed: u64) -> Vec<bool> {
    let mut start = START * size.pixels() as f64 / wanted as f64;
    loop {
        let mut squared = sum_of_squares_above(start as u64);
        let mut set = Set::new(size);
        set.pass(squared, seed);
        // Tiny fields may hold more than the plane would; then from further up.
        if set.count > wanted {
            start *= 1.5;
            continue;
        }
        let mut latest = Vec::new();
        while set.count < wanted {
            squared = sum_of_squares_below(squared);
            latest = set.pass(squared, hash(seed, squared));
        }
        set.drop_some(&mut latest, set.count - wanted, seed);
        for _ in 0..SWEEPS {
            set.relax(squared, seed);
        }
        return set.taken;
    }
}

fn is_sum_of_squares(n: u64) -> bool {
    (0..=n.isqrt()).any(|a| (n - a * a).isqrt().pow(2) == n - a * a)
}

/// The smallest sum of two squares above `n`; twice a sum of two squares is one.
fn sum_of_squares_above(n: u64) -> u64 {
    (n + 1..2 * n + 2).find(|&n| is_sum_of_squares(n)).unwrap_or(2 * n + 2)
}

/// The largest sum of two squares below `n`, at least 1, the radius that keeps nothing off.
fn sum_of_squares_below(n: u64) -> u64 {
    (1..n).rev().find(|&n| is_sum_of_squares(n)).unwrap_or(1)
}

/// The samples so far.
struct Set {
    size: Size,
    taken: Vec<bool>,
    count: usize,
}

impl Set {
    fn new(size: Size) -> Self {
        Self { size, taken: vec![false; size.pixels()], count: 0 }
    }

    /// Throws every dart once; none is taken closer to another than the root of `squared`. Returns what was taken, unless
    /// it is the first pass.
    fn pass(&mut self, squared: u64, seed: u64) -> Vec<u32> {
        let (disk, first) = (disk(squared), self.count == 0);
        let latest = self.in_rounds(&Tiles::new(self.size, squared, seed), |slab, tiles, row| {
            let mut near = vec![false; slab.taken.len()];
            for pixel in (0..near.len()).filter(|&pixel| slab.taken[pixel]) {
                slab.mark(&disk, pixel, &mut near);
            }
            let (mut latest, mut count) = (Vec::new(), 0);
            tiles.for_each_dart(row, |y, x| {
                let pixel = (y - slab.top) * slab.width + x;
                if !near[pixel] {
                    slab.mark(&disk, pixel, &mut near);
                    slab.taken[pixel] = true;
                    count += 1;
                    if !first {
                        // A field has fewer than 2^32 pixels.
                        latest.push((y * slab.width + x) as u32);
                    }
                }
            });
            (latest, count)
        });
        self.count += latest.iter().map(|(_, count)| count).sum::<usize>();
        latest.into_iter().flat_map(|(latest, _)| latest).collect()
    }

    /// Moves each sample to that of the eight pixels around it from which the nearest other one is farthest, if farther.
    ///
    /// The least distance of all cannot fall: who is moved has nobody nearer than before.
    fn relax(&mut self, squared: u64, seed: u64) {
        let around = offsets(2 * (squared.isqrt() as isize + 1));
        self.in_rounds(&Tiles::new(self.size, squared, seed), |slab, tiles, row| {
            tiles.for_each_dart(row, |y, x| slab.relax(y - slab.top, x, &around));
        });
    }

    /// Calls `work` for every row of tiles, even ones first, those of a kind in parallel, each with half a tile around.
    fn in_rounds<R: Send>(
        &mut self,
        tiles: &Tiles,
        work: impl Fn(&mut Slab<'_>, &Tiles, usize) -> R + Sync,
    ) -> Vec<R> {
        let (mut results, width) = (Vec::new(), self.size.width);
        for parity in 0..2 {
            let (mut rest, mut top, mut slabs) = (self.taken.as_mut_slice(), 0, Vec::new());
            for row in (parity..tiles.down).step_by(2) {
                let from = (row * tiles.side).saturating_sub(tiles.side / 2);
                let to = (row * tiles.side + tiles.side + tiles.side / 2).min(self.size.height);
                let (_, after) = rest.split_at_mut((from - top) * width);
                let (taken, after) = after.split_at_mut((to - from) * width);
                slabs.push((Slab { top: from, width, taken }, row));
                (rest, top) = (after, to);
            }
            results.extend(slabs.into_par_iter().map(|(mut slab, row)| work(&mut slab, tiles, row)));
        }
        results
    }

    /// Takes `excess` of these samples away, those of the lowest hash.
    fn drop_some(&mut self, samples: &mut [u32], excess: usize, seed: u64) {
        if excess > 0 {
            let key = |pixel: &u32| (hash(!seed, u64::from(*pixel)), *pixel);
            samples.select_nth_unstable_by_key(excess - 1, key);
            samples[..excess].iter().for_each(|&pixel| self.taken[pixel as usize] = false);
            self.count -= excess;
        }
    }
}

/// Some whole rows of the field: a row of tiles and what its darts may meet.
struct Slab<'a> {
    top: usize,
    width: usize,
    taken: &'a mut [bool],
}

impl Slab<'_> {
    fn mark(&self, disk: &[(isize, isize)], pixel: usize, near: &mut [bool]) {
        let (row, column) = (pixel / self.width, pixel % self.width);
        let height = near.len() / self.width;
        for &(dy, half) in disk {
            let Some(row) = row.checked_add_signed(dy).filter(|&row| row < height) else { continue };
            let from = column.saturating_add_signed(-half);
            let to = (column + half as usize + 1).min(self.width);
            near[row * self.width..][from..to].fill(true);
        }
    }

    /// Moves a sample, if there is one, to a better place beside it.
    fn relax(&mut self, row: usize, column: usize, around: &[Offset]) {
        let pixel = row * self.width + column;
        if !self.taken[pixel] {
            return;
        }
        // Not its own neighbour while places are tried.
        self.taken[pixel] = false;
        let (mut best, mut farthest) = (pixel, self.nearest(row, column, around));
        let height = self.taken.len() / self.width;
        for y in row.saturating_sub(1)..(row + 2).min(height) {
            for x in column.saturating_sub(1)..(column + 2).min(self.width) {
                let distance = self.nearest(y, x, around);
                if distance > farthest {
                    (best, farthest) = (y * self.width + x, distance);
                }
            }
        }
        self.taken[best] = true;
    }

    /// Squared distance to the nearest sample among these places, 0 on one.
    fn nearest(&self, row: usize, column: usize, around: &[Offset]) -> usize {
        let height = self.taken.len() / self.width;
        let reach = around.last().map_or(0, |last| last.row.unsigned_abs());
        let inside = row >= reach && row + reach < height && column >= reach && column + reach < self.width;
        let pixel = row * self.width + column;
        let is_taken = |offset: &&Offset| {
            if inside {
                return self.taken
                    [pixel.wrapping_add_signed(offset.row * self.width as isize + offset.column)];
            }
            let y = row.checked_add_signed(offset.row).filter(|&y| y < height);
            let x = column.checked_add_signed(offset.column).filter(|&x| x < self.width);
            y.zip(x).is_some_and(|(y, x)| self.taken[y * self.width + x])
        };
        around.iter().find(is_taken).map_or(usize::MAX, |offset| offset.squared)
    }
}

/// A place beside a pixel, and how far it is.
struct Offset {
    row: isize,
    column: isize,
    squared: usize,
}

/// All places within `reach` rows and columns, the nearest first; the last is a corner.
fn offsets(reach: isize) -> Vec<Offset> {
    let rows = (-reach..=reach).flat_map(|row| (-reach..=reach).map(move |column| (row, column)));
    let offset = |(row, column): (isize, isize)| Offset {
        row,
        column,
        squared: row.unsigned_abs().pow(2) + column.unsigned_abs().pow(2),
    };
    let mut all: Vec<Offset> = rows.map(offset).collect();
    all.sort_by_key(|offset| offset.squared);
    all
}

/// The order of the darts.
struct Tiles {
    size: Size,
    side: usize,
    across: usize,
    down: usize,
    seed: u64,
}

impl Tiles {
    /// Tiles of eight radii at least, so that those of one round, of which half a tile lies between, do not meet.
    fn new(size: Size, squared: u64, seed: u64) -> Self {
        let side = (8 * (squared.isqrt() as usize + 1)).next_power_of_two().max(64);
        let side = side.min(size.height.max(size.width).next_power_of_two());
        Self { size, side, across: size.width.div_ceil(side), down: size.height.div_ceil(side), seed }
    }

    /// Calls `dart` with row and column for every pixel of a row of tiles, in the random order.
    fn for_each_dart(&self, row: usize, mut dart: impl FnMut(usize, usize)) {
        let (Size { height, width }, side) = (self.size, self.side);
        for parity in 0..2 {
            for column in (parity..self.across).step_by(2) {
                let tile = (row * self.across + column) as u64;
                let order = Permutation::new((side * side) as u64, hash(self.seed, tile));
                for place in 0..side * side {
                    let place = order.apply(place as u64) as usize;
                    let (y, x) = (row * side + place / side, column * side + place % side);
                    if y < height && x < width {
                        dart(y, x);
                    }
                }
            }
        }
    }
}

/// The rows of the open disk: row and half width from the centre.
fn disk(squared: u64) -> Vec<(isize, isize)> {
    let reach = (squared - 1).isqrt() as isize;
    (-reach..=reach).map(|dy| (dy, (squared - 1 - (dy * dy) as u64).isqrt() as isize)).collect()
}

#[cfg(test)]
#[path = "poisson/tests.rs"]
mod tests;
