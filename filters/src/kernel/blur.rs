//! A Gaussian over a plane.

use lacuna_core::parallel::prelude::*;

use super::{Body, Isa, dispatch, fma};
use crate::Size;

/// Rows that one task takes.
const ROWS: usize = 16;
/// Standard deviation from which on half of the rows and columns will do.
const WIDE: f64 = 3.0;
/// Of rows or columns from the one before a pair to the one after it, in the pair's place among half as many.
const PARTS: [f32; 4] = [0.125, 0.375, 0.375, 0.125];
/// Columns whose sums are in registers at a time.
const BLOCK: usize = 64;

/// Convolves with a Gaussian of standard deviation `sigma` pixels, cut at four of them; zero outside of the image. Where it is [`WIDE`], of half as many rows and
/// columns: off by 3 % of the kernel's largest value at most.
pub fn blur(size: Size, values: &[f32], sigma: f64) -> Vec<f32> {
    if sigma < WIDE {
        return narrow(size, values, sigma);
    }
    // With one row and column outside of the image on every side.
    let half = Size::new(size.height.div_ceil(2) + 2, size.width.div_ceil(2) + 2);
    // Halving and doubling add three quarters each to the variance.
    let small = blur(half, &halved(size, values, half), 0.5 * (sigma * sigma - 1.5).sqrt());
    doubled(half, &small, size)
}

fn narrow(size: Size, values: &[f32], sigma: f64) -> Vec<f32> {
    let reach = (4.0 * sigma).ceil() as usize;
    let weight = |d: usize| (-((d * d) as f64) / (2.0 * sigma * sigma)).exp() as f32;
    // One side of the kernel, the middle and the other side.
    let weights: Vec<f32> = (0..=2 * reach).map(|k| weight(k.abs_diff(reach))).collect();
    let total: f32 = weights.iter().sum();
    let weights: Vec<f32> = weights.into_iter().map(|weight| weight / total).collect();
    let (isa, width) = (Isa::best(), size.width.max(1));
    let mut rows = vec![0.0; values.len()];
    rows.par_chunks_mut(width).zip(values.par_chunks(width)).with_min_len(ROWS).for_each_init(
        || vec![0.0; width + 2 * reach],
        |padded, (out, row)| {
            padded[reach..][..width].copy_from_slice(row);
            dispatch(isa, Weighted { weights: &weights, from: padded, apart: 1, out });
        },
    );
    let mut out = vec![0.0; values.len()];
    out.par_chunks_mut(width).enumerate().with_min_len(ROWS).for_each(|(y, out)| {
        let (above, end) = (y.saturating_sub(reach), (y + reach + 1).min(size.height));
        let weights = &weights[above + reach - y..end + reach - y];
        dispatch(isa, Weighted { weights, from: &rows[above * width..end * width], apart: width, out });
    });
    out
}

/// What [`doubled`] is the transpose of, over 4: each pixel in parts to the nearest ones of half as many rows and columns.
fn halved(size: Size, values: &[f32], half: Size) -> Vec<f32> {
    let mut out = vec![0.0; half.pixels()];
    out.par_chunks_mut(half.width).enumerate().with_min_len(ROWS).for_each_init(
        || vec![0.0; 2 * half.width + 2],
        |line, (y, out)| {
            line.fill(0.0);
            for (k, weight) in PARTS.into_iter().enumerate() {
                let row = (2 * y + k).checked_sub(3).filter(|row| *row < size.height);
                let row = row.map_or(&[][..], |row| &values[row * size.width..][..size.width]);
                line[3..].iter_mut().zip(row).for_each(|(sum, value)| *sum += weight * value);
            }
            for (out, four) in out.iter_mut().zip(line.windows(4).step_by(2)) {
                *out = four.iter().zip(PARTS).map(|(value, weight)| weight * value).sum();
            }
        },
    );
    out
}

/// Twice as large, between the middles of pixels by lines.
fn doubled(half: Size, small: &[f32], size: Size) -> Vec<f32> {
    let mut out = vec![0.0; size.pixels()];
    out.par_chunks_mut(size.width.max(1)).enumerate().with_min_len(ROWS).for_each_init(
        || vec![0.0; half.width],
        |line, (y, out)| {
            let near = y / 2 + 1;
            let far = if y % 2 == 0 { near - 1 } else { near + 1 };
            let [near, far] = [near, far].map(|row| &small[row * half.width..][..half.width]);
            for (value, (near, far)) in line.iter_mut().zip(near.iter().zip(far)) {
                *value = 0.75 * near + 0.25 * far;
            }
            for (pair, near) in out.chunks_mut(2).zip(line.windows(3)) {
                let both = [0.75 * near[1] + 0.25 * near[0], 0.75 * near[1] + 0.25 * near[2]];
                pair.copy_from_slice(&both[..pair.len()]);
            }
        },
    );
    out
}

