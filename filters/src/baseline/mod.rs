//! Baselines: direct methods without an objective, fast and plain.

pub mod nearest;
pub mod push_pull;
