//! One frame in, one frame out; pure.
//!
//! ```text
//! targets (which values are measured) ──> groups ──> domain ──> filter ──> back ──> limiter, bounds ──┐
//!                                    └──> nearest, depth: copied bits ────────────────────────────────┤
//!                                                 normals: unit length <──────────────────────────────┤
//!                                 missing pixels written, measured bits are the input's  <────────────┘
//! ```
//!
//! A measured value that is NaN or infinite counts as missing, here and nowhere else (`groups::targets`); an infinite
//! depth is a value like any other, and codes (identifiers, Cryptomatte) are copied as they are; a NaN in another channel that
//! is only copied stays where it is and is not copied (`groups::copyable`). A mask without a missing pixel leaves its
//! channels alone, non-finite values included.

mod apply;
mod bands;
mod bounds;
pub(crate) mod energy;
mod enlarge;
mod error;
pub(crate) mod estimate;
mod filled;
mod gradients;
mod groups;
mod job;
mod learned;
mod noise;
pub(crate) mod normals;
mod part;
mod report;
#[cfg(test)]
mod same_bits;
pub(crate) mod shared;
mod stamp;
mod surfaces;
#[cfg(test)]
mod tests;
mod twins;
mod values;
mod weights;

pub(crate) use bands::pixels_at_a_time;
pub(crate) use bounds::bounds_of;
pub use energy::Energy;
pub use enlarge::{Enlarge, Target, Windows, enlarge, logarithms_of};
pub use error::Error;
pub use estimate::{Estimated, Gate, Interval};
pub use filled::{blank, drop_errors, is_enlarged, made_by, was_smoothed, wrong_mask};
pub(crate) use groups::usable;
pub use job::{Job, Kind, make_writable, output_compression, parse_settings};
use lacuna_exr::{Frame, Part};
pub use lacuna_filters::Plans;
pub use lacuna_filters::domain::Domain;
use lacuna_filters::{Run, Stop};
pub use noise::{NoiseError, NoiseSource};
pub(crate) use part::measured_floats;
pub use report::{ChannelReport, GroupReport, PartReport, Report, behind, named};
pub use stamp::{
    ADDED, DENSITY, DERIVED, FILLED_BY, FILTER, RENDER, SCENE, SOURCES, Stamp, dropped_note, error_channel,
    estimated_errors, of_other_pixels, remove, was_cut_short,
};
pub(crate) use twins::line as copied_line;
pub(crate) use values::{convert, kind_for, to_half, to_halves, value};
pub use weights::{Weights, WeightsError};

use crate::channels::{Choice, Rule, non_finite, non_finite_note, part_label, unheeded};
use crate::guides::{self, Asked};
use crate::mask::{ATTRIBUTE, Masks, Source};
use crate::temporal::Neighbours;

/// Pixels that one task takes in loops over a plane.
const PIECE: usize = 1 << 14;

/// Fills the missing pixels of a frame, with guides of the same frame.
pub fn fill(
    frame: Frame,
    masks: &Masks,
    choices: &[Vec<Choice>],
    job: &Job,
    plans: &Plans,
    run: &Run<'_>,
) -> Result<(Frame, Report), Error> {
    fill_with(frame, masks, choices, Beside::default(), job, plans, run)
}

/// What a frame is filled with beside itself.
#[derive(Clone, Copy, Debug, Default)]
pub struct Beside<'a> {
    /// The frame that guides come from, if it is another one.
    pub guides: Option<&'a Frame>,
    /// The frames before and after it.
    pub neighbours: Option<&'a Neighbours>,
    /// What all of this was read from, for the stamp.
    pub sources: Option<&'a str>,
}

/// Fills the missing pixels of a frame.
pub fn fill_with(
    mut frame: Frame,
    masks: &Masks,
    choices: &[Vec<Choice>],
    beside: Beside<'_>,
    job: &Job,
    plans: &Plans,
    run: &Run<'_>,
) -> Result<(Frame, Report), Error> {
    let fits = |(part, choices): (&Part, &Vec<Choice>)| part.channels.len() == choices.len();
    if frame.parts.len() != choices.len() || !frame.parts.iter().zip(choices).all(fits) {
        return Err(Error::OtherFrame);
    }
    job.noise.check(&frame)?;
    let Beside { guides: second, neighbours, sources } = beside;
    let mut choices = choices.to_vec();
    let mut found = guides::find(&frame, masks, &mut choices, job.wanted(), second)?;
    if *job.wanted() == Asked::None && job.guides != Asked::None {
        found.notes = guides::keep_complete(&frame, masks, &mut choices);
    }
    let choices = choices.as_slice();
    let stamp = Stamp::new(job, &masks.origin, sources);
    let unheeded = unheeded(&frame, &masks.mask_channels, &job.overrides, choices);
    let dropped = Vec::from_iter(nothing_dropped(masks, job));
    let notes = [masks.notes.as_slice(), &found.notes, &unheeded, &dropped].concat();
    let mut report = Report { copied: true, ..Report::new(&stamp, masks.density(), notes) };
    for (index, choices) in choices.iter().enumerate() {
        let label = part_label(&frame, index);
        let twins = guides::twins(&frame, index, choices, &found.parts[index], second);
        let twins = twins::known(&frame, (index, masks, choices), twins, second, job)?;
        let (guides, guide_channels, twins) = (&[][..], found.parts[index].as_slice(), twins.as_slice());
        let work = part::Work {
            index,
            masks,
            choices,
            guides,
            guide_channels,
            twins,
            second,
            neighbours,
            job,
            plans,
            run,
        };
        let mut done = bands::fill(&mut frame, &work, &found.parts[index])?;
        let same = done.report.channels.iter().all(|channel| channel.filled == 0) && !done.converted;
        // A restoration fills nothing and changes all.
        let copied = same && done.report.groups.is_empty();
        let part = &mut frame.parts[index];
        if copied {
            done.notes.extend(non_finite_copied(part, masks, choices, index));
        }
        done.notes.extend(done.report.non_finite());
        let mask = mask_name(part, masks, index);
        let (notes, dropped) = finish(part, masks, index, job);
        if !copied || dropped {
            done.notes.extend(drop_derived(part));
            stamp.with_mask(mask).sign(&mut part.attributes, masks.part_density(index), &done.report);
            stamp::write_estimate(&mut part.attributes, &done.report);
            stamp::write_neighbours(&mut part.attributes, &done.report, neighbours);
        }
        if let Some(name) = &job.error_channel {
            done.notes.extend(estimate::without_errors(&done.untold));
            done.notes.extend(estimate::add_channels(part, name, std::mem::take(&mut done.errors)));
        }
        report.copied &= copied;
        done.notes.extend(notes);
        report.notes.extend(prefixed(&label, done.notes));
        report.parts.push(done.report);
    }
    report.notes.extend(report.copied.then(|| copied_note(job)));
    stamp_copies(&mut frame, masks, job, &stamp, &report);
    report.total();
    Ok((frame, report))
}

