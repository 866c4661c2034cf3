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
//! `s` is enlarged bilinearly. It is next to nothing where small pixels resolve the image, as third differences vanish beside the others
//! there, and the spline is right; at a hard edge it is nearly 1. `n` and `w` are found once, in `x0`. What the steps change of the means
//! is put back by the spline, so that `R x` is what it was: to rounding at whole factors, at broken ones to what pixels blur that straddle
//! two. Everything is in proportion to the image: twice the light gives twice the result. Constants and ramps stay.
//!
//! Boundary: no corner, no flux; beyond the outermost corners `B` repeats them. An image of one row or column stays as it is.
//! The steps are in `kernel/diffusion.rs`, `s` is in this file. Stable: the largest eigenvalue of a step's operator is 4 w <= 4, and
//! 4 TAU < 2. What overshoots is for `settle`.
//! Cost: about 130 flops a pixel, one plane; two maps of the spline's kind. Each pixel depends on those within 7 rows and columns.
//! Fails: a line that crosses an edge loses contrast where it does.
//!
//! Sources: J. Weickert, "Coherence-enhancing diffusion filtering", International Journal of Computer Vision 31, 1999 (the tensor);
//! M. Welk, J. Weickert, G. Steidl, "From tensor-driven diffusion to anisotropic wavelet shrinkage", ECCV 2006 (differences at corners).

use lacuna_core::parallel::prelude::*;

use crate::Plane;

/// Third differences over the lower ones at which an image is half resolved.
const SMOOTH: f32 = 0.1;

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

#[cfg(test)]
#[path = "edges/tests.rs"]
mod tests;
