//! Bounds for footprints whose weights change their sign: multipliers by accelerated steps of the dual, window by window.
//!
//! The problem is that of [`super::relax`]; one footprint after the other creeps there. A step is `(R R')^-1` times what the image lacks
//! of the samples: without bounds in the way the first one is all but exact. Momentum begins anew where it leads down.
//!
//! Where bounds cut in beside hard edges it takes hundreds of steps, elsewhere none. So windows of 24 x 24 low-resolution pixels, in which
//! a footprint lacks more than the tolerance, go on by themselves, each with the multipliers around it as they are (alternating
//! minimisation over blocks that overlap). Those that are worked on together share no pixel, so threads change no bit.
//!
//! Roofline: about 20 000 multiplications a step of a window at a factor of 2, all in the first cache.
//!
//! Source: Y. Nesterov, "A method of solving a convex programming problem with convergence rate O(1/k^2)", Soviet Mathematics Doklady 27,
//! 1983; B. O'Donoghue, E. Candes, "Adaptive restart for accelerated gradient schemes", Foundations of Computational Mathematics 15, 2015.
#![allow(
    clippy::inline_always,
    reason = "a body must be compiled inside the function that enables the features"
)]

use std::ops::Range;

use lacuna_core::parallel::prelude::*;

use super::bounds::{Bounds, TOLERANCE, clamp, largest};
use super::{Axis, Plan, Sampling};
use crate::kernel::rows::Rows;
use crate::kernel::{Body, Isa, dispatch, fma};
use crate::limiter::Moved;
use crate::operator::taps::Taps;
use crate::{Plane, Run, Stop};

/// Low-resolution pixels along a side that a window answers for.
const SIDE: usize = 16;
/// Those around it whose multipliers move along.
const MARGIN: usize = 4;
/// Steps of a window in a sweep.
const STEPS: usize = 200;
/// Sweeps over the windows that are left.
const SWEEPS: usize = 6;
/// Weights of `(R R')^-1` below this are left out: a step that is nearly right costs half as much.
const NEARLY: f64 = 1e-3;
/// Pixels that are summed side by side; rows are padded to a multiple of them.
const LANES: usize = 8;
/// Part of the tolerance that a window is brought to, so that its neighbours may move it by the rest.
const CLOSE: f32 = 0.5;

/// What is asked of the pixels.
struct Task<'a> {
    /// What the reduction is to be.
    samples: &'a Plane,
    /// The least and the greatest value allowed.
    range: (f32, f32),
    /// By how much the reduction may be off.
    tolerance: f32,
}

/// Moves `plane`, whose reduction is `samples`, into `bounds`, which are those of `range`; how many pixels were at one, how it ended and
/// after how many steps of a window at most.
pub fn ascend(
    plan: &Plan,
    samples: &Plane,
    (bounds, range): (&Bounds, (f32, f32)),
    plane: &mut Plane,
    run: &Run<'_>,
) -> (Moved, Stop, usize) {
    let tolerance = (TOLERANCE * largest(samples)) as f32;
    let task = Task { samples, range, tolerance: tolerance.max(f32::MIN_POSITIVE) };
    let (stop, steps) = finish(plan, &task, plane, run);
    (clamp(plan, bounds, plane), stop, steps)
}

/// Moves `free`, the image before it is clamped; how that ended, and after how many steps of a window at most.
fn finish(plan: &Plan, task: &Task<'_>, free: &mut Plane, run: &Run<'_>) -> (Stop, usize) {
    let lines = [plan.geometry.vertical, plan.geometry.horizontal]
        .map(|axis| Line::all(&axis, plan.geometry.sampling));
    let mut steps = 0;
    for _ in 0..SWEEPS {
        let open = open(plan, task, &lines, free);
        if open.is_empty() {
            return (Stop::Converged, steps);
        }
        let mut most = 0;
        // Windows of one colour share no pixel of the result.
        for colour in 0..4 {
            if let Some(stop) = run.interrupted() {
                return (stop, steps);
            }
            let same = |&&(row, column): &&(usize, usize)| (row % 2) * 2 + column % 2 == colour;
            let places: Vec<_> = open.iter().filter(same).copied().collect();
            let done = places.into_par_iter().map_init(Window::default, |window, (row, column)| {
                window.load(&lines[0][row], &lines[1][column], task, free);
                let steps = dispatch(Isa::best(), Ascent { window, tolerance: CLOSE * task.tolerance });
                (row, column, window.free.clone(), steps)
            });
            for (row, column, values, steps) in done {
                let (rows, columns) = (lines[0][row].high.clone(), lines[1][column].high.clone());
                for (y, values) in rows.zip(values.chunks(padded(columns.len()))) {
                    free.row_mut(y)[columns.clone()].copy_from_slice(&values[..columns.len()]);
                }
                most = most.max(steps);
            }
        }
        steps += most;
    }
    let stop = if open(plan, task, &lines, free).is_empty() { Stop::Converged } else { Stop::IterationLimit };
    (stop, steps)
}

