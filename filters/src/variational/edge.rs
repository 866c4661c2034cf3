//! Edge-enhancing splines: the smoothest image through the samples, where bending across an edge costs next to nothing.
//!
//! Given samples `y` at the measured pixels of an `H x W` image of one or more channels, the channels `x_k` minimise, each,
//!
//! ```text
//! sum over pixels of |D^(1/2) H(x_k) D^(1/2)|^2     over all x_k that equal y_k at the measured pixels
//! D = g(J),    J = G * sum over channels of (H(x_k)^2 + s^2 grad x_k grad x_k'),    g(j) = 1 / (1 + j / c^2), at least 1/100
//! ```
//!
//! with `H` the Hessian (2 x 2), `G` a Gaussian of 1.5 pixels, `s` = 0.3 and `c` the contrast. `g` acts on the eigenvalues of `J`: along an
//! edge `D` is about 1 and the image is held straight, across it about 0 and the image may bend and jump; in smooth shading `D` is 1 and
//! the energy that of `ss` at its plainest. `D` is one for all channels: an edge that one of them shows is an edge of all.
//!
//! It is edge-enhancing diffusion with second derivatives in place of first ones, which is better on all frames it was tried on: first
//! derivatives make smooth shading flat (4 dB below `ss`), and their tensor takes a steep ramp for an edge. Curvature does neither.
//!
//! Discretisation: differences of three pixels, mixed ones of 2 x 2 (`kernel/curvature.rs`); the Hessian in `J` is that of the image
//! blurred by half a pixel. The energy is symmetric under flips and transposition.
//!
//! Boundary: free, as of `ss`: a difference that would leave the image is none. So planes are exact up to the border. In `J`
//! the outermost pixels take the value of those within, and its blur goes on with them. Where there are fewer than three rows or columns,
//! `D` is 1.
//!
//! Algorithm: lagged diffusivity, started from `ss`. A round finds `D` from the image, then solves for the missing pixels with `D` held, by
//! conjugate gradients with the diagonal as preconditioner, until the residual is a tenth or 8 steps are done (more change figures by less
//! than 0.1 dB; 4 where a rough image will do). This happens in tiles of 64 x 64 pixels with 8 around them, each from the image of the round before; the grid of tiles
//! moves by half a tile from round to round. A tile in which no weight is below 0.7 stays as `ss` left it, bit for bit.
//!
//! References: J. Weickert, "Theoretical foundations of anisotropic diffusion in image processing", Computing Supplement 11, 1996
//! (edge-enhancing diffusion); I. Galic, J. Weickert, M. Welk, A. Bruhn, A. Belyaev, H.-P. Seidel, "Image compression with
//! anisotropic diffusion", JMIV 31, 2008 (from scattered samples); S. Didas, J. Weickert, B. Burgeth, "Properties of higher order nonlinear
//! diffusion filtering", JMIV 35, 2009 (second derivatives); C. Vogel, M. Oman, "Iterative methods for total variation denoising", SIAM J.
//! Sci. Comput. 17, 1996 (lagged diffusivity).
//!
//! Settings:
//! - `contrast`: above 0, default 0.1: the curvature, in spreads of the samples a pixel squared, at which bending counts half. Larger is nearer
//!   to `ss`; smaller also keeps faint edges, and is better on smooth renders, worse where edges are steps. The spread of a channel is
//!   `(sum |y - m| / sum |y - m|^(1/2))^2`, m its mean: as large as the contrast of an object that covers little of the frame, and not moved by
//!   few highlights. The largest of the channels counts for all, so that a factor on all of them changes nothing.
//! - `rounds`: at least 1, default 2. A third gains 0.1 dB.
//!
//! Cost: `ss`, then a round finds `J` (about 60 operations a pixel and channel) and takes up to 8 steps of about 60 in every tile that has
//! an edge. Memory beyond samples and result: 17 planes of a tile a thread, and a plane a channel.
//!
//! The outcome's residual is the largest preconditioned residual of a tile in the last round, over that before its first step.
//!
//! Fails: where samples are too few to show an edge's course (below about 5 %) it gains little over `ss`; it rounds thin crossings and
//! corners; a texture finer than the samples becomes streaks.

use std::sync::Arc;

use lacuna_core::parallel::prelude::*;

use crate::descriptor::Kind;
use crate::descriptor::{Configured, Descriptor, Field, Memory, Range, Setting, Takes};
use crate::filter::Start;
use crate::kernel::blur::half_window;
use crate::kernel::curvature::{Solve, Tile, Weigh, Weighting};
use crate::kernel::{Isa, dispatch};
use crate::tiling::{Core, Tiling};
use crate::variational::ss;
use crate::{Error, Filter, Mask, Outcome, Plan, Plane, Planes, Problem, Run, Size, check};
use lacuna_core::hash;

