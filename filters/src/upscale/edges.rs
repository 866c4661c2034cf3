//! Edges without steps: a few steps of diffusion along them, after the spline of means.
//!
//! A spline of means keeps the steps that a slanted edge has in large pixels, and the noise of the few samples that each pixel of the edge
//! is the mean of. Both change along the edge, where the image does not. Given the spline `x0` (`H x W`), differences
//! `g = (g_x, g_y)` and means `m` of the 2 x 2 pixels around each of the `(H - 1) x (W - 1)` corners between pixels,
//!
//! ```text
//! J = B [g g'],  e = B [m^2]          B: the binomial (1 4 6 4 1) / 16 along both axes
//! d x / d t = div (w n n' grad x)     n: the eigenvector of J's smaller eigenvalue: along the edge
//! w = s c mu / (mu + KNEE^2 e)        mu: the larger eigenvalue; c = (mu - mu') / (mu + mu'): how much of an edge it is
//! s = d3 / (d3 + SMOOTH (d1 + d2))    dk: squared k-th differences of the small pixels, both axes, binomial 3 x 3 means
//! x = u + S (R x0 - R u)              u: after STEPS explicit steps of TAU; S: the spline of means
//! ```
//!
//! `s` is enlarged in straight lines. It is next to nothing where small pixels resolve the image, third differences vanish beside the others,
//! and the spline is right; at a hard edge it is nearly 1. `n` and `w` are found once, in `x0`. What the steps change of the means is put back by the spline, so that `R x` is what it was: to
//! rounding at whole factors, at broken ones to what pixels blur that straddle two. Everything is in proportion to the
//! image: twice the light gives twice the result. Constants and ramps stay.
//!
//! Boundary: no corner, no flux; beyond the outermost corners `B` repeats them. An image of one row or column stays as it is.
//! Stable: the largest eigenvalue of a step's operator is 4 w <= 4, and 4 TAU < 2. What overshoots is for [`super::settle`].
//! Cost: about 130 flops a pixel, one plane; two maps of the spline's kind. Each pixel depends on those within 7 rows and columns.
//! Fails: a line that crosses an edge loses contrast where it does.
//!
//! Sources: J. Weickert, "Coherence-enhancing diffusion filtering", International Journal of Computer Vision 31, 1999 (the tensor);
//! M. Welk, J. Weickert, G. Steidl, "From tensor-driven diffusion to anisotropic wavelet shrinkage", ECCV 2006 (differences at corners).

#![allow(clippy::inline_always, reason = "a body must be compiled with the instruction set of its caller")]

use std::ops::Range;

use lacuna_core::parallel::prelude::*;

use crate::Plane;
use crate::kernel::{Body, Isa, dispatch};

/// Steps of diffusion.
const STEPS: usize = 4;
/// Their length.
const TAU: f32 = 0.4;
/// Slope a pixel, as a part of the light around, at which edges begin to count.
const KNEE: f32 = 0.03;
/// Third differences over the lower ones at which an image is half resolved.
const SMOOTH: f32 = 0.1;
/// The binomial.
const BINOMIAL: [f32; 5] = [1.0 / 16.0, 0.25, 0.375, 0.25, 1.0 / 16.0];
/// Corners on either side that it reaches.
const REACH: usize = 2;
/// Rows that one task takes.
const BAND: usize = 64;
/// Lines of products: the three entries of J, and the light.
const LINES: usize = 4;

/// The image after the steps, means not put back; `share` is `s`, in pixels of the image.
pub(super) fn smooth(image: &Plane, share: &Plane) -> Plane {
    let size = image.size();
    let mut out = image.clone();
    if size.height < 2 || size.width < 2 {
        return out;
    }
    let isa = Isa::best();
    out.pixels_mut().par_chunks_mut(BAND * size.width).enumerate().for_each(|(band, out)| {
        let from = band * BAND;
        let rows = from..from + out.len() / size.width;
        dispatch(isa, Steps { image, share, rows, out });
    });
    out
}

