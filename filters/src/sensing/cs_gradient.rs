//! CS-Gradient: each component of the gradient is recovered by the sparsity of its spectrum, then integrated.
//!
//! Given samples `y1` of one component of the gradient at some pixels of an image of `H x W` pixels (`S` picks them), per
//! channel and component
//!
//! ```text
//! min_g |F g|_1  subject to  |S g - y1|_2 <= epsilon        (equation 3.9 of the thesis)
//! ```
//!
//! with `F` the unitary DFT, `|.|_1` the sum of the moduli. The image is then the one with the recovered differences
//! `x(i, j+1) - x(i, j)` and `x(i+1, j) - x(i, j)`, in the least-squares sense, and given pixels:
//!
//! - anchor `border`: the image border, which is filled first: between its measured pixels it follows the recovered
//!   differences along it, the misfit spread evenly. The interior solves Poisson's equation directly.
//! - anchor `measured`: every measured pixel, with natural conditions at the border, by conjugate gradients.
//!
//! Where the samples come from:
//! - gradients that a renderer measured ([`Plan::reconstruct_gradients`]): derivatives per pixel at pixel centres, of which
//!   neighbours' mean is the difference between them.
//! - pixels alone ([`Plan::reconstruct`]): the difference of two neighbours that are both measured. Masks must hold such
//!   pairs, as `lacuna mask --paired` makes them; every pixel of a pair counts as computed.
//!
//! Boundary: the DFT is periodic; differences across the border are unknown and not used.
//!
//! Algorithm: NESTA from gradients of 0, smoothing `mu = tolerance` times the largest sample in its last step. The outcome
//! reports the sum of both objectives and the larger distance from the samples.
//!
//! Source: X. Liu, "Compressive Volume Rendering" (the thesis), section 3.1.3; P. Perez, M. Gangnet, A. Blake, "Poisson Image
//! Editing", SIGGRAPH 2003 (Dirichlet conditions). Settings:
//! - `anchor`: see above; default border, as in the thesis.
//! - `restore`: measured pixels leave as recovered, too; default off, they keep their bits.
//! - `epsilon`: at least 0, the gradient's unit times the root of the number of samples; default 0. Larger is smoother.
//! - `tolerance`: above 0, default 1e-2 as in the thesis. Smaller is closer to the minimum and slower.
//! - `max_iterations`: at least 1, default 2000, per component.
//!
//! Cost: an iteration is two Fourier transforms a component; 60 to the default tolerance. Memory: ten planes a channel, three
//! channels at a time.
//!
//! Fails: an error in the gradient is summed up by the integration: shades drift at low densities. Regular masks are not
//! incoherent with waves, and alias.

mod integrate;
#[cfg(test)]
mod tests;

use std::sync::Arc;

use lacuna_core::parallel::prelude::*;
use lacuna_transforms::Complex;
use serde::Serialize;

use super::cs_wavelet::SIDE_BY_SIDE;
use super::recover::Rule;
use crate::descriptor::{Configured, Descriptor, Field, Memory, Range, Setting, Takes, words};
use crate::operator::fourier::{Fourier, Spectrum};
use crate::solver::Solver;
use crate::solver::sparsity::{Samples, Sparsity};
use crate::{Error, Filter, Gradients, Mask, Outcome, Plan, Plane, Planes, Problem, Run, Size, check};

/// Which pixels the integration starts from.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize)]
#[serde(rename_all = "kebab-case")]
pub enum Anchor {
    /// Those of the image border.
    #[default]
    Border,
    /// All that were measured.
    Measured,
}

/// What is asked of CS-Gradient; see the module for units and directions.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Settings {
    /// Where the integration starts.
    pub anchor: Anchor,
    /// Whether measured pixels leave as recovered.
    pub restore: bool,
    /// Distance from the samples of a component that is allowed; 0 is exact.
    pub epsilon: f64,
    /// Relative variation of the objective at which the solver stops, and its smoothing over the largest sample.
    pub tolerance: f64,
    /// Iterations at most.
    pub max_iterations: usize,
    /// The solver.
    pub solver: Solver,
}

impl Default for Settings {
    fn default() -> Self {
        Self {
            anchor: Anchor::Border,
            restore: false,
            epsilon: 0.0,
            tolerance: 1e-2,
            max_iterations: 2000,
            solver: Solver::Nesta,
        }
    }
}

words!(Anchor {
    Border: "border", "At the image border";
    Measured: "measured", "At every measured pixel";
});

