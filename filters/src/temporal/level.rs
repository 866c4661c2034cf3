//! Samples of another frame brought to the brightness of this one.
//!
//! Where light or a transfer function changes from frame to frame, what another frame measured at `p` is, around every `q`, nearly
//!
//! ```text
//! L v = a + g (v - b),      a, b = means of y and v,      g = (cov(v, y) + r) / (var(v) + r)
//! ```
//!
//! of this frame's values `y`, the moments over pairs `(v, y)` under a Gaussian around `q` of `SPREAD` spacings of the pairs; `r` = `HALF^2` of the range
//! draws the gain to 1 where values hardly differ.
//!
//! Pairs are those of each sample of the other frame with this frame's image at its place; and, where the other frame's own fill is known, of
//! this at each measured pixel with what was measured there. An image is smoother than samples, so the first alone would make gains too small
//! and the second too large.
//!
//! Boundary: the Gaussian ends there. Cost: five blurs a plane. Fails: where brightness changes within a few pixels otherwise than by a gain, as
//! at the rims of moving shadows.
//!
//! Source: W. Cleveland, S. Devlin, "Locally weighted regression", Journal of the American Statistical Association 83, 1988.

use std::sync::Arc;

use lacuna_core::parallel::prelude::*;

use super::usual::{self, Usual, wide};
use super::{Carried, HALF, Taps, carried};
use crate::kernel::blur::blur;
use crate::{Mask, Planes, Size};

/// Width of the Gaussian, in spacings of the pairs.
const SPREAD: f64 = 1.0;
/// The same where it is only asked whether brightness changes.
const WIDE: f64 = 6.0;

/// The other frame's own fill where both stand on the same pixels, and this frame's samples.
#[derive(Clone, Copy)]
pub struct Both<'a> {
    /// Of the other frame.
    pub fill: &'a Planes,
    /// What was measured here.
    pub samples: &'a Planes,
    /// Where.
    pub mask: &'a Mask,
}

/// The samples with values as this frame would show them, of which `image` is known, measured at the pixels of the mask.
pub fn levelled(carried: &Carried, (image, mask): (&Planes, &Mask), both: Option<Both<'_>>) -> Carried {
    levelled_within((SPREAD, false), carried, (image, mask), both)
}

/// The part of the squared disagreement of an image with samples that levelling over a wide Gaussian takes away: little but where brightness changes.
pub fn gain(carried: &Carried, (image, mask): (&Planes, &Mask)) -> f64 {
    let usual = usual::of_samples(carried);
    let misses = |carried: &Carried| usual::missed(carried, image, &usual);
    let before = misses(carried);
    if before > 0.0 {
        1.0 - misses(&levelled_within((WIDE, true), carried, (image, mask), None)) / before
    } else {
        0.0
    }
}

fn levelled_within(
    (spread, coarsely): (f64, bool),
    carried: &Carried,
    (image, mask): (&Planes, &Mask),
    both: Option<Both<'_>>,
) -> Carried {
    let size = image.size();
    let mut own = carried.not_judged();
    let at: Vec<usize> = carried.places.iter().map(|place| carried::pixel(size, *place)).collect();
    let measured = both.map_or(0, |both| both.mask.count());
    let around = Gaussian::new(size, carried.len() + measured, spread, coarsely);
    own.values.par_iter_mut().enumerate().for_each(|(channel, values)| {
        let values = Arc::make_mut(values);
        let plane = &image.as_slice()[channel];
        let ridge = (HALF * wide(mask, plane)).powi(2).max(f64::MIN_POSITIVE);
        let theirs = Usual::of(values.iter().copied()).widened();
        let own = Usual::measured(mask, plane).widened();
        let pair = |v: f32, y: f32| (f64::from(theirs.clamp(v)), f64::from(own.clamp(y)));
        let mut sums = Moments::new(around);
        for ((value, place), at) in values.iter().zip(&*carried.places).zip(&at) {
            sums.add(*at, pair(*value, Taps::new(size, place[0], place[1]).of(plane)));
        }
        if let Some(Both { fill, samples, mask }) = both {
            let (fill, samples) = (&fill.as_slice()[channel], &samples.as_slice()[channel]);
            let both = |(at, flag): &(usize, &bool)| **flag && carried.covers(*at);
            for (at, _) in mask.as_slice().iter().enumerate().filter(both) {
                sums.add(at, pair(fill.pixels()[at], samples.pixels()[at]));
            }
        }
        let maps = sums.blurred();
        for (value, at) in values.iter_mut().zip(&at) {
            *value = maps.of(*at, f64::from(*value), ridge) as f32;
        }
    });
    own
}

/// What is around a pixel.
#[derive(Clone, Copy)]
struct Gaussian {
    size: Size,
    /// Standard deviation in pixels.
    sigma: f64,
    /// Side of the square cells of which it is made.
    cell: usize,
}

impl Gaussian {
    /// Of so many spacings of pairs; coarsely, of cells a quarter as wide.
    fn new(size: Size, pairs: usize, spread: f64, coarsely: bool) -> Self {
        let sigma = spread * (size.pixels() as f64 / pairs.max(1) as f64).sqrt();
        let cell = if coarsely { ((sigma / 4.0) as usize).max(1) } else { 1 };
        Self { size, sigma, cell }
    }

    fn cells(self) -> Size {
        Size::new(self.size.height.div_ceil(self.cell), self.size.width.div_ceil(self.cell))
    }

    fn cell(self, pixel: usize) -> usize {
        if self.cell == 1 {
            return pixel;
        }
        let [row, column] = [pixel / self.size.width, pixel % self.size.width].map(|at| at / self.cell);
        row * self.cells().width + column
    }
}

