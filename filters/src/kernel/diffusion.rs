//! Diffusion along edges: explicit steps of a tensor that is found once, in bands of rows. [`crate::upscale`] (`edges.rs`) has the formulas.
//!
//! Boundary: no corner between pixels, no flux; beyond the outermost corners the binomial repeats them. Each pixel depends on those within
//! `STEPS + REACH + 1` rows and columns. Cost: about 130 flops a pixel.

use std::ops::Range;

use lacuna_core::parallel::prelude::*;

use super::{Body, Isa, dispatch};
use crate::Plane;

/// Steps of diffusion.
const STEPS: usize = 4;
/// Their length.
const TAU: f32 = 0.4;
/// Slope a pixel, as a part of the light around, at which edges begin to count.
const KNEE: f32 = 0.03;
/// The binomial.
const BINOMIAL: [f32; 5] = [1.0 / 16.0, 0.25, 0.375, 0.25, 1.0 / 16.0];
/// Corners on either side that it reaches.
const REACH: usize = 2;
/// Rows that one task takes.
const BAND: usize = 64;
/// Lines of products: the three entries of the structure tensor, and the light.
const LINES: usize = 4;

/// The image after the steps; `share` is what each pixel's weight is multiplied by.
/// Rows that are begun when `is_over` stay as they are.
pub fn smooth(image: &Plane, share: &Plane, is_over: &(dyn Fn() -> bool + Sync)) -> Plane {
    let size = image.size();
    let mut out = image.clone();
    if size.height < 2 || size.width < 2 {
        return out;
    }
    let isa = Isa::best();
    out.pixels_mut().par_chunks_mut(BAND * size.width).enumerate().for_each(|(band, out)| {
        let from = band * BAND;
        let rows = from..from + out.len() / size.width;
        if !is_over() {
            dispatch(isa, Steps { image, share, rows, out });
        }
    });
    out
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
mod tests;
