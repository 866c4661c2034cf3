//! The rows of push-pull: means of 2 x 2 pixels on the way down, bilinear samples on the way up.
//!
//! Roofline: 5 bytes a pixel are read and 1 written on the way down, 6 and 4 on the way up; memory decides.

use super::{Body, Isa, dispatch};

/// The means of the known among each 2 x 2 block of one or two rows, 0 where none is.
pub fn push<const N: usize>(isa: Isa, above: &mut [f32], known: [&[bool]; N], values: [&[f32]; N]) {
    dispatch(isa, Push { above, known, values });
}

struct Push<'a, const N: usize> {
    above: &'a mut [f32],
    known: [&'a [bool]; N],
    values: [&'a [f32]; N],
}

impl<const N: usize> Body for Push<'_, N> {
    type Output = ();

    #[inline(always)]
    fn run<const FUSED: bool>(self) {
        let halves = self.known.map(<[bool]>::as_chunks::<2>);
        let pairs = self.values.map(<[f32]>::as_chunks::<2>);
        let (whole, rest) = self.above.split_at_mut(pairs[0].0.len());
        let (known, values) =
            (halves.map(|half| &half.0[..whole.len()]), pairs.map(|pair| &pair.0[..whole.len()]));
        for (x, above) in whole.iter_mut().enumerate() {
            let (mut sum, mut count) = (0.0, 0.0);
            for (known, values) in known.iter().zip(&values) {
                let ([left_known, right_known], [left, right]) = (known[x], values[x]);
                sum += f64::from(choose(left_known, left, 0.0)) + f64::from(choose(right_known, right, 0.0));
                count += f64::from(u8::from(left_known) + u8::from(right_known));
            }
            *above = (sum / if count > 0.0 { count } else { 1.0 }) as f32;
        }
        for above in rest {
            let (mut sum, mut count) = (0.0, 0.0);
            for (half, pair) in halves.iter().zip(&pairs) {
                for (_, value) in half.1.iter().zip(pair.1).filter(|(known, _)| **known) {
                    sum += f64::from(*value);
                    count += 1.0;
                }
            }
            *above = (sum / if count > 0.0 { count } else { 1.0 }) as f32;
        }
    }
}

/// A row on the way up.
pub struct Pull<'a> {
    /// Its pixels. Those that are known stay, or are taken from `samples`.
    pub values: &'a mut [f32],
    /// Which are known.
    pub known: &'a [bool],
    /// What known pixels are.
    pub samples: Option<&'a [f32]>,
    /// The row of the level above that lies nearest.
    pub near: &'a [f32],
    /// The one on the other side.
    pub far: &'a [f32],
    /// Scratch, two longer than those.
    pub between: &'a mut [f32],
}

/// Unknown pixels take the bilinear sample of the level above, which repeats its border.
pub fn pull(isa: Isa, row: Pull<'_>) {
    dispatch(isa, row);
}

impl Body for Pull<'_> {
    type Output = ();

    #[inline(always)]
    fn run<const FUSED: bool>(self) {
        let Pull { values, known, samples, near, far, between } = self;
        for ((between, &near), &far) in between[1..].iter_mut().zip(near).zip(far) {
            *between = blend(near, far);
        }
        let last = near.len();
        between[0] = between[1];
        between[last + 1] = between[last];
        if let Some(samples) = samples {
            values.copy_from_slice(samples);
        }
        let (pairs, rest) = values.as_chunks_mut::<2>();
        let (flags, last_known) = known.as_chunks::<2>();
        for ((pair, flags), &[before, near, after]) in
            pairs.iter_mut().zip(flags).zip(between.array_windows::<3>())
        {
            let (left, right) = (blend(near, before), blend(near, after));
            pair[0] = choose(flags[0], pair[0], left);
            pair[1] = choose(flags[1], pair[1], right);
        }
        if let ([value], [false]) = (rest, last_known) {
            *value = blend(between[last], between[last - 1]);
        }
    }
}

/// `a` if `first`, else `b`. By bits: a choice would become a branch, and the loop would not run in vectors.
#[inline(always)]
fn choose(first: bool, a: f32, b: f32) -> f32 {
    let keep = u32::from(first).wrapping_neg();
    f32::from_bits(a.to_bits() & keep | b.to_bits() & !keep)
}

/// Three parts of `near`, one of `far`; `near` itself where both agree, always between the two.
#[inline(always)]
fn blend(near: f32, far: f32) -> f32 {
    near + (0.25 * far - 0.25 * near)
}