/// Half of the window of a Gaussian whose sum is 1, by the distance from its middle in pixels.
pub fn half_window<const N: usize>(sigma: f64) -> [f32; N] {
    let gauss = |k: usize| (-0.5 * (k as f64 / sigma).powi(2)).exp();
    let sum = 1.0 + 2.0 * (1..N).map(gauss).sum::<f64>();
    std::array::from_fn(|k| (gauss(k) / sum) as f32)
}

/// Sums of values `apart` from each other, each with its weight.
struct Weighted<'a> {
    weights: &'a [f32],
    from: &'a [f32],
    apart: usize,
    out: &'a mut [f32],
}

impl Body for Weighted<'_> {
    type Output = ();

    #[inline(always)]
    fn run<const FUSED: bool>(self) {
        let Self { weights, from, apart, out } = self;
        for (block, out) in out.chunks_mut(BLOCK).enumerate() {
            let from = &from[block * BLOCK..];
            if let Some(out) = out.first_chunk_mut::<BLOCK>() {
                let mut sums = [0.0; BLOCK];
                for (k, &weight) in weights.iter().enumerate() {
                    let Some(near) = from[k * apart..].first_chunk::<BLOCK>() else { break };
                    for j in 0..BLOCK {
                        sums[j] = fma::<f32, FUSED>(weight, near[j], sums[j]);
                    }
                }
                *out = sums;
            } else {
                for (k, &weight) in weights.iter().enumerate() {
                    for (out, &near) in out.iter_mut().zip(&from[k * apart..]) {
                        *out = fma::<f32, FUSED>(weight, near, *out);
                    }
                }
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use std::f64::consts::PI;

    use super::*;

    /// Against the sum in f64, pixel by pixel.
    #[test]
    fn it_is_the_weighted_mean_around_a_pixel() {
        let (size, sigma) = (Size::new(37, 50), 1.7);
        let values: Vec<f32> = (0..size.pixels()).map(|i| ((i * 7919) % 101) as f32 / 101.0).collect();
        let found = blur(size, &values, sigma);
        let reach = (4.0 * sigma).ceil() as isize;
        let weight = |d: isize| (-((d * d) as f64) / (2.0 * sigma * sigma)).exp();
        let total: f64 = (-reach..=reach).map(weight).sum();
        for (pixel, found) in found.iter().enumerate() {
            let (y, x) = ((pixel / size.width) as isize, (pixel % size.width) as isize);
            let mut sum = 0.0;
            for (dy, dx) in (-reach..=reach).flat_map(|dy| (-reach..=reach).map(move |dx| (dy, dx))) {
                let (v, u) = (y + dy, x + dx);
                if (0..size.height as isize).contains(&v) && (0..size.width as isize).contains(&u) {
                    sum += weight(dy) * weight(dx) * f64::from(values[v as usize * size.width + u as usize]);
                }
            }
            let sum = sum / (total * total);
            // Each pass rounds as often as it adds.
            let bound = 4.0 * f64::from(f32::EPSILON) * (2 * reach + 1) as f64;
            assert!((f64::from(*found) - sum).abs() < bound, "{found} for {sum}");
        }
    }
    /// Against the narrow one, which knows of no halves: what single pixels, constants and lines become.
    #[test]
    fn wide_ones_are_as_if_no_rows_were_left_out() {
        for (sigma, size) in [(3.0, Size::new(80, 91)), (4.7, Size::new(97, 80)), (9.1, Size::new(181, 200))]
        {
            let largest = 0.5 / (PI * sigma * sigma);
            for (row, column) in [(0, 0), (40, 45), (41, 44), (size.height - 1, 3)] {
                let mut values = vec![0.0; size.pixels()];
                values[row * size.width + column] = 1.0;
                let (found, slow) = (blur(size, &values, sigma), narrow(size, &values, sigma));
                for (at, (found, slow)) in found.iter().zip(&slow).enumerate() {
                    let off = f64::from((found - slow).abs());
                    assert!(off < 0.03 * largest, "{sigma} at {at}: {found} for {slow}");
                }
            }
            let lines: Vec<f32> = (0..size.pixels()).map(|at| (at % size.width) as f32).collect();
            for (values, bound) in [(vec![1.0; size.pixels()], 1e-3), (lines, 2e-3 * size.width as f32)] {
                let (found, slow) = (blur(size, &values, sigma), narrow(size, &values, sigma));
                let margin = (4.0 * sigma).ceil() as usize + 4;
                for row in margin..size.height - margin {
                    for column in margin..size.width - margin {
                        let at = row * size.width + column;
                        assert!(
                            (found[at] - slow[at]).abs() < bound,
                            "{sigma}: {} for {}",
                            found[at],
                            slow[at]
                        );
                    }
                }
            }
        }
    }
}
