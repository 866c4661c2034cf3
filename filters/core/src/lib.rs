//! What the crates of lacuna stand on: sizes of images, and work on parts of buffers shared out among threads.

pub mod parallel;
mod size;

pub use size::Size;