/// The windows in which a footprint lacks more than the tolerance, row by row.
fn open(plan: &Plan, task: &Task<'_>, lines: &[Vec<Line>; 2], free: &Plane) -> Vec<(usize, usize)> {
    let mut inside = free.clone();
    let (low, high) = task.range;
    inside.pixels_mut().iter_mut().for_each(|value| *value = value.clamp(low, high));
    let back = plan.model.reduce(&inside);
    let is_open = |&(row, column): &(usize, usize)| {
        let columns = lines[1][column].own.clone();
        lines[0][row].own.clone().any(|y| {
            let pairs = back.row(y)[columns.clone()].iter().zip(&task.samples.row(y)[columns.clone()]);
            pairs.into_iter().any(|(back, sample)| (sample - back).abs() > task.tolerance)
        })
    };
    let all = (0..lines[0].len()).flat_map(|row| (0..lines[1].len()).map(move |column| (row, column)));
    all.filter(is_open).collect()
}

/// One axis of a window.
struct Line {
    /// Low-resolution pixels that the window answers for.
    own: Range<usize>,
    /// Those whose multipliers it moves.
    low: Range<usize>,
    /// The pixels of the result in their footprints.
    high: Range<usize>,
    reduce: Rows,
    adjoint: Rows,
    gram_inverse: Rows,
}

impl Line {
    /// The windows of an axis.
    fn all(axis: &Axis, sampling: Sampling) -> Vec<Self> {
        let reduce = axis.reduce(sampling);
        let windows = (0..axis.inputs).step_by(SIDE).map(|from| {
            let own = from..axis.inputs.min(from + SIDE);
            let low = from.saturating_sub(MARGIN)..axis.inputs.min(own.end + MARGIN);
            // Footprints begin and end in the order of their pixels.
            let end = |(start, weights): (usize, &[f64])| start + weights.len();
            let high = reduce.row(low.start).0..end(reduce.row(low.end - 1));
            let shifted = low.clone().map(|i| reduce.row(i)).map(|(at, row)| (at - high.start, row.to_vec()));
            let part = Taps::from_rows(high.len(), shifted);
            Self {
                adjoint: part.transpose().rows(),
                gram_inverse: part.after(&part.transpose()).inverse(NEARLY).rows(),
                reduce: part.rows(),
                own,
                low,
                high,
            }
        });
        windows.collect()
    }
}

/// The numbers of a window, rows padded. Images of multipliers lie on their side: one row a column.
#[derive(Default)]
struct Window<'a> {
    lines: Option<[&'a Line; 2]>,
    range: (f32, f32),
    samples: Vec<f32>,
    start: Vec<f32>,
    free: Vec<f32>,
    inside: Vec<f32>,
    multiplier: Vec<f32>,
    ahead: Vec<f32>,
    next: Vec<f32>,
    residual: Vec<f32>,
    scratch: [Vec<f32>; 2],
}

impl<'a> Window<'a> {
    fn load(&mut self, vertical: &'a Line, horizontal: &'a Line, task: &Task<'_>, free: &Plane) {
        self.lines = Some([vertical, horizontal]);
        self.range = task.range;
        cut(free, (&vertical.high, &horizontal.high), &mut self.start);
        self.free.clone_from(&self.start);
        cut(task.samples, (&vertical.low, &horizontal.low), &mut self.scratch[0]);
        turn(&self.scratch[0], (vertical.low.len(), horizontal.low.len()), &mut self.samples);
        for plane in [&mut self.multiplier, &mut self.ahead] {
            plane.clear();
            plane.resize(self.samples.len(), 0.0);
        }
    }

    /// What the clamped pixels lack of the samples; the largest of it.
    #[inline(always)]
    fn lack<const FUSED: bool>(&mut self, [vertical, horizontal]: [&Line; 2]) -> f32 {
        let (low, high) = self.range;
        self.inside.clear();
        self.inside.extend(self.free.iter().map(|value| value.max(low).min(high)));
        let (tall, wide) = (vertical.low.len(), horizontal.high.len());
        let [first, second] = &mut self.scratch;
        columns::<FUSED>(&vertical.reduce, &self.inside, padded(wide), first);
        turn(first, (tall, wide), second);
        columns::<FUSED>(&horizontal.reduce, second, padded(tall), &mut self.residual);
        let mut most = [0.0_f32; LANES];
        let pairs =
            self.residual.as_chunks_mut::<LANES>().0.iter_mut().zip(self.samples.as_chunks::<LANES>().0);
        for (residual, samples) in pairs {
            for ((residual, sample), most) in residual.iter_mut().zip(samples).zip(&mut most) {
                *residual = sample - *residual;
                *most = most.max(residual.abs());
            }
        }
        // Beyond the ends of rows nothing is asked.
        most.into_iter().fold(0.0, f32::max)
    }

