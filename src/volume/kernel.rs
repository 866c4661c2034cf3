//! Interpolation within a cell: weights, value and gradient, for all ways of interpolating.
//!
//! A kernel gathers the voxels of a cell once; the samples of a ray within the cell are computed from that copy. SIMD
//! over the four voxels of a row, in vectors that every machine has; no multiplication is fused with a sum, so that the
//! bits do not depend on the machine.
//!
//! The cubic kernels are separable: with `w` the weights of an axis and `w'` their derivatives,
//! `f = sum w_z w_y w_x c`, and a component of the gradient has `w'` in place of `w` on its axis. Value and
//! gradient share the sums over z and y: 84 multiplications for the value, 108 more for the gradient.
//!
//! Sources: T. Möller, R. Machiraju, K. Mueller, R. Yagel, "Evaluation and design of filters using a Taylor series
//! expansion", IEEE TVCG 3(2), 1997 (derivatives by the interpolant's own); M. Unser, "Splines: a perfect fit for signal
//! and image processing", IEEE Signal Processing Magazine 16(6), 1999 (cubic B-spline).

use wide::f32x4;

use super::grid::Grid;

/// How values between voxels are made.
pub trait Kernel: Copy + Send + Sync {
    /// The voxels of a cell.
    type Taps: Copy;
    /// What the value leaves behind for the gradient.
    type Partial;
    /// Voxels before and after a cell's lowest corner that count: -before ..= after.
    const SUPPORT: (usize, usize);

    /// Taps of value 0.
    fn zero() -> Self::Taps;
    /// Gathers the voxels of the cell that [`Grid::at`] gives.
    fn gather(self, grid: &Grid, at: usize, taps: &mut Self::Taps);
    /// Bounds of all values in the cell.
    fn bounds(self, taps: &Self::Taps) -> (f32, f32);
    /// The value at `f`: x, y, z in 0 to 1 from the cell's lowest corner, and 0.
    fn value(self, taps: &Self::Taps, f: f32x4) -> (f32, Self::Partial);
    /// The gradient there, per index step.
    fn gradient(self, taps: &Self::Taps, f: f32x4, partial: &Self::Partial) -> [f32; 3];
    /// Bounds of the values of an interpolant whose voxels lie between `low` and `high`.
    fn widen(low: f32, high: f32) -> (f32, f32) {
        (low, high)
    }
}

/// The nearest voxel; its gradient is that of central differences around it.
#[derive(Clone, Copy, Debug)]
pub struct Nearest;
/// Linear along each axis.
#[derive(Clone, Copy, Debug)]
pub struct Linear;
/// Cubic along each axis, by its weights.
#[derive(Clone, Copy, Debug)]
pub struct Cubic<W>(pub W);

/// Four weights of a cubic kernel and their derivatives.
pub trait Weights: Copy + Send + Sync {
    /// The largest sum of absolute weights over all three axes: 1 where no weight is negative.
    const GAIN: f32;
    /// Weights of the voxels -1, 0, 1, 2 at `f` for three axes at once.
    fn weights(f: f32x4) -> [f32x4; 4];
    /// Their derivatives.
    fn derivatives(f: f32x4) -> [f32x4; 4];
}

/// The uniform cubic B-spline.
#[derive(Clone, Copy, Debug)]
pub struct BSpline;
/// The cubic of Catmull and Rom: goes through the voxels.
#[derive(Clone, Copy, Debug)]
pub struct CatmullRom;

#[inline(always)]
fn c(value: f32) -> f32x4 {
    f32x4::splat(value)
}

impl Weights for BSpline {
    const GAIN: f32 = 1.0;

    #[inline(always)]
    fn weights(f: f32x4) -> [f32x4; 4] {
        let (sixth, g) = (c(1.0 / 6.0), c(1.0) - f);
        let (f2, g2) = (f * f, g * g);
        [
            g2 * g * sixth,
            c(2.0 / 3.0) - f2 * (c(1.0) - c(0.5) * f),
            c(2.0 / 3.0) - g2 * (c(1.0) - c(0.5) * g),
            f2 * f * sixth,
        ]
    }

    #[inline(always)]
    fn derivatives(f: f32x4) -> [f32x4; 4] {
        let g = c(1.0) - f;
        [g * g * c(-0.5), f * (c(1.5) * f - c(2.0)), g * (c(2.0) - c(1.5) * g), f * f * c(0.5)]
    }
}

impl Weights for CatmullRom {
    // 1.25 per axis, at one half.
    const GAIN: f32 = 1.953_125;

