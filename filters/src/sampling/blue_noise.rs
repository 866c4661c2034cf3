//! Blue noise: void and cluster, a progressive order whose every prefix is evenly and irregularly spread.
//!
//! One tile of 128 x 128 pixels is ordered on a torus and repeated over the plane, anchored to absolute coordinates: pixel
//! (x, y) has the rank `(r(x mod 128, y mod 128) + s) / 128^2`, r the place in the tile's order and s in [0, 1) the
//! rank of the tile in a shuffle of the tiles, so that a density between two places of the order takes a share of tiles.
//!
//! Algorithm: a measured pixel adds `exp(-d^2 / (2 sigma^2))` to the energy of those at distance d. From a tenth of the
//! pixels at random, the measured pixel of highest energy (tightest cluster) moves to the missing one of lowest (largest
//! void) until nothing moves. Taking the tightest cluster away again and again gives the ranks below that; putting
//! one into the largest void the ranks above. Since the energy of the missing pixels is a constant less that of the
//! measured, the third phase of the paper (the clusters of the minority above one half) is the same as the second.
//! sigma is 0.475 spacings of the samples (1.5 pixels, the paper's value, at a tenth; 0.9 at least) and follows their number
//! in steps of a fourth root of two: with one value for all, samples would not feel each other at low densities.
//!
//! Properties: little energy at low frequencies; periodic with 128 pixels, so that its spectrum has a value at every 128th
//! of a cycle only. Cost: the tile, 2^14 moves of a sample, then a table look-up and a rank of the shuffle a pixel; 32 KiB.
//! Fails: below a density of 1 / 128^2 whole tiles are empty.
//!
//! Source: R. Ulichney, "The void-and-cluster method for dither array generation", Proc. SPIE 1913, 1993.

use std::sync::{Arc, Mutex, PoisonError};

use super::random::Permutation;
use super::shuffle;

/// The period in pixels.
pub const PERIOD: usize = 128;
const PIXELS: usize = PERIOD * PERIOD;
/// Measured pixels at the start: a tenth.
const START: usize = PIXELS / 10;
/// The width of the energy in spacings of the samples.
const SPREAD: f64 = 0.475;
/// And in pixels at least.
const LEAST: f64 = 0.9;

/// The order of one tile.
#[derive(Clone, PartialEq, Eq)]
pub struct Tile {
    ranks: Vec<u16>,
}

impl std::fmt::Debug for Tile {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        write!(f, "Tile({PERIOD}x{PERIOD})")
    }
}

/// The last tile that was asked for, and its seed.
static LAST: Mutex<Option<(u64, Arc<Tile>)>> = Mutex::new(None);

impl Tile {
    /// The tile of a seed. It costs more than most masks: frames of one seed share it.
    pub fn shared(seed: u64) -> Arc<Self> {
        let mut last = LAST.lock().unwrap_or_else(PoisonError::into_inner);
        match &*last {
            Some((of, tile)) if *of == seed => Arc::clone(tile),
            _ => Arc::clone(&last.insert((seed, Arc::new(Self::new(seed)))).1),
        }
    }

    /// The tile of a seed.
    pub fn new(seed: u64) -> Self {
        let order = Permutation::new(PIXELS as u64, seed);
        let mut field = Energy::new(width_for(START));
        for place in 0..START {
            field.put(order.apply(place as u64) as usize);
        }
        field.relax();
        let mut ranks = vec![0; PIXELS];
        let mut below = field.clone();
        for rank in (0..START).rev() {
            below.fit(rank + 1);
            let cluster = below.tightest_cluster();
            below.take(cluster);
            ranks[cluster] = rank as u16;
        }
        for rank in START..PIXELS {
            field.fit(rank);
            let void = field.largest_void();
            field.put(void);
            ranks[void] = rank as u16;
        }
        Self { ranks }
    }

