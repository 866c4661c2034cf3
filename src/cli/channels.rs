//! Flags that say what happens to each channel.

use clap::Args;

use crate::channels::Override;

/// Rules for channels.
#[derive(Args, Clone, Debug)]
#[command(next_help_heading = "Channels")]
pub struct ChannelArgs {
    /// Rule for the channels whose full name matches GLOB (case matters); repeatable, the first match wins
    ///
    /// fill: reconstructed by the filter. normal: filled, then unit length. depth: only values that a measured neighbour
    /// had. nearest: copied from the nearest measured pixel. keep: untouched. Channels that no GLOB matches get their
    /// rule from their type, name and attributes; `lacuna info FRAME` prints it with the reason.
    #[arg(long, value_name = "GLOB=RULE")]
    pub channels: Vec<Override>,
}
