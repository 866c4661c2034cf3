//! Flags of the filters `dictionary` and `dct`; `lacuna encode`, `decode` and `dictionary-info`: flags to checked jobs.

use std::path::PathBuf;
use std::sync::Arc;

use clap::Args;
use lacuna_filters::dictionary::fill::{Cosines, Learned, Use};

use super::Usage;
use super::filter::{Name, one_or_more, set, zero_or_more};
use super::output::called;
use super::run::SpeechArgs;
use crate::commands::{DictionaryJob, DictionaryTask};
use crate::dictionary::Stored;
use crate::dictionary::code::Fineness;

/// Settings of `dictionary` and `dct`.
#[derive(Args, Clone, Debug, Default)]
#[command(next_help_heading = "Filter")]
pub struct DictionaryArgs {
    /// dictionary: the file that lacuna train made
    #[arg(long, value_name = "FILE")]
    pub dictionary: Option<PathBuf>,

    /// dictionary, dct: atoms of a block at most, 1 or more, and never more than a third of its measured values; larger follows
    /// the samples closer [default: 30]
    #[arg(long, value_name = "L", value_parser = one_or_more, allow_hyphen_values = true)]
    pub dict_sparsity: Option<u32>,

    /// dictionary, dct: root mean squared error of a block's measured values at which no more atoms are taken, 0 or more; larger is
    /// smoother [default: 0]
    #[arg(long, value_name = "ERROR", value_parser = zero_or_more, allow_hyphen_values = true)]
    pub dict_error: Option<f64>,

    /// dictionary, dct: pixels from block to block, 1 to the block; smaller is better and slower, the block itself is what the
    /// thesis has [default: half a block]
    #[arg(long, value_name = "N", value_parser = one_or_more, allow_hyphen_values = true)]
    pub dict_stride: Option<u32>,

    /// dictionary, dct: measured pixels leave as approximated, too, instead of as they came; also where none is missing
    #[arg(long)]
    pub dict_restore: bool,
}

impl DictionaryArgs {
    /// The flags that were given and belong to neither of these filters.
    pub fn check(&self, filter: Name) -> Result<(), Usage> {
        let both = matches!(filter, Name::Dictionary | Name::Dct);
        let given = [
            ("--dict-sparsity", self.dict_sparsity.is_some()),
            ("--dict-error", self.dict_error.is_some()),
            ("--dict-stride", self.dict_stride.is_some()),
            ("--dict-restore", self.dict_restore),
        ];
        if let Some((flag, _)) = given.iter().find(|(_, given)| *given && !both) {
            return Err(Usage(format!("{flag} is a setting of --filter dictionary and --filter dct")));
        }
        match (&self.dictionary, filter) {
            (None, Name::Dictionary) => Err(Usage(
                "--filter dictionary needs --dictionary FILE; lacuna train makes one from complete frames"
                    .into(),
            )),
            (Some(_), filter) if filter != Name::Dictionary => {
                Err(Usage("--dictionary is a setting of --filter dictionary".into()))
            }
            _ => Ok(()),
        }
    }

    fn how(&self) -> Use {
        let mut how = Use::default();
        set(&mut how.sparsity, self.dict_sparsity.map(|count| count as usize));
        set(&mut how.error, self.dict_error);
        how.stride = self.dict_stride.map(|stride| stride as usize);
        how.restore = self.dict_restore;
        how
    }

    /// The settings of `dictionary`; reads the file.
    pub fn learned(&self) -> Result<Learned, Usage> {
        let path = self.dictionary.clone().unwrap_or_default();
        let failed =
            |error: &dyn std::fmt::Display| Usage(format!("--dictionary {}: {error}", path.display()));
        let stored = Stored::read(&path).map_err(|error| failed(&error))?;
        let how = self.how();
        let block = stored.dictionary.block();
        if how.stride.is_some_and(|stride| stride > block) {
            return Err(Usage(format!(
                "--dict-stride is more than the dictionary's block of {block} pixels"
            )));
        }
        Ok(Learned { name: stored.name(), dictionary: Arc::new(stored.dictionary), how })
    }

    /// The settings of `dct`.
    pub fn cosines(&self) -> Result<Cosines, Usage> {
        let cosines = Cosines { how: self.how(), ..Cosines::default() };
        if cosines.how.stride.is_some_and(|stride| stride > cosines.block) {
            return Err(Usage(format!("--dict-stride is more than the block of {} pixels", cosines.block)));
        }
        Ok(cosines)
    }
}

/// How to run.
#[derive(Args, Clone, Debug)]
#[command(next_help_heading = "Run")]
struct FileRun {
    /// Threads in all; 0 takes what the machine allows
    #[arg(long, value_name = "N", default_value_t = 0)]
    threads: usize,

    #[command(flatten)]
    speech: SpeechArgs,
}

impl FileRun {
    fn job(&self, dictionary: &std::path::Path, task: DictionaryTask) -> DictionaryJob {
        let verbosity = self.speech.verbosity();
        DictionaryJob { dictionary: dictionary.into(), task, threads: self.threads, verbosity }
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

    /// The dictionary, a file of lacuna train
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

/// Make a frame of what lacuna encode wrote
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
    /// The dictionary, a file of lacuna train
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
