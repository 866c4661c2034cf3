//! The channels of one part: filtered, copied, bounded, and written where pixels are missing.

use std::sync::Arc;

use half::slice::HalfFloatSliceExt;
use lacuna_core::parallel::prelude::*;
use lacuna_exr::{Frame, Part, Samples};
use lacuna_filters::baseline::nearest::NearestMap;
use lacuna_filters::variational::guided::Guides;
use lacuna_filters::{Mask, Plane, Planes, Run};

use super::apply::{Change, apply};
use super::bounds::{Bounds, bounds_of};
use super::groups::{Group, Target, copyable, groups, targets};
use super::solve::{Question, overflow_note, solve};
use super::{ChannelReport, Error, GroupReport, Job, PIECE, PartReport, Plans, gradients, learned, normals};
use crate::channels::{self, Choice, Rule, channel_label};
use crate::mask::Masks;

/// What is to be done to a part, and with what.
#[derive(Clone, Copy)]
pub struct Work<'a> {
    /// The part's place in the frame.
    pub index: usize,
    /// The frame's masks.
    pub masks: &'a Masks,
    /// The part's channel rules.
    pub choices: &'a [Choice],
    /// Complete planes that may steer the colour.
    pub guides: &'a Guides,
    /// What was asked for.
    pub job: &'a Job,
    /// Plans made before.
    pub plans: &'a Plans,
    /// How to run.
    pub run: &'a Run<'a>,
}

/// What was done to a part.
#[derive(Debug, Default)]
pub struct Done {
    /// Channels and groups.
    pub report: PartReport,
    /// Whether a channel has another type now.
    pub converted: bool,
    /// For the log.
    pub notes: Vec<String>,
}

/// A channel's values after the filter, before they are written.
struct Filled {
    target: Target,
    samples: Vec<f32>,
    values: Vec<f32>,
    limited: usize,
}

/// Fills one part of a frame, in place.
pub fn fill(frame: &mut Frame, work: &Work<'_>) -> Result<Done, Error> {
    let mut targets = targets(frame, work.index, work.masks, work.choices, work.job.method.restores())?;
    let part = &frame.parts[work.index];
    let mut done = Done { report: blank_report(part, work.choices), ..Done::default() };
    for channel in gradients::used(part, &targets, &work.job.method) {
        targets.retain(|target| target.channel != channel);
        let report = &mut done.report.channels[channel];
        (report.rule, report.why) = (Rule::Keep, "samples of the gradient".into());
    }
    let mut filled = Vec::new();
    for (group, job) in learned::assign(part, groups(frame, work.index, &targets), work.job) {
        let own = Work { job: &job, ..*work };
        let before = done.report.groups.len();
        filled.extend(filter(frame, &own, &group, &targets, &mut done)?);
        if job.method.name() != work.job.method.name() {
            let names = done.report.groups[before..].iter().flat_map(|group| group.channels.clone());
            let names = names.collect::<Vec<_>>().join(", ");
            done.notes.push(format!("{names}: not of the dictionary, filled by {}", job.method.name()));
        }
    }
    unit_normals(frame, work, &mut filled, &mut done)?;
    let mut changes: Vec<Option<Change>> = vec![None; part.channels.len()];
    let all = !work.job.method.keeps_measured();
    for Filled { target, values, limited, .. } in filled {
        done.report.channels[target.channel].limited = limited;
        changes[target.channel] = Some(Change::Values { values, mask: target.mask, all });
    }
    for target in targets.iter().filter(|target| matches!(target.rule, Rule::Nearest | Rule::Depth)) {
        let map = sources(frame, work, target, &targets)?;
        changes[target.channel] = Some(Change::Copies { map, mask: Arc::clone(&target.mask) });
    }
    for target in &targets {
        let report = &mut done.report.channels[target.channel];
        report.filled = target.mask.as_slice().len() - target.mask.count();
        report.non_finite = target.non_finite;
    }
    if all && !done.report.groups.is_empty() {
        done.notes.push("measured pixels are smoothed, as asked".into());
    }
    let applied = apply(&mut frame.parts[work.index], &changes, work.choices, work.job.kind);
    let mut rounded = 0;
    for (report, applied) in done.report.channels.iter_mut().zip(applied) {
        report.clamped_halves = applied.loss.clamped;
        rounded += applied.loss.rounded;
        done.converted |= applied.converted;
    }
    if rounded > 0 {
        done.notes.push(format!("{rounded} measured values changed because -d half was asked for"));
    }
    Ok(done)
}

fn blank_report(part: &Part, choices: &[Choice]) -> PartReport {
    let channel = |(index, choice): (usize, &Choice)| ChannelReport {
        name: part.channels[index].display_name().into_owned(),
        rule: choice.rule,
        why: choice.why.clone(),
        filled: 0,
        non_finite: 0,
        limited: 0,
        clamped_halves: 0,
    };
    PartReport {
        name: part.name(),
        channels: choices.iter().enumerate().map(channel).collect(),
        groups: Vec::new(),
    }
}

