//! Sampling masks: which pixels a renderer should compute, and how well they lie.
//!
//! A [`Pattern`] with a seed is an [`Order`] of the pixels where it is progressive ([`random`], [`shuffle`],
//! [`blue_noise`]): the mask of density D is where the rank is less than D, so that each density contains the smaller
//! ones. [`poisson`] and [`grid`] are made for one density. [`temporal`] says how the frames of a sequence share an
//! order, [`refine`] which pixels to compute after a first pass, and [`adaptive`] does so round after round. [`measure`], [`spectrum`] and [`coherence`] judge masks.

pub mod adaptive;
pub mod blue_noise;
pub mod coherence;
mod components;
pub mod grid;
pub(crate) mod leave_out;
pub mod measure;
pub mod order;
pub mod paired;
pub mod poisson;
pub mod random;
pub mod refine;
pub mod shuffle;
pub mod spectrum;
pub mod temporal;

pub use order::{Field, Order, Pattern};
pub use temporal::{Band, Temporal, mask};

use crate::Error;

/// The density if it is one.
fn checked(density: f64) -> Result<f64, Error> {
    if (0.0..=1.0).contains(&density) {
        Ok(density)
    } else {
        Err(Error::setting("density", &density, "0 to 1"))
    }
}
