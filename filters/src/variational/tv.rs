//! Total variation: the image with the least sum of gradient lengths that passes through, or near, the samples.
//!
//! Given samples `y` at the measured pixels of an image of `H x W` pixels (`S` picks them; row-major), per channel
//!
//! ```text
//! min_x |x|_TV  subject to  |S x - y|_2 <= epsilon,     |x|_TV = sum over pixels of |(grad x)_ij|
//! (grad x)_ij = (x_{i+1,j} - x_{i,j}, x_{i,j+1} - x_{i,j}),  |.| Euclidean (isotropic) or absolute (anisotropic)
//! ```
//!
//! Boundary: the vertical difference is zero in the last row, the horizontal one in the last column; these components
//! of the dual variable are zero too, and the adjoint is
//! `(grad* q)_ij = q1_{i-1,j} - q1_{i,j} + q2_{i,j-1} - q2_{i,j}` with zeros outside.
//!
//! Algorithm: over-relaxed primal-dual sweeps (see `solver::primal_dual`) from a push-pull start `x` and the dual start
//! `q = clip(a grad x)`, with the channel scaled to 0..1 and `rho = 1.6`. Step sizes follow the start: in each block of 16 x 16
//! pixels, with `g` its mean gradient (smoothed over neighbouring blocks) and `m` that of the image, `tau = 0.8 sqrt(g m)`
//! (times the 3/4 power of 0.2 / density), `sigma` is the largest for which no gradient has `sigma tau > 0.99 / 8`, and `a = 2.4 / tau`
//! (times that power). It stops on the relative duality gap `(P - D) / P`, which the outcome reports: `P` is the
//! objective of the image, and for any `q` in the unit ball, with `d = grad* q`,
//!
//! ```text
//! D = sum_measured y d + sum_missing min(low d, high d) - epsilon |d|_measured
//! ```
//!
//! bounds the minimum from below. Weights `w` of the samples make the ball `sum w (x - y)^2 <= epsilon^2`, and `|d|` in
//! the bound `sqrt(sum d^2 / w)`; a sample of weight 0 is missing. `low..high` is the measured range: clamping an image to it
//! shortens its gradients and its distance from the samples, so the box moves no minimum, and it makes the bound finite for every
//! `q`. The image is therefore at most `gap` (relative to its own objective) above the minimum. Before a bound is taken `q`
//! is made nearly divergence-free at missing pixels (`tighten`), and the sweeps go on from there. With `epsilon > 0` the steps
//! are the same everywhere: `tau = 1.1 m (0.2 / density)^(3/4)`, `a = 3 / m`.
//!
//! Source: L. Rudin, S. Osher, E. Fatemi, "Nonlinear Total Variation Based Noise Removal Algorithms", Physica D 60, 1992
//! (the functional); A. Chambolle, T. Pock, JMIV 40, 2011, algorithm 1; L. Condat, JOTA 158, 2013, algorithm 3.1.
//!
//! Settings:
//! - `norm`: isotropic (default) or anisotropic, which prefers edges along rows and columns and is about 1 dB worse
//!   on smooth renders.
//! - `epsilon`: at least 0, in the samples' unit times the root of their number; default 0, which keeps
//!   measured bits. Larger is smoother; at the samples' distance from their mean the image is that mean.
//!   `auto` is the discrepancy principle: the root of the summed variances, mean over channels, of noise that is known, or that the rest of
//!   smoothing splines shows (`ss/choose.rs`). Source: V. Morozov, "On the solution of functional equations by the method of
//!   regularization", Soviet Mathematics Doklady 7, 1966.
//! - `gap`: above 0, relative, default 1e-2. Smaller is closer to the minimum and slower; f32 reaches 1e-5 on small frames.
//! - `max_iterations`: at least 1, default 2000.
//! - `solver`: primal-dual (default), or NESTA (`tv/nesta.rs`), which the thesis used: the same objective and the same certificate.
//!
//! Cost: a sweep is one pass of about 30 operations, a root and a division a pixel (two passes for `epsilon > 0`); a certificate
//! costs about 20 sweeps. A render at 20 % density takes 40 sweeps to the default gap, 104 to 115 to 1e-3. Memory: per
//! channel 3 planes of f32, half a plane of band edges and an eighth of a plane of step sizes (1 more for `epsilon > 0`, and 1 for
//! all channels); one plane of bytes for all.
//!
//! Fails: smooth shading becomes flat steps; on smooth renders it is not better than OpenImageIO's push-pull (48.33 against
//! 48.98 dB at 20 % of an engine render). Holes 256 pixels wide and densities of 1 % need thousands of sweeps, and the outcome says
//! so if they end at the limit. Weights that differ by large factors slow it: the heavier a sample, the shorter its steps.

