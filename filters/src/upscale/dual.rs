//! Bounds for footprints whose weights change their sign: multipliers by conjugate gradients of the dual, window by window.
//!
//! The problem is that of [`super::relax`]; one footprint after the other creeps there. The slope of the dual is what the clamped image
//! lacks of the samples, `y - R clamp(x)`, and its bend `R M R'`, with `M` the pixels between the bounds. Directions are conjugate after
//! Polak and Ribiere and begin anew where they would lead down. The preconditioner is `S (R R')^-1 S`, with `1 / S^2` the share of a
//! footprint's squared weights that is between the bounds: without bounds in the way the first step is all but exact. Along a direction
//! the slope falls in straight pieces, on which Newton's method finds the length of the step.
//!
//! Where bounds cut in beside hard edges it takes hundreds of steps, elsewhere none. So windows of 12 x 12 low-resolution pixels, in which
//! a footprint lacks more than the tolerance, go on by themselves, each with the multipliers around it as they are (alternating
//! minimisation over blocks that overlap). Those that are worked on together share no pixel, so threads change no bit.
//!
//! Roofline: about 8 000 multiplications a step of a window at a factor of 2, all in the first cache; larger windows leave it.
//!
//! Sources: E. Polak, G. Ribiere, "Note sur la convergence de methodes de directions conjuguees", Revue Francaise d'Informatique et de
//! Recherche Operationnelle 3, 1969; J. Nocedal, S. Wright, "Numerical Optimization", Springer, 2006, section 5.2, for the restart.
#![allow(
    clippy::inline_always,
    reason = "a body must be compiled inside the function that enables the features"
)]

mod maps;

use std::ops::Range;

use lacuna_core::parallel::prelude::*;

use self::maps::{LANES, Map, padded};
use super::bounds::{Bounds, TOLERANCE, clamp, largest};
use super::{Axis, Plan, Sampling};
use crate::kernel::{Body, Isa, dispatch, fma};
use crate::limiter::Moved;
use crate::operator::taps::Taps;
use crate::{Plane, Run, Stop};

/// Small windows stay in the first cache; what creeps from one to the next needs larger ones.
const KINDS: [Kind; 2] = [Kind { side: 8, margin: 2, sweeps: 8 }, Kind { side: 16, margin: 4, sweeps: 6 }];
/// Steps of a window in a sweep.
const STEPS: usize = 200;
/// Weights of `(R R')^-1` below this are left out: a step that is nearly right costs half as much.
const NEARLY: f64 = 1e-3;
/// The share of a footprint's squared weights that counts as between the bounds, at least. With 0.1 a factor of 2 takes a sixth fewer steps,
/// but a factor of 1.5 is left 5e-4 off.
const LEAST_FREE: f32 = 0.3;
/// Trials of a step's length, and the part of the slope that one may leave.
const SEARCH: usize = 4;
const NEAR: f32 = 0.2;
/// Part of the tolerance that a window is brought to, so that its neighbours may move it by the rest.
const CLOSE: f32 = 0.5;
/// What a sweep lowers the lack of a window by: its neighbours will move it anyway.
const RATE: f32 = 300.0;

/// A way to cut an image into windows.
struct Kind {
    /// Low-resolution pixels along a side that a window answers for.
    side: usize,
    /// Those around it whose multipliers move along.
    margin: usize,
    /// Sweeps over the windows that are left.
    sweeps: usize,
}

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
    let mut steps = 0;
    for kind in KINDS {
        let lines = [plan.geometry.vertical, plan.geometry.horizontal]
            .map(|axis| Line::all(&axis, plan.geometry.sampling, &kind));
        let mut left = open(plan, task, &lines, free);
        for _ in 0..kind.sweeps {
            if left.is_empty() {
                break;
            }
            match sweep(task, &lines, &left, free, run) {
                Ok(most) => steps += most,
                Err(stop) => return (stop, steps),
            }
            left = open_beside(task, &lines, &left, free);
        }
        if left.is_empty() {
            return (Stop::Converged, steps);
        }
    }
    (Stop::IterationLimit, steps)
}

