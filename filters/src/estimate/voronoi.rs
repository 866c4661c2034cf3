//! Voronoi cells of the samples, the missing pixels that each is the nearest of: how evenly samples lie, and what each of them speaks for.

use lacuna_core::parallel::prelude::*;

use super::held_out::PixelError;
use crate::Mask;
use crate::baseline::nearest::NearestMap;
use lacuna_core::hash;

/// Standard deviation over the mean of how many pixels each sample is the nearest of, beyond which samples lie unevenly: at 20 % it is 0.19 for the
/// shuffle and 0.23 for blue noise, 0.29 to 0.48 after a second pass of a quarter of them, 0.5 at random, 0.7 to 1.3 for samples chosen in rounds.
const UNEVEN: f64 = 0.26;
/// Share of the exponent that holds between a sample and the missing pixels around it where samples were put where errors are, in rounds: at
/// exponents up to the first number, and at the largest.
const CHOSEN: (f64, [f64; 2]) = (1.15, [0.25, 0.8]);
/// By how much unevenness exceeds [`UNEVEN`] where the share has fallen from 1 to that, as after some rounds.
const CHOSEN_UNEVEN: f64 = 0.3;

/// The cell of each sample.
pub struct Voronoi {
    map: Option<NearestMap>,
    /// How many they are, and 1 for itself; 0 at missing pixels.
    counts: Vec<f32>,
    /// Standard deviation of the counts over their mean.
    variation: f64,
}

impl Voronoi {
    /// Those of a mask.
    pub fn new(mask: &Mask) -> Self {
        let mut counts = vec![0.0_f32; mask.size().pixels()];
        // A mask without samples has no held-out ones either.
        let map = NearestMap::new(mask).ok();
        let sources = map.iter().flat_map(NearestMap::as_slice);
        sources.for_each(|&source| counts[source as usize] += 1.0);
        let square = |piece: &[f32]| piece.iter().map(|&count| f64::from(count).powi(2)).sum::<f64>();
        let squares: f64 = counts.par_chunks(1 << 14).map(square).iter().sum();
        let mean = mask.density().recip();
        let variation = (squares / mask.count().max(1) as f64 / (mean * mean) - 1.0).max(0.0).sqrt();
        Self { map, counts, variation }
    }

    /// Whether samples lie unevenly: those that stand close together must not speak for the rest of the image.
    pub fn is_uneven(&self) -> bool {
        self.variation > UNEVEN
    }

    /// Share of the exponent: from all of it to what [`CHOSEN`] says.
    pub fn share(&self, exponent: f64, largest: f64) -> f64 {
        let (from, [least, most]) = CHOSEN;
        let smooth = ((exponent - from) / (largest - from)).max(0.0);
        let lost = 1.0 - least - (most - least) * smooth;
        1.0 - lost * ((self.variation - UNEVEN) / CHOSEN_UNEVEN).clamp(0.0, 1.0)
    }

    /// What a sample counts for: where they lie unevenly the root of its missing pixels. (By their number those at the rim of a dense place count
    /// too little.)
    pub fn weight(&self, sample: u32) -> f32 {
        if self.is_uneven() { (self.counts[sample as usize] - 1.0).max(0.0).sqrt() } else { 1.0 }
    }

    /// Whether errors are larger where samples lie close together, which of itself makes them smaller.
    pub fn are_where_errors_are(&self, at: &[u32], squared: &[f64]) -> bool {
        let pairs = at.iter().zip(squared).filter(|(_, squared)| squared.is_finite());
        let mut held: Vec<(f32, f64)> =
            pairs.map(|(&pixel, &squared)| (self.counts[pixel as usize], squared)).collect();
        held.sort_by(|a, b| a.0.total_cmp(&b.0));
        let (close, wide) = held.split_at(held.len() / 2);
        let sum = |half: &[(f32, f64)]| half.iter().map(|(_, squared)| squared).sum::<f64>();
        sum(close) > sum(wide)
    }

    /// About so many missing pixels whose nearest sample was held out, drawn by a seed: its place in `held`, and the pixel.
    pub fn owned(&self, mask: &Mask, held: &[PixelError], (count, seed): (usize, u64)) -> Vec<(u32, u32)> {
        let mut places = vec![u32::MAX; mask.size().pixels()];
        held.iter().zip(0..).for_each(|(error, place)| places[error.pixel as usize] = place);
        let cells: f32 = held.iter().map(|error| self.counts[error.pixel as usize] - 1.0).sum();
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