/// What is to be known of CS-Gradient.
pub static DESCRIPTOR: Descriptor = Descriptor {
    name: "cs-gradient",
    help: "Compressed sensing: gradients with a sparse spectrum; a baseline",
    settings: &[
        Setting {
            name: "anchor",
            flag: "csg-anchor",
            value: "ANCHOR",
            range: Range::OneOf(Anchor::CHOICES),
            help: "the measured pixels from which gradients are integrated",
            ..Setting::PLAIN
        },
        Setting {
            name: "restore",
            flag: "csg-restore",
            range: Range::Switch,
            help: "measured pixels leave as recovered, too, instead of as they came",
            smooths: true,
            ..Setting::PLAIN
        },
        Setting {
            name: "epsilon",
            flag: "csg-epsilon",
            value: "EPSILON",
            range: Range::NotNegative,
            help: "distance from a component's samples that is allowed, a Euclidean norm, 0 or more; larger is smoother",
            ..Setting::PLAIN
        },
        Setting {
            name: "tolerance",
            flag: "csg-tolerance",
            value: "TOLERANCE",
            range: Range::Positive,
            help: "relative change of the objective at which the solver stops, and its smoothing over the largest sample, above 0; \
                   smaller is closer to the minimum and slower",
            ..Setting::PLAIN
        },
        Setting {
            name: "max_iterations",
            flag: "csg-iterations",
            value: "N",
            range: Range::Count(1, usize::MAX),
            help: "iterations at most for a component, 1 or more",
            ..Setting::PLAIN
        },
        Setting {
            name: "solver",
            flag: "csg-solver",
            value: "SOLVER",
            range: Range::OneOf(Solver::CHOICES),
            help: "the solver",
            ..Setting::PLAIN
        },
    ],
    even: Memory { image: 48, channel: 44 },
    uneven: Memory { image: 48, channel: 44 },
    takes: Takes { gradients: true, ..Takes::NOTHING },
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
            "anchor" => &mut self.anchor,
            "restore" => &mut self.restore,
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
}

/// What depends on the mask alone.
struct Planned {
    settings: Settings,
    mask: Arc<Mask>,
    operator: Operator,
}

impl Filter for Settings {
    fn plan(&self, problem: &Problem, _run: &Run<'_>) -> Result<Box<dyn Plan>, Error> {
        check::not_negative("epsilon", self.epsilon)?;
        self.rule().validate()?;
        let mask = problem.mask.clone();
        mask.require_samples()?;
        let operator = Operator { fourier: Fourier::new(mask.size()), size: mask.size() };
        Ok(Box::new(Planned { settings: *self, mask, operator }))
    }
}

impl Plan for Planned {
    fn reconstruct(&self, samples: &Planes, out: &mut Planes, run: &Run<'_>) -> Result<Outcome, Error> {
        check::group(&self.mask, samples, out)?;
        let pairs = [self.pairs(0, 1), self.pairs(1, 0)];
        let Size { height, width } = self.mask.size();
        let none = |pairs: &[bool], length: usize| length > 1 && !pairs.contains(&true);
        if !self.mask.is_full() && (none(&pairs[0], width) || none(&pairs[1], height)) {
            return Err(Error::NoPairs);
        }
        let differences = |channel: usize, axis: usize| {
            let ahead = if axis == 0 { 1 } else { width };
            let pixels = samples.as_slice()[channel].pixels();
            let difference =
                |(i, pair): (usize, &bool)| if *pair { pixels[i + ahead] - pixels[i] } else { 0.0 };
            pairs[axis].iter().enumerate().map(difference).collect()
        };
        let sources = Sources { measured: [&pairs[0], &pairs[1]], values: &differences, centred: false };
        Ok(self.solve(samples, &sources, out, run))
    }

    fn reconstruct_gradients(
        &self,
        samples: &Planes,
        gradients: &Gradients<'_>,
        out: &mut Planes,
        run: &Run<'_>,
    ) -> Result<Outcome, Error> {
        check::group(&self.mask, samples, out)?;
        gradients.mask.require_samples()?;
        for planes in gradients.planes {
            check::group(gradients.mask, planes, out)?;
        }
        let measured = gradients.mask.as_slice();
        let values = |channel: usize, axis: usize| {
            let pixels = gradients.planes[axis].as_slice()[channel].pixels();
            pixels.iter().zip(measured).map(|(value, flag)| if *flag { *value } else { 0.0 }).collect()
        };
        let sources = Sources { measured: [measured, measured], values: &values, centred: true };
        Ok(self.solve(samples, &sources, out, run))
    }
}

/// Samples of the gradient: horizontal, then vertical.
struct Sources<'a> {
    measured: [&'a [bool]; 2],
    /// By channel and axis, a value for each pixel; only measured ones count.
    values: &'a (dyn Fn(usize, usize) -> Vec<f32> + Sync),
    /// Whether they are derivatives at pixel centres rather than differences to the next pixel.
    centred: bool,
}

