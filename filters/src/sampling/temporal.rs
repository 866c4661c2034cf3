//! Masks for the frames of a sequence: the same one, decorrelated ones, or ones that complete each other.
//!
//! `complementary`: frame k takes the ranks of `[k D, (k + 1) D)` modulo 1 of one progressive order. Then any n
//! frames in a row hold n different parts of it, n of them together are the mask of density n D, which is as even as the
//! order makes it, and the first `ceil(1 / D)` cover every pixel. A grid does the same with its offsets.
//! `offset`: frame k has the order of another seed (blue noise: another place of the tile), frame 0 that of the seed.

use super::{Field, Order, Pattern, checked, grid, poisson};
use crate::{Error, Mask};
use lacuna_core::hash;

/// How the masks of frames are related.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Temporal {
    /// Every frame has the same mask.
    #[default]
    Fixed,
    /// Every frame has a mask that is independent of the others.
    Offset,
    /// Frames in a row cover every pixel as early and as evenly as possible.
    Complementary,
}

/// Frames from which on `k D` in f64 would lose the digits of its fraction that ranks need.
const LATE: u64 = 1 << 32;

/// A half-open interval of ranks, modulo 1.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Band {
    low: f64,
    high: f64,
}

impl Band {
    /// The ranks below `density`.
    pub const fn below(density: f64) -> Self {
        Self { low: 0.0, high: density }
    }

    /// The `k`-th of the intervals of length `density` that follow each other from 0 on, modulo 1.
    ///
    /// Neighbours share their end to the bit, so nothing is left between them.
    pub fn of_frame(density: f64, k: i64) -> Self {
        if k.unsigned_abs() >= LATE
            && let Some(band) = Self::late(density, k)
        {
            return band;
        }
        let (from, to) = (k as f64 * density, k.saturating_add(1) as f64 * density);
        Self { low: from - from.floor(), high: to - from.floor() }
    }

    /// The same in whole numbers; nothing for densities so small that no rank lies in them.
    fn late(density: f64, k: i64) -> Option<Self> {
        const DIGITS: u32 = f64::MANTISSA_DIGITS - 1;
        let (exponent, digits) = (density.to_bits() >> DIGITS, density.to_bits() & ((1 << DIGITS) - 1));
        // The density is `length` parts of a turn of so many; times a frame it is below 2^116.
        let length = i128::from(digits | (1 << DIGITS));
        let turn = 1_i128 << 1075_u64.checked_sub(exponent).filter(|parts| *parts < 120)?;
        let from = (i128::from(k) * length).rem_euclid(turn);
        let to = from + length;
        let part = |parts: i128| parts as f64 / turn as f64;
        let high = if to < turn { part(to) } else { 1.0 + part(to - turn) };
        Some(Self { low: part(from), high })
    }

    /// Where it starts.
    pub const fn start(self) -> f64 {
        self.low
    }

    /// The first of the ranks `0, 1, ... one - 1` over `one` that lies in it, and how many from there on, modulo `one`, do.
    ///
    /// `one` is a power of two up to 2^53, so that nothing is rounded but up to the next whole rank.
    pub(super) fn units(self, one: u64) -> (u64, u64) {
        let above = |end: f64| (end * one as f64).ceil() as u64;
        let start = above(self.low);
        let length =
            if self.high <= 1.0 { above(self.high) - start } else { one - start + above(self.high - 1.0) };
        (start, length)
    }

    /// Whether a rank of [0, 1) lies in it.
    pub fn contains(self, rank: f64) -> bool {
        if self.high <= 1.0 {
            self.low <= rank && rank < self.high
        } else {
            self.low <= rank || rank < self.high - 1.0
        }
    }
}

