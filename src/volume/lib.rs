//! The ray caster: volumes in, frames out, only the pixels asked for.
//!
//! ```text
//! read (one file a format) ──> grid ──> blocks ─┐
//! scene ──> transfer, camera, shade ────────────┴─> walk + kernel ──> march ──> picture
//! ```

// A ray's march is one function to the compiler, or its registers go to memory at every sample.
#![allow(clippy::inline_always)]
// Tests ask for exact values where the arithmetic is exact.
#![cfg_attr(test, allow(clippy::float_cmp))]
// Formulas index several vectors by one axis.
#![allow(clippy::needless_range_loop)]

mod automatic;
mod blocks;
mod camera;
mod check;
mod coarse;
mod colour_space;
mod dense;
mod error;
mod grid;
mod integral;
mod kernel;
mod lanes;
mod limits;
mod march;
mod paraview;
mod picture;
mod prefilter;
mod procedural;
pub mod read;
#[cfg(test)]
mod reference;
mod reshape;
mod scene;
mod shade;
mod stage;
mod surface;
#[cfg(test)]
mod tests;
mod tiles;
mod transfer;
mod values;
mod vector;
mod walk;
mod weights;

pub use camera::{Camera, Projection, Ray};
pub use coarse::shot as dense_shot;
pub use error::Error;
pub use grid::Grid;
pub use limits::{Limits, is_there};
pub use picture::{Interpolation, Look, Picture, Renderer, Shot, render, render_onto};
pub use procedural::PREFIX as PROCEDURAL;
pub use scene::{InterpolationName, ModeName, Override, Scene};
pub use shade::Shader;
pub use stage::{Stage, files, prepare};
pub use tiles::tiles;
pub use transfer::{Curve, Joining, Lookup, Transfer};
pub use values::Values;
pub use vector::{Affine, Vector};
