//! Between the file's sample types and the filters' planes: exact where nothing is filled.

use half::f16;
use half::slice::HalfFloatSliceExt;
use lacuna_core::parallel::prelude::*;
use lacuna_exr::Samples;
use lacuna_filters::Mask;

use super::PIECE;
use super::job::Kind;
use crate::channels::Rule;

/// The nearest half (ties to even); finite values past the largest half become the largest, and are counted.
pub fn to_half(value: f32, clamped: &mut usize) -> f16 {
    let half = f16::from_f32(value);
    if half.is_infinite() && value.is_finite() {
        *clamped += 1;
        if value > 0.0 { f16::MAX } else { f16::MIN }
    } else {
        half
    }
}

/// The same for many values at once, and how many became the largest half.
pub fn to_halves(values: &[f32]) -> (Vec<f16>, usize) {
    let mut halves = vec![f16::ZERO; values.len()];
    let parts = halves.par_chunks_mut(1 << 14).zip(values.par_chunks(1 << 14));
    let counts = parts.map(|(halves, values)| {
        halves.convert_from_f32_slice(values);
        let mut clamped = 0;
        for (half, &value) in halves.iter_mut().zip(values).filter(|(half, _)| half.is_infinite()) {
            *half = to_half(value, &mut clamped);
        }
        clamped
    });
    let clamped = counts.into_iter().sum();
    (halves, clamped)
}

/// What a smaller type did to values.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Loss {
    /// Values past the largest half, which became it.
    pub clamped: usize,
    /// Other values that were rounded.
    pub rounded: usize,
}

/// The type that a channel gets if `asked` is asked for: what is only copied keeps its own, and a depth, whose values
/// are copied too, does not become a half.
pub fn kind_for(rule: Rule, asked: Option<Kind>) -> Option<Kind> {
    match (rule, asked) {
        (Rule::Nearest | Rule::Keep, _) | (Rule::Depth, Some(Kind::Half)) => None,
        (Rule::Fill | Rule::Normal | Rule::Depth, kind) => kind,
    }
}

/// A channel's samples in another float type; whole numbers stay. Returns what was lost as well, among the measured
/// pixels if a mask is given.
pub fn convert(samples: Samples, kind: Option<Kind>, mask: Option<&Mask>) -> (Samples, Loss) {
    match (samples, kind) {
        (Samples::Float(values), Some(Kind::Half)) => {
            let (mut loss, mut unused) = (Loss::default(), 0);
            let counts = |at: usize| mask.is_none_or(|mask| mask.as_slice()[at]);
            let half = |(at, value): (usize, f32)| {
                if !counts(at) {
                    return to_half(value, &mut unused);
                }
                let before = loss.clamped;
                let half = to_half(value, &mut loss.clamped);
                // A NaN differs from itself and stays one.
                let differs = half.to_f32().to_bits() != value.to_bits() && !value.is_nan();
                loss.rounded += usize::from(differs && loss.clamped == before);
                half
            };
            let halves = values.into_iter().enumerate().map(half).collect();
            (Samples::Half(halves), loss)
        }
        (samples @ Samples::Half(_), Some(Kind::Float)) => {
            (samples.to_floats().map_or(samples, Samples::Float), Loss::default())
        }
        (samples, _) => (samples, Loss::default()),
    }
}

/// Writes `values` where the mask is missing, or everywhere if `all`; returns how many halves were clamped.
pub fn write(samples: &mut Samples, values: &[f32], mask: &Mask, all: bool) -> usize {
    let pieces = mask.as_slice().par_chunks(PIECE).zip(values.par_chunks(PIECE));
    match samples {
        Samples::Half(out) => {
            let pieces = out.par_chunks_mut(PIECE).zip(pieces);
            pieces.map(|(out, (flags, values))| write_halves(out, values, flags, all)).into_iter().sum()
        }
        Samples::Float(out) => {
            out.par_chunks_mut(PIECE).zip(pieces).for_each(|(out, (flags, values))| {
                for ((out, &value), &flag) in out.iter_mut().zip(values).zip(flags) {
                    // By bits: a choice would become a branch.
                    let new = (u32::from(all) | u32::from(!flag)).wrapping_neg();
                    *out = f32::from_bits(value.to_bits() & new | out.to_bits() & !new);
                }
            });
            0
        }
        Samples::Uint(_) => 0,
    }
}

