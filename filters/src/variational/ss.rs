//! Smoothness splines: the smoothest image that passes through (or near) the samples.
//!
//! Given samples `y` at the measured pixels of an `H x W` image, the image `x` (as many unknowns as pixels) minimises
//!
//! ```text
//! lambda = 0:   x' H x               over all x that equal y at the measured pixels
//! lambda > 0:   lambda x' H x  +  sum over measured pixels of  w (x - y)^2        w = 1 unless weights are given
//! ```
//!
//! (equations 3.17 to 3.21 of the thesis). `x' H x` is the energy of the function `f` that interpolates `x`: at order 2
//! `|f_yy|^2 + 2 |f_xy|^2 + |f_xx|^2` integrated (equation 3.16), at order 3 `|f_yyy|^2 + 3 |f_yyx|^2 + 3 |f_yxx|^2 +
//! |f_xxx|^2`, plus `tension (|f_y|^2 + |f_x|^2)`. `H` is a sum of three or four products of banded matrices that reach
//! 3 (order 2) or 4 (order 3) pixels: `operator/energy.rs`, `operator/profile.rs`.
//!
//! Why the kernel is a choice: the kernel of equation 3.18 is continuous, but its first derivative jumps at every pixel,
//! so its second derivative contains impulses and the inner products of equation 3.20 are infinite if read literally.
//! Taken piece by piece they are finite and give a usable energy (`piecewise`). The interpolating cubic spline, the
//! B-spline behind its inverse filter, spans the space that 3.18 approximates, has a true second derivative, and
//! reconstructs about 1 dB better (`bspline`, the default). Its matrices are infinitely long; they are cut in a factored
//! form that keeps the null space, which on renders is no worse than the full ones.
//!
//! Boundary: the energy is integrated over the rectangle between the outermost pixel centres; the spline has natural
//! ends at order 2 and parabolic ones at order 3, the piecewise kernel continues by a polynomial. With tension 0, planes
//! (order 3: paraboloids) are exact up to the border. Where tension is 0 and the samples lie on a line (order 3: a
//! conic), the result is the limit of a vanishing harmonic term (`polynomials`).
//!
//! Algorithm: the mask decides (`holes`).
//!
//! - Where every 8 x 8 block has a sample: overlapping tiles in f32 (`tiles`). The preconditioner is a masked blur, at order 3 a
//!   sparse factor (`solver/factor`). A tile is solved by a Chebyshev iteration between eigenvalues that a few parts of the mask
//!   show beforehand; in corners, and where these differ much, by conjugate gradients (`solver/local`). It is done when the
//!   preconditioned residual over the least eigenvalue is small, or f32 cannot tell it from rounding.
//! - Around empty blocks: rectangles, roughly before the tiles and exactly after them, by conjugate gradients with a multigrid
//!   cycle; at order 2 in f32 around residuals in f64, until the same estimate is small, else in f64 until a cycle's
//!   correction is (`region`).
//! - Shifted sweeps look along the borders of the tiles that were solved (`doubt`), until no tile and no rectangle has
//!   anything left to correct. The aim is 1e-4 of the measured range at any mask.
//! - Sparse masks (two fifths of the image in rectangles), order 3 with holes, and `lambda > 0` take multigrid on the whole image; so
//!   does order 3 where the tiles' own estimate stays above the aim, as f32 does not hold more.
//!
//! Start: push-pull; where multigrid takes the whole image, what its coarse grids make of the samples, and of one channel what those
//! before it explain (`whole`). The result does not depend on the number of threads, nor on the start or on other channels by more than
//! the aim.
//!
//! References: P. Meinguet, "Multivariate interpolation at arbitrary points made simple", ZAMP 30, 1979 (the energy);
//! M. Unser, "Splines: a perfect fit for signal and image processing", IEEE Signal Processing Magazine 16(6), 1999
//! (cardinal splines). Solvers and matrices cite theirs.
//!
//! Settings: see [`Settings`].
//!
//! Cost: tiles take at most 14 steps over all sweeps on renders at 20 % low-discrepancy samples (order 3: 24), up to 59 at
//! random ones; a step is one pass over a tile with one application of `H` (`kernel/chebyshev.rs`, by conjugate gradients
//! `kernel/step.rs`). Multigrid takes 4 to 9 iterations of 7 applications at order 2, most of them on a part of the image (on four
//! renders at 1 % they amount to about three on all of it), up to a hundred and more at order 3.
//!
//! Memory beyond samples and result:
//!
//! - tiles: 0.9 megabytes a thread (order 3: 1.5);
//! - around holes: 5 planes of a rectangle and 9 for each channel, in f32;
//! - multigrid on the whole image: 5 planes and 9 for one channel at a time, in f32 (order 2) or f64, and two planes of samples.
//!
//! The outcome's residual: the largest entry of the preconditioned residual after the last sweep, in the pixels that it looked at,
//! over that before the first; with holes the larger of this and the same for the first solve of any rectangle.
//!
//! Fails: overshoots at sharp edges (order 3 more than order 2), so values leave the measured range; callers limit
//! them. In a hole it is smooth, whatever the texture around.

