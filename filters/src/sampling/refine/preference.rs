//! Which pixels are taken rather than others that would do as well.

use std::borrow::Cow;

use lacuna_core::parallel::prelude::*;

use crate::sampling::{Field, shuffle};

/// By how many factors of two the score of the last pixel of a frame's order is less than that of an equal first one. Chosen of 0, 1, 2, 4, 6, 8, 12 on turntables
/// of engine, head and aneurism; from 4 to 8 all are within 0.4 dB.
const OCTAVES: f64 = 4.0;
/// Ranks that are told apart.
const RANKS: usize = 256;

/// The order of a frame's pixels, and whether it decides between equal scores alone.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Preference {
    /// Of the shuffle order.
    seed: u64,
    /// Whether early pixels are preferred to late ones of a larger score.
    early: bool,
}

impl Preference {
    /// The shuffle order of that seed, which decides between equal scores. With the number of a frame in a sequence, the order of the seed plus that number: its ranks move by the
    /// golden ratio from frame to frame, which spreads those of any frames in a row evenly. Early pixels are then preferred also to later ones of a larger score.
    pub const fn new(seed: u64, frame: Option<i64>) -> Self {
        match frame {
            Some(number) => Self { seed: seed.wrapping_add(number as u64), early: true },
            None => Self { seed, early: false },
        }
    }

    /// The seed of the order.
    pub const fn seed(self) -> u64 {
        self.seed
    }

    /// The place of a pixel in the order, in [0, 1).
    pub(super) fn rank(self, field: Field, pixel: usize) -> f64 {
        let (x, y) = field.at(pixel / field.size.width, pixel % field.size.width);
        shuffle::rank(x, y, self.seed)
    }

    /// The order of equal scores, the least first. A frame's own order does not continue the one of its first mask, so distance goes before it.
    pub(super) fn order(self, field: Field, pixel: usize, squared: u32) -> u64 {
        let nearness = if self.early { u32::MAX - squared } else { 0 };
        u64::from(nearness) << 32 | u64::from((self.rank(field, pixel) * f64::from(u32::MAX)) as u32)
    }

    /// What the squared errors of a field's pixels are proportional to, less at late pixels where early ones are preferred.
    pub(super) fn applied(self, coefficient: &[f32], field: Field) -> Cow<'_, [f32]> {
        if !self.early {
            return Cow::Borrowed(coefficient);
        }
        let factors: Vec<f32> =
            (0..RANKS).map(|rank| (-OCTAVES * (rank as f64 + 0.5) / RANKS as f64).exp2() as f32).collect();
        let mut applied = coefficient.to_vec();
        let width = field.size.width.max(1);
        applied.par_chunks_mut(width).enumerate().with_min_len(16).for_each(|(row, values)| {
            for (column, value) in values.iter_mut().enumerate() {
                let rank = self.rank(field, row * width + column);
                *value *= factors[(rank * RANKS as f64) as usize];
            }
        });
        Cow::Owned(applied)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::Size;

    #[test]
    fn frames_prefer_early_pixels_and_others_what_they_are_given() {
        let field = Field { x: -3, y: 9, size: Size::new(20, 30) };
        let squared = vec![2.0; 600];
        assert_eq!(*Preference::new(7, None).applied(&squared, field), squared[..]);
        assert_eq!(Preference::new(7, Some(2)).seed(), Preference::new(9, None).seed());
        let preference = Preference::new(7, Some(-2));
        for (pixel, value) in preference.applied(&squared, field).iter().enumerate() {
            let exact = 2.0 * (-OCTAVES * preference.rank(field, pixel)).exp2();
            // Half a step of the ranks.
            let step = (OCTAVES / RANKS as f64 * std::f64::consts::LN_2).exp_m1();
            assert!((f64::from(*value) / exact - 1.0).abs() <= step, "{pixel}");
        }
    }
}
