//! What the crates of lacuna stand on: sizes of images, and work on parts of buffers shared out among threads.

mod hash;
pub mod parallel;
mod size;

pub use hash::{hash, mix};
pub use size::Size;
