//! The batch scripts of Slurm, as text.

use std::path::PathBuf;

use super::{SubmitJob, ranges};

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
        scripts.push(job.task.sparse.as_deref().map_or_else(|| finished(job), |sparse| verify(job, sparse)));
    }
    if let Some(reference) = &job.reference {
        let mut words = vec!["compare".into(), reference.pattern.clone(), job.task.output.clone()];
        words.extend(reference.bounds.iter().cloned());
        scripts.push(gate(job, "compare", &format!("exec {}", logged(job, &words, false))));
    }
    scripts
}

fn array(job: &SubmitJob) -> Script {
    let chunks: Vec<&[i64]> = job.frames.chunks(job.chunk.max(1)).collect();
    let at_once = job.grant.at_once.map_or(String::new(), |count| format!("%{count}"));
    let mut options = vec![format!("--array=0-{}{at_once}", chunks.len().saturating_sub(1))];
    options.push(output(job, job.what(), "%A_%a"));
    let lines: Vec<String> = chunks.iter().map(|chunk| quoted(&ranges::text(chunk))).collect();
    let mut words = job.task.words.clone();
    words.extend(job.task.resume.map(Into::into));
    let command = logged(job, &words, job.task.has_log);
    let body = format!(
        "frames=(\n{}\n)\n\
         # The task is lacuna itself, so that Slurm's signals reach it.\n\
         exec {command} --frames=\"${{frames[$SLURM_ARRAY_TASK_ID]}}\" --progress=plain",
        lines.join("\n")
    );
    script(job, job.what(), &options, &body)
}

fn verify(job: &SubmitJob, sparse: &str) -> Script {
    let words = ["verify".into(), sparse.into(), job.task.output.clone()];
    gate(job, "verify", &format!("exec {}", logged(job, &words, false)))
}

/// For what `verify` does not know: every frame is passed over as up to date.
fn finished(job: &SubmitJob) -> Script {
    let mut words = job.task.words.clone();
    words.extend(job.task.resume.map(Into::into));
    words.push("-n".into());
    let body =
        format!("set -o pipefail\n{} {} | {{ ! grep -v '^skip  '; }}", command(job, &words), all_frames(job));
    script(job, "check", &[output(job, "check", "%j")], &body)
}

fn gate(job: &SubmitJob, what: &str, body: &str) -> Script {
    script(job, what, &[output(job, what, "%j")], &format!("{body} {}", all_frames(job)))
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

/// A command that appends to the ledger.
fn logged(job: &SubmitJob, words: &[String], has_log: bool) -> String {
    let ledger = job.logs.join(format!("{}.jsonl", job.name)).display().to_string();
    let log = if has_log { String::new() } else { format!(" --log={}", quoted(&ledger)) };
    format!("{}{log}", command(job, words))
}

fn command(job: &SubmitJob, words: &[String]) -> String {
    let program = job.program.display().to_string();
    let words: Vec<String> = std::iter::once(&program).chain(words).map(|word| quoted(word)).collect();
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
