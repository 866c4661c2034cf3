//! Patterns, and the order in which a progressive one takes the pixels.

use std::sync::Arc;

use lacuna_core::parallel::prelude::*;

use super::{Band, blue_noise, random, shuffle};
use crate::{Mask, Size};
use lacuna_core::hash;

/// The patterns that a user picks from.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum Pattern {
    /// Uniform, without replacement: [`random`].
    Random,
    /// Linear pixel shuffling: [`shuffle`].
    Shuffle,
    /// Poisson disk: [`super::poisson`].
    Poisson,
    /// Void and cluster: [`blue_noise`].
    BlueNoise,
    /// Every n-th pixel of every n-th row: [`super::grid`].
    Grid,
}

impl Pattern {
    /// Whether one seed is one order, of which every density is a prefix.
    pub const fn is_progressive(self) -> bool {
        matches!(self, Self::Random | Self::Shuffle | Self::BlueNoise)
    }

    /// The name that `--pattern` takes.
    pub const fn name(self) -> &'static str {
        match self {
            Self::Random => "random",
            Self::Shuffle => "shuffle",
            Self::Poisson => "poisson",
            Self::BlueNoise => "blue-noise",
            Self::Grid => "grid",
        }
    }
}

/// The pixels that a mask covers: a window in absolute coordinates.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Field {
    /// First column.
    pub x: i32,
    /// First row.
    pub y: i32,
    /// Height and width.
    pub size: Size,
}

impl Field {
    /// The absolute column and row of a pixel; past the end of i32 they wrap.
    pub const fn at(&self, row: usize, column: usize) -> (i32, i32) {
        (self.x.wrapping_add(column as i32), self.y.wrapping_add(row as i32))
    }

    /// The pixels for which `taken` holds, rows in parallel.
    pub(super) fn mask(&self, taken: impl Fn(usize, usize) -> bool + Sync) -> Mask {
        self.mask_of_rows(|row, flags| {
            flags.iter_mut().enumerate().for_each(|(column, flag)| *flag = taken(row, column));
        })
    }

    /// The pixels whose flags `fill` sets, a row at a time, rows in parallel.
    pub(super) fn mask_of_rows(&self, fill: impl Fn(usize, &mut [bool]) + Sync) -> Mask {
        let mut flags = vec![false; self.size.pixels()];
        if self.size.width > 0 {
            flags.par_chunks_mut(self.size.width).enumerate().for_each(|(row, flags)| fill(row, flags));
        }
        let size = self.size;
        Mask::new(size, flags).unwrap_or_else(|_| Mask::from_fn(Size::new(0, 0), |_, _| false))
    }
}

/// A progressive order of the pixels of a field.
#[derive(Clone, Debug)]
pub struct Order {
    field: Field,
    kind: Kind,
}

#[derive(Clone, Debug)]
enum Kind {
    Random(random::Permutation),
    Shuffle(u64),
    BlueNoise { tile: Arc<blue_noise::Tile>, x: i32, y: i32 },
}

impl Order {
    /// The order of a pattern; nothing if the pattern has none. `frame` 0 is the order of the seed itself, each other
    /// number one that is decorrelated from it.
    pub fn new(pattern: Pattern, field: Field, seed: u64, frame: i64) -> Option<Self> {
        let own = if frame == 0 { seed } else { hash(seed, frame as u64) };
        let kind = match pattern {
            Pattern::Random => Kind::Random(random::Permutation::new(field.size.pixels() as u64, own)),
            Pattern::Shuffle => Kind::Shuffle(own),
            Pattern::BlueNoise => {
                // Frames share the tile, each from another place.
                let (x, y) = if frame == 0 { (0, 0) } else { (own as i32, (own >> 32) as i32) };
                Kind::BlueNoise { tile: blue_noise::Tile::shared(seed), x, y }
            }
            Pattern::Poisson | Pattern::Grid => return None,
        };
        Some(Self { field, kind })
    }

    /// The rank in [0, 1) of a pixel of the field: it is measured at every density above this.
    pub fn rank(&self, row: usize, column: usize) -> f64 {
        let (x, y) = self.field.at(row, column);
        match &self.kind {
            Kind::Random(permutation) => {
                permutation.rank(row as u64 * self.field.size.width as u64 + column as u64)
            }
            Kind::Shuffle(seed) => shuffle::rank(x, y, *seed),
            Kind::BlueNoise { tile, x: dx, y: dy } => tile.rank(x.wrapping_add(*dx), y.wrapping_add(*dy)),
        }
    }

    /// The pixels whose rank lies in the band.
    pub fn mask(&self, band: Band) -> Mask {
        match &self.kind {
            Kind::Shuffle(seed) => self.field.mask_of_rows(|row, flags| {
                let (x, y) = self.field.at(row, 0);
                shuffle::fill(x, y, *seed, band, flags);
            }),
            _ => self.field.mask(|row, column| band.contains(self.rank(row, column))),
        }
    }
}

#[cfg(test)]
#[path = "order/tests.rs"]
mod tests;
