//! `lacuna submit`: flags and the command behind them to a checked job.

use std::ffi::OsString;
use std::fmt::Display;
use std::path::{Path, PathBuf};

use clap::{Args, Subcommand};

use super::{Ending, Job, parse};
use crate::commands::{FillJob, RenderJob};
use crate::files::plan::pair;
use crate::files::ranges::RangeError;
use crate::files::{PlanError, Selection, frame_numbers};
use crate::mask::Source;
use crate::report::Bound;
use crate::run::RunOptions;
use crate::submit::{Grant, Reference, SubmitJob, Task, ranges};

const EXAMPLES: &str = "\
Examples:
  lacuna submit slurm -- fill 'shot.####.exr' -o full/ --create-dir
  lacuna submit slurm --chunk 8 --cpus 4 --mem 8G -n -- fill 'in/*.exr' -o full/
  lacuna submit slurm --reference 't/s.#.exr' -- fill 's.#.exr' -o full/
  lacuna submit slurm -- upscale 'small.#.exr' -o 'large.#.exr' --scale 2

Each job is told on a line: what it is, and its number. docs/farm.md has the rest.

Exit status: 0 all submitted, 1 not, 2 usage.";

/// Submit a sequence to a farm
#[derive(Args, Clone, Debug)]
#[command(arg_required_else_help = true)]
pub struct SubmitArgs {
    #[command(subcommand)]
    manager: Manager,
}

#[derive(Subcommand, Clone, Debug)]
enum Manager {
    Slurm(Box<SlurmArgs>),
}

/// Submit an array job of chunks to Slurm, and gates that wait for it
///
/// Every task runs the command on its chunk, passes over frames that are done (so that a second submission does the rest
/// only), appends to the ledger LOGS/NAME.jsonl and writes its log beside it. A task whose node is lost is requeued. Then
/// verify checks all frames (for upscale, render and fill --layers: that every output is there, whole and up to date), and compare
/// holds them against a reference if there is one; both wait as long as a task has failed.
#[derive(Args, Clone, Debug)]
#[command(after_help = EXAMPLES)]
struct SlurmArgs {
    /// Frames of a task, 1 or more
    #[arg(long, value_name = "N", default_value = "10", value_parser = clap::value_parser!(u32).range(1..))]
    chunk: u32,

    /// Processors of a task, 1 or more; lacuna takes as many threads
    #[arg(long, value_name = "N", default_value = "1", value_parser = clap::value_parser!(u32).range(1..))]
    cpus: u32,

    /// Memory of a task, such as 4G; lacuna keeps within it [default: the partition's]
    #[arg(long, value_name = "SIZE", value_parser = size)]
    mem: Option<String>,

    /// Wall time of a task, such as 1:30:00 [default: the partition's]
    #[arg(long, value_name = "TIME", value_parser = wall_time)]
    time: Option<String>,

    /// The partition [default: Slurm's]
    #[arg(long, value_name = "NAME", value_parser = word)]
    partition: Option<String>,

    /// Tasks that run at the same time, at most [default: no bound]
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u32).range(1..))]
    at_once: Option<u32>,

    /// Another option of sbatch, such as --sbatch=--account=show; may be given again
    #[arg(long, value_name = "OPTION", value_parser = option, allow_hyphen_values = true)]
    sbatch: Vec<String>,

    /// The name that jobs, scripts, logs and ledger begin with
    #[arg(long, value_name = "NAME", default_value = "lacuna", value_parser = word)]
    name: String,

    /// Folder of scripts, logs and ledger, which all nodes see; made if it is missing
    #[arg(long, value_name = "DIR", default_value = "lacuna-logs", value_parser = folder)]
    logs: PathBuf,

    /// Do not check the frames when all tasks are through
    #[arg(long)]
    no_verify: bool,

    /// Compare the frames with these when they are checked: a pattern or a glob, as compare's REFERENCE
    #[arg(long, value_name = "REFERENCE")]
    reference: Option<String>,

    /// Bounds of that comparison, as in compare: psnr=40,missing.ssim=0.98
    #[arg(long, value_name = "BOUNDS", value_delimiter = ',', value_parser = bound, requires = "reference")]
    fail_below: Vec<String>,

    /// The same for measures above their bounds: flip=0.05
    #[arg(long, value_name = "BOUNDS", value_delimiter = ',', value_parser = bound, requires = "reference")]
    fail_above: Vec<String>,

    /// The program that tasks run [default: this one, by its full path]
    #[arg(long, value_name = "FILE")]
    lacuna: Option<PathBuf>,

    /// Print the scripts and submit nothing
    #[arg(short = 'n', long)]
    dry_run: bool,

    /// fill, upscale or render with its flags
    #[arg(value_name = "COMMAND", required = true, last = true)]
    command: Vec<String>,
}