    /// The rank in [0, 1) of the pixel at absolute column `x`, row `y`.
    pub fn rank(&self, x: i32, y: i32) -> f64 {
        let period = PERIOD as i32;
        let place = y.rem_euclid(period) as usize * PERIOD + x.rem_euclid(period) as usize;
        let tile = shuffle::rank(x.div_euclid(period), y.div_euclid(period), 0);
        // 14 bits of place above the tile's: the sum must stay below the next place.
        ((f64::from(self.ranks[place]) + tile) / PIXELS as f64).min(1.0_f64.next_down())
    }
}

/// The width of the energy for so many samples of the tile.
fn width_for(count: usize) -> f64 {
    (SPREAD * (PIXELS as f64 / count as f64).sqrt()).max(LEAST)
}

/// The energy of a set of pixels of the torus.
#[derive(Clone)]
struct Energy {
    values: Vec<f64>,
    measured: Vec<bool>,
    sigma: f64,
    /// The kernel within `reach` of its centre.
    kernel: Vec<f64>,
    reach: usize,
    /// Per row the pixel of the highest energy among the measured, of the lowest among the missing.
    highest: Vec<Option<usize>>,
    lowest: Vec<Option<usize>>,
}

impl Energy {
    fn new(sigma: f64) -> Self {
        // Beyond 5.5 sigma the kernel is below 3e-7; the torus itself ends at half a period.
        let reach = ((5.5 * sigma).ceil() as usize).min(PERIOD / 2 - 1);
        let side = 2 * reach + 1;
        let kernel = (0..side * side).map(|i| {
            let (dy, dx) = ((i / side) as f64 - reach as f64, (i % side) as f64 - reach as f64);
            (-(dy * dy + dx * dx) / (2.0 * sigma * sigma)).exp()
        });
        Self {
            values: vec![0.0; PIXELS],
            measured: vec![false; PIXELS],
            sigma,
            kernel: kernel.collect(),
            reach,
            highest: vec![None; PERIOD],
            lowest: (0..PERIOD).map(|row| Some(row * PERIOD)).collect(),
        }
    }

    fn put(&mut self, pixel: usize) {
        self.set(pixel, true, 1.0);
    }

    fn take(&mut self, pixel: usize) {
        self.set(pixel, false, -1.0);
    }

    fn set(&mut self, pixel: usize, measured: bool, sign: f64) {
        self.measured[pixel] = measured;
        let (row, column) = (pixel / PERIOD, pixel % PERIOD);
        let side = 2 * self.reach + 1;
        for (line, kernel) in self.kernel.chunks_exact(side).enumerate() {
            let row = (row + PERIOD + line - self.reach) % PERIOD;
            let values = &mut self.values[row * PERIOD..][..PERIOD];
            for (step, weight) in kernel.iter().enumerate() {
                values[(column + PERIOD + step - self.reach) % PERIOD] += sign * weight;
            }
        }
        for line in 0..side {
            self.rank_row((row + PERIOD + line - self.reach) % PERIOD);
        }
    }

    /// Finds the extremes of a row again; of equal energies the first counts.
    fn rank_row(&mut self, row: usize) {
        let (mut highest, mut lowest) = (None, None);
        let (mut most, mut least) = (f64::NEG_INFINITY, f64::INFINITY);
        for pixel in row * PERIOD..(row + 1) * PERIOD {
            let value = self.values[pixel];
            if self.measured[pixel] {
                if value > most {
                    (most, highest) = (value, Some(pixel));
                }
            } else if value < least {
                (least, lowest) = (value, Some(pixel));
            }
        }
        (self.highest[row], self.lowest[row]) = (highest, lowest);
    }

    fn tightest_cluster(&self) -> usize {
        let pixels = self.highest.iter().flatten().copied();
        pixels.reduce(|a, b| if self.values[b] > self.values[a] { b } else { a }).unwrap_or(0)
    }

    fn largest_void(&self) -> usize {
        let pixels = self.lowest.iter().flatten().copied();
        pixels.reduce(|a, b| if self.values[b] < self.values[a] { b } else { a }).unwrap_or(0)
    }

    /// Moves clusters into voids until nothing moves. Every move lowers the energy of the set; the bound is for ties.
    fn relax(&mut self) {
        for _ in 0..PIXELS {
            let cluster = self.tightest_cluster();
            self.take(cluster);
            let void = self.largest_void();
            self.put(void);
            if void == cluster {
                return;
            }
        }
    }

