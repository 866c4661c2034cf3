//! CS-Wavelet: the image whose blurred version has the sparsest wavelet coefficients.
//!
//! Given samples `y` at the measured pixels of an image of `H x W` pixels (`S` picks them; row-major), per channel
//!
//! ```text
//! min_x |W G x|_1  subject to  |S x - y|_2 <= epsilon
//! ```
//!
//! with `W` a wavelet transform and `G` the inverse of what undoes the blur. The thesis (equation 3.7) senses the
//! coefficients `c = W x_b` of the blurred image `x_b = Phi x` by `S Phi^-1 W^-1 c`, with `Phi` multiplying the frequency
//! (k, l), indices of the DFT, by `exp(-(k^2 + l^2) / (2 sigma^2))`. With `c = W G x`, `G = Phi`, both problems are one, and in
//! this form the constraint is an orthogonal projection.
//!
//! `Phi^-1` is not representable where the blur is wide (sigma = 20 asks for e^450 at 1200 squared), and read literally the
//! objective costs frequencies beyond the blur nothing: its minimum then alternates wildly between measured and missing
//! pixels, with `Phi x` near 0. So the inverse is Wiener's by default: `Phi^-1` becomes `(1 + kappa) Phi / (Phi^2 + kappa)`, and
//!
//! ```text
//! G = min((Phi + kappa / Phi) / (1 + kappa), 8)
//! ```
//!
//! which is 1 at frequency 0 and costs high frequencies more, not less; 8 bounds the condition. `kappa = 0` is `G = Phi`.
//!
//! The level of an image is no part of what is to be sparse: `x` and `y` are taken less the median of the samples, which is the
//! constant of the least l1 distance (0 on mostly black frames). Penalised, a level that is large against the range outweighs all detail.
//!
//! Boundary: that of `W` by `boundary`; the blur is periodic.
//!
//! Algorithm: NESTA ([`crate::sensing::Solver`]; `solver::nesta`) from a push-pull start, smoothing `mu = tolerance` times
//! the range of the samples in its last step. The outcome reports `|W G x|_1` and `|S x - y|_2`.
//!
//! Source: P. Sen, S. Darabi, "Compressive Rendering: A Rendering Application of Compressed Sensing", IEEE TVCG 17(4), 2011;
//! X. Liu, "Compressive Volume Rendering" (the thesis), equations 3.5 to 3.7.
//!
//! Settings:
//! - `blur`: sigma, at least 0, DFT samples of the frame; default 20. Smaller blurs more; 0 is no blur.
//! - `wiener`: kappa, at least 0, default 1e-4. Larger is nearer to no blur; 0 is the literal inverse.
//! - `wavelet`, `levels` (0 to 16, default 4), `boundary`: see [`crate::sensing::wavelet`]; default `db4`, periodic.
//! - `epsilon`: at least 0, the samples' unit times the root of their number; default 0, which keeps measured bits.
//! - `tolerance`: above 0, default 1e-2 as in the thesis. Smaller is closer to the minimum and slower.
//! - `max_iterations`: at least 1, default 2000.
//!
//! Cost: an iteration is four Fourier and two wavelet transforms a channel; about 60 to the default tolerance. Memory: eleven
//! planes a channel, three channels at a time.
//!
//! Fails: wavelets are not incoherent with pixels. On renders it stays below `ss` at every density; where the blur is wide for
//! the frame it falls below nearest neighbour at 80 % missing, with speckles in random gaps (`docs/methods.md`).

mod operator;

use std::sync::Arc;

use lacuna_core::parallel::prelude::*;

use super::recover::Rule;
use super::wavelet::{Boundary, Wavelet};
use crate::baseline::push_pull;
use crate::descriptor::{Configured, Descriptor, Field, Memory, Range, Setting, Takes, words};
use crate::kernel::extremes::range;
use crate::solver::Solver;
use crate::solver::sparsity::Samples;
use crate::{Error, Filter, Mask, Outcome, Plan, Plane, Planes, Problem, Run, Stop, check};
use operator::Operator;

/// Channels that are solved side by side; more would cost memory.
pub(super) const SIDE_BY_SIDE: usize = 3;