use std::sync::Arc;

use lacuna_core::parallel::prelude::*;

use crate::baseline::push_pull;
use crate::kernel::Isa;
use crate::kernel::extremes::range;
use crate::operator::energy::Form;
use crate::{Error, Filter, Mask, Outcome, Plan, Plane, Planes, Problem, Run, Stop};

mod choose;
mod doubt;
mod improve;
mod polynomials;
mod pulled;
mod region;
mod settings;
#[cfg(test)]
mod tests;
mod tiles;
mod whole;

pub use crate::operator::profile::Kernel;
pub(crate) use choose::smoothness;
pub(crate) use improve::improve;
pub(crate) use pulled::Pulled;
pub use settings::{DESCRIPTOR, Order, Settings};

use crate::solver::holes::{self, Division};
use crate::solver::local::Target;
use polynomials::Unseen;
use region::{Matrices, Region};
use tiles::{Task, Tiles};
use whole::Whole;

/// Largest correction that multigrid may still see, over the measured range. The error is of the same size.
const TOLERANCE: f64 = 2e-6;
/// The same when holes are solved for the first time, before their surroundings.
const GUESS: f64 = 1e-4;
/// Largest error of the result, over the measured range.
const AIM: f64 = 1e-4;
/// Largest error that tiles may leave by their estimate, over the measured range.
const TILE_TOLERANCE: f64 = 4e-5;
/// Measured ranges whose squares, as tiles sum them, fit f32.
const TILED: std::ops::Range<f64> = 1e-12..1e15;
/// Size of a correction, over the range of the values, that f32 cannot tell from rounding.
const ROUNDING: f64 = 4e-7;
/// From this tension on bending counts for nothing.
const STIFFEST: f64 = 1e10;
/// Images of up to so many pixels are left to multigrid.
const SMALL: usize = 64 * 64;
/// From this error on, over the measured range, one sweep of tiles is enough.
const ROUGH: f64 = 5e-3;
/// Pixels that one task takes.
const PIECE: usize = 1 << 14;
/// Rounds of tiles and holes after which the whole image is handed to multigrid.
const ROUNDS: usize = 8;

struct Planned {
    settings: Settings,
    mask: Arc<Mask>,
    start: Box<dyn Plan>,
    form: Form,
    parts: Parts,
    /// Polynomials that neither the samples nor the energy see.
    unseen: Option<Unseen>,
}

/// How the work is divided.
enum Parts {
    /// All of the image by multigrid.
    Whole(Region),
    /// Tiles where measured pixels are near, multigrid around holes.
    Tiled(Tiles, Vec<Region>),
}

impl Filter for Settings {
    fn plan(&self, problem: &Problem, run: &Run<'_>) -> Result<Box<dyn Plan>, Error> {
        self.check()?;
        let mask = Arc::clone(&problem.mask);
        mask.require_samples()?;
        let weights = match (&problem.weights, self.lambda > 0.0) {
            (Some(weights), true) => Some(check_weights(weights, &mask)?),
            _ => None,
        };
        let form = Form::new(self.kernel, self.order.number(), self.tension.min(STIFFEST));
        let heaviest = weights.map_or(1.0, |weights| f64::from(range(mask.as_slice(), weights.pixels()).1));
        let lambda = self.lambda.min(self.order.smoothest() * heaviest / form.stretch());
        let isa = Isa::best();
        let matrices = Matrices::new(&form, mask.size());
        let region = |window| Region::new(isa, &matrices, &mask, (lambda, weights), window);
        let tiles = |held| Tiles::new(isa, &form.energy(mask.size(), (1.0, 1.0)), &mask, held);
        let whole = || Region::whole(isa, &form, &mask, lambda, weights);
        let small = mask.size().pixels() <= SMALL;
        let parts = if self.lambda > 0.0 || small {
            Parts::Whole(whole())
        } else {
            match holes::divide(&mask) {
                Division::Dense => Parts::Tiled(tiles(None), Vec::new()),
                // Third order beside a hole is more than f32 can hold.
                Division::Holes(windows, held) if self.order == Order::Second => {
                    Parts::Tiled(tiles(Some(held)), windows.into_iter().map(region).collect())
                }
                Division::Holes(..) | Division::Sparse => Parts::Whole(whole()),
            }
        };
        let counts = |i, j| weights.is_none_or(|w: &Plane| w.at(i, j) > 0.0);
        let unseen = (self.tension == 0.0)
            .then(|| Unseen::new(self.order.number(), &mask, counts))
            .filter(|unseen| !unseen.is_empty());
        let start = push_pull::Settings.plan(&Problem::fill(Arc::clone(&mask)), run)?;
        drop(matrices);
        Ok(Box::new(Planned { settings: *self, mask, start, form, parts, unseen }))
    }
}

