//! Edge-enhancing splines, corrected by a small convolutional network.
//!
//! Given the image `u` that [`edge`] makes of samples, each channel becomes, at missing pixels,
//!
//! ```text
//! x = u + a f(u, mask),      kept within the least and the largest u of 3 x 3 pixels;      a = the lesser of their range and s
//! ```
//!
//! with `f` a convolutional network and `s` the strength of the finest detail around (`kernel/detail.rs`). Its inputs are the image's detail,
//! its range in 3 x 3 pixels and the strength of its finest detail, all over the strength of detail around, and which pixels were measured. So a
//! correction does not depend on scale and offset of the values, reaches 20 pixels, and is none where the image is a plane.
//!
//! The network: pixels in blocks of 2 x 2 (17 inputs a block, the strength of the finest detail as a mean), then three layers of 24 planes, 3 x 3 and
//! rectified, the second and third with their input added, and a fourth to the 4 pixels of a block. 14 980 weights, one network for all channels,
//! densities and patterns. Planes continue beyond the border with their outermost blocks.
//!
//! Training (`scripts/train`): 1000 procedural images and renders of procedural volumes, 256 x 256 pixels, some with lamps, noise or nothing but smooth
//! shading, filled by `edge` at 4 to 84 %; the logarithm of the squared error, with losses counting more. Frames of long range were learned as they are
//! filled, by their inverse hyperbolic sine. The last layer is multiplied by 0.8, as chosen on procedural frames that training did not see, where
//! 3 of 448 fills lost more than 0.2 dB.
//!
//! References: K. Zhang, W. Zuo, Y. Chen, D. Meng, L. Zhang, "Beyond a Gaussian denoiser: residual learning of deep CNN for image denoising", IEEE
//! Transactions on Image Processing 26, 2017 (learning the residual); W. Shi et al., "Real-time single image and video super-resolution using an efficient sub-pixel
//! convolutional neural network", CVPR 2016 (blocks of pixels as planes).
//!
//! No settings. The same bits for any number of threads.
//!
//! Cost: `edge`, then 1863 multiplications a pixel and channel where the image is not flat (`kernel/convolution.rs`). Memory: 3 MB a thread beside `edge`, and a plane a channel.
//!
//! Fails: as `edge` where samples are too few to show an edge's course. Where `edge` is nearly exact already, as on waves and stripes of a few pixels with half of the pixels
//! measured, it takes several decibels away, from antialiased text and mattes up to 0.8: `auto` then chooses `edge`. It is not invariant to shifts by one pixel: the
//! corrections of the two differ by half of their size.

mod refine;

use std::sync::Arc;

use crate::descriptor::Kind;
use crate::descriptor::{Configured, Descriptor, Takes};
use crate::filter::Start;
use crate::variational::edge;
use crate::{Error, Filter, Mask, Outcome, Plan, Planes, Problem, Run, check};

/// No settings.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Settings;

/// What is to be known of it.
pub static DESCRIPTOR: Descriptor = Descriptor {
    name: "cnn",
    help: "Edge-enhancing splines, corrected by a small convolutional network",
    settings: &[],
    even: edge::DESCRIPTOR.even,
    uneven: edge::DESCRIPTOR.uneven,
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

/// What depends on the mask alone.
struct Planned {
    mask: Arc<Mask>,
    edge: Start,
}

impl Filter for Settings {
    fn plan(&self, problem: &Problem, _: &Run<'_>) -> Result<Box<dyn Plan>, Error> {
        let mask = Arc::clone(&problem.mask);
        let edge = Start::new(edge::Settings::default(), Arc::clone(&mask))?;
        Ok(Box::new(Planned { mask, edge }))
    }

    fn start(&self) -> Option<&'static str> {
        Some(edge::DESCRIPTOR.name)
    }
}

impl Plan for Planned {
    fn reconstruct(&self, samples: &Planes, out: &mut Planes, run: &Run<'_>) -> Result<Outcome, Error> {
        let outcome = self.edge.plan(run)?.reconstruct(samples, out, run)?;
        Ok(self.refine(outcome, samples, out, run))
    }

    fn reconstruct_roughly(
        &self,
        samples: &Planes,
        error: f64,
        out: &mut Planes,
        run: &Run<'_>,
    ) -> Result<Outcome, Error> {
        let outcome = self.edge.plan(run)?.reconstruct_roughly(samples, error, out, run)?;
        Ok(self.refine(outcome, samples, out, run))
    }

    fn reconstruct_from_start(
        &self,
        samples: &Planes,
        _error: Option<f64>,
        out: &mut Planes,
        run: &Run<'_>,
    ) -> Result<Outcome, Error> {
        check::group(&self.mask, samples, out)?;
        Ok(self.refine(Outcome::direct(), samples, out, run))
    }
}

impl Planned {
    /// Corrects what edge-enhancing splines made of the samples.
    fn refine(&self, outcome: Outcome, samples: &Planes, out: &mut Planes, run: &Run<'_>) -> Outcome {
        if self.mask.is_full() || run.interrupted().is_some() {
            return outcome;
        }
        let spreads = edge::spreads(&self.mask, samples);
        let units: Vec<f32> = spreads.into_iter().map(|spread| edge::unit(spread) as f32).collect();
        refine::refine(&self.mask, &units, out, run);
        match run.interrupted() {
            Some(stop) => Outcome { stop: stop.max(outcome.stop), ..outcome },
            None => outcome,
        }
    }
}

#[cfg(test)]
mod tests;
