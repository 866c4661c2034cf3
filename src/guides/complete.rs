//! Whether channels hold something at the missing pixels: nobody writes it down, so it is told from the values.
//!
//! A renderer that skips a pixel leaves the same there for all: zero, NaN, or what its buffer was cleared to. A group of
//! channels is complete if the missing pixels hold at least two different finite values among them, and are not more often
//! blank (all channels zero, or any of them NaN) than the measured ones, give or take a little; so a background of
//! zeros does no harm, if it is behind both. What a lossy compression may have made of zero counts as zero.

use half::f16;
use lacuna_core::parallel::prelude::*;
use lacuna_exr::{Compression, Samples};
use lacuna_filters::Mask;

/// What the share of blank pixels may be higher.
const MARGIN: f64 = 0.02;
/// Pixels that one task takes.
const PIECE: usize = 1 << 14;

/// Whether the group, channels of one part that came in this compression, is complete over a mask.
pub fn complete(group: &[&Samples], compression: Compression, mask: &Mask) -> bool {
    if mask.is_full() {
        return true;
    }
    let zero = |samples: &&Samples| compression.zero_within(samples.kind());
    let group: Vec<(&Samples, f32)> = group.iter().map(|samples| (*samples, zero(samples))).collect();
    let pieces = mask.as_slice().par_chunks(PIECE).enumerate();
    let pieces = pieces.map(|(piece, flags)| Seen::new(&group, flags, piece * PIECE));
    let Seen { blank, all, first, differs } = pieces.into_iter().fold(Seen::default(), Seen::and);
    let share = |side: usize| blank[side] as f64 / all[side].max(1) as f64;
    // One value everywhere, measured pixels included, is complete, if idle.
    let value = |at: usize| group.iter().map(|(samples, _)| bits(samples, at)).collect::<Vec<u32>>();
    let same = |first: &Vec<u32>| (0..mask.as_slice().len()).all(|at| value(at) == *first);
    let idle = !differs && blank[0] == 0 && first.as_ref().is_some_and(same);
    let varies = differs || idle || (first.is_some() && blank[0] > 0);
    varies && share(0) <= share(1) + MARGIN
}

/// What some pixels hold.
#[derive(Default)]
struct Seen {
    /// Blank pixels and all pixels, of the missing and of the measured ones.
    blank: [usize; 2],
    all: [usize; 2],
    /// The values of the first missing pixel that is not blank, and whether another one has others.
    first: Option<Vec<u32>>,
    differs: bool,
}

impl Seen {
    fn new(group: &[(&Samples, f32)], flags: &[bool], start: usize) -> Self {
        let mut seen = Self::default();
        for (at, &measured) in (start..).zip(flags) {
            let side = usize::from(measured);
            seen.all[side] += 1;
            let (zero, nan) = look(group, at);
            if zero || nan {
                seen.blank[side] += 1;
            } else if !measured && !seen.differs {
                let bits: Vec<u32> = group.iter().map(|(samples, _)| bits(samples, at)).collect();
                seen.differs = *seen.first.get_or_insert_with(|| bits.clone()) != bits;
            }
        }
        seen
    }

    /// With what the next pixels hold.
    fn and(self, next: Self) -> Self {
        let sum = |a: [usize; 2], b: [usize; 2]| [a[0] + b[0], a[1] + b[1]];
        let apart = matches!((&self.first, &next.first), (Some(a), Some(b)) if a != b);
        Self {
            blank: sum(self.blank, next.blank),
            all: sum(self.all, next.all),
            first: self.first.or(next.first),
            differs: self.differs || next.differs || apart,
        }
    }
}

/// Whether all channels are within what is zero to each there, and whether one is NaN.
fn look(group: &[(&Samples, f32)], at: usize) -> (bool, bool) {
    group.iter().fold((true, false), |(zero, nan), &(samples, within)| match samples {
        Samples::Half(values) => {
            let low = values[at].to_bits() & 0x7fff <= f16::from_f32(within).to_bits();
            (zero && low, nan || values[at].is_nan())
        }
        Samples::Float(values) => (zero && values[at].abs() <= within, nan || values[at].is_nan()),
        Samples::Uint(values) => (zero && values[at] == 0, nan),
    })
}

/// Something that is equal where the values are.
fn bits(samples: &Samples, at: usize) -> u32 {
    match samples {
        Samples::Half(values) => u32::from(values[at].to_bits()),
        Samples::Float(values) => values[at].to_bits(),
        Samples::Uint(values) => values[at],
    }
}
