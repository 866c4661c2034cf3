//! What can go wrong while a mask is looked for.

/// No usable mask; each message says what there is instead.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[non_exhaustive]
pub enum Error {
    /// `auto` found nothing.
    #[error(
        "no sampling mask found (no channel that the attribute lacuna/mask names, no channel mask, no LAYER.mask of 0 and 1): \
             name one with --mask, nan where all finite pixels were measured; channels are {channels}{}",
        hint.as_ref().map(|hint| format!("; {hint}")).unwrap_or_default()
    )]
    NotFound {
        /// The channels of the frame.
        channels: String,
        /// What may be the mask all the same.
        hint: Option<String>,
    },
    /// Several channels called `mask`, none of them exactly so.
    #[error("several channels could be the sampling mask ({names}): name one with --mask channel:NAME")]
    Several {
        /// The channels.
        names: String,
    },
    /// The channel asked for is not there.
    #[error("no channel '{name}' to take the mask from: name another with --mask; channels are {channels}")]
    NoChannel {
        /// The name asked for.
        name: String,
        /// The channels there are.
        channels: String,
    },
    /// `alpha` in a frame without one.
    #[error("no alpha channel to take the mask from: name another mask with --mask; channels are {channels}")]
    NoAlpha {
        /// The channels of the frame.
        channels: String,
    },
    /// `nan` in a frame in which no channel can say it.
    #[error(
        "no float channel to tell measured pixels by: name another mask with --mask; channels are {channels}"
    )]
    NoFloat {
        /// The channels of the frame.
        channels: String,
    },
    /// A mask without a window of its own fits no part.
    #[error(
        "mask {path} has {found} pixels, but the frame's windows have {expected}: \
             use a mask of the data window's or the display window's size"
    )]
    Size {
        /// The mask file.
        path: String,
        /// Its size.
        found: String,
        /// The sizes that would do.
        expected: String,
    },
    /// The mask file cannot be read.
    #[error("mask {path}: {why}")]
    File {
        /// The mask file.
        path: String,
        /// What is wrong with it.
        why: String,
    },
    /// Several channels and nothing that says which.
    #[error("mask {path} has no channel '{wanted}': name one as {path}:CHANNEL; channels are {channels}")]
    FileChannel {
        /// The mask file.
        path: String,
        /// The channel that was looked for.
        wanted: String,
        /// The channels of the mask file.
        channels: String,
    },
    /// The source is a file, but the caller passed none.
    #[error("the mask file has not been read")]
    FileNotRead,
}
