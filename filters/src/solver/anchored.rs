//! The image whose differences are nearest to given ones, with some pixels fixed: conjugate gradients on the graph of
//! neighbours.
//!
//! Minimises `sum (x(i, j+1) - x(i, j) - g)^2 + sum (x(i+1, j) - x(i, j) - g')^2` over the free pixels; at the border there is
//! simply no difference across (a natural boundary). The preconditioner is the number of neighbours.
//!
//! Source: M. Hestenes, E. Stiefel, "Methods of conjugate gradients for solving linear systems", J. Res. NBS 49, 1952.

use lacuna_core::parallel::prelude::*;

use crate::{Run, Size};

/// Iterations at most.
const LIMIT: usize = 4000;

/// Solves for the pixels of `x` that are not `fixed`, until no correction exceeds `tolerance` in ten iterations. `right` is
/// the divergence of the differences (see [`divergence`]). Returns the iterations taken.
pub fn solve(
    size: Size,
    right: &[f64],
    fixed: &[bool],
    tolerance: f64,
    x: &mut [f64],
    run: &Run<'_>,
) -> usize {
    let mut product = vec![0.0; x.len()];
    laplacian(size, x, fixed, &mut product);
    let mut r = product.clone();
    let others = right.par_iter().zip(fixed);
    r.par_iter_mut().zip(others).for_each(|(r, (right, &fixed))| *r = if fixed { 0.0 } else { *r - right });
    let mut p = vec![0.0; x.len()];
    let (mut before, mut quiet) = (0.0, 0);
    for iteration in 0..LIMIT {
        let rz = rows(size, |y, j, at| r[at] * r[at] / degree(size, y, j));
        if rz == 0.0 || quiet == 10 || run.interrupted().is_some() {
            return iteration;
        }
        let beta = if before > 0.0 { rz / before } else { 0.0 };
        let width = size.width;
        p.par_chunks_mut(width).enumerate().for_each(|(y, row)| {
            for (j, p) in row.iter_mut().enumerate() {
                *p = r[y * width + j] / degree(size, y, j) + beta * *p;
            }
        });
        laplacian(size, &p, fixed, &mut product);
        // The Laplacian is negative definite.
        let curvature = -rows(size, |_, _, at| p[at] * product[at]);
        if curvature <= 0.0 {
            return iteration;
        }
        let step = rz / curvature;
        let largest = p.par_chunks(width).map(|row| row.iter().fold(0.0, |top: f64, p| top.max(p.abs())));
        let largest = largest.into_iter().fold(0.0, f64::max);
        quiet = if (step * largest).abs() <= tolerance { quiet + 1 } else { 0 };
        x.par_iter_mut().zip(&p).for_each(|(x, p)| *x += step * p);
        r.par_iter_mut().zip(&product).for_each(|(r, product)| *r += step * product);
        before = rz;
    }
    LIMIT
}

/// Neighbours of a pixel.
fn degree(size: Size, y: usize, x: usize) -> f64 {
    let inside = [y > 0, y + 1 < size.height, x > 0, x + 1 < size.width];
    inside.iter().filter(|inside| **inside).count().max(1) as f64
}

/// A sum over all pixels, row by row.
fn rows(size: Size, term: impl Fn(usize, usize, usize) -> f64 + Sync) -> f64 {
    let rows: Vec<f64> = (0..size.height)
        .into_par_iter()
        .map(|y| (0..size.width).map(|x| term(y, x, y * size.width + x)).sum());
    rows.iter().sum()
}

/// Sum of the neighbours minus as often the pixel, at free pixels; 0 at fixed ones.
fn laplacian(size: Size, x: &[f64], fixed: &[bool], out: &mut [f64]) {
    let Size { height, width } = size;
    out.par_chunks_mut(width.max(1)).enumerate().for_each(|(y, row)| {
        for (j, out) in row.iter_mut().enumerate() {
            let at = y * width + j;
            let mut sum = 0.0;
            if y > 0 {
                sum += x[at - width] - x[at];
            }
            if y + 1 < height {
                sum += x[at + width] - x[at];
            }
            if j > 0 {
                sum += x[at - 1] - x[at];
            }
            if j + 1 < width {
                sum += x[at + 1] - x[at];
            }
            *out = if fixed[at] { 0.0 } else { sum };
        }
    });
}

/// The divergence of differences to the next column (`horizontal`) and row (`vertical`), those beyond the border being 0.
pub fn divergence(size: Size, horizontal: &[f32], vertical: &[f32]) -> Vec<f64> {
    let Size { height, width } = size;
    let mut out = vec![0.0; size.pixels()];
    out.par_chunks_mut(width.max(1)).enumerate().for_each(|(y, row)| {
        for (j, out) in row.iter_mut().enumerate() {
            let at = y * width + j;
            let ahead = |inside: bool, of: &[f32], at: usize| if inside { f64::from(of[at]) } else { 0.0 };
            *out = ahead(j + 1 < width, horizontal, at)
                - if j > 0 { f64::from(horizontal[at - 1]) } else { 0.0 }
                + ahead(y + 1 < height, vertical, at)
                - if y > 0 { f64::from(vertical[at - width]) } else { 0.0 };
        }
    });
    out
}
