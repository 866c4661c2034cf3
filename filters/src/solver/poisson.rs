//! The Poisson equation on a rectangle with given values at its border, solved directly.
//!
//! `x(i-1, j) + x(i+1, j) + x(i, j-1) + x(i, j+1) - 4 x(i, j) = r(i, j)` at interior pixels: a sine transform along rows turns
//! it into one tridiagonal system per frequency, `u(i-1) + u(i+1) - (4 - 2 cos(pi k / (w - 1))) u(i) = r(i)`.
//!
//! Cost: two sine transforms a row and a sweep down and up. Memory: three images of f64. The condition grows with the
//! square of the side, so all is in f64.
//!
//! Source: W. Press, S. Teukolsky, W. Vetterling, B. Flannery, "Numerical Recipes", Cambridge 2007, section 20.4 (Fourier
//! analysis along one axis, cyclic elimination or direct along the other).

use std::f64::consts::PI;
use std::sync::Arc;

use lacuna_core::parallel::prelude::*;
use lacuna_transforms::{Complex, Planned, RealToComplex};

use crate::Size;

/// Solves for the interior of `x`, whose border is given. `right` holds `r` at interior pixels; it is destroyed.
pub fn solve(size: Size, right: &mut [f64], x: &mut [f64]) {
    let Size { height, width } = size;
    if height < 3 || width < 3 {
        return;
    }
    let inner = 1..width - 1;
    for y in 1..height - 1 {
        let row = &mut right[y * width..][..width];
        row[1] -= x[y * width];
        row[width - 2] -= x[(y + 1) * width - 1];
    }
    for j in inner.clone() {
        right[width + j] -= x[j];
        right[(height - 2) * width + j] -= x[(height - 1) * width + j];
    }
    let sine = Sine::new(width - 2);
    let interior = width..(height - 1) * width;
    sine.rows(&mut right[interior.clone()], width);
    eliminate(size, &mut right[interior.clone()]);
    sine.rows(&mut right[interior], width);
    let scale = 2.0 / (width - 1) as f64;
    for y in 1..height - 1 {
        let rows = x[y * width..][inner.clone()].iter_mut().zip(&right[y * width..][inner.clone()]);
        rows.for_each(|(x, u)| *x = scale * u);
    }
}

/// Thomas's elimination down and up the rows, all frequencies side by side.
fn eliminate(size: Size, u: &mut [f64]) {
    let width = size.width;
    let diagonal: Vec<f64> =
        (0..width).map(|k| -4.0 + 2.0 * (PI * k as f64 / (width - 1) as f64).cos()).collect();
    let mut pivots = vec![0.0; u.len()];
    for y in 0..size.height - 2 {
        let (done, rest) = u.split_at_mut(y * width);
        let (pivots_done, pivots) = pivots.split_at_mut(y * width);
        for k in 1..width - 1 {
            let (above, pivot) = match y {
                0 => (0.0, 0.0),
                _ => (done[(y - 1) * width + k], pivots_done[(y - 1) * width + k]),
            };
            pivots[k] = 1.0 / (diagonal[k] - pivot);
            rest[k] = (rest[k] - above) * pivots[k];
        }
    }
    for y in (0..size.height - 3).rev() {
        let (upper, lower) = u.split_at_mut((y + 1) * width);
        let rows = upper[y * width..].iter_mut().zip(&*lower).zip(&pivots[y * width..]);
        rows.take(width - 1).skip(1).for_each(|((u, below), pivot)| *u -= pivot * below);
    }
}

/// The sine transform of lines of `n` values, `X_k = sum_j x_j sin(pi j k / (n + 1))`, by an odd extension.
struct Sine {
    n: usize,
    plan: Arc<dyn RealToComplex<f64>>,
}

impl Sine {
    fn new(n: usize) -> Self {
        Self { n, plan: f64::real_forward(2 * (n + 1)) }
    }

    /// Transforms the values 1 to n of each row of `width`.
    fn rows(&self, values: &mut [f64], width: usize) {
        let n = self.n;
        values.par_chunks_mut(width).for_each_init(
            || (vec![0.0; 2 * (n + 1)], vec![Complex::default(); n + 2], self.plan.make_scratch_vec()),
            |(line, spectrum, scratch), row| {
                line.fill(0.0);
                for j in 1..=n {
                    line[j] = row[j];
                    line[2 * (n + 1) - j] = -row[j];
                }
                // The lengths are those of the plan, the only thing that it checks.
                let _ = self.plan.process_with_scratch(line, spectrum, scratch);
                for (value, spectrum) in row[1..=n].iter_mut().zip(&spectrum[1..=n]) {
                    *value = -0.5 * spectrum.im;
                }
            },
        );
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_image_is_the_solution_for_its_own_laplacian() {
        for (height, width) in [(1, 1), (2, 5), (3, 3), (3, 8), (7, 3), (6, 9), (12, 31), (40, 25)] {
            let size = Size::new(height, width);
            let image: Vec<f64> =
                (0..size.pixels()).map(|i| ((i * 7919 + 5) % 1009) as f64 / 1009.0).collect();
            let at = |y: usize, x: usize| image[y * width + x];
            let mut right = vec![f64::NAN; image.len()];
            let mut x = image.clone();
            for y in 1..height.max(2) - 1 {
                for j in 1..width.max(2) - 1 {
                    right[y * width + j] =
                        at(y - 1, j) + at(y + 1, j) + at(y, j - 1) + at(y, j + 1) - 4.0 * at(y, j);
                    x[y * width + j] = f64::NAN;
                }
            }
            solve(size, &mut right, &mut x);
            let bound = 1e-13 * (height * width) as f64;
            for (x, image) in x.iter().zip(&image) {
                assert!((x - image).abs() <= bound, "{size}: {x} {image}");
            }
        }
    }
}
