//! Between the file's sample types and the filters' planes: exact where nothing is filled.

use half::f16;
use half::slice::HalfFloatSliceExt;
use lacuna_filters::Mask;

use super::job::Kind;
use crate::frame::Samples;

/// The values of a float channel as 32-bit floats; nothing for whole numbers.
pub fn to_floats(samples: &Samples) -> Option<Vec<f32>> {
    match samples {
        Samples::Half(values) => {
            let mut floats = vec![0.0; values.len()];
            values.convert_to_f32_slice(&mut floats);
            Some(floats)
        }
        Samples::Float(values) => Some(values.clone()),
        Samples::Uint(_) => None,
    }
}

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

/// A channel's samples in another float type; whole numbers stay. Returns how many halves were clamped as well, among
/// the measured pixels if a mask is given.
pub fn convert(samples: Samples, kind: Option<Kind>, mask: Option<&Mask>) -> (Samples, usize) {
    match (samples, kind) {
        (Samples::Float(values), Some(Kind::Half)) => {
            let (mut clamped, mut unused) = (0, 0);
            let counts = |at: usize| mask.is_none_or(|mask| mask.as_slice()[at]);
            let half = |(at, value)| to_half(value, if counts(at) { &mut clamped } else { &mut unused });
            let halves = values.into_iter().enumerate().map(half).collect();
            (Samples::Half(halves), clamped)
        }
        (samples @ Samples::Half(_), Some(Kind::Float)) => {
            (to_floats(&samples).map_or(samples, Samples::Float), 0)
        }
        (samples, _) => (samples, 0),
    }
}

/// Writes `values` where the mask is missing, or everywhere if `all`; returns how many halves were clamped.
pub fn write(samples: &mut Samples, values: &[f32], mask: &Mask, all: bool) -> usize {
    let mut clamped = 0;
    let places = mask.as_slice().iter().zip(values).map(|(&measured, &value)| (all || !measured, value));
    match samples {
        Samples::Half(out) => {
            for (out, (write, value)) in out.iter_mut().zip(places) {
                if write {
                    *out = to_half(value, &mut clamped);
                }
            }
        }
        Samples::Float(out) => {
            for (out, (write, value)) in out.iter_mut().zip(places) {
                if write {
                    *out = value;
                }
            }
        }
        Samples::Uint(_) => {}
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
        assert_eq!(clamped, 2);
    }

    #[test]
    fn every_half_survives_the_way_through_floats() {
        let all: Vec<f16> = (0..=u16::MAX).map(f16::from_bits).filter(|half| !half.is_nan()).collect();
        let (floats, _) = convert(Samples::Half(all.clone()), Some(Kind::Float), None);
        let (halves, clamped) = convert(floats, Some(Kind::Half), None);
        let Samples::Half(back) = halves else { panic!("not halves") };
        assert_eq!(clamped, 0);
        assert!(all.iter().zip(&back).all(|(a, b)| a.to_bits() == b.to_bits()));
    }
}
