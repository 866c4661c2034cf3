//! `lacuna study`: flags and the study's file to a checked job.

use std::ffi::OsString;
use std::path::PathBuf;

use clap::Args;
use clap::parser::ValueSource;
use lacuna_filters::METHODS;
use lacuna_filters::descriptor::Descriptor;
use lacuna_filters::fill::Estimate;

use super::run::SpeechArgs;
use super::{Ending, Job, Usage};
use crate::commands::StudyJob;
use crate::reconstruct;
use crate::study::{Definition, Entry};

const EXAMPLES: &str = "\
Examples:
  lacuna study samples/study/samples.toml -o out/study
  lacuna study samples/study/frames.toml -o out/study --threads 8

The same command goes on where an earlier run ended. A filter in the study's file is written as it follows --filter on
fill's command line, for example \"tv --tv-gap 1e-3\"; \"all\" is every filter that needs no file,
with its defaults.

Exit status: 0 all done, 1 some cell failed, 2 usage, 128 + n on signal n.";

/// Headings of flags that decide no result of a cell.
const UNUSED: [&str; 4] = ["Input and frames", "Output", "Run", "Estimated error"];

/// Compare filters on frames, patterns and densities: tables, figures and a page
///
/// Makes complete frames sparse, fills them as fill does, and measures the results: frames x patterns x densities x seeds x
/// filters. Writes into a folder results.jsonl (a line a cell, continued by later runs), results.csv, results.json, tables.md,
/// figures as SVG and report.html.
#[derive(Args, Clone, Debug)]
#[command(after_help = EXAMPLES)]
pub struct StudyArgs {
    /// The study's file, TOML (see docs/study.md)
    #[arg(value_name = "STUDY.toml", help_heading = "Input and frames")]
    definition: PathBuf,

    /// The folder for results, figures and report; it is made where it is missing
    #[arg(short, long, value_name = "DIR", help_heading = "Output")]
    output: PathBuf,

    /// Cells at the same time, each on one thread; 0 for as many as the machine allows
    #[arg(long, value_name = "N", default_value_t = 0, help_heading = "Run")]
    threads: usize,

    /// Print the cells that would be run and change nothing
    #[arg(short = 'n', long, help_heading = "Run")]
    dry_run: bool,

    #[command(flatten)]
    speech: SpeechArgs,
}

impl StudyArgs {
    /// The checked job.
    pub fn job(&self) -> Result<StudyJob, Usage> {
        let at = |error: String| Usage(format!("{}: {error}", self.definition.display()));
        let mut definition = Definition::read(&self.definition).map_err(|error| at(error.to_string()))?;
        for sheet in &mut definition.sheets {
            sheet.filters = sheet.filters.iter().flat_map(|label| labels(label, METHODS)).collect();
        }
        let mut entries: Vec<Entry> = Vec::new();
        for label in definition.filters.iter().flat_map(|label| labels(label, METHODS)) {
            if entries.iter().all(|entry| entry.label != label) {
                entries.push(entry(label).map_err(|usage| at(usage.0))?);
            }
        }
        Ok(StudyJob {
            definition,
            folder: self.definition.parent().map(PathBuf::from).unwrap_or_default(),
            entries,
            output: self.output.clone(),
            threads: self.threads,
            dry_run: self.dry_run,
            verbosity: self.speech.verbosity(),
        })
    }
}

/// The label itself, or every filter that needs no file for `all`.
pub(super) fn labels(label: &str, methods: &[&Descriptor]) -> Vec<String> {
    if label != "all" {
        return vec![label.to_owned()];
    }
    methods.iter().filter(|method| !method.takes.dictionary).map(|method| method.name.into()).collect()
}

