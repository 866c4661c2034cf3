//! Baselines: direct methods without an objective, fast and plain.

mod check;
pub mod nearest;
pub mod push_pull;