    /// A step by what is lacking; the momentum after it.
    #[inline(always)]
    fn step<const FUSED: bool>(&mut self, [vertical, horizontal]: [&Line; 2], mut momentum: f32) -> f32 {
        let (tall, wide) = (vertical.low.len(), horizontal.low.len());
        let [first, second] = &mut self.scratch;
        columns::<FUSED>(&horizontal.gram_inverse, &self.residual, padded(tall), first);
        turn(first, (wide, tall), second);
        columns::<FUSED>(&vertical.gram_inverse, second, padded(wide), first);
        turn(first, (tall, wide), &mut self.next);
        let mut uphill = 0.0;
        for ((next, ahead), (before, residual)) in
            self.next.iter_mut().zip(&self.ahead).zip(self.multiplier.iter().zip(&self.residual))
        {
            *next += ahead;
            uphill += (*next - before) * residual;
        }
        if uphill < 0.0 {
            momentum = 1.0;
        }
        let after = f32::midpoint(1.0, (1.0 + 4.0 * momentum * momentum).sqrt());
        let factor = (momentum - 1.0) / after;
        for ((ahead, next), before) in self.ahead.iter_mut().zip(&self.next).zip(&self.multiplier) {
            *ahead = next + factor * (next - before);
        }
        std::mem::swap(&mut self.multiplier, &mut self.next);
        columns::<FUSED>(&horizontal.adjoint, &self.ahead, padded(tall), first);
        turn(first, (horizontal.high.len(), tall), second);
        columns::<FUSED>(&vertical.adjoint, second, padded(horizontal.high.len()), &mut self.free);
        self.free.iter_mut().zip(&self.start).for_each(|(free, start)| *free += start);
        after
    }
}

/// Steps of one window until nothing lacks more than the tolerance; how many.
struct Ascent<'w, 'a> {
    window: &'w mut Window<'a>,
    tolerance: f32,
}

impl Body for Ascent<'_, '_> {
    type Output = usize;

    #[inline(always)]
    fn run<const FUSED: bool>(self) -> usize {
        let Some(lines) = self.window.lines else { return 0 };
        let mut momentum = 1.0;
        for step in 0..STEPS {
            if self.window.lack::<FUSED>(lines) <= self.tolerance {
                return step;
            }
            momentum = self.window.step::<FUSED>(lines, momentum);
        }
        STEPS
    }
}

/// The length of a row in memory.
const fn padded(width: usize) -> usize {
    width.next_multiple_of(LANES)
}

/// A part of a plane, its rows padded with zeros.
fn cut(plane: &Plane, (rows, columns): (&Range<usize>, &Range<usize>), to: &mut Vec<f32>) {
    to.clear();
    for y in rows.clone() {
        to.extend_from_slice(&plane.row(y)[columns.clone()]);
        to.resize(to.len().next_multiple_of(LANES), 0.0);
    }
}

/// Maps every column of an image of this width in memory.
#[inline(always)]
fn columns<const FUSED: bool>(map: &Rows, from: &[f32], width: usize, to: &mut Vec<f32>) {
    to.resize(map.outputs() * width, 0.0);
    for (output, to) in to.chunks_exact_mut(width).enumerate() {
        let (start, taps) = map.row(output);
        for (x, to) in to.as_chunks_mut::<LANES>().0.iter_mut().enumerate() {
            let mut sums = [0.0_f32; LANES];
            for (&tap, row) in taps.iter().zip(from[start * width..].chunks_exact(width)) {
                let values = &row.as_chunks::<LANES>().0[x];
                sums.iter_mut()
                    .zip(values)
                    .for_each(|(sum, &value)| *sum = fma::<f32, FUSED>(tap, value, *sum));
            }
            *to = sums;
        }
    }
}

/// Rows become columns.
#[inline(always)]
fn turn(from: &[f32], (height, width): (usize, usize), to: &mut Vec<f32>) {
    let (stride, tall) = (padded(width), padded(height));
    to.resize(width * tall, 0.0);
    for (x, to) in to.chunks_exact_mut(tall).enumerate() {
        let (to, rest) = to.split_at_mut(height);
        to.iter_mut().zip(from[x..].iter().step_by(stride)).for_each(|(to, value)| *to = *value);
        rest.fill(0.0);
    }
}

#[cfg(test)]
#[path = "dual/tests.rs"]
mod tests;
