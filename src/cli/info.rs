//! `lacuna info`: flags to a checked job.

use std::path::PathBuf;

use clap::Args;

use super::Usage;
use super::channels::{self, ChannelArgs};
use super::guides::GuideArgs;
use super::mask_source::MaskArgs;
use super::run::Bytes;
use crate::commands::InfoJob;

const EXAMPLES: &str = "\
Examples:
  lacuna info shot.0001.exr
  lacuna info 'shot.####.exr' --json
  lacuna info shot.0001.exr --mask alpha --json

Exit status: 0 described (with --mask auto also if no mask is found, which is said), 1 a frame \
cannot be read or the mask asked for cannot be used, 2 usage.";

/// Print parts, windows, channels, the mask found, the density, and each channel's rule and why
#[derive(Args, Clone, Debug)]
#[command(after_help = EXAMPLES)]
pub struct InfoArgs {
    /// The frame's file; several, a pattern or a glob are described one after the other
    #[arg(value_name = "FRAME", required = true, help_heading = "Input and frames")]
    frames: Vec<PathBuf>,

    #[command(flatten)]
    mask: MaskArgs,

    #[command(flatten)]
    channels: ChannelArgs,

    /// Print the rules as a file for --rules of fill to start from; =FILE takes the rules of a file instead
    #[arg(long, value_name = "FILE", num_args = 0..=1, require_equals = true, help_heading = "Channels")]
    rules: Option<Vec<PathBuf>>,

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
    ///
    /// # Errors
    /// A file of rules that is none; rules as JSON.
    pub fn job(&self) -> Result<InfoJob, Usage> {
        let print_rules = self.rules.as_ref().is_some_and(Vec::is_empty);
        if print_rules && self.json {
            return Err(Usage(
                "--rules prints a file of rules, which is TOML: drop --json, whose channels name their rules"
                    .into(),
            ));
        }
        let is_report = |path: &&PathBuf| path.extension().is_some_and(|ending| ending == "json");
        if let Some(path) = self.frames.iter().find(is_report).filter(|_| self.json) {
            let path = path.display();
            return Err(Usage(format!(
                "--json takes no file and prints: give the frames alone, and > {path}"
            )));
        }
        let rules = self.rules.iter().flatten().next().map(PathBuf::as_path);
        Ok(InfoJob {
            frames: self.frames.clone(),
            mask: self.mask.mask.clone(),
            overrides: channels::all(&self.channels, rules)?,
            print_rules,
            guides: self.guides.guides.clone(),
            guides_from: self.guides.guides_from.clone(),
            memory: self.memory.map(|bytes| bytes.0),
            json: self.json,
        })
    }
}
