//! What can go wrong in a filter.

use crate::Size;

/// A problem that a filter cannot be run on. Stopping early is not one: see [`crate::Outcome`].
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum Error {
    /// Two images that belong together differ in size.
    #[error("expected {expected} pixels, found {found}")]
    SizeMismatch {
        /// What the other image has.
        expected: Size,
        /// What was given.
        found: String,
    },
    /// The mask has no measured pixel, so nothing says what the image is.
    #[error("the mask has no measured pixel")]
    EmptyMask,
    /// A setting is outside its range.
    #[error("{name} = {value} is out of range ({range})")]
    Setting {
        /// The setting's name.
        name: &'static str,
        /// The value given.
        value: String,
        /// The values allowed.
        range: &'static str,
    },
    /// A measured value is NaN or infinite; callers take such pixels out of the mask.
    #[error("a measured value is not finite (row {row}, column {column})")]
    NotFinite {
        /// Row of the first such pixel.
        row: usize,
        /// Column of the first such pixel.
        column: usize,
    },
    /// The image has more pixels than an index can count.
    #[error("{size} pixels are too many (the limit is 2^32 - 1)")]
    TooLarge {
        /// What was given.
        size: Size,
    },
}
