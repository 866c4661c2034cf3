//! What can go wrong while masks are made, united or measured.

/// One line for people; the caller names the file.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum MakeError {
    /// The generators or the filter refuse.
    #[error(transparent)]
    Filters(#[from] lacuna_filters::Error),
    /// No mask was found.
    #[error(transparent)]
    Mask(#[from] super::Error),
    /// A file cannot be read or written.
    #[error(transparent)]
    Frame(#[from] lacuna_exr::Error),
    /// Anything else.
    #[error("{0}")]
    Other(String),
}
