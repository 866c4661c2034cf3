//! Baselines: direct methods without an objective, fast and plain; and the rules that copy instead of computing.

pub mod cubic;
mod delaunay;
pub mod depth;
pub mod linear;
pub mod nearest;
pub mod push_pull;
#[cfg(test)]
pub(crate) mod testing;
