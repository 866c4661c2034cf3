//! The command line: flags become a checked job; no work is done here.
//!
//! Groups of flags that several subcommands share have a file each ([`input`], [`mask`], [`channels`], [`filter`],
//! [`output`], [`run`]), so that a flag means the same everywhere; so has each subcommand.

pub mod channels;
pub mod compare;
pub mod fill;
pub mod filter;
mod guides;
pub mod info;
pub mod input;
pub mod make_mask;
pub mod mask;
pub mod output;
pub mod render;
pub mod run;
pub mod sparsify;
pub mod verify;

use std::ffi::OsString;

use clap::error::ErrorKind;
use clap::{Parser, Subcommand};

use crate::sequence::{CompareJob, FillJob, InfoJob, MaskJob, RenderJob, SparsifyJob, VerifyJob};

/// A command line that contradicts itself: exit status 2.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[error("{0}")]
pub struct Usage(pub String);

/// lacuna fills the pixels that a renderer skipped: sparse EXR frames in, complete EXR frames out.
#[derive(Parser, Clone, Debug)]
#[command(name = "lacuna", version, max_term_width = 110)]
#[command(args_override_self = true)]
#[command(after_help = "Exit status: 0 all done, 1 some frame failed, 2 usage, 128 + n on signal n.")]
struct Cli {
    #[command(subcommand)]
    command: Command,
}

#[derive(Subcommand, Clone, Debug)]
enum Command {
    Fill(Box<fill::FillArgs>),
    Info(info::InfoArgs),
    Verify(verify::VerifyArgs),
    Compare(Box<compare::CompareArgs>),
    Sparsify(sparsify::SparsifyArgs),
    Render(Box<render::RenderArgs>),
    Mask(Box<make_mask::MakeMaskArgs>),
}

/// What is to be done.
#[derive(Clone, Debug, PartialEq)]
pub enum Job {
    /// Fill frames.
    Fill(Box<FillJob>),
    /// Describe a frame.
    Info(InfoJob),
    /// Compare filled frames with the sparse ones.
    Verify(VerifyJob),
    /// Compare frames with their references.
    Compare(Box<CompareJob>),
    /// Make sparse frames.
    Sparsify(SparsifyJob),
    /// Render a volume.
    Render(Box<RenderJob>),
    /// Make, unite or measure masks.
    Mask(Box<MaskJob>),
}

/// Why a command line is no job.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Ending {
    /// Help or version, for standard output; exit status 0.
    Shown(String),
    /// What is wrong, for standard error; exit status 2.
    Usage(String),
}

impl Ending {
    /// A usage error of a subcommand: one line and where to look.
    pub fn usage(subcommand: &str, text: &str) -> Self {
        let line = text.replace(|c: char| c.is_control(), " ");
        Self::Usage(format!(
            "lacuna: error: {line}\n\nFor more information, try 'lacuna {subcommand} --help'.\n"
        ))
    }

    /// The exit status.
    pub const fn status(&self) -> u8 {
        match self {
            Self::Shown(_) => 0,
            Self::Usage(_) => 2,
        }
    }
}

impl From<clap::Error> for Ending {
    fn from(error: clap::Error) -> Self {
        if matches!(error.kind(), ErrorKind::DisplayHelp | ErrorKind::DisplayVersion) {
            return Self::Shown(error.render().to_string());
        }
        let text = error.render().to_string();
        match text.strip_prefix("error: ") {
            Some(rest) => Self::Usage(format!("lacuna: error: {rest}")),
            None => Self::Usage(text),
        }
    }
}

/// Reads a command line, the program's name first.
///
/// # Errors
/// What the user asked to see (help, version) or got wrong.
pub fn parse(words: impl IntoIterator<Item = OsString>) -> Result<Job, Ending> {
    let command = Cli::try_parse_from(words)?.command;
    let (name, job) = match &command {
        Command::Fill(args) => ("fill", args.job().map(|job| Job::Fill(Box::new(job)))),
        Command::Info(args) => ("info", Ok(Job::Info(args.job()))),
        Command::Verify(args) => ("verify", Ok(Job::Verify(args.job()))),
        Command::Compare(args) => ("compare", args.job().map(|job| Job::Compare(Box::new(job)))),
        Command::Sparsify(args) => ("sparsify", args.job().map(Job::Sparsify)),
        Command::Render(args) => ("render", args.job().map(|job| Job::Render(Box::new(job)))),
        Command::Mask(args) => ("mask", args.job().map(|job| Job::Mask(Box::new(job)))),
    };
    job.map_err(|usage| Ending::usage(name, &usage.to_string()))
}

#[cfg(test)]
mod tests;