impl SubmitArgs {
    /// The checked job.
    pub fn job(&self) -> Result<SubmitJob, Ending> {
        let Manager::Slurm(args) = &self.manager;
        args.job()
    }
}

impl SlurmArgs {
    fn job(&self) -> Result<SubmitJob, Ending> {
        let (task, frames) = task(&self.command)?;
        if let Some(reference) = &self.reference {
            check_reference(reference, &task, &frames)?;
        }
        let bounds = [("--fail-below", &self.fail_below), ("--fail-above", &self.fail_above)];
        let bounds = bounds.into_iter().filter(|(_, list)| !list.is_empty());
        let bounds: Vec<String> = bounds.map(|(flag, list)| format!("{flag}={}", list.join(","))).collect();
        let program = match &self.lacuna {
            Some(program) => program.clone(),
            None => std::env::current_exe().map_err(|error| {
                usage(&format!("--lacuna is needed: this program's path is unknown: {error}"))
            })?,
        };
        Ok(SubmitJob {
            task,
            frames,
            chunk: self.chunk as usize,
            grant: Grant {
                cpus: self.cpus,
                memory: self.mem.clone(),
                time: self.time.clone(),
                partition: self.partition.clone(),
                at_once: self.at_once,
                more: self.sbatch.clone(),
            },
            verify: !self.no_verify,
            reference: self.reference.clone().map(|pattern| Reference { pattern, bounds }),
            name: self.name.clone(),
            logs: self.logs.clone(),
            program,
            dry_run: self.dry_run,
        })
    }
}

fn usage(text: &str) -> Ending {
    Ending::usage("submit slurm", text)
}

/// The command, read as `lacuna` will read it, and its frames.
fn task(words: &[String]) -> Result<(Task, Vec<i64>), Ending> {
    match parse(std::iter::once("lacuna".into()).chain(words.iter().map(OsString::from)))? {
        Job::Fill(job) => of_fill(words, &job),
        Job::Render(job) => of_render(words, &job),
        _ => Err(usage(&format!("{}: not fill, upscale or render", words.join(" ")))),
    }
}

/// A task names the frames of its chunk itself.
fn without_frames(words: &[String]) -> Vec<String> {
    let own = words.iter().position(|word| word == "--").unwrap_or(words.len());
    let is_value = |at: usize| at > 0 && words[at - 1] == "--frames";
    let is_of_frames =
        |at: usize| words[at] == "--frames" || words[at].starts_with("--frames=") || is_value(at);
    let kept = (0..words.len()).filter(|&at| at >= own || !is_of_frames(at));
    kept.map(|at| words[at].clone()).collect()
}

fn of_fill(words: &[String], job: &FillJob) -> Result<(Task, Vec<i64>), Ending> {
    check(&job.run, &[&job.run.json, &job.run.page])?;
    let Selection { inputs, files_from: None, .. } = &job.selection else {
        return Err(usage("--files-from cannot be cut into chunks: name a pattern and --frames"));
    };
    let [input] = &inputs[..] else {
        return Err(usage("one INPUT is needed, a pattern or a glob: chunks are cut by frame numbers"));
    };
    let refused = |error: PlanError| Ending::usage(job.command(), &error.to_string());
    let frames = some(frame_numbers(&job.selection).map_err(refused)?)?;
    job.check().map_err(refused)?;
    let input = text(input)?;
    // To `verify`, channels of other files would be new ones.
    let verifies = job.what.enlarge.is_none() && job.targets.layers.is_empty();
    let task = Task {
        words: without_frames(words),
        existing: job.existing,
        skip_missing: job.skip_missing,
        has_log: job.run.log.is_some(),
        has_time_limit: job.run.time_limit.is_some(),
        sparse: verifies.then_some(input),
        mask: Some(job.what.mask.clone()).filter(|mask| *mask != Source::Auto),
        output: text(&job.targets.output)?,
    };
    Ok((task, frames))
}

