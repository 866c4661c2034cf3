//! Makes a dual variable nearly free of divergence at missing pixels, so that its bound is close.
//!
//! Four rounds; each takes away the divergence by a few conjugate-gradient steps of the Poisson problem
//! `grad* grad phi = grad* q` with `phi = 0` at measured pixels, subtracts `grad phi` and clips to the ball again.
//! Any `phi` gives a valid bound, so the problem is cut into bands of rows with `phi = 0` on their first row; odd
//! rounds shift the bands by half. The bands belong to the method: their height changes the bound (not its truth).

use rayon::prelude::*;

use crate::Size;
use crate::kernel::tv::{
    DualBall, Isa, PrimalRow, correct_row, descend_row, direction_row, laplacian_row, source_row,
};

/// Rows of a band: four vectors of a band of 1200 columns fit the second-level cache.
const BAND: usize = 32;
/// Rounds of removing divergence and clipping.
const ROUNDS: usize = 4;
/// Curvature along a direction that counts as none.
const NEGLIGIBLE: f64 = 1e-9;
/// Tightens `(vertical, horizontal)` in place by rounds of `steps` conjugate-gradient steps and leaves it within the dual ball.
pub fn tighten<B: DualBall>(
    isa: Isa,
    size: Size,
    free: &[u8],
    steps: usize,
    vertical: &mut [f32],
    horizontal: &mut [f32],
) {
    let width = size.width;
    if width == 0 {
        return;
    }
    for round in 0..ROUNDS {
        let first = if round % 2 == 0 { BAND } else { BAND / 2 }.min(size.height);
        let (vertical_head, vertical_tail) = vertical.split_at_mut(first * width);
        let (horizontal_head, horizontal_tail) = horizontal.split_at_mut(first * width);
        let heads = rayon::iter::once((vertical_head, horizontal_head));
        let tails = vertical_tail.par_chunks_mut(BAND * width);
        let tails = tails.zip(horizontal_tail.par_chunks_mut(BAND * width));
        heads.chain(tails).enumerate().for_each(|(index, (vertical, horizontal))| {
            let start = if index == 0 { 0 } else { first + (index - 1) * BAND };
            let rows = vertical.len() / width;
            let free = &free[start * width..][..vertical.len()];
            Band { isa, width, rows, free, steps, top: start == 0, bottom: start + rows == size.height }
                .remove_divergence::<B>(vertical, horizontal);
        });
    }
}

/// Brings a dual variable back into its ball, which over-relaxation leaves a little.
pub fn clip<B: DualBall>(isa: Isa, size: Size, vertical: &mut [f32], horizontal: &mut [f32]) {
    let width = size.width.max(1);
    let zeros = vec![0.0; width];
    let rows = vertical.par_chunks_mut(width).zip(horizontal.par_chunks_mut(width));
    rows.for_each(|(vertical, horizontal)| correct_row::<B>(isa, vertical, horizontal, &zeros, &zeros));
}

/// Some rows; `top` and `bottom` say whether its edges are those of the image.
#[derive(Clone, Copy)]
struct Band<'a> {
    isa: Isa,
    width: usize,
    rows: usize,
    free: &'a [u8],
    steps: usize,
    top: bool,
    bottom: bool,
}

impl Band<'_> {
    fn remove_divergence<B: DualBall>(self, vertical: &mut [f32], horizontal: &mut [f32]) {
        let Self { isa, width, rows, .. } = self;
        let zeros = vec![0.0; width];
        let phi = self.potential(vertical, horizontal, &zeros);
        for y in 0..rows {
            let at = y * width..(y + 1) * width;
            let here = &phi[at.clone()];
            let below = if y + 1 < rows {
                &phi[(y + 1) * width..][..width]
            } else if self.bottom {
                here
            } else {
                &zeros
            };
            correct_row::<B>(isa, &mut vertical[at.clone()], &mut horizontal[at], here, below);
        }
    }

    /// The approximate solution of the Poisson problem.
    fn potential(self, vertical: &[f32], horizontal: &[f32], zeros: &[f32]) -> Vec<f32> {
        let Self { isa, width, rows, free, .. } = self;
        let at = |y: usize| y * width..(y + 1) * width;
        let first = usize::from(!self.top);
        let mut residual = vec![0.0; rows * width];
        let mut norm = 0.0;
        for y in first..rows {
            let row = PrimalRow {
                above: if y == 0 { zeros } else { &vertical[at(y - 1)] },
                vertical: &vertical[at(y)],
                horizontal: &horizontal[at(y)],
                free: &free[at(y)],
            };
            norm += source_row(isa, &mut residual[at(y)], row);
        }
        let mut phi = vec![0.0; rows * width];
        let mut direction = residual.clone();
        let mut image = vec![0.0; rows * width];
        for step in 0..self.steps {
            let mut product = 0.0;
            for y in first..rows {
                let here = &direction[at(y)];
                let above = if y == 0 { here } else { &direction[at(y - 1)] };
                let below = if y + 1 < rows {
                    &direction[at(y + 1)]
                } else if self.bottom {
                    here
                } else {
                    zeros
                };
                product += laplacian_row(isa, &mut image[at(y)], here, above, below, &free[at(y)]);
            }
            // Solved already, or lost to rounding: the Laplacian's smallest eigenvalue on a band is far above this.
            if norm < f64::from(f32::MIN_POSITIVE) || product <= NEGLIGIBLE * norm {
                break;
            }
            let alpha = (norm / product) as f32;
            let before = norm;
            norm = 0.0;
            for y in first..rows {
                let (phi, residual) = (&mut phi[at(y)], &mut residual[at(y)]);
                norm += descend_row(isa, phi, residual, &direction[at(y)], &image[at(y)], alpha);
            }
            if step + 1 < self.steps {
                let beta = (norm / before) as f32;
                for y in first..rows {
                    direction_row(isa, &mut direction[at(y)], &residual[at(y)], beta);
                }
            }
        }
        phi
    }
}
