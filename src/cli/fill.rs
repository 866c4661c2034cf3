//! `lacuna fill`: flags to a checked job.

use clap::Args;

use super::Usage;
use super::channels::ChannelArgs;
use super::filter::FilterArgs;
use super::input::InputArgs;
use super::mask::MaskArgs;
use super::output::{FormatArgs, MoreOutput, OutputArgs};
use super::run::{PageArgs, RunArgs};
use crate::reconstruct;
use crate::sequence::{FillJob, RunOptions, Targets};

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
    output: OutputArgs,

    #[command(flatten)]
    format: FormatArgs,

    #[command(flatten)]
    more: MoreOutput,

    #[command(flatten)]
    run: RunArgs,

    #[command(flatten)]
    page: PageArgs,
}

impl FillArgs {
    /// The checked job.
    pub fn job(&self) -> Result<FillJob, Usage> {
        let (selection, skip_missing) = self.input.selection();
        let packing = self.format.compression;
        let what = reconstruct::Job {
            method: self.filter.method()?,
            domain: self.filter.settings.domain(),
            limit: self.filter.settings.limits(),
            kind: self.more.kind(),
            drop_mask: self.more.drop_mask,
            compression: packing.map(|packing| packing.compression),
            mask: self.mask.mask.clone(),
            overrides: self.channels.channels.clone(),
            enlarge: None,
        };
        let run = RunOptions { page: self.page.report.clone(), ..self.run.options() };
        Ok(FillJob {
            selection,
            skip_missing,
            targets: Targets {
                output: self.output.checked()?,
                mask: self.mask.file(),
                also_written: run.json.iter().chain(&run.page).cloned().collect(),
                create_dir: self.output.create_dir,
            },
            what,
            level: packing.and_then(|packing| packing.level),
            existing: self.more.existing(&self.output),
            run,
        })
    }
}
