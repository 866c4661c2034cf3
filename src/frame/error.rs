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
    #[error("not an OpenEXR file; check the path")]
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
    #[error("the frame needs {} MiB of memory, the limit is {} MiB; allow more with --memory", needed.div_ceil(1 << 20), limit >> 20)]
    TooLarge {
        /// Bytes that decoding needs.
        needed: u64,
        /// Bytes that are allowed.
        limit: u64,
    },
    /// The output exists and must not be replaced.
    #[error("exists already; remove it or drop --no-clobber")]
    Exists,
    /// The frame in memory is not one that an EXR file can hold.
    #[error("cannot be written: {0}")]
    Unwritable(String),
}

impl Error {
    pub(super) fn io(action: &'static str) -> impl FnOnce(io::Error) -> Self {
        move |source| Self::Io { action, source }
    }

    pub(super) fn damaged(message: impl Into<String>) -> Self {
        Self::Damaged(message.into())
    }
}
