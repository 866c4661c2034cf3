//! Generators of sampling masks.

pub mod shuffle;