/// What is told of a frame in which nothing was filled.
fn copied_note(job: &Job) -> String {
    let why = if job.mask == Source::Finite { ", as no pixel is NaN" } else { "" };
    format!("nothing is to be filled{why}: the pixels are copied")
}

/// Notes that name their part.
pub fn prefixed(label: &str, notes: Vec<String>) -> Vec<String> {
    let prefix = if label.is_empty() { String::new() } else { format!("{label}: ") };
    notes.into_iter().map(|note| format!("{prefix}{note}")).collect()
}

/// Stamps every part of a frame in which nothing was filled: what was asked for is needed to tell that this is right.
fn stamp_copies(frame: &mut Frame, masks: &Masks, job: &Job, stamp: &Stamp, report: &Report) {
    let of_job = |part: &Part| Stamp::read(&part.attributes).is_some_and(|own| own.is_of(job));
    if frame.parts.iter().any(of_job) || (masks.is_full() && job.compression.is_none()) {
        return;
    }
    for (index, part) in frame.parts.iter_mut().enumerate() {
        let mask = mask_name(part, masks, index);
        let density = masks.part_density(index).unwrap_or(1.0);
        stamp.with_mask(mask).write(&mut part.attributes, density, Stop::Converged);
        report.parts.get(index).into_iter().for_each(|own| stamp::write_kept(&mut part.attributes, own));
    }
}

/// Where the part's mask was found; masks that do not share a name keep the part's own, if it says so already.
fn mask_name(part: &Part, masks: &Masks, index: usize) -> String {
    let own = part.attributes.text(ATTRIBUTE).filter(|name| {
        let is = |at: &usize| part.channels.get(*at).is_some_and(|channel| channel.name == name.as_bytes());
        masks.mask_channels.get(index).is_some_and(|channels| channels.iter().any(is))
    });
    own.unwrap_or_else(|| masks.origin.clone())
}

/// Removes the attributes that the new pixels turn into lies, and says so.
fn drop_derived(part: &mut Part) -> Option<String> {
    let dropped = stamp::remove(&mut part.attributes, DERIVED.iter().copied());
    dropped_note(&dropped)
}

/// Says how many values are not finite in channels that a full mask leaves alone.
fn non_finite_copied(part: &Part, masks: &Masks, choices: &[Choice], index: usize) -> Option<String> {
    let computed = |channel: &usize| matches!(choices[*channel].rule, Rule::Fill | Rule::Normal);
    let served = |channel: &usize| masks.get(index, *channel).is_some();
    let channels = (0..part.channels.len()).filter(computed).filter(served);
    let counts = channels.map(|at| &part.channels[at]);
    let counts = counts.map(|channel| (channel.display_name(), non_finite(&channel.samples)));
    let said = [
        "value is not finite and stays, as the mask calls it measured (--mask nan)",
        "values are not finite and stay, as the mask calls them measured (--mask nan)",
    ];
    non_finite_note(said, counts)
}

/// Says that `--drop-mask` leaves nothing out.
fn nothing_dropped(masks: &Masks, job: &Job) -> Option<String> {
    let none = job.drop_mask && (0..masks.mask_channels.len()).all(|part| masks.droppable(part).is_empty());
    let why = if masks.are_counts() { "counts samples and stays" } else { "is no channel of the frame" };
    none.then(|| format!("--drop-mask leaves nothing out: the mask ({}) {why}", masks.origin))
}

/// Compression, levels and the mask channels, which do not depend on the pixels. Returns what to tell, and whether
/// channels were left out.
fn finish(part: &mut Part, masks: &Masks, index: usize, job: &Job) -> (Vec<String>, bool) {
    let mut notes = make_writable(part, job.compression);
    let before = part.channels.len();
    let dropped = if job.drop_mask { masks.droppable(index) } else { &[] };
    if dropped.len() < before {
        let mut at = 0..before;
        part.channels.retain(|_| at.next().is_none_or(|channel| !dropped.contains(&channel)));
    } else if before > 0 {
        notes.push("the mask is the only channel and stays".into());
    }
    let dropped = part.channels.len() < before;
    (notes, dropped)
}
