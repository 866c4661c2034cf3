//! Whether channels of a file hold something at the missing pixels ([`lacuna_filters::complete`]). What a lossy compression may have made of zero
//! counts as zero.

use half::f16;
use lacuna_exr::{Compression, Samples};
use lacuna_filters::Mask;
use lacuna_filters::complete::{Group, is_complete, is_left_out};

/// Whether the group, channels of one part that came in this compression, is complete over a mask, and no channel left out of it.
pub fn complete(group: &[&Samples], compression: Compression, mask: &Mask) -> bool {
    let zero = |samples: &&Samples| compression.zero_within(samples.kind());
    let all: Vec<(&Samples, f32)> = group.iter().map(|samples| (*samples, zero(samples))).collect();
    is_complete(&Stored(&all), mask) && group.iter().all(|one| !left_out(one, compression, mask))
}

/// Whether a channel was left out of a complete group.
pub fn left_out(one: &Samples, compression: Compression, mask: &Mask) -> bool {
    is_left_out(&Stored(&[(one, compression.zero_within(one.kind()))]), mask)
}

/// Channels, and what is zero to each.
struct Stored<'a>(&'a [(&'a Samples, f32)]);

impl Group for Stored<'_> {
    fn is_blank(&self, at: usize) -> bool {
        let look = |(zero, nan), &(samples, within): &(&Samples, f32)| match samples {
            Samples::Half(values) => {
                let low = values[at].to_bits() & 0x7fff <= f16::from_f32(within).to_bits();
                (zero && low, nan || values[at].is_nan())
            }
            Samples::Float(values) => (zero && values[at].abs() <= within, nan || values[at].is_nan()),
            Samples::Uint(values) => (zero && values[at] == 0, nan),
        };
        let (zero, nan) = self.0.iter().fold((true, false), look);
        zero || nan
    }

    fn are_same(&self, one: usize, other: usize) -> bool {
        self.0.iter().all(|(samples, _)| bits(samples, one) == bits(samples, other))
    }
}

/// Something that is equal where the values are.
fn bits(samples: &Samples, at: usize) -> u32 {
    match samples {
        Samples::Half(values) => u32::from(values[at].to_bits()),
        Samples::Float(values) => values[at].to_bits(),
        Samples::Uint(values) => values[at],
    }
}
