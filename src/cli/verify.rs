//! `lacuna verify`: flags to a checked job.

use std::path::PathBuf;

use clap::Args;

use super::input::FramesArgs;
use super::mask_source::SameMaskArgs;
use super::run::RunArgs;
use crate::commands::VerifyJob;
use crate::files::Selection;

const EXAMPLES: &str = "\
Examples:
  lacuna verify sparse.exr full.exr
  lacuna verify 'shot.####.exr' 'full/shot.####.exr' --frames 1-100

Exit status: 0 all as promised, 1 a frame is not or cannot be read, 2 usage, 128 + n on signal n.";

/// Check that filled frames are what fill promises of the sparse ones
///
/// Checked, with the mask and the rules that the filled frame's attributes name: parts, channels, types, windows,
/// layout, compression and attributes; every bit of kept channels and of measured pixels (unless the attributes say
/// that they were smoothed, by a filter that does, which log and --json repeat); that filled values are finite, not negative where no measured one is
/// (light) and from 0 to 1 where all measured ones are (alpha, mattes); that identifiers and depths were measured
/// somewhere in their channel; that what lacuna/copied names is what stands in that complete channel, unless that is in another file; that filled normals are of unit length where the measured ones are; that the attributes
/// lacuna/density, mask and filter are consistent with the mask, and lacuna/estimate and the channels of estimated errors with themselves.
///
/// Not checked: whether the named filter and settings made the values, how far these are from the measured ones, and
/// whether a copied value is the nearest one.
/// What differs is named with part, channel and pixel.
/// Enlarged frames are refused: lacuna compare checks them against frames rendered at their size.
#[derive(Args, Clone, Debug)]
#[command(after_help = EXAMPLES)]
pub struct VerifyArgs {
    /// The sparse frame: a file, a pattern or a glob, as in fill
    #[arg(value_name = "SPARSE", display_order = 0, help_heading = "Input and frames")]
    sparse: PathBuf,

    /// The filled frame: a file, a pattern or a folder, as fill's OUTPUT
    #[arg(value_name = "FILLED", display_order = 1, help_heading = "Input and frames")]
    filled: PathBuf,

    #[command(flatten)]
    frames: FramesArgs,

    #[command(flatten)]
    mask: SameMaskArgs,

    #[command(flatten)]
    run: RunArgs,
}

impl VerifyArgs {
    /// The checked job.
    pub fn job(&self) -> VerifyJob {
        VerifyJob {
            selection: Selection {
                inputs: vec![self.sparse.clone()],
                files_from: None,
                frames: self.frames.frames.clone(),
            },
            skip_missing: self.frames.skips_missing(),
            filled: self.filled.clone(),
            mask: self.mask.mask.clone(),
            run: self.run.options(),
        }
    }
}
