//! Why a frame cannot be filled; each message names the part and channel and a way out.

/// A frame that cannot be filled.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum Error {
    /// No mask for a channel that is to be filled.
    #[error("{channel}: {why}: give a mask that covers it, or keep it with --channels '{name}=keep'")]
    NoMask {
        /// Part and channel.
        channel: String,
        /// The channel's name alone.
        name: String,
        /// Why there is none.
        why: String,
    },
    /// A mask without a measured pixel.
    #[error("{channel}: the mask ({origin}) has no measured pixel, {why}")]
    EmptyMask {
        /// Part and channel.
        channel: String,
        /// Where the mask was found.
        origin: String,
        /// What is the matter with it, and the way out.
        why: String,
    },
    /// Measured pixels, but none with a usable value.
    #[error(
        "{channel}: no measured value is finite: render the frame again, or keep the channel with --channels '{}=keep'",
        glob::Pattern::escape(name).replace('=', "[=]")
    )]
    NothingFinite {
        /// Part and channel.
        channel: String,
        /// The channel's name alone.
        name: String,
    },
    /// The filter refused.
    #[error("{channel}: {source}{}", remedy(source))]
    Filter {
        /// Part and channel.
        channel: String,
        /// What it said.
        source: lacuna_filters::Error,
    },
    /// It cannot be enlarged as asked.
    #[error("{part}{why}")]
    Enlarge {
        /// The part, if there are several.
        part: String,
        /// What is in the way, and the way out.
        why: String,
    },
    /// Weights that cannot be used.
    #[error("--weights {weights}: {why}")]
    Weights {
        /// As asked for.
        weights: String,
        /// What is in the way.
        why: String,
    },
    /// Noise that cannot be used.
    #[error("--noise {noise}: {why}")]
    Noise {
        /// As asked for.
        noise: String,
        /// What is in the way.
        why: String,
    },
    /// Guides that cannot be used.
    #[error(transparent)]
    Guides(#[from] crate::guides::Error),
    /// Masks or choices of another frame.
    #[error("the masks or the channel rules belong to another frame")]
    OtherFrame,
}

/// The flags that are the way out of what a filter refused, if there are such.
fn remedy(source: &lacuna_filters::Error) -> &'static str {
    match source {
        lacuna_filters::Error::NoPairs => " (lacuna mask --paired, lacuna render --gradients)",
        _ => "",
    }
}
