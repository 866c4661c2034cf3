//! Reconstruction of images from sparse samples.
//!
//! A renderer measured some pixels of a frame; the filters here compute the rest. No file, clock, environment
//! or global state: planes in, planes out, the same bits for every thread count. The exceptions are [`keep_freed_memory`] and
//! [`share_heaps`], which set the allocator of the process; no filter calls them.
//!
//! The calls, [`fill()`] and [`upscale()`], do for a group of channels what the tool does:
//!
//! ```text
//! samples, mask, [fill::Options] ──> domain ──> Plan::reconstruct ──> back ──> limiter, bounds ──> Filled
//!                                                 └── Filter::plan, kept in [Plans] for groups and frames of the mask
//! ```
//!
//! Below them, for those who need a part: a [`Method`] (one of [`METHODS`], each with a [`descriptor`]), [`domain`] and [`limiter`],
//! [`Filter`] and [`Plan`]. [`sampling`] makes masks, [`metric`] compares images.
//! The rooms, each importing only from those to its right: `enlarge -> fill -> plans -> method -> noise | auto -> temporal -> estimate ->
//! network | sampling | upscale -> variational | sensing | dictionary -> baseline -> descriptor -> solver -> operator | prox -> kernel -> plane | mask`.
//!
//! "The thesis", whose equations the filters cite, is X. Liu, "Compressive Volume Rendering", University of Calgary.
//!
#![doc = include_str!("../README.md")]

mod arrays;
pub mod auto;
pub mod baseline;
mod bounds;
mod check;
pub mod choose;
pub mod complete;
mod decided;
pub mod descriptor;
pub mod dictionary;
pub mod domain;
pub mod enlarge;
mod error;
pub mod estimate;
pub mod excerpt;
pub mod fill;
mod filter;
mod kernel;
pub mod limiter;
mod mask;
mod method;
pub mod metric;
pub mod network;
pub mod noise;
mod operator;
mod outcome;
mod plane;
mod plans;
mod prox;
mod run;
pub mod sampling;
pub mod sensing;
mod solver;
pub mod temporal;
mod tiling;
pub mod upscale;
pub mod variational;
mod weights;

pub use bounds::Bounds;
pub use enlarge::upscale;
pub use error::Error;
pub use fill::{Filled, Options, fill};
pub use filter::{Filter, Gradients, Plan, Problem};
pub use kernel::heap::{keep_freed_memory, share_heaps};
pub use lacuna_core::Size;
pub use mask::{Doubt, Fit, Mask};
pub use method::{METHODS, Method};
pub use outcome::{Outcome, Stop};
pub use plane::{Plane, Planes};
pub use plans::Plans;
pub use run::Run;
