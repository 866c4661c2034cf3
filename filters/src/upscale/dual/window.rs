//! Conjugate gradients of the dual in one window, as [`super`] describes them.

use std::ops::Range;

use super::maps::{LANES, Map, padded};
use super::{State, Task, Tiling};
use crate::Plane;
use crate::kernel::stencil::lanes_dot;
use crate::kernel::{Body, fma};
use crate::operator::taps::Taps;
use crate::upscale::{Axis, Sampling};

/// Steps of a window in a sweep.
const STEPS: usize = 200;
/// Weights of `(R R')^-1` below this are left out: a step that is nearly right costs half as much.
const NEARLY: f64 = 1e-3;
/// The share of a footprint's squared weights that counts as between the bounds, at least.
const LEAST_FREE: f32 = 0.3;
/// Trials of a step's length, and the part of the slope that one may leave.
const SEARCH: usize = 4;
const NEAR: f32 = 0.2;
/// Part of the tolerance that a window is brought to, so that its neighbours may move it by the rest.
const CLOSE: f32 = 0.5;
/// A sweep divides the residual of a window by no more than this, as its neighbours will move it again.
const RATE: f32 = 300.0;

/// One axis of a window.
pub struct Line {
    /// Low-resolution pixels that the window answers for.
    pub own: Range<usize>,
    /// Those whose multipliers it moves.
    pub low: Range<usize>,
    /// The pixels of the result in their footprints.
    pub high: Range<usize>,
    reduce: Map,
    adjoint: Map,
    gram_inverse: Map,
    /// Squared weights, which sum to 1.
    squares: Map,
    /// The sum of the squared weights of each footprint.
    norms: Vec<f32>,
}