fn of_render(words: &[String], job: &RenderJob) -> Result<(Task, Vec<i64>), Ending> {
    check(&job.run, &[&job.run.json, &job.run.page])?;
    let frames = some(job.frames.as_ref().map_or(Vec::new(), |frames| frames.numbers().to_vec()))?;
    job.check().map_err(|error| Ending::usage("render", &error.to_string()))?;
    let task = Task {
        words: without_frames(words),
        existing: job.existing,
        skip_missing: false,
        has_log: job.run.log.is_some(),
        has_time_limit: job.run.time_limit.is_some(),
        sparse: None,
        mask: None,
        output: text(&job.targets.output)?,
    };
    Ok((task, frames))
}

/// Whether there is a plan for the comparison, as its job will find.
fn check_reference(reference: &str, task: &Task, frames: &[i64]) -> Result<(), Ending> {
    let refused = |error: &dyn Display| usage(&format!("--reference {reference}: {error}"));
    let frames = ranges::text(frames).parse().map_err(|error: RangeError| refused(&error))?;
    let selection = Selection { inputs: vec![reference.into()], files_from: None, frames: Some(frames) };
    pair(&selection, Path::new(&task.output), None).map(drop).map_err(|error| refused(&error))
}

fn some(frames: Vec<i64>) -> Result<Vec<i64>, Ending> {
    if frames.is_empty() {
        return Err(usage("no frames: name them with --frames after the command"));
    }
    Ok(frames)
}

fn check(run: &RunOptions, single: &[&Option<PathBuf>]) -> Result<(), Ending> {
    if run.dry_run {
        return Err(usage(
            "--dry-run after the command: nothing would be done; before it the scripts are printed",
        ));
    }
    if single.iter().any(|path| path.is_some()) {
        return Err(usage(
            "--json and --report are of one run, and tasks would replace each other's: use --log",
        ));
    }
    Ok(())
}

fn text(path: &std::path::Path) -> Result<String, Ending> {
    path.to_str().map(Into::into).ok_or_else(|| usage(&format!("{}: the name is not UTF-8", path.display())))
}

/// What a line of `#SBATCH` takes without quotes.
fn word(text: &str) -> Result<String, String> {
    let plain = |c: char| c.is_ascii_alphanumeric() || "-_.:,+".contains(c);
    if !text.is_empty() && text.chars().all(plain) {
        return Ok(text.into());
    }
    Err("it may have letters, digits and - _ . : , + only".into())
}

/// Memory as Slurm reads it.
fn size(text: &str) -> Result<String, String> {
    let number = text.strip_suffix(['K', 'M', 'G', 'T', 'k', 'm', 'g', 't']).unwrap_or(text);
    let fits = number.bytes().all(|byte| byte.is_ascii_digit()) && number.parse::<u64>().is_ok();
    if fits { Ok(text.into()) } else { Err("it must be a whole number of K, M, G or T, such as 4G".into()) }
}

/// A time as Slurm reads it: minutes, with seconds, hours and days as far as they are given.
fn wall_time(text: &str) -> Result<String, String> {
    let (days, rest) = text.split_once('-').map_or((None, text), |(days, rest)| (Some(days), rest));
    let fields: Vec<&str> = days.into_iter().chain(rest.split(':')).collect();
    let is_number = |field: &&str| !field.is_empty() && field.bytes().all(|byte| byte.is_ascii_digit());
    let most = if days.is_some() { 4 } else { 3 };
    let is_endless = ["unlimited", "infinite"].iter().any(|word| text.eq_ignore_ascii_case(word));
    if is_endless || fields.len() <= most && fields.iter().all(is_number) {
        return Ok(text.into());
    }
    Err("it must be minutes, M:S, H:M:S or D-H:M:S, such as 1:30:00".into())
}

