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
//! Every pass is a plain loop over rows that contracts no product and sum, and sums have a fixed number of lanes: all instruction sets
//! give the same bits.
#![allow(clippy::inline_always, reason = "a body must be compiled with the instruction set of its caller")]

use super::Body;

/// Lanes of sums.
const LANES: usize = 16;
/// Values that are summed in single precision.
const RUN: usize = 8 * LANES;
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
    /// At cells: the factor of the squared mixed difference. No cell is in the last row or column.
    twist: Vec<f32>,
    /// Inverse of the diagonal where pixels are free, else 0.
    inverse: Vec<f32>,
    room: [Vec<f32>; 7],
}

impl Tile {
    /// Takes on a size of one pixel or more; everything but the pixels becomes zero.
    pub fn resize(&mut self, height: usize, width: usize, channels: usize) {
        (self.height, self.width) = (height, width);
        let pixels = height * width;
        self.values.resize(channels * pixels, 0.0);
        let single = [&mut self.free, &mut self.twist, &mut self.inverse].into_iter();
        for plane in single.chain(&mut self.matrix).chain(&mut self.room) {
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
        let [smooth, other, ..] = room;
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
        let mut least = 1.0_f32;
        for ((p, q), r) in p.iter_mut().zip(q).zip(r) {
            let (half, skew) = (0.5 * (*p + *r), 0.5 * (*p - *r));
            let spread = (skew * skew + *q * *q).sqrt();
            let weight = |square: f32| (1.0 / (1.0 + square.max(0.0) * self.how.inverse)).max(self.how.floor);
            let (across, along) = (weight(half + spread), weight(half - spread));
            let (mean, turn) =
                (0.5 * (across + along), 0.5 * (across - along) / spread.max(f32::MIN_POSITIVE));
            (*p, *q, *r) = (mean + turn * skew, turn * *q, mean - turn * skew);
            least = least.min(across);
        }
        least
    }
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
    let mut add = |x: usize, left: usize, centre: usize, right: usize, wide: f32| {
        let xx = wide * (mid[left] - 2.0 * mid[centre] + mid[right]);
        let yy = tall * (up[x] - 2.0 * mid[x] + down[x]);
        let xy = 0.25 * (down[right] - down[left] - up[right] + up[left]);
        let (gx, gy) = (0.5 * (mid[right] - mid[left]), 0.5 * (down[x] - up[x]));
        p[x] += xx * xx + xy * xy + slope * gx * gx;
        q[x] += xy * (xx + yy) + slope * gx * gy;
        r[x] += yy * yy + xy * xy + slope * gy * gy;
    };
    for x in 1..w.max(1) - 1 {
        add(x, x - 1, x, x + 1, 1.0);
    }
    if w > 2 {
        add(0, 0, 1, 2, 1.0);
        add(w - 1, w - 3, w - 2, w - 1, 1.0);
    } else {
        (0..w).for_each(|x| add(x, 0, x, w - 1, 0.0));
    }
}

/// A separable blur; beyond the border the outermost pixel goes on.
#[inline(always)]
fn blur(plane: &mut [f32], between: &mut [f32], taps: &[f32; REACH + 1], h: usize, w: usize) {
    for y in 0..h {
        let row = |y: usize| &plane[y.min(h - 1) * w..][..w];
        let rows: [(&[f32], &[f32]); REACH + 1] =
            std::array::from_fn(|k| (row(y.saturating_sub(k)), row(y + k)));
        for (x, out) in between[y * w..][..w].iter_mut().enumerate() {
            let mut sum = taps[0] * rows[0].0[x];
            for k in 1..=REACH {
                sum += taps[k] * (rows[k].0[x] + rows[k].1[x]);
            }
            *out = sum;
        }
    }
    for (from, to) in between.chunks_exact(w).zip(plane.chunks_exact_mut(w)) {
        let inner = if w > 2 * REACH { REACH..w - REACH } else { 0..0 };
        for x in (0..inner.start.min(w)).chain(inner.end..w) {
            let at = |k: usize| from[x.saturating_sub(k)] + from[(x + k).min(w - 1)];
            to[x] = taps[0] * from[x] + (1..=REACH).map(|k| taps[k] * at(k)).sum::<f32>();
        }
        for x in inner {
            let mut sum = taps[0] * from[x];
            for k in 1..=REACH {
                sum += taps[k] * (from[x - k] + from[x + k]);
            }
            to[x] = sum;
        }
    }
}

/// Solves for the free pixels of every channel, starting from what is there.
#[derive(Debug)]
pub struct Solve<'a> {
    /// The tile, whose matrices are known.
    pub tile: &'a mut Tile,
    /// Steps at most.
    pub steps: usize,
    /// The residual, over what it is at first, at which a channel ends.
    pub tolerance: f64,
}

