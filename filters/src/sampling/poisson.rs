//! Poisson disk: pixels in random order, each taken unless one within a radius has been.
//!
//! Every pixel of the field is a dart, thrown once, in a random order: what is left is a maximal Poisson-disk set of the
//! pixel grid, without the misses of dart throwing in the plane. Distances of pixels are roots of sums of two squares, and
//! with one of them as radius only some densities can be had; therefore a dart draws its squared radius from the two sums
//! of squares next to R, so that its mean is R, and R > 0 is solved by bisection for the density: the largest R (to
//! 1 / 512) that leaves enough pixels. The few too many (below 1 % of them but on tiny fields) are dropped at random, which
//! leaves exactly `round(D N)`. No two samples are closer than the smaller of the two radii.
//!
//! The order: tiles of at least 64 pixels in four passes (even and odd columns and rows of tiles), random within each.
//!
//! Properties: blue noise, isotropic, irregular. NOT progressive: the mask of a smaller density is no part of a larger
//! one, hence no rank. Depends on the field, not on absolute coordinates. Cost: about 60 ns a pixel for the field and
//! 20 passes over a field of at most 512 x 512; two bytes a pixel.
//!
//! Sources: R. Cook, "Stochastic Sampling in Computer Graphics", ACM Transactions on Graphics 5(1), 1986 (dart
//! throwing); R. Bridson, "Fast Poisson Disk Sampling in Arbitrary Dimensions", SIGGRAPH sketches 2007 (the grid that makes a
//! dart cost constant time); L.-Y. Wei, "Parallel Poisson Disk Sampling", SIGGRAPH 2008 (passes of tiles).

use super::random::Permutation;
use super::{Field, checked, hash};
use crate::{Error, Mask, Size};

/// Side of the field on which the radius is solved first.
const PROBE: usize = 512;
/// Bisections of R.
const STEPS: usize = 18;

/// The mask: exactly `round(density N)` of the N pixels (halves go up).
///
/// # Errors
/// [`Error::Setting`] if the density is outside 0 to 1.
pub fn mask(field: Field, density: f64, seed: u64) -> Result<Mask, Error> {
    let wanted = (checked(density)? * field.size.pixels() as f64).round() as usize;
    if wanted == 0 || wanted == field.size.pixels() {
        return Ok(field.mask(|_, _| wanted > 0));
    }
    let size = Size::new(field.size.height.min(PROBE), field.size.width.min(PROBE));
    let share = wanted as f64 / field.size.pixels() as f64;
    let mut squared = solve(size, (share * size.pixels() as f64).max(1.0), share, seed);
    let mut taken = throw(field.size, squared, seed);
    // The probe is a sample of the field: a little less radius where it promised too much.
    while count(&taken) < wanted {
        squared = (squared * 0.9975).max(1.0);
        taken = throw(field.size, squared, seed);
    }
    let excess = count(&taken) - wanted;
    drop_some(&mut taken, excess, seed);
    Mask::new(field.size, taken)
}

/// The largest R found for which at least `wanted` pixels are left; 1 leaves all.
fn solve(size: Size, wanted: f64, share: f64, seed: u64) -> f64 {
    // Random sequential packing covers 0.547 of the plane: density times squared radius is about 0.7.
    let (mut enough, mut too_few) = (1.0, 2.0 + 1.4 / share);
    for _ in 0..STEPS {
        let middle = 0.5 * (enough + too_few);
        if count(&throw(size, middle, seed)) as f64 >= wanted {
            enough = middle;
        } else {
            too_few = middle;
        }
        if too_few - enough < enough / 512.0 {
            break;
        }
    }
    enough
}

fn count(taken: &[bool]) -> usize {
    taken.iter().filter(|&&taken| taken).count()
}

/// What a dart at a pixel would find.
#[derive(Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
enum Around {
    Nobody,
    OneWithinTheLarger,
    OneWithinTheSmaller,
}

/// Throws every dart once, with squared radii of mean `squared`, which is at least 1.
fn throw(size: Size, squared: f64, seed: u64) -> Vec<bool> {
    let (small, large) = neighbours(squared);
    let share = (squared - small as f64) / (large - small) as f64;
    let larger = (share * 2_f64.powi(64)) as u64;
    let disk = disk(small, large);
    let mut taken = vec![false; size.pixels()];
    let mut around = vec![Around::Nobody; size.pixels()];
    for_each_dart(size, large, seed, |row, column| {
        let pixel = row * size.width + column;
        let limit =
            if hash(seed, pixel as u64) < larger { Around::Nobody } else { Around::OneWithinTheLarger };
        if taken[pixel] || around[pixel] > limit {
            return;
        }
        taken[pixel] = true;
        for &(dy, first, last, state) in &disk {
            let Some(row) = row.checked_add_signed(dy).filter(|&row| row < size.height) else { continue };
            let from = column.saturating_add_signed(first);
            let to = (column as isize + last + 1).clamp(0, size.width as isize) as usize;
            for found in &mut around[row * size.width..][from.min(to)..to] {
                *found = (*found).max(state);
            }
        }
    });
    taken
}

/// The runs of pixels within the larger radius, then within the smaller: row, first and last column from the centre.
fn disk(small: u64, large: u64) -> Vec<(isize, isize, isize, Around)> {
    let mut runs = Vec::new();
    for (squared, state) in [(large, Around::OneWithinTheLarger), (small, Around::OneWithinTheSmaller)] {
        let reach = (squared - 1).isqrt() as isize;
        for dy in -reach..=reach {
            let half = (squared - 1 - (dy * dy) as u64).isqrt() as isize;
            runs.push((dy, -half, half, state));
        }
    }
    runs
}

/// The sums of two squares next to `squared`: the largest at or below it and the smallest above.
fn neighbours(squared: f64) -> (u64, u64) {
    let is_sum = |n: u64| (0..=n.isqrt()).any(|a| (n - a * a).isqrt().pow(2) == n - a * a);
    let floor = squared.floor() as u64;
    let small = (1..=floor).rev().find(|&n| is_sum(n)).unwrap_or(1);
    let large = (floor + 1..2 * floor + 2).find(|&n| is_sum(n)).unwrap_or(2 * floor);
    (small, large)
}

/// Calls `dart` for every pixel, in the random order.
fn for_each_dart(size: Size, squared: u64, seed: u64, mut dart: impl FnMut(usize, usize)) {
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
                        dart(row, column);
                    }
                }
            }
        }
    }
}

/// Takes `excess` samples away again, those of the lowest hash.
fn drop_some(taken: &mut [bool], excess: usize, seed: u64) {
    if excess == 0 {
        return;
    }
    let total = count(taken);
    let mut share = 1.5 * (excess as f64 + 16.0) / total as f64;
    loop {
        let below = if share >= 1.0 { u64::MAX } else { (share * 2_f64.powi(64)) as u64 };
        let key = |pixel: usize| hash(!seed, pixel as u64);
        let samples = taken.iter().enumerate().filter(|(_, taken)| **taken).map(|(pixel, _)| pixel);
        let mut found: Vec<(u64, usize)> =
            samples.map(|pixel| (key(pixel), pixel)).filter(|(key, _)| *key <= below).collect();
        if found.len() >= excess {
            found.sort_unstable();
            for (_, pixel) in &found[..excess] {
                taken[*pixel] = false;
            }
            return;
        }
        share *= 2.0;
    }
}

#[cfg(test)]
#[path = "poisson/tests.rs"]
mod tests;