/// Pixels of the side of a tile.
const SIDE: usize = 64;
/// Pixels around it that are solved with it and thrown away.
const HALO: usize = 8;
/// Pixels of rows that tell the spread of samples.
const ENOUGH: usize = 1 << 18;
/// Outermost pixels of a tile's surroundings that stay as they are: a difference of three pixels reaches so far.
const RIM: usize = 2;
/// A tile without a smaller weight than this has no edge.
const EDGE: f32 = 0.7;
/// The least weight.
const FLOOR: f32 = 0.01;
/// What a slope counts beside a curvature.
const SLOPE: f32 = 0.3;
/// Standard deviation of the tensor's blur, in pixels.
const BLUR: f64 = 1.5;
/// Steps of conjugate gradients in a tile and round.
const STEPS: usize = 8;
/// The same from the error [`ROUGH`] on, over the range of the samples.
const FEW_STEPS: usize = 4;
/// See [`FEW_STEPS`].
const ROUGH: f64 = 1e-3;
/// The residual, over that before the first step, that is small enough.
const TOLERANCE: f64 = 0.1;

/// What is asked of edge-enhancing splines; see the module for units and directions.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Settings {
    /// The curvature, in spreads of the samples a pixel squared, at which bending counts half.
    pub contrast: f64,
    /// How often edges are looked for and the image is found again.
    pub rounds: usize,
}

impl Default for Settings {
    fn default() -> Self {
        Self { contrast: 0.1, rounds: 2 }
    }
}

/// What is to be known of edge-enhancing splines.
pub static DESCRIPTOR: Descriptor = Descriptor {
    name: "edge",
    help: "Edge-enhancing splines: smooth, but bending freely across edges",
    settings: &[
        Setting {
            name: "contrast",
            flag: "edge-contrast",
            value: "CONTRAST",
            range: Range::Positive,
            help: "the curvature that is taken for an edge, in spreads of the samples a pixel squared, above 0; larger is \
                   nearer to ss",
            ..Setting::PLAIN
        },
        Setting {
            name: "rounds",
            flag: "edge-rounds",
            value: "N",
            range: Range::Count(1, usize::MAX),
            help: "how often edges are looked for and the image is found again, 1 or more",
            ..Setting::PLAIN
        },
    ],
    // As `ss`, from which it starts.
    even: Memory { image: 26, channel: 6 },
    uneven: Memory { image: 165, channel: 8 },
    takes: Takes::NOTHING,
    restores: false,
    held_out: Some(Kind::Spline),
    new: || Box::new(Settings::default()),
};

impl Configured for Settings {
    fn descriptor(&self) -> &'static Descriptor {
        &DESCRIPTOR
    }

    fn field(&mut self, name: &str) -> Option<&mut dyn Field> {
        Some(match name {
            "contrast" => &mut self.contrast,
            "rounds" => &mut self.rounds,
            _ => return None,
        })
    }

    fn boxed(&self) -> Box<dyn Configured> {
        Box::new(*self)
    }
}

/// What all tiles have in common.
#[derive(Clone, Copy)]
struct How {
    weighting: Weighting,
    /// What values are divided by.
    unit: f32,
    /// Steps at most.
    steps: usize,
}

/// What depends on the mask alone.
struct Planned {
    settings: Settings,
    mask: Arc<Mask>,
    start: Start,
    isa: Isa,
}

impl Filter for Settings {
    fn plan(&self, problem: &Problem, _: &Run<'_>) -> Result<Box<dyn Plan>, Error> {
        check::positive("contrast", self.contrast)?;
        check::at_least_one("rounds", self.rounds)?;
        let mask = Arc::clone(&problem.mask);
        let start = Start::new(ss::Settings::default(), Arc::clone(&mask))?;
        Ok(Box::new(Planned { settings: *self, mask, start, isa: Isa::best() }))
    }

    fn start(&self) -> Option<&'static str> {
        Some(ss::DESCRIPTOR.name)
    }
}

impl Plan for Planned {
    fn reconstruct(&self, samples: &Planes, out: &mut Planes, run: &Run<'_>) -> Result<Outcome, Error> {
        // The start checks the planes, and copies every measured pixel's bits.
        let start = self.start.plan(run)?.reconstruct(samples, out, run)?;
        Ok(self.enhance(start, steps(None), samples, out, run))
    }

    fn reconstruct_roughly(
        &self,
        samples: &Planes,
        error: f64,
        out: &mut Planes,
        run: &Run<'_>,
    ) -> Result<Outcome, Error> {
        let start = self.start.plan(run)?.reconstruct_roughly(samples, error, out, run)?;
        Ok(self.enhance(start, steps(Some(error)), samples, out, run))
    }

    fn reconstruct_from_start(
        &self,
        samples: &Planes,
        error: Option<f64>,
        out: &mut Planes,
        run: &Run<'_>,
    ) -> Result<Outcome, Error> {
        check::group(&self.mask, samples, out)?;
        Ok(self.enhance(Outcome::direct(), steps(error), samples, out, run))
    }
}

/// Steps of conjugate gradients at most, where so large an error will do.
fn steps(error: Option<f64>) -> usize {
    if error.is_some_and(|error| error >= ROUGH) { FEW_STEPS } else { STEPS }
}

/// The power of two below a spread: values over it are exact, and their squares stay in the range of f32.
pub fn unit(spread: f64) -> f64 {
    spread.log2().floor().clamp(-120.0, 120.0).exp2()
}

