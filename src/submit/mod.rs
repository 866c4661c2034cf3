//! A sequence for a farm: one array job of chunks, and the gates that wait for it.
//!
//! ```text
//! command, frames ──> chunks ──> scripts ──> sbatch: array ──afterok──> verify ──afterok──> compare
//! ```
//!
//! A task of the array runs the user's command on its chunk of frames, passes over what is done, and appends to the ledger.
//! The gates wait as long as a task has failed: what is not whole goes no further.

pub mod ranges;
pub mod script;

use std::path::PathBuf;
use std::process::Command;

use crate::files::{PlanError, reports};
use crate::mask::Source;
use crate::run::Existing;

/// What a task does.
#[derive(Clone, Debug, PartialEq)]
pub struct Task {
    /// The subcommand and its flags, without the frames.
    pub words: Vec<String>,
    /// What the command says of outputs that exist.
    pub existing: Existing,
    /// Whether frames that do not exist are passed over.
    pub skip_missing: bool,
    /// Whether the command names a ledger itself.
    pub has_log: bool,
    /// Whether the command may end frames early.
    pub has_time_limit: bool,
    /// The sparse frames, if `verify` can judge what is made of them.
    pub sparse: Option<String>,
    /// Which pixels of them were measured, if the command says it.
    pub mask: Option<Source>,
    /// Where the frames go: a file pattern or a folder.
    pub output: String,
}

/// A reference and what is good enough, as flags of `compare`.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Reference {
    /// The complete frames.
    pub pattern: String,
    /// `--fail-below` and `--fail-above` with their bounds.
    pub bounds: Vec<String>,
}

/// What a task is granted, in the words of Slurm.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Grant {
    /// Processors.
    pub cpus: u32,
    /// Memory of a task, such as `4G`.
    pub memory: Option<String>,
    /// Wall time, such as `1:30:00`.
    pub time: Option<String>,
    /// The partition.
    pub partition: Option<String>,
    /// Tasks that run at the same time.
    pub at_once: Option<u32>,
    /// Further options of `sbatch`, each `--name=value` or `--name`.
    pub more: Vec<String>,
}

/// A sequence for Slurm.
#[derive(Clone, Debug, PartialEq)]
pub struct SubmitJob {
    /// What is done with each chunk.
    pub task: Task,
    /// The frames, in the order asked for.
    pub frames: Vec<i64>,
    /// Frames of a task.
    pub chunk: usize,
    /// What a task is granted.
    pub grant: Grant,
    /// Whether what is made is checked when all tasks are through.
    pub verify: bool,
    /// What it is compared with afterwards.
    pub reference: Option<Reference>,
    /// The name of the jobs.
    pub name: String,
    /// The folder of scripts, logs and ledger.
    pub logs: PathBuf,
    /// The program that tasks run.
    pub program: PathBuf,
    /// Print the scripts only.
    pub dry_run: bool,
}

/// Submits the jobs, and prints a line for each: what it is and its number.
///
/// # Errors
/// If the folder of logs cannot be made, or `sbatch` is missing or refuses.
pub fn submit(job: &SubmitJob) -> Result<u8, PlanError> {
    let scripts = script::all(job);
    if job.dry_run {
        return printed(scripts.iter().map(|script| script.shown(job)));
    }
    std::fs::create_dir_all(&job.logs).map_err(|error| {
        PlanError::Failed(format!("{}: cannot make the folder: {error}", job.logs.display()))
    })?;
    let mut numbers: Vec<String> = Vec::new();
    for script in &scripts {
        let number = sbatch(job, script, numbers.last()).map_err(|error| {
            let there =
                scripts.iter().zip(&numbers).map(|(script, number)| format!("{} {number}", script.what));
            let there: Vec<String> = there.collect();
            let note = if there.is_empty() {
                String::new()
            } else {
                format!("; submitted already: {} (scancel takes them back)", there.join(", "))
            };
            PlanError::Failed(format!("{error}{note}"))
        })?;
        numbers.push(number);
    }
    printed(scripts.iter().zip(&numbers).map(|(script, number)| format!("{} {number}\n", script.what)))
}

fn printed(texts: impl Iterator<Item = String>) -> Result<u8, PlanError> {
    reports::print(&texts.collect::<String>()).map(|()| 0)
}

/// Writes a script and submits it; the number of the job.
fn sbatch(job: &SubmitJob, script: &script::Script, after: Option<&String>) -> Result<String, String> {
    let path = script.path(job);
    lacuna_exr::write_whole(&path, script.text.as_bytes())
        .map_err(|error| format!("{}: cannot write the script: {error}", path.display()))?;
    let mut command = Command::new("sbatch");
    command.arg("--parsable");
    command.args(after.map(|number| format!("--dependency=afterok:{number}")));
    let done = command.arg(&path).output().map_err(|error| {
        format!("cannot run sbatch: {error}; submit on a machine with Slurm's commands, or see the scripts with --dry-run")
    })?;
    let said = String::from_utf8_lossy(&done.stderr);
    if !done.status.success() {
        let said = said.trim().replace('\n', "; ");
        return Err(format!("{}: sbatch refused it: {said}; -n only prints the scripts", path.display()));
    }
    // `NUMBER` or `NUMBER;CLUSTER`.
    let number = String::from_utf8_lossy(&done.stdout);
    Ok(number.trim().split(';').next().unwrap_or_default().into())
}

#[cfg(test)]
mod tests;
