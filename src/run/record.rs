//! What happened to each frame, as the JSON report has it.

use std::path::Path;
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};

use lacuna_filters::{Outcome, Stop};
use serde::Serialize;

use crate::files::plan::Item;
use crate::files::reports;
use crate::mask::rounds::{Round, Rounds};
use crate::reconstruct::{Energy, Estimated};

/// How far a frame came.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize)]
#[serde(rename_all = "kebab-case")]
pub enum State {
    /// Not begun: the run ended before.
    #[default]
    Pending,
    /// Written (or, where nothing is written, found in order).
    Done,
    /// Passed over, for the reason in `message`.
    Skipped,
    /// Not done, for the reason in `message`.
    Failed,
    /// Begun, and given up on a signal.
    Stopped,
}

/// Seconds by stage.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize)]
pub struct Seconds {
    /// Reading and decoding the frame and its mask.
    pub read: f64,
    /// Planning and solving.
    pub solve: f64,
    /// Encoding and writing.
    pub write: f64,
}

/// How wrong the missing pixels of a group of channels are by estimate.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Estimate {
    /// Its part, where the frame has several.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub part: Option<String>,
    /// The channels' full names.
    pub channels: Vec<String>,
    /// The error.
    #[serde(flatten)]
    pub error: Estimated,
    /// The power by which squared errors grow with the variance of pixels given the samples; near 0 where noise decides.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub exponent: Option<f64>,
}

/// How the light of a group's filled pixels compares with that of measured ones around them.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Light {
    /// Its part, where the frame has several.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub part: Option<String>,
    /// The channels' full names.
    pub channels: Vec<String>,
    /// The comparison.
    #[serde(flatten)]
    pub energy: Energy,
}

/// The residual that people are told: one that converged to little, or was stopped with much. Methods of a fixed number of rounds end
/// with another.
pub fn told_residual(outcome: Outcome) -> Option<f64> {
    outcome.residual.filter(|residual| *residual < 0.1 || outcome.stop != Stop::Converged)
}

/// One frame of the report.
#[derive(Clone, Debug, Default, PartialEq, Serialize)]
pub struct Record {
    /// The frame number.
    pub frame: Option<i64>,
    /// The file read.
    pub input: String,
    /// The file written.
    pub output: String,
    /// How far it came.
    pub state: State,
    /// Why it was skipped or failed.
    pub message: Option<String>,
    /// Where the mask was found.
    pub mask: Option<String>,
    /// Measured pixels over all pixels.
    pub density: Option<f64>,
    /// Measured samples that no missing one was made from because they are NaN or infinite.
    pub non_finite: Option<usize>,
    /// Values that the limiter or a bound moved.
    pub limited: Option<usize>,
    /// The farthest that one of them was moved, in the units of its channel.
    pub largest_move: Option<f32>,
    /// Values that would have overflowed a half and became the largest one.
    pub clamped_halves: Option<usize>,
    /// How many channels each rule had.
    pub rules: Option<String>,
    /// What steered the colour, and what that gained by estimate.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub guides: Option<String>,
    /// Channels whose missing pixels were copied from a complete one that holds their values.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub copied: Option<String>,
    /// The frames beside it that it was filled along with, by what motion, and what that gained by estimate.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub neighbours: Option<String>,
    /// What the filter chose where, if it does.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub chosen: Option<String>,
    /// How wrong the missing pixels of each group of channels are by estimate.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    pub estimates: Vec<Estimate>,
    /// Which groups of channels have more or less light in filled pixels than chance explains.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    pub energies: Vec<Light>,
    /// How the solvers ended: stop, iterations, residual or gap; the worst of all channels.
    #[serde(flatten)]
    pub outcome: Option<Outcome>,
    /// The rounds in which pixels were chosen.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    pub rounds: Vec<Round>,
    /// Seconds of rendering, where frames are rendered, without those in which pixels were chosen.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub rendered: Option<f64>,
    /// Seconds of filling in memory what was rendered.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub filled: Option<f64>,
    /// Seconds by stage.
    pub seconds: Seconds,
    /// What the log warned of.
    pub warnings: Vec<String>,
}

impl Record {
    /// Notes for the log, which are warnings of this frame.
    pub fn warn(&mut self, notes: &[String]) {
        for note in notes {
            tracing::warn!("{note}");
        }
        self.warnings.extend_from_slice(notes);
    }

    /// So many values became the largest half.
    pub fn clamped(&mut self, halves: usize) {
        self.clamped_halves = Some(halves);
        if halves > 0 {
            self.warn(&[format!("{halves} values past the largest half were clamped to it")]);
        }
    }