/// What is asked of CS-Wavelet; see the module for units and directions.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Settings {
    /// Standard deviation of the blur in DFT samples.
    pub blur: f64,
    /// Regularisation of its inverse.
    pub wiener: f64,
    /// The wavelet.
    pub wavelet: Wavelet,
    /// Levels of the transform at most.
    pub levels: usize,
    /// What lies beyond the edges for the wavelet.
    pub boundary: Boundary,
    /// Distance from the samples that is allowed, a Euclidean norm over all measured pixels of a channel; 0 is exact.
    pub epsilon: f64,
    /// Relative variation of the objective at which the solver stops, and its smoothing over the samples' range.
    pub tolerance: f64,
    /// Iterations at most.
    pub max_iterations: usize,
    /// The solver.
    pub solver: Solver,
}

impl Default for Settings {
    fn default() -> Self {
        Self {
            blur: 20.0,
            wiener: 1e-4,
            wavelet: Wavelet::Daubechies(4),
            levels: 4,
            boundary: Boundary::Periodic,
            epsilon: 0.0,
            tolerance: 1e-2,
            max_iterations: 2000,
            solver: Solver::Nesta,
        }
    }
}

words!(Boundary {
    Periodic: "periodic", "The opposite edge";
    Symmetric: "symmetric", "The mirror image";
});

/// The wavelets by name.
const WAVELETS: &str = "haar, db2 to db10, sym2 to sym10, coif1 to coif5 or cdf97";

/// What is to be known of CS-Wavelet.
pub static DESCRIPTOR: Descriptor = Descriptor {
    name: "cs-wavelet",
    help: "Compressed sensing: sparse wavelet coefficients; a baseline",
    settings: &[
        Setting {
            name: "blur",
            flag: "csw-blur",
            value: "SIGMA",
            range: Range::NotNegative,
            help: "standard deviation of the blur in DFT samples of the frame, 0 or more; smaller blurs more, 0 not at all",
            ..Setting::PLAIN
        },
        Setting {
            name: "wiener",
            flag: "csw-wiener",
            value: "KAPPA",
            range: Range::NotNegative,
            help: "regularisation of the blur's inverse (Wiener), 0 or more; 0 takes it literally, larger is nearer to no \
                   blur",
            ..Setting::PLAIN
        },
        Setting {
            name: "wavelet",
            flag: "csw-wavelet",
            value: "WAVELET",
            range: Range::Word(WAVELETS),
            help: "the wavelet: haar, db2 to db10, sym2 to sym10, coif1 to coif5 or cdf97",
            ..Setting::PLAIN
        },
        Setting {
            name: "levels",
            flag: "csw-levels",
            value: "N",
            range: Range::Count(0, 16),
            help: "levels of the transform, 0 to 16",
            ..Setting::PLAIN
        },
        Setting {
            name: "boundary",
            flag: "csw-boundary",
            value: "BOUNDARY",
            range: Range::OneOf(Boundary::CHOICES),
            help: "what lies beyond the edges for the wavelet",
            ..Setting::PLAIN
        },
        Setting {
            name: "epsilon",
            flag: "csw-epsilon",
            value: "EPSILON",
            range: Range::NotNegative,
            help: "distance from the samples that is allowed, a Euclidean norm over a channel's measured pixels, 0 or \
                   more; 0 is exact, larger is smoother and changes measured pixels",
            smooths: true,
            ..Setting::PLAIN
        },
        Setting {
            name: "tolerance",
            flag: "csw-tolerance",
            value: "TOLERANCE",
            range: Range::Positive,
            help: "relative change of the objective at which the solver stops, and its smoothing over the samples' range, above \
                   0; smaller is closer to the minimum and slower",
            ..Setting::PLAIN
        },
        Setting {
            name: "max_iterations",
            flag: "csw-iterations",
            value: "N",
            range: Range::Count(1, usize::MAX),
            help: "iterations at most, 1 or more",
            ..Setting::PLAIN
        },
        Setting {
            name: "solver",
            flag: "csw-solver",
            value: "SOLVER",
            range: Range::OneOf(Solver::CHOICES),
            help: "the solver",
            ..Setting::PLAIN
        },
    ],
    even: Memory { image: 48, channel: 48 },
    uneven: Memory { image: 48, channel: 48 },
    takes: Takes::NOTHING,
    restores: false,
    held_out: None,
    new: || Box::new(Settings::default()),
};

