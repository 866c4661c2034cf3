//! `lacuna info`: flags to a checked job.

use std::path::PathBuf;

use clap::Args;

use super::channels::ChannelArgs;
use super::mask::MaskArgs;
use crate::sequence::InfoJob;

const EXAMPLES: &str = "\
Examples:
  lacuna info shot.0001.exr
  lacuna info shot.0001.exr --mask alpha --json";

/// Print parts, windows, channels, the mask found, the density, and each channel's rule and why
#[derive(Args, Clone, Debug)]
#[command(after_help = EXAMPLES)]
pub struct InfoArgs {
    /// The frame's file
    #[arg(value_name = "FRAME", help_heading = "Input and frames")]
    frame: PathBuf,

    #[command(flatten)]
    mask: MaskArgs,

    #[command(flatten)]
    channels: ChannelArgs,

    /// Print JSON
    #[arg(long, help_heading = "Run")]
    json: bool,
}

impl InfoArgs {
    /// The checked job.
    pub fn job(&self) -> InfoJob {
        InfoJob {
            frame: self.frame.clone(),
            mask: self.mask.mask.clone(),
            overrides: self.channels.channels.clone(),
            json: self.json,
        }
    }
}
