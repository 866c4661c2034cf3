//! `lacuna dictionary`: flags to checked jobs; `train` has a file of its own.

use std::path::PathBuf;

use clap::{Args, Subcommand};

use super::numbers::{one_or_more, zero_or_more};
use super::output::called;
use super::run::{Bytes, SpeechArgs};
use super::train::TrainArgs;
use super::{Job, Usage};
use crate::commands::{DictionaryJob, DictionaryTask};
use crate::dictionary::code::Fineness;
use crate::run::granted_memory;

/// Learn dictionaries from complete frames, and use them to encode frames
#[derive(Args, Clone, Debug)]
#[command(arg_required_else_help = true)]
pub struct DictionaryArgs {
    #[command(subcommand)]
    command: Command,
}

#[derive(Subcommand, Clone, Debug)]
enum Command {
    Train(Box<TrainArgs>),
    Encode(EncodeArgs),
    Decode(DecodeArgs),
    Info(DictionaryInfoArgs),
}

impl DictionaryArgs {
    /// The checked job, and the name of its subcommand.
    pub fn job(&self) -> (&'static str, Result<Job, Usage>) {
        let of = |name, job: Result<DictionaryJob, Usage>| {
            (name, job.map(|job| Job::Dictionary(name, Box::new(job))))
        };
        match &self.command {
            Command::Train(args) => ("dictionary train", args.job().map(|job| Job::Train(Box::new(job)))),
            Command::Encode(args) => of("dictionary encode", Ok(args.job())),
            Command::Decode(args) => of("dictionary decode", args.job()),
            Command::Info(args) => of("dictionary info", args.job()),
        }
    }
}

/// How to run.
#[derive(Args, Clone, Debug)]
#[command(next_help_heading = "Run")]
struct FileRun {
    /// Threads in all; 0 takes what the machine allows
    #[arg(long, value_name = "N", default_value_t = 0)]
    threads: usize,

    /// Memory that what is read may take: bytes, or with K, M, G, T (powers of 1024) [default: what Slurm granted]
    #[arg(long, value_name = "SIZE", allow_hyphen_values = true)]
    memory: Option<Bytes>,

    #[command(flatten)]
    speech: SpeechArgs,
}

impl FileRun {
    fn job(&self, dictionary: &std::path::Path, task: DictionaryTask) -> DictionaryJob {
        let verbosity = self.speech.verbosity();
        let memory = self.memory.map(|bytes| bytes.0).or_else(granted_memory);
        DictionaryJob { dictionary: dictionary.into(), task, threads: self.threads, memory, verbosity }
    }
}

/// Write a frame's colour as few atoms of a dictionary
///
/// Prints the bytes, the bits per pixel and the PSNR of what decoding gives. Other channels and attributes are not kept.
#[derive(Args, Clone, Debug)]
#[command(next_help_heading = "Files")]
pub struct EncodeArgs {
    /// The frame
    #[arg(value_name = "FRAME")]
    input: PathBuf,

    /// The dictionary, a file of lacuna dictionary train
    #[arg(long, value_name = "FILE")]
    dictionary: PathBuf,

    /// The encoded frame
    #[arg(short, long, value_name = "FILE")]
    output: PathBuf,

    /// Atoms of a block at most, 1 or more
    #[arg(long, value_name = "L", default_value_t = 30, value_parser = one_or_more, allow_hyphen_values = true)]
    dict_sparsity: u32,

    /// Root mean squared error of a block at which no more atoms are taken, 0 or more
    #[arg(long, value_name = "ERROR", default_value_t = 0.0, value_parser = zero_or_more, allow_hyphen_values = true)]
    dict_error: f64,

    /// Bits of a factor, its sign included, 2 to 16
    #[arg(long, value_name = "N", default_value_t = 10, value_parser = clap::value_parser!(u8).range(2..=16))]
    bits: u8,

    #[command(flatten)]
    run: FileRun,
}

impl EncodeArgs {
    /// The checked job.
    pub fn job(&self) -> DictionaryJob {
        let how = Fineness {
            sparsity: self.dict_sparsity as usize,
            error: self.dict_error,
            bits: u32::from(self.bits),
        };
        let (input, output) = (self.input.clone(), self.output.clone());
        self.run.job(&self.dictionary, DictionaryTask::Encode { input, output, how })
    }
}

/// Make a frame of what lacuna dictionary encode wrote
#[derive(Args, Clone, Debug)]
#[command(next_help_heading = "Files")]
pub struct DecodeArgs {
    /// The encoded frame
    #[arg(value_name = "FILE")]
    input: PathBuf,

    /// The dictionary that it was encoded with
    #[arg(long, value_name = "FILE")]
    dictionary: PathBuf,

    /// The frame, an EXR file
    #[arg(short, long, value_name = "FRAME")]
    output: PathBuf,

    #[command(flatten)]
    run: FileRun,
}

impl DecodeArgs {
    /// The checked job.
    pub fn job(&self) -> Result<DictionaryJob, Usage> {
        let (input, output) = (self.input.clone(), called("-o", &self.output, "exr")?);
        Ok(self.run.job(&self.dictionary, DictionaryTask::Decode { input, output }))
    }
}

/// Describe a dictionary
///
/// Prints its size, training, how often atoms are used and how alike they are.
#[derive(Args, Clone, Debug)]
#[command(next_help_heading = "Files")]
pub struct DictionaryInfoArgs {
    /// The dictionary, a file of lacuna dictionary train
    #[arg(value_name = "FILE")]
    dictionary: PathBuf,

    /// Write a picture of the first 200 atoms, a PNG image: a panel a channel
    #[arg(long, value_name = "FILE")]
    png: Option<PathBuf>,

    #[command(flatten)]
    run: FileRun,
}

impl DictionaryInfoArgs {
    /// The checked job.
    pub fn job(&self) -> Result<DictionaryJob, Usage> {
        let png = self.png.as_ref().map(|path| called("--png", path, "png")).transpose()?;
        Ok(self.run.job(&self.dictionary, DictionaryTask::Info { png }))
    }
}
