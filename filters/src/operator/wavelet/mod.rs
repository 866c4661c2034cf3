//! The two-dimensional discrete wavelet transform `W` of any image size, its adjoint and its inverse.
//!
//! A level turns `h x w` values into an approximation and three details; the next level takes the approximation. Along a
//! line of `n` values, with filters of `f` taps, coefficient `k` of either half is `sum_j filter[j] x[2 k + c - j]`:
//!
//! - periodic: `c = f / 2`, `ceil(n / 2)` coefficients a half; an odd line repeats its last value first. Orthonormal for the
//!   orthonormal families on even lines (`W^T = W^-1`).
//! - symmetric: `c = 1`, `floor((n + f - 1) / 2)` coefficients a half, the line mirrored at its edges (the edge value
//!   twice). A frame with a few more coefficients than pixels.
//!
//! These are `periodization` and `symmetric` of `PyWavelets`, coefficient for coefficient. A line of one value is left alone.
//! The inverse is exact for every size; the adjoint equals it only where the transform is orthonormal.
//!
//! Cost: 4/3 (f + f) operations a pixel and direction. Memory: one plane of coefficients and 1.3 of scratch.
//!
//! Source: S. Mallat, "A Theory for Multiresolution Signal Decomposition: The Wavelet Representation", IEEE PAMI 11(7), 1989;
//! A. Cohen, I. Daubechies, J.-C. Feauveau, Communications on Pure and Applied Mathematics 45, 1992 (biorthogonal banks).

mod families;
mod level;
mod line;
mod taps;
#[cfg(test)]
mod tests;

pub use families::{Bank, Wavelet};
use level::Level;
use serde::Serialize;

use crate::Size;

/// What lies beyond the edges of an image.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash, Serialize)]
#[serde(rename_all = "kebab-case")]
pub enum Boundary {
    /// The opposite edge.
    #[default]
    Periodic,
    /// The mirror image, the edge pixel twice.
    Symmetric,
}

impl Boundary {
    /// The pixel of a line of `length` that stands at `index`.
    fn fold(self, index: isize, length: usize) -> usize {
        let n = length as isize;
        let folded = match self {
            // An odd line repeats its last value.
            Self::Periodic => index.rem_euclid(n + n % 2).min(n - 1),
            Self::Symmetric => {
                let index = index.rem_euclid(2 * n);
                index.min(2 * n - 1 - index)
            }
        };
        folded as usize
    }
}

/// A transform of one image size.
#[derive(Clone, Debug)]
pub struct Transform {
    size: Size,
    levels: Vec<Level>,
    orthonormal: bool,
}

/// Buffers for one transform at a time.
#[derive(Clone, Debug)]
pub struct Scratch {
    /// Rows transformed, columns not yet.
    rows: Vec<f32>,
    /// The approximation of the level above.
    coarse: Vec<f32>,
}

impl Transform {
    /// A transform over at most `levels` levels; it stops where an approximation would be a single pixel's.
    pub fn new(size: Size, wavelet: Wavelet, boundary: Boundary, levels: usize) -> Self {
        let bank = wavelet.bank();
        let (mut current, mut done) = (size, Vec::new());
        while done.len() < levels && current.height.max(current.width) > 1 && current.pixels() > 0 {
            let level = Level::new(&bank, boundary, current);
            let next = level.coarse();
            // The filters are longer than the image: a level would make more of it, not less.
            let grows = |from: usize, to: usize| from > 1 && to >= from;
            if grows(current.height, next.height) || grows(current.width, next.width) {
                break;
            }
            current = next;
            done.push(level);
        }
        let even = |level: &Level| {
            let odd = |length: usize| length > 1 && length % 2 == 1;
            !odd(level.size().height) && !odd(level.size().width)
        };
        let orthonormal = wavelet.is_orthonormal() && boundary == Boundary::Periodic && done.iter().all(even);
        Self { size, levels: done, orthonormal }
    }

    /// Number of coefficients.
    pub fn coefficients(&self) -> usize {
        let coarse = self.levels.last().map_or(self.size, Level::coarse);
        self.levels.iter().map(Level::details).sum::<usize>() + coarse.pixels()
    }

    /// Levels that the image allowed.
    pub fn levels(&self) -> usize {
        self.levels.len()
    }

    /// Whether the adjoint is the inverse.
    pub fn is_orthonormal(&self) -> bool {
        self.orthonormal
    }

    /// Buffers for the other methods.
    pub fn scratch(&self) -> Scratch {
        let rows = self.levels.iter().map(Level::row_buffer).max().unwrap_or(0);
        let coarse = self.levels.iter().map(|level| level.coarse().pixels()).max().unwrap_or(0);
        Scratch { rows: vec![0.0; rows], coarse: vec![0.0; coarse] }
    }

    /// `out = W x`: the details of level 1 (finest), 2, ..., then the last approximation.
    pub fn forward(&self, x: &[f32], out: &mut [f32], scratch: &mut Scratch) {
        let mut rest = out;
        for (index, level) in self.levels.iter().enumerate() {
            let (details, tail) = rest.split_at_mut(level.details());
            rest = tail;
            let input = if index == 0 { x } else { &scratch.coarse[..level.size().pixels()] };
            let rows = &mut scratch.rows[..level.row_buffer()];
            level.rows_forward(input, rows);
            level.columns_forward(rows, &mut scratch.coarse[..level.coarse().pixels()], details);
        }
        let coarse = if self.levels.is_empty() { x } else { &scratch.coarse[..rest.len()] };
        rest.copy_from_slice(coarse);
    }

    /// `x = W^T c`.
    pub fn adjoint(&self, c: &[f32], x: &mut [f32], scratch: &mut Scratch) {
        self.back(c, x, scratch, Level::columns_adjoint, Level::rows_adjoint);
    }

    /// `x = W^-1 c`.
    pub fn inverse(&self, c: &[f32], x: &mut [f32], scratch: &mut Scratch) {
        self.back(c, x, scratch, Level::columns_inverse, Level::rows_inverse);
    }

    fn back(
        &self,
        c: &[f32],
        x: &mut [f32],
        scratch: &mut Scratch,
        columns: fn(&Level, &[f32], &[f32], &mut [f32]),
        rows: fn(&Level, &[f32], &mut [f32]),
    ) {
        let Some(last) = self.levels.last() else {
            x.copy_from_slice(c);
            return;
        };
        let coarse = last.coarse().pixels();
        let (mut details, approximation) = c.split_at(c.len() - coarse);
        scratch.coarse[..coarse].copy_from_slice(approximation);
        for (index, level) in self.levels.iter().enumerate().rev() {
            let (rest, own) = details.split_at(details.len() - level.details());
            details = rest;
            let buffer = &mut scratch.rows[..level.row_buffer()];
            columns(level, &scratch.coarse[..level.coarse().pixels()], own, buffer);
            let target = if index == 0 { &mut *x } else { &mut scratch.coarse[..level.size().pixels()] };
            rows(level, buffer, target);
        }
    }
}
