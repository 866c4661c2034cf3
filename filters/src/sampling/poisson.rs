//! Poisson disk: pixels in random order, each taken unless one within a radius has been, the radius shrinking.
//!
//! Every pixel of the field is a dart, thrown once a pass, in a random order: what a pass leaves is a maximal Poisson-disk
//! set of the pixel grid, without the misses of dart throwing in the plane. Squared distances of pixels are sums of two
//! squares; the first pass takes the next one above 0.75 / D as squared radius, which leaves too few, and each further pass
//! the next smaller one that leaves room for any and adds to what is there, until there are enough. Of the last pass' samples as many as
//! needed stay, drawn at random: exactly `round(D N)` samples, no two closer than the radius of the last pass, and all but
//! the last pass' ones at least as far apart as the radius before. So the radius is solved for the density.
//!
//! Then each sample, in two sweeps, moves to that of the eight pixels around it from which the nearest other sample is
//! farthest, if it gains by that; no distance below the radius can arise.
//!
//! The order of a pass: tiles of at least 64 pixels and eight radii in four rounds (even and odd columns and rows of tiles),
//! random within. The tiles of a round are too far apart to meet, so that threads take a row of them each. A tile with few pixels to look at, as
//! it reaches beyond the field or has few samples, sorts these by the order; others are gone through in it.
//!
//! Each pixel knows how far its nearest sample is, so that a pass takes the largest distance there is as radius: those between take nothing.
//!
//! Properties: blue noise, isotropic, irregular. NOT progressive: the mask of a smaller density is no part of a larger
//! one, hence no rank. Depends on the field, not on absolute coordinates. Cost: a hash a pixel of the first pass, and of each sweep unless
//! samples are few; five bytes a pixel, and four for each sample.
//!
//! Sources: R. Cook, "Stochastic Sampling in Computer Graphics", ACM Transactions on Graphics 5(1), 1986 (dart
//! throwing); M. `McCool`, E. Fiume, "Hierarchical Poisson Disk Sampling Distributions", Graphics Interface 1992 (the shrinking
//! radius); R. Bridson, "Fast Poisson Disk Sampling in Arbitrary Dimensions", SIGGRAPH sketches 2007 (the grid that makes a
//! dart cost constant time); L.-Y. Wei, "Parallel Poisson Disk Sampling", SIGGRAPH 2008 (rounds of tiles).

use std::cmp::Reverse;
use std::collections::BinaryHeap;
use std::ops::Range;

use lacuna_core::parallel::prelude::*;

