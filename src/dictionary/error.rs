//! What can go wrong with a dictionary or an encoded frame: one line each, with the way out, without the path.

/// Why a dictionary or an encoded frame cannot be had.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum Error {
    /// The operating system refused.
    #[error("cannot {action}: {source}")]
    Io {
        /// What was tried, as the end of "cannot ...".
        action: &'static str,
        /// What the system said.
        source: std::io::Error,
    },
    /// It is something else.
    #[error("not {0}; check the path")]
    Other(&'static str),
    /// The content contradicts itself or the format.
    #[error("damaged: {0}; make or copy it again")]
    Damaged(String),
    /// It would take more memory than any that lacuna writes.
    #[error("{0} is larger than any that lacuna makes; make it again")]
    TooLarge(String),
    /// It would take more memory than is granted.
    #[error("reading it takes {0}; allow more with --memory")]
    Memory(lacuna_exr::Amount),
    /// Encoded with another dictionary.
    #[error(
        "encoded with dictionary {wanted}, but --dictionary is {given}; give the one it was encoded with"
    )]
    OtherDictionary {
        /// The name of the one that is needed.
        wanted: String,
        /// The name of the one that was given.
        given: String,
    },
    /// The frame has not what a dictionary needs.
    #[error("{0}")]
    Frame(String),
}

impl Error {
    /// What an operation of the system ended with.
    pub fn io(action: &'static str) -> impl FnOnce(std::io::Error) -> Self {
        move |source| Self::Io { action, source }
    }
}