/// `s`: 0 where small pixels resolve the image, 1 where they do not.
pub(super) fn unresolved(samples: &Plane) -> Plane {
    let size = samples.size();
    let mut third = Plane::filled(size, 0.0);
    let mut lower = third.clone();
    let rows =
        third.pixels_mut().par_chunks_mut(size.width).zip(lower.pixels_mut().par_chunks_mut(size.width));
    rows.enumerate().for_each(|(y, (third, lower))| {
        let lines: [Vec<f32>; 5] = [0, 1, 2, 3, 4].map(|k| {
            let (at, edge) = beyond(y + k, size.height);
            let (row, edge) = (samples.row(at), edge.map(|edge| samples.row(edge)));
            edge.map_or_else(|| row.to_vec(), |edge| edge.iter().zip(row).map(|(e, v)| 2.0 * e - v).collect())
        });
        let own = samples.row(y);
        let value = |x: usize| {
            let (at, edge) = beyond(x, size.width);
            edge.map_or(own[at], |edge| 2.0 * own[edge] - own[at])
        };
        let wide: Vec<f32> = (0..size.width + 4).map(value).collect();
        energies([0, 1, 2, 3, 4].map(|k| &lines[k][..]), third, lower);
        energies([0, 1, 2, 3, 4].map(|k| &wide[k..][..size.width]), third, lower);
    });
    let mut out = Plane::filled(size, 0.0);
    out.pixels_mut().par_chunks_mut(size.width).enumerate().for_each(|(y, out)| {
        let (above, below) = (y.saturating_sub(1), (y + 1).min(size.height - 1));
        let [third, lower] = [&third, &lower].map(|plane| {
            let rows = plane.row(above).iter().zip(plane.row(y)).zip(plane.row(below));
            rows.map(|((above, own), below)| (above + below) + 2.0 * own).collect::<Vec<f32>>()
        });
        let mean =
            |line: &[f32], x: usize| line[x.max(1) - 1] + 2.0 * line[x] + line[(x + 1).min(line.len() - 1)];
        for (x, out) in out.iter_mut().enumerate() {
            let (third, lower) = (mean(&third, x), mean(&lower, x));
            let share = third / (third + SMOOTH * lower + f32::MIN_POSITIVE);
            *out = if share.is_finite() { share } else { 0.0 };
        }
    });
    out
}

/// The pixel that is `at - 2`; beyond the border its mirror image, and the pixel at the border, about which it is turned.
fn beyond(at: usize, count: usize) -> (usize, Option<usize>) {
    let last = count - 1;
    if at < 2 {
        ((2 - at).min(last), Some(0))
    } else if at - 2 > last {
        (last - (at - 2 - last).min(last), Some(last))
    } else {
        (at - 2, None)
    }
}

/// Adds the squared differences of lines of pixels one after the other.
fn energies([a, b, c, d, e]: [&[f32]; 5], third: &mut [f32], lower: &mut [f32]) {
    let count = third.len();
    let (a, b, c, d, e) = (&a[..count], &b[..count], &c[..count], &d[..count], &e[..count]);
    let lower = &mut lower[..count];
    for x in 0..count {
        let (before, after) = (c[x] - b[x], d[x] - c[x]);
        let (bend, twist) = (after - before, 0.5 * (e[x] - a[x]) - (d[x] - b[x]));
        lower[x] += 0.5 * (before * before + after * after) + bend * bend;
        third[x] += twist * twist;
    }
}

/// All steps on some rows, from an image that has them and those around.
struct Steps<'a> {
    image: &'a Plane,
    share: &'a Plane,
    rows: Range<usize>,
    out: &'a mut [f32],
}

