//! What every reconstruction method is: a filter that plans on a mask, and a plan that runs on samples.

use std::any::Any;
use std::sync::{Arc, OnceLock};

use crate::{Error, Mask, Outcome, Plane, Planes, Run};

/// What is to be solved, as far as the samples' values do not matter.
#[derive(Clone, Debug)]
#[non_exhaustive]
pub struct Problem {
    /// Which pixels were measured.
    pub mask: Arc<Mask>,
    /// Per measured pixel, the inverse of its noise variance up to a factor; `None` weighs all alike.
    /// Used only where a filter smooths instead of interpolating.
    pub weights: Option<Arc<Plane>>,
}

impl Problem {
    /// Fill the missing pixels of an image on its own grid.
    pub fn fill(mask: Arc<Mask>) -> Self {
        Self { mask, weights: None }
    }
}

/// A reconstruction method with its settings.
pub trait Filter: Send + Sync {
    /// Computes what depends on the mask alone.
    ///
    /// # Errors
    /// [`Error::EmptyMask`] and [`Error::Setting`].
    fn plan(&self, problem: &Problem, run: &Run<'_>) -> Result<Box<dyn Plan>, Error>;

    /// The name of the method by whose image, with its defaults, it starts: [`Plan::reconstruct_from_start`] takes that where it is known.
    fn start(&self) -> Option<&'static str> {
        None
    }
}

/// The plan of what a method starts from, made when it is first asked for: an image to start from does without.
pub(crate) struct Start {
    filter: Box<dyn Filter>,
    mask: Arc<Mask>,
    plan: OnceLock<Box<dyn Plan>>,
}

impl Start {
    /// Fills the missing pixels of an image; the mask has samples.
    pub fn new(filter: impl Filter + 'static, mask: Arc<Mask>) -> Result<Self, Error> {
        mask.require_samples()?;
        Ok(Self { filter: Box::new(filter), mask, plan: OnceLock::new() })
    }

    /// The plan.
    pub fn plan(&self, run: &Run<'_>) -> Result<&dyn Plan, Error> {
        if let Some(plan) = self.plan.get() {
            return Ok(plan.as_ref());
        }
        let plan = self.filter.plan(&Problem::fill(Arc::clone(&self.mask)), run)?;
        Ok(self.plan.get_or_init(|| plan).as_ref())
    }
}

/// A method that is ready for samples of its mask.
pub trait Plan: Send + Sync {
    /// Fills `out` from `samples`.
    ///
    /// `samples` holds finite values at measured pixels; what it holds elsewhere is not read. In `out` every pixel
    /// is finite, and measured pixels keep their bits unless the settings ask for smoothing.
    ///
    /// # Errors
    /// [`Error::SizeMismatch`] and [`Error::NotFinite`].
    fn reconstruct(&self, samples: &Planes, out: &mut Planes, run: &Run<'_>) -> Result<Outcome, Error>;

    /// The same where a rough result will do: it may be off by about `error` times the range of the samples. Methods that
    /// have no faster way give their usual result.
    ///
    /// # Errors
    /// As [`Plan::reconstruct`].
    fn reconstruct_roughly(
        &self,
        samples: &Planes,
        _error: f64,
        out: &mut Planes,
        run: &Run<'_>,
    ) -> Result<Outcome, Error> {
        self.reconstruct(samples, out, run)
    }

    /// The same where `out` holds what the method that it starts from ([`Filter::start`]) makes of the samples, roughly if an error is given.
    /// The result has the bits that it has without.
    ///
    /// # Errors
    /// As [`Plan::reconstruct`].
    fn reconstruct_from_start(
        &self,
        samples: &Planes,
        error: Option<f64>,
        out: &mut Planes,
        run: &Run<'_>,
    ) -> Result<Outcome, Error> {
        match error {
            Some(error) => self.reconstruct_roughly(samples, error, out, run),
            None => self.reconstruct(samples, out, run),
        }
    }

    /// The same, where samples of the image's gradient were measured, too. Methods that have no use for them fill from
    /// the pixels alone.
    ///
    /// # Errors
    /// As [`Plan::reconstruct`].
    fn reconstruct_gradients(
        &self,
        samples: &Planes,
        _gradients: &Gradients<'_>,
        out: &mut Planes,
        run: &Run<'_>,
    ) -> Result<Outcome, Error> {
        self.reconstruct(samples, out, run)
    }

    /// Itself, where its type offers more than this.
    fn as_any(&self) -> Option<&dyn Any> {
        None
    }
}

/// Samples of the derivatives of a group of channels per pixel, at pixel centres.
#[derive(Clone, Copy, Debug)]
pub struct Gradients<'a> {
    /// Along rows (x, to the right), and along columns (y, down): as many planes each as the group has channels.
    pub planes: [&'a Planes; 2],
    /// Where they were measured.
    pub mask: &'a Mask,
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::Size;

    #[test]
    fn a_problem_without_weights_weighs_all_alike() {
        let mask = Arc::new(Mask::from_fn(Size::new(2, 2), |y, x| y == x));
        let problem = Problem::fill(Arc::clone(&mask));
        assert_eq!(problem.mask, mask);
        assert!(problem.weights.is_none());
    }
}
