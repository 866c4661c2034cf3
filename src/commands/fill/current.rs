//! Whether an output that exists is what this run would make again.

use std::path::Path;

use lacuna_exr::{PartHeader, read_header};

use super::FillJob;
use crate::files::content::Sums;
use crate::files::plan::Item;
use crate::mask::Source;
use crate::reconstruct::{Gate, Job, Stamp, Windows, estimate, was_cut_short};
use crate::run::existing::{self, CUT_SHORT};
use crate::temporal;

/// Why the output is not what this run would make of the files that the frame is made from, if it is not.
pub fn stale(item: &Item, job: &FillJob, sums: &Sums) -> Option<String> {
    let mut is_short = false;
    let why = existing::stale(&item.output, item.used_sources(), sums, |parts| {
        is_short = parts.iter().any(|part| was_cut_short(&part.attributes));
        differs(item, job, parts)
    });
    // Only of a frame that is up to date otherwise: a farm lets it pass.
    why.or_else(|| is_short.then(|| CUT_SHORT.into()))
}

/// Whether the output may be a copy of a complete frame, which gets no stamp: it has the stamps of the input, if any. The input's
/// pixels have to tell whether it is.
pub fn may_be_copy(item: &Item) -> bool {
    let stamps = |path: &Path| -> Option<Vec<Option<Stamp>>> {
        Some(read_header(path).ok()?.iter().map(|part| Stamp::read(&part.attributes)).collect())
    };
    let output = stamps(&item.output);
    output.is_some() && output == stamps(&item.input)
}

/// Why a gate does not let a filled output pass that is there already, if it does not: as its attributes say of its error, by
/// figures that the gate goes by when the frame is filled.
pub fn doubt(output: &Path, gate: &Gate) -> Option<String> {
    let parts = match read_header(output) {
        Ok(parts) => parts,
        Err(error) => return Some(error.to_string()),
    };
    let of_part = |part: &PartHeader| {
        let stamp = Stamp::read(&part.attributes)?;
        match part.attributes.text(estimate::ATTRIBUTE) {
            Some(line) => gate.doubt_of(&line),
            // Nothing that has an error was filled.
            None => stamp.setting("estimate").map(|_| "its error was not estimated".into()),
        }
    };
    estimate::joined(parts.iter().filter_map(of_part))
}

/// Why the headers are not those that this run would write: the windows differ, no part has a stamp, or
/// one has another run's. The settings tell which mask was asked for; of a file they tell the pattern, so its path is compared as well
/// where no sum tells which it was.
fn differs(item: &Item, FillJob { what: job, again, .. }: &FillJob, parts: &[PartHeader]) -> Option<String> {
    let stamps: Vec<Stamp> = parts.iter().filter_map(|part| Stamp::read(&part.attributes)).collect();
    let source = item.mask.as_ref().and_then(|path| match &job.mask {
        Source::File { channel, .. } => {
            Some(Source::File { pattern: path.display().to_string(), channel: channel.clone() }.to_string())
        }
        _ => None,
    });
    let complete = item.neighbours.iter().filter(|file| file.is_complete());
    let beside: Vec<i64> = complete.map(|file| file.number).collect();
    let other_neighbours = |part: &PartHeader| {
        let line = part.attributes.text(temporal::ATTRIBUTE).unwrap_or_default();
        let left = temporal::left_unread(&line) || (*again && temporal::left_filled(&line));
        let same = temporal::numbers(&line) == beside && !left;
        !same && Stamp::read(&part.attributes).is_some()
    };
    let other_mask = |stamp: &Stamp| {
        stamp.sources.is_none() && source.as_ref().is_some_and(|source| *source != stamp.mask)
    };
    let why = match () {
        () if stamps.is_empty() => "lacuna did not fill it".into(),
        () if !has_windows(parts, &item.input, job) => "the input has other windows".into(),
        () if stamps.iter().any(other_mask) => "the mask was another file".into(),
        () if parts.iter().any(other_neighbours) => "other frames beside it are there".into(),
        () => return stamps.iter().find_map(|stamp| stamp.differs(job)),
    };
    Some(why)
}

/// Whether the parts of an output have the windows that this run makes of those of the input.
fn has_windows(output: &[PartHeader], input: &Path, job: &Job) -> bool {
    let Ok(input) = read_header(input) else { return false };
    let made = |part: &PartHeader| match &job.enlarge {
        None => Some((part.data_window, part.display_window)),
        Some(enlarge) => {
            let windows = Windows::of_header(part, &enlarge.target).ok()?;
            Some((windows.data, windows.display))
        }
    };
    let same = |(part, output): (&PartHeader, &PartHeader)| {
        made(part) == Some((output.data_window, output.display_window))
    };
    input.len() == output.len() && input.iter().zip(output).all(same)
}