/// Runs the filter on a group, with the domain and the limiter around it.
fn filter(
    frame: &Frame,
    work: &Work<'_>,
    group: &Group,
    targets: &[Target],
    done: &mut Done,
) -> Result<Vec<Filled>, Error> {
    let part = &frame.parts[work.index];
    let fail =
        |source| Error::Filter { channel: channel_label(frame, work.index, group.channels[0]), source };
    let mask = &group.mask;
    let plane = |&channel: &usize| {
        let values = measured_floats(&part.channels[channel].samples, mask)?;
        Plane::new(mask.size(), values).map_err(fail)
    };
    let planes = group.channels.iter().map(plane).collect::<Result<_, _>>()?;
    let samples = Planes::new(mask.size(), planes).map_err(fail)?;
    let names: Vec<_> =
        group.channels.iter().map(|&at| part.channels[at].display_name().into_owned()).collect();
    let bounds = names.iter().map(|name| if group.normal { Bounds::Free } else { bounds_of(name) });
    let gradients = gradients::find(frame, work, group).map_err(fail)?;
    let steered = !group.normal && names.iter().all(|name| !channels::is_position(name));
    let question = Question {
        mask,
        weights: weights(frame, work, group, &mut done.notes)?,
        light: group.light,
        limit: !group.normal,
        bounds: bounds.collect(),
        gradients,
        guides: steered.then_some(work.guides),
    };
    let answer = solve(&question, &samples, work.job, work.plans, work.run).map_err(fail)?;
    done.notes.extend(overflow_note(&names, answer.mended));
    if !work.job.method.keeps_measured() && answer.map.name() == "log" {
        done.notes
            .push(format!("{}: smoothed in the log domain, whose unit the setting has", names.join(", ")));
    }
    done.report.groups.push(GroupReport {
        channels: names,
        domain: answer.map.name(),
        guides: answer.guides,
        guides_gain: answer.gain,
        outcome: answer.outcome,
    });
    let planes = samples.into_vec().into_iter().zip(answer.planes.into_vec()).zip(answer.limited);
    let filled = group.channels.iter().zip(planes).filter_map(|(&channel, ((samples, values), limited))| {
        let target = targets.iter().find(|target| target.channel == channel)?.clone();
        Some(Filled { target, samples: samples.into_pixels(), values: values.into_pixels(), limited })
    });
    Ok(filled.collect())
}

/// How much each measured pixel of a group counts, if not all alike.
fn weights(
    frame: &Frame,
    work: &Work<'_>,
    group: &Group,
    notes: &mut Vec<String>,
) -> Result<Option<Arc<Plane>>, Error> {
    let Some(weights) = &work.job.weights else { return Ok(None) };
    let (plane, empty) = weights.plane(frame, work.index, &group.mask)?;
    if empty > 0 {
        let name = channel_label(frame, work.index, group.channels[0]);
        notes.push(format!("{name}: {empty} measured pixels count no sample and weigh nothing"));
    }
    Ok(Some(plane))
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

/// Gives every whole normal unit length.
fn unit_normals(frame: &Frame, work: &Work<'_>, filled: &mut [Filled], done: &mut Done) -> Result<(), Error> {
    let part = &frame.parts[work.index];
    for channel in 0..part.channels.len() {
        let Some(triple) = channels::normal_triple(part, work.choices, channel) else { continue };
        let at = |wanted: usize| filled.iter().position(|filled| filled.target.channel == wanted);
        let (Some(x), Some(y), Some(z)) = (at(triple[0]), at(triple[1]), at(triple[2])) else { continue };
        if triple.iter().min() != Some(&channel) {
            continue;
        }
        let fail = |source| Error::Filter { channel: channel_label(frame, work.index, channel), source };
        let masks = [x, y, z].map(|at| Arc::clone(&filled[at].target.mask));
        let all = normals::kept(&masks, work.job.method.keeps_measured());
        let both = normals::both(&masks);
        if !normals::are_unit([x, y, z].map(|at| filled[at].samples.as_slice()), &both) {
            let name = part.channels[channel].display_name();
            done.notes
                .push(format!("channel {name}: measured normals are not of unit length, so none is scaled"));
            continue;
        }
        let Ok([a, b, c]) = filled.get_disjoint_mut([x, y, z]) else { continue };
        let nearest = work.plans.nearest(&both).map_err(fail)?;
        let samples = [a.samples.as_slice(), &b.samples, &c.samples];
        normals::normalise([&mut a.values, &mut b.values, &mut c.values], samples, &all, nearest.as_slice());
    }
    Ok(())
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
