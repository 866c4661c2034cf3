//! Bounds for footprints whose weights change their sign: multipliers by conjugate gradients of the dual, window by window.
//!
//! The problem is that of [`super::relax`]; one footprint after the other creeps there. The gradient of the dual is the residual
//! `y - R clamp(x)`, its Hessian `-R M R'`, with `M` the pixels between the bounds. Directions are conjugate after Polak and Ribiere and
//! begin anew where the dual would not rise. The preconditioner is `S (R R')^-1 S`, with `1 / S^2` the share of a footprint's squared weights
//! that is between the bounds: without bounds in the way the first step is all but exact. Along a direction the slope is piecewise linear,
//! and Newton's method finds where it vanishes. A window that runs out of steps ends with the least residual it had: where the bounds
//! leave no interior the dual has no maximum, and its largest residual swings while it rises.
//!
//! Where bounds cut in beside hard edges it takes hundreds of steps, elsewhere none. So windows of 12 x 12 low-resolution pixels, in which
//! a residual is above the tolerance, go on by themselves, each with the multipliers around it as they are (alternating
//! minimisation over blocks that overlap). Those that are worked on together share no pixel, so threads change no bit.
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

use self::maps::padded;
use self::window::{Ascent, Largest, Line, Window};
use super::Plan;
use super::bounds::{Bounds, TOLERANCE, clamp, largest};
use crate::kernel::{Isa, dispatch};
use crate::limiter::Moved;
use crate::{Plane, Run, Stop};

/// Small windows stay in the first cache; what creeps from one to the next needs larger ones.
const TILINGS: [Tiling; 2] =
    [Tiling { side: 8, margin: 2, sweeps: 8 }, Tiling { side: 16, margin: 4, sweeps: 6 }];

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
    for tiling in TILINGS {
        let lines = [plan.geometry.vertical, plan.geometry.horizontal]
            .map(|axis| Line::all(&axis, plan.geometry.sampling, &tiling));
        let mut left = open(plan, task, &lines, free);
        for _ in 0..tiling.sweeps {
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
            window.load([&lines[0][row], &lines[1][column]], task, free);
            let steps = dispatch(Isa::best(), Ascent { window, tolerance: task.tolerance });
            (row, column, std::mem::take(&mut window.free), steps)
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

/// The windows in which a residual is above the tolerance, row by row. All of the image is reduced at once.
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

/// The same for windows that share pixels with one of `open`, one by one: no other's residual has changed.
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
    let residuals = places.into_par_iter().map_init(Window::default, |window, (row, column)| {
        window.load([&lines[0][row], &lines[1][column]], task, free);
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
