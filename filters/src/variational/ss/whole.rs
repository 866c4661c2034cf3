//! Channels of an image that multigrid takes whole, one after the other.
//!
//! One channel keeps all threads busy, and its buffers bound the memory. The spline is linear in the samples and keeps constants. So
//! the solution for samples `y` is `b + sum a_k x_k`, with `x_k` the solutions of other channels, and the solution for
//! `y - b - sum a_k y_k`, whatever `b` and `a_k` are. Channels of renders have much in common: with `b` and `a_k` by least squares
//! over the measured pixels, less is left to solve for, in fewer places ([`crate::solver::regression`]).

use lacuna_core::parallel::prelude::*;

use super::region::Region;
use crate::kernel::extremes::range;
use crate::solver::regression::{self, Column, Line};
use crate::{Mask, Outcome, Plane, Run};

/// Ranges of channels of which parts may be solved for: differences of larger values may be too large, of smaller ones too coarse.
const EXPLAINED: std::ops::Range<f64> = 1e-30..1e30;
/// The error that a channel may have with what others bring along, over its own: what the aim leaves (`EASE` in [`super::region`]).
const ERROR: f64 = 1.6;
/// Less of its own is not worth it.
const OWN: f64 = 0.3;

/// What the channels have in common.
pub struct Whole<'a> {
    /// Multigrid on the image.
    pub region: &'a Region,
    /// The measured pixels.
    pub mask: &'a Mask,
    /// Whether these change, too.
    pub smooths: bool,
    /// The error that a channel may have, over its range.
    pub tolerance: f64,
    /// Settles what neither the samples nor the energy see.
    pub settle: &'a (dyn Fn(&mut Plane) + Sync),
}

impl Whole<'_> {
    /// Replaces the free pixels of all channels by the solutions. Channels of one value keep what they have.
    pub fn solve(&self, samples: &[Plane], out: &mut [Plane], run: &Run<'_>) -> Outcome {
        let count = self.mask.as_slice().iter().filter(|measured| **measured).count();
        let column = |plane: &Plane| {
            let (low, high) = range(self.mask.as_slice(), plane.pixels());
            let measured = plane.pixels().iter().zip(self.mask.as_slice()).filter(|(_, measured)| **measured);
            Column::new(measured.map(|(value, _)| *value), count, f64::from(high) - f64::from(low))
        };
        let columns: Vec<Column> = samples.par_iter().map(column);
        let mut worst = Outcome::direct();
        // Per channel its error with those of others, over what one may have alone.
        let mut errors = vec![1.0; samples.len()];
        for (k, line) in regression::order(&columns) {
            let wide = columns[k].range;
            let brought = |line: &Line| -> f64 {
                line.factors.iter().map(|&(j, a)| a.abs() * columns[j].range / wide * errors[j]).sum()
            };
            let line = line.filter(|line| EXPLAINED.contains(&wide) && brought(line) <= ERROR - OWN);
            let brought = line.as_ref().map_or(0.0, brought);
            let own = (ERROR - brought).min(1.0);
            errors[k] = own + brought;
            let tolerance = own * self.tolerance * wide;
            worst = worst.worst(match line {
                None => self.channel(&samples[k], &mut out[k], tolerance, run),
                Some(line) => {
                    let rest = self.rest(samples, k, &line);
                    let mut image = rest.clone();
                    let outcome = self.channel(&rest, &mut image, tolerance, run);
                    drop(rest);
                    self.add(&line, image, out, k);
                    outcome
                }
            });
            (self.settle)(&mut out[k]);
        }
        worst
    }

    fn channel(&self, samples: &Plane, image: &mut Plane, tolerance: f64, run: &Run<'_>) -> Outcome {
        self.region.begin(samples, image, tolerance);
        self.region.solve(samples, image, tolerance, run)
    }

    /// The samples of channel `k` without what others explain of them; zero where nothing was measured.
    fn rest(&self, samples: &[Plane], k: usize, line: &Line) -> Plane {
        let mut rest = samples[k].clone();
        let width = rest.size().width.max(1);
        rest.pixels_mut().par_chunks_mut(width).enumerate().for_each_init(Vec::new, |explained, (i, row)| {
            explain(line, samples, i, explained);
            for ((value, &measured), explained) in row.iter_mut().zip(self.mask.row(i)).zip(explained) {
                *value = if measured { (f64::from(*value) - *explained) as f32 } else { 0.0 };
            }
        });
        rest
    }

    /// Sets the free pixels of channel `k` to the solution `image` for its rest and what others explain.
    fn add(&self, line: &Line, mut image: Plane, out: &mut [Plane], k: usize) {
        let width = image.size().width.max(1);
        image.pixels_mut().par_chunks_mut(width).enumerate().for_each_init(
            Vec::new,
            |explained, (i, row)| {
                explain(line, out, i, explained);
                let known = out[k].row(i).iter().zip(self.mask.row(i));
                for ((value, (&own, &measured)), explained) in row.iter_mut().zip(known).zip(explained) {
                    let sum = (f64::from(*value) + *explained) as f32;
                    *value = if self.smooths || !measured { sum } else { own };
                }
            },
        );
        out[k] = image;
    }
}

/// Sets `explained` to what the line makes of row `i`.
fn explain(line: &Line, channels: &[Plane], i: usize, explained: &mut Vec<f64>) {
    explained.clear();
    for &(k, factor) in &line.factors {
        let row = channels[k].row(i);
        explained.resize(row.len(), line.constant);
        for (explained, &value) in explained.iter_mut().zip(row) {
            *explained += factor * f64::from(value);
        }
    }
}

