//! One axis of an enlargement: where its pixels lie, and the two maps between them.
//!
//! Along an axis `n` low-resolution pixels `y` become `N` high-resolution ones `x`. High-resolution pixel `j` covers
//! `[(j + shift) / scale, (j + 1 + shift) / scale]` in units of low-resolution pixels, counted from the left edge of
//! the first one. The edges of the two display windows lie on each other, so `shift` is not 0 only where a data window
//! does not begin at a multiple of the scale.
//!
//! - `reduce` (R, n rows over N): what the model of a pixel makes of high-resolution pixels. Every row sums to 1.
//! - `spline` (U, N rows over n): the cubic spline with a knot at each low-resolution centre, coefficients to
//!   high-resolution pixels: means over pixels for `box`, values at centres else.
//! - `prefilter` (n over n): the coefficients with which the spline is what `y` says: `(R U)^-1`, so that the result, reduced, is
//!   `y`; for `box` the inverse of the spline's means over low-resolution pixels, which is the same where the factor is whole, and for
//!   `point` of its values at their centres, which is the same where high-resolution pixels stand there.
//!   At broken factors a high-resolution pixel that straddles two has one value for both, and a spline whose *shares* had the
//!   given means would run through the wrong places; so means are those of the continuous spline, over both kinds of pixels.
//!   Weights at centres have their own middle beside the pixel's there, another one in each: so weighted means are
//!   integrals, for the prefilter over the spline, and in R over the cubics through four high-resolution pixels each.
//!
//! Boundary: coefficients go on linearly beyond the ends (a natural spline), and so does the image where a footprint
//! reaches beyond it, so a ramp stays that ramp up to the border. A single pixel is constant.
//!
//! Source: M. Unser, A. Aldroubi, "A general sampling theory for nonideal acquisition devices", IEEE Transactions on Signal
//! Processing 42(11), 1994 (consistent reconstruction: R x = y with x in a spline space).

use super::Sampling;
use crate::Error;
use crate::operator::taps::Taps;

/// Weights of an inverse below this are cut: what f32 would lose anyway.
const FLOOR: f64 = 2e-8;
/// Places across a footprint that integrals are summed at.
const PLACES: usize = 64;

/// Where the pixels of an axis lie.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Axis {
    /// Number of low-resolution pixels, at least 1.
    pub inputs: usize,
    /// Number of high-resolution pixels, at least 1.
    pub outputs: usize,
    /// High-resolution pixels for a low-resolution one, 1 to 16.
    pub scale: f64,
    /// Where the first high-resolution pixel begins, in high-resolution pixels from the edge of the first
    /// low-resolution one; above -1, at most 0.
    pub shift: f64,
}

impl Axis {
    /// An axis whose ends lie on each other: `inputs` pixels become `outputs`.
    pub fn whole(inputs: usize, outputs: usize) -> Self {
        Self { inputs, outputs, scale: outputs as f64 / inputs.max(1) as f64, shift: 0.0 }
    }

    /// Whether the numbers are in range, and whole where the model asks for it.
    ///
    /// # Errors
    /// [`Error::Setting`].
    pub fn check(&self, sampling: Sampling) -> Result<(), Error> {
        let setting = |name, value: f64, range| Err(Error::setting(name, &value, range));
        if self.inputs == 0 || self.outputs == 0 {
            return setting("pixels", 0.0, "at least 1");
        }
        if !(1.0..=16.0).contains(&self.scale) {
            return setting("scale", self.scale, "1 to 16");
        }
        if !(self.shift > -1.0 && self.shift <= 0.0) {
            return setting("shift", self.shift, "above -1, at most 0");
        }
        if sampling == Sampling::Grid
            && !(self.is_whole() && self.outputs == self.scale as usize * self.inputs)
        {
            return setting("scale", self.scale, "a whole number where pixels are sampled as a grid");
        }
        Ok(())
    }

    /// Whether high-resolution pixels stand alike in every low-resolution one.
    pub(super) fn is_whole(&self) -> bool {
        self.scale.fract() == 0.0 && self.shift == 0.0
    }

    /// The low-resolution pixel that the centre of a high-resolution one lies in; for a grid the nearest sample.
    pub fn source(&self, sampling: Sampling, output: usize) -> usize {
        let at = match sampling {
            Sampling::Grid => (output as f64 / self.scale - 0.5).ceil(),
            _ => self.centre(output).floor(),
        };
        (at.max(0.0) as usize).min(self.inputs.saturating_sub(1))
    }

    /// The low-resolution pixels that a high-resolution one has shares of; in a grid the one that it stands for.
    pub(super) fn touched(&self, sampling: Sampling, output: usize) -> std::ops::Range<usize> {
        let source = self.source(sampling, output);
        if sampling == Sampling::Grid {
            return source..source + 1;
        }
        let edge = |output: usize| (output as f64 + self.shift) / self.scale;
        // What is too small to be an overlap is the rounding of the scale.
        let (from, to) = ((edge(output) + 1e-9).max(0.0) as usize, (edge(output + 1) - 1e-9).ceil() as usize);
        from.min(source)..to.clamp(source + 1, self.inputs.max(source + 1))
    }

