//! Bounds for footprints that share pixels: one footprint after the other, only where something is left to do.
//!
//! The dual of [`super::settle`]'s problem, by its coordinates: `x = clamp(x0 + R' l, low, high)`, and for each low-resolution
//! pixel in turn the `l_i` with which its own footprint gives `y_i`. That is a root of a nondecreasing, piecewise linear function of
//! one number, found by Newton's steps between bounds. A pixel is looked at again if a neighbour whose footprint overlaps has changed, so that
//! the work is where bounds cut in, and nothing where they do not. The order is that of the pixels: threads change no bit.
//!
//! Cost: a footprint's pixels, a few times for each pixel on the list; lists shrink from sweep to sweep.
//!
//! Source: S. Han, "A successive projection method", Mathematical Programming 40, 1988 (the dual, one constraint after the other).

use std::ops::Range;

use super::bounds::{Bounds, TOLERANCE};
use super::{Geometry, Plan};
use crate::kernel::rows::Rows;
use crate::{Plane, Run, Stop};

/// Sweeps over the list of what is left.
const SWEEPS: usize = 400;
/// Footprints between two questions whether to go on.
const ASK: usize = 4096;
/// Newton's steps for one footprint; what they leave is met again in the next sweep.
const NEWTON: usize = 24;
/// Part of the tolerance that a footprint is brought to, so that its neighbours may move it by the rest.
const CLOSE: f64 = 0.25;

/// What is asked of the pixels.
pub struct Task<'a> {
    /// The footprints' weighted means.
    pub target: &'a Plane,
    /// The largest of them, by absolute value.
    pub peak: f64,
    /// Bounds by the low-resolution pixel.
    pub bounds: &'a Bounds,
    /// The most that a multiplier may move its own footprint's mean.
    pub limit: f64,
}

/// The pixels of the result on their way.
pub struct Relaxed<'a> {
    task: Task<'a>,
    rows: Footprints,
    columns: Footprints,
    /// `x0 + R' l`, before it is clamped.
    free: &'a mut Plane,
    moved: Vec<f32>,
    list: Vec<u32>,
    marked: Vec<bool>,
    values: Vec<Pixel>,
}

/// One pixel of a footprint.
#[derive(Clone, Copy)]
struct Pixel {
    weight: f64,
    value: f64,
    low: f64,
    high: f64,
}

/// The footprints of an axis.
struct Footprints {
    taps: Vec<(usize, Vec<f64>)>,
    /// Low-resolution pixels whose footprints overlap that of each.
    near: Vec<Range<usize>>,
    /// The low-resolution pixel whose bounds hold for each high-resolution one.
    sources: Vec<usize>,
}

impl Footprints {
    fn new(reduce: &Rows, sources: Vec<usize>) -> Self {
        let row = |i| {
            let (start, taps) = reduce.row(i);
            (start, taps.iter().map(|tap| f64::from(*tap)).collect::<Vec<_>>())
        };
        let taps: Vec<(usize, Vec<f64>)> = (0..reduce.outputs()).map(row).collect();
        let end = |i: usize| taps[i].0 + taps[i].1.len();
        // Footprints begin and end in the order of their pixels.
        let near = (0..taps.len()).map(|i| {
            let first = (0..i).rev().take_while(|&k| end(k) > taps[i].0).last().unwrap_or(i);
            let last = (i + 1..taps.len()).take_while(|&k| taps[k].0 < end(i)).last().unwrap_or(i);
            first..last + 1
        });
        let near = near.collect();
        Self { taps, near, sources }
    }
}

impl<'a> Relaxed<'a> {
    /// Starts from `free`, the image without bounds; `residual` is what its clamped twin lacks of the target.
    pub fn new(plan: &Plan, task: Task<'a>, residual: &Plane, free: &'a mut Plane) -> Self {
        let Geometry { vertical, horizontal, sampling } = plan.geometry;
        let sources = |axis: super::Axis| (0..axis.outputs).map(|at| axis.source(sampling, at)).collect();
        let [down, across] = &plan.model.reduce;
        let tolerance = TOLERANCE * task.peak;
        let open = residual.pixels().iter().enumerate();
        let open = open.filter(|(_, value)| f64::from(value.abs()) > CLOSE * tolerance);
        Self {
            rows: Footprints::new(down, sources(vertical)),
            columns: Footprints::new(across, sources(horizontal)),
            moved: vec![0.0; residual.pixels().len()],
            list: open.map(|(at, _)| at as u32).collect(),
            marked: vec![false; residual.pixels().len()],
            values: Vec::new(),
            task,
            free,
        }
    }