#[cfg(test)]
mod tests {
    use std::sync::Arc;

    use super::super::{AIM, Settings};
    use crate::{Filter, Mask, Plane, Planes, Problem, Run, Size, Stop};

    const SIZE: Size = Size::new(300, 411);
    /// Of the samples of a picture, at least.
    const RANGE: f64 = 2.0;

    /// Waves, and an edge that the grid does not follow.
    fn picture(seed: usize) -> Plane {
        let (a, b) = (9.0 + 7.0 * seed as f32, 31.0 - 5.0 * seed as f32);
        Plane::from_fn(SIZE, |y, x| {
            let (y, x) = (y as f32, x as f32);
            (y / a).sin() * (x / b).cos() + if (x - 200.0).hypot(y - 140.0) < 80.0 { 1.0 } else { 0.0 }
        })
    }

    fn sparse() -> Mask {
        Mask::from_fn(SIZE, |y, x| (y * 7919 + x * 104_729 + y * x * 31) % 101 == 0)
    }

    /// With samples at every measured pixel and, where there is none, what must not be read.
    fn solve(settings: &Settings, mask: &Mask, channels: &[Plane], error: f64) -> Vec<Plane> {
        let hide = |plane: &Plane| {
            Plane::from_fn(SIZE, |y, x| if mask.is_measured(y, x) { plane.at(y, x) } else { f32::NAN })
        };
        let samples = Planes::new(SIZE, channels.iter().map(hide).collect()).unwrap();
        let mut out = Planes::zeros(SIZE, channels.len());
        let plan = settings.plan(&Problem::fill(Arc::new(mask.clone())), &Run::default()).unwrap();
        let outcome = plan.reconstruct_roughly(&samples, error, &mut out, &Run::default()).unwrap();
        assert_eq!(outcome.stop, Stop::Converged);
        out.into_vec()
    }

    fn distance(a: &Plane, b: &Plane) -> f64 {
        let pairs = a.pixels().iter().zip(b.pixels());
        pairs.fold(0.0, |top, (a, b)| f64::max(top, f64::from((a - b).abs())))
    }

    /// Where cells are left out, too, no pixel is off by more than is allowed.
    #[test]
    fn sparse_images_are_as_exact_as_asked() {
        let (mask, channels) = (sparse(), [picture(0)]);
        let found = solve(&Settings::default(), &mask, &channels, AIM);
        let exact = solve(&Settings::default(), &mask, &channels, AIM / 100.0);
        let distance = distance(&found[0], &exact[0]);
        assert!(distance > 0.0 && distance <= RANGE * AIM, "{distance}");
    }

    /// Neither where values lie no further apart than what is asked for, nor where they are hardly any.
    #[test]
    fn samples_that_differ_by_little_more_than_rounding_converge() {
        let mask = sparse();
        let a = picture(0);
        for (middle, size) in [(1000.0, 1e-4), (1.0, 3e-7), (0.0, 1e-38), (0.0, 1e-44)] {
            let channel = Plane::from_fn(SIZE, |y, x| middle + size * a.at(y, x));
            let top =
                |plane: &Plane| plane.pixels().iter().fold(0.0, |top: f32, x| top.max((x - middle).abs()));
            let found = &solve(&Settings::default(), &mask, std::slice::from_ref(&channel), AIM)[0];
            assert!(top(found) <= 2.0 * top(&channel), "{middle} {size}");
        }
    }

    /// What channels have in common changes neither a sample nor, beyond what is allowed, any other pixel.
    #[test]
    fn channels_with_much_in_common_are_solved_as_alone() {
        let mask = sparse();
        let (a, b, flat) = (picture(0), picture(1), Plane::filled(SIZE, 2.0));
        let mixture = Plane::from_fn(SIZE, |y, x| {
            5.0 + 0.4 * a.at(y, x) + 0.6 * b.at(y, x) + (y as f32 / 5.0).sin() / 50.0
        });
        // Samples that are rounded to more than the aim of the first, which has the same shape.
        let far = Plane::from_fn(SIZE, |y, x| 1000.0 + 1e-2 * a.at(y, x));
        let channels = [a, mixture, flat, b, far];
        for settings in [Settings::default(), Settings { lambda: 0.2, ..Settings::default() }] {
            let together = solve(&settings, &mask, &channels, AIM);
            for (channel, together) in channels.iter().zip(&together) {
                let alone = solve(&settings, &mask, std::slice::from_ref(channel), AIM);
                let distance = distance(&alone[0], together);
                let top =
                    |from: f32| channel.pixels().iter().fold(0.0, |top: f32, x| top.max((x - from).abs()));
                // Values far from zero are rounded in the end.
                let (range, rounding) =
                    (f64::from(top(channel.at(0, 0))), f64::from(f32::EPSILON * top(0.0)));
                assert!(distance <= 2.0 * (AIM * range + rounding), "{settings:?}: {distance} of {range}");
                for (y, x) in (0..SIZE.height).flat_map(|y| (0..SIZE.width).map(move |x| (y, x))) {
                    let kept = settings.lambda > 0.0 || !mask.is_measured(y, x);
                    assert!(kept || together.at(y, x).to_bits() == channel.at(y, x).to_bits());
                }
            }
        }
    }
}
