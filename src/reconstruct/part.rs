//! The channels of one part: filtered, copied, bounded, and written where pixels are missing.

mod filter;
mod shape;

use std::sync::Arc;

use half::slice::HalfFloatSliceExt;
use lacuna_core::parallel::prelude::*;
use lacuna_exr::{Frame, Part, Samples};
use lacuna_filters::baseline::nearest::NearestMap;
use lacuna_filters::estimate::Repeated;
use lacuna_filters::fill::Values;
use lacuna_filters::limiter::Moved;
use lacuna_filters::variational::guided::Guides;
use lacuna_filters::{Mask, Plane, Run};

pub use filter::{channel_names, overflow_note, values_options};
pub use shape::{EMPTY, is_black_where_empty};

use super::apply::{Change, apply};
use super::groups::{Target, copyable, targets, usable};
use super::twins::{self, Known};
use super::{
    ChannelReport, Error, GroupReport, Job, NoiseSource, PIECE, PartReport, Plans, gradients, learned,
};
use crate::channels::{Choice, Rule, channel_label};
use crate::guides::Guide;
use crate::mask::Masks;
use crate::temporal::Neighbours;

/// What is to be done to a part, and with what.
#[derive(Clone, Copy)]
pub struct Work<'a> {
    /// The part's place in the frame.
    pub index: usize,
    /// The frame's masks.
    pub masks: &'a Masks,
    /// The part's channel rules.
    pub choices: &'a [Choice],
    /// Complete planes that may steer the colour, for each of its views.
    pub guides: &'a [(Option<String>, Guides)],
    /// The channels that these are.
    pub guide_channels: &'a [Guide],
    /// Complete channels that hold the values of those to be filled.
    pub twins: &'a [Known],
    /// The frame that guides come from, if it is another one.
    pub second: Option<&'a Frame>,
    /// The frames before and after it.
    pub neighbours: Option<&'a Neighbours>,
    /// What was asked for.
    pub job: &'a Job,
    /// Plans made before.
    pub plans: &'a Plans,
    /// How to run.
    pub run: &'a Run<'a>,
}

impl<'a> Work<'a> {
    /// A part without frames beside it, whose guides are none of its own channels.
    pub fn alone(
        (index, masks, choices): (usize, &'a Masks, &'a [Choice]),
        guides: &'a [(Option<String>, Guides)],
        job: &'a Job,
        plans: &'a Plans,
        run: &'a Run<'a>,
    ) -> Self {
        let (guide_channels, twins, second, neighbours) = (&[][..], &[][..], None, None);
        Self { index, masks, choices, guides, guide_channels, twins, second, neighbours, job, plans, run }
    }

    /// The guides of channels of a view, if there are any.
    pub fn guides_of(&self, view: Option<&str>) -> Option<&'a Guides> {
        let own = |(of, _): &&(Option<String>, Guides)| of.is_none() || of.as_deref() == view;
        self.guides.iter().find(own).map(|(_, guides)| guides).filter(|guides| !guides.is_empty())
    }
}

/// What was done to a part.
#[derive(Debug, Default)]
pub struct Done {
    /// Channels and groups.
    pub report: PartReport,
    /// Whether a channel has another type now.
    pub converted: bool,
    /// For the log, as warnings.
    pub notes: Vec<String>,
    /// For the log, of what was done as asked.
    pub remarks: Vec<String>,
    /// The estimated error of layers, if it is to be written: the layer's first channel, and the error.
    pub errors: Vec<(String, Plane)>,
    /// Channels of light whose error nothing is known of, and why.
    pub untold: Vec<(Vec<String>, String)>,
}

/// A channel's values after the filter, before they are written.
struct Filled {
    channel: usize,
    /// The values that count as measured.
    mask: Arc<Mask>,
    samples: Vec<f32>,
    values: Vec<f32>,
    limited: Moved,
    /// Whether measured pixels are smoothed, too.
    all: bool,
    /// Whether missing ones are copied from a complete channel, and stay as they are.
    copied: bool,
}

