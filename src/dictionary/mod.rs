//! Dictionaries as files: trained on frames, described, drawn, and used to write frames in few numbers.
//!
//! ```text
//! frames ──> training (blocks) ──> lacuna_filters::dictionary::ksvd ──> file (.npz)
//! file ──> fill | picture | code (a frame as the atoms of its blocks, quantised and entropy-coded)
//! ```

pub mod code;
mod error;
pub mod file;
mod npy;
pub mod picture;
mod stream;
pub mod training;

pub use error::Error;
pub use file::{Stored, Trained};
