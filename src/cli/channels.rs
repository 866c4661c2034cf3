//! Flags that say what happens to each channel.

use std::path::{Path, PathBuf};

use clap::Args;

use super::Usage;
use crate::channels::{Override, read_rules};

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

/// Rules from a file.
#[derive(Args, Clone, Debug)]
#[command(next_help_heading = "Channels")]
pub struct RulesArgs {
    /// Take rules from a file too, after those of --channels: TOML, [[rule]] with glob, rule and perhaps reason; lacuna info
    /// FRAME --rules prints one to start from
    #[arg(long, value_name = "FILE")]
    pub rules: Option<PathBuf>,
}

/// The rules of the command line, then those of a file.
///
/// # Errors
/// A file that cannot be read or is none.
pub fn all(channels: &ChannelArgs, rules: Option<&Path>) -> Result<Vec<Override>, Usage> {
    let mut all = channels.channels.clone();
    if let Some(path) = rules {
        all.extend(read_rules(path).map_err(|why| Usage(format!("--rules {why}")))?);
    }
    Ok(all)
}
