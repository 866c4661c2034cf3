//! The range of measured values.
//!
//! Roofline: 5 bytes a pixel and half a dozen integer and comparing instructions a vector: memory decides.

use lacuna_core::parallel::prelude::*;

use super::{Body, Isa, dispatch};

/// Extremes that are kept apart, so that the compiler may use vectors.
const LANES: usize = 16;

/// Whether all of the values that are flagged are finite.
pub fn finite(flags: &[bool], values: &[f32]) -> bool {
    dispatch(Isa::best(), Finite { flags, values })
}

struct Finite<'a> {
    flags: &'a [bool],
    values: &'a [f32],
}

impl Body for Finite<'_> {
    type Output = bool;
    #[inline(always)]
    fn run<const FUSED: bool>(self) -> bool {
        // No exit inside the loop: that lets it run in vectors.
        !self
            .flags
            .iter()
            .zip(self.values)
            .fold(false, |any, (&flag, &value)| any | (flag & !value.is_finite()))
    }
}

/// The smallest and the largest of the values that are flagged; infinite the other way round if none is.
pub fn range(flags: &[bool], values: &[f32]) -> (f32, f32) {
    let tasks = values.par_chunks(1 << 14).zip(flags.par_chunks(1 << 14));
    let ranges = tasks.map(|(values, flags)| dispatch(Isa::best(), Range { flags, values }));
    let both = |a: (f32, f32), b: (f32, f32)| (least(a.0, b.0), -least(-a.1, -b.1));
    ranges.into_iter().fold((f32::INFINITY, f32::NEG_INFINITY), both)
}

struct Range<'a> {
    flags: &'a [bool],
    values: &'a [f32],
}

impl Body for Range<'_> {
    type Output = (f32, f32);
    #[inline(always)]
    fn run<const FUSED: bool>(self) -> (f32, f32) {
        let Range { flags, values } = self;
        // As many minima as there are lanes: one alone would wait for itself.
        let (mut low, mut high) = ([f32::INFINITY; LANES], [f32::INFINITY; LANES]);
        for (values, flags) in values.chunks(LANES).zip(flags.chunks(LANES)) {
            for (((low, high), &value), &flag) in low.iter_mut().zip(&mut high).zip(values).zip(flags) {
                *low = least(*low, or_infinite(value, flag));
                *high = least(*high, or_infinite(-value, flag));
            }
        }
        let smallest = |lanes: [f32; LANES]| lanes.into_iter().fold(f32::INFINITY, least);
        (smallest(low), -smallest(high))
    }
}

/// The largest of some values less the least one.
#[inline(always)]
pub fn span(values: &[f32]) -> f32 {
    let mut lanes = [[f32::INFINITY, f32::NEG_INFINITY]; LANES];
    let (whole, rest) = values.as_chunks::<LANES>();
    for values in whole {
        for ([least, most], value) in lanes.iter_mut().zip(values) {
            (*least, *most) = (least.min(*value), most.max(*value));
        }
    }
    let lanes = lanes.into_iter().chain(rest.iter().map(|value| [*value; 2]));
    let [least, most] = lanes.fold([f32::INFINITY, f32::NEG_INFINITY], |[least, most], [low, high]| {
        [least.min(low), most.max(high)]
    });
    most - least
}

/// The smaller of two numbers; unlike `f32::min` a single instruction, as NaN does not occur.
#[inline(always)]
pub fn least(a: f32, b: f32) -> f32 {
    if b < a { b } else { a }
}

/// The larger of two numbers, likewise.
#[inline(always)]
pub fn most(a: f32, b: f32) -> f32 {
    if b > a { b } else { a }
}

/// The value if it counts, else infinity. By bits: a choice would become a branch, and the loop would not run in vectors.
#[inline(always)]
pub fn or_infinite(value: f32, counts: bool) -> f32 {
    let keep = u32::from(counts).wrapping_neg();
    f32::from_bits(value.to_bits() & keep | f32::INFINITY.to_bits() & !keep)
}