    /// The centre of a high-resolution pixel, in low-resolution pixels.
    pub(super) fn centre(&self, output: usize) -> f64 {
        (output as f64 + 0.5 + self.shift) / self.scale
    }

    /// The centre of a low-resolution pixel, in high-resolution pixels from the left edge of the first one.
    fn high_centre(&self, input: usize) -> f64 {
        (input as f64 + 0.5) * self.scale - self.shift
    }

    /// R: what a model makes of the high-resolution pixels.
    pub fn reduce(&self, sampling: Sampling) -> Taps {
        let row = |input: usize| match sampling {
            Sampling::Box => self.area(input),
            Sampling::Grid => (input * self.scale as usize, vec![1.0]),
            Sampling::Point => self.cubic(input),
            Sampling::Gaussian(_) | Sampling::Mitchell => self.weighted(sampling, input),
        };
        Taps::from_rows(self.outputs, (0..self.inputs).map(row))
    }

    /// The shares of the high-resolution pixels in the area of a low-resolution one.
    fn area(&self, input: usize) -> (usize, Vec<f64>) {
        let from = (input as f64 * self.scale - self.shift).max(0.0);
        let to = ((input + 1) as f64 * self.scale - self.shift).min(self.outputs as f64);
        let last = self.outputs - 1;
        let (first, end) = ((from.floor() as usize).min(last), (to.ceil() as usize).min(self.outputs));
        let share = |j: usize| (to.min(j as f64 + 1.0) - from.max(j as f64)).max(0.0);
        // What is too small to be an overlap is the rounding of the scale.
        let shares: Vec<f64> = (first..end.max(first + 1)).map(share).collect();
        let keep = |share: &f64| *share > 1e-9;
        let begin = shares.iter().position(keep).unwrap_or(0);
        let stop = shares.iter().rposition(keep).map_or(begin + 1, |at| at + 1);
        let sum: f64 = shares[begin..stop].iter().sum();
        (first + begin, shares[begin..stop].iter().map(|share| share / sum).collect())
    }

    /// The cubic through the four pixels around the centre.
    fn cubic(&self, input: usize) -> (usize, Vec<f64>) {
        let at = self.high_centre(input) - 0.5;
        let nearest = at.round();
        if (at - nearest).abs() < 1e-9 && (0.0..self.outputs as f64).contains(&nearest) {
            return (nearest as usize, vec![1.0]);
        }
        let count = self.outputs.min(4);
        let first = (at.floor() as isize - 1).clamp(0, (self.outputs - count) as isize) as usize;
        (first, through(at - first as f64, count).collect())
    }

    /// The normalised weights of a filter, at the centres of pixels where the factor is whole.
    fn weighted(&self, sampling: Sampling, input: usize) -> (usize, Vec<f64>) {
        let Some((radius, weight)) = sampling.weight() else { return (0, vec![1.0]) };
        let centre = self.high_centre(input) - 0.5;
        if !self.is_whole() {
            let entries = places(radius, weight).into_iter().flat_map(|(place, weight)| {
                let at = centre + place * self.scale;
                let first = at.floor() as isize - 1;
                (first..).zip(through(at - first as f64, 4).map(move |part| weight * part))
            });
            return inside(entries, self.outputs);
        }
        let first = (centre - radius * self.scale).ceil() as isize;
        let last = (centre + radius * self.scale).floor() as isize;
        let weights: Vec<f64> = (first..=last).map(|j| weight((j as f64 - centre) / self.scale)).collect();
        let sum: f64 = weights.iter().sum();
        inside((first..=last).zip(weights.iter().map(|weight| weight / sum)), self.outputs)
    }

    /// U: spline coefficients to high-resolution pixels.
    pub fn spline(&self, sampling: Sampling) -> Taps {
        let row = |output: usize| {
            let (weights, first): (Vec<f64>, isize) = if sampling == Sampling::Box {
                let from = (output as f64 + self.shift) / self.scale;
                let to = (output as f64 + 1.0 + self.shift) / self.scale;
                let (first, last) = ((from - 2.5).floor() as isize, (to + 1.5).ceil() as isize);
                let knot = |k: isize| k as f64 + 0.5;
                let mean = |k| (integral(to - knot(k)) - integral(from - knot(k))) * self.scale;
                ((first..=last).map(mean).collect(), first)
            } else {
                let at = match sampling {
                    Sampling::Grid => output as f64 / self.scale,
                    _ => self.centre(output) - 0.5,
                };
                let first = at.floor() as isize - 1;
                ((first..first + 4).map(|k| cubic(at - k as f64)).collect(), first)
            };
            let end = first + weights.len() as isize;
            inside((first..end).zip(weights), self.inputs)
        };
        Taps::from_rows(self.inputs, (0..self.outputs).map(row))
    }

