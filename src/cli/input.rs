//! Flags that say which frames are taken.

use std::path::{Path, PathBuf};

use clap::{Args, ValueEnum};

use crate::files::Selection;
use crate::files::ranges::Frames;

/// Inputs of a subcommand that works through frames.
#[derive(Args, Clone, Debug)]
// After the frames themselves, which have no flag.
#[command(next_help_heading = "Input and frames", next_display_order = 1)]
pub struct InputArgs {
    /// Frames: a file, a pattern or a glob; several may be given
    ///
    /// Patterns: shot.####.exr, shot.%04d.exr, shot.@@@@.exr and shot.$F4.exr all mean four digits. A single # reads as
    /// four digits, a run of n as n; @ needs a run of two or more; %d and $F pad nothing; wider numbers take the digits
    /// they need. A glob ('shot.*.exr', in quotes) takes the frame numbers from the names: the last field between dots
    /// that is all digits, else the last run of digits that is no version (_v2). A file or folder that exists under the
    /// very name is that one.
    #[arg(value_name = "INPUT", required_unless_present = "files_from", display_order = 0)]
    pub inputs: Vec<PathBuf>,

    /// Read more inputs from FILE, one path a line, taken as they are; - is standard input
    #[arg(long, value_name = "FILE")]
    pub files_from: Option<PathBuf>,

    #[command(flatten)]
    #[allow(
        missing_docs,
        reason = "rustdoc on a flattened group would become the help of the whole subcommand"
    )]
    pub frames: FramesArgs,
}

/// Which frames of a sequence.
#[derive(Args, Clone, Debug)]
// After the frames themselves, of which there may be two kinds.
#[command(next_help_heading = "Input and frames", next_display_order = 2)]
pub struct FramesArgs {
    /// Frames of a pattern or glob, in this order: 1-10, 1-10x2 or 1-10:2 (every second), 1,5,9-12, 10-1, -5--1
    /// [default: all that exist, by number]
    #[arg(long, value_name = "RANGE", allow_hyphen_values = true)]
    pub frames: Option<Frames>,

    /// A frame that does not exist: fail (the others are done, exit status 1) or pass over it
    #[arg(long, value_name = "WHAT", default_value = "error")]
    pub missing_frame: Missing,
}

/// What a frame is that does not exist.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
pub enum Missing {
    /// An error of that frame.
    Error,
    /// Nothing to do.
    Skip,
}

impl InputArgs {
    /// The selection, and whether missing frames are passed over.
    pub fn selection(&self) -> (Selection, bool) {
        let selection = Selection {
            inputs: self.inputs.clone(),
            files_from: self.files_from.clone(),
            frames: self.frames.frames.clone(),
        };
        (selection, self.frames.skips_missing())
    }

    /// The file that lists frames, if it is one.
    pub fn listed(&self) -> Option<(&'static str, PathBuf)> {
        let list = self.files_from.clone().filter(|list| list != Path::new("-"));
        list.map(|list| ("list of --files-from", list))
    }
}

impl FramesArgs {
    /// Whether missing frames are passed over.
    pub fn skips_missing(&self) -> bool {
        self.missing_frame == Missing::Skip
    }
}
