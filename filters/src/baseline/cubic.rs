//! Cubic: a smooth surface through the measured pixels, of cubic pieces on their triangles (Clough and Tocher).
//!
//! On the Delaunay triangulation of the measured pixels' centres, the gradients `g` of the surface at the sites minimise
//! `E(g) = sum over edges (i, j) of 4 / L^3 (p^2 + p q + q^2 - 3 d (p + q) + 3 d^2)`, where `e = x_j - x_i`, `L = |e|`,
//! `p = g_i e`, `q = g_j e`, `d = f_j - f_i`: the integral of the squared second derivative along all edges, each a cubic.
//! Each triangle is split at its centroid into three cubic patches in Bezier form; values and gradients at the corners give all coefficients but
//! one for each edge, which follows from the demand that the derivative across the edge, in the direction from centroid to
//! centroid, be linear along it. Neighbours make the same demand of the same line, so that the surface has no crease.
//! At the hull the direction is that of the edge's middle. Outside the convex hull, and where all measured pixels lie on one
//! line, a pixel copies the nearest measured one.
//!
//! Algorithm: Gauss-Seidel over the sites in row-major order, 2x2 solves, until the largest change of a gradient is below
//! 1e-5 of the range of the samples (a pixel's width is the unit of length), or 400 sweeps. All in f64.
//! Exact on ramps inside the hull.
//! Cost: the triangulation, about 20 sweeps over 6 edges a site, then about 100 operations a missing pixel; 160 bytes a
//! measured pixel and a u32 a pixel. Planes of a group run in parallel. No settings.
//! Fails: overshoots at edges as every cubic does (`fill` limits it); slow at high densities, where the sites are many.
//!
//! Sources: R. Clough, J. Tocher, "Finite Element Stiffness Matrices for Analysis of Plate Bending", 1965; P. Alfeld, "A
//! Trivariate Clough-Tocher Scheme for Tetrahedral Data", Computer Aided Geometric Design 1, 1984 (section 2, the planar
//! case); G. Farin, "Triangular Bernstein-Bezier Patches", Computer Aided Geometric Design 3, 1986; G. Nielson, "A Method for
//! Interpolating Scattered Data Based Upon a Minimum Norm Network", Mathematics of Computation 40, 1983 (the gradients).

mod gradients;
mod patch;

use lacuna_core::parallel::prelude::*;

use self::gradients::Network;
use self::patch::{Patch, across};
use super::delaunay::Barycentric;
use super::linear::Scattered;
use crate::descriptor::Kind;
use crate::descriptor::{Configured, Descriptor, Memory, Takes};
use crate::{Error, Filter, Outcome, Plan, Planes, Problem, Run, Stop};

/// No settings.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Settings;

/// What is to be known of it.
pub static DESCRIPTOR: Descriptor = Descriptor {
    name: "cubic",
    help: "Cubic pieces on triangles of measured pixels, without creases",
    settings: &[],
    // Those triangles, gradients and edges.
    even: Memory { image: 110, channel: 3 },
    uneven: Memory { image: 120, channel: 3 },
    takes: Takes::NOTHING,
    restores: false,
    held_out: Some(Kind::Spline),
    new: || Box::new(Settings),
};

impl Configured for Settings {
    fn descriptor(&self) -> &'static Descriptor {
        &DESCRIPTOR
    }

    fn boxed(&self) -> Box<dyn Configured> {
        Box::new(*self)
    }
}

impl Filter for Settings {
    fn plan(&self, problem: &Problem, _run: &Run<'_>) -> Result<Box<dyn Plan>, Error> {
        let scattered = Scattered::new(&problem.mask)?;
        let network = Network::new(&scattered.triangulation);
        Ok(Box::new(Planned { scattered, network }))
    }
}

struct Planned {
    scattered: Scattered,
    network: Network,
}

impl Plan for Planned {
    fn reconstruct(&self, samples: &Planes, out: &mut Planes, run: &Run<'_>) -> Result<Outcome, Error> {
        self.scattered.start(samples, out)?;
        let planes = samples.as_slice().par_iter().zip(out.as_mut_slice());
        let outcomes: Vec<Outcome> = planes.map(|(samples, out)| {
            let triangulation = &self.scattered.triangulation;
            let value = |&pixel: &u32| f64::from(samples.pixels()[pixel as usize]);
            let values: Vec<f64> = triangulation.pixels.iter().map(value).collect();
            let (gradients, outcome) = self.network.gradients(&values, run);
            let patch = |triangle: u32| self.patch(triangle, &values, &gradients);
            triangulation.fill(out.pixels_mut(), patch, |patch, shares| patch.at(shares) as f32);
            outcome
        });
        Ok(outcomes.into_iter().reduce(Outcome::worst).unwrap_or(Outcome::direct()))
    }
}

impl Planned {
    fn patch(&self, triangle: u32, values: &[f64], gradients: &[[f64; 2]]) -> Patch {
        let triangulation = &self.scattered.triangulation;
        let corners = triangulation.corners(triangle);
        let within = Barycentric::of(corners);
        let sites = triangulation.triangles[triangle as usize];
        // Of the edge opposite to corner k, thus from corner k + 1 to corner k + 2.
        let directions = [0, 1, 2].map(|k| {
            let beyond = triangulation.neighbours[triangle as usize][(k + 1) % 3];
            let other = (beyond != super::delaunay::NONE).then(|| {
                let corners = triangulation.corners(beyond);
                within.at([0, 1].map(|axis| corners.iter().map(|corner| corner[axis]).sum::<f64>() / 3.0))
            });
            across(k, other)
        });
        Patch::new(
            corners,
            sites.map(|site| values[site as usize]),
            sites.map(|site| gradients[site as usize]),
            directions,
        )
    }
}

/// How many sweeps there are at most.
const MOST_SWEEPS: usize = 400;

/// The outcome of so many sweeps.
fn outcome(stop: Stop, sweeps: usize) -> Outcome {
    Outcome { stop, iterations: sweeps, ..Outcome::direct() }
}

#[cfg(test)]
#[path = "cubic/tests.rs"]
mod tests;
