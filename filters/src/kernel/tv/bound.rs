//! Row sums of the certificate, in f64: the total variation, and what the dual bound is made of.

use super::{DualBall, LANES, PrimalRow, dispatch};

dispatch! {
    /// Sum of the gradient's norm over a row; `below` is the next row, or the row itself at the last.
    variation_row<B> = variation(x: &[f32], below: &[f32]) -> f64
}

#[inline(always)]
fn variation<B: DualBall>(x: &[f32], below: &[f32]) -> f64 {
    let n = x.len();
    if n == 0 {
        return 0.0;
    }
    let one = |here: f32, right: f32, down: f32| {
        B::norm(f64::from(down) - f64::from(here), f64::from(right) - f64::from(here))
    };
    let (here, here_rest) = x[..n - 1].as_chunks::<LANES>();
    let (right, right_rest) = x[1..n].as_chunks::<LANES>();
    let (down, down_rest) = below[..n - 1].as_chunks::<LANES>();
    let mut sums = [0.0; LANES];
    for ((here, right), down) in here.iter().zip(right).zip(down) {
        for lane in 0..LANES {
            sums[lane] += one(here[lane], right[lane], down[lane]);
        }
    }
    let mut sum: f64 = sums.iter().sum();
    for ((&here, &right), &down) in here_rest.iter().zip(right_rest).zip(down_rest) {
        sum += one(here, right, down);
    }
    sum + one(x[n - 1], x[n - 1], below[n - 1])
}

/// Sums over pixels of `d`, the adjoint gradient of the dual variable.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Bound {
    /// Sum of sample times `d` over measured pixels.
    pub measured: f64,
    /// Sum of `min(0, d)` over missing pixels: the minimum of `x d` over `0 <= x <= 1`.
    pub missing: f64,
    /// Sum of `d` squared over measured pixels.
    pub squares: f64,
}

impl std::ops::Add for Bound {
    type Output = Self;

    fn add(self, other: Self) -> Self {
        Self {
            measured: self.measured + other.measured,
            missing: self.missing + other.missing,
            squares: self.squares + other.squares,
        }
    }
}

dispatch! {
    /// The bound's sums over a row of samples.
    bound_row = bound(sample: &[f32], row: PrimalRow<'_>) -> Bound
}

#[inline(always)]
fn bound(sample: &[f32], row: PrimalRow<'_>) -> Bound {
    let n = sample.len();
    if n == 0 {
        return Bound::default();
    }
    let mut lanes = [Bound::default(); LANES];
    let (horizontal, vertical, above, free) =
        (&row.horizontal[..n], &row.vertical[..n], &row.above[..n], &row.free[..n]);
    let one = |sum: &mut Bound, j: usize, left: f32| {
        let d = (f64::from(above[j]) - f64::from(vertical[j])) + (f64::from(left) - f64::from(horizontal[j]));
        let held = f64::from(1 - free[j]);
        sum.measured += held * f64::from(sample[j]) * d;
        sum.missing += (1.0 - held) * d.min(0.0);
        sum.squares += held * d * d;
    };
    one(&mut lanes[0], 0, 0.0);
    let mut j = 1;
    while j + LANES <= n {
        for (lane, sum) in lanes.iter_mut().enumerate() {
            one(sum, j + lane, horizontal[j + lane - 1]);
        }
        j += LANES;
    }
    for j in j..n {
        one(&mut lanes[0], j, horizontal[j - 1]);
    }
    lanes.into_iter().fold(Bound::default(), |a, b| a + b)
}

dispatch! {
    /// [`Bound::squares`] over a row with each square times `ease`, the inverse of the sample's weight.
    squares_row = squares(ease: &[f32], row: PrimalRow<'_>) -> f64
}

#[inline(always)]
fn squares(ease: &[f32], row: PrimalRow<'_>) -> f64 {
    let (mut sum, mut left) = (0.0, 0.0);
    for (j, &ease) in ease.iter().enumerate() {
        let here = row.horizontal[j];
        let d = (f64::from(row.above[j]) - f64::from(row.vertical[j])) + (f64::from(left) - f64::from(here));
        left = here;
        sum += f64::from(1 - row.free[j]) * f64::from(ease) * d * d;
    }
    sum
}