    #[inline(always)]
    fn weights(f: f32x4) -> [f32x4; 4] {
        [
            f * (c(-0.5) + f * (c(1.0) - c(0.5) * f)),
            c(1.0) + f * f * (c(1.5) * f - c(2.5)),
            f * (c(0.5) + f * (c(2.0) - c(1.5) * f)),
            f * f * (c(0.5) * f - c(0.5)),
        ]
    }

    #[inline(always)]
    fn derivatives(f: f32x4) -> [f32x4; 4] {
        [
            c(-0.5) + f * (c(2.0) - c(1.5) * f),
            f * (c(4.5) * f - c(5.0)),
            c(0.5) + f * (c(4.0) - c(4.5) * f),
            f * (c(1.5) * f - c(1.0)),
        ]
    }
}

/// The sums that value and gradient share.
#[derive(Clone, Copy, Debug)]
pub struct CubicPartial {
    weights: [f32x4; 4],
    /// Over z: by y, each along x.
    over_z: [f32x4; 4],
    /// Over z and y, along x.
    over_zy: f32x4,
}

impl<W: Weights> Kernel for Cubic<W> {
    type Taps = [f32x4; 16];
    type Partial = CubicPartial;
    const SUPPORT: (usize, usize) = (1, 2);

    #[inline(always)]
    fn zero() -> Self::Taps {
        [f32x4::ZERO; 16]
    }

    #[inline(always)]
    fn gather(self, grid: &Grid, at: usize, taps: &mut Self::Taps) {
        grid.gather4(at, taps);
    }

    #[inline(always)]
    fn bounds(self, taps: &Self::Taps) -> (f32, f32) {
        let (low, high) = range(taps);
        Self::widen(low, high)
    }

    #[inline(always)]
    fn value(self, taps: &Self::Taps, f: f32x4) -> (f32, CubicPartial) {
        let weights = W::weights(f);
        let over_z = sum_over_z(taps, &weights);
        let over_zy = sum_over_y(&over_z, &weights);
        let along_x = transposed(&weights, 0);
        (total(along_x * over_zy), CubicPartial { weights, over_z, over_zy })
    }

    #[inline(always)]
    fn gradient(self, taps: &Self::Taps, f: f32x4, partial: &CubicPartial) -> [f32; 3] {
        let slopes = W::derivatives(f);
        let CubicPartial { weights, over_z, over_zy } = partial;
        let along_y = sum_over_y(over_z, &slopes);
        let along_z = sum_over_y(&sum_over_z(taps, &slopes), weights);
        let (weights, slopes) = (transposed(weights, 0), transposed(&slopes, 0));
        [total(slopes * *over_zy), total(weights * along_y), total(weights * along_z)]
    }

    fn widen(low: f32, high: f32) -> (f32, f32) {
        let (middle, half) = (0.5 * (low + high), 0.5 * (high - low) * W::GAIN);
        if W::GAIN > 1.0 { (middle - half, middle + half) } else { (low, high) }
    }
}

/// The four weights of an axis.
#[inline(always)]
fn transposed(weights: &[f32x4; 4], axis: usize) -> f32x4 {
    let of = |k: usize| weights[k].as_array()[axis];
    f32x4::new([of(0), of(1), of(2), of(3)])
}

#[inline(always)]
fn splat(weights: &[f32x4; 4], axis: usize) -> [f32x4; 4] {
    let of = |k: usize| f32x4::splat(weights[k].as_array()[axis]);
    [of(0), of(1), of(2), of(3)]
}

#[inline(always)]
fn sum_over_z(taps: &[f32x4; 16], weights: &[f32x4; 4]) -> [f32x4; 4] {
    let [a, b, c, d] = splat(weights, 2);
    let row = |y: usize| (a * taps[y] + b * taps[4 + y]) + (c * taps[8 + y] + d * taps[12 + y]);
    [row(0), row(1), row(2), row(3)]
}

#[inline(always)]
fn sum_over_y(over_z: &[f32x4; 4], weights: &[f32x4; 4]) -> f32x4 {
    let [a, b, c, d] = splat(weights, 1);
    (a * over_z[0] + b * over_z[1]) + (c * over_z[2] + d * over_z[3])
}

/// The sum of four numbers, in pairs.
#[inline(always)]
fn total(v: f32x4) -> f32 {
    let v = v.to_array();
    (v[0] + v[2]) + (v[1] + v[3])
}