/// Weights must be finite, not negative, and positive at some measured pixel.
pub(super) fn check_weights<'a>(weights: &'a Plane, mask: &Mask) -> Result<&'a Plane, Error> {
    if weights.size() != mask.size() {
        return Err(Error::size(mask.size(), "weights", weights.size()));
    }
    let measured = || weights.pixels().iter().zip(mask.as_slice()).filter(|(_, m)| **m).map(|(w, _)| *w);
    if let Some(bad) = measured().find(|w| !w.is_finite() || *w < 0.0) {
        return Err(Error::setting("weight", &bad, "0 or more, finite"));
    }
    if measured().all(|w| w == 0.0) {
        return Err(Error::EmptyMask);
    }
    Ok(weights)
}

impl Plan for Planned {
    fn reconstruct(&self, samples: &Planes, out: &mut Planes, run: &Run<'_>) -> Result<Outcome, Error> {
        self.reconstruct_roughly(samples, AIM, out, run)
    }

    fn reconstruct_roughly(
        &self,
        samples: &Planes,
        error: f64,
        out: &mut Planes,
        run: &Run<'_>,
    ) -> Result<Outcome, Error> {
        // The start checks the planes.
        let outcome = self.start.reconstruct(samples, out, run)?;
        if self.mask.is_full() && self.settings.lambda == 0.0 {
            return Ok(outcome);
        }
        let outcome = outcome.worst(self.solve(samples, error, out, run));
        // What is not finite solves nothing.
        let solved = outcome.residual.is_none_or(f64::is_finite) && out.are_finite();
        let stop = if solved { outcome.stop } else { outcome.stop.max(Stop::IterationLimit) };
        Ok(Outcome { stop, ..outcome })
    }
}

impl Planned {
    /// Solves for all channels, from the image that stands in `out`.
    fn solve(&self, samples: &Planes, error: f64, out: &mut Planes, run: &Run<'_>) -> Outcome {
        let (tiles, regions) = match &self.parts {
            Parts::Whole(region) => {
                let smooths = self.settings.lambda > 0.0;
                let tolerance = TOLERANCE * error / AIM;
                let settle = |out: &mut Plane| self.settle(out);
                let whole = Whole { region, mask: &self.mask, smooths, tolerance, settle: &settle };
                return whole.solve(samples.as_slice(), out.as_mut_slice(), run);
            }
            Parts::Tiled(tiles, regions) => (tiles, regions),
        };
        let channel =
            |(sample, out): (&Plane, &mut Plane)| self.channel(tiles, regions, sample, out, error, run);
        let ends = samples.as_slice().into_par_iter().zip(out.as_mut_slice()).map(channel);
        let (mut worst, mut whole) = (Outcome::direct(), None);
        for (end, (sample, out)) in ends.into_iter().zip(samples.as_slice().iter().zip(out.as_mut_slice())) {
            worst = worst.worst(match end {
                Ending::Done(outcome) => outcome,
                // One channel after the other: the grids of a whole image are the most memory that a fill takes.
                Ending::Left { iterations, tolerance } => {
                    let region = || Region::whole(Isa::best(), &self.form, &self.mask, 0.0, None);
                    let last = whole.get_or_insert_with(region).solve(sample, out, tolerance, run);
                    self.settle(out);
                    Outcome { iterations: iterations + last.iterations, ..last }
                }
            });
        }
        worst
    }
}

/// How a channel ended.
enum Ending {
    /// With this outcome.
    Done(Outcome),
    /// Tiles could not do it after so many iterations: it is left to multigrid on the whole image, to within this tolerance.
    Left { iterations: usize, tolerance: f64 },
}

/// Adds a value to all pixels.
fn add(plane: &mut Plane, value: f32) {
    if value != 0.0 {
        plane.pixels_mut().par_chunks_mut(PIECE).for_each(|own| own.iter_mut().for_each(|own| *own += value));
    }
}

