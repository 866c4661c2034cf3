//! Which files a job reads and writes: names, numbers, patterns, and the plan of inputs and outputs.
//!
//! ```text
//! inputs (pattern, range, glob, list) ─┐
//! destinations ────────────────────────┴─> plan: one item a frame, checked against what is the same file (identity)
//! ```

pub(crate) mod content;
pub(crate) mod destinations;
pub(crate) mod error;
pub(crate) mod globs;
pub(crate) mod identity;
pub(crate) mod inputs;
pub(crate) mod layers;
pub(crate) mod names;
pub(crate) mod neighbours;
pub mod patterns;
pub(crate) mod plan;
pub mod ranges;
pub(crate) mod reports;

pub use error::PlanError;
pub use inputs::{Selection, frame_numbers};
pub use layers::LayerSource;
pub use plan::Targets;
pub use reports::print;
