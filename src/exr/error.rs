//! What can go wrong with a frame's file: one line each, with the way out, without the path (the caller knows it).

use std::io;

/// Why a frame could not be read or written.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum Error {
    /// The operating system refused.
    #[error("cannot {action}: {source}")]
    Io {
        /// What was tried, as the end of "cannot ...".
        action: &'static str,
        /// What the system said.
        source: io::Error,
    },
    /// The file begins with other bytes than an EXR file does.
    #[error("not an OpenEXR file, or an empty one; check the path")]
    NotExr,
    /// The file ends too early.
    #[error("truncated: the file ends inside {place}; render or copy it again")]
    Truncated {
        /// What was being read.
        place: String,
    },
    /// Chunks of pixels are missing: the writer did not come to its end.
    #[error("unfinished: {place} has no pixels in the file; render it again")]
    Unfinished {
        /// Part and row or tile.
        place: String,
    },
    /// The content contradicts itself or the format.
    #[error("damaged: {0}; render or copy it again")]
    Damaged(String),
    /// A correct file of a kind that lacuna does not work on.
    #[error("{what} not supported; {remedy}")]
    Unsupported {
        /// The feature and "is" or "are".
        what: String,
        /// What to do about it.
        remedy: String,
    },
    /// Decoding would take more memory than allowed.
    #[error(
        "it needs {} of memory, the limit is {}; allow more with --memory",
        Amount::at_most(*needed),
        Amount::at_least(*limit)
    )]
    TooLarge {
        /// Bytes that decoding needs.
        needed: u64,
        /// Bytes that are allowed.
        limit: u64,
    },
    /// The output exists and must not be replaced.
    #[error("exists already; remove it or drop --no-clobber")]
    Exists,
    /// The output exists and nobody is meant to change it.
    #[error("exists and is read-only; make it writable or remove it")]
    ReadOnly,
    /// The frame in memory is not one that an EXR file can hold.
    #[error("cannot be written: {0}")]
    Unwritable(String),
}

/// An amount of memory for people, in the largest unit of which there is one, rounded so that what is above a bound never
/// looks as if it were within.
#[derive(Clone, Copy, Debug)]
pub struct Amount {
    bytes: u64,
    up: bool,
}

impl Amount {
    /// Rounded up.
    pub const fn at_most(bytes: u64) -> Self {
        Self { bytes, up: true }
    }

    /// Rounded down.
    pub const fn at_least(bytes: u64) -> Self {
        Self { bytes, up: false }
    }
}

impl std::fmt::Display for Amount {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        let units = [(20, "MiB"), (10, "KiB"), (0, "bytes")];
        let unit = units.into_iter().find(|(shift, _)| self.bytes >> shift > 0);
        let (shift, name) = unit.unwrap_or((0, "bytes"));
        let number = if self.up { self.bytes.div_ceil(1 << shift) } else { self.bytes >> shift };
        write!(f, "{number} {name}")
    }
}

/// Whether the system refused to give a file that is there: rights, the disk, the network.
pub fn is_refusal(error: &io::Error) -> bool {
    // What lacuna itself refuses has no number.
    error.raw_os_error().is_some() && error.kind() != io::ErrorKind::NotFound
}

impl Error {
    /// Whether the system refused to give a file that is there, which it may do another time.
    pub fn is_of_system(&self) -> bool {
        matches!(self, Self::Io { source, .. } if is_refusal(source))
    }

    pub(super) fn io(action: &'static str) -> impl FnOnce(io::Error) -> Self {
        move |source| Self::Io { action, source }
    }

    pub(super) fn damaged(message: impl Into<String>) -> Self {
        Self::Damaged(message.into())
    }
}

#[cfg(test)]
mod tests {
    use super::Amount;

    #[test]
    fn amounts_have_the_unit_that_they_need() {
        for (bytes, at_most, at_least) in [
            (0, "0 bytes", "0 bytes"),
            (1000, "1000 bytes", "1000 bytes"),
            (1 << 10, "1 KiB", "1 KiB"),
            ((1 << 20) - 1, "1024 KiB", "1023 KiB"),
            ((3 << 30) + 1, "3073 MiB", "3072 MiB"),
        ] {
            assert_eq!(Amount::at_most(bytes).to_string(), at_most);
            assert_eq!(Amount::at_least(bytes).to_string(), at_least);
        }
    }
}
