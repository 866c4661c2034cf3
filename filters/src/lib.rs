//! Reconstruction of images from sparse samples.
//!
//! A renderer measured some pixels of a frame; the filters here compute the rest. No file, clock, environment
//! or global state: planes in, planes out, the same bits for every thread count. The one exception is [`keep_freed_memory`], which
//! sets the allocator of the process; no filter calls it.
//!
//! ```text
//! Problem (mask, weights) ──> Filter::plan ──> Plan ──┐
//! Planes (samples of a group of channels) ────────────┴─> Plan::reconstruct ──> Planes + Outcome
//! ```
//!
//! [`domain`] and [`limiter`] stand before and after a plan and keep long ranges from ringing.
//! What depends on the mask alone is in the plan, which serves every channel and every frame of that mask.
//! The rooms of the filters, each importing only from those to its right:
//! `variational | sensing | dictionary | upscale -> baseline -> solver -> operator | prox -> kernel -> plane | mask`.
//! [`sampling`] makes masks, [`metric`] compares images.
//!
//! "The thesis", whose equations the filters cite, is X. Liu, "Compressive Volume Rendering", University of Calgary.

pub mod baseline;
mod check;
pub mod dictionary;
pub mod domain;
mod error;
mod filter;
mod kernel;
pub mod limiter;
mod mask;
mod method;
pub mod metric;
mod operator;
mod outcome;
mod plane;
mod prox;
mod run;
pub mod sampling;
pub mod sensing;
mod solver;
pub mod upscale;
pub mod variational;

pub use error::Error;
pub use filter::{Filter, Gradients, Plan, Problem};
pub use kernel::heap::keep_freed_memory;
pub use lacuna_core::Size;
pub use mask::Mask;
pub use method::Method;
pub use outcome::{Outcome, Stop};
pub use plane::{Plane, Planes};
pub use run::Run;
