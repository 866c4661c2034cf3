//! The batch scripts of Slurm, as text.

use std::path::PathBuf;

use super::{SubmitJob, ranges};
use crate::run::{CUT_SHORT, Existing};

/// The flag that passes over frames that are done.
const UPDATE: &str = "-u";

/// A batch script.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Script {
    /// What it does: the subcommand.
    pub what: String,
    /// The whole text.
    pub text: String,
}

impl Script {
    /// Where it is written.
    pub fn path(&self, job: &SubmitJob) -> PathBuf {
        job.logs.join(format!("{}-{}.sbatch", job.name, self.what))
    }

    /// The script as a dry run shows it.
    pub fn shown(&self, job: &SubmitJob) -> String {
        format!("==> {} <==\n{}\n", self.path(job).display(), self.text)
    }
}

/// The array, then the gates, each of which waits for the one before.
pub fn all(job: &SubmitJob) -> Vec<Script> {
    let mut scripts = vec![array(job)];
    if job.verify {
        let sparse = job.task.sparse.as_deref();
        // A frame in which nothing is missing is copied as it is: nothing in it says what it was filled by.
        let mask: Vec<String> = job.task.mask.iter().map(|mask| format!("--mask={mask}")).collect();
        scripts.push(sparse.map_or_else(|| finished(job), |sparse| gate(job, "verify", sparse, &mask)));
    }
    if let Some(reference) = &job.reference {
        scripts.push(gate(job, "compare", &reference.pattern, &reference.bounds));
    }
    scripts
}

fn array(job: &SubmitJob) -> Script {
    let chunks: Vec<&[i64]> = job.frames.chunks(job.chunk.max(1)).collect();
    let at_once = job.grant.at_once.map_or(String::new(), |count| format!("%{count}"));
    let mut options = vec![format!("--array=0-{}{at_once}", chunks.len().saturating_sub(1))];
    options.push(output(job, job.what(), "%A_%a"));
    let lines: Vec<String> = chunks.iter().map(|chunk| quoted(&ranges::text(chunk))).collect();
    let task = &job.task;
    let mut flags = Vec::new();
    flags.extend((task.existing == Existing::Replace).then(|| UPDATE.to_owned()));
    flags.extend((!task.has_log).then(|| ledger(job)));
    flags.push("--frames=\"${frames[$SLURM_ARRAY_TASK_ID]}\"".into());
    flags.push("--progress=plain".into());
    let body = format!(
        "frames=(\n{}\n)\n\
         # The task is lacuna itself, so that Slurm's signals reach it.\n\
         exec {}",
        lines.join("\n"),
        command(job, &task.words, &flags)
    );
    script(job, job.what(), &options, &body)
}

/// For what `verify` does not know: every frame is passed over as up to date, or was made so and cut short by the command's own time
/// limit. That an output exists is not enough.
fn finished(job: &SubmitJob) -> Script {
    let task = &job.task;
    let own = place_of_flags(&task.words);
    let kept =
        |(at, word): &(usize, &String)| *at >= own || !["--no-clobber", "--force"].contains(&word.as_str());
    let words: Vec<String> =
        task.words.iter().enumerate().filter(kept).map(|(_, word)| word.clone()).collect();
    let mut flags = Vec::new();
    flags.extend((task.existing != Existing::Update).then(|| UPDATE.to_owned()));
    flags.extend(["-n".into(), all_frames(job)]);
    let short = if task.has_time_limit { format!(" -e ': {CUT_SHORT}$'") } else { String::new() };
    let body =
        format!("set -o pipefail\n{} | {{ ! grep -v -e '^skip  '{short}; }}", command(job, &words, &flags));
    script(job, "check", &[output(job, "check", "%j")], &body)
}

/// A job that holds what was made against frames of the user's.
fn gate(job: &SubmitJob, what: &str, other: &str, own: &[String]) -> Script {
    let mut words = vec![what.into(), other.into(), job.task.output.clone()];
    if words[1..].iter().any(|word| word.starts_with('-')) {
        words.insert(1, "--".into());
    }
    let mut flags: Vec<String> = own.iter().map(|flag| quoted(flag)).collect();
    flags.push(ledger(job));
    flags.extend(job.task.skip_missing.then(|| "--missing-frame=skip".to_owned()));
    flags.push(all_frames(job));
    let body = format!("exec {}", command(job, &words, &flags));
    script(job, what, &[output(job, what, "%j")], &body)
}

fn all_frames(job: &SubmitJob) -> String {
    format!("--frames={}", quoted(&ranges::text(&job.frames)))
}

/// A script with what all of them have.
fn script(job: &SubmitJob, what: &str, options: &[String], body: &str) -> Script {
    let grant = &job.grant;
    let mut all = vec![format!("--job-name={}-{what}", job.name)];
    all.extend_from_slice(options);
    all.push(format!("--cpus-per-task={}", grant.cpus));
    let given = [("mem", &grant.memory), ("time", &grant.time), ("partition", &grant.partition)];
    all.extend(given.iter().filter_map(|(name, value)| Some(format!("--{name}={}", value.as_ref()?))));
    // A task whose node is lost begins again elsewhere, and its log goes on.
    all.extend(["--requeue".into(), "--open-mode=append".into()]);
    // What waits for a task that failed stays, for someone to look.
    all.push("--kill-on-invalid-dep=no".into());
    all.extend(grant.more.iter().cloned());
    let text = format!(
        "#!/bin/bash\n#SBATCH {}\n# Made by lacuna {} submit.\n{body}\n",
        all.join("\n#SBATCH "),
        env!("CARGO_PKG_VERSION")
    );
    Script { what: what.into(), text }
}

/// Where a job's output goes; `%` has a meaning there.
fn output(job: &SubmitJob, what: &str, numbers: &str) -> String {
    let folder = job.logs.display().to_string().replace('%', "%%");
    format!("--output=\"{folder}/{}-{what}-{numbers}.log\"", job.name)
}

/// The flag that names the ledger of these jobs.
fn ledger(job: &SubmitJob) -> String {
    format!("--log={}", quoted(&job.logs.join(format!("{}.jsonl", job.name)).display().to_string()))
}

/// The place of a `--` of the user's: what stands behind it is an input, whatever it looks like.
fn place_of_flags(words: &[String]) -> usize {
    words.iter().position(|word| word == "--").unwrap_or(words.len())
}

/// A command of these words, and flags that are quoted already.
fn command(job: &SubmitJob, words: &[String], flags: &[String]) -> String {
    let (own, inputs) = words.split_at(place_of_flags(words));
    let text = |word: &String| quoted(word);
    let program = job.program.display().to_string();
    let words = std::iter::once(quoted(&program)).chain(own.iter().map(text));
    let words: Vec<String> = words.chain(flags.iter().cloned()).chain(inputs.iter().map(text)).collect();
    words.join(" ")
}

/// A word as a shell reads it back.
fn quoted(word: &str) -> String {
    let plain = |c: char| c.is_ascii_alphanumeric() || "-_./:=,+@%".contains(c);
    if !word.is_empty() && word.chars().all(plain) {
        return word.into();
    }
    format!("'{}'", word.replace('\'', r"'\''"))
}

impl SubmitJob {
    /// The subcommand that the tasks run.
    pub fn what(&self) -> &str {
        self.task.words.first().map_or("lacuna", String::as_str)
    }
}