impl Planned {
    /// Which pixels are measured together with their neighbour `rows` down and `columns` to the right.
    fn pairs(&self, rows: usize, columns: usize) -> Vec<bool> {
        let Size { height, width } = self.mask.size();
        let inside = |y: usize, x: usize| y + rows < height && x + columns < width;
        let pair = |y: usize, x: usize| {
            inside(y, x) && self.mask.is_measured(y, x) && self.mask.is_measured(y + rows, x + columns)
        };
        (0..height).flat_map(|y| (0..width).map(move |x| pair(y, x))).collect()
    }

    fn solve(&self, samples: &Planes, sources: &Sources<'_>, out: &mut Planes, run: &Run<'_>) -> Outcome {
        if self.mask.is_full() && !self.settings.restore {
            out.as_mut_slice().clone_from_slice(samples.as_slice());
            return Outcome::direct();
        }
        let mut outcome: Option<Outcome> = None;
        let planes = samples.as_slice().iter().zip(out.as_mut_slice());
        let mut planes: Vec<(usize, (&Plane, &mut Plane))> = planes.enumerate().collect();
        for group in planes.chunks_mut(SIDE_BY_SIDE) {
            let channels = group.par_iter_mut();
            let outcomes =
                channels.map(|(channel, (samples, out))| self.channel(*channel, samples, sources, out, run));
            outcome = outcomes.into_iter().chain(outcome).reduce(Outcome::worst);
        }
        outcome.unwrap_or(Outcome::direct())
    }

    fn channel(
        &self,
        channel: usize,
        samples: &Plane,
        sources: &Sources<'_>,
        out: &mut Plane,
        run: &Run<'_>,
    ) -> Outcome {
        let size = self.mask.size();
        let (mut horizontal, first) = self.component(channel, 0, sources, run);
        let (mut vertical, second) = self.component(channel, 1, sources, run);
        if sources.centred {
            integrate::differences(size, &mut horizontal, &mut vertical);
        }
        let field = integrate::Field { size, horizontal, vertical };
        let image = field.integrate(samples.pixels(), self.mask.as_slice(), self.settings.anchor, run);
        let pixels =
            out.pixels_mut().iter_mut().zip(image).zip(samples.pixels().iter().zip(self.mask.as_slice()));
        for ((out, value), (sample, measured)) in pixels {
            *out = if *measured && !self.settings.restore { *sample } else { value as f32 };
        }
        let sum = |a: Option<f64>, b: Option<f64>| a.zip(b).map(|(a, b)| a + b).or(a).or(b);
        Outcome { objective: sum(first.objective, second.objective), ..first.worst(second) }
    }

    /// One component of the gradient.
    fn component(
        &self,
        channel: usize,
        axis: usize,
        sources: &Sources<'_>,
        run: &Run<'_>,
    ) -> (Vec<f32>, Outcome) {
        let values = (sources.values)(channel, axis);
        let scale = values.iter().fold(0.0_f32, |largest, value| largest.max(value.abs()));
        let mut x = vec![0.0; values.len()];
        if scale == 0.0 {
            return (x, Outcome::direct());
        }
        let samples =
            Samples { values: &values, measured: sources.measured[axis], radius: self.settings.epsilon };
        let ending = self.settings.rule().solve(&self.operator, samples, f64::from(scale), &mut x, run);
        (x, ending.into())
    }
}

/// The unitary Fourier transform as a sparsity: entries are moduli over the whole spectrum.
#[derive(Debug)]
pub(super) struct Operator {
    pub fourier: Fourier,
    pub size: Size,
}

impl Sparsity for Operator {
    type Entry = Complex<f32>;
    type Work = Spectrum;

    fn work(&self) -> Spectrum {
        self.fourier.spectrum()
    }

    fn analyse(&self, x: &[f32], work: &mut Spectrum) {
        self.fourier.forward(x, work);
    }

    fn adjoint(&self, work: &mut Spectrum, x: &mut [f32]) {
        self.fourier.inverse(work, x);
    }

    fn entries<'a>(&self, work: &'a mut Spectrum) -> &'a mut [Complex<f32>] {
        &mut work.values
    }

    fn row(&self) -> usize {
        self.size.height
    }

    fn weight(&self, row: usize) -> f64 {
        self.fourier.multiplicity(row)
    }

    fn bound(&self) -> f64 {
        1.0
    }
}

#[cfg(test)]
pub(super) mod testing {
    use super::{Fourier, Operator, Size};

    /// The sparsity of one image size.
    pub fn operator(size: Size) -> Operator {
        Operator { fourier: Fourier::new(size), size }
    }
}
