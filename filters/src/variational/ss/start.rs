//! Where the solvers start: a pull-push pyramid without interpolation, rough and cheap. The result does not depend on
//! it, the number of iterations does.

use crate::{Mask, Plane};

/// Sets `out` to the samples at measured pixels and to a mean of samples around at the others.
pub fn fill(samples: &Plane, mask: &Mask, out: &mut Plane) {
    let size = samples.size();
    let known: Vec<(f32, f32)> = samples
        .pixels()
        .iter()
        .zip(mask.as_slice())
        .map(|(&value, &measured)| if measured { (value, 1.0) } else { (0.0, 0.0) })
        .collect();
    let mut levels = vec![(size.height, size.width, known)];
    while let Some((height, width, level)) = levels.last().filter(|(height, width, _)| height * width > 1) {
        let next = pull(*height, *width, level);
        levels.push(next);
    }
    let mut coarse = levels.pop();
    while let (Some((_, coarse_width, above)), Some((height, width, mut level))) = (&coarse, levels.pop()) {
        for i in 0..height {
            for j in 0..width {
                let (value, weight) = level[i * width + j];
                let (up, _) = above[i / 2 * coarse_width + j / 2];
                // A mean of means: exact for a measured pixel, whatever `up` is.
                let mixed = if weight >= 1.0 { value } else { weight * value + (1.0 - weight) * up };
                level[i * width + j] = (mixed, 1.0);
            }
        }
        coarse = Some((height, width, level));
    }
    if let Some((_, _, level)) = coarse {
        for ((out, (value, _)), (&sample, &measured)) in
            out.pixels_mut().iter_mut().zip(level).zip(samples.pixels().iter().zip(mask.as_slice()))
        {
            *out = if measured { sample } else { value };
        }
    }
}

/// The weighted mean of 2 x 2 values and the sum of their weights, at most 1.
fn pull(height: usize, width: usize, level: &[(f32, f32)]) -> (usize, usize, Vec<(f32, f32)>) {
    let (tall, wide) = (height.div_ceil(2), width.div_ceil(2));
    let mut result = Vec::with_capacity(tall * wide);
    for i in 0..tall {
        for j in 0..wide {
            let (mut sum, mut weight) = (0.0, 0.0);
            for y in 2 * i..height.min(2 * i + 2) {
                for x in 2 * j..width.min(2 * j + 2) {
                    let (value, share) = level[y * width + x];
                    sum += value * share;
                    weight += share;
                }
            }
            result.push(if weight > 0.0 { (sum / weight, weight.min(1.0)) } else { (0.0, 0.0) });
        }
    }
    (tall, wide, result)
}
