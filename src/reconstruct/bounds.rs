//! Bounds that filled values keep because every measured value keeps them.

use crate::channels;

/// Which bounds are asked of a channel.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Bounds {
    /// None: positions, normals.
    Free,
    /// Nowhere negative if measured so: light.
    Positive,
    /// Within 0 and 1, each if measured so: alpha and mattes.
    Unit,
}

/// The bounds of a channel that is filled, by its name.
pub fn bounds_of(name: &str) -> Bounds {
    if channels::is_light(name) {
        Bounds::Positive
    } else if channels::is_alpha(name) || channels::is_matte(name) {
        Bounds::Unit
    } else {
        Bounds::Free
    }
}