/// Sums over pairs, by cell: of 1, v, y, v v and v y.
struct Moments {
    around: Gaussian,
    sums: [Vec<f32>; 5],
}

impl Moments {
    fn new(around: Gaussian) -> Self {
        Self { around, sums: std::array::from_fn(|_| vec![0.0; around.cells().pixels()]) }
    }

    fn add(&mut self, at: usize, (v, y): (f64, f64)) {
        let at = self.around.cell(at);
        for (sum, term) in self.sums.iter_mut().zip([1.0, v, y, v * v, v * y]) {
            sum[at] += term as f32;
        }
    }

    /// Of the pairs around each cell.
    fn blurred(self) -> Self {
        let Gaussian { sigma, cell, .. } = self.around;
        let blurred = |sums: Vec<f32>| blur(self.around.cells(), &sums, sigma / cell as f64);
        Self { sums: self.sums.map(blurred), ..self }
    }

    /// What becomes of a value at a pixel.
    fn of(&self, at: usize, value: f64, ridge: f64) -> f64 {
        let at = self.around.cell(at);
        let [count, v, y, vv, vy] = std::array::from_fn(|k| f64::from(self.sums[k][at]));
        if count <= 0.0 {
            return value;
        }
        let (v, y, vv, vy) = (v / count, y / count, vv / count, vy / count);
        let gain = ((vy - v * y + ridge) / ((vv - v * v).max(0.0) + ridge)).max(0.0);
        y + gain * (value - v)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::Plane;

    const SIZE: Size = Size::new(40, 50);

    fn scene(y: usize, x: usize) -> f32 {
        0.5 + 0.2 * (0.4 * y as f32).sin() * (0.3 * x as f32).cos()
    }

    /// Every third pixel, half as bright and lifted, and beside pixel centres.
    fn darker() -> (Planes, Carried) {
        let samples = Planes::new(SIZE, vec![Plane::from_fn(SIZE, |y, x| 0.5 * scene(y, x) + 0.1)]).unwrap();
        let mask = Mask::from_fn(SIZE, |y, x| (y + 2 * x) % 3 == 0);
        let place = |at: usize| [(at / SIZE.width) as f32, (at % SIZE.width) as f32 + 0.25];
        (samples.clone(), Carried::new(SIZE, (&samples, &mask), 1, place).unwrap())
    }

    #[test]
    fn a_gain_and_an_offset_are_undone() {
        let (_, carried) = darker();
        let image = Planes::new(SIZE, vec![Plane::from_fn(SIZE, scene)]).unwrap();
        let found = levelled(&carried, (&image, &Mask::from_fn(SIZE, |_, _| true)), None);
        let off = |values: &Carried| {
            let pairs = values.values[0].iter().zip(&*values.places);
            let errors = pairs.map(|(value, [y, x])| {
                let truth = f64::from(Taps::new(SIZE, *y, *x - 0.25).of(&image.as_slice()[0]));
                (f64::from(*value) - truth).powi(2)
            });
            (errors.sum::<f64>() / values.len() as f64).sqrt()
        };
        assert!(off(&found) < 0.1 * off(&carried), "{} of {}", off(&found), off(&carried));
    }

    /// Against the weighted moments in f64, sample by sample.
    #[test]
    fn it_is_the_regression_around_each_sample() {
        let (fill, carried) = darker();
        let image = Planes::new(SIZE, vec![Plane::from_fn(SIZE, |y, x| scene(y, x) + 0.01 * (y % 4) as f32)])
            .unwrap();
        let mask = Mask::from_fn(SIZE, |y, x| (2 * y + x) % 5 == 0);
        let both = Both { fill: &fill, samples: &image, mask: &mask };
        let everything = Mask::from_fn(SIZE, |_, _| true);
        let found = levelled(&carried, (&image, &everything), Some(both));
        let plane = &image.as_slice()[0];
        let mut pairs: Vec<(usize, f64, f64)> = carried
            .pixels(SIZE)
            .enumerate()
            .map(|(i, at)| {
                let [y, x] = carried.places[i];
                (at, f64::from(carried.values[0][i]), f64::from(Taps::new(SIZE, y, x).of(plane)))
            })
            .collect();
        let own = (0..SIZE.pixels()).filter(|&at| mask.as_slice()[at]);
        pairs.extend(
            own.map(|at| (at, f64::from(fill.as_slice()[0].pixels()[at]), f64::from(plane.pixels()[at]))),
        );
        let sigma = SPREAD * (SIZE.pixels() as f64 / pairs.len() as f64).sqrt();
        let reach = (4.0 * sigma).ceil() as usize;
        let ridge = (HALF * wide(&everything, plane)).powi(2);
        for (i, at) in carried.pixels(SIZE).enumerate().step_by(37) {
            let (row, column) = (at / SIZE.width, at % SIZE.width);
            let mut sums = [0.0; 5];
            for &(pixel, v, y) in &pairs {
                let (dy, dx) = (row.abs_diff(pixel / SIZE.width), column.abs_diff(pixel % SIZE.width));
                if dy <= reach && dx <= reach {
                    let weight = (-((dy * dy + dx * dx) as f64) / (2.0 * sigma * sigma)).exp();
                    [1.0, v, y, v * v, v * y]
                        .iter()
                        .zip(&mut sums)
                        .for_each(|(term, sum)| *sum += weight * term);
                }
            }
            let [_, v, y, vv, vy] = sums.map(|sum| sum / sums[0]);
            let value = f64::from(carried.values[0][i]);
            let expected = y + (vy - v * y + ridge) / (vv - v * v + ridge) * (value - v);
            assert!((f64::from(found.values[0][i]) - expected).abs() < 2e-5, "{i}");
        }
    }
}