/// The same for a piece of halves.
fn write_halves(out: &mut [f16], values: &[f32], flags: &[bool], all: bool) -> usize {
    let mut clamped = 0;
    let mut halves = [f16::ZERO; 256];
    for ((out, values), flags) in out.chunks_mut(256).zip(values.chunks(256)).zip(flags.chunks(256)) {
        let halves = &mut halves[..values.len()];
        halves.convert_from_f32_slice(values);
        for (((out, &half), &value), &flag) in out.iter_mut().zip(&*halves).zip(values).zip(flags) {
            if all || !flag {
                *out = if half.is_infinite() { to_half(value, &mut clamped) } else { half };
            }
        }
    }
    clamped
}

/// Gives every missing pixel the bits of the pixel that `source` names for it.
pub fn copy_from(samples: &mut Samples, mask: &Mask, source: &[u32]) {
    fn copy<T: Copy>(values: &mut [T], mask: &Mask, source: &[u32]) {
        for (at, (&measured, &source)) in mask.as_slice().iter().zip(source).enumerate() {
            if !measured {
                values[at] = values[source as usize];
            }
        }
    }
    match samples {
        Samples::Half(values) => copy(values, mask, source),
        Samples::Float(values) => copy(values, mask, source),
        Samples::Uint(values) => copy(values, mask, source),
    }
}

/// One value of any type.
pub fn value(samples: &Samples, at: usize) -> f32 {
    match samples {
        Samples::Half(values) => values[at].to_f32(),
        Samples::Float(values) => values[at],
        Samples::Uint(values) => values[at] as f32,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn halves_round_to_even_and_do_not_overflow() {
        let mut clamped = 0;
        assert_eq!(to_half(1.0 + 1.0 / 2048.0, &mut clamped), f16::from_f32(1.0));
        assert_eq!(to_half(1.0 + 3.0 / 2048.0, &mut clamped), f16::from_f32(1.0 + 2.0 / 1024.0));
        assert_eq!(to_half(65519.0, &mut clamped), f16::MAX);
        assert_eq!(clamped, 0);
        assert_eq!(to_half(65520.0, &mut clamped), f16::MAX);
        assert_eq!(to_half(-1e9, &mut clamped), f16::MIN);
        assert_eq!(clamped, 2);
        assert_eq!(to_half(f32::NEG_INFINITY, &mut clamped), f16::NEG_INFINITY);
        let (halves, count) = to_halves(&[65519.0, 65520.0, -1e9, f32::INFINITY, 0.1]);
        assert_eq!(halves, [f16::MAX, f16::MAX, f16::MIN, f16::INFINITY, f16::from_f32(0.1)]);
        assert_eq!(count, 2);
        assert_eq!(clamped, 2);
    }

    #[test]
    fn what_a_half_cannot_hold_is_counted() {
        let values = || Samples::Float(vec![0.5, 0.1, 1e6, f32::NAN, 0.2, f32::INFINITY]);
        assert_eq!(convert(values(), Some(Kind::Half), None).1, Loss { clamped: 1, rounded: 2 });
        let mask = Mask::from_fn(lacuna_filters::Size::new(1, 6), |_, x| x == 4);
        assert_eq!(convert(values(), Some(Kind::Half), Some(&mask)).1, Loss { clamped: 0, rounded: 1 });
        assert_eq!(convert(values(), None, None).1, Loss::default());
        assert_eq!(kind_for(Rule::Depth, Some(Kind::Half)), None);
        assert_eq!(kind_for(Rule::Depth, Some(Kind::Float)), Some(Kind::Float));
    }

    #[test]
    fn every_half_survives_the_way_through_floats() {
        let all: Vec<f16> = (0..=u16::MAX).map(f16::from_bits).filter(|half| !half.is_nan()).collect();
        let (floats, _) = convert(Samples::Half(all.clone()), Some(Kind::Float), None);
        let (halves, loss) = convert(floats, Some(Kind::Half), None);
        let Samples::Half(back) = halves else { panic!("not halves") };
        assert_eq!(loss, Loss::default());
        assert!(all.iter().zip(&back).all(|(a, b)| a.to_bits() == b.to_bits()));
    }
}
