//! One frame in, a larger frame out; pure.
//!
//! ```text
//! part ──> fill (missing pixels by the rules) ──> each channel by its rule onto the larger grid ──> windows, types, stamp
//! ```
//!
//! Colour, alpha and positions are reconstructed by the method; normals too, and made unit length again; depths,
//! identifiers and everything that is kept (the sampling mask as well) take the bits of the pixel that they lie in, so
//! that no value appears that was not there. Values that are not finite count as missing. With total variation what was
//! missing does not bind the result: filling and enlarging are one problem. With splines they are one too: among the splines
//! whose reduction passes through the measured pixels, the one whose reduction has the least energy.

mod channels;
mod target;
mod windows;

use std::sync::Arc;

use lacuna_exr::Frame;
use lacuna_filters::upscale::{Geometry, Method, Sampling};
use lacuna_filters::variational::guided::Guides;
use lacuna_filters::{Run, Stop};
pub use target::Target;
pub use windows::Windows;

use super::groups::usable;
use super::part::{self, Done};
use super::{Error, Job, Kind, Plans, Report, Stamp, drop_derived, finish, mask_name, prefixed};
use crate::channels::{Choice, channel_label, part_label, unheeded};
use crate::mask::Masks;

/// How frames are enlarged.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Enlarge {
    /// By how much, or to what size.
    pub target: Target,
    /// How.
    pub method: Method,
    /// The model of a low-resolution pixel.
    pub sampling: Sampling,
}

impl Enlarge {
    /// The name that `--filter` takes.
    pub const fn name(&self) -> &'static str {
        match &self.method {
            Method::Tv(_) => "tv",
            Method::Plain(kernel) => kernel.name(),
            _ => "ss",
        }
    }

    /// Everything that changes the result, `name=value` separated by spaces.
    pub fn settings(&self) -> String {
        let line = format!("upscale={} {} sampling={}", self.name(), self.target, self.sampling);
        match self.method {
            Method::Tv(settings) => format!("{line} {}", lacuna_filters::Method::from(settings).settings()),
            _ => line,
        }
    }
}

/// Fills and enlarges a frame.
pub fn enlarge(
    mut frame: Frame,
    masks: &Masks,
    choices: &[Vec<Choice>],
    (job, asked): (&Job, &Enlarge),
    plans: &Plans,
    run: &Run<'_>,
) -> Result<(Frame, Report), Error> {
    let stamp = Stamp::new(job, &masks.origin);
    let notes =
        [masks.notes.clone(), unheeded(&frame, &masks.mask_channels, &job.overrides, choices)].concat();
    let mut report = Report::new(&stamp, masks.density(), notes);
    let (finite, lost) = finite(&frame, masks, choices)?;
    for (index, choices) in choices.iter().enumerate() {
        let label = part_label(&frame, index);
        let windows = Windows::of(&frame.parts[index], &asked.target).map_err(|why| Error::Enlarge {
            part: if label.is_empty() { String::new() } else { format!("{label}: ") },
            why,
        })?;
        let kinds: Vec<_> =
            frame.parts[index].channels.iter().map(|channel| channel.samples.kind()).collect();
        let mut done = low(&mut frame, (index, &finite, choices), job, plans, run)?;
        for (channel, lost) in done.report.channels.iter_mut().zip(&lost[index]) {
            channel.non_finite += lost;
        }
        done.notes.extend(done.report.non_finite());
        let geometry = windows.geometry(asked.sampling);
        let guides = Guides::new(frame.parts[index].size());
        let work = part::Work { index, masks: &finite, choices, guides: &guides, job, plans, run };
        channels::enlarge(&mut frame, (&work, &kinds), (geometry, asked.method), &mut done)?;
        let part = &mut frame.parts[index];
        (part.data_window, part.display_window) = (windows.data, windows.display);
        let mask = mask_name(part, masks, index);
        let (notes, _) = finish(part, masks, index, job);
        done.notes.extend(notes);
        done.notes.extend(drop_derived(part));
        let stop = done.report.groups.iter().map(|group| group.outcome.stop).max();
        let density = masks.part_density(index).unwrap_or(1.0);
        stamp.with_mask(mask).write(&mut part.attributes, density, stop.unwrap_or(Stop::Converged));
        report.notes.extend(prefixed(&label, done.notes));
        report.parts.push(done.report);
    }
    report.total();
    Ok((frame, report))
}

/// Fills the part on its own grid, with floats in place of halves where something is missing, so that nothing is rounded twice.
fn low(
    frame: &mut Frame,
    (index, masks, choices): (usize, &Masks, &[Choice]),
    job: &Job,
    plans: &Plans,
    run: &Run<'_>,
) -> Result<Done, Error> {
    let missing = masks.channels[index].iter().flatten().any(|mask| !mask.is_full());
    let job = Job { kind: missing.then_some(Kind::Float), enlarge: None, ..job.clone() };
    let guides = Guides::new(frame.parts[index].size());
    let work = part::Work { index, masks, choices, guides: &guides, job: &job, plans, run };
    part::fill(frame, &work)
}

/// The masks without the pixels whose value a rule cannot use, and how many these are for each channel.
fn finite(frame: &Frame, masks: &Masks, choices: &[Vec<Choice>]) -> Result<(Masks, Vec<Vec<usize>>), Error> {
    let mut finite = masks.clone();
    let mut lost = Vec::with_capacity(choices.len());
    for (index, choices) in choices.iter().enumerate() {
        let mut counts = vec![0; choices.len()];
        for (channel, choice) in choices.iter().enumerate() {
            let Some(mask) = masks.get(index, channel) else { continue };
            let content = &frame.parts[index].channels[channel];
            let usable = usable(choice.rule, &content.samples, mask)?;
            if Arc::ptr_eq(&usable, mask) {
                continue;
            }
            if usable.is_empty() {
                let name = content.display_name().into_owned();
                return Err(Error::NothingFinite { channel: channel_label(frame, index, channel), name });
            }
            counts[channel] = mask.count() - usable.count();
            let known = finite.channels[index][..channel].iter().flatten().find(|other| ***other == *usable);
            let shared = known.cloned().unwrap_or(usable);
            finite.channels[index][channel] = Some(shared);
        }
        lost.push(counts);
    }
    Ok((finite, lost))
}

impl Windows {
    /// Where the pixels lie.
    fn geometry(&self, sampling: Sampling) -> Geometry {
        Geometry { vertical: self.vertical, horizontal: self.horizontal, sampling }
    }
}