/// The mask of one frame.
///
/// # Errors
/// [`Error::Setting`] if the density is outside 0 to 1, or if Poisson disks, which have no order, are asked to be
/// complementary.
pub fn mask(
    pattern: Pattern,
    field: Field,
    density: f64,
    seed: u64,
    temporal: Temporal,
    frame: i64,
) -> Result<Mask, Error> {
    let density = checked(density)?;
    let offset = if temporal == Temporal::Offset { frame } else { 0 };
    let step = if temporal == Temporal::Complementary { frame } else { 0 };
    if let Some(order) = Order::new(pattern, field, seed, offset) {
        return Ok(order.mask(Band::of_frame(density, step)));
    }
    let own = if offset == 0 { seed } else { hash(seed, offset as u64) };
    match pattern {
        Pattern::Grid => grid::mask(field, density, own, step),
        _ if temporal == Temporal::Complementary => Err(Error::Setting {
            name: "temporal",
            value: "complementary".into(),
            range: "fixed or offset with the pattern poisson, which is not progressive".into(),
        }),
        _ => poisson::mask(field, density, own),
    }
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;
    use crate::Size;

    const FIELD: Field = Field { x: -7, y: 11, size: Size::new(45, 61) };

    fn frames(pattern: Pattern, density: f64, temporal: Temporal, count: i64) -> Vec<Mask> {
        (0..count).map(|k| mask(pattern, FIELD, density, 5, temporal, k).unwrap()).collect()
    }

    proptest! {
        #[test]
        fn bands_follow_each_other_without_gap_or_overlap(
            density in 1e-4..1.0_f64, start in -1000_i64..1000, rank in 0.0..1.0_f64,
        ) {
            // As many frames as fit into one turn: no rank is hit twice, and one more frame leaves no rank out.
            let fitting = (1.0 / density).floor() as i64;
            let hits = |count: i64| {
                (start..start + count).filter(|&k| Band::of_frame(density, k).contains(rank)).count()
            };
            prop_assert!(hits(fitting) <= 1);
            prop_assert!(hits(fitting + 1) >= 1);
        }
    }

    proptest! {
        #[test]
        fn whole_ranks_are_those_of_the_band(density in 0.0..=1.0_f64, k in -9_i64..9, one in 0..12_u32) {
            let (band, one) = (Band::of_frame(density, k), 1_u64 << one);
            let (start, length) = band.units(one);
            for rank in 0..one {
                let steps = (rank + one - start % one) % one;
                prop_assert_eq!(band.contains(rank as f64 / one as f64), steps < length);
            }
        }
    }

    #[test]
    fn complementary_frames_cover_every_pixel_once_per_turn() {
        for pattern in [Pattern::Random, Pattern::Shuffle, Pattern::BlueNoise, Pattern::Grid] {
            let masks = frames(pattern, 0.25, Temporal::Complementary, 4);
            for pixel in 0..FIELD.size.pixels() {
                let times = masks.iter().filter(|mask| mask.as_slice()[pixel]).count();
                assert_eq!(times, 1, "{pattern:?} {pixel}");
            }
        }
    }

    /// Beyond 2^53 a frame and the next one are the same number of f64.
    #[test]
    fn frames_of_any_number_cover_every_pixel_once_per_turn() {
        for start in [1 << 40, 1 << 53, i64::MAX - 4, i64::MIN, -(1 << 53) - 2, (1 << 32) - 2] {
            let masks: Vec<Mask> = (start..start + 4)
                .map(|k| mask(Pattern::Shuffle, FIELD, 0.25, 5, Temporal::Complementary, k).unwrap())
                .collect();
            for pixel in 0..FIELD.size.pixels() {
                let times = masks.iter().filter(|mask| mask.as_slice()[pixel]).count();
                assert_eq!(times, 1, "{start} {pixel}");
            }
            let third = mask(Pattern::Random, FIELD, 0.3, 5, Temporal::Complementary, start).unwrap();
            assert!((third.density() - 0.3).abs() < 0.03, "{start}: {}", third.density());
        }
        for density in [0.0, f64::MIN_POSITIVE, 1e-30, 1.0] {
            for frame in [i64::MAX, i64::MIN] {
                for pattern in [Pattern::Random, Pattern::Grid] {
                    let mask = mask(pattern, FIELD, density, 5, Temporal::Complementary, frame).unwrap();
                    assert!(
                        if density < 1.0 { mask.count() <= 1 } else { mask.is_full() },
                        "{density} {frame}"
                    );
                }
            }
        }
    }

    #[test]
    fn late_bands_are_those_of_early_ones() {
        for (density, k) in [(0.3, 7), (0.25, -9), (1.0, 3), (1e-3, 12_345)] {
            let (late, early) = (Band::late(density, k).unwrap(), Band::of_frame(density, k));
            let off = (late.low - early.low).abs().max((late.high - early.high).abs());
            assert!(off < 1e-12, "{density} {k} {off}");
        }
    }

    #[test]
    fn a_turn_that_does_not_divide_still_covers() {
        let masks = frames(Pattern::Shuffle, 0.3, Temporal::Complementary, 4);
        assert!((0..FIELD.size.pixels()).all(|pixel| masks.iter().any(|mask| mask.as_slice()[pixel])));
    }

    #[test]
    fn fixed_frames_are_equal_and_offset_ones_are_independent() {
        for pattern in
            [Pattern::Random, Pattern::Shuffle, Pattern::BlueNoise, Pattern::Poisson, Pattern::Grid]
        {
            let fixed = frames(pattern, 0.2, Temporal::Fixed, 2);
            assert_eq!(fixed[0], fixed[1]);
            let offset = frames(pattern, 0.2, Temporal::Offset, 2);
            assert_eq!(fixed[0], offset[0], "{pattern:?}: frame 0 is the seed's own mask");
            assert_ne!(offset[0], offset[1], "{pattern:?}");
        }
        // White noise: the overlap of two independent masks is near D^2 (a fifth of the standard deviation is 0.007).
        let offset = frames(Pattern::Random, 0.2, Temporal::Offset, 2);
        let both = offset[0].as_slice().iter().zip(offset[1].as_slice()).filter(|(a, b)| **a && **b).count();
        let share = both as f64 / FIELD.size.pixels() as f64;
        assert!((share - 0.04).abs() < 0.02, "{share}");
    }

    #[test]
    fn nonsense_is_refused() {
        for density in [-0.1, 1.5, f64::NAN, f64::INFINITY] {
            let error = mask(Pattern::Shuffle, FIELD, density, 0, Temporal::Fixed, 0).unwrap_err();
            assert!(error.to_string().contains("0 to 1"), "{error}");
        }
        assert!(mask(Pattern::Poisson, FIELD, 0.2, 0, Temporal::Complementary, 1).is_err());
    }
}