    /// Works until nothing is left to do; how that ended, and after how many sweeps.
    pub fn run(&mut self, run: &Run<'_>) -> (Stop, usize) {
        for sweep in 0..SWEEPS {
            if self.list.is_empty() {
                return (Stop::Converged, sweep);
            }
            if let Some(stop) = run.interrupted() {
                return (stop, sweep);
            }
            for (done, at) in std::mem::take(&mut self.list).into_iter().enumerate() {
                if done % ASK == ASK - 1
                    && let Some(stop) = run.interrupted()
                {
                    return (stop, sweep);
                }
                self.one(at as usize);
            }
            for at in &self.list {
                self.marked[*at as usize] = false;
            }
            self.list.sort_unstable();
        }
        (Stop::IterationLimit, SWEEPS)
    }

    /// Gives one footprint its mean, and puts those that it moves on the list.
    fn one(&mut self, at: usize) {
        let width = self.columns.taps.len();
        let (row, column) = (at / width, at % width);
        self.gather(row, column);
        let target = f64::from(self.task.target.pixels()[at]);
        let tolerance = TOLERANCE * self.task.peak;
        let square: f64 = self.values.iter().map(|pixel| pixel.weight * pixel.weight).sum();
        let mut step = 0.0;
        let (mut from, mut to) = (f64::NEG_INFINITY, f64::INFINITY);
        for newton in 0..NEWTON {
            let (mut mean, mut slope) = (0.0, 0.0);
            for pixel in &self.values {
                let value = pixel.value + pixel.weight * step;
                mean += pixel.weight * value.clamp(pixel.low, pixel.high);
                let is_free = value > pixel.low && value < pixel.high;
                slope += if is_free { pixel.weight * pixel.weight } else { 0.0 };
            }
            let left = target - mean;
            if left > 0.0 {
                from = step;
            } else {
                to = step;
            }
            if left.abs() <= if newton == 0 { tolerance } else { CLOSE * tolerance } {
                break;
            }
            step += left / if slope > 0.0 { slope } else { square };
            // Past a kink the slope is another's: between two that are known the middle is never bad.
            if step <= from || step >= to {
                step = f64::midpoint(from, to);
            }
        }
        let most = self.task.limit / square;
        let before = f64::from(self.moved[at]);
        step = (before + step).clamp(-most, most) - before;
        if step.abs() * square <= CLOSE * tolerance {
            return;
        }
        self.moved[at] += step as f32;
        let ((top, down), (left, across)) = (&self.rows.taps[row], &self.columns.taps[column]);
        for (y, v) in (*top..).zip(down) {
            for (value, h) in self.free.row_mut(y)[*left..].iter_mut().zip(across) {
                *value += (v * h * step) as f32;
            }
        }
        for y in self.rows.near[row].clone() {
            for x in self.columns.near[column].clone() {
                let near = y * width + x;
                if !self.marked[near] {
                    self.marked[near] = true;
                    self.list.push(near as u32);
                }
            }
        }
    }

    /// Collects the pixels of a footprint.
    fn gather(&mut self, row: usize, column: usize) {
        self.values.clear();
        let bounds = self.task.bounds;
        let ((top, down), (left, across)) = (&self.rows.taps[row], &self.columns.taps[column]);
        for (y, v) in (*top..).zip(down) {
            let (values, source) = (self.free.row(y), self.rows.sources[y]);
            let (low, high) = (bounds.low.row(source), bounds.high.row(source));
            for (x, h) in (*left..).zip(across) {
                let source = self.columns.sources[x];
                let low = f64::from(low[source]);
                self.values.push(Pixel {
                    weight: v * h,
                    value: f64::from(values[x]),
                    low,
                    high: f64::from(high[source]).max(low),
                });
            }
        }
    }
}
