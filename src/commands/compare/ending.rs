//! What is said and written when frames are compared, or a signal ends it.

use std::collections::BTreeSet;
use std::path::{Path, PathBuf};

use crate::commands::compare::CompareJob;
use crate::files::reports;
use crate::files::reports::is_standard_output;
use crate::report::{self, Comparison, FrameReport, Picture, why_unknown};
use crate::run::batch::RunOptions;
use crate::run::console::{Console, Verbosity};

/// The frames, judged by the gate; failures are named. Those of which nothing is known are `undone`.
pub fn judged(job: &CompareJob, mut frames: Vec<FrameReport>, undone: &str, console: &Console) -> Comparison {
    let gate = &job.gate;
    let mut failing = 0;
    let compared = |frame: &&FrameReport| frame.error.is_none() && frame.skipped.is_none();
    let known: Vec<&FrameReport> = frames.iter().filter(compared).collect();
    let unknown = gate.unknown(&known);
    let why: Vec<String> = unknown.iter().map(|&measure| why_unknown(measure)).collect();
    let numbers: BTreeSet<i64> = known.iter().filter_map(|frame| frame.frame).collect();
    let mut first = true;
    for frame in &mut frames {
        if frame.groups.is_empty() && frame.error.is_none() && frame.skipped.is_none() {
            frame.error = Some(undone.into());
        }
        if frame.error.is_some() || frame.skipped.is_some() {
            continue;
        }
        if std::mem::take(&mut first) {
            frame.failures.extend(why.iter().cloned());
        }
        let before = frame.frame.and_then(|number| number.checked_sub(1));
        let follows = before.is_some_and(|number| numbers.contains(&number));
        frame.failures.extend(gate.failures(frame, follows, &unknown));
        if !frame.failures.is_empty() {
            failing += 1;
            let label = crate::run::console::label(Path::new(&frame.test), frame.frame);
            console.error(&format!("{label}: {}", frame.failures.join("; ")));
        }
    }
    // Of a single frame the line above has said all.
    if failing > 0 && frames.len() > 1 {
        console.error(&format!("{failing} of {} frames fail: {}", frames.len(), gate.texts().join(", ")));
    }
    Comparison {
        lacuna: env!("CARGO_PKG_VERSION"),
        settings: job.settings.clone(),
        gate: gate.texts(),
        frames,
    }
}

/// Writes every format that was asked for, and the tables to standard output if that is not taken. What cannot be written keeps no
/// other from it.
pub fn write(job: &CompareJob, comparison: &Comparison, pictures: &[Option<Picture>]) -> Vec<String> {
    let outputs = &job.outputs;
    let mut results = vec![write_json(&job.run, comparison)];
    let mut put = |path: &Option<PathBuf>, text: &dyn Fn() -> String| {
        results.extend(path.as_ref().map(|path| reports::write(path, text().as_bytes())));
    };
    put(&outputs.csv, &|| report::csv(comparison));
    put(&outputs.markdown, &|| report::markdown(comparison));
    put(&outputs.html, &|| report::html(comparison, pictures));
    let asked = outputs.reports().into_iter().map(|(_, path)| path);
    let taken = asked.chain(job.run.json.as_deref()).any(is_standard_output);
    if !taken && job.run.verbosity != Verbosity::Quiet {
        results.push(reports::print(&report::markdown(comparison)).map_err(|error| error.to_string()));
    }
    results.into_iter().filter_map(Result::err).collect()
}

/// Writes the report that `--json` asks for.
pub fn write_json(run: &RunOptions, comparison: &Comparison) -> Result<(), String> {
    let Some(path) = &run.json else { return Ok(()) };
    let text = serde_json::to_string_pretty(comparison).map_err(|error| error.to_string())?;
    reports::write(path, (text + "\n").as_bytes())
}