impl Body for Solve<'_> {
    /// The most steps that a channel took, and the largest residual over what it was.
    type Output = (usize, f64);
    #[inline(always)]
    fn run<const FUSED: bool>(self) -> (usize, f64) {
        let Tile { height, width, values, free, matrix, twist, inverse, room } = self.tile;
        let size = (*height, *width);
        twists(matrix, twist, size);
        diagonal(matrix, twist, inverse, size);
        for (inverse, free) in inverse.iter_mut().zip(free) {
            *inverse = if *inverse > 0.0 { *free / *inverse } else { 0.0 };
        }
        let [residual, direction, image, room @ ..] = room;
        let (mut steps, mut left) = (0, 0.0_f64);
        for x in values.chunks_exact_mut(size.0 * size.1) {
            apply(x, matrix, twist, image, room, size);
            for (((r, d), o), m) in residual.iter_mut().zip(&mut *direction).zip(&*image).zip(&*inverse) {
                *r = -o;
                *d = *r * m;
            }
            let first = dot(residual, direction);
            let (mut rest, mut step) = (first, 0);
            while step < self.steps && rest > self.tolerance * self.tolerance * first {
                apply(direction, matrix, twist, image, room, size);
                let alpha = rest / dot(direction, image);
                if !alpha.is_finite() {
                    break;
                }
                advance(x, residual, direction, image, alpha as f32);
                for ((z, r), m) in image.iter_mut().zip(&*residual).zip(&*inverse) {
                    *z = r * m;
                }
                let now = dot(residual, image);
                let beta = (now / rest) as f32;
                for (d, z) in direction.iter_mut().zip(&*image) {
                    *d = z + beta * *d;
                }
                rest = now;
                step += 1;
            }
            steps = steps.max(step);
            left = left.max(if first > 0.0 { (rest / first).sqrt() } else { 0.0 });
        }
        (steps, left)
    }
}

/// A step along a direction.
#[inline(always)]
fn advance(x: &mut [f32], residual: &mut [f32], direction: &[f32], image: &[f32], alpha: f32) {
    for ((x, r), (d, o)) in x.iter_mut().zip(residual).zip(direction.iter().zip(image)) {
        *x += alpha * d;
        *r -= alpha * o;
    }
}

/// A sum of products.
#[inline(always)]
fn dot(a: &[f32], b: &[f32]) -> f64 {
    let mut all = 0.0;
    for (a, b) in a.chunks(RUN).zip(b.chunks(RUN)) {
        let mut sums = [0.0_f32; LANES];
        for (a, b) in a.chunks(LANES).zip(b.chunks(LANES)) {
            for ((sum, a), b) in sums.iter_mut().zip(a).zip(b) {
                *sum += a * b;
            }
        }
        all += f64::from(sums.iter().sum::<f32>());
    }
    all
}