/// A filter as `fill` would have it.
fn entry(label: String) -> Result<Entry, Usage> {
    // The frames' names are of no account.
    let fixed = ["lacuna", "fill", "study.exr", "-o", "filled.exr", "--filter"];
    let words = || fixed.into_iter().chain(label.split_whitespace()).map(OsString::from);
    match super::parse(words()) {
        Ok(Job::Fill(job)) if job.run.time_limit.is_some() => {
            Err(Usage(format!("filter '{label}': --time-limit depends on the machine: leave it away")))
        }
        Ok(Job::Fill(job)) => {
            if let Some(unused) = unused(words()) {
                return Err(Usage(format!(
                    "filter '{label}': a study has no use for {unused}: leave it away"
                )));
            }
            // An estimate would count as time of the filter.
            let job = reconstruct::Job { estimate: Estimate::No, error_channel: None, ..job.what };
            Ok(Entry { label, job })
        }
        Ok(_) => Err(Usage(format!("filter '{label}' is none"))),
        Err(Ending::Shown(text) | Ending::Usage(text)) => {
            let line = text.lines().next().unwrap_or_default();
            let line = line.strip_prefix("lacuna: error: ").unwrap_or(line);
            Err(Usage(format!("filter '{label}': {line}")))
        }
    }
}

/// What is in `fill`'s words that decides no result of a cell: flags by their headings, and further inputs.
fn unused(words: impl Iterator<Item = OsString>) -> Option<String> {
    let lacuna = super::help::command();
    let fill = lacuna.find_subcommand("fill")?;
    let found = lacuna.clone().try_get_matches_from(words).ok()?;
    let found = found.subcommand_matches("fill")?;
    let is_unused = |arg: &&clap::Arg| match arg.get_id().as_str() {
        "output" | "inputs" | "data_type" | "memory" => false,
        "again" | "guides_from" => true,
        _ => arg.get_help_heading().is_some_and(|heading| UNUSED.contains(&heading)),
    };
    let given =
        |arg: &&clap::Arg| found.value_source(arg.get_id().as_str()) == Some(ValueSource::CommandLine);
    let mut flags = fill.get_arguments().filter(is_unused).filter(given);
    let flag = flags.find_map(|arg| Some(format!("--{}", arg.get_long()?)));
    let inputs = || found.get_many::<PathBuf>("inputs")?.nth(1);
    flag.or_else(|| Some(format!("'{}'", inputs()?.display())))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn filters_are_read_as_fill_reads_them() {
        let found = entry("tv --tv-gap 1e-3 --limit off".into()).unwrap();
        assert_eq!((found.job.method.name(), found.job.limit), ("tv", false));
        assert_eq!(found.job.estimate, Estimate::No);
        for (label, reason) in [
            ("nothing", "nothing"),
            ("ss --tv-gap 1e-3", "--tv-gap is a setting of --filter tv"),
            ("", "filter ''"),
            ("ss --ss-lambda x", "--ss-lambda"),
            ("tv --time-limit 2", "--time-limit depends on the machine"),
            ("ss --guides-from a.exr", "no use for --guides-from"),
            ("ss --layers a=b.####.exr", "no use for --layers"),
            ("ss --frames 1-3", "no use for --frames"),
            ("ss -n", "no use for --dry-run"),
            ("ss --json -", "no use for --json"),
            ("ss --report a.html", "no use for --report"),
            ("ss --error-channel error", "no use for --error-channel"),
            ("ss --again", "no use for --again"),
            ("ss other.exr", "no use for 'other.exr'"),
        ] {
            let error = entry(label.into()).unwrap_err().0;
            assert!(error.contains(reason) && !error.contains('\n'), "{error}");
        }
    }

    #[test]
    fn all_is_every_filter_of_the_command_line_that_needs_no_file() {
        let all = labels("all", METHODS);
        assert!(["ss", "tv", "linear", "cubic"].iter().all(|name| all.iter().any(|found| found == name)));
        assert_eq!(all.len(), METHODS.len() - 1);
        for label in all {
            assert_eq!(entry(label.clone()).unwrap().job.method.name(), label);
        }
    }
}