/// The spread of each channel's measured values; of a large image, those of some rows.
pub fn spreads(mask: &Mask, samples: &Planes) -> Vec<f64> {
    let (height, every) = (mask.size().height, (mask.size().pixels() / ENOUGH).max(1) as u64);
    let mut rows: Vec<usize> = (0..height).filter(|&row| hash(0, row as u64).is_multiple_of(every)).collect();
    if rows.iter().all(|&row| !mask.row(row).contains(&true)) {
        rows = (0..height).collect();
    }
    let spread = |plane: &Plane| {
        let values = || rows.iter().flat_map(|&row| plane.row(row).iter().zip(mask.row(row)));
        let measured = || values().filter(|(_, flag)| **flag).map(|(value, _)| f64::from(*value));
        let (sum, count) = measured().fold((0.0, 0_u32), |(sum, count), value| (sum + value, count + 1));
        let mean = sum / f64::from(count.max(1));
        let (far, roots) = measured().fold((0.0, 0.0), |(far, roots), value| {
            let distance = (value - mean).abs();
            (far + distance, roots + distance.sqrt())
        });
        if roots > 0.0 { (far / roots).powi(2) } else { 0.0 }
    };
    samples.as_slice().par_iter().map(spread)
}

impl Planned {
    /// All rounds on what splines made of the samples.
    fn enhance(
        &self,
        start: Outcome,
        steps: usize,
        samples: &Planes,
        out: &mut Planes,
        run: &Run<'_>,
    ) -> Outcome {
        let mut outcome = start;
        let spread = spreads(&self.mask, samples).into_iter().fold(0.0, f64::max);
        if self.mask.is_full() || spread <= 0.0 {
            return outcome;
        }
        let unit = unit(spread);
        let contrast = self.settings.contrast * spread / unit;
        let weighting = Weighting {
            inverse: (1.0 / (contrast * contrast)) as f32,
            slope: SLOPE * SLOPE,
            floor: FLOOR,
            blur: half_window(BLUR),
        };
        let how = How { weighting, unit: unit as f32, steps };
        outcome.residual = None;
        for round in 0..self.settings.rounds {
            let shift = if round % 2 == 0 { 0 } else { SIDE / 2 };
            let (steps, left) = self.round(how, shift, out, run);
            outcome.iterations += steps;
            outcome.residual = Some(left);
            if let Some(stop) = run.interrupted() {
                return Outcome { stop: stop.max(outcome.stop), ..outcome };
            }
        }
        outcome
    }

    /// Finds the edges of the image and solves with them, tile by tile. Returns the most steps and the largest residual of a tile.
    fn round(&self, how: How, shift: usize, out: &mut Planes, run: &Run<'_>) -> (usize, f64) {
        let tiling = Tiling { side: SIDE, halo: HALO, shift };
        let ends = tiling.map(&self.mask, out, run, |tile, core, before| self.solve(how, tile, core, before));
        ends.into_iter()
            .fold((0, 0.0), |(most, largest), (steps, left)| (most.max(steps), f64::max(largest, left)))
    }

    /// The pixels of a core, one channel after the other, with steps and residual; nothing if it has no edge.
    fn solve(
        &self,
        how: How,
        tile: &mut Tile,
        core: &Core,
        before: &Planes,
    ) -> Option<(Vec<f32>, (usize, f64))> {
        self.read(how, core, before, tile);
        if dispatch(self.isa, Weigh { tile, how: how.weighting, sought: EDGE }) >= EDGE {
            return None;
        }
        let (steps, left) = dispatch(self.isa, Solve { tile, steps: how.steps, tolerance: TOLERANCE });
        let (outer, inner) = (core.outer, core.inner);
        let mut values = Vec::with_capacity(inner.pixels() * before.len());
        for plane in tile.values.chunks_exact(outer.pixels()) {
            let rows = plane.chunks_exact(outer.width).skip(core.margin.0).take(inner.height);
            values.extend(
                rows.flat_map(|row| &row[core.margin.1..][..inner.width]).map(|value| value * how.unit),
            );
        }
        Some((values, (steps, left)))
    }

    /// Fills a tile with a window's pixels, in units, and with which of them are to be found.
    fn read(&self, how: How, core: &Core, from: &Planes, tile: &mut Tile) {
        let (Size { height, width }, (top, left)) = (core.outer, core.origin);
        tile.resize(height, width, from.len());
        for (plane, values) in from.as_slice().iter().zip(tile.values.chunks_exact_mut(height * width)) {
            core.copy(plane, how.unit.recip(), width, values);
        }
        // Where the window ends within the image, its rim stays.
        let inside = |first: usize, length: usize, all: usize| {
            let begin = if first > 0 { RIM } else { 0 };
            let end = if first + length < all { length.saturating_sub(RIM) } else { length };
            begin..end.max(begin)
        };
        let columns = inside(left, width, self.mask.size().width);
        for y in inside(top, height, self.mask.size().height) {
            let flags = &self.mask.row(top + y)[left..][..width];
            for x in columns.clone() {
                tile.free[y * width + x] = f32::from(u8::from(!flags[x]));
            }
        }
    }
}

#[cfg(test)]
mod tests;
