//! What can go wrong in a filter.

use std::borrow::Cow;

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
        /// What was given, by its name.
        found: String,
    },
    /// The mask has no measured pixel, so nothing says what the image is.
    #[error("the mask has no measured pixel")]
    EmptyMask,
    /// No two neighbours were measured, so that no difference is known.
    #[error(
        "no two neighbours are measured in a row or in a column, so nothing is known of the gradient: measure pixels in pairs, \
         or give samples of the gradient"
    )]
    NoPairs,
    /// Measured pixels, but none with a finite value.
    #[error("no measured value of plane {plane} is finite")]
    NothingFinite {
        /// The plane's place in the group.
        plane: usize,
    },
    /// Weights that leave no sample.
    #[error("no measured pixel has a weight above 0")]
    NothingWeighs,
    /// A guide that is sparse like the samples.
    #[error(
        "guide '{name}' is zero, NaN or the same at the missing pixels, and only complete ones can guide: leave it out, or render it everywhere"
    )]
    SparseGuide {
        /// Its name.
        name: String,
    },
    /// A filter that uses a learned dictionary and has none.
    #[error("there is no dictionary to fill with")]
    NoDictionary,
    /// A name that no method has.
    #[error("there is no method '{name}', but {known}")]
    NoMethod {
        /// The name.
        name: String,
        /// The names that methods have.
        known: String,
    },
    /// A name that no setting of a method has.
    #[error("{method} has no setting '{name}'; it has {known}")]
    NoSetting {
        /// The method.
        method: &'static str,
        /// The name.
        name: String,
        /// The names that its settings have.
        known: String,
    },
    /// A setting is outside its range.
    #[error("{name} = {value} is out of range ({range})")]
    Setting {
        /// The setting's name.
        name: &'static str,
        /// The value given.
        value: String,
        /// The values allowed.
        range: Cow<'static, str>,
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

impl Error {
    /// What has this name is of another size than what it belongs to.
    pub(crate) fn size(expected: Size, name: &str, found: Size) -> Self {
        Self::SizeMismatch { expected, found: format!("{name} of {found}") }
    }

    /// A region that has not one flag for each pixel, if it is one.
    pub(crate) fn of_region(expected: Size, region: Option<&[bool]>) -> Result<(), Self> {
        match region {
            Some(flags) if flags.len() != expected.pixels() => {
                Err(Self::SizeMismatch { expected, found: format!("a region of {} flags", flags.len()) })
            }
            _ => Ok(()),
        }
    }

    /// A setting with this value is outside its range.
    pub(crate) fn setting(name: &'static str, value: &dyn std::fmt::Display, range: &'static str) -> Self {
        Self::Setting { name, value: value.to_string(), range: range.into() }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn each_is_one_line_that_says_what_and_where() {
        let size = Size::new(1080, 1920);
        let lines = [
            (
                Error::SizeMismatch { expected: size, found: "7 values".into() },
                "expected 1920x1080 pixels, found 7 values",
            ),
            (
                Error::size(size, "weights", Size::new(1080, 1919)),
                "expected 1920x1080 pixels, found weights of 1919x1080",
            ),
            (Error::EmptyMask, "the mask has no measured pixel"),
            (
                Error::Setting { name: "density", value: "2".into(), range: "0 to 1".into() },
                "density = 2 is out of range (0 to 1)",
            ),
            (Error::NotFinite { row: 3, column: 5 }, "a measured value is not finite (row 3, column 5)"),
            (Error::TooLarge { size }, "1920x1080 pixels are too many (the limit is 2^32 - 1)"),
        ];
        for (error, line) in lines {
            assert_eq!(error.to_string(), line);
        }
    }
}