/// Works on these windows once; how many steps one took at most, or what interrupted it.
fn sweep(
    task: &Task<'_>,
    lines: &[Vec<Line>; 2],
    open: &[(usize, usize)],
    free: &mut Plane,
    run: &Run<'_>,
) -> Result<usize, Stop> {
    let mut most = 0;
    // Windows of one colour share no pixel of the result.
    let [tall, wide] = lines.each_ref().map(|lines| apart(lines));
    for colour in 0..tall * wide {
        if let Some(stop) = run.interrupted() {
            return Err(stop);
        }
        let same = |&&(row, column): &&(usize, usize)| row % tall * wide + column % wide == colour;
        let places: Vec<_> = open.iter().filter(same).copied().collect();
        let done = places.into_par_iter().map_init(Window::default, |window, (row, column)| {
            window.load(&lines[0][row], &lines[1][column], task, free);
            let tolerance = CLOSE * task.tolerance;
            let steps = dispatch(Isa::best(), Ascent { window, tolerance });
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
    Ok(most)
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

/// Those of the windows that share pixels with one of `open`, itself among them, in which a footprint still lacks more than the tolerance.
fn open_beside(
    task: &Task<'_>,
    lines: &[Vec<Line>; 2],
    open: &[(usize, usize)],
    free: &Plane,
) -> Vec<(usize, usize)> {
    let (height, width) = (lines[0].len(), lines[1].len());
    let [tall, wide] = lines.each_ref().map(|lines| apart(lines));
    let mut is_near = vec![false; height * width];
    for &(row, column) in open {
        for y in (row + 1).saturating_sub(tall)..height.min(row + tall) {
            is_near[y * width..][(column + 1).saturating_sub(wide)..width.min(column + wide)].fill(true);
        }
    }
    let near = (0..height * width).filter(|i| is_near[*i]).map(|i| (i / width, i % width));
    let places: Vec<_> = near.collect();
    let lack = places.into_par_iter().map_init(Window::default, |window, (row, column)| {
        window.load(&lines[0][row], &lines[1][column], task, free);
        ((row, column), dispatch(Isa::best(), Lack { window }))
    });
    lack.into_iter().filter(|(_, lack)| *lack > task.tolerance).map(|(place, _)| place).collect()
}

/// How many windows of an axis on the next one is that shares no pixel of the result.
fn apart(lines: &[Line]) -> usize {
    let is_apart = |&by: &usize| lines.iter().zip(&lines[by..]).all(|(a, b)| a.high.end <= b.high.start);
    (1..lines.len()).find(is_apart).unwrap_or(lines.len())
}

/// One axis of a window.
struct Line {
    /// Low-resolution pixels that the window answers for.
    own: Range<usize>,
    /// Those whose multipliers it moves.
    low: Range<usize>,
    /// The pixels of the result in their footprints.
    high: Range<usize>,
    reduce: Map,
    adjoint: Map,
    gram_inverse: Map,
    /// Squared weights, which sum to 1.
    squares: Map,
}

impl Line {
    /// The windows of an axis.
    fn all(axis: &Axis, sampling: Sampling, kind: &Kind) -> Vec<Self> {
        let &Kind { side, margin, .. } = kind;
        let reduce = axis.reduce(sampling);
        let windows = (0..axis.inputs).step_by(side).map(|from| {
            let own = from..axis.inputs.min(from + side);
            let low = from.saturating_sub(margin)..axis.inputs.min(own.end + margin);
            // Footprints begin and end in the order of their pixels.
            let end = |(start, weights): (usize, &[f64])| start + weights.len();
            let high = reduce.row(low.start).0..end(reduce.row(low.end - 1));
            let shifted = low.clone().map(|i| reduce.row(i)).map(|(at, row)| (at - high.start, row.to_vec()));
            let part = Taps::from_rows(high.len(), shifted);
            let squares = low.clone().map(|i| reduce.row(i)).map(|(at, row)| {
                let sum: f64 = row.iter().map(|weight| weight * weight).sum();
                (at - high.start, row.iter().map(|weight| weight * weight / sum).collect())
            });
            Self {
                squares: Map::new(&Taps::from_rows(high.len(), squares)),
                adjoint: Map::new(&part.transpose()),
                gram_inverse: Map::new(&part.after(&part.transpose()).inverse(NEARLY)),
                reduce: Map::new(&part),
                own,
                low,
                high,
            }
        });
        windows.collect()
    }
}

/// The numbers of a window, rows padded.
#[derive(Default)]
struct Window<'a> {
    lines: Option<[&'a Line; 2]>,
    range: (f32, f32),
    samples: Vec<f32>,
    /// The image before it is clamped, and after.
    free: Vec<f32>,
    inside: Vec<f32>,
    /// What the clamped image lacks of the samples, which is the slope of the dual, and what it lacked a step before.
    lack: Vec<f32>,
    before: Vec<f32>,
    /// The slope preconditioned, the direction of the multipliers, and what it is in the image.
    ascent: Vec<f32>,
    direction: Vec<f32>,
    change: Vec<f32>,
    /// Of each footprint, one over the root of the share that is between the bounds.
    stretch: Vec<f32>,
    scratch: Vec<f32>,
}

impl<'a> Window<'a> {
    fn load(&mut self, vertical: &'a Line, horizontal: &'a Line, task: &Task<'_>, free: &Plane) {
        self.lines = Some([vertical, horizontal]);
        self.range = task.range;
        cut(free, (&vertical.high, &horizontal.high), &mut self.free);
        cut(task.samples, (&vertical.low, &horizontal.low), &mut self.samples);
        for plane in [&mut self.before, &mut self.direction] {
            plane.clear();
            plane.resize(self.samples.len(), 0.0);
        }
    }

    /// Finds what the clamped pixels lack of the samples; the largest of it.
    #[inline(always)]
    fn find_lack<const FUSED: bool>(&mut self, [vertical, horizontal]: [&Line; 2]) -> f32 {
        let (low, high) = self.range;
        self.inside.clear();
        self.inside.extend(self.free.iter().map(|value| value.max(low).min(high)));
        let wide = padded(horizontal.high.len());
        vertical.reduce.along_columns::<FUSED>(&self.inside, wide, &mut self.scratch);
        horizontal.reduce.along_rows::<FUSED>(&self.scratch, wide, &mut self.lack);
        let mut most = [0.0_f32; LANES];
        let pairs = self.lack.as_chunks_mut::<LANES>().0.iter_mut().zip(self.samples.as_chunks::<LANES>().0);
        for (lack, samples) in pairs {
            for ((lack, sample), most) in lack.iter_mut().zip(samples).zip(&mut most) {
                *lack = sample - *lack;
                *most = most.max(lack.abs());
            }
        }
        most.into_iter().fold(0.0, f32::max)
    }

    /// Finds what of each footprint is between the bounds.
    #[inline(always)]
    fn find_stretch<const FUSED: bool>(&mut self, [vertical, horizontal]: [&Line; 2]) {
        self.change.clear();
        let pairs = self.free.iter().zip(&self.inside);
        self.change.extend(pairs.map(|(free, inside)| if free == inside { 1.0 } else { 0.0 }));
        let wide = padded(horizontal.high.len());
        vertical.squares.along_columns::<FUSED>(&self.change, wide, &mut self.scratch);
        horizontal.squares.along_rows::<FUSED>(&self.scratch, wide, &mut self.stretch);
        for share in &mut self.stretch {
            *share = share.max(LEAST_FREE).sqrt().recip();
        }
    }

    /// Turns to the conjugate direction and finds what it is in the image; the slope along it. `worth` is that of the last preconditioned
    /// slope along its own.
    #[inline(always)]
    fn find_direction<const FUSED: bool>(
        &mut self,
        [vertical, horizontal]: [&Line; 2],
        worth: &mut f32,
    ) -> f32 {
        let wide = padded(horizontal.low.len());
        self.ascent.clear();
        self.ascent.extend(self.lack.iter().zip(&self.stretch).map(|(lack, stretch)| lack * stretch));
        horizontal.gram_inverse.along_rows::<FUSED>(&self.ascent, wide, &mut self.scratch);
        vertical.gram_inverse.along_columns::<FUSED>(&self.scratch, wide, &mut self.ascent);
        for (ascent, stretch) in self.ascent.iter_mut().zip(&self.stretch) {
            *ascent *= stretch;
        }
        let now = sum::<FUSED>(&self.ascent, &self.lack);
        let turned = (now - sum::<FUSED>(&self.ascent, &self.before)) / *worth;
        let along = sum::<FUSED>(&self.direction, &self.lack);
        // None of the last direction where it would lead down.
        let kept = if turned > 0.0 && now + turned * along > 0.0 { turned } else { 0.0 };
        *worth = now;
        for (direction, ascent) in self.direction.iter_mut().zip(&self.ascent) {
            *direction = ascent + kept * *direction;
        }
        self.before.clone_from(&self.lack);
        horizontal.adjoint.along_rows::<FUSED>(&self.direction, wide, &mut self.scratch);
        vertical.adjoint.along_columns::<FUSED>(
            &self.scratch,
            padded(horizontal.high.len()),
            &mut self.change,
        );
        now + kept * along
    }

    /// How far along the direction the dual is greatest, all but for [`NEAR`] of its slope `uphill`, which falls in straight pieces.
    #[inline(always)]
    fn length<const FUSED: bool>(&self, uphill: f32) -> f32 {
        let (mut from, mut to) = (0.0_f32, f32::INFINITY);
        let (mut length, mut slope, mut bend) = (0.0, uphill, self.taken::<FUSED>(0.0).1);
        for _ in 0..SEARCH {
            let newton = length + slope / bend;
            length = match (newton > from && newton < to, to.is_finite()) {
                (true, _) => newton,
                (false, true) => f32::midpoint(from, to),
                // Nothing bends: every pixel that moves is at a bound.
                (false, false) => return from,
            };
            let (taken, there) = self.taken::<FUSED>(length);
            (slope, bend) = (uphill - taken, there);
            if slope.abs() <= NEAR * uphill {
                break;
            }
            if slope > 0.0 { from = length } else { to = length }
        }
        length
    }

    /// What of the slope is gone after such a length of the direction, and how fast it goes there.
    #[inline(always)]
    fn taken<const FUSED: bool>(&self, length: f32) -> (f32, f32) {
        let (low, high) = self.range;
        let (mut taken, mut bend) = ([0.0_f32; LANES], [0.0_f32; LANES]);
        let rows = self.change.as_chunks::<LANES>().0.iter().zip(self.free.as_chunks::<LANES>().0);
        for ((change, free), inside) in rows.zip(self.inside.as_chunks::<LANES>().0) {
            for i in 0..LANES {
                let there = fma::<f32, FUSED>(length, change[i], free[i]);
                let clamped = there.max(low).min(high);
                taken[i] = fma::<f32, FUSED>(change[i], clamped - inside[i], taken[i]);
                let moves = if there == clamped { change[i] } else { 0.0 };
                bend[i] = fma::<f32, FUSED>(moves, moves, bend[i]);
            }
        }
        (taken.iter().sum(), bend.iter().sum())
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
        let Self { window, tolerance } = self;
        let Some(lines) = window.lines else { return 0 };
        let mut worth = f32::INFINITY;
        let mut enough = tolerance;
        for step in 0..STEPS {
            let lack = window.find_lack::<FUSED>(lines);
            if step == 0 {
                enough = tolerance.max(lack / RATE);
            }
            if lack <= enough {
                return step;
            }
            window.find_stretch::<FUSED>(lines);
            let uphill = window.find_direction::<FUSED>(lines, &mut worth);
            let length = window.length::<FUSED>(uphill);
            if length <= 0.0 {
                return step;
            }
            for (free, change) in window.free.iter_mut().zip(&window.change) {
                *free = fma::<f32, FUSED>(length, *change, *free);
            }
        }
        STEPS
    }
}

/// The most that a footprint lacks which the window answers for.
struct Lack<'w, 'a> {
    window: &'w mut Window<'a>,
}

impl Body for Lack<'_, '_> {
    type Output = f32;

    #[inline(always)]
    fn run<const FUSED: bool>(self) -> f32 {
        let Some(lines) = self.window.lines else { return 0.0 };
        self.window.find_lack::<FUSED>(lines);
        let [rows, columns] =
            lines.map(|line| line.own.start - line.low.start..line.own.end - line.low.start);
        let own = self.window.lack.chunks(padded(lines[1].low.len())).skip(rows.start).take(rows.len());
        own.flat_map(|row| &row[columns.clone()]).fold(0.0, |most, lack| lack.abs().max(most))
    }
}

/// The sum of products, lane by lane.
#[inline(always)]
fn sum<const FUSED: bool>(one: &[f32], other: &[f32]) -> f32 {
    let mut sums = [0.0_f32; LANES];
    for (one, other) in one.as_chunks::<LANES>().0.iter().zip(other.as_chunks::<LANES>().0) {
        for ((sum, one), other) in sums.iter_mut().zip(one).zip(other) {
            *sum = fma::<f32, FUSED>(*one, *other, *sum);
        }
    }
    sums.iter().sum()
}

/// A part of a plane, its rows padded with zeros.
fn cut(plane: &Plane, (rows, columns): (&Range<usize>, &Range<usize>), to: &mut Vec<f32>) {
    to.clear();
    for y in rows.clone() {
        to.extend_from_slice(&plane.row(y)[columns.clone()]);
        to.resize(to.len().next_multiple_of(LANES), 0.0);
    }
}

#[cfg(test)]
#[path = "dual/tests.rs"]
mod tests;