/// An option of sbatch as a line of `#SBATCH` has it.
fn option(text: &str) -> Result<String, String> {
    let ends: &[char] = if text.starts_with("--") { &['=', ' '] } else { &[' '] };
    let (name, value) = text.split_once(ends).map_or((text, None), |(name, value)| (name, Some(value)));
    let plain = |c: char| c.is_ascii_alphanumeric() || "-_./:=,+@%".contains(c);
    if !name.starts_with('-') || name.trim_start_matches('-').is_empty() || !name.chars().all(plain) {
        return Err("it must be --NAME or --NAME=VALUE, as on the command line of sbatch".into());
    }
    if let Some(taken) = ["--array", "--dependency", "--wrap"].into_iter().find(|taken| is_spelt(name, taken))
    {
        return Err(format!(
            "{taken} is set by submit itself: the array, its scripts and their order are its work"
        ));
    }
    let Some(value) = value else { return Ok(name.into()) };
    if value.contains(|c: char| c.is_control() || "\"\\".contains(c)) {
        return Err("a line of #SBATCH takes no double quotes and backslashes".into());
    }
    let between = if name.starts_with("--") { '=' } else { ' ' };
    if !value.is_empty() && value.chars().all(plain) {
        return Ok(format!("{name}{between}{value}"));
    }
    Ok(format!("{name}{between}\"{value}\""))
}

/// Whether sbatch would read that name as this option: shortened, or by its letter.
fn is_spelt(name: &str, option: &str) -> bool {
    let letter = match option {
        "--array" => Some("-a"),
        "--dependency" => Some("-d"),
        _ => None,
    };
    let shortened = name.len() > 3 && option.starts_with(name);
    shortened || letter.is_some_and(|letter| name.starts_with(letter))
}

fn folder(text: &str) -> Result<PathBuf, String> {
    if text.is_empty() {
        return Err("it must name a folder; without --logs it is lacuna-logs".into());
    }
    if text.contains(|c: char| c.is_control() || "\"\\".contains(c)) {
        return Err("Slurm takes no quotes and backslashes in the name of a log".into());
    }
    // To sbatch, a script that begins with - would be an option.
    Ok(if text.starts_with('-') { format!("./{text}").into() } else { text.into() })
}