mod channel;
mod nesta;
pub(crate) mod tighten;
mod weights;

use crate::baseline::push_pull;
use crate::choose::Given;
use crate::descriptor::Kind;
use crate::descriptor::{Configured, Descriptor, Field, Memory, Range, Setting, Takes, words};
use crate::kernel::Isa;
use crate::kernel::extremes::range;
use crate::kernel::tv::{Anisotropic, DualBall, Isotropic};
pub use crate::prox::Norm;
pub use crate::solver::Solver;
use crate::variational::ss;
use crate::{Error, Filter, Mask, Outcome, Plan, Plane, Planes, Problem, Run, check};
use channel::{Channel, Shared};
use weights::Weights;

/// Sweeps between two looks at the clock.
const ROUND: usize = 16;

/// The outcome where the answer is known without a sweep.
const PROVEN: Outcome = Outcome { gap: Some(0.0), ..Outcome::direct() };

/// What is asked of total variation; see the module for units and directions.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Settings {
    /// How the length of a gradient is measured.
    pub norm: Norm,
    /// Distance from the samples that is allowed, a Euclidean norm over all measured pixels of a channel; 0 is exact.
    pub epsilon: f64,
    /// Relative duality gap at which the solver stops.
    pub gap: f64,
    /// Sweeps at most.
    pub max_iterations: usize,
    /// How the image is found: primal-dual sweeps, or NESTA, to the same gap.
    pub solver: Solver,
}

impl Default for Settings {
    fn default() -> Self {
        let solver = Solver::PrimalDual;
        Self { norm: Norm::Isotropic, epsilon: 0.0, gap: 1e-2, max_iterations: 2000, solver }
    }
}

words!(Norm {
    Isotropic: "isotropic", "Euclidean length";
    Anisotropic: "anisotropic", "Sum of absolute differences";
});

/// What is to be known of total variation.
pub static DESCRIPTOR: Descriptor = Descriptor {
    name: "tv",
    help: "Total variation: flat regions between sharp edges",
    settings: &[
        Setting {
            name: "norm",
            flag: "tv-norm",
            value: "NORM",
            range: Range::OneOf(Norm::CHOICES),
            help: "how the length of a gradient is measured; anisotropic prefers edges along rows and columns",
            ..Setting::PLAIN
        },
        Setting {
            name: "epsilon",
            flag: "tv-epsilon",
            value: "EPSILON",
            range: Range::NotNegative,
            help: "distance from the samples that is allowed, a Euclidean norm over a channel's measured pixels, 0 or \
                   more; 0 is exact, larger is smoother and changes measured pixels; auto: as far as their noise \
                   puts them off",
            smooths: true,
            auto: true,
            ..Setting::PLAIN
        },
        Setting {
            name: "gap",
            flag: "tv-gap",
            value: "GAP",
            range: Range::Positive,
            help: "relative duality gap at which the solver stops, above 0; smaller is closer to the minimum and slower",
            ..Setting::PLAIN
        },
        Setting {
            name: "max_iterations",
            flag: "tv-iterations",
            value: "N",
            range: Range::Count(1, usize::MAX),
            help: "iterations at most, 1 or more",
            ..Setting::PLAIN
        },
        Setting {
            name: "solver",
            flag: "tv-solver",
            value: "SOLVER",
            range: Range::OneOf(Solver::CHOICES),
            help: "how the image is found, to the same gap; nesta is what the thesis used",
            silent: true,
            ..Setting::PLAIN
        },
    ],
    even: Memory { image: 8, channel: 20 },
    uneven: Memory { image: 28, channel: 20 },
    takes: Takes { weights: true, ..Takes::NOTHING },
    restores: false,
    held_out: Some(Kind::Density),
    new: || Box::new(Settings::default()),
};

