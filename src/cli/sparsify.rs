//! `lacuna sparsify`: flags to a checked job.

use clap::Args;

use super::Usage;
use super::adaptive::AdaptiveArgs;
use super::input::InputArgs;
use super::numbers::density;
use super::output::{FormatArgs, OutputArgs};
use super::run::RunArgs;
use crate::channels::{Override, Rule};
use crate::commands::{SparsifyJob, SparsifyPattern};
use crate::files::Targets;
use crate::mask::Source;

const EXAMPLES: &str = "\
Examples:
  lacuna sparsify full.exr -o sparse.exr --density 0.2
  lacuna sparsify 'full.####.exr' -o sparse/ --density 0.1 --create-dir
  lacuna sparsify full.exr -o sparse.exr --mask mask.png
  lacuna sparsify full.exr -o sparse.exr --density 0.2 --adaptive
  lacuna sparsify full.exr -o sparse.exr --density 0.1 --channels 'N.*=keep'

Exit status: 0 all done, 1 some frame failed, 2 usage, 128 + n on signal n.";

// Not a comment for rustdoc, which would read an address into it.
const MASK: &str = "A mask instead of a density: file:PATTERN[:CHANNEL] or a bare path, EXR or PNG; a pattern goes frame \
                    by frame";

/// Make sparse test frames from complete ones
///
/// Missing pixels become zero in every part, every part gets a channel mask, nothing else changes. The pattern is of low
/// discrepancy and nested (a smaller density is a subset of a larger one), and anchored to absolute pixels, so that parts
/// and overscan agree. With --adaptive the frame stands for a renderer that is asked for pixels in rounds.
#[derive(Args, Clone, Debug)]
#[command(after_help = EXAMPLES)]
pub struct SparsifyArgs {
    #[command(flatten)]
    input: InputArgs,

    #[command(flatten)]
    pattern: PatternArgs,

    /// Keep matching channels complete, for example 'albedo.*=keep'; the attribute lacuna/dense lists them, so that fill
    /// keeps them and takes guides among them
    #[arg(long, value_name = "GLOB=keep", help_heading = "Channels")]
    channels: Vec<Override>,

    #[command(flatten)]
    output: OutputArgs,

    #[command(flatten)]
    format: FormatArgs,

    #[command(flatten)]
    run: RunArgs,
}

/// Which pixels stay.
#[derive(Args, Clone, Debug)]
#[command(next_help_heading = "Mask")]
struct PatternArgs {
    /// Measured pixels over all pixels, above 0 to 1
    #[arg(long, value_name = "D", value_parser = density, allow_hyphen_values = true)]
    density: Option<f64>,

    /// Another pattern of the same kind; the output records it
    #[arg(long, value_name = "N", default_value_t = 0)]
    seed: u64,

    #[arg(long, value_name = "SOURCE", help = MASK, conflicts_with_all = ["density", "seed"])]
    mask: Option<Source>,

    #[command(flatten)]
    adaptive: AdaptiveArgs,
}

impl SparsifyArgs {
    /// The checked job.
    pub fn job(&self) -> Result<SparsifyJob, Usage> {
        let (selection, skip_missing) = self.input.selection();
        let (pattern, mask) = match (&self.pattern.mask, self.pattern.density) {
            (Some(source @ Source::File { pattern, .. }), _) => {
                (SparsifyPattern::Mask(source.clone()), Some(pattern.clone()))
            }
            (Some(other), _) => {
                return Err(Usage(format!(
                    "--mask {other} is in the sparse frame itself; sparsify takes a mask file"
                )));
            }
            (None, Some(density)) => {
                let seed = self.pattern.seed;
                let shuffle = SparsifyPattern::Shuffle { density, seed };
                let rounds = self.pattern.adaptive.settings(density, seed)?;
                (rounds.map_or(shuffle, SparsifyPattern::Adaptive), None)
            }
            (None, None) => {
                return Err(Usage(
                    "what stays measured is not said: give --density D (0 to 1) or --mask SOURCE (a file)"
                        .into(),
                ));
            }
        };
        if let Some(other) = self.channels.iter().find(|asked| asked.rule != Rule::Keep) {
            let text =
                format!("--channels {other}: sparsify knows keep alone, for channels that stay complete");
            return Err(Usage(text));
        }
        let packing = self.format.compression;
        let run = self.run.options();
        Ok(SparsifyJob {
            selection,
            skip_missing,
            targets: Targets {
                neighbours: 0,
                guides: None,
                layers: Vec::new(),
                output: self.output.checked(false)?,
                mask,
                also_read: self.input.listed().into_iter().collect(),
                also_written: run.also_written(),
                create_dir: self.output.create_dir,
            },
            pattern,
            complete: self.channels.iter().map(|asked| asked.glob.clone()).collect(),
            compression: packing.map(|packing| packing.compression),
            level: packing.and_then(|packing| packing.level),
            existing: self.output.existing(false),
            run,
        })
    }
}
