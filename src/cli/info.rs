//! `lacuna info`: flags to a checked job.

use std::path::PathBuf;

use clap::Args;

use super::channels::ChannelArgs;
use super::guides::GuideArgs;
use super::mask_source::MaskArgs;
use super::run::Bytes;
use crate::commands::InfoJob;

const EXAMPLES: &str = "\
Examples:
  lacuna info shot.0001.exr
  lacuna info shot.0001.exr --mask alpha --json

Exit status: 0 described (with --mask auto also if no mask is found, which is said), 1 the frame cannot be read or the
mask asked for cannot be used, 2 usage.";

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

    #[command(flatten)]
    guides: GuideArgs,

    /// Memory that reading the frame may take: bytes, or with K, M, G, T (powers of 1024), for example 4G
    /// [default: 1.5G]
    #[arg(long, value_name = "SIZE", allow_hyphen_values = true, help_heading = "Run")]
    memory: Option<Bytes>,

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
            guides: self.guides.guides.clone(),
            guides_from: self.guides.guides_from.clone(),
            memory: self.memory.map(|bytes| bytes.0),
            json: self.json,
        }
    }
}
