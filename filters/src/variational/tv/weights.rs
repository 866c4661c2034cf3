//! The ball that measured pixels may move in: its radius, and what the weights of the samples make of it.
//!
//! `sum w (x - y)^2 <= epsilon^2` with the least weight `v` of a measured pixel is `sum (x - y)^2 / ease <= radius^2` with
//! `ease = v / w`, in (0, 1], and `radius = epsilon / sqrt(v)`.

use std::sync::Arc;

use crate::variational::ss::check_weights;
use crate::{Error, Mask, Plane};

/// See the module.
pub struct Weights {
    /// One value a pixel, 1 at missing ones; empty where measured pixels do not move.
    pub ease: Vec<f32>,
    /// In the samples' unit.
    pub radius: f64,
}

impl Weights {
    /// Also returns the mask of the pixels that count: those of weight 0 are missing.
    pub fn new(mask: &Arc<Mask>, weights: Option<&Plane>, epsilon: f64) -> Result<(Arc<Mask>, Self), Error> {
        let Some(weights) = weights else {
            let ease = if epsilon > 0.0 { vec![1.0; mask.size().pixels()] } else { Vec::new() };
            return Ok((Arc::clone(mask), Self { ease, radius: epsilon }));
        };
        let weights = check_weights(weights, mask)?.pixels();
        let measured = mask.as_slice();
        let counts = |at: usize| measured[at] && weights[at] > 0.0;
        let least = (0..weights.len()).filter(|&at| counts(at)).map(|at| weights[at]);
        let least = f64::from(least.fold(f32::INFINITY, f32::min));
        let ease = |at: usize| if counts(at) { (least / f64::from(weights[at])) as f32 } else { 1.0 };
        let ease = (0..weights.len()).map(ease).collect();
        let counted = Mask::new(mask.size(), (0..weights.len()).map(counts).collect())?;
        Ok((Arc::new(counted), Self { ease, radius: epsilon / least.sqrt() }))
    }

    /// Weights over the least one, of the measured pixels in their order.
    pub fn measured<'a>(&'a self, mask: &'a Mask) -> impl Iterator<Item = f64> + 'a {
        let ease = |at: usize| self.ease.get(at).map_or(1.0, |&ease| f64::from(ease));
        let places = mask.as_slice().iter().enumerate().filter(|(_, measured)| **measured);
        places.map(move |(at, _)| 1.0 / ease(at))
    }
}
