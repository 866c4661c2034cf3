//! From differences between neighbours to an image.

use super::Anchor;
use crate::solver::{anchored, poisson};
use crate::{Run, Size};

/// Largest correction, over the largest difference, at which anchored integration ends.
const TOLERANCE: f64 = 1e-7;

/// Differences to the next column and to the next row; the last column and the last row have none.
pub struct Field {
    /// Height and width.
    pub size: Size,
    /// `x(i, j+1) - x(i, j)`.
    pub horizontal: Vec<f32>,
    /// `x(i+1, j) - x(i, j)`.
    pub vertical: Vec<f32>,
}

/// Makes derivatives at pixel centres differences: the mean of both ends (the trapezoid rule).
pub fn differences(size: Size, horizontal: &mut [f32], vertical: &mut [f32]) {
    let Size { height, width } = size;
    for row in horizontal.chunks_mut(width.max(1)) {
        for x in 1..width {
            row[x - 1] = 0.5 * (row[x - 1] + row[x]);
        }
    }
    for at in 0..width * height.saturating_sub(1) {
        vertical[at] = 0.5 * (vertical[at] + vertical[at + width]);
    }
}

impl Field {
    /// The image with these differences and the anchor's pixels.
    pub fn integrate(&self, samples: &[f32], measured: &[bool], anchor: Anchor, run: &Run<'_>) -> Vec<f64> {
        let mut image = vec![0.0; samples.len()];
        let anchored = self.border(samples, measured, &mut image);
        let mut right = anchored::divergence(self.size, &self.horizontal, &self.vertical);
        if anchor == Anchor::Measured {
            let largest = |field: &[f32]| field.iter().fold(0.0_f32, |most, value| most.max(value.abs()));
            let scale = f64::from(largest(&self.horizontal).max(largest(&self.vertical)));
            poisson::solve(self.size, &mut right.clone(), &mut image);
            for ((x, sample), _) in image.iter_mut().zip(samples).zip(measured).filter(|(_, flag)| **flag) {
                *x = f64::from(*sample);
            }
            anchored::solve(self.size, &right, measured, TOLERANCE * scale, &mut image, run);
            return image;
        }
        poisson::solve(self.size, &mut right, &mut image);
        if !anchored {
            let both = image.iter().zip(samples).zip(measured).filter(|(_, flag)| **flag);
            let (sum, count) = both
                .fold((0.0, 0), |(sum, count), ((x, sample), _)| (sum + f64::from(*sample) - x, count + 1));
            let shift = sum / f64::from(count.max(1));
            for x in &mut image {
                *x += shift;
            }
        }
        image
    }

    /// Fills the border; whether a pixel of it was measured.
    fn border(&self, samples: &[f32], measured: &[bool], image: &mut [f64]) -> bool {
        let ring = ring(self.size);
        let closed = self.size.height > 1 && self.size.width > 1;
        let steps: Vec<f64> =
            (0..ring.len()).map(|k| self.step(ring[k], ring[(k + 1) % ring.len()])).collect();
        let known: Vec<Option<f64>> =
            ring.iter().map(|&at| measured[at].then(|| f64::from(samples[at]))).collect();
        for (at, value) in ring.iter().zip(chain(&known, &steps, closed)) {
            image[*at] = value;
        }
        known.iter().any(Option::is_some)
    }

    /// The difference from one pixel to a neighbour.
    fn step(&self, from: usize, to: usize) -> f64 {
        let width = self.size.width;
        // Rows first: in an image of one column the next row is also the next pixel.
        if to == from + width {
            f64::from(self.vertical[from])
        } else if to + width == from {
            -f64::from(self.vertical[to])
        } else if to == from + 1 {
            f64::from(self.horizontal[from])
        } else if to + 1 == from {
            -f64::from(self.horizontal[to])
        } else {
            0.0
        }
    }
}

/// The border's pixels, each a neighbour of the one before; closed unless the image is a line.
fn ring(size: Size) -> Vec<usize> {
    let Size { height, width } = size;
    if height <= 1 || width <= 1 {
        return (0..size.pixels()).collect();
    }
    let top = 0..width;
    let right = (1..height).map(|y| (y + 1) * width - 1);
    let bottom = (0..width - 1).rev().map(|x| (height - 1) * width + x);
    let left = (1..height - 1).rev().map(|y| y * width);
    top.chain(right).chain(bottom).chain(left).collect()
}

