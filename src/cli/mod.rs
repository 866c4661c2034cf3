//! The command line: flags become a checked job; no work is done here.
//!
//! Groups of flags that several subcommands share have a file each ([`input`], [`mask`], `channels`, [`filter`], `settings`,
//! [`output`], [`run`]), so that a flag means the same everywhere; so has each subcommand.

pub mod adaptive;
pub mod analyze;
mod channels;
pub mod compare;
pub mod dictionary;
mod estimate;
pub mod fill;
pub mod filter;
pub mod filters;
mod foreign;
mod guides;
mod help;
pub mod info;
pub mod input;
mod layers;
pub mod manual;
pub mod mask;
mod mask_source;
pub mod noise;
mod numbers;
pub mod output;
mod renamed;
pub mod render;
pub mod run;
mod settings;
pub mod sparsify;
pub mod study;
pub mod submit;
pub mod temporal;
pub mod train;
pub mod upscale;
pub mod verify;
mod weights;
mod words;

use std::ffi::OsString;

use clap::error::{ContextKind, ContextValue, ErrorKind};
use clap::{FromArgMatches, Parser, Subcommand};

use crate::commands::{
    CompareJob, DictionaryJob, FillJob, InfoJob, ManualJob, MaskJob, RenderJob, SparsifyJob, StudyJob,
    TrainJob, VerifyJob,
};
use crate::submit::SubmitJob;

/// A command line that contradicts itself: exit status 2.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[error("{0}")]
pub struct Usage(pub String);

/// Fills the pixels that a renderer skipped: sparse EXR frames in, complete EXR frames out.
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
    Upscale(Box<upscale::UpscaleArgs>),
    Info(info::InfoArgs),
    Verify(verify::VerifyArgs),
    Compare(Box<compare::CompareArgs>),
    Study(study::StudyArgs),
    Sparsify(sparsify::SparsifyArgs),
    Render(Box<render::RenderArgs>),
    Mask(Box<mask::MakeMaskArgs>),
    Analyze(Box<analyze::AnalyzeArgs>),
    Submit(submit::SubmitArgs),
    Dictionary(dictionary::DictionaryArgs),
    Filters(filters::FiltersArgs),
    Completions(manual::CompletionsArgs),
    Manual(manual::ManualArgs),
}

/// What is to be done.
#[derive(Clone, Debug, PartialEq)]
pub enum Job {
    /// Fill frames, and enlarge them if the job says so.
    Fill(Box<FillJob>),
    /// Describe a frame.
    Info(InfoJob),
    /// Compare filled frames with the sparse ones.
    Verify(VerifyJob),
    /// Compare frames with their references.
    Compare(Box<CompareJob>),
    /// Compare filters with each other.
    Study(Box<StudyJob>),
    /// Make sparse frames.
    Sparsify(SparsifyJob),
    /// Render a volume.
    Render(Box<RenderJob>),
    /// Make, unite or measure masks.
    Mask(Box<MaskJob>),
    /// Give a sequence to a farm.
    Submit(Box<SubmitJob>),
    /// Learn a dictionary.
    Train(Box<TrainJob>),
    /// Use one on single files; the name of the subcommand.
    Dictionary(&'static str, Box<DictionaryJob>),
    /// Install man pages and completions.
    Manual(Box<ManualJob>),
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
        Self::Usage(format!("lacuna: error: {line} (see 'lacuna {subcommand} --help')\n"))
    }

    /// The exit status.
    pub const fn status(&self) -> u8 {
        match self {
            Self::Shown(_) => 0,
            Self::Usage(_) => 2,
        }
    }
}