/// Fills one part of a frame, in place.
pub fn fill(frame: &mut Frame, work: &Work<'_>) -> Result<Done, Error> {
    let restores = work.job.method.restores() || work.job.noise != NoiseSource::None;
    let mut targets = targets(frame, work.index, work.masks, work.choices, restores)?;
    let part = &frame.parts[work.index];
    let mut done = Done { report: blank_report(part, work.choices), ..Done::default() };
    let mut changes: Vec<Option<Change>> = vec![None; part.channels.len()];
    for channel in gradients::used(part, &targets, &work.job.method) {
        targets.retain(|target| target.channel != channel);
        let report = &mut done.report.channels[channel];
        (report.rule, report.why) = (Rule::Keep, "samples of the gradient".into());
        (changes[channel], report.non_finite) = finite_slopes(frame, work, channel)?;
    }
    let (blank, [telling, noisy]) = work.job.noise.groups(frame, work.index, &mut targets)?;
    for channel in blank {
        let report = &mut done.report.channels[channel];
        (report.rule, report.why) = (Rule::Keep, "no measured value is finite".into());
    }
    done.notes.extend(work.job.noise.untold(part, &noisy));
    let noisy = work.job.noise.split(part, noisy);
    let carriers = filter::along_motion(frame, work, &noisy, &mut done)?;
    let noiseless =
        (work.job.noise != NoiseSource::None).then(|| Job { noise: NoiseSource::None, ..work.job.clone() });
    let plain = Work { job: noiseless.as_ref().unwrap_or(work.job), ..*work };
    let mut filled = Vec::new();
    let repeated = Repeated::default();
    for (work, groups) in [(work, noisy), (&plain, telling)] {
        let mut assigned = learned::assign(part, groups, &work.job.method);
        assigned.sort_by_key(|(group, _)| (group.values != Values::Light, !group.colours));
        for (group, method) in assigned {
            filled.extend(filter::filter(
                frame,
                (work, &carriers, &repeated),
                (&group, method),
                &mut targets,
                &mut done,
            )?);
        }
    }
    // Sets of other masks come apart in the filter; the report has them in the order of the channels.
    let first = |group: &GroupReport| {
        let name = group.channels.first();
        done.report.channels.iter().position(|channel| Some(&channel.name) == name)
    };
    done.report.groups.sort_by_key(first);
    shape::unit_normals(frame, work, &mut filled, &mut done)?;
    shape::on_surfaces(frame, work, &mut filled, &mut done)?;
    shape::empty_stays_black(frame, work, &mut filled);
    let any = filled.iter().any(|filled| filled.all);
    for Filled { channel, mask, values, limited, all, .. } in filled {
        done.report.channels[channel].limit(limited);
        changes[channel] = Some(Change::Values { values, mask, all });
    }
    for target in targets.iter().filter(|target| matches!(target.rule, Rule::Nearest | Rule::Depth)) {
        changes[target.channel] = Some(chosen(frame, work, target, &targets, &mut done)?);
    }
    for target in &targets {
        let report = &mut done.report.channels[target.channel];
        report.filled = target.mask.as_slice().len() - target.mask.count();
        report.non_finite = target.non_finite;
    }
    if any {
        done.notes.push("measured pixels are smoothed, as asked".into());
    }
    write(frame, work, &changes, &mut done);
    Ok(done)
}

/// Puts what changed into the part's channels, and says what that cost.
fn write(frame: &mut Frame, work: &Work<'_>, changes: &[Option<Change>], done: &mut Done) {
    let applied = apply(&mut frame.parts[work.index], changes, work.choices, work.job.kind);
    let mut rounded = 0;
    for (report, applied) in done.report.channels.iter_mut().zip(applied) {
        report.clamped_halves = applied.loss.clamped;
        rounded += applied.loss.rounded;
        done.converted |= applied.converted;
    }
    if rounded > 0 {
        done.notes.push(format!("{rounded} measured values changed because -d half was asked for"));
    }
}

