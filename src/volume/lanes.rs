//! Eight samples of one ray side by side.
//!
//! Vectors that every machine has; no multiplication is fused with a sum, so that the bits do not depend on the machine.
//! A sample's bits do not depend on its neighbours either: nothing goes from one lane to another.

use wide::f32x8;

/// Samples side by side.
pub const LANES: usize = 8;
/// A number for each of them.
pub type Lanes = f32x8;

/// One number for all.
#[inline(always)]
pub fn all(value: f32) -> Lanes {
    Lanes::splat(value)
}

/// One vector for all.
#[inline(always)]
pub fn splat([x, y, z]: [f32; 3]) -> [Lanes; 3] {
    [all(x), all(y), all(z)]
}

/// `a . b`.
#[inline(always)]
pub fn dot(a: [Lanes; 3], b: [Lanes; 3]) -> Lanes {
    a[0] * b[0] + a[1] * b[1] + a[2] * b[2]
}