impl Configured for Settings {
    fn descriptor(&self) -> &'static Descriptor {
        &DESCRIPTOR
    }

    fn field(&mut self, name: &str) -> Option<&mut dyn Field> {
        Some(match name {
            "norm" => &mut self.norm,
            "epsilon" => &mut self.epsilon,
            "gap" => &mut self.gap,
            "max_iterations" => &mut self.max_iterations,
            "solver" => &mut self.solver,
            _ => return None,
        })
    }

    fn boxed(&self) -> Box<dyn Configured> {
        Box::new(*self)
    }

    fn choose(
        &self,
        _name: &str,
        given: &Given<'_>,
        run: &Run<'_>,
    ) -> Result<Option<(f64, &'static str)>, Error> {
        Ok(Some(discrepancy(given, run)?))
    }

    fn unweighted(&self) -> Option<&'static str> {
        (self.solver == Solver::Nesta).then_some("solver")
    }
}

impl Settings {
    pub(crate) fn check(&self) -> Result<(), Error> {
        check::not_negative("epsilon", self.epsilon)?;
        check::positive("gap", self.gap)?;
        check::at_least_one("max_iterations", self.max_iterations)
    }
}

/// The distance from the samples that their noise explains, and what showed it.
fn discrepancy(given: &Given<'_>, run: &Run<'_>) -> Result<(f64, &'static str), Error> {
    let weight = |pixel: usize| given.weights.map_or(1.0, |weights| f64::from(weights.pixels()[pixel]));
    let measured = || (0..given.mask.size().pixels()).filter(|&pixel| given.mask.as_slice()[pixel]);
    let Some(noise) = given.noise else {
        let found = ss::smoothness(&ss::Settings::default(), given, run)?;
        let count = measured().filter(|&pixel| weight(pixel) > 0.0).count();
        return Ok(((count as f64 * found.variance).sqrt(), found.by));
    };
    let mut sum = 0.0;
    for plane in noise.as_slice() {
        let known: Vec<f64> = measured()
            .filter(|&pixel| plane.pixels()[pixel].is_finite())
            .map(|pixel| weight(pixel) * f64::from(plane.pixels()[pixel]).powi(2))
            .collect();
        // Samples whose noise is not known have that of the others.
        sum += known.iter().sum::<f64>() / known.len().max(1) as f64 * given.mask.count() as f64;
    }
    Ok(((sum / noise.len().max(1) as f64).sqrt(), "known noise"))
}

/// What depends on the mask alone.
struct Planned {
    settings: Settings,
    /// The measured pixels that count: not those of weight 0.
    mask: std::sync::Arc<Mask>,
    free: Vec<u8>,
    ball: Weights,
    start: Box<dyn Plan>,
    isa: Isa,
}

impl Filter for Settings {
    fn plan(&self, problem: &Problem, run: &Run<'_>) -> Result<Box<dyn Plan>, Error> {
        self.check()?;
        problem.mask.require_samples()?;
        let weights = problem.weights.as_deref().filter(|_| self.epsilon > 0.0);
        if weights.is_some() && self.solver == Solver::Nesta {
            let range = "primal-dual where samples have weights";
            return Err(Error::setting("solver", &self.solver.show(), range));
        }
        let (mask, ball) = Weights::new(&problem.mask, weights, self.epsilon)?;
        let free = mask.as_slice().iter().map(|&measured| u8::from(!measured)).collect();
        let start = push_pull::Settings.plan(&Problem::fill(mask.clone()), run)?;
        Ok(Box::new(Planned { settings: *self, mask, free, ball, start, isa: Isa::best() }))
    }
}