/// Samples of a gradient that are not finite take the nearest one that is, measured ones counted.
fn finite_slopes(frame: &Frame, work: &Work<'_>, channel: usize) -> Result<(Option<Change>, usize), Error> {
    let samples = &frame.parts[work.index].channels[channel].samples;
    let Some(measured) = work.masks.get(work.index, channel) else { return Ok((None, 0)) };
    let values = samples.to_floats().ok_or(Error::OtherFrame)?;
    let flags: Vec<bool> = values.iter().map(|value| value.is_finite()).collect();
    let fail = |source| Error::Filter { channel: channel_label(frame, work.index, channel), source };
    let mask = Mask::new(measured.size(), flags).map_err(fail)?;
    if mask.is_full() {
        return Ok((None, 0));
    }
    let finite = usable(Rule::Fill, samples, measured)?;
    if finite.is_empty() {
        let name = frame.parts[work.index].channels[channel].display_name().into_owned();
        return Err(Error::NothingFinite { channel: channel_label(frame, work.index, channel), name });
    }
    let map = work.plans.nearest(&finite).map_err(fail)?;
    Ok((Some(Change::Copies { map, mask: Arc::new(mask) }), measured.count() - finite.count()))
}

fn blank_report(part: &Part, choices: &[Choice]) -> PartReport {
    let channel = |(index, choice): (usize, &Choice)| ChannelReport {
        name: part.channels[index].display_name().into_owned(),
        rule: choice.rule,
        why: choice.why.clone(),
        filled: 0,
        non_finite: 0,
        limited: 0,
        largest_move: 0.0,
        clamped_halves: 0,
    };
    PartReport {
        name: part.name(),
        channels: choices.iter().enumerate().map(channel).collect(),
        groups: Vec::new(),
        copied: Vec::new(),
        neighbours: Vec::new(),
    }
}

/// A channel's measured values, zero elsewhere.
pub fn measured_floats(samples: &Samples, mask: &Mask) -> Result<Vec<f32>, Error> {
    let mut floats = vec![0.0; samples.len()];
    let pieces = floats.par_chunks_mut(PIECE).zip(mask.as_slice().par_chunks(PIECE));
    match samples {
        Samples::Half(values) => {
            pieces.zip(values.par_chunks(PIECE)).for_each(|((floats, flags), values)| {
                values.convert_to_f32_slice(&mut floats[..values.len()]);
                floats.iter_mut().zip(flags).for_each(|(value, &flag)| *value = only(*value, flag));
            });
        }
        Samples::Float(values) => {
            pieces.zip(values.par_chunks(PIECE)).for_each(|((floats, flags), values)| {
                let places = floats.iter_mut().zip(flags).zip(values);
                places.for_each(|((place, &flag), &value)| *place = only(value, flag));
            });
        }
        Samples::Uint(_) => return Err(Error::OtherFrame),
    }
    Ok(floats)
}

/// The value if it counts, else zero. By bits: a choice would become a branch.
fn only(value: f32, counts: bool) -> f32 {
    f32::from_bits(value.to_bits() & u32::from(counts).wrapping_neg())
}

/// What becomes of an identifier, a motion vector or a depth: it is copied, from a complete depth that holds its values or from measured pixels.
fn chosen(
    frame: &Frame,
    work: &Work<'_>,
    target: &Target,
    targets: &[Target],
    done: &mut Done,
) -> Result<Change, Error> {
    let mask = Arc::clone(&target.mask);
    if target.rule == Rule::Depth
        && let Some(twin) = twins::twin(frame, work, target.channel)
    {
        twins::tell(frame, work, target.channel, &mut done.report);
        return Ok(Change::Values { values: twin.pixels().to_vec(), mask, all: false });
    }
    Ok(Change::Copies { map: sources(frame, work, target, targets)?, mask })
}

/// Which measured pixel each pixel of an identifier, a motion vector or a depth takes its bits from.
fn sources(
    frame: &Frame,
    work: &Work<'_>,
    target: &Target,
    targets: &[Target],
) -> Result<Arc<NearestMap>, Error> {
    let fail = |source| Error::Filter { channel: channel_label(frame, work.index, target.channel), source };
    let mask = &target.mask;
    if target.rule == Rule::Nearest {
        let mask = copyable(&frame.parts[work.index], target, targets)?;
        return work.plans.nearest(&mask).map_err(fail);
    }
    let depth = measured_floats(&frame.parts[work.index].channels[target.channel].samples, mask)?;
    let depth = Plane::new(mask.size(), depth).map_err(fail)?;
    work.plans.depth(mask).and_then(|plan| plan.choose(&depth)).map(Arc::new).map_err(fail)
}
