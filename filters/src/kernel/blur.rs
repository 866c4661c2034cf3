//! A Gaussian over a plane.

use lacuna_core::parallel::prelude::*;

use crate::Size;

/// Rows that one task takes.
const ROWS: usize = 16;

/// Convolves with a Gaussian of standard deviation `sigma` pixels, cut at four of them; zero outside of the image.
pub fn blur(size: Size, values: &[f32], sigma: f64) -> Vec<f32> {
    let reach = (4.0 * sigma).ceil() as usize;
    let weights: Vec<f32> =
        (0..=reach).map(|d| (-((d * d) as f64) / (2.0 * sigma * sigma)).exp() as f32).collect();
    let total = 2.0 * weights.iter().sum::<f32>() - weights[0];
    let weights: Vec<f32> = weights.into_iter().map(|weight| weight / total).collect();
    let width = size.width.max(1);
    let mut rows = vec![0.0; values.len()];
    rows.par_chunks_mut(width).zip(values.par_chunks(width)).with_min_len(ROWS).for_each(|(out, row)| {
        for (d, weight) in weights.iter().enumerate().take(width) {
            add(&mut out[..width - d], *weight, &row[d..]);
            if d > 0 {
                add(&mut out[d..], *weight, &row[..width - d]);
            }
        }
    });
    let mut out = vec![0.0; values.len()];
    out.par_chunks_mut(width).enumerate().with_min_len(ROWS).for_each(|(y, out)| {
        for v in y.saturating_sub(reach)..(y + reach + 1).min(size.height) {
            add(out, weights[y.abs_diff(v)], &rows[v * width..][..width]);
        }
    });
    out
}

fn add(out: &mut [f32], weight: f32, values: &[f32]) {
    for (out, value) in out.iter_mut().zip(values) {
        *out += weight * value;
    }
}

#[cfg(test)]
mod tests {
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
}
