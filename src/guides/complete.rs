//! Whether channels hold something at the missing pixels: nobody writes it down, so it is told from the values.
//!
//! A renderer that skips a pixel leaves the same there for all: zero, NaN, or what its buffer was cleared to. A group of
//! channels is complete if the missing pixels hold at least two different finite values among them, and are not more often
//! blank (all channels zero, or any of them NaN) than the measured ones, give or take a little; so a background of
//! zeros does no harm, if it is behind both.

use lacuna_filters::Mask;

use crate::frame::Samples;

/// What the share of blank pixels may be higher.
const MARGIN: f64 = 0.02;

/// Whether the group, channels of one part, is complete over a mask.
pub fn complete(group: &[&Samples], mask: &Mask) -> bool {
    if mask.is_full() {
        return true;
    }
    let (mut blank, mut all) = ([0_usize; 2], [0_usize; 2]);
    let mut first: Option<Vec<u32>> = None;
    let mut differs = false;
    for (at, &measured) in mask.as_slice().iter().enumerate() {
        let side = usize::from(measured);
        all[side] += 1;
        let (zero, nan) = look(group, at);
        if zero || nan {
            blank[side] += 1;
        } else if !measured && !differs {
            let bits: Vec<u32> = group.iter().map(|samples| bits(samples, at)).collect();
            differs = *first.get_or_insert_with(|| bits.clone()) != bits;
        }
    }
    let share = |side: usize| blank[side] as f64 / all[side].max(1) as f64;
    // One value everywhere, measured pixels included, is complete, if idle.
    let value = |at: usize| group.iter().map(|samples| bits(samples, at)).collect::<Vec<u32>>();
    let same = |first: &Vec<u32>| (0..mask.as_slice().len()).all(|at| value(at) == *first);
    let idle = !differs && blank[0] == 0 && first.as_ref().is_some_and(same);
    let varies = differs || idle || (first.is_some() && blank[0] > 0);
    varies && share(0) <= share(1) + MARGIN
}

/// Whether all channels are zero there, and whether one is NaN.
fn look(group: &[&Samples], at: usize) -> (bool, bool) {
    group.iter().fold((true, false), |(zero, nan), samples| match samples {
        Samples::Half(values) => (zero && values[at].to_f32() == 0.0, nan || values[at].is_nan()),
        Samples::Float(values) => (zero && values[at] == 0.0, nan || values[at].is_nan()),
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
