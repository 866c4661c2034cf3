//! lacuna fills the pixels that a renderer skipped: sparse EXR frames in, complete EXR frames out.
//!
//! The way a frame goes, which is also the order of the modules:
//!
//! ```text
//! lacuna_exr::read ──> mask ──> channels ──> reconstruct (lacuna_filters) ──> lacuna_exr::write
//!                      which    one rule     planes in, planes out
//!                      pixels   a channel
//! └──────────────── commands and run repeat it per frame ──────────────────────────────┘
//! ```
//!
//! [`report`] compares frames with their references, [`study`] filters with each other, [`dictionary`] learns from frames,
//! [`submit`] gives a sequence to a farm.
//!
//! [`cli`] turns flags into a checked job and does no work; the algorithms are in the crate `lacuna_filters`.

pub mod channels;
pub mod cli;
pub mod commands;
pub mod dictionary;
pub mod files;
pub mod guides;
pub mod info;
pub mod mask;
mod raster;
pub mod reconstruct;
pub mod report;
pub mod run;
pub mod sparsify;
pub mod study;
pub mod submit;
pub mod temporal;
#[cfg(test)]
mod testing;
pub mod verify;