    /// The coefficients of the spline that is what is given.
    pub fn prefilter(&self, sampling: Sampling) -> Taps {
        if matches!(sampling, Sampling::Box | Sampling::Point) {
            return Self::whole(self.inputs, self.inputs).spline(sampling).inverse(FLOOR);
        }
        match sampling.weight() {
            Some((radius, weight)) if !self.is_whole() => {
                let places = places(radius, weight);
                let row = |input: usize| {
                    let entries = places.iter().flat_map(|&(place, weight)| {
                        let at = input as f64 + place;
                        let first = at.floor() as isize - 1;
                        (first..first + 4).map(move |k| (k, weight * cubic(at - k as f64)))
                    });
                    inside(entries, self.inputs)
                };
                Taps::from_rows(self.inputs, (0..self.inputs).map(row)).inverse(FLOOR)
            }
            _ => self.reduce(sampling).after(&self.spline(sampling)).inverse(FLOOR),
        }
    }

    /// M = (R R')^-1, by which R' M takes a residual back to the nearest image without one.
    pub fn gram_inverse(&self, sampling: Sampling) -> Taps {
        let reduce = self.reduce(sampling);
        reduce.after(&reduce.transpose()).inverse(FLOOR)
    }

    /// The high-resolution pixels of each low-resolution one, if they are shared by none, weigh alike, and leave none
    /// over.
    pub fn cells(&self, sampling: Sampling) -> Option<Vec<std::ops::Range<usize>>> {
        let reduce = self.reduce(sampling);
        let mut end = 0;
        let mut cells = Vec::with_capacity(self.inputs);
        for input in 0..self.inputs {
            let (start, weights) = reduce.row(input);
            if start != end || weights.iter().any(|weight| (weight - weights[0]).abs() > 1e-9) {
                return None;
            }
            end = start + weights.len();
            cells.push(start..end);
        }
        (end == self.outputs).then_some(cells)
    }
}

/// The weights at `t` of the polynomial through values at 0, 1, ..., `count - 1`.
fn through(t: f64, count: usize) -> impl Iterator<Item = f64> {
    let weight = move |j: usize| {
        (0..count).filter(|&k| k != j).map(|k| (t - k as f64) / (j as f64 - k as f64)).product()
    };
    (0..count).map(weight)
}

/// Places across a footprint, from its centre, and their shares of its weight.
fn places(radius: f64, weight: impl Fn(f64) -> f64) -> Vec<(f64, f64)> {
    let place = |at: usize| ((2 * at + 1) as f64 / PLACES as f64 - 1.0) * radius;
    let weights: Vec<(f64, f64)> = (0..PLACES).map(|at| (place(at), weight(place(at)))).collect();
    let sum: f64 = weights.iter().map(|(_, weight)| weight).sum();
    weights.into_iter().map(|(place, weight)| (place, weight / sum)).collect()
}

/// A row over indices that may lie outside `0..n`, folded onto those inside: what is outside goes on linearly.
fn inside(entries: impl Iterator<Item = (isize, f64)>, n: usize) -> (usize, Vec<f64>) {
    let last = n as isize - 1;
    let mut folded: Vec<(isize, f64)> = Vec::new();
    for (at, weight) in entries {
        let (edge, inward) = if at < 0 { (0, 1) } else { (last, -1) };
        if (0..=last).contains(&at) {
            folded.push((at, weight));
        } else if n == 1 {
            folded.push((0, weight));
        } else {
            let beyond = (at - edge).abs() as f64;
            folded.push((edge, weight * (1.0 + beyond)));
            folded.push((edge + inward, -weight * beyond));
        }
    }
    let first = folded.iter().map(|entry| entry.0).min().unwrap_or(0);
    let end = folded.iter().map(|entry| entry.0).max().unwrap_or(0) + 1;
    let mut row = vec![0.0; (end - first) as usize];
    for (at, weight) in folded {
        row[(at - first) as usize] += weight;
    }
    (first as usize, row)
}

/// The centred cubic B-spline.
fn cubic(x: f64) -> f64 {
    let d = x.abs();
    if d < 1.0 {
        2.0 / 3.0 - d * d + d * d * d / 2.0
    } else if d < 2.0 {
        (2.0 - d).powi(3) / 6.0
    } else {
        0.0
    }
}

/// Its integral from minus infinity.
fn integral(x: f64) -> f64 {
    let d = x.abs();
    let half = if d < 1.0 {
        2.0 / 3.0 * d - d.powi(3) / 3.0 + d.powi(4) / 8.0
    } else {
        0.5 - (2.0 - d).max(0.0).powi(4) / 24.0
    };
    0.5 + half.copysign(x)
}

#[cfg(test)]
#[path = "axis/tests.rs"]
mod tests;
