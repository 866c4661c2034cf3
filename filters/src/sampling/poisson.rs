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
//! The order of a pass: tiles of at least 64 pixels in four rounds (even and odd columns and rows of tiles), random within.
//!
//! Properties: blue noise, isotropic, irregular. NOT progressive: the mask of a smaller density is no part of a larger
//! one, hence no rank. Depends on the field, not on absolute coordinates. Cost: about 60 ns a pixel and pass, 2 to 5
//! passes, one thread; two bytes a pixel.
//!
//! Sources: R. Cook, "Stochastic Sampling in Computer Graphics", ACM Transactions on Graphics 5(1), 1986 (dart
//! throwing); M. `McCool`, E. Fiume, "Hierarchical Poisson Disk Sampling Distributions", Graphics Interface 1992 (the shrinking
//! radius); R. Bridson, "Fast Poisson Disk Sampling in Arbitrary Dimensions", SIGGRAPH sketches 2007 (the grid that makes a
//! dart cost constant time); L.-Y. Wei, "Parallel Poisson Disk Sampling", SIGGRAPH 2008 (rounds of tiles).

use super::random::Permutation;
use super::{Field, checked, hash};
use crate::{Error, Mask, Size};

/// The squared radius of the first pass, times the density. Random packing covers 0.547 of the plane with disks of half
/// the radius, which is a density of 0.7 over the squared radius; on the pixel grid somewhat more.
const START: f64 = 0.75;

/// Sweeps of relaxation: one gives 0.35 dB on `engine` at 20 %, three 0.4 dB.
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
        while set.count < wanted {
            squared = sum_of_squares_below(squared);
            set.pass(squared, hash(seed, squared));
        }
        set.drop_latest(set.count - wanted, seed);
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
    /// The samples of the last pass, by index row by row.
    latest: Vec<usize>,
}

impl Set {
    fn new(size: Size) -> Self {
        Self { size, taken: vec![false; size.pixels()], count: 0, latest: Vec::new() }
    }

    /// Throws every dart once; none is taken closer to another than the root of `squared`.
    fn pass(&mut self, squared: u64, seed: u64) {
        let size = self.size;
        let disk = disk(squared);
        let mut near = vec![false; size.pixels()];
        for pixel in (0..size.pixels()).filter(|&pixel| self.taken[pixel]) {
            mark(size, &disk, pixel, &mut near);
        }
        self.latest.clear();
        for_each_dart(size, squared, seed, |pixel| {
            if !near[pixel] {
                mark(size, &disk, pixel, &mut near);
                self.taken[pixel] = true;
                self.latest.push(pixel);
            }
        });
        self.count += self.latest.len();
    }

    /// Moves each sample to that of the eight pixels around it from which the nearest other one is farthest, if farther.
    ///
    /// The least distance of all cannot fall: who is moved has nobody nearer than before.
    fn relax(&mut self, squared: u64, seed: u64) {
        let size = self.size;
        let reach = 2 * (squared.isqrt() as usize + 1);
        for_each_dart(size, squared, seed, |pixel| {
            if !self.taken[pixel] {
                return;
            }
            // Not its own neighbour while places are tried.
            self.taken[pixel] = false;
            let (row, column) = (pixel / size.width, pixel % size.width);
            let (mut best, mut farthest) = (pixel, self.nearest(row, column, reach));
            for y in row.saturating_sub(1)..(row + 2).min(size.height) {
                for x in column.saturating_sub(1)..(column + 2).min(size.width) {
                    let distance = self.nearest(y, x, reach);
                    if distance > farthest {
                        (best, farthest) = (y * size.width + x, distance);
                    }
                }
            }
            self.taken[best] = true;
        });
    }

    /// Squared distance to the nearest sample within `reach` rows and columns, 0 on one.
    fn nearest(&self, row: usize, column: usize, reach: usize) -> usize {
        let size = self.size;
        let columns = column.saturating_sub(reach)..(column + reach + 1).min(size.width);
        let mut least = usize::MAX;
        for y in row.saturating_sub(reach)..(row + reach + 1).min(size.height) {
            let dy = y.abs_diff(row).pow(2);
            if dy < least {
                let flags = &self.taken[y * size.width..][columns.clone()];
                for (x, _) in columns.clone().zip(flags).filter(|(_, taken)| **taken) {
                    least = least.min(dy + x.abs_diff(column).pow(2));
                }
            }
        }
        least
    }

    /// Takes `excess` samples of the last pass away, those of the lowest hash.
    fn drop_latest(&mut self, excess: usize, seed: u64) {
        if excess > 0 {
            let key = |pixel: &usize| (hash(!seed, *pixel as u64), *pixel);
            self.latest.select_nth_unstable_by_key(excess - 1, key);
            self.latest[..excess].iter().for_each(|&pixel| self.taken[pixel] = false);
            self.count -= excess;
        }
    }
}

/// The rows of the open disk: row and half width from the centre.
fn disk(squared: u64) -> Vec<(isize, isize)> {
    let reach = (squared - 1).isqrt() as isize;
    (-reach..=reach).map(|dy| (dy, (squared - 1 - (dy * dy) as u64).isqrt() as isize)).collect()
}

fn mark(size: Size, disk: &[(isize, isize)], pixel: usize, near: &mut [bool]) {
    let (row, column) = (pixel / size.width, pixel % size.width);
    for &(dy, half) in disk {
        let Some(row) = row.checked_add_signed(dy).filter(|&row| row < size.height) else { continue };
        let from = column.saturating_add_signed(-half);
        let to = (column + half as usize + 1).min(size.width);
        near[row * size.width..][from..to].fill(true);
    }
}

/// Calls `dart` for every pixel, in the random order.
fn for_each_dart(size: Size, squared: u64, seed: u64, mut dart: impl FnMut(usize)) {
    let side = (8 * (squared.isqrt() as usize + 1)).next_power_of_two().max(64);
    let side = side.min(size.height.max(size.width).next_power_of_two());
    let (across, down) = (size.width.div_ceil(side), size.height.div_ceil(side));
    for pass in 0..4 {
        for top in (pass / 2..down).step_by(2) {
            for left in (pass % 2..across).step_by(2) {
                let order = Permutation::new((side * side) as u64, hash(seed, (top * across + left) as u64));
                for place in 0..side * side {
                    let place = order.apply(place as u64) as usize;
                    let (row, column) = (top * side + place / side, left * side + place % side);
                    if row < size.height && column < size.width {
                        dart(row * size.width + column);
                    }
                }
            }
        }
    }
}

#[cfg(test)]
#[path = "poisson/tests.rs"]
mod tests;