use super::random::Permutation;
use super::{Field, checked};
use crate::{Error, Mask, Size};
use lacuna_core::hash;

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
        let mut latest = set.pass(squared, seed);
        // Tiny and thin fields may hold more than the plane would; then from further up.
        if set.count > wanted {
            start *= 1.5;
            continue;
        }
        while set.count < wanted {
            squared = set.widest();
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

/// Of a pixel: no sample is within the radius.
const OPEN: u32 = u32::MAX;

/// Neighbours as near are looked for place by place, farther ones in a list of samples.
const NEAR: usize = 16;

/// The samples so far.
struct Set {
    size: Size,
    taken: Vec<bool>,
    /// The squared distance to the nearest sample while darts are thrown; distances of 65535 pixels and more are alike.
    squared: Vec<u32>,
    count: usize,
}

impl Set {
    fn new(size: Size) -> Self {
        Self { size, taken: vec![false; size.pixels()], squared: vec![OPEN; size.pixels()], count: 0 }
    }

    /// The largest squared distance of a pixel to its nearest sample.
    fn widest(&self) -> u64 {
        u64::from(self.squared.iter().copied().max().unwrap_or(0))
    }

    /// Throws every dart once; none is taken closer to another than the root of `squared`. Returns what was taken.
    fn pass(&mut self, squared: u64, seed: u64) -> Vec<u32> {
        let disk = disk(squared, self.size.height);
        let radius = u32::try_from(squared).unwrap_or(OPEN);
        let latest = self.in_rounds(&Tiles::new(self.size, squared, seed), |slab, tiles, row| {
            let mut latest = Vec::new();
            tiles.for_each_dart(
                row,
                slab,
                |slab, pixel| slab.squared[pixel] >= radius,
                |slab, pixel| {
                    slab.taken[pixel] = true;
                    slab.mark(&disk, pixel);
                    // A field has fewer than 2^32 pixels.
                    latest.push((slab.top * slab.width + pixel) as u32);
                    pixel
                },
            );
            latest
        });
        let latest = latest.concat();
        self.count += latest.len();
        latest
    }

    /// Moves each sample to that of the eight pixels around it from which the nearest other one is farthest, if farther.
    ///
    /// The least distance of all cannot fall: who is moved has nobody nearer than before.
    fn relax(&mut self, squared: u64, seed: u64) {
        let reach = 2 * (squared.isqrt() as usize + 1);
        let around = offsets(reach.min(NEAR) as isize);
        self.in_rounds(&Tiles::new(self.size, squared, seed), |slab, tiles, row| {
            let mut far = Vec::new();
            let is_sample = |slab: &Slab<'_>, pixel: usize| slab.taken[pixel];
            tiles.for_each_dart(row, slab, is_sample, |slab, pixel| {
                slab.relax(pixel, (reach, &around), &mut far)
            });
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
            let mut rest = (self.taken.as_mut_slice(), self.squared.as_mut_slice());
            let (mut top, mut slabs) = (0, Vec::new());
            for row in (parity..tiles.down).step_by(2) {
                let from = (row * tiles.side).saturating_sub(tiles.side / 2);
                let to = (row * tiles.side + tiles.side + tiles.side / 2).min(self.size.height);
                let (taken, after) = rest.0[(from - top) * width..].split_at_mut((to - from) * width);
                let (squared, beyond) = rest.1[(from - top) * width..].split_at_mut((to - from) * width);
                slabs.push((Slab { top: from, width, taken, squared }, row));
                (rest, top) = ((after, beyond), to);
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

/// Some whole rows of the field: a row of tiles and what its darts may meet. Pixels are counted from its first.
struct Slab<'a> {
    top: usize,
    width: usize,
    taken: &'a mut [bool],
    squared: &'a mut [u32],
}

impl Slab<'_> {
    fn index(&self, (y, x): (usize, usize)) -> usize {
        (y - self.top) * self.width + x
    }

    /// Tells the pixels around a sample how far it is.
    fn mark(&mut self, disk: &[(isize, isize)], pixel: usize) {
        let (row, column) = (pixel / self.width, pixel % self.width);
        let height = self.taken.len() / self.width;
        for &(dy, half) in disk {
            let Some(row) = row.checked_add_signed(dy).filter(|&row| row < height) else { continue };
            let from = column.saturating_add_signed(-half);
            let to = (column + half as usize + 1).min(self.width);
            let below = dy.unsigned_abs().pow(2);
            for (x, squared) in (from..to).zip(&mut self.squared[row * self.width..][from..to]) {
                let own = (below + x.abs_diff(column).pow(2)).min(OPEN as usize - 1);
                *squared = (*squared).min(own as u32);
            }
        }
    }

    /// Moves a sample to a better place beside it, if there is one; returns where it is then. `around` are places within [`NEAR`], `far` is room
    /// for the samples within reach.
    fn relax(
        &mut self,
        pixel: usize,
        (reach, around): (usize, &[Offset]),
        far: &mut Vec<(usize, usize)>,
    ) -> usize {
        let (row, column) = (pixel / self.width, pixel % self.width);
        let height = self.taken.len() / self.width;
        // Not its own neighbour while places are tried.
        self.taken[pixel] = false;
        let range = |at: usize, by: usize, end: usize| at.saturating_sub(by)..(at + by + 1).min(end);
        far.clear();
        // Places beside it are at most two pixels farther.
        let is_near = self.nearest(row, column, around).is_some_and(|squared| squared <= (NEAR - 2).pow(2));
        if !is_near {
            let columns = range(column, reach + 1, self.width);
            for y in range(row, reach + 1, height) {
                let flags = &self.taken[y * self.width..][columns.clone()];
                far.extend(columns.clone().zip(flags).filter(|(_, flag)| **flag).map(|(x, _)| (y, x)));
            }
        }
        let nearest = |y: usize, x: usize| {
            if is_near { self.nearest(y, x, around) } else { nearest_of(far, (y, x), reach) }
                .unwrap_or(usize::MAX)
        };
        let (mut best, mut farthest) = (pixel, nearest(row, column));
        for y in range(row, 1, height) {
            for x in range(column, 1, self.width) {
                let distance = nearest(y, x);
                if distance > farthest {
                    (best, farthest) = (y * self.width + x, distance);
                }
            }
        }
        self.taken[best] = true;
        best
    }

    /// Squared distance to the nearest sample among these places, 0 on one.
    fn nearest(&self, row: usize, column: usize, around: &[Offset]) -> Option<usize> {
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
        around.iter().find(is_taken).map(|offset| offset.squared)
    }
}

/// Squared distance to the nearest of these samples within `reach` rows and columns.
fn nearest_of(samples: &[(usize, usize)], (y, x): (usize, usize), reach: usize) -> Option<usize> {
    let apart = samples.iter().map(|sample| (sample.0.abs_diff(y), sample.1.abs_diff(x)));
    apart.filter(|(dy, dx)| dy.max(dx) <= &reach).map(|(dy, dx)| dy * dy + dx * dx).min()
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

/// Of a tile with fewer pixels to look at than one in so many, these are sorted.
const FEW: usize = 16;

impl Tiles {
    /// Tiles of eight radii at least, so that those of one round, of which half a tile lies between, do not meet.
    fn new(size: Size, squared: u64, seed: u64) -> Self {
        let side = (8 * (squared.isqrt() as usize + 1)).next_power_of_two().max(64);
        let side = side.min(size.height.max(size.width).next_power_of_two());
        Self { size, side, across: size.width.div_ceil(side), down: size.height.div_ceil(side), seed }
    }

    /// Calls `dart` for every pixel of a row of tiles that `wanted` takes when its turn comes, in the random order. `dart` returns where in the slab
    /// the pixel's sample is then, whose turn may still come.
    fn for_each_dart(
        &self,
        row: usize,
        slab: &mut Slab<'_>,
        wanted: impl Fn(&Slab<'_>, usize) -> bool,
        mut dart: impl FnMut(&mut Slab<'_>, usize) -> usize,
    ) {
        for column in (0..self.across).step_by(2).chain((1..self.across).step_by(2)) {
            let (tile, few) = (self.tile(row, column), self.side * self.side / FEW);
            let pixels = tile.pixels().filter(|&pixel| wanted(slab, slab.index(pixel)));
            let mut turns: BinaryHeap<Reverse<u64>> =
                pixels.take(few + 1).map(|pixel| Reverse(tile.turn(pixel))).collect();
            if turns.len() > few {
                for pixel in (0..(self.side * self.side) as u64).filter_map(|turn| tile.pixel(turn)) {
                    let pixel = slab.index(pixel);
                    if wanted(slab, pixel) {
                        dart(slab, pixel);
                    }
                }
                continue;
            }
            while let Some(Reverse(turn)) = turns.pop() {
                let pixel = tile.pixel(turn).map(|pixel| slab.index(pixel));
                let Some(pixel) = pixel.filter(|&pixel| wanted(slab, pixel)) else { continue };
                let moved = dart(slab, pixel);
                let moved = (slab.top + moved / slab.width, moved % slab.width);
                if tile.contains(moved) && tile.turn(moved) > turn {
                    turns.push(Reverse(tile.turn(moved)));
                }
            }
        }
    }

    fn tile(&self, row: usize, column: usize) -> Tile {
        let Size { height, width } = self.size;
        let of = |at: usize, end: usize| at * self.side..(at * self.side + self.side).min(end);
        let seed = hash(self.seed, (row * self.across + column) as u64);
        let order = Permutation::new((self.side * self.side) as u64, seed);
        Tile { rows: of(row, height), columns: of(column, width), side: self.side, order }
    }
}

/// A tile: its pixels in the field, and the order of all that it would have.
struct Tile {
    rows: Range<usize>,
    columns: Range<usize>,
    side: usize,
    order: Permutation,
}

impl Tile {
    fn pixels(&self) -> impl Iterator<Item = (usize, usize)> {
        self.rows.clone().flat_map(|y| self.columns.clone().map(move |x| (y, x)))
    }

    fn contains(&self, (y, x): (usize, usize)) -> bool {
        self.rows.contains(&y) && self.columns.contains(&x)
    }

    /// When it is a pixel's turn.
    fn turn(&self, (y, x): (usize, usize)) -> u64 {
        self.order.invert(((y - self.rows.start) * self.side + x - self.columns.start) as u64)
    }

    /// Whose turn it is, if it lies in the field.
    fn pixel(&self, turn: u64) -> Option<(usize, usize)> {
        let place = self.order.apply(turn) as usize;
        let pixel = (self.rows.start + place / self.side, self.columns.start + place % self.side);
        self.contains(pixel).then_some(pixel)
    }
}

/// The rows of the open disk that a field may have: row and half width from the centre.
fn disk(squared: u64, height: usize) -> Vec<(isize, isize)> {
    let reach = (squared - 1).isqrt().min(height as u64 - 1) as isize;
    (-reach..=reach).map(|dy| (dy, (squared - 1 - (dy * dy) as u64).isqrt() as isize)).collect()
}

#[cfg(test)]
#[path = "poisson/tests.rs"]
mod tests;
