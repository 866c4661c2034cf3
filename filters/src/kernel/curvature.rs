//! The energy of weighted second derivatives on a tile, and its minimum by conjugate gradients.
//!
//! A tile is a small rectangle that stays in the cache. With a symmetric matrix `D = (p q; q r)` at each pixel and the Hessian `H` of
//! differences there,
//!
//! ```text
//! E(u) = sum over pixels of the mean, over the four cells around, of |D^(1/2) H D^(1/2)|^2
//!      = sum of the mean of p^2 u_xx^2 + r^2 u_yy^2 + 2 q^2 u_xx u_yy + 2 (p r + q^2) u_xy^2 + 4 q u_xy (p u_xx + r u_yy)
//! ```
//!
//! `u_xx` and `u_yy` are differences of three pixels (none where the tile ends), `u_xy` that of a cell of 2 x 2 pixels. Every term is a
//! square, so that `E` is positive semidefinite as it stands, and zero on planes alone.
//!
//! Every pass is a plain loop that contracts no product and sum, and sums have a fixed number of lanes: all instruction sets
//! give the same bits.
#![allow(clippy::inline_always, reason = "a body must be compiled with the instruction set of its caller")]

use solve::Operator;
pub use solve::Solve;

use super::Body;
use super::extremes::span;

mod solve;

/// Lanes of sums.
const LANES: usize = 16;
/// More than the trace of a channel's tensor over the square of its range: 2 of it is the most that a second derivative can be, 1/2 the
/// mixed one and a slope, whose square counts less.
const STEEPEST: f32 = 2.0 * (4.0 + 0.25 + 0.25) * 1.01;
/// Values on one side of a blur's middle.
const REACH: usize = 4;

/// How curvature makes weights.
#[derive(Clone, Copy, Debug)]
pub struct Weighting {
    /// Inverse square of the curvature at which a derivative counts half.
    pub inverse: f32,
    /// What a squared slope counts beside a squared curvature.
    pub slope: f32,
    /// The least weight.
    pub floor: f32,
    /// Half of the window of the blur, by distance.
    pub blur: [f32; REACH + 1],
}

/// A tile: its size, its pixels, and room for what is computed of them. Rows lie one after the other.
#[derive(Debug, Default)]
pub struct Tile {
    height: usize,
    width: usize,
    /// Pixels, one channel after the other.
    pub values: Vec<f32>,
    /// 1 where a pixel is to be found, else 0.
    pub free: Vec<f32>,
    /// At pixels: the matrix `(p q; q r)`.
    pub matrix: [Vec<f32>; 3],
    operator: Operator,
    room: [Vec<f32>; 2],
}

impl Tile {
    /// Takes on a size of one pixel or more; everything but the pixels becomes zero.
    pub fn resize(&mut self, height: usize, width: usize, channels: usize) {
        (self.height, self.width) = (height, width);
        let pixels = height * width;
        self.values.resize(channels * pixels, 0.0);
        for plane in std::iter::once(&mut self.free).chain(&mut self.matrix).chain(&mut self.room) {
            plane.clear();
            plane.resize(pixels, 0.0);
        }
    }
}

/// Finds a tile's matrices from its pixels. Returns the least weight of a direction, or 1, and no matrices, where the range of the pixels shows
/// that it cannot be below `sought`.
#[derive(Debug)]
pub struct Weigh<'a> {
    /// The tile.
    pub tile: &'a mut Tile,
    /// How.
    pub how: Weighting,
    /// From this weight on matrices are not needed.
    pub sought: f32,
}

impl Body for Weigh<'_> {
    type Output = f32;
    #[inline(always)]
    fn run<const FUSED: bool>(self) -> f32 {
        let Tile { height, width, values, matrix, room, .. } = self.tile;
        let (h, w) = (*height, *width);
        let [smooth, other] = room;
        let squares: f32 = values.chunks_exact(h * w).map(span).map(|span| span * span).sum();
        if 1.0 / (1.0 + STEEPEST * squares * self.how.inverse) >= self.sought {
            return 1.0;
        }
        if h > 2 && w > 2 {
            for channel in values.chunks_exact(h * w) {
                soften(channel, other, smooth, w);
                products(smooth, matrix, w, self.how.slope);
            }
        }
        for plane in &mut *matrix {
            continue_outwards(plane, (h, w));
            blur(plane, other, &self.how.blur, (h, w));
        }
        let [p, q, r] = matrix;
        for (((p, q), r), least) in p.iter_mut().zip(q).zip(r).zip(&mut *other) {
            let (half, skew) = (0.5 * (*p + *r), 0.5 * (*p - *r));
            let spread = (skew * skew + *q * *q).sqrt();
            let square = [(half + spread).max(0.0), (half - spread).max(0.0)];
            let across = (1.0 / (1.0 + square[0] * self.how.inverse)).max(self.how.floor);
            let along = (1.0 / (1.0 + square[1] * self.how.inverse)).max(self.how.floor);
            let (mean, turn) =
                (0.5 * (across + along), 0.5 * (across - along) / spread.max(f32::MIN_POSITIVE));
            (*p, *q, *r) = (mean + turn * skew, turn * *q, mean - turn * skew);
            *least = across;
        }
        least(other)
    }
}

