//! Smoothness splines: the smoothest image that passes through (or near) the samples.
use std::sync::Arc;

use crate::kernel::Isa;
use crate::operator::energy::Form;
use crate::{Error, Filter, Mask, Outcome, Plan, Plane, Planes, Problem, Run};

mod polynomials;
mod region;
mod settings;
mod start;
#[cfg(test)]
mod tests;

pub use crate::operator::profile::Kernel;
pub use settings::{Order, Settings};

use polynomials::Unseen;
use region::Region;

/// Largest correction that a solver may still see, over the measured range. The error is of the same size.
const TOLERANCE: f64 = 2e-6;

struct Planned {
    settings: Settings,
    mask: Arc<Mask>,
    regions: Vec<Region>,
    /// Polynomials that neither the samples nor the energy see.
    unseen: Option<Unseen>,
}

impl Filter for Settings {
    fn plan(&self, problem: &Problem, _run: &Run<'_>) -> Result<Box<dyn Plan>, Error> {
        self.check()?;
        let mask = Arc::clone(&problem.mask);
        if mask.is_empty() {
            return Err(Error::EmptyMask);
        }
        let weights = match (&problem.weights, self.lambda > 0.0) {
            (Some(weights), true) => Some(check_weights(weights, &mask)?),
            _ => None,
        };
        let form = Form::new(self.kernel, self.order.number(), self.tension);
        let regions = if mask.is_full() && self.lambda == 0.0 {
            Vec::new()
        } else {
            vec![Region::whole(Isa::best(), &form, &mask, self.lambda, weights)]
        };
        let counts = |i, j| weights.is_none_or(|w: &Plane| w.at(i, j) > 0.0);
        let unseen = (self.tension == 0.0)
            .then(|| Unseen::new(self.order.number(), &mask, counts))
            .filter(|unseen| !unseen.is_empty());
        Ok(Box::new(Planned { settings: *self, mask, regions, unseen }))
    }
}

/// Weights must be finite, not negative, and positive at some measured pixel.
fn check_weights<'a>(weights: &'a Plane, mask: &Mask) -> Result<&'a Plane, Error> {
    if weights.size() != mask.size() {
        return Err(Error::SizeMismatch { expected: mask.size(), found: weights.size().to_string() });
    }
    let measured = || weights.pixels().iter().zip(mask.as_slice()).filter(|(_, m)| **m).map(|(w, _)| *w);
    if let Some(bad) = measured().find(|w| !w.is_finite() || *w < 0.0) {
        return Err(Error::Setting {
            name: "weight",
            value: bad.to_string(),
            range: "finite and at least 0",
        });
    }
    if measured().all(|w| w == 0.0) {
        return Err(Error::EmptyMask);
    }
    Ok(weights)
}

impl Plan for Planned {
    fn reconstruct(
        &self,
        samples: &Planes,
        _guides: Option<&Planes>,
        out: &mut Planes,
        run: &Run<'_>,
    ) -> Result<Outcome, Error> {
        self.check(samples, out)?;
        let mut outcome = Outcome::direct();
        for (sample, out) in samples.as_slice().iter().zip(out.as_mut_slice()) {
            outcome = outcome.worst(self.channel(sample, out, run));
        }
        Ok(outcome)
    }
}

impl Planned {
    fn check(&self, samples: &Planes, out: &Planes) -> Result<(), Error> {
        let size = self.mask.size();
        for planes in [samples, out] {
            if planes.size() != size {
                return Err(Error::SizeMismatch { expected: size, found: planes.size().to_string() });
            }
        }
        if out.len() != samples.len() {
            let found = format!("{} planes for {}", out.len(), samples.len());
            return Err(Error::SizeMismatch { expected: size, found });
        }
        for plane in samples.as_slice() {
            let bad = plane.pixels().iter().zip(self.mask.as_slice()).position(|(x, m)| *m && !x.is_finite());
            if let Some(bad) = bad {
                return Err(Error::NotFinite { row: bad / size.width, column: bad % size.width });
            }
        }
        Ok(())
    }

    fn channel(&self, samples: &Plane, out: &mut Plane, run: &Run<'_>) -> Outcome {
        let measured =
            || samples.pixels().iter().zip(self.mask.as_slice()).filter(|(_, m)| **m).map(|(x, _)| *x);
        let (low, high) =
            measured().fold((f32::INFINITY, f32::NEG_INFINITY), |(a, b), x| (a.min(x), b.max(x)));
        start::fill(samples, &self.mask, out);
        let range = f64::from(high) - f64::from(low);
        if range <= 0.0 {
            return Outcome::direct();
        }
        let mut outcome = Outcome::direct();
        for region in &self.regions {
            outcome = outcome.worst(region.solve(samples, out, TOLERANCE * range, run));
        }
        if let Some(unseen) = &self.unseen {
            let smooths = self.settings.lambda > 0.0;
            unseen.settle(out, |i, j| smooths || !self.mask.is_measured(i, j));
        }
        outcome
    }
}
