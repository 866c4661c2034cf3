//! Bounds for footprints whose weights change their sign: multipliers by conjugate gradients of the dual, window by window.
//!
//! The problem is that of [`super::relax`]; one footprint after the other creeps there. The gradient of the dual is the residual
//! `y - R clamp(x)`, its Hessian `-R M R'`, with `M` the pixels between the bounds. Directions are conjugate after Polak and Ribiere and
//! begin anew where the dual would not rise. The preconditioner is `S (R R')^-1 S`, with `1 / S^2` the share of a footprint's squared weights
//! that is between the bounds: without bounds in the way the first step is all but exact. Along a direction the slope is piecewise linear,
//! and Newton's method finds where it vanishes.
//!
//! Where bounds cut in beside hard edges it takes hundreds of steps, elsewhere none. So windows of 12 x 12 low-resolution pixels, in which
//! a residual is above the tolerance, go on by themselves, each with the multipliers around it as they are (alternating
//! minimisation over blocks that overlap). Those that are worked on together share no pixel, so threads change no bit.
//!
//! Where no image keeps bounds and samples (another footprint has made them) multipliers grow without end, and the image with them. So
//! they are limited first to what moves a footprint's mean by [`LARGEST`] times the greatest sample, an exact penalty on the residual; only where
//! that leaves little they go on without.
//!
//! Roofline: some 20 000 multiplications a step of a small window at a factor of 2, all in the first cache; larger windows leave it.
//!
//! Sources: E. Polak, G. Ribiere, "Note sur la convergence de methodes de directions conjuguees", Revue Francaise d'Informatique et de
//! Recherche Operationnelle 3, 1969; J. Nocedal, S. Wright, "Numerical Optimization", Springer, 2006, section 5.2, for the restart.
#![allow(
    clippy::inline_always,
    reason = "a body must be compiled inside the function that enables the features"
)]

mod maps;
mod window;

use lacuna_core::parallel::prelude::*;

use self::window::{Ascent, Largest, Line, Window, is_held, most, paste};
use super::Plan;
use super::bounds::{Bounds, LARGEST, TOLERANCE, clamp, difference, largest};
use crate::kernel::{Isa, dispatch};
use crate::limiter::Moved;
use crate::{Plane, Run, Stop};

/// Small windows stay in the first cache; what creeps from one to the next needs larger ones.
const TILINGS: [Tiling; 2] =
    [Tiling { side: 8, margin: 2, sweeps: 8 }, Tiling { side: 16, margin: 4, sweeps: 6 }];

/// Where limited multipliers leave a residual of no more than this part of the largest sample, those without a limit may leave none.
const NEAR: f64 = 0.1;

/// A way to cut an image into windows.
struct Tiling {
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
    /// The most that a multiplier may move its own footprint's mean.
    limit: f32,
}

/// How far the ascent has come.
struct State<'a> {
    /// The image before it is clamped.
    free: &'a mut Plane,
    multipliers: Plane,
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
    let peak = largest(samples);
    let tolerance = ((TOLERANCE * peak) as f32).max(f32::MIN_POSITIVE);
    let limited = Task { samples, range, tolerance, limit: (LARGEST * peak) as f32 };
    let (mut stop, mut steps) = finish(plan, &limited, plane, run);
    let off = largest(&residual(plan, &limited, plane));
    if stop == Stop::Converged && off > f64::from(tolerance) && off <= NEAR * peak {
        let limited_free = plane.clone();
        let task = Task { limit: f32::INFINITY, ..limited };
        let (after, more) = finish(plan, &task, plane, run);
        (stop, steps) = (after, steps + more);
        if largest(&residual(plan, &task, plane)) > off {
            *plane = limited_free;
        }
    }
    (clamp(plan, bounds, plane), stop, steps)
}

/// The samples less the reduction of the clamped image.
fn residual(plan: &Plan, task: &Task<'_>, free: &Plane) -> Plane {
    let (low, high) = task.range;
    let mut inside = free.clone();
    inside.pixels_mut().iter_mut().for_each(|value| *value = value.clamp(low, high));
    difference(task.samples, &plan.model.reduce(&inside))
}

/// Moves `free`, the image before it is clamped; how that ended, and after how many steps of a window at most.
fn finish(plan: &Plan, task: &Task<'_>, free: &mut Plane, run: &Run<'_>) -> (Stop, usize) {
    let multipliers = Plane::filled(plan.geometry.low(), 0.0);
    let mut state = State { free, multipliers };
    let mut steps = 0;
    for tiling in TILINGS {
        let lines = [plan.geometry.vertical, plan.geometry.horizontal]
            .map(|axis| Line::all(&axis, plan.geometry.sampling, &tiling));
        let mut left = open(plan, task, &lines, &state);
        for _ in 0..tiling.sweeps {
            if left.is_empty() {
                break;
            }
            match sweep(task, &lines, &left, &mut state, run) {
                Ok(most) => steps += most,
                Err(stop) => return (stop, steps),
            }
            left = open_beside(task, &lines, &left, &state);
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
    state: &mut State<'_>,
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
            let lines = [&lines[0][row], &lines[1][column]];
            window.load(lines, task, state);
            let steps = dispatch(Isa::best(), Ascent { window, tolerance: task.tolerance });
            (lines, std::mem::take(&mut window.free), std::mem::take(&mut window.multipliers), steps)
        });
        for ([vertical, horizontal], free, multipliers, steps) in done {
            paste(&free, (&vertical.high, &horizontal.high), state.free);
            paste(&multipliers, (&vertical.low, &horizontal.low), &mut state.multipliers);
            most = most.max(steps);
        }
    }
    Ok(most)
}

/// The windows in which a residual is above the tolerance, row by row. All of the image is reduced at once.
fn open(plan: &Plan, task: &Task<'_>, lines: &[Vec<Line>; 2], state: &State<'_>) -> Vec<(usize, usize)> {
    let residual = residual(plan, task, state.free);
    let is_open = |&(row, column): &(usize, usize)| {
        let (vertical, horizontal) = (&lines[0][row], &lines[1][column]);
        vertical.own.clone().zip(vertical.own_norms()).any(|(y, down)| {
            horizontal.own.clone().zip(horizontal.own_norms()).any(|(x, across)| {
                let residual = residual.at(y, x);
                let most = || most(task.limit, *down, *across);
                residual.abs() > task.tolerance && !is_held(state.multipliers.at(y, x), most(), residual)
            })
        })
    };
    let all = (0..lines[0].len()).flat_map(|row| (0..lines[1].len()).map(move |column| (row, column)));
    all.filter(is_open).collect()
}

/// The same for windows that share pixels with one of `open`, one by one: no other's residual has changed.
fn open_beside(
    task: &Task<'_>,
    lines: &[Vec<Line>; 2],
    open: &[(usize, usize)],
    state: &State<'_>,
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
    let residuals = places.into_par_iter().map_init(Window::default, |window, (row, column)| {
        window.load([&lines[0][row], &lines[1][column]], task, state);
        ((row, column), dispatch(Isa::best(), Largest { window }))
    });
    let is_open = |(place, residual)| (residual > task.tolerance).then_some(place);
    residuals.into_iter().filter_map(is_open).collect()
}

/// How many windows of an axis on the next one is that shares no pixel of the result.
fn apart(lines: &[Line]) -> usize {
    let is_apart = |&by: &usize| lines.iter().zip(&lines[by..]).all(|(a, b)| a.high.end <= b.high.start);
    (1..lines.len()).find(is_apart).unwrap_or(lines.len())
}

#[cfg(test)]
#[path = "dual/tests.rs"]
mod tests;
