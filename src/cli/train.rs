//! `lacuna dictionary train`: flags to a checked job.

use std::path::PathBuf;

use clap::Args;
use lacuna_filters::dictionary::ksvd;

use super::Usage;
use super::input::InputArgs;
use super::run::SpeechArgs;
use crate::commands::TrainJob;

const EXAMPLES: &str = "\
Examples:
  lacuna dictionary train 'views/*.exr' -o show.npz
  lacuna dictionary train 'shot.####.exr' -o show.npz --frames 1-100
  lacuna dictionary train 'views/*.exr' -o grey.npz --grey --atoms 1024

Exit status: 0 done, 1 failed, 2 usage, 128 + n on signal n.";

const MISSING: &str = "A frame that does not exist: fail, and learn nothing (exit status 1), or pass over it";

/// Learn a dictionary from complete frames
///
/// Cuts the colour (R, G, B) of the frames into blocks and finds the atoms that explain each with few of them (K-SVD).
/// `lacuna fill --filter dictionary --dictionary FILE` uses them. See docs/dictionary.md.
#[derive(Args, Clone, Debug)]
#[command(after_help = EXAMPLES, mut_arg("missing_frame", |missing| missing.help(MISSING)))]
pub struct TrainArgs {
    #[command(flatten)]
    input: InputArgs,

    #[command(flatten)]
    settings: KsvdArgs,

    #[command(flatten)]
    output: TrainOutput,

    #[command(flatten)]
    run: TrainRun,
}

/// Where the dictionary goes.
#[derive(Args, Clone, Debug)]
#[command(next_help_heading = "Output")]
struct TrainOutput {
    /// The dictionary: an archive of NumPy arrays (.npz), whatever its name ends in
    #[arg(short, long, value_name = "FILE")]
    output: PathBuf,

    /// Make the output's folder where it is missing
    #[arg(long)]
    create_dir: bool,

    /// Continue the output, which has the same frames and settings and is unfinished (it is written twice a minute) or has fewer
    /// --iterations
    #[arg(long)]
    resume: bool,
}

/// What is learned.
#[derive(Args, Clone, Debug)]
#[command(next_help_heading = "Dictionary")]
struct KsvdArgs {
    /// Pixels of a block's side, 1 to 64
    #[arg(long, value_name = "N", default_value_t = 16, value_parser = side, allow_hyphen_values = true)]
    block: u16,

    /// Atoms, 1 to 16384 [default: 3 for each number of a block in colour, 4 in grey: 2304 and 1024]
    #[arg(long, value_name = "K", value_parser = atoms, allow_hyphen_values = true)]
    atoms: Option<u16>,

    /// Atoms of a block at most, 1 or more
    #[arg(long, value_name = "L", default_value_t = 10, value_parser = super::numbers::one_or_more, allow_hyphen_values = true)]
    sparsity: u32,

    /// One channel instead of three: the luminance; fills then take each channel alone
    #[arg(long)]
    grey: bool,

    /// Iterations, 1 or more
    #[arg(long, value_name = "N", default_value_t = 50, value_parser = super::numbers::one_or_more, allow_hyphen_values = true)]
    iterations: u32,

    /// Pixels from block to block, 1 to the block [default: the block]
    #[arg(long, value_name = "N", value_parser = side, allow_hyphen_values = true)]
    stride: Option<u16>,

    /// Blocks at most, drawn evenly from all frames; 0 takes all
    #[arg(long, value_name = "N", default_value_t = 50000)]
    blocks_max: u32,

    /// Which blocks the atoms begin as, and which are drawn; the output records it
    #[arg(long, value_name = "N", default_value_t = 0)]
    seed: u64,

    /// Update atoms by one step instead of by their best (faster, a little worse)
    #[arg(long)]
    approximate: bool,
}

/// How to run.
#[derive(Args, Clone, Debug)]
#[command(next_help_heading = "Run")]
struct TrainRun {
    /// Threads in all; 0 takes what the machine allows
    #[arg(long, value_name = "N", default_value_t = 0)]
    threads: usize,

    #[command(flatten)]
    speech: SpeechArgs,
}

impl TrainArgs {
    /// The checked job.
    pub fn job(&self) -> Result<TrainJob, Usage> {
        let (selection, skip_missing) = self.input.selection();
        let KsvdArgs { block, sparsity, grey, iterations, stride, blocks_max, seed, approximate, .. } =
            self.settings;
        let (block, channels) = (usize::from(block), if grey { 1 } else { 3 });
        let stride = stride.map_or(block, usize::from);
        if stride > block {
            return Err(Usage(format!(
                "--stride {stride} is more than --block {block}: pixels would be left out"
            )));
        }
        let numbers = channels * block * block;
        let usual = (if grey { 4 * numbers } else { 3 * numbers }).min(16384);
        let atoms = self.settings.atoms.map_or(usual, usize::from);
        let sparsity = sparsity as usize;
        if sparsity > numbers.min(atoms) {
            return Err(Usage(format!(
                "--sparsity {sparsity} is more than the {atoms} atoms or the {numbers} numbers of a block"
            )));
        }
        Ok(TrainJob {
            selection,
            skip_missing,
            output: self.output.output.clone(),
            settings: ksvd::Settings {
                block,
                channels,
                atoms,
                sparsity,
                iterations: iterations as usize,
                seed,
                approximate,
            },
            stride,
            blocks_max: blocks_max as usize,
            resume: self.output.resume,
            create_dir: self.output.create_dir,
            threads: self.run.threads,
            verbosity: self.run.speech.verbosity(),
        })
    }
}

fn within(text: &str, most: u16) -> Result<u16, String> {
    let value = text.parse().ok().filter(|value| (1..=most).contains(value));
    value.ok_or_else(|| format!("it must be a whole number from 1 to {most}"))
}

fn side(text: &str) -> Result<u16, String> {
    within(text, 64)
}

fn atoms(text: &str) -> Result<u16, String> {
    within(text, 16384)
}