impl Line {
    /// The windows of an axis.
    pub fn all(axis: &Axis, sampling: Sampling, tiling: &Tiling) -> Vec<Self> {
        let &Tiling { side, margin, .. } = tiling;
        let reduce = axis.reduce(sampling);
        let windows = (0..axis.inputs).step_by(side).map(|from| {
            let own = from..axis.inputs.min(from + side);
            let low = from.saturating_sub(margin)..axis.inputs.min(own.end + margin);
            // Footprints begin and end in the order of their pixels.
            let end = |(start, weights): (usize, &[f64])| start + weights.len();
            let high = reduce.row(low.start).0..end(reduce.row(low.end - 1));
            let shifted = low.clone().map(|i| reduce.row(i)).map(|(at, row)| (at - high.start, row.to_vec()));
            let part = Taps::from_rows(high.len(), shifted);
            let norm = |row: &[f64]| row.iter().map(|weight| weight * weight).sum::<f64>();
            let squares = low.clone().map(|i| reduce.row(i)).map(|(at, row)| {
                (at - high.start, row.iter().map(|weight| weight * weight / norm(row)).collect())
            });
            Self {
                norms: low.clone().map(|i| norm(reduce.row(i).1) as f32).collect(),
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

    /// Sums of the squared weights of the footprints that the window answers for.
    pub fn own_norms(&self) -> &[f32] {
        &self.norms[self.own.start - self.low.start..][..self.own.len()]
    }
}

/// How large a multiplier may become, of a footprint with these sums of squared weights down and across.
pub fn most(limit: f32, down: f32, across: f32) -> f32 {
    limit / (down * across)
}

/// Whether a multiplier is as large as it may be and this residual would have it larger.
#[inline(always)]
pub fn is_held(multiplier: f32, most: f32, residual: f32) -> bool {
    multiplier.abs() >= most && multiplier * residual > 0.0
}

/// The numbers of a window, rows padded.
#[derive(Default)]
pub struct Window<'a> {
    lines: Option<[&'a Line; 2]>,
    range: (f32, f32),
    samples: Vec<f32>,
    /// The image before it is clamped, and after.
    pub free: Vec<f32>,
    clamped: Vec<f32>,
    /// The multipliers, and how large they may become.
    pub multipliers: Vec<f32>,
    most: Vec<f32>,
    /// The samples less the reduction of the clamped image, which is the gradient of the dual, but 0 for multipliers that are held; that of
    /// the step before.
    residual: Vec<f32>,
    last: Vec<f32>,
    /// 1 for multipliers that move, 0 for those that are held.
    moves: Vec<f32>,
    /// How many are held.
    held: f32,
    preconditioned: Vec<f32>,
    /// The direction of the multipliers, and what it is in the image.
    direction: Vec<f32>,
    change: Vec<f32>,
    /// The diagonal `S` of the preconditioner.
    scaling: Vec<f32>,
    scratch: Vec<f32>,
}

impl<'a> Window<'a> {
    /// Takes a window of the problem.
    pub fn load(&mut self, [vertical, horizontal]: [&'a Line; 2], task: &Task<'_>, state: &State<'_>) {
        self.lines = Some([vertical, horizontal]);
        self.range = task.range;
        cut(state.free, (&vertical.high, &horizontal.high), &mut self.free);
        let low = (&vertical.low, &horizontal.low);
        cut(task.samples, low, &mut self.samples);
        cut(&state.multipliers, low, &mut self.multipliers);
        self.most.clear();
        for down in &vertical.norms {
            self.most.extend(horizontal.norms.iter().map(|across| most(task.limit, *down, *across)));
            self.most.resize(self.most.len().next_multiple_of(LANES), 1.0);
        }
        for plane in [&mut self.last, &mut self.direction, &mut self.moves] {
            plane.clear();
            plane.resize(self.samples.len(), 0.0);
        }
    }

    /// Finds the residual; the largest of it.
    #[inline(always)]
    fn find_residual<const FUSED: bool>(&mut self, [vertical, horizontal]: [&Line; 2]) -> f32 {
        let (low, high) = self.range;
        self.clamped.clear();
        self.clamped.extend(self.free.iter().map(|value| value.max(low).min(high)));
        let wide = padded(horizontal.high.len());
        vertical.reduce.along_columns::<FUSED>(&self.clamped, wide, &mut self.scratch);
        horizontal.reduce.along_rows::<FUSED>(&self.scratch, wide, &mut self.residual);
        let (mut largest, mut held) = ([0.0_f32; LANES], [0.0_f32; LANES]);
        let residuals = self.residual.as_chunks_mut::<LANES>().0.iter_mut();
        let residuals = residuals.zip(self.samples.as_chunks::<LANES>().0);
        let multipliers =
            self.multipliers.as_chunks::<LANES>().0.iter().zip(self.most.as_chunks::<LANES>().0);
        let moves = self.moves.as_chunks_mut::<LANES>().0;
        for (((residual, samples), (multipliers, most)), moves) in residuals.zip(multipliers).zip(moves) {
            for i in 0..LANES {
                let left = samples[i] - residual[i];
                moves[i] = if is_held(multipliers[i], most[i], left) { 0.0 } else { 1.0 };
                residual[i] = left * moves[i];
                held[i] += 1.0 - moves[i];
                largest[i] = largest[i].max(residual[i].abs());
            }
        }
        self.held = held.iter().sum();
        largest.into_iter().fold(0.0, f32::max)
    }

    /// Finds the diagonal of the preconditioner: of each footprint, one over the root of the share that is between the bounds.
    #[inline(always)]
    fn find_scaling<const FUSED: bool>(&mut self, [vertical, horizontal]: [&Line; 2]) {
        self.change.clear();
        let pairs = self.free.iter().zip(&self.clamped);
        self.change.extend(pairs.map(|(free, clamped)| if free == clamped { 1.0 } else { 0.0 }));
        let wide = padded(horizontal.high.len());
        vertical.squares.along_columns::<FUSED>(&self.change, wide, &mut self.scratch);
        horizontal.squares.along_rows::<FUSED>(&self.scratch, wide, &mut self.scaling);
        for share in &mut self.scaling {
            *share = share.max(LEAST_FREE).sqrt().recip();
        }
    }

    /// Finds the next conjugate direction and what it is in the image; the slope of the dual along it. `product` is that of the residual and
    /// the preconditioned one, of the step before and then of this one.
    #[inline(always)]
    fn find_direction<const FUSED: bool>(
        &mut self,
        [vertical, horizontal]: [&Line; 2],
        product: &mut f64,
    ) -> f64 {
        let (low, high) = (padded(horizontal.low.len()), padded(horizontal.high.len()));
        self.preconditioned.clear();
        self.preconditioned.extend(self.residual.iter().zip(&self.scaling).map(|(r, scaling)| r * scaling));
        horizontal.gram_inverse.along_rows::<FUSED>(&self.preconditioned, low, &mut self.scratch);
        vertical.gram_inverse.along_columns::<FUSED>(&self.scratch, low, &mut self.preconditioned);
        for ((value, scaling), moves) in self.preconditioned.iter_mut().zip(&self.scaling).zip(&self.moves) {
            *value *= scaling * moves;
        }
        let now = lanes_dot::<f32, FUSED>(&self.preconditioned, &self.residual);
        let beta = (now - lanes_dot::<f32, FUSED>(&self.preconditioned, &self.last)) / *product;
        let along = lanes_dot::<f32, FUSED>(&self.direction, &self.residual);
        // Begins anew where the dual would not rise.
        let beta = if beta > 0.0 && now + beta * along > 0.0 { beta } else { 0.0 };
        *product = now;
        for (direction, value) in self.direction.iter_mut().zip(&self.preconditioned) {
            *direction = value + beta as f32 * *direction;
        }
        self.last.clone_from(&self.residual);
        horizontal.adjoint.along_rows::<FUSED>(&self.direction, low, &mut self.scratch);
        vertical.adjoint.along_columns::<FUSED>(&self.scratch, high, &mut self.change);
        now + beta * along
    }

    /// Moves the multipliers, and the image with them, by this length of the direction; whether one was held back.
    #[inline(always)]
    fn step<const FUSED: bool>(&mut self, [vertical, horizontal]: [&Line; 2], length: f32) -> bool {
        let mut is_over = false;
        for ((multiplier, direction), most) in self.multipliers.iter().zip(&self.direction).zip(&self.most) {
            is_over |= fma::<f32, FUSED>(length, *direction, *multiplier).abs() > *most;
        }
        for ((multiplier, direction), most) in
            self.multipliers.iter_mut().zip(&mut self.direction).zip(&self.most)
        {
            let moved = fma::<f32, FUSED>(length, *direction, *multiplier).max(-most).min(*most);
            *direction = if is_over { moved - *multiplier } else { *direction };
            *multiplier = moved;
        }
        if is_over {
            let (low, high) = (padded(horizontal.low.len()), padded(horizontal.high.len()));
            horizontal.adjoint.along_rows::<FUSED>(&self.direction, low, &mut self.scratch);
            vertical.adjoint.along_columns::<FUSED>(&self.scratch, high, &mut self.change);
        }
        let length = if is_over { 1.0 } else { length };
        for (free, change) in self.free.iter_mut().zip(&self.change) {
            *free = fma::<f32, FUSED>(length, *change, *free);
        }
        is_over
    }

    /// How far along the direction the dual is greatest, all but for [`NEAR`] of its slope.
    #[inline(always)]
    fn step_length<const FUSED: bool>(&self, slope: f32) -> f32 {
        let (mut from, mut to) = (0.0_f32, f32::INFINITY);
        let (mut length, mut left, mut curvature) = (0.0, slope, self.along::<FUSED>(0.0).1);
        for _ in 0..SEARCH {
            let newton = length + left / curvature;
            length = match (newton > from && newton < to, to.is_finite()) {
                (true, _) => newton,
                (false, true) => f32::midpoint(from, to),
                // No curvature: every pixel that moves is at a bound.
                (false, false) => return from,
            };
            let (decrease, there) = self.along::<FUSED>(length);
            (left, curvature) = (slope - decrease, there);
            if left.abs() <= NEAR * slope {
                break;
            }
            if left > 0.0 { from = length } else { to = length }
        }
        length
    }

    /// After such a length of the direction: by how much the slope has decreased, and the curvature.
    #[inline(always)]
    fn along<const FUSED: bool>(&self, length: f32) -> (f32, f32) {
        let (low, high) = self.range;
        let (mut decrease, mut curvature) = ([0.0_f32; LANES], [0.0_f32; LANES]);
        let rows = self.change.as_chunks::<LANES>().0.iter().zip(self.free.as_chunks::<LANES>().0);
        for ((change, free), clamped) in rows.zip(self.clamped.as_chunks::<LANES>().0) {
            for i in 0..LANES {
                let there = fma::<f32, FUSED>(length, change[i], free[i]);
                let inside = there.max(low).min(high);
                decrease[i] = fma::<f32, FUSED>(change[i], inside - clamped[i], decrease[i]);
                let moves = if there == inside { change[i] } else { 0.0 };
                curvature[i] = fma::<f32, FUSED>(moves, moves, curvature[i]);
            }
        }
        (decrease.iter().sum(), curvature.iter().sum())
    }
}

/// Steps of one window until its residual is small enough for this sweep; how many.
pub struct Ascent<'w, 'a> {
    pub window: &'w mut Window<'a>,
    pub tolerance: f32,
}

impl Body for Ascent<'_, '_> {
    type Output = usize;

    #[inline(always)]
    fn run<const FUSED: bool>(self) -> usize {
        let Self { window, tolerance } = self;
        let Some(lines) = window.lines else { return 0 };
        // Without end: the direction before counts for nothing.
        let mut product = f64::INFINITY;
        let mut enough = CLOSE * tolerance;
        let mut held = 0.0;
        for step in 0..STEPS {
            let residual = window.find_residual::<FUSED>(lines);
            if step == 0 {
                enough = enough.max(residual / RATE);
            }
            if residual <= enough {
                return step;
            }
            if window.held != held {
                (held, product) = (window.held, f64::INFINITY);
            }
            window.find_scaling::<FUSED>(lines);
            let slope = window.find_direction::<FUSED>(lines, &mut product);
            let length = window.step_length::<FUSED>(slope as f32);
            if length <= 0.0 {
                return step;
            }
            if window.step::<FUSED>(lines, length) {
                product = f64::INFINITY;
            }
        }
        STEPS
    }
}

/// The largest residual of the footprints that a window answers for.
pub struct Largest<'w, 'a> {
    pub window: &'w mut Window<'a>,
}

impl Body for Largest<'_, '_> {
    type Output = f32;

    #[inline(always)]
    fn run<const FUSED: bool>(self) -> f32 {
        let Some(lines) = self.window.lines else { return 0.0 };
        self.window.find_residual::<FUSED>(lines);
        let [rows, columns] =
            lines.map(|line| line.own.start - line.low.start..line.own.end - line.low.start);
        let own = self.window.residual.chunks(padded(lines[1].low.len())).skip(rows.start).take(rows.len());
        own.flat_map(|row| &row[columns.clone()]).fold(0.0, |most, residual| residual.abs().max(most))
    }
}

/// Puts what [`cut`] took back into its place.
pub fn paste(from: &[f32], (rows, columns): (&Range<usize>, &Range<usize>), plane: &mut Plane) {
    for (y, row) in rows.clone().zip(from.chunks(padded(columns.len()))) {
        plane.row_mut(y)[columns.clone()].copy_from_slice(&row[..columns.len()]);
    }
}

/// A part of a plane, its rows padded with zeros.
fn cut(plane: &Plane, (rows, columns): (&Range<usize>, &Range<usize>), to: &mut Vec<f32>) {
    to.clear();
    for y in rows.clone() {
        to.extend_from_slice(&plane.row(y)[columns.clone()]);
        to.resize(to.len().next_multiple_of(LANES), 0.0);
    }
}
