//! Flags that say which pixels were measured.

use clap::Args;

use crate::mask::Source;

const MASK: &str =
    "Which pixels were measured: auto, channel:NAME, file:PATTERN[:CHANNEL], alpha, nan or count:CHANNEL:N";

const MASK_LONG: &str = "\
Which pixels were measured: auto, channel:NAME, file:PATTERN[:CHANNEL], alpha, nan or count:CHANNEL:N

auto: in this order the channel that the attribute lacuna/mask names, a channel called mask, or LAYER.mask for the \
channels of LAYER. file: an EXR or PNG image, or a pattern that goes frame by frame; a bare path means the same. \
alpha: measured where alpha is above 0. nan: measured where the colour is finite. count: measured where CHANNEL counts \
at least N samples. In a channel or image, half of the full value or more is measured.";

/// Where the sampling mask comes from.
#[derive(Args, Clone, Debug)]
#[command(next_help_heading = "Mask")]
pub struct MaskArgs {
    // Not a comment for rustdoc, which would read addresses and emphasis into it.
    #[arg(long, value_name = "SOURCE", default_value = "auto", help = MASK, long_help = MASK_LONG)]
    #[allow(
        missing_docs,
        reason = "the help is a constant, whose addresses and emphasis are not for rustdoc"
    )]
    pub mask: Source,
}

/// Where the mask of a filled frame came from.
#[derive(Args, Clone, Debug)]
#[command(next_help_heading = "Mask")]
pub struct SameMaskArgs {
    /// The mask that the frames were filled with, as in fill [default: what the filled frame's attributes say]
    #[arg(long, value_name = "SOURCE")]
    pub mask: Option<Source>,
}

impl MaskArgs {
    /// Path or pattern of the mask's file, if it comes from one.
    pub fn file(&self) -> Option<String> {
        match &self.mask {
            Source::File { pattern, .. } => Some(pattern.clone()),
            _ => None,
        }
    }
}