/// Least and largest.
#[inline(always)]
fn range<const N: usize>(taps: &[f32x4; N]) -> (f32, f32) {
    let (mut low, mut high) = (taps[0], taps[0]);
    for tap in &taps[1..] {
        low = low.fast_min(*tap);
        high = high.fast_max(*tap);
    }
    let (low, high) = (low.to_array(), high.to_array());
    let least = |a: f32, b: f32| if b < a { b } else { a };
    let most = |a: f32, b: f32| if b > a { b } else { a };
    (
        least(least(low[0], low[1]), least(low[2], low[3])),
        most(most(high[0], high[1]), most(high[2], high[3])),
    )
}

impl Kernel for Linear {
    /// The corners by z: along y and x.
    type Taps = [f32x4; 2];
    type Partial = ();
    const SUPPORT: (usize, usize) = (0, 1);

    #[inline(always)]
    fn zero() -> Self::Taps {
        [f32x4::ZERO; 2]
    }

    #[inline(always)]
    fn gather(self, grid: &Grid, at: usize, taps: &mut Self::Taps) {
        grid.gather2(at, taps);
    }

    #[inline(always)]
    fn bounds(self, taps: &Self::Taps) -> (f32, f32) {
        range(taps)
    }

    #[inline(always)]
    fn value(self, taps: &Self::Taps, f: f32x4) -> (f32, ()) {
        let f = f.to_array();
        let [a, b, e, d] = (taps[0] * c(1.0 - f[2]) + taps[1] * c(f[2])).to_array();
        let (low, high) = ((1.0 - f[1]) * a + f[1] * e, (1.0 - f[1]) * b + f[1] * d);
        ((1.0 - f[0]) * low + f[0] * high, ())
    }

    #[inline(always)]
    fn gradient(self, taps: &Self::Taps, f: f32x4, (): &()) -> [f32; 3] {
        let f = f.to_array();
        let [a, b, c_, d] = (taps[0] * c(1.0 - f[2]) + taps[1] * c(f[2])).to_array();
        let [e, g, h, i] = (taps[1] - taps[0]).to_array();
        [
            (1.0 - f[1]) * (b - a) + f[1] * (d - c_),
            (1.0 - f[0]) * (c_ - a) + f[0] * (d - b),
            (1.0 - f[1]) * ((1.0 - f[0]) * e + f[0] * g) + f[1] * ((1.0 - f[0]) * h + f[0] * i),
        ]
    }
}

impl Kernel for Nearest {
    type Taps = [f32x4; 16];
    type Partial = ();
    const SUPPORT: (usize, usize) = (0, 1);

    #[inline(always)]
    fn zero() -> Self::Taps {
        [f32x4::ZERO; 16]
    }

    #[inline(always)]
    fn gather(self, grid: &Grid, at: usize, taps: &mut Self::Taps) {
        grid.gather4(at, taps);
    }

    #[inline(always)]
    fn bounds(self, taps: &Self::Taps) -> (f32, f32) {
        let pair = |row: usize| {
            let row = taps[row].to_array();
            [row[1], row[2]]
        };
        let ([a, b], [c, d], [e, f], [g, h]) = (pair(5), pair(6), pair(9), pair(10));
        range(&[f32x4::new([a, b, c, d]), f32x4::new([e, f, g, h])])
    }

    #[inline(always)]
    fn value(self, taps: &Self::Taps, f: f32x4) -> (f32, ()) {
        let [x, y, z] = nearest(f);
        (tap(taps, x, y, z), ())
    }

    #[inline(always)]
    fn gradient(self, taps: &Self::Taps, f: f32x4, (): &()) -> [f32; 3] {
        let [x, y, z] = nearest(f);
        [
            0.5 * (tap(taps, x + 1, y, z) - tap(taps, x - 1, y, z)),
            0.5 * (tap(taps, x, y + 1, z) - tap(taps, x, y - 1, z)),
            0.5 * (tap(taps, x, y, z + 1) - tap(taps, x, y, z - 1)),
        ]
    }
}

/// The nearest corner of the cell, as a tap: 1 or 2 on each axis.
#[inline(always)]
fn nearest(f: f32x4) -> [usize; 3] {
    let f = f.to_array();
    [1 + usize::from(f[0] >= 0.5), 1 + usize::from(f[1] >= 0.5), 1 + usize::from(f[2] >= 0.5)]
}

#[inline(always)]
fn tap(taps: &[f32x4; 16], x: usize, y: usize, z: usize) -> f32 {
    taps[z * 4 + y].as_array()[x]
}