/// Values of a chain that pass through the known ones and follow the steps between them, the misfit spread evenly. Beyond
/// the ends of an open chain the steps alone lead on; without a known value the first is 0.
fn chain(known: &[Option<f64>], steps: &[f64], closed: bool) -> Vec<f64> {
    let count = known.len();
    let places: Vec<usize> = (0..count).filter(|&k| known[k].is_some()).collect();
    let mut values: Vec<f64> = known.iter().map(|value| value.unwrap_or(0.0)).collect();
    let places = if places.is_empty() { vec![0] } else { places };
    let mut spans: Vec<(usize, usize)> = places.windows(2).map(|pair| (pair[0], pair[1])).collect();
    let (first, last) = (places[0], places[places.len() - 1]);
    if closed {
        spans.push((last, first + count));
    } else {
        for k in (0..first).rev() {
            values[k] = values[k + 1] - steps[k];
        }
        for k in last + 1..count {
            values[k] = values[k - 1] + steps[k - 1];
        }
    }
    for (from, to) in spans {
        let sum: f64 = (from..to).map(|k| steps[k % count]).sum();
        let misfit = values[to % count] - values[from] - sum;
        let share = misfit / (to - from) as f64;
        for k in from + 1..to {
            values[k % count] = values[(k - 1) % count] + steps[(k - 1) % count] + share;
        }
    }
    values
}

#[cfg(test)]
mod tests {
    use super::*;

    fn value(at: usize) -> f32 {
        ((at * 7919 + 3) % 257) as f32 / 256.0
    }

    /// The differences of an image, and something else where there is none.
    fn of(size: Size) -> Field {
        let ahead =
            |at: usize, by: usize, inside: bool| if inside { value(at + by) - value(at) } else { 9.0 };
        let Size { height, width } = size;
        let pixels = 0..size.pixels();
        Field {
            size,
            horizontal: pixels.clone().map(|at| ahead(at, 1, at % width + 1 < width)).collect(),
            vertical: pixels.map(|at| ahead(at, width, at / width + 1 < height)).collect(),
        }
    }

    #[test]
    fn gradient_fields_are_integrated_exactly() {
        for (height, width) in [(1, 1), (1, 9), (8, 1), (2, 2), (3, 2), (7, 5), (12, 17), (30, 31)] {
            let size = Size::new(height, width);
            let samples: Vec<f32> = (0..size.pixels()).map(value).collect();
            // One pixel at the border, one within, and many.
            for step in [size.pixels(), 5] {
                for first in [0, size.pixels() / 2 + width / 2] {
                    let flag = |at: usize| at == first.min(size.pixels() - 1) || at % step == step - 1;
                    let measured: Vec<bool> = (0..size.pixels()).map(flag).collect();
                    for anchor in [Anchor::Border, Anchor::Measured] {
                        let image = of(size).integrate(&samples, &measured, anchor, &Run::default());
                        for (found, expected) in image.iter().zip(&samples) {
                            let error = (found - f64::from(*expected)).abs();
                            assert!(error < 1e-5, "{size} {anchor:?} {step} {first}: {error}");
                        }
                    }
                }
            }
        }
    }

    #[test]
    fn a_misfit_is_spread_between_known_values() {
        let known = [None, Some(1.0), None, None, Some(7.0), None];
        let steps = [1.0; 6];
        assert_eq!(chain(&known, &steps, false), [0.0, 1.0, 3.0, 5.0, 7.0, 8.0]);
        // Closed: from 7 over two pixels back to 1.
        assert_eq!(chain(&known, &steps, true), [3.0, 1.0, 3.0, 5.0, 7.0, 5.0]);
        assert_eq!(chain(&[None; 3], &[1.0, 1.0, 1.0], true), [0.0, 0.0, 0.0]);
    }

    #[test]
    fn the_mean_of_derivatives_is_the_difference_of_a_parabola() {
        let size = Size::new(4, 5);
        let derivative = |at: usize| 2.0 * (at % 5) as f32;
        let mut horizontal: Vec<f32> = (0..20).map(derivative).collect();
        let mut vertical: Vec<f32> = (0..20).map(|at| 2.0 * (at / 5) as f32).collect();
        differences(size, &mut horizontal, &mut vertical);
        for at in 0..20 {
            let (y, x) = (at / 5, at % 5);
            assert!(x == 4 || horizontal[at] == 2.0 * x as f32 + 1.0);
            assert!(y == 3 || vertical[at] == 2.0 * y as f32 + 1.0);
        }
    }
}