fn bound(text: &str) -> Result<String, String> {
    text.parse::<Bound>().map(|_| text.into()).map_err(|error| error.to_string())
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::run::Existing;

    fn submit(line: &str) -> Result<SubmitJob, Ending> {
        match parse(std::iter::once("lacuna").chain(line.split(' ')).map(OsString::from))? {
            Job::Submit(job) => Ok(*job),
            other => panic!("{other:?}"),
        }
    }

    #[test]
    fn a_command_becomes_tasks() {
        let job = submit(
            "submit slurm --chunk 4 --cpus 2 --mem 4G --reference full.#.exr --fail-below psnr=40,ssim=0.9 --sbatch=--account=a \
             -- fill s.####.exr -o f.####.exr --frames 1-6",
        )
        .unwrap();
        assert_eq!((job.chunk, job.grant.cpus, job.frames.len()), (4, 2, 6));
        assert_eq!(job.task.words, ["fill", "s.####.exr", "-o", "f.####.exr"]);
        assert_eq!((job.task.existing, job.task.skip_missing), (Existing::Replace, false));
        assert_eq!(
            (job.task.sparse.as_deref(), job.task.output.as_str()),
            (Some("s.####.exr"), "f.####.exr")
        );
        assert_eq!(job.reference.unwrap().bounds, ["--fail-below=psnr=40,ssim=0.9"]);
        assert!(job.verify && !job.dry_run && job.program.is_absolute());
        let job =
            submit("submit slurm -n -- render samples/scenes/vessels.toml -o a.####.exr --frames 1-9x2")
                .unwrap();
        assert_eq!(job.task.sparse, None);
        assert_eq!((job.frames, job.dry_run), (vec![1, 3, 5, 7, 9], true));
        let job =
            submit("submit slurm -- upscale a.#.exr -o b.#.exr --scale 2 --frames 1 --no-clobber --log l")
                .unwrap();
        assert_eq!((job.task.existing, job.task.sparse, job.task.has_log), (Existing::Keep, None, true));
        let masked = submit("submit slurm -- fill a.#.exr -o b.#.exr --mask m.#.png:R --frames 1").unwrap();
        assert_eq!(masked.task.mask.unwrap().to_string(), "file:m.#.png:R");
        let layers = "fill a.#.exr -o b.#.exr --layers n=n.#.exr --frames 1-2 --missing-frame skip";
        let job = submit(&format!("submit slurm --logs=-x -- {layers}")).unwrap();
        assert_eq!((job.task.sparse, job.task.skip_missing, job.logs), (None, true, "./-x".into()));
    }

    #[test]
    fn options_of_sbatch_are_written_as_its_lines_are_read() {
        for (given, written) in [
            ("--account=show", "--account=show"),
            ("--account show", "--account=show"),
            ("--comment=my shot's #1", "--comment=\"my shot's #1\""),
            ("--exclusive", "--exclusive"),
            ("-A show", "-A show"),
            ("-C a&b", "-C \"a&b\""),
            ("--distribution=block", "--distribution=block"),
        ] {
            assert_eq!(option(given).unwrap(), written);
        }
        for (given, reason) in [
            ("x", "--NAME"),
            ("--", "--NAME"),
            ("--array=0-3", "--array is set"),
            ("--arr 0-3", "--array is set"),
            ("-a0-3", "--array is set"),
            ("--dependency=afterok:1", "--dependency is set"),
            ("-d afterok:1", "--dependency is set"),
            ("--wrap=hostname", "--wrap is set"),
            ("--comment=a\"b", "no double quotes"),
            ("--comment=a\nb", "no double quotes"),
        ] {
            assert!(option(given).unwrap_err().contains(reason), "{given}");
        }
        assert!(folder("").unwrap_err().contains("must name a folder"));
    }

    #[test]
    fn what_cannot_be_cut_into_chunks_is_refused_in_one_line() {
        for (line, reason) in [
            ("fill a.exr -o b.exr", "no frames"),
            ("fill s.#.exr t.#.exr -o f/ --frames 1", "one INPUT"),
            ("fill --files-from l -o f/", "--files-from"),
            ("fill s.#.exr -o f.#.exr --frames 1 -n", "--dry-run"),
            ("fill s.#.exr -o f.#.exr --frames 1 --json r.json", "--log"),
            ("fill s.#.exr -o f.#.exr --frames 1 --fliter ss", "--fliter"),
            ("render a.toml -o a.exr", "no frames"),
            ("fill s.#.exr -o one.exr --frames 1-4", "several frames need"),
            ("fill s.#.exr -o not/there/ --frames 1-4", "--create-dir makes it"),
            ("render a.nrrd -o a.exr --frames 1-4", "output pattern"),
            ("render not-there.toml -o a.#.exr --frames 1-4", "cannot read the scene"),
            ("render not-there.nrrd -o a.#.exr --frames 1-4", "there is no such file"),
            ("fill s.#.exr -o f.#.exr --frames 1 --log -", "a ledger is a file"),
            ("info a.exr", "not fill"),
        ] {
            let Err(Ending::Usage(text)) = submit(&format!("submit slurm -- {line}")) else {
                panic!("{line}")
            };
            assert!(text.contains(reason) && text.lines().count() == 1, "{line}: {text}");
        }
        for wrong in [
            "--chunk 0",
            "--mem a\"b",
            "--mem foo",
            "--mem 4.5G",
            "--mem G",
            "--time abc",
            "--time 1:2:3:4",
            "--time 1-",
            "--time :",
            "--sbatch x",
            "--fail-below psnr=1",
            "--reference full/",
            "--reference full.exr",
            "--logs a\"",
            "--name a/b",
        ] {
            assert!(
                submit(&format!("submit slurm {wrong} -- fill s.#.exr -o f.#.exr --frames 1")).is_err(),
                "{wrong}"
            );
        }
    }
    #[test]
    fn sizes_and_times_are_those_of_slurm() {
        for right in [
            "--mem 4G",
            "--mem 512",
            "--mem 900k",
            "--time 90",
            "--time 1:30",
            "--time 1:30:00",
            "--time 1-12",
            "--time 2-0:30:00",
            "--time UNLIMITED",
        ] {
            let line = format!("submit slurm {right} -- fill s.#.exr -o f.#.exr --frames 1");
            assert!(submit(&line).is_ok(), "{right}");
        }
    }
}