impl Body for Steps<'_> {
    type Output = ();

    #[inline(always)]
    fn run<const FUSED: bool>(self) {
        let Self { image, share, rows, out } = self;
        let (height, width) = (image.size().height, image.size().width);
        // Each step is wrong one row further in from where rows are left out.
        let (top, end) = (rows.start.saturating_sub(STEPS), height.min(rows.end + STEPS));
        let [across, down] = along((image, share), top..end - 1);
        let mut now = image.pixels()[top * width..end * width].to_vec();
        let mut next = now.clone();
        // What corners above and below give; the outermost stay zero.
        let mut flux = [(); 4].map(|()| vec![0.0_f32; width + 1]);
        for _ in 0..STEPS {
            let [above, crossed, below, crossing] = &mut flux;
            above.fill(0.0);
            crossed.fill(0.0);
            for (row, out) in next.chunks_exact_mut(width).enumerate() {
                let own = &now[row * width..][..width];
                if let Some(under) = now.get((row + 1) * width..(row + 2) * width) {
                    let at = row * (width - 1)..(row + 1) * (width - 1);
                    let field = (&across[at.clone()], &down[at]);
                    fluxes((own, under), field, &mut below[1..width], &mut crossing[1..width]);
                } else {
                    below.fill(0.0);
                    crossing.fill(0.0);
                }
                let gained = below[1..].iter().zip(&crossing[..width]);
                let lost = above[..width].iter().zip(&crossed[1..]);
                for (((out, own), (right, left)), (before, after)) in
                    out.iter_mut().zip(own).zip(gained).zip(lost)
                {
                    *out = own + ((right + left) - (before + after));
                }
                std::mem::swap(above, below);
                std::mem::swap(crossed, crossing);
            }
            std::mem::swap(&mut now, &mut next);
        }
        out.copy_from_slice(&now[(rows.start - top) * width..][..out.len()]);
    }
}

/// What the corners between two rows give to the pixels above them: on their left, and on their right. Those below lose it crosswise.
#[inline(always)]
fn fluxes(
    (upper, lower): (&[f32], &[f32]),
    (across, down): (&[f32], &[f32]),
    left: &mut [f32],
    right: &mut [f32],
) {
    let count = left.len();
    let (a, b) = (&upper[..count], &upper[1..][..count]);
    let (c, d) = (&lower[..count], &lower[1..][..count]);
    let (across, down, right) = (&across[..count], &down[..count], &mut right[..count]);
    for x in 0..count {
        // Half the differences, and half of them again where their flux is shared.
        let (one, other) = (d[x] - a[x], b[x] - c[x]);
        let (x_slope, y_slope) = (one + other, one - other);
        let (n_x, n_y) = (across[x], down[x]);
        let flux = (0.25 * TAU) * (n_x * x_slope + n_y * y_slope);
        // Where nothing counts, differences may have overflowed.
        let counts = n_x != 0.0 || n_y != 0.0;
        left[x] = if counts { flux * (n_x + n_y) } else { 0.0 };
        right[x] = if counts { flux * (n_y - n_x) } else { 0.0 };
    }
}

/// `sqrt(w) n` at the corners below some rows of pixels: components along rows and along columns.
#[inline(always)]
fn along((image, share): (&Plane, &Plane), rows: Range<usize>) -> [Vec<f32>; 2] {
    let (last, count) = (image.size().height - 2, image.size().width - 1);
    let mut ring = [(); 2 * REACH + 1].map(|()| vec![0.0_f32; LINES * count]);
    let mut raw = vec![0.0_f32; LINES * (count + 2 * REACH)];
    let mut sums = vec![0.0_f32; LINES * count];
    let mut field = [(); 2].map(|()| vec![0.0_f32; rows.len() * count]);
    let mut known = rows.start.saturating_sub(REACH);
    for (at, row) in rows.enumerate() {
        while known <= last.min(row + REACH) {
            products((image.row(known), image.row(known + 1)), &mut raw, &mut ring[known % (2 * REACH + 1)]);
            known += 1;
        }
        sums.fill(0.0);
        for (tap, weight) in BINOMIAL.iter().enumerate() {
            let line = &ring[(row + tap).saturating_sub(REACH).min(last) % (2 * REACH + 1)];
            sums.iter_mut().zip(line).for_each(|(sum, value)| *sum += weight * value);
        }
        let [across, down] = &mut field;
        let place = at * count..(at + 1) * count;
        let shares = (share.row(row), share.row(row + 1));
        direction(&sums, shares, &mut across[place.clone()], &mut down[place]);
    }
    field
}

