//! Linear: each missing pixel lies in a triangle of measured ones and takes the plane through their values.
//!
//! With the Delaunay triangulation of the measured pixels' centres, a pixel with the barycentric coordinates (a, b, c) in
//! its triangle gets `a f1 + b f2 + c f3`, kept within the three values against rounding. Outside the convex hull, and
//! where all measured pixels lie on one line, it copies the nearest measured pixel.
//!
//! Boundary: the hull, see above. Exact on ramps inside the hull. Continuous, with creases along the edges of triangles.
//! Cost: O(n log n) for n measured pixels while planning, one pass afterwards; a u32 a pixel and 48 bytes a measured pixel.
//! No settings, no iterations.
//! Fails: creases show on curved shading; slivers along the hull; the triangulation takes longer than smoothness splines.
//!
//! Sources: B. Delaunay, "Sur la sphere vide", 1934; the triangulation is that of the crate `delaunator`.

use std::sync::Arc;

use super::delaunay::{NONE, Triangulation};
use super::nearest::NearestMap;
use crate::descriptor::Kind;
use crate::descriptor::{Configured, Descriptor, Memory, Takes};
use crate::{Error, Filter, Mask, Outcome, Plan, Planes, Problem, Run, check};

/// No settings.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Settings;

/// What is to be known of it.
pub static DESCRIPTOR: Descriptor = Descriptor {
    name: "linear",
    help: "Planes on triangles of measured pixels",
    settings: &[],
    // The triangles of a frame that is nearly all measured.
    even: Memory { image: 66, channel: 1 },
    uneven: Memory { image: 118, channel: 1 },
    takes: Takes::NOTHING,
    restores: false,
    held_out: Some(Kind::Distance),
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
        Ok(Box::new(Planned { scattered: Scattered::new(&problem.mask)? }))
    }
}

struct Planned {
    scattered: Scattered,
}

impl Plan for Planned {
    fn reconstruct(&self, samples: &Planes, out: &mut Planes, _run: &Run<'_>) -> Result<Outcome, Error> {
        self.scattered.start(samples, out)?;
        let triangulation = &self.scattered.triangulation;
        for (samples, out) in samples.as_slice().iter().zip(out.as_mut_slice()) {
            let values = |triangle: u32| {
                let sites = triangulation.triangles[triangle as usize];
                sites.map(|site| samples.pixels()[triangulation.pixels[site as usize] as usize])
            };
            triangulation.fill(out.pixels_mut(), values, plane);
        }
        Ok(Outcome::direct())
    }
}

/// The plane through three values, within them.
fn plane(values: &[f32; 3], shares: [f64; 3]) -> f32 {
    let sum: f64 = values.iter().zip(shares).map(|(value, share)| f64::from(*value) * share).sum();
    let (low, high) = values.iter().fold((values[0], values[0]), |(a, b), &v| (a.min(v), b.max(v)));
    (sum as f32).clamp(low, high)
}

/// What the interpolations of scattered samples share: triangles, and the nearest pixel where there is none.
pub(super) struct Scattered {
    pub triangulation: Triangulation,
    mask: Arc<Mask>,
    nearest: NearestMap,
}

impl Scattered {
    pub fn new(mask: &Arc<Mask>) -> Result<Self, Error> {
        let nearest = NearestMap::new(mask)?;
        Ok(Self { triangulation: Triangulation::new(mask)?, mask: Arc::clone(mask), nearest })
    }

    /// Checks the planes and writes what needs no triangle: measured pixels, and those outside the hull.
    pub fn start(&self, samples: &Planes, out: &mut Planes) -> Result<(), Error> {
        check::group(&self.mask, samples, out)?;
        let outside = self.triangulation.at.iter().enumerate().filter(|(_, triangle)| **triangle == NONE);
        let outside: Vec<usize> = outside.map(|(at, _)| at).collect();
        for (samples, out) in samples.as_slice().iter().zip(out.as_mut_slice()) {
            for &at in &outside {
                out.pixels_mut()[at] = samples.pixels()[self.nearest.as_slice()[at] as usize];
            }
        }
        Ok(())
    }
}

#[cfg(test)]
#[path = "linear/tests.rs"]
mod tests;