/// The factor of each cell's squared mixed difference, from the pixels at its corners.
#[inline(always)]
fn twists([p, q, r]: &[Vec<f32>; 3], twist: &mut [f32], (h, w): (usize, usize)) {
    for i in (0..h - 1).flat_map(|y| y * w..y * w + w - 1) {
        let both = |k: usize| p[k] * r[k] + q[k] * q[k];
        twist[i] = 0.5 * ((both(i) + both(i + 1)) + (both(i + w) + both(i + w + 1)));
    }
}

/// The diagonal of half of the energy's Hessian; at the border without products of different derivatives, which cancel elsewhere.
#[inline(always)]
fn diagonal([p, q, r]: &[Vec<f32>; 3], twist: &[f32], out: &mut [f32], (h, w): (usize, usize)) {
    out.fill(0.0);
    for (y, x) in (0..h).flat_map(|y| (0..w).map(move |x| (y, x))) {
        let i = y * w + x;
        let (wide, tall) = (x > 0 && x + 1 < w, y > 0 && y + 1 < h);
        for (inside, beside, root) in [(wide, 1, p[i]), (tall, w, r[i])] {
            if !inside {
                continue;
            }
            let square = root * root;
            out[i - beside] += square;
            out[i] += 4.0 * square;
            out[i + beside] += square;
        }
        if wide && tall {
            out[i] += 8.0 * q[i] * q[i];
        }
    }
    for i in (0..h - 1).flat_map(|y| y * w..y * w + w - 1) {
        for corner in [i, i + 1, i + w, i + w + 1] {
            out[corner] += twist[i];
        }
    }
}

/// Half of the energy's gradient at `u`.
#[inline(always)]
fn apply(
    u: &[f32],
    matrix: &[Vec<f32>; 3],
    twist: &[f32],
    out: &mut [f32],
    room: &mut [Vec<f32>],
    (h, w): (usize, usize),
) {
    let [xx, yy, e, mixed] = room else { return };
    for y in 0..h - 1 {
        let n = w - 1;
        let ([a, b], [c, d]) = (pair(u, y, w), pair(u, y + 1, w));
        let row = &mut mixed[y * w..][..n];
        for x in 0..n {
            row[x] = (d[x] - c[x]) - (b[x] - a[x]);
        }
    }
    for y in 0..h {
        let i = y * w;
        let above = if y > 0 { i - w } else { (h - 1) * w };
        // Beyond the first and the last row the image goes on as it is, and its differences do not count.
        let tall = y > 0 && y + 1 < h;
        let beside = if tall { [i - w, i + w] } else { [i, i] };
        let rows = [&u[i..][..w], &u[beside[0]..][..w], &u[beside[1]..][..w]];
        let matrix = [0, 1, 2].map(|k: usize| &matrix[k][i..][..w]);
        let mixed = [&mixed[above..][..w], &mixed[i..][..w]];
        let out = [&mut xx[i..][..w], &mut yy[i..][..w], &mut e[i..][..w]];
        pull_row(rows, matrix, mixed, out, f32::from(u8::from(tall)));
    }
    for y in 0..h - 1 {
        let ([e0, e1], [e2, e3]) = (pair(e, y, w), pair(e, y + 1, w));
        for ((((mixed, twist), (e0, e1)), e2), e3) in
            mixed[y * w..][..w - 1].iter_mut().zip(&twist[y * w..]).zip(e0.iter().zip(e1)).zip(e2).zip(e3)
        {
            *mixed = (e0 + e1) + (e2 + e3) + twist * *mixed;
        }
    }
    for y in 0..h {
        gather(y, out, [xx, yy, mixed], (h, w));
    }
}

/// Of row `y`, all pixels but the last, and all but the first.
#[inline(always)]
fn pair(plane: &[f32], y: usize, w: usize) -> [&[f32]; 2] {
    [&plane[y * w..][..w - 1], &plane[y * w + 1..][..w - 1]]
}

