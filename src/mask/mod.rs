//! Where a mask comes from: which pixels of each part and channel were measured.

use std::sync::Arc;

use lacuna_filters::Mask;

/// What `--mask` asks for.
#[derive(Clone, Debug, PartialEq)]
pub enum Source {
    /// Find the mask in the frame: the attribute `lacuna/mask`, a channel `mask`, or `LAYER.mask`.
    Auto,
    /// The channel of that name.
    Channel(String),
    /// A file (EXR or PNG), or a pattern that goes frame by frame; `channel` if not the obvious one.
    File {
        /// Path or pattern.
        pattern: String,
        /// The channel to take.
        channel: Option<String>,
    },
    /// Measured where alpha is above 0.
    Alpha,
    /// Measured where every colour channel is finite.
    Finite,
    /// Measured where a sample-count channel is at least this.
    Count {
        /// The channel that counts samples.
        channel: String,
        /// The least count of a measured pixel.
        at_least: f64,
    },
}

/// The masks of one frame: for every part and channel the mask that serves it.
#[derive(Clone, Debug)]
pub struct Masks {
    /// Per part, per channel: the mask over the part's data window, or `None` where none serves
    /// (such a channel must be `keep`).
    pub channels: Vec<Vec<Option<Arc<Mask>>>>,
    /// Where the mask was found, for people and for the attribute `lacuna/mask`.
    pub origin: String,
}
