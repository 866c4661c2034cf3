//! `lacuna analyze`: flags to a checked job.

use std::path::PathBuf;

use clap::Args;

use super::Usage;
use super::mask::{CROP_OVERHEAD, file};
use super::numbers::density;
use super::run::{Bytes, SpeechArgs};
use crate::commands::{MaskJob, MaskOutput, MaskTask};
use crate::mask::Source;
use crate::run::granted_memory;

const EXAMPLES: &str = "\
Examples:
  lacuna analyze mask.exr
  lacuna analyze mask.exr -o spectrum.png --json
  lacuna analyze --coherence --densities 0.1,0.2
  lacuna analyze --spectrum frame.exr -o histogram.png

Exit status: 0 all done, 1 something failed, 2 usage, 128 + n on signal n.";

/// Measure a mask: density, discrepancy, distances, holes, spectrum, coherence
///
/// Prints density, star discrepancy, distances and the largest hole; -o FILE.png plots the power spectrum, averaged over directions.
#[derive(Args, Clone, Debug)]
#[command(after_help = EXAMPLES, next_help_heading = "Measure")]
#[allow(clippy::struct_excessive_bools, reason = "each is a flag of its own")]
pub struct AnalyzeArgs {
    /// The mask: an image file, EXR (channel mask, A or the only one if not named) or PNG
    #[arg(value_name = "MASK[:CHANNEL]")]
    mask: Option<Source>,

    /// Coherence of 64 x 64 sensing matrices (partial Fourier, wavelets with and without blur) over densities, as figure 3.1
    /// of the thesis; takes minutes
    #[arg(long)]
    coherence: bool,

    /// The densities of --coherence [default: 0.1,0.2,0.3,0.4,0.5,0.6,0.7,0.8,0.9]
    #[arg(long, value_name = "LIST", value_delimiter = ',', value_parser = density, requires = "coherence")]
    densities: Option<Vec<f64>>,

    /// The seed of the masks of --coherence [default: 0]
    #[arg(long, value_name = "N", requires = "coherence")]
    seed: Option<u64>,

    /// Histogram of the DFT magnitudes of a frame and of its derivatives, as figure 3.2 of the thesis; -o FILE.png plots it: the image black, d/dx grey, d/dy light grey
    #[arg(long, value_name = "FRAME")]
    spectrum: Option<PathBuf>,

    /// Print JSON
    #[arg(long)]
    json: bool,

    /// A plot of the spectrum, a PNG image
    #[arg(short, long, value_name = "FILE.png", help_heading = "Output")]
    output: Option<PathBuf>,

    /// Make the output's folder where it is missing
    #[arg(long, requires = "output", help_heading = "Output")]
    create_dir: bool,

    /// Pass over an output that exists
    #[arg(long, requires = "output", help_heading = "Output")]
    no_clobber: bool,

    /// Threads in all; 0 takes what the machine, a cgroup limit and the batch system allow
    #[arg(long, value_name = "N", default_value_t = 0, help_heading = "Run")]
    threads: usize,

    /// Memory that the work may take: bytes, or with K, M, G, T (powers of 1024), for example 4G
    #[arg(long, value_name = "SIZE", allow_hyphen_values = true, help_heading = "Run")]
    memory: Option<Bytes>,

    #[command(flatten)]
    speech: SpeechArgs,
}

impl AnalyzeArgs {
    /// The checked job.
    pub fn job(&self) -> Result<MaskJob, Usage> {
        let mask = self.mask.as_ref().map(|mask| file("MASK", mask)).transpose()?;
        if mask.is_none() && !self.coherence && self.spectrum.is_none() {
            return Err(Usage(
                "what to measure is not said: give a mask, --coherence or --spectrum FRAME".into(),
            ));
        }
        if self.output.is_some() && mask.is_none() && self.spectrum.is_none() {
            let line = "-o plots a spectrum: give a mask or --spectrum FRAME; --coherence prints";
            return Err(Usage(line.into()));
        }
        if self.output.is_some() && mask.is_some() && self.spectrum.is_some() {
            return Err(Usage(
                "-o is one plot: give it with a mask or with --spectrum FRAME, not with both".into(),
            ));
        }
        let is_png = |path: &PathBuf| path.extension().is_some_and(|end| end.eq_ignore_ascii_case("png"));
        if let Some(path) = self.output.as_ref().filter(|path| !is_png(path)) {
            return Err(Usage(format!("{}: the plot is a PNG image, -o FILE.png", path.display())));
        }
        let plot = self.output.clone().map(|path| MaskOutput {
            path,
            create_dir: self.create_dir,
            no_clobber: self.no_clobber,
            overhead: CROP_OVERHEAD,
        });
        let densities = || (1..10).map(|tenths| f64::from(tenths) / 10.0).collect();
        let densities =
            if self.coherence { self.densities.clone().unwrap_or_else(densities) } else { Vec::new() };
        let task = MaskTask::Measure {
            mask,
            coherence: densities,
            spectrum: self.spectrum.clone(),
            seed: self.seed.unwrap_or(0),
            plot,
            json: self.json,
        };
        let memory = self.memory.map(|bytes| bytes.0).or_else(granted_memory);
        Ok(MaskJob { task, threads: self.threads, memory, verbosity: self.speech.verbosity() })
    }
}