/// What a row's second derivatives pull with, along rows and columns, and its share in the pull of the cells around.
#[inline(always)]
fn pull_row(
    [mid, up, down]: [&[f32]; 3],
    [p, q, r]: [&[f32]; 3],
    [above, below]: [&[f32]; 2],
    [xx, yy, e]: [&mut [f32]; 3],
    tall: f32,
) {
    let w = mid.len();
    if w > 2 {
        let n = w - 2;
        let (left, centre, right) = (&mid[..n], &mid[1..][..n], &mid[2..][..n]);
        let (up, down) = (&up[1..][..n], &down[1..][..n]);
        let (p, q, r) = (&p[1..][..n], &q[1..][..n], &r[1..][..n]);
        let (a0, a1, b0, b1) = (&above[..n], &above[1..][..n], &below[..n], &below[1..][..n]);
        let (xx, yy, e) = (&mut xx[1..][..n], &mut yy[1..][..n], &mut e[1..][..n]);
        for x in 0..n {
            let dxx = (left[x] - centre[x]) + (right[x] - centre[x]);
            let dyy = tall * ((up[x] - centre[x]) + (down[x] - centre[x]));
            let (square, half) = (q[x] * q[x], 0.5 * q[x]);
            let twist = half * ((a0[x] + a1[x]) + (b0[x] + b1[x]));
            let (px, ry) = (p[x] * dxx, r[x] * dyy);
            xx[x] = p[x] * (px + twist) + square * dyy;
            yy[x] = tall * (r[x] * (ry + twist) + square * dxx);
            e[x] = half * (px + ry);
        }
    }
    for x in if w > 1 { [0, w - 1] } else { [0, 0] } {
        let dyy = tall * ((up[x] - mid[x]) + (down[x] - mid[x]));
        let before = x.checked_sub(1).map_or(0.0, |x| above[x] + below[x]);
        let twist = 0.5 * q[x] * (before + (above[x] + below[x]));
        xx[x] = 0.0;
        yy[x] = tall * r[x] * (r[x] * dyy + twist);
        e[x] = 0.5 * q[x] * r[x] * dyy;
    }
}

/// A row of all pulls, of pixels and of cells, at the pixels that they reach.
#[inline(always)]
fn gather(y: usize, out: &mut [f32], planes: [&[f32]; 3], (h, w): (usize, usize)) {
    // Pulls along columns are zero in the first and the last row, those of cells in the last row.
    let before = if y > 0 { y - 1 } else { h - 1 };
    let [xx, yy, below] = planes.map(|plane| &plane[y * w..][..w]);
    let [_, up, above] = planes.map(|plane| &plane[before * w..][..w]);
    let down = &planes[1][(y + 1) % h * w..][..w];
    let out = &mut out[y * w..][..w];
    if w > 2 {
        let n = w - 2;
        let [yy, up, down] = [yy, up, down].map(|row| &row[1..][..n]);
        let (left, centre, right) = (&xx[..n], &xx[1..][..n], &xx[2..][..n]);
        let (a0, a1, b0, b1) = (&above[..n], &above[1..][..n], &below[..n], &below[1..][..n]);
        let out = &mut out[1..][..n];
        for x in 0..n {
            let along = (left[x] - centre[x]) + (right[x] - centre[x]);
            let across = (up[x] - yy[x]) + (down[x] - yy[x]);
            out[x] = (along + across) + ((a0[x] - a1[x]) + (b1[x] - b0[x]));
        }
    }
    for x in if w > 1 { [0, w - 1] } else { [0, 0] } {
        let across = (up[x] - yy[x]) + (down[x] - yy[x]);
        let along = x.checked_sub(1).map_or(0.0, |x| xx[x]) + xx.get(x + 1).copied().unwrap_or(0.0);
        let corner = x.checked_sub(1).map_or(0.0, |x| above[x] - below[x]);
        out[x] = (along + across) + (corner + (below[x] - above[x]));
    }
}

#[cfg(test)]
mod tests;
