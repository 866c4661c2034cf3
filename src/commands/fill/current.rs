//! Whether an output that exists is what this run would make again.

use std::path::Path;

use lacuna_exr::{PartHeader, read_header};

use super::FillJob;
use crate::files::plan::Item;
use crate::mask::Source;
use crate::reconstruct::{Gate, Job, Stamp, Windows, estimate, was_cut_short};
use crate::run::existing::is_made_from;
use crate::temporal;

/// Whether the output is newer than all that it was made from, and its attributes name this version, these settings
/// and this mask.
pub fn is_current(item: &Item, job: &FillJob) -> bool {
    is_made_from(&item.output, item.used_sources(), |parts| is_of(item, job, parts))
}

/// Whether the output may be a copy of a complete frame, which gets no stamp: it is whole, newer than all that it was made
/// from, and has the stamps of the input, if any. The input's mask has to tell whether it is.
pub fn may_be_copy(item: &Item) -> bool {
    let Ok(input) = read_header(&item.input) else { return false };
    let stamps = |parts: &[PartHeader]| -> Vec<Option<Stamp>> {
        parts.iter().map(|part| Stamp::read(&part.attributes)).collect()
    };
    is_made_from(&item.output, item.used_sources(), |parts| stamps(parts) == stamps(&input))
}

/// Whether a gate may let an output pass that is there already, by what its attributes say of its error.
pub fn may_pass(output: &Path, gate: &Gate) -> bool {
    let Ok(parts) = read_header(output) else { return false };
    let line = |part: &PartHeader| part.attributes.text(estimate::ATTRIBUTE);
    !parts.iter().any(|part| gate.may_refuse(line(part).as_deref()))
}

/// Whether the windows are those that this run would give it, at least one part has a stamp, all stamps are this run's and no time
/// limit cut a part short. The settings tell which mask was asked for; of a file they tell the pattern, so its path is compared as
/// well.
fn is_of(item: &Item, FillJob { what: job, again, .. }: &FillJob, parts: &[PartHeader]) -> bool {
    if parts.iter().any(|part| was_cut_short(&part.attributes)) || !has_windows(parts, &item.input, job) {
        return false;
    }
    let stamps: Vec<Stamp> = parts.iter().filter_map(|part| Stamp::read(&part.attributes)).collect();
    let source = item.mask.as_ref().and_then(|path| match &job.mask {
        Source::File { channel, .. } => {
            Some(Source::File { pattern: path.display().to_string(), channel: channel.clone() }.to_string())
        }
        _ => None,
    });
    let complete = item.neighbours.iter().filter(|file| file.is_complete());
    let beside: Vec<i64> = complete.map(|file| file.number).collect();
    let same_neighbours = |part: &PartHeader| {
        let line = part.attributes.text(temporal::ATTRIBUTE).unwrap_or_default();
        let left = temporal::left_unread(&line) || (*again && temporal::left_filled(&line));
        let same = temporal::numbers(&line) == beside && !left;
        same || Stamp::read(&part.attributes).is_none()
    };
    let same_mask = |stamp: &Stamp| source.as_ref().is_none_or(|source| *source == stamp.mask);
    !stamps.is_empty()
        && parts.iter().all(same_neighbours)
        && stamps.iter().all(|stamp| stamp.is_of(job) && same_mask(stamp))
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