    /// Renews the kernel once it is a fourth root of two too wide or too narrow for `count` samples.
    fn fit(&mut self, count: usize) {
        let ratio = width_for(count) / self.sigma;
        if ratio.max(ratio.recip()) < 2_f64.powf(0.25) {
            return;
        }
        let mut fitting = Self::new(width_for(count));
        for pixel in 0..PIXELS {
            if self.measured[pixel] {
                fitting.put(pixel);
            }
        }
        *self = fitting;
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::Size;
    use crate::sampling::{Band, Field, Order, Pattern};

    #[test]
    fn a_tile_is_made_once_for_all_frames_of_a_seed() {
        // Tests beside this one may ask for other seeds at the same time.
        let is_shared = || Arc::ptr_eq(&Tile::shared(77), &Tile::shared(77));
        assert!((0..9).any(|_| is_shared()));
        assert!(*Tile::shared(77) == Tile::new(77));
    }

    #[test]
    fn every_rank_of_the_tile_occurs_once() {
        for seed in 0..2 {
            let mut ranks = Tile::new(seed).ranks;
            ranks.sort_unstable();
            assert!(ranks.into_iter().map(usize::from).eq(0..PIXELS));
        }
    }

    #[test]
    fn seeds_differ_and_repeat() {
        assert_eq!(Tile::new(4), Tile::new(4));
        assert_ne!(Tile::new(4), Tile::new(5));
    }

    #[test]
    fn is_periodic_where_the_density_is_a_whole_number_of_places() {
        let density = 3000.0 / PIXELS as f64;
        let field = |x, y| Field { x, y, size: Size::new(50, 70) };
        let mask =
            |x, y| Order::new(Pattern::BlueNoise, field(x, y), 1, 0).unwrap().mask(Band::below(density));
        assert_eq!(mask(0, 0), mask(128, -256));
        assert_ne!(mask(0, 0), mask(1, 0));
        let whole = Field { x: 5, y: -3, size: Size::new(PERIOD, PERIOD) };
        let whole = Order::new(Pattern::BlueNoise, whole, 1, 0).unwrap().mask(Band::below(density));
        assert_eq!(whole.count(), 3000);
    }

    #[test]
    fn a_density_between_two_places_takes_a_share_of_tiles() {
        let field = Field { x: 0, y: 0, size: Size::new(8 * PERIOD, 8 * PERIOD) };
        let order = Order::new(Pattern::BlueNoise, field, 1, 0).unwrap();
        let count = order.mask(Band::below(100.5 / PIXELS as f64)).count();
        assert!((6431..=6433).contains(&count), "{count}: 64 tiles with 100 or 101 each");
    }

    #[test]
    fn samples_keep_their_distance_at_every_density() {
        // In units of the spacing the densest packing has 1.07, a random set 0.5 on average and 0 at least.
        let tile = Tile::new(2);
        for count in [16, 160, 1638, 3277] {
            let points: Vec<_> = (0..PIXELS).filter(|&p| usize::from(tile.ranks[p]) < count).collect();
            let spacing = (PIXELS as f64 / count as f64).sqrt();
            let wrap = |a: usize, b: usize| {
                let d = a.abs_diff(b);
                d.min(PERIOD - d) as f64
            };
            let distance =
                |a: usize, b: usize| wrap(a % PERIOD, b % PERIOD).hypot(wrap(a / PERIOD, b / PERIOD));
            let nearest: Vec<f64> = points
                .iter()
                .map(|&a| {
                    let others = points.iter().filter(|&&b| b != a);
                    others.map(|&b| distance(a, b)).fold(f64::INFINITY, f64::min) / spacing
                })
                .collect();
            let mean = nearest.iter().sum::<f64>() / count as f64;
            let least = nearest.iter().copied().fold(f64::INFINITY, f64::min);
            assert!(least > 0.4 && mean > 0.75, "{count}: {least} {mean}");
        }
    }
}