/// What clap says of a command line. A log has lines, not paragraphs: the reason, clap's tip, and where to look instead of the
/// usage.
fn ending(mut error: clap::Error, words: &[OsString]) -> Ending {
    match error.kind() {
        ErrorKind::DisplayHelp | ErrorKind::DisplayVersion => {
            return Ending::Shown(error.render().to_string());
        }
        ErrorKind::DisplayHelpOnMissingArgumentOrSubcommand => {
            return Ending::Usage(error.render().to_string());
        }
        _ => {}
    }
    let (mut command, mut help) = (help::command(), String::from("lacuna"));
    for word in words.iter().skip(1) {
        let Some(inner) = command.find_subcommand(word).cloned() else { break };
        help = format!("{help} {}", inner.get_name());
        command = inner;
    }
    let hint = match (error.kind(), error.get(ContextKind::InvalidArg)) {
        (ErrorKind::InvalidSubcommand, _) if help == "lacuna submit" => {
            Some("the farm's manager comes first: lacuna submit slurm -- fill ...".into())
        }
        (ErrorKind::UnknownArgument, Some(ContextValue::String(flag))) => {
            let of_task = help == "lacuna submit slurm" && is_flag_of(&help::command(), "fill", flag);
            let after = of_task.then(|| "flags of the command that is submitted stand behind --".to_owned());
            after.or_else(|| foreign::hint(flag, &command))
        }
        _ => None,
    };
    without_useless_tips(&mut error, hint.is_some());
    let text = error.render().to_string();
    let reason = ["\n\nUsage:", "\n\nFor more information"]
        .into_iter()
        .fold(text.as_str(), |text, end| text.split_once(end).map_or(text, |(before, _)| before));
    let reason: Vec<&str> = reason.trim_start_matches("error: ").split_whitespace().collect();
    let hint = hint.map_or_else(String::new, |hint| format!("; {hint}"));
    let reason = reason.join(" ").replace(" tip: ", "; ");
    Ending::Usage(format!("lacuna: error: {reason}{hint} (see '{help} --help')\n"))
}

fn is_flag_of(lacuna: &clap::Command, subcommand: &str, flag: &str) -> bool {
    let of = lacuna.find_subcommand(subcommand);
    of.is_some_and(|command| command.get_arguments().any(|arg| arg.get_long() == flag.strip_prefix("--")))
}

/// Leaves out how a misspelt flag would be taken for a file's name, and, where a better hint is known, flags that look alike.
fn without_useless_tips(error: &mut clap::Error, is_known: bool) {
    if is_known {
        error.remove(ContextKind::SuggestedArg);
    }
    if let Some(ContextValue::StyledStrs(mut tips)) = error.remove(ContextKind::Suggested) {
        tips.retain(|tip| !is_known && !tip.to_string().starts_with("to pass "));
        if !tips.is_empty() {
            error.insert(ContextKind::Suggested, ContextValue::StyledStrs(tips));
        }
    }
}

/// Whether a command line, good or not, asks for the lines of Open Job Description.
pub fn tells_openjd(words: &[OsString]) -> bool {
    let own: Vec<&str> =
        words.iter().map(|word| word.to_str().unwrap_or_default()).take_while(|word| *word != "--").collect();
    let after = own.iter().zip(own.iter().skip(1));
    let named = after.filter_map(|(flag, value)| (*flag == "--progress").then_some(*value));
    named.chain(own.iter().filter_map(|word| word.strip_prefix("--progress="))).any(|how| how == "openjd")
}

/// Reads a command line, the program's name first.
///
/// # Errors
/// What the user asked to see (help, version) or got wrong.
pub fn parse(words: impl IntoIterator<Item = OsString>) -> Result<Job, Ending> {
    let words: Vec<OsString> = words.into_iter().collect();
    if let Some(line) = renamed::line(&words) {
        return Err(Ending::Usage(format!("lacuna: error: {line}\n")));
    }
    let read = help::command().try_get_matches_from(&words).and_then(|found| Cli::from_arg_matches(&found));
    let command = read.map_err(|error| ending(error, &words))?.command;
    let (name, job) = match &command {
        Command::Fill(args) => ("fill", args.job().map(|job| Job::Fill(Box::new(job)))),
        Command::Upscale(args) => ("upscale", args.job().map(|job| Job::Fill(Box::new(job)))),
        Command::Info(args) => ("info", args.job().map(Job::Info)),
        Command::Verify(args) => ("verify", Ok(Job::Verify(args.job()))),
        Command::Compare(args) => ("compare", args.job().map(|job| Job::Compare(Box::new(job)))),
        Command::Study(args) => ("study", args.job().map(|job| Job::Study(Box::new(job)))),
        Command::Sparsify(args) => ("sparsify", args.job().map(Job::Sparsify)),
        Command::Render(args) => ("render", args.job().map(|job| Job::Render(Box::new(job)))),
        Command::Submit(args) => return args.job().map(|job| Job::Submit(Box::new(job))),
        Command::Mask(args) => ("mask", args.job().map(|job| Job::Mask(Box::new(job)))),
        Command::Analyze(args) => ("analyze", args.job().map(|job| Job::Mask(Box::new(job)))),
        Command::Dictionary(args) => args.job(),
        Command::Filters(args) => return Err(Ending::Shown(args.text())),
        Command::Completions(args) => return Err(Ending::Shown(args.text())),
        Command::Manual(args) => ("manual", Ok(Job::Manual(Box::new(args.job())))),
    };
    job.map_err(|usage| Ending::usage(name, &usage.to_string()))
}

#[cfg(test)]
mod tests;
