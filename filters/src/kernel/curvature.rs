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

mod solve;

/// Lanes of sums.
const LANES: usize = 16;
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

/// Finds a tile's matrices from its pixels. Returns the least weight of a direction.
#[derive(Debug)]
pub struct Weigh<'a> {
    /// The tile.
    pub tile: &'a mut Tile,
    /// How.
    pub how: Weighting,
}

impl Body for Weigh<'_> {
    type Output = f32;
    #[inline(always)]
    fn run<const FUSED: bool>(self) -> f32 {
        let Tile { height, width, values, matrix, room, .. } = self.tile;
        let (h, w) = (*height, *width);
        let [smooth, other] = room;
        for channel in values.chunks_exact(h * w) {
            soften(channel, other, smooth, h, w);
            for y in 0..h {
                products(smooth, matrix, (y, h, w), self.how.slope);
            }
        }
        for plane in &mut *matrix {
            blur(plane, other, &self.how.blur, h, w);
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

/// A Gaussian blur of half a pixel, which leaves what is linear as it is, up to the border.
#[inline(always)]
fn soften(from: &[f32], between: &mut [f32], to: &mut [f32], h: usize, w: usize) {
    const SIDE: f32 = 0.106_507;
    to.copy_from_slice(from);
    for (to, from) in to.chunks_exact_mut(w).zip(from.chunks_exact(w)).filter(|_| w > 2) {
        let sides = from[..w - 2].iter().zip(&from[2..]);
        for ((to, mid), (left, right)) in to[1..w - 1].iter_mut().zip(&from[1..w - 1]).zip(sides) {
            *to = mid + SIDE * (left - 2.0 * mid + right);
        }
    }
    between.copy_from_slice(to);
    for y in 1..h.max(1) - 1 {
        let (above, mid, below) = three(between, y, w);
        for (((to, above), mid), below) in to[y * w..][..w].iter_mut().zip(above).zip(mid).zip(below) {
            *to = mid + SIDE * (above - 2.0 * mid + below);
        }
    }
}

/// Row `y` and those beside it.
#[inline(always)]
fn three(plane: &[f32], y: usize, w: usize) -> (&[f32], &[f32], &[f32]) {
    (&plane[(y - 1) * w..][..w], &plane[y * w..][..w], &plane[(y + 1) * w..][..w])
}

/// Adds a row of `H^2 + slope grad grad'` of a channel. The outermost rows and columns take the curvature of those within.
#[inline(always)]
fn products(u: &[f32], matrix: &mut [Vec<f32>; 3], (y, h, w): (usize, usize, usize), slope: f32) {
    let [p, q, r] = matrix;
    let (p, q, r) = (&mut p[y * w..][..w], &mut q[y * w..][..w], &mut r[y * w..][..w]);
    let middle = if h > 2 { y.clamp(1, h - 2) } else { y };
    let up = &u[middle.saturating_sub(1) * w..][..w];
    let mid = &u[middle * w..][..w];
    let down = &u[(middle + 1).min(h - 1) * w..][..w];
    let tall = if h > 2 { 1.0 } else { 0.0 };
    if w > 2 {
        let n = w - 2;
        let [(u0, u1, u2), (m0, m1, m2), (d0, d1, d2)] =
            [up, mid, down].map(|row| (&row[..n], &row[1..][..n], &row[2..][..n]));
        let (p, q, r) = (&mut p[1..][..n], &mut q[1..][..n], &mut r[1..][..n]);
        for x in 0..n {
            let around = [[u0[x], u1[x], u2[x]], [m0[x], m1[x], m2[x]], [d0[x], d1[x], d2[x]]];
            let [xx, xy, yy] = product(around, m1[x], [1.0, tall], slope);
            p[x] += xx;
            q[x] += xy;
            r[x] += yy;
        }
    }
    for x in if w > 1 { 0..2 } else { 0..1 } {
        let x = x * (w - 1);
        let (centre, wide) = if w > 2 { (x.clamp(1, w - 2), 1.0) } else { (x, 0.0) };
        let (left, right) = (centre.saturating_sub(1), (centre + 1).min(w - 1));
        let mut around = [up, mid, down].map(|row| [row[left], row[x], row[right]]);
        around[1][1] = mid[centre];
        let [xx, xy, yy] = product(around, mid[x], [wide, tall], slope);
        p[x] += xx;
        q[x] += xy;
        r[x] += yy;
    }
}

/// The entries of `H^2 + slope grad grad'`, from the pixels around the middle one. Down the column, `own` takes the middle's place.
#[inline(always)]
fn product([up, mid, down]: [[f32; 3]; 3], own: f32, [wide, tall]: [f32; 2], slope: f32) -> [f32; 3] {
    let xx = wide * (mid[0] - 2.0 * mid[1] + mid[2]);
    let yy = tall * (up[1] - 2.0 * own + down[1]);
    let xy = 0.25 * (down[2] - down[0] - up[2] + up[0]);
    let (gx, gy) = (0.5 * (mid[2] - mid[0]), 0.5 * (down[1] - up[1]));
    [
        xx * xx + xy * xy + slope * gx * gx,
        xy * (xx + yy) + slope * gx * gy,
        yy * yy + xy * xy + slope * gy * gy,
    ]
}

/// A separable blur; beyond the border the outermost pixel goes on.
#[inline(always)]
fn blur(plane: &mut [f32], between: &mut [f32], taps: &[f32; REACH + 1], h: usize, w: usize) {
    for (y, to) in between.chunks_exact_mut(w).enumerate() {
        let row = |y: usize| &plane[y.min(h - 1) * w..][..w];
        scaled(to, row(y), taps[0]);
        for k in 1..=REACH {
            add_both(to, (row(y.saturating_sub(k)), row(y + k)), taps[k]);
        }
    }
    for (from, to) in between.chunks_exact(w).zip(plane.chunks_exact_mut(w)) {
        let n = w.saturating_sub(2 * REACH);
        let inner = if n > 0 { REACH..w - REACH } else { 0..0 };
        for x in (0..inner.start).chain(inner.end..w) {
            let at = |k: usize| from[x.saturating_sub(k)] + from[(x + k).min(w - 1)];
            to[x] = taps[0] * from[x] + (1..=REACH).map(|k| taps[k] * at(k)).sum::<f32>();
        }
        let to = &mut to[inner.clone()];
        scaled(to, &from[inner], taps[0]);
        for k in 1..=REACH {
            add_both(to, (&from[REACH.min(w) - k.min(w)..], &from[(REACH + k).min(w)..]), taps[k]);
        }
    }
}

/// Values times a factor.
#[inline(always)]
fn scaled(to: &mut [f32], from: &[f32], factor: f32) {
    for (to, from) in to.iter_mut().zip(from) {
        *to = factor * from;
    }
}

/// Adds a multiple of the sums of two rows.
#[inline(always)]
fn add_both(to: &mut [f32], (one, other): (&[f32], &[f32]), factor: f32) {
    for ((to, one), other) in to.iter_mut().zip(one).zip(other) {
        *to += factor * (one + other);
    }
}

#[cfg(test)]
mod tests;
