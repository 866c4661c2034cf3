//! Why a volume cannot be rendered: one line each, with the way out.

use std::path::PathBuf;

/// What can go wrong before a ray is cast.
#[derive(Debug, thiserror::Error)]
pub enum Error {
    /// The system refused a file.
    #[error("{path}: cannot {action}: {source}", path = path.display())]
    Io {
        /// The file.
        path: PathBuf,
        /// What was tried.
        action: &'static str,
        /// Why not.
        source: std::io::Error,
    },
    /// A volume file is damaged or of a kind that is not read.
    #[error("{path}: {why}", path = path.display())]
    File {
        /// The file.
        path: PathBuf,
        /// What is wrong, and the way out where there is one.
        why: String,
    },
    /// Values and sizes that make no volume.
    #[error("the volume: {0}")]
    Volume(String),
    /// A scene that contradicts itself.
    #[error("the scene: {0}")]
    Scene(String),
    /// Values set over a scene, which is good without them.
    #[error("what is set over the scene: {0}")]
    Set(String),
}