/// The products of a row of corners, smoothed along it.
#[inline(always)]
fn products((upper, lower): (&[f32], &[f32]), raw: &mut [f32], out: &mut [f32]) {
    let count = upper.len() - 1;
    let padded = count + 2 * REACH;
    let (a, b) = (&upper[..count], &upper[1..][..count]);
    let (c, d) = (&lower[..count], &lower[1..][..count]);
    let (squares, rest) = raw.split_at_mut(padded);
    let (mixed, rest) = rest.split_at_mut(padded);
    let (others, light) = rest.split_at_mut(padded);
    let [squares_in, mixed_in, others_in, light_in] =
        [&mut *squares, mixed, others, light].map(|line| &mut line[REACH..][..count]);
    for x in 0..count {
        let (one, other) = (d[x] - a[x], b[x] - c[x]);
        let (x_slope, y_slope) = (0.5 * (one + other), 0.5 * (one - other));
        let mean = 0.25 * ((a[x] + b[x]) + (c[x] + d[x]));
        squares_in[x] = x_slope * x_slope;
        mixed_in[x] = x_slope * y_slope;
        others_in[x] = y_slope * y_slope;
        light_in[x] = mean * mean;
    }
    for (line, out) in raw.chunks_exact_mut(padded).zip(out.chunks_exact_mut(count)) {
        let (first, end) = (line[REACH], line[REACH + count - 1]);
        line[..REACH].fill(first);
        line[REACH + count..].fill(end);
        let [p, q, r, s, t] = [0, 1, 2, 3, 4].map(|tap| &line[tap..][..count]);
        for x in 0..count {
            out[x] = BINOMIAL[0] * (p[x] + t[x]) + BINOMIAL[1] * (q[x] + s[x]) + BINOMIAL[2] * r[x];
        }
    }
}

/// `sqrt(w) n` from a row of smoothed products.
#[inline(always)]
fn direction(sums: &[f32], (upper, lower): (&[f32], &[f32]), across: &mut [f32], down: &mut [f32]) {
    let count = across.len();
    let [squares, mixed, others, light] = [0, 1, 2, 3].map(|line| &sums[line * count..][..count]);
    let down = &mut down[..count];
    let (a, b) = (&upper[..count], &upper[1..][..count]);
    let (c, d) = (&lower[..count], &lower[1..][..count]);
    for x in 0..count {
        let share = 0.25 * ((a[x] + b[x]) + (c[x] + d[x]));
        let mean = 0.5 * (squares[x] + others[x]) + f32::MIN_POSITIVE;
        // Parts of the mean eigenvalue, so that nothing is squared twice.
        let (tilt, skew) = (0.5 * (squares[x] - others[x]) / mean, mixed[x] / mean);
        let edge = (tilt * tilt + skew * skew).sqrt();
        let weight = share * edge * (1.0 + edge) / (1.0 + edge + KNEE * KNEE * (light[x] / mean));
        let level = tilt / edge.max(f32::MIN_POSITIVE);
        let n_x = (weight * (0.5 - 0.5 * level).max(0.0)).sqrt();
        let n_y = (weight * (0.5 + 0.5 * level).max(0.0)).sqrt().copysign(-skew);
        // Squares that overflowed say nothing.
        let known = mean < f32::MAX && light[x] < f32::MAX && weight < 2.0;
        across[x] = if known { n_x } else { 0.0 };
        down[x] = if known { n_y } else { 0.0 };
    }
}

#[cfg(test)]
#[path = "edges/tests.rs"]
mod tests;
