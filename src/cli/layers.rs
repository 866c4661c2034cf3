//! The flag that brings channels in from files of their own.

use clap::Args;

use crate::files::LayerSource;

/// Layers from other files.
#[derive(Args, Clone, Debug)]
#[command(next_help_heading = "Input and frames")]
pub struct LayerArgs {
    /// Take the channels of another file, or pattern that goes frame by frame, into the frame as the layer NAME; may be repeated
    ///
    /// For renderers that write each output to its own file: --layers albedo=ALBEDO.####.exr --layers depth=DEPTH.####.exr
    #[arg(long, value_name = "NAME=PATTERN")]
    pub layers: Vec<LayerSource>,
}