    /// Pixels were chosen in rounds. Returns what there is to know about their target.
    pub fn chosen(&mut self, rounds: &Rounds, target: Option<f64>) -> Option<String> {
        self.rounds.clone_from(&rounds.rounds);
        let verdict = rounds.verdict(target)?;
        verdict.map_err(|text| self.warn(&[text])).ok()
    }

    /// Nothing was written, for this reason.
    pub fn pass_over(&mut self, reason: String) {
        self.state = State::Skipped;
        self.message = Some(reason);
    }

    /// Stages that have been through, of read, solve and write.
    pub fn steps_done(&self) -> u64 {
        let Seconds { read, solve, write } = self.seconds;
        [read, solve, write].into_iter().filter(|&seconds| seconds > 0.0).count() as u64
    }

    fn pending(item: &Item) -> Self {
        Self {
            frame: item.number,
            input: item.input.display().to_string(),
            output: item.output.display().to_string(),
            ..Self::default()
        }
    }
}

/// What the report says once for all frames.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Heading {
    /// The version of lacuna.
    pub lacuna: &'static str,
    /// The subcommand.
    pub command: &'static str,
    /// The filter, if one ran.
    pub filter: Option<String>,
    /// Its settings and everything else that the pixels depend on.
    pub settings: Option<String>,
}

/// The records of all frames while the run goes on.
#[derive(Clone, Debug)]
pub struct Journal {
    heading: Heading,
    records: Arc<Mutex<Vec<Record>>>,
}

#[derive(Serialize)]
struct Report<'a> {
    #[serde(flatten)]
    heading: &'a Heading,
    #[serde(skip_serializing_if = "Option::is_none")]
    error: Option<&'a str>,
    frames: &'a [Record],
}

impl Journal {
    /// A journal in which every frame is pending.
    pub fn new(heading: Heading, items: &[Item]) -> Self {
        Self { heading, records: Arc::new(Mutex::new(items.iter().map(Record::pending).collect())) }
    }

    /// What is said once for all frames.
    pub fn heading(&self) -> &Heading {
        &self.heading
    }

    /// Enters a frame's record.
    pub fn enter(&self, index: usize, record: Record) {
        if let Some(slot) = self.records().get_mut(index) {
            *slot = record;
        }
    }

    /// The record of a frame as it stands.
    pub fn get(&self, index: usize) -> Record {
        self.records().get(index).cloned().unwrap_or_default()
    }

    /// All records.
    pub fn records(&self) -> MutexGuard<'_, Vec<Record>> {
        self.records.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// Writes the report, complete or not at all; `-` is standard output.
    pub fn write(&self, path: &Path) -> Result<(), String> {
        // Not while it is written: that may take for ever, and a signal's thread needs the records.
        let text = serde_json::to_vec_pretty(&Report {
            heading: &self.heading,
            error: None,
            frames: &self.records(),
        });
        write(path, text)
    }
}

/// Writes the report of a run that has no frames, for this reason.
pub fn write_failure(path: &Path, heading: &Heading, error: &str) -> Result<(), String> {
    write(path, serde_json::to_vec_pretty(&Report { heading, error: Some(error), frames: &[] }))
}

fn write(path: &Path, text: serde_json::Result<Vec<u8>>) -> Result<(), String> {
    let mut text = text.map_err(|error| format!("{}: the report is not written: {error}", path.display()))?;
    text.push(b'\n');
    reports::write(path, &text)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_report_is_json_with_every_frame() {
        let item = |number: i64| Item {
            number: Some(number),
            input: format!("in \"{number}\".exr").into(),
            output: "out.exr".into(),
            mask: None,
            guides: None,
            layers: Vec::new(),
            neighbours: Vec::new(),
            made_from: Vec::new(),
        };
        let heading = Heading {
            lacuna: "1",
            command: "fill",
            filter: Some("ss".into()),
            settings: Some("lambda=0".into()),
        };
        let journal = Journal::new(heading, &[item(1), item(2)]);
        let mut record = journal.get(1);
        record.state = State::Done;
        record.outcome = Some(Outcome::direct());
        journal.enter(1, record);
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("report.json");
        journal.write(&path).unwrap();
        journal.write(&path).unwrap();
        let json: serde_json::Value = serde_json::from_slice(&std::fs::read(&path).unwrap()).unwrap();
        assert_eq!(json["filter"], "ss");
        assert_eq!(json["frames"][0]["state"], "pending");
        assert_eq!(json["frames"][0]["input"], "in \"1\".exr");
        assert_eq!(json["frames"][1]["state"], "done");
        assert_eq!(json["frames"][1]["stop"], "converged");
        assert_eq!(std::fs::read_dir(folder.path()).unwrap().count(), 1);
        let error = journal.write(&folder.path().join("no/such.json")).unwrap_err();
        assert!(error.contains("no/such.json") && !error.contains(".lacuna-"), "{error}");
    }
}
