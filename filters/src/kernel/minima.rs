//! What the limiter does with rows: minima, in loops of a comparison or two a pixel.
//!
//! Maxima are minima of negatives. Minima do not depend on the order, so that instruction sets agree to the bit.
//!
//! Roofline: 8 to 21 bytes a pixel to and from the caches for two to six instructions a vector: the caches decide.

use super::extremes::{least, or_infinite};
use super::{Body, Isa, dispatch};

/// The smaller ones of two rows, in the first.
pub fn lower_to(isa: Isa, row: &mut [f32], other: &[f32]) {
    dispatch(isa, LowerTo { row, other });
}

struct LowerTo<'a> {
    row: &'a mut [f32],
    other: &'a [f32],
}

impl Body for LowerTo<'_> {
    type Output = ();
    #[inline(always)]
    fn run<const FUSED: bool>(self) {
        for (value, &other) in self.row.iter_mut().zip(self.other) {
            *value = least(*value, other);
        }
    }
}

/// The smallest of each three neighbours of `old`, which is two longer than `new`.
pub fn of_three(isa: Isa, old: &[f32], new: &mut [f32]) {
    dispatch(isa, OfThree { old, new });
}

struct OfThree<'a> {
    old: &'a [f32],
    new: &'a mut [f32],
}

impl Body for OfThree<'_> {
    type Output = ();
    #[inline(always)]
    fn run<const FUSED: bool>(self) {
        let old = self.old;
        for (((new, &left), &middle), &right) in self.new.iter_mut().zip(old).zip(&old[1..]).zip(&old[2..]) {
            *new = least(least(left, right), middle);
        }
    }
}

/// Lowers `low` to the values that are flagged `which`, and `high` to their negatives.
pub fn take(isa: Isa, lows: [&mut [f32]; 2], flags: &[bool], values: &[f32], which: bool) {
    dispatch(isa, Take { lows, flags, values, which });
}

struct Take<'a> {
    lows: [&'a mut [f32]; 2],
    flags: &'a [bool],
    values: &'a [f32],
    which: bool,
}

impl Body for Take<'_> {
    type Output = ();
    #[inline(always)]
    fn run<const FUSED: bool>(self) {
        let [low, high] = self.lows;
        for (((low, high), &value), &flag) in low.iter_mut().zip(high).zip(self.values).zip(self.flags) {
            *low = least(*low, or_infinite(value, flag == self.which));
            *high = least(*high, or_infinite(-value, flag == self.which));
        }
    }
}

/// NaN for values that are not flagged and not finite.
pub fn poison(isa: Isa, poison: &mut [f32], flags: &[bool], values: &[f32]) {
    dispatch(isa, Poison { into: poison, flags, values });
}

struct Poison<'a> {
    into: &'a mut [f32],
    flags: &'a [bool],
    values: &'a [f32],
}

impl Body for Poison<'_> {
    type Output = ();
    #[inline(always)]
    fn run<const FUSED: bool>(self) {
        for ((poison, &value), &flag) in self.into.iter_mut().zip(self.values).zip(self.flags) {
            let missing = u32::from(!flag).wrapping_neg();
            *poison += f32::from_bits(value.to_bits() & missing) * 0.0;
        }
    }
}

/// Whether any value that is not flagged lies outside its bounds or is not a number.
pub fn outside(isa: Isa, flags: &[bool], bounds: (&[f32], &[f32]), values: &[f32]) -> bool {
    dispatch(isa, Outside { flags, bounds, values })
}

struct Outside<'a> {
    flags: &'a [bool],
    bounds: (&'a [f32], &'a [f32]),
    values: &'a [f32],
}

impl Body for Outside<'_> {
    type Output = bool;
    #[expect(clippy::needless_bitwise_bool, reason = "lazy operators would keep the loop out of vectors")]
    #[inline(always)]
    fn run<const FUSED: bool>(self) -> bool {
        let bounds = self.bounds.0.iter().zip(self.bounds.1);
        self.values.iter().zip(self.flags).zip(bounds).fold(false, |any, ((value, flag), (bottom, top))| {
            any | (!flag & !((*value >= *bottom) & (*value <= *top)))
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Every instruction set against the definition, with values that are not finite, at lengths that do not fill a vector.
    #[test]
    fn every_instruction_set_says_what_plain_loops_say() {
        for length in [0, 1, 7, 16, 33, 100] {
            let number = |k: usize, seed: f32| match (k * 7 + length) % 11 {
                0 => f32::INFINITY,
                1 => f32::NAN,
                _ => (k as f32 * seed).sin(),
            };
            let row = |seed: f32| -> Vec<f32> { (0..length).map(|k| number(k, seed)).collect() };
            let finite = |seed: f32| -> Vec<f32> { (0..length).map(|k| (k as f32 * seed).sin()).collect() };
            let flags: Vec<bool> = (0..length).map(|k| k % 3 == 0).collect();
            for isa in Isa::all() {
                let (a, b) = (finite(0.3), finite(0.7));
                let mut found = a.clone();
                lower_to(isa, &mut found, &b);
                assert!(found.iter().zip(a.iter().zip(&b)).all(|(found, (a, b))| *found == a.min(*b)));
                if length > 2 {
                    let mut three = vec![0.0; length - 2];
                    of_three(isa, &a, &mut three);
                    assert!(
                        three
                            .iter()
                            .zip(a.windows(3))
                            .all(|(x, near)| *x == near[0].min(near[1]).min(near[2]))
                    );
                }
                let (mut low, mut high) = (vec![f32::INFINITY; length], vec![f32::INFINITY; length]);
                take(isa, [&mut low, &mut high], &flags, &a, true);
                let values = row(0.9);
                let mut bad = vec![0.0; length];
                poison(isa, &mut bad, &flags, &values);
                for k in 0..length {
                    let expected = if flags[k] { (a[k], -a[k]) } else { (f32::INFINITY, f32::INFINITY) };
                    assert_eq!((low[k], high[k]), expected, "{isa:?} {k}");
                    assert_eq!(bad[k].is_nan(), !flags[k] && !values[k].is_finite(), "{isa:?} {k}");
                }
                let (bottom, top) = (vec![-0.5; length], vec![0.5; length]);
                let any = (0..length).any(|k| !flags[k] && !(-0.5..=0.5).contains(&values[k]));
                assert_eq!(outside(isa, &flags, (&bottom, &top), &values), any, "{isa:?} {length}");
            }
        }
    }
}
