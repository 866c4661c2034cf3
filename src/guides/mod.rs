//! Guides: complete channels that steer how colour is filled. Which channels are taken, and how filters get them.
//!
//! `auto` takes, from the frame (every part with the view and data window of the part that is filled) or from a second
//! frame: what `lacuna/dense` lists, and normals, positions, albedo, depths, alpha and identifiers, if every pixel holds them
//! (`complete`). A channel that is taken is kept as it is. One that has the name of a channel to be filled may hold its very values (`twins`).

mod asked;
mod collect;
mod complete;
mod filled;
mod find;
#[cfg(test)]
mod tests;
mod twins;

use std::path::Path;

pub use asked::{Asked, AskedError};
pub use collect::collect;
pub use filled::{COPIED, Copied, KEPT, Place, made, read as copied, write as write_copied, write_kept};
pub use find::{Found, Guide, Kind, Second, find, keep_complete, of_larger, of_other_pixels};
pub use twins::{Twin, twins};

/// The attribute that lists the guides of a filled part.
pub const ATTRIBUTE: &str = "lacuna/guides";

/// Why guides cannot be used.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
pub enum Error {
    /// A name that no channel has.
    #[error(
        "--guides {asked}: no channel of that name over the pixels that are filled; there are {channels}"
    )]
    NoChannel {
        /// What was asked for.
        asked: String,
        /// What there is.
        channels: String,
    },
    /// A channel that holds nothing where colour is missing.
    #[error(
        "--guides: channel {channel} holds nothing at the missing pixels, and only complete channels can guide: leave it out, \
         or give the file that has it complete with --guides-from"
    )]
    Sparse {
        /// The channel.
        channel: String,
    },
    /// A second file of which nothing that was asked for is complete.
    #[error(
        "{channels}: zero, NaN, the same or filled at the missing pixels, and only complete channels can guide: render the guides for every pixel, \
         or leave --guides-from out"
    )]
    SparseFile {
        /// The channels.
        channels: String,
    },
    /// A second file that does not fit the larger frame.
    #[error(
        "--guides-from: no part has {window} of the larger frame: render the guides for the pixels of the output"
    )]
    LargerWindow {
        /// Of what is made.
        window: String,
    },
    /// A second file that does not fit.
    #[error("--guides-from: no part has {window} of what is filled: render the guides for the same pixels")]
    Window {
        /// Of what is filled.
        window: String,
    },
}

impl Error {
    /// The file that it is about: the frame's own, or that of the guides.
    pub fn file<'a>(&self, own: &'a Path, second: Option<&'a Path>) -> &'a Path {
        second.filter(|_| matches!(self, Self::SparseFile { .. })).unwrap_or(own)
    }
}