impl Plan for Planned {
    fn reconstruct(&self, samples: &Planes, out: &mut Planes, run: &Run<'_>) -> Result<Outcome, Error> {
        // The start checks the planes, and copies every measured pixel's bits.
        self.start.reconstruct(samples, out, run)?;
        if self.settings.epsilon == 0.0 && self.mask.is_full() {
            return Ok(PROVEN);
        }
        match self.settings.norm {
            Norm::Isotropic => Ok(self.solve::<Isotropic>(out, run)),
            Norm::Anisotropic => Ok(self.solve::<Anisotropic>(out, run)),
        }
    }
}

impl Planned {
    /// Improves the start that `out` holds.
    fn solve<B: DualBall>(&self, out: &mut Planes, run: &Run<'_>) -> Outcome {
        let size = self.mask.size();
        let shared = Shared {
            settings: &self.settings,
            size,
            free: &self.free,
            ball: &self.ball,
            measured: self.mask.as_slice(),
            density: self.mask.density(),
            isa: self.isa,
        };
        let mut outcome = PROVEN;
        let mut channels = Vec::new();
        for plane in out.as_mut_slice() {
            let (low, high) = range(self.mask.as_slice(), plane.pixels());
            let (low, high) = (f64::from(low), f64::from(high));
            if let Some(value) = self.constant(plane, low, high) {
                self.fill(plane, value);
            } else {
                let channel = Channel::new::<B>(shared, plane, low, high);
                channels.push((channel, plane));
            }
        }
        while channels.iter().any(|(channel, _)| !channel.done()) {
            let stop = run.interrupted();
            for (channel, _) in channels.iter_mut().filter(|(channel, _)| !channel.done()) {
                match stop {
                    None if channel.step::<B>(shared, run) => {}
                    None => channel.advance::<B>(shared, ROUND),
                    Some(stop) => channel.interrupt::<B>(shared, stop),
                }
            }
        }
        for (channel, plane) in channels {
            channel.write(shared, plane);
            outcome = outcome.worst(channel.outcome());
        }
        outcome
    }

    /// The samples' mean, if it is near enough to all of them, which span `low..=high`, to be the answer.
    fn constant(&self, plane: &Plane, low: f64, high: f64) -> Option<f64> {
        if low >= high {
            return Some(low);
        }
        if self.ball.radius == 0.0 {
            return None;
        }
        let values = || measured(plane, &self.mask);
        let weights = || self.ball.measured(&self.mask);
        let mean = values().zip(weights()).map(|(v, w)| w * v).sum::<f64>() / weights().sum::<f64>();
        let distance = values().zip(weights()).map(|(v, w)| w * (v - mean).powi(2)).sum::<f64>().sqrt();
        (distance <= self.ball.radius).then_some(mean)
    }

    /// Makes missing pixels `value`, and measured ones too where the settings let them move.
    fn fill(&self, plane: &mut Plane, value: f64) {
        let moves = self.settings.epsilon > 0.0;
        for (pixel, &measured) in plane.pixels_mut().iter_mut().zip(self.mask.as_slice()) {
            if moves || !measured {
                *pixel = value as f32;
            }
        }
    }
}

/// The measured values of a plane.
fn measured<'a>(plane: &'a Plane, mask: &'a Mask) -> impl Iterator<Item = f64> + 'a {
    let both = plane.pixels().iter().zip(mask.as_slice());
    both.filter_map(|(&v, &measured)| measured.then_some(f64::from(v)))
}

#[cfg(test)]
mod tests;
#[cfg(test)]
mod twin;