/// The least of some values and 1.
#[inline(always)]
fn least(values: &[f32]) -> f32 {
    let mut lanes = [1.0_f32; LANES];
    let (whole, rest) = values.as_chunks::<LANES>();
    for values in whole {
        for (least, value) in lanes.iter_mut().zip(values) {
            *least = least.min(*value);
        }
    }
    rest.iter().chain(&lanes).copied().fold(1.0, f32::min)
}

/// A Gaussian blur of half a pixel, which leaves what is linear as it is; the outermost pixels are blurred along the border alone.
#[inline(always)]
fn soften(from: &[f32], between: &mut [f32], to: &mut [f32], w: usize) {
    const SIDE: f32 = 0.106_507;
    let n = from.len() - 2;
    let [left, mid, right] = slices(from, [0, 1, 2], n);
    for (i, to) in between[1..=n].iter_mut().enumerate() {
        *to = mid[i] + SIDE * (left[i] - 2.0 * mid[i] + right[i]);
    }
    for (to, from) in between.chunks_exact_mut(w).zip(from.chunks_exact(w)) {
        (to[0], to[w - 1]) = (from[0], from[w - 1]);
    }
    let n = from.len() - 2 * w;
    let [up, mid, down] = slices(between, [0, w, 2 * w], n);
    for (i, to) in to[w..][..n].iter_mut().enumerate() {
        *to = mid[i] + SIDE * (up[i] - 2.0 * mid[i] + down[i]);
    }
    to[..w].copy_from_slice(&between[..w]);
    to[w + n..].copy_from_slice(&between[w + n..]);
}

/// Adds `H^2 + slope grad grad'` of a channel at all but the outermost pixels. Those get values that mean nothing.
#[inline(always)]
fn products(u: &[f32], matrix: &mut [Vec<f32>; 3], w: usize, slope: f32) {
    let n = u.len() - 2 * (w + 1);
    let [p, q, r] = matrix.each_mut().map(|plane| &mut plane[w + 1..][..n]);
    let [u0, u1, u2] = slices(u, [0, 1, 2], n);
    let [m0, m1, m2] = slices(u, [w, w + 1, w + 2], n);
    let [d0, d1, d2] = slices(u, [2 * w, 2 * w + 1, 2 * w + 2], n);
    for i in 0..n {
        let xx = m0[i] - 2.0 * m1[i] + m2[i];
        let yy = u1[i] - 2.0 * m1[i] + d1[i];
        let xy = 0.25 * (d2[i] - d0[i] - u2[i] + u0[i]);
        let (gx, gy) = (0.5 * (m2[i] - m0[i]), 0.5 * (d1[i] - u1[i]));
        p[i] += xx * xx + xy * xy + slope * gx * gx;
        q[i] += xy * (xx + yy) + slope * gx * gy;
        r[i] += yy * yy + xy * xy + slope * gy * gy;
    }
}

/// Gives the outermost pixels the values of those within.
#[inline(always)]
fn continue_outwards(plane: &mut [f32], (h, w): (usize, usize)) {
    if h > 2 && w > 2 {
        plane.chunks_exact_mut(w).for_each(|row| (row[0], row[w - 1]) = (row[1], row[w - 2]));
        plane.copy_within(w..2 * w, 0);
        plane.copy_within((h - 2) * w..(h - 1) * w, (h - 1) * w);
    }
}

/// A separable blur; beyond the border the outermost pixel goes on.
#[inline(always)]
fn blur(plane: &mut Vec<f32>, blurred: &mut Vec<f32>, taps: &[f32; REACH + 1], (h, w): (usize, usize)) {
    let mut line = vec![0.0; w + 2 * REACH];
    for (y, to) in blurred.chunks_exact_mut(w).enumerate() {
        let row = |k: usize| &plane[(y + k).saturating_sub(REACH).min(h - 1) * w..][..w];
        weighted([0, 1, 2, 3, 4, 5, 6, 7, 8].map(row), taps, &mut line[REACH..][..w]);
        let ends = (line[REACH], line[REACH + w - 1]);
        line[..REACH].fill(ends.0);
        line[REACH + w..].fill(ends.1);
        weighted(slices(&line, [0, 1, 2, 3, 4, 5, 6, 7, 8], w), taps, to);
    }
    std::mem::swap(plane, blurred);
}

/// The sum of rows, each times the tap of its distance from the middle one.
#[inline(always)]
fn weighted(rows: [&[f32]; 2 * REACH + 1], taps: &[f32; REACH + 1], out: &mut [f32]) {
    let n = out.len();
    let [a, b, c, d, e, f, g, h, i] = rows.map(|row| &row[..n]);
    let [t0, t1, t2, t3, t4] = *taps;
    for (x, out) in out.iter_mut().enumerate() {
        let near = t0 * e[x] + t1 * (d[x] + f[x]) + t2 * (c[x] + g[x]);
        *out = near + t3 * (b[x] + h[x]) + t4 * (a[x] + i[x]);
    }
}

/// As many values of a plane from each of some places.
#[inline(always)]
fn slices<const N: usize>(plane: &[f32], from: [usize; N], n: usize) -> [&[f32]; N] {
    from.map(|from| &plane[from..][..n])
}

#[cfg(test)]
mod tests;
