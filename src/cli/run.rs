//! Flags that say how the work runs and what is said about it; none of them changes a bit of a result.

use std::path::PathBuf;
use std::str::FromStr;
use std::time::Duration;

use clap::{ArgAction, Args, ValueEnum};

use crate::run::{Meter, RunOptions, Verbosity, granted_memory};

// Not a comment for rustdoc, which would read code into it.
const THREADS: &str =
    "Threads in all; 0 takes what the machine, a cgroup limit and SLURM_CPUS_PER_TASK allow";

/// How to run.
#[derive(Args, Clone, Debug)]
#[command(next_help_heading = "Run")]
pub struct RunArgs {
    #[arg(long, value_name = "N", default_value_t = 0, value_parser = threads)]
    #[arg(allow_hyphen_values = true, help = THREADS)]
    #[allow(missing_docs, reason = "the help is a constant")]
    pub threads: usize,

    /// Frames computed at the same time, 1 or more; reading and writing overlap with it anyway
    #[arg(long, value_name = "N", default_value = "1", value_parser = frames, allow_hyphen_values = true)]
    pub parallel_frames: u16,

    /// Memory that frames on the way may use together: bytes, or with K, M, G, T (powers of 1024), for example 4G;
    /// a frame that alone needs more is refused [default: what Slurm granted; elsewhere no bound together, and reading one
    /// frame takes 1.5G at most]
    #[arg(long, value_name = "SIZE", allow_hyphen_values = true)]
    pub memory: Option<Bytes>,

    /// Print the plan (input, output, what would be done) and change nothing
    #[arg(short = 'n', long)]
    pub dry_run: bool,

    #[command(flatten)]
    #[allow(
        missing_docs,
        reason = "rustdoc on a flattened group would become the help of the whole subcommand"
    )]
    pub speech: SpeechArgs,

    /// Write a report as JSON (- is standard output): per frame files, state, seconds, warnings, and what the subcommand
    /// finds out (density, iterations, measures ...)
    #[arg(long, value_name = "FILE")]
    pub json: Option<PathBuf>,

    /// Append to a ledger that many runs may share, one line of JSON for each frame when it is through: state, hashes of input
    /// and output, settings, seconds, host, time
    #[arg(long, value_name = "FILE")]
    pub log: Option<PathBuf>,

    /// How progress is told
    #[arg(long, value_name = "HOW", default_value = "auto")]
    pub progress: ProgressName,
}

/// How long a solver may run.
#[derive(Args, Clone, Debug)]
#[command(next_help_heading = "Run")]
pub struct SolveArgs {
    /// Seconds that solving one frame may take, above 0; then its best image so far is written and the report says so
    /// [default: no limit]
    #[arg(long, value_name = "SECONDS", value_parser = seconds, allow_hyphen_values = true)]
    pub time_limit: Option<Duration>,
}

/// How progress is told.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
pub enum ProgressName {
    /// A bar on a terminal, else plain lines, one in a second at most, none with -q
    Auto,
    /// Lines such as Progress: 45% on standard error, each percent, as Deadline reads them
    Plain,
    /// Lines of Open Job Description (progress, status, fail) on standard output
    Openjd,
    /// None
    None,
}

impl From<ProgressName> for Meter {
    fn from(name: ProgressName) -> Self {
        match name {
            ProgressName::Auto => Self::Auto,
            ProgressName::Plain => Self::Plain,
            ProgressName::Openjd => Self::OpenJd,
            ProgressName::None => Self::None,
        }
    }
}

/// A page for people.
#[derive(Args, Clone, Debug)]
#[command(next_help_heading = "Run")]
pub struct PageArgs {
    /// Write one HTML page (- is standard output) that needs no other file and no network: mask, sparse input and result of
    /// each frame, density, timings
    #[arg(long, value_name = "FILE")]
    pub report: Option<PathBuf>,
}

/// What is said.
#[derive(Args, Clone, Debug)]
#[command(next_help_heading = "Run")]
pub struct SpeechArgs {
    /// Say nothing but errors
    #[arg(short, long, conflicts_with = "verbose")]
    pub quiet: bool,

    /// Say more: a line for every frame
    #[arg(short, long, action = ArgAction::Count)]
    pub verbose: u8,
}

impl SpeechArgs {
    /// How much is said.
    pub fn verbosity(&self) -> Verbosity {
        match (self.quiet, self.verbose) {
            (true, _) => Verbosity::Quiet,
            (false, 0) => Verbosity::Normal,
            (false, _) => Verbosity::Verbose,
        }
    }
}

impl RunArgs {
    /// The checked options.
    pub fn options(&self) -> RunOptions {
        RunOptions {
            threads: self.threads,
            parallel_frames: self.parallel_frames.into(),
            memory: self.memory.map(|bytes| bytes.0).or_else(granted_memory),
            time_limit: None,
            dry_run: self.dry_run,
            verbosity: self.speech.verbosity(),
            json: self.json.clone(),
            log: self.log.clone(),
            meter: self.progress.into(),
            page: None,
        }
    }
}

/// A number of bytes.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Bytes(pub u64);

impl FromStr for Bytes {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        let digits = text.trim_end_matches(|c: char| c.is_ascii_alphabetic());
        let shift = match text[digits.len()..].to_ascii_lowercase().as_str() {
            "" | "b" => 0,
            "k" | "kb" | "kib" => 10,
            "m" | "mb" | "mib" => 20,
            "g" | "gb" | "gib" => 30,
            "t" | "tb" | "tib" => 40,
            _ => return Err("not a size such as 4G, 512M or 1.5G".into()),
        };
        let number: f64 = digits.trim().parse().map_err(|_| "not a size such as 4G, 512M or 1.5G")?;
        let bytes =
            number * f64::from(1_u32 << (shift % 30)) * if shift >= 30 { f64::from(1 << 30) } else { 1.0 };
        if bytes >= 1.0 && bytes < 2_f64.powi(60) {
            Ok(Self(bytes as u64))
        } else {
            Err("it must be a size above 0, such as 4G, 512M or 1.5G".into())
        }
    }
}

fn seconds(text: &str) -> Result<Duration, String> {
    let seconds = text.parse().ok().filter(|seconds| *seconds > 0.0);
    let time = seconds.and_then(|seconds| Duration::try_from_secs_f64(seconds).ok());
    time.ok_or_else(|| "it must be a number of seconds above 0; without --time-limit there is none".into())
}

fn threads(text: &str) -> Result<usize, String> {
    text.parse().map_err(|_| "it must be a whole number: 0 for all that the machine allows, or more".into())
}

fn frames(text: &str) -> Result<u16, String> {
    let number = text.parse().ok().filter(|number| *number >= 1);
    number.ok_or_else(|| format!("it must be a whole number from 1 to {}", u16::MAX))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn sizes_are_read_as_powers_of_1024() {
        let bytes = |text: &str| text.parse::<Bytes>().map(|bytes| bytes.0);
        assert_eq!(bytes("123"), Ok(123));
        assert_eq!(bytes("2K"), Ok(2 << 10));
        assert_eq!(bytes("512m"), Ok(512 << 20));
        assert_eq!(bytes("1.5G"), Ok(3 << 29));
        assert_eq!(bytes("4GiB"), Ok(4 << 30));
        assert_eq!(bytes("2T"), Ok(2 << 40));
        for nonsense in ["", "G", "0", "-1G", "4X", "nan", "infT", "1e30"] {
            assert!(bytes(nonsense).is_err(), "{nonsense}");
        }
    }
}