/// What a channel asks for.
#[derive(Clone, Copy)]
struct Wanted {
    /// A value in the midst of those that are solved for.
    middle: f32,
    /// Their range.
    range: f64,
    /// Largest error of the result.
    error: f64,
}

impl Wanted {
    /// Where the best result may be off by `best` times the range: by how much this one may be.
    fn within(self, best: f64) -> f64 {
        best * self.error / AIM
    }

    /// As many rounds as this error is worth.
    fn rounds(self) -> usize {
        if self.error < ROUGH * self.range { ROUNDS } else { 1 }
    }
}

impl Planned {
    fn channel(
        &self,
        tiles: &Tiles,
        regions: &[Region],
        samples: &Plane,
        out: &mut Plane,
        error: f64,
        run: &Run<'_>,
    ) -> Ending {
        let (low, high) = range(self.mask.as_slice(), samples.pixels());
        let range = f64::from(high) - f64::from(low);
        if range <= 0.0 {
            return Ending::Done(Outcome::direct());
        }
        let middle = low + 0.5 * (high - low);
        // Far from zero an image is rounded by more than its range allows, so it is solved less its middle: samples are within a factor of two
        // of that, and lose nothing.
        let far = if f64::from(middle.abs()) > range { middle } else { 0.0 };
        let wanted = Wanted { middle: middle - far, range, error: error * range };
        if range < TILED.start || range * self.form.stretch() >= TILED.end {
            return Ending::Left { iterations: 0, tolerance: wanted.within(TOLERANCE) };
        }
        add(out, -far);
        let end = self.tiled(tiles, regions, samples, out, wanted, run);
        add(out, far);
        if far != 0.0 {
            self.mask.restore(samples, out);
        }
        if matches!(end, Ending::Done(_)) {
            self.settle(out);
        }
        end
    }

    /// Settles what neither the samples nor the energy see.
    fn settle(&self, out: &mut Plane) {
        if let Some(unseen) = &self.unseen {
            let smooths = self.settings.lambda > 0.0;
            unseen.settle(out, |i, j| smooths || !self.mask.is_measured(i, j));
        }
    }

    /// Tiles, then holes, then tiles that are shifted, and so on until nothing is left to correct.
    fn tiled(
        &self,
        tiles: &Tiles,
        regions: &[Region],
        samples: &Plane,
        out: &mut Plane,
        wanted: Wanted,
        run: &Run<'_>,
    ) -> Ending {
        let mut outcome = Outcome::direct();
        let Wanted { middle, range, error } = wanted;
        let floor = ROUNDING * range;
        let (mut first, mut least, mut holes) = (0.0, None, 0.0_f64);
        let mut seen = None;
        let mut changed = Vec::new();
        let rounds = wanted.rounds();
        // A first guess for holes, whose rims the tiles then find better.
        let guesses: Vec<f64> = regions
            .iter()
            .filter_map(|region| region.solve(samples, out, wanted.within(GUESS), run).residual)
            .collect();
        for round in 0..rounds {
            let target = Target { tolerance: wanted.within(TILE_TOLERANCE), floor, least };
            let task = Task { before: seen.as_ref(), changed: &changed, middle, target, limit: tiles::LIMIT };
            let (sweep, now) = tiles.sweep(&self.mask, out, task, run);
            changed.clear();
            if round == 0 {
                first = sweep.tops.0;
            }
            least = Some(sweep.least.min(least.unwrap_or(f64::INFINITY))).filter(|least| least.is_finite());
            let mut work = sweep.steps;
            let mut failed = false;
            for (region, guess) in regions.iter().zip(&guesses) {
                if round > 0 && !now.touches(&region.window(), tiles.felt()) {
                    continue;
                }
                let ending = region.solve(samples, out, wanted.within(TOLERANCE), run);
                changed.push(region.window());
                work = work.max(ending.iterations);
                failed |= ending.stop != Stop::Converged;
                holes = holes.max(ending.residual.filter(|_| round == 0).map_or(0.0, |left| guess * left));
            }
            seen = Some(now);
            outcome.iterations += work;
            let left = if first > 0.0 { sweep.tops.1 / first } else { 0.0 };
            outcome.residual = Some(left.max(holes));
            if let Some(stop) = run.interrupted() {
                return Ending::Done(Outcome { stop, ..outcome });
            }
            // Third order may have come to the end of f32 before it came near enough.
            failed |= !sweep.tops.1.is_finite();
            if failed || (work == 0 && self.settings.order == Order::Third && sweep.error > error) {
                break;
            }
            if work == 0 || rounds == 1 {
                return Ending::Done(outcome);
            }
        }
        Ending::Left { iterations: outcome.iterations, tolerance: wanted.within(TOLERANCE) }
    }
}
