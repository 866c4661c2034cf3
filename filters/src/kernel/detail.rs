//! What of an image is finer than a blur, over a small window: the signed detail, how strong it is nearby, and the range of each pixel's
//! neighbours.
//!
//! ```text
//! d = u - B(1.5) u,     s = (B(1) (d - B(1.5) d)^2)^(1/2),     r = (B(2.5) d^2)^(1/2)
//! ```
//!
//! `B(sigma)` is a Gaussian blur of `sigma` pixels, cut at two or three of them. In `d` the window continues beyond its border by point reflection,
//! `2 e - p` with `e` the outermost pixel, so that planes have no detail; elsewhere by its outermost pixels.
//!
//! Every pass is a plain loop that contracts no product and sum: all instruction sets give the same bits.
#![allow(clippy::inline_always, reason = "a body must be compiled with the instruction set of its caller")]

use super::Body;
use super::blur::half_window;
use super::extremes::{least, most, span};

/// Keeps quotients finite.
const TINY: f32 = 1e-18;
/// The most that detail and range may be, over the strength of detail around.
pub const MOST: f32 = 6.0;

/// The detail of a window; rows of each plane lie one after the other.
#[derive(Debug, Default)]
pub struct Detail {
    /// The least value of 3 x 3 pixels.
    pub low: Vec<f32>,
    /// The largest.
    pub high: Vec<f32>,
    /// `d / r`, within -6 and 6.
    pub signed: Vec<f32>,
    /// `s / r`.
    pub fine: Vec<f32>,
    /// The range of 3 x 3 pixels over `r`, at most 6.
    pub steep: Vec<f32>,
    /// The lesser of `s` and the range of 3 x 3 pixels.
    pub amplitude: Vec<f32>,
    blur: Blur,
    room: [Vec<f32>; 2],
}

/// Finds it.
#[derive(Debug)]
pub struct Measure<'a> {
    /// The window, row by row.
    pub values: &'a [f32],
    /// The pixels of a row.
    pub width: usize,
    /// What becomes of it.
    pub detail: &'a mut Detail,
}

impl Body for Measure<'_> {
    type Output = ();

    #[inline(always)]
    fn run<const FUSED: bool>(self) {
        let Self { values, width, detail } = self;
        let Detail { low, high, signed, fine, steep, amplitude, blur, room: [finest, other] } = detail;
        let (finer, near, around) = (half_window::<5>(1.5), half_window::<4>(1.0), half_window::<7>(2.5));
        for plane in [&mut *low, high, signed, fine, steep, amplitude, finest, other] {
            plane.resize(values.len(), 0.0);
        }
        extremes(values, width, other, low, least);
        extremes(values, width, other, high, most);
        blur.run(values, width, &finer, true, other);
        for ((signed, value), smooth) in signed.iter_mut().zip(values).zip(&*other) {
            *signed = value - smooth;
        }
        blur.run(signed, width, &finer, false, other);
        for ((finest, signed), smooth) in finest.iter_mut().zip(&*signed).zip(&*other) {
            let rest = signed - smooth;
            *finest = rest * rest;
        }
        blur.run(finest, width, &near, false, fine);
        for (square, signed) in finest.iter_mut().zip(&*signed) {
            *square = signed * signed;
        }
        blur.run(finest, width, &around, false, other);
        for i in 0..values.len() {
            let (near, inverse) = (fine[i].max(0.0).sqrt(), 1.0 / (other[i].max(0.0).sqrt() + TINY));
            let span = high[i] - low[i];
            amplitude[i] = least(near, span);
            fine[i] = near * inverse;
            steep[i] = least(span * inverse, MOST);
            signed[i] = most(least(signed[i] * inverse, MOST), -MOST);
        }
    }
}

/// The least or largest value of 3 x 3 pixels, of those that there are.
#[inline(always)]
fn extremes(from: &[f32], w: usize, between: &mut [f32], to: &mut [f32], pick: impl Fn(f32, f32) -> f32) {
    for (row, to) in from.chunks_exact(w).zip(between.chunks_exact_mut(w)) {
        to.copy_from_slice(row);
        for (to, left) in to[1..].iter_mut().zip(row) {
            *to = pick(*to, *left);
        }
        for (to, right) in to.iter_mut().zip(&row[1..]) {
            *to = pick(*to, *right);
        }
    }
    to.copy_from_slice(between);
    let n = from.len() - w;
    for (to, below) in to[..n].iter_mut().zip(&between[w..]) {
        *to = pick(*to, *below);
    }
    for (to, above) in to[w..].iter_mut().zip(&between[..n]) {
        *to = pick(*to, *above);
    }
}

/// The largest of some values less the least.
#[derive(Debug)]
pub struct Span<'a>(pub &'a [f32]);

impl Body for Span<'_> {
    type Output = f32;

    #[inline(always)]
    fn run<const FUSED: bool>(self) -> f32 {
        span(self.0)
    }
}

/// A separable blur and its room.
#[derive(Debug, Default)]
struct Blur {
    line: Vec<f32>,
    tall: Vec<f32>,
}

impl Blur {
    /// Blurs along rows, then along columns; beyond the border by point reflection if `reflects`, else by the outermost pixel.
    #[inline(always)]
    fn run(&mut self, from: &[f32], w: usize, taps: &[f32], reflects: bool, to: &mut [f32]) {
        let (h, reach) = (from.len() / w, taps.len() - 1);
        self.line.resize(w + 2 * reach, 0.0);
        self.tall.resize((h + 2 * reach) * w, 0.0);
        for (row, out) in from.chunks_exact(w).zip(self.tall[reach * w..].chunks_exact_mut(w)) {
            self.line[reach..][..w].copy_from_slice(row);
            for k in 1..=reach {
                let beyond = |edge: f32, within: f32| if reflects { 2.0 * edge - within } else { edge };
                self.line[reach - k] = beyond(row[0], row[k.min(w - 1)]);
                self.line[reach + w - 1 + k] = beyond(row[w - 1], row[(w - 1).saturating_sub(k)]);
            }
            weighted(&self.line, 1, taps, out);
        }
        for k in 1..=reach {
            for (edge, within, beyond) in [
                (reach, reach + k.min(h - 1), reach - k),
                (reach + h - 1, reach + (h - 1).saturating_sub(k), reach + h - 1 + k),
            ] {
                for x in 0..w {
                    let (e, p) = (self.tall[edge * w + x], self.tall[within * w + x]);
                    self.tall[beyond * w + x] = if reflects { 2.0 * e - p } else { e };
                }
            }
        }
        for (y, out) in to.chunks_exact_mut(w).enumerate() {
            weighted(&self.tall[y * w..][..(2 * reach + 1) * w], w, taps, out);
        }
    }
}

/// Sums of values `apart` from each other by their distance from the middle one.
#[inline(always)]
fn weighted(from: &[f32], apart: usize, taps: &[f32], out: &mut [f32]) {
    let (n, reach) = (out.len(), taps.len() - 1);
    let at = |k: usize| &from[k * apart..][..n];
    for (out, middle) in out.iter_mut().zip(at(reach)) {
        *out = taps[0] * middle;
    }
    for (k, tap) in taps.iter().enumerate().skip(1) {
        for ((out, before), after) in out.iter_mut().zip(at(reach - k)).zip(at(reach + k)) {
            *out += tap * (before + after);
        }
    }
}

#[cfg(test)]
mod tests;
