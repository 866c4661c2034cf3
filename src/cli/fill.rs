//! `lacuna fill`: flags to a checked job.

use clap::Args;

use super::Usage;
use super::channels::ChannelArgs;
use super::filter::{FilterArgs, Switch};
use super::guides::GuideArgs;
use super::input::InputArgs;
use super::mask::MaskArgs;
use super::output::{Depth, FormatArgs, OutputArgs};
use super::run::RunArgs;
use crate::reconstruct::{self, Kind};
use crate::sequence::{Existing, FillJob, Targets};

const EXAMPLES: &str = "\
Examples:
  lacuna fill sparse.exr -o full.exr
  lacuna fill 'shot.####.exr' -o 'full/shot.####.exr' --frames 1-100 --create-dir
  lacuna fill 'in/*.exr' -o out/ -u --json report.json
  lacuna fill shot.exr -o full.exr --mask file:mask.png --channels 'crypto*=keep'
  lacuna fill shot.exr -o full.exr --filter tv --tv-gap 1e-3

Exit status: 0 all done, 1 some frame failed, 2 usage, 128 + n on signal n.";

/// Fill the missing pixels of sparse EXR frames
///
/// Reads frames in which only some pixels were measured, reconstructs the rest and writes complete frames. A measured
/// pixel keeps its bits unless an option asks for smoothing or for another type; whatever has no business being reconstructed passes through.
#[derive(Args, Clone, Debug)]
#[command(after_help = EXAMPLES)]
pub struct FillArgs {
    #[command(flatten)]
    input: InputArgs,

    #[command(flatten)]
    mask: MaskArgs,

    #[command(flatten)]
    channels: ChannelArgs,

    #[command(flatten)]
    filter: FilterArgs,

    #[command(flatten)]
    guides: GuideArgs,

    #[command(flatten)]
    output: OutputArgs,

    #[command(flatten)]
    format: FormatArgs,

    #[command(flatten)]
    more: MoreOutput,

    #[command(flatten)]
    run: RunArgs,
}

/// What only outputs with reconstructed channels have.
#[derive(Args, Clone, Debug)]
#[command(next_help_heading = "Output")]
struct MoreOutput {
    /// Type of the reconstructed channels: half rounds their measured pixels too and clamps what would overflow, both
    /// are counted; depths, identifiers and kept channels never become half [default: the input's]
    #[arg(short = 'd', long, value_name = "TYPE")]
    data_type: Option<Depth>,

    /// Leave the mask's channels out
    #[arg(long)]
    drop_mask: bool,

    /// Pass over frames whose output is newer than their input (and mask file) and was made by this version with the
    /// same settings and mask
    #[arg(short, long, conflicts_with = "no_clobber")]
    update: bool,
}

impl FillArgs {
    /// The checked job.
    pub fn job(&self) -> Result<FillJob, Usage> {
        let (selection, skip_missing) = self.input.selection();
        let packing = self.format.compression;
        let what = reconstruct::Job {
            method: self.filter.method()?,
            domain: self.filter.domain(),
            limit: self.filter.limit == Switch::On,
            kind: self.more.data_type.map(|depth| match depth {
                Depth::Half => Kind::Half,
                Depth::Float => Kind::Float,
            }),
            drop_mask: self.more.drop_mask,
            compression: packing.map(|packing| packing.compression),
            mask: self.mask.mask.clone(),
            overrides: self.channels.channels.clone(),
            guides: self.guides.guides.clone(),
            guides_from: self.guides.guides_from.clone(),
        };
        self.guides.check(&what)?;
        let run = self.run.options();
        Ok(FillJob {
            selection,
            skip_missing,
            targets: Targets {
                output: self.output.checked()?,
                mask: self.mask.file(),
                guides: self.guides.guides_from.clone(),
                also_written: run.json.iter().cloned().collect(),
                create_dir: self.output.create_dir,
            },
            what,
            level: packing.and_then(|packing| packing.level),
            existing: match (self.more.update, self.output.no_clobber) {
                (true, _) => Existing::Update,
                (_, true) => Existing::Keep,
                _ => Existing::Replace,
            },
            run,
        })
    }
}
