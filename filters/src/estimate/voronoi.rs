//! Voronoi cells of the samples, the missing pixels that each is the nearest of: how evenly samples lie, and what each of them speaks for.

use super::held_out::PixelError;
use crate::Mask;
use crate::baseline::nearest::{Cells, NearestMap, UNEVEN};
use lacuna_core::hash;

/// Share of the exponent that holds between a sample and the missing pixels around it where samples were put where errors are, in rounds: at
/// exponents up to the first number, and at the largest.
const CHOSEN: (f64, [f64; 2]) = (1.15, [0.25, 0.8]);
/// By how much unevenness exceeds [`UNEVEN`] where the share has fallen from 1 to that, as after some rounds.
const CHOSEN_UNEVEN: f64 = 0.3;

/// The cell of each sample.
pub struct Voronoi {
    map: Option<NearestMap>,
    cells: Cells,
}

impl Voronoi {
    /// Those of a mask.
    pub fn new(mask: &Mask) -> Self {
        // A mask without samples has no held-out ones either.
        let map = NearestMap::new(mask).ok();
        let cells = Cells::new(mask, map.as_ref());
        Self { map, cells }
    }

    /// Whether samples lie unevenly.
    pub fn is_uneven(&self) -> bool {
        self.cells.is_uneven()
    }

    /// Share of the exponent: from all of it to what [`CHOSEN`] says.
    pub fn share(&self, exponent: f64, largest: f64) -> f64 {
        let (from, [least, most]) = CHOSEN;
        let smooth = ((exponent - from) / (largest - from)).max(0.0);
        let lost = 1.0 - least - (most - least) * smooth;
        1.0 - lost * ((self.cells.variation() - UNEVEN) / CHOSEN_UNEVEN).clamp(0.0, 1.0)
    }

    /// What a sample counts for: where they lie unevenly the root of its missing pixels. (By their number those at the rim of a dense place count
    /// too little.)
    pub fn weight(&self, sample: u32) -> f32 {
        if self.is_uneven() { (self.cells.count(sample as usize) - 1.0).max(0.0).sqrt() } else { 1.0 }
    }

    /// Whether errors are larger where samples lie close together, which of itself makes them smaller.
    pub fn are_where_errors_are(&self, at: &[u32], squared: &[f64]) -> bool {
        let pairs = at.iter().zip(squared).filter(|(_, squared)| squared.is_finite());
        let mut held: Vec<(f32, f64)> =
            pairs.map(|(&pixel, &squared)| (self.cells.count(pixel as usize), squared)).collect();
        held.sort_by(|a, b| a.0.total_cmp(&b.0));
        let (close, wide) = held.split_at(held.len() / 2);
        let sum = |half: &[(f32, f64)]| half.iter().map(|(_, squared)| squared).sum::<f64>();
        sum(close) > sum(wide)
    }

    /// About so many missing pixels whose nearest sample was held out, drawn by a seed: its place in `held`, and the pixel.
    pub fn owned(&self, mask: &Mask, held: &[PixelError], (count, seed): (usize, u64)) -> Vec<(u32, u32)> {
        let mut places = vec![u32::MAX; mask.size().pixels()];
        held.iter().zip(0..).for_each(|(error, place)| places[error.pixel as usize] = place);
        let cells: f32 = held.iter().map(|error| self.cells.count(error.pixel as usize) - 1.0).sum();
        let every = (cells as u64 / count as u64).max(1);
        let sources = self.map.iter().flat_map(NearestMap::as_slice).zip(0..);
        let owned = sources.map(|(&source, pixel)| (places[source as usize], pixel));
        let wanted = |&(place, pixel): &(u32, u32)| {
            place != u32::MAX
                && !mask.as_slice()[pixel as usize]
                && hash(seed ^ 0x51, u64::from(pixel)).is_multiple_of(every)
        };
        owned.filter(wanted).collect()
    }
}