impl Configured for Settings {
    fn descriptor(&self) -> &'static Descriptor {
        &DESCRIPTOR
    }

    fn field(&mut self, name: &str) -> Option<&mut dyn Field> {
        Some(match name {
            "blur" => &mut self.blur,
            "wiener" => &mut self.wiener,
            "wavelet" => &mut self.wavelet,
            "levels" => &mut self.levels,
            "boundary" => &mut self.boundary,
            "epsilon" => &mut self.epsilon,
            "tolerance" => &mut self.tolerance,
            "max_iterations" => &mut self.max_iterations,
            "solver" => &mut self.solver,
            _ => return None,
        })
    }

    fn boxed(&self) -> Box<dyn Configured> {
        Box::new(*self)
    }
}

impl Settings {
    fn rule(&self) -> Rule {
        Rule { solver: self.solver, tolerance: self.tolerance, iterations: self.max_iterations }
    }

    fn validate(&self) -> Result<(), Error> {
        check::not_negative("blur", self.blur)?;
        check::not_negative("wiener", self.wiener)?;
        check::not_negative("epsilon", self.epsilon)?;
        if self.levels > 16 {
            return Err(Error::setting("levels", &self.levels, "0 to 16"));
        }
        if !Wavelet::all().contains(&self.wavelet) {
            return Err(Error::setting("wavelet", &self.wavelet, "an order that exists"));
        }
        self.rule().validate()
    }
}

/// What depends on the mask alone.
struct Planned {
    settings: Settings,
    mask: Arc<Mask>,
    start: Box<dyn Plan>,
    operator: Operator,
}

impl Filter for Settings {
    fn plan(&self, problem: &Problem, run: &Run<'_>) -> Result<Box<dyn Plan>, Error> {
        self.validate()?;
        let mask = problem.mask.clone();
        mask.require_samples()?;
        let start = push_pull::Settings.plan(problem, run)?;
        let operator = Operator::new(mask.size(), self);
        Ok(Box::new(Planned { settings: *self, mask, start, operator }))
    }
}

impl Plan for Planned {
    fn reconstruct(&self, samples: &Planes, out: &mut Planes, run: &Run<'_>) -> Result<Outcome, Error> {
        // The start checks the planes, and copies every measured pixel's bits.
        self.start.reconstruct(samples, out, run)?;
        if self.settings.epsilon == 0.0 && self.mask.is_full() {
            return Ok(Outcome::direct());
        }
        let both = samples.as_slice().chunks(SIDE_BY_SIDE).zip(out.as_mut_slice().chunks_mut(SIDE_BY_SIDE));
        let outcomes: Vec<Outcome> = both
            .flat_map(|(samples, out)| {
                let channels = samples.par_iter().zip(out);
                channels.map(|(samples, out)| self.channel(samples, out, run))
            })
            .collect();
        Ok(outcomes.into_iter().reduce(Outcome::worst).unwrap_or(Outcome::direct()))
    }
}

impl Planned {
    /// Improves the start that `out` holds.
    fn channel(&self, samples: &Plane, out: &mut Plane, run: &Run<'_>) -> Outcome {
        let measured = self.mask.as_slice();
        let (low, high) = range(measured, samples.pixels());
        if low >= high {
            // The start is that constant already.
            return Outcome { stop: Stop::Converged, ..Outcome::direct() };
        }
        let level = median(measured, samples.pixels());
        let values: Vec<f32> = samples.pixels().iter().map(|x| x - level).collect();
        out.pixels_mut().iter_mut().for_each(|x| *x -= level);
        let constraint = Samples { values: &values, measured, radius: self.settings.epsilon };
        let scale = f64::from(high) - f64::from(low);
        let ending = self.settings.rule().solve(&self.operator, constraint, scale, out.pixels_mut(), run);
        for ((x, sample), measured) in out.pixels_mut().iter_mut().zip(samples.pixels()).zip(measured) {
            *x = if *measured && constraint.radius == 0.0 { *sample } else { *x + level };
        }
        ending.into()
    }
}

/// The median of the measured values, the upper one of two; 0 where there is none.
fn median(measured: &[bool], values: &[f32]) -> f32 {
    let both = values.iter().zip(measured);
    let mut values: Vec<f32> = both.filter(|(_, measured)| **measured).map(|(x, _)| *x).collect();
    let middle = values.len() / 2;
    if values.is_empty() { 0.0 } else { *values.select_nth_unstable_by(middle, f32::total_cmp).1 }
}

#[cfg(test)]
pub(super) mod testing {
    use super::{Operator, Settings};
    use crate::Size;

    /// The sparsity of one image size.
    pub fn operator(size: Size, settings: &Settings) -> Operator {
        Operator::new(size, settings)
    }
}
