//! The channels of one part: filtered, copied, bounded, and written where pixels are missing.

use std::sync::Arc;

use half::slice::HalfFloatSliceExt;
use lacuna_core::parallel::prelude::*;
use lacuna_exr::{Frame, Part, Samples};
use lacuna_filters::baseline::nearest::NearestMap;
use lacuna_filters::domain::Domain;
use lacuna_filters::fill::{Options, Set, Values, fill_with};
use lacuna_filters::limiter::Moved;
use lacuna_filters::noise::Noise;
use lacuna_filters::variational::guided::Guides;
use lacuna_filters::{Bounds, Mask, Method, Plane, Planes, Run};

use super::apply::{Change, apply};
use super::bounds::bounds_of;
use super::estimate::{Estimated, untold};
use super::groups::{Group, Target, copyable, targets, usable};
use super::normals::Lengths;
use super::{
    ChannelReport, Error, GroupReport, Job, NoiseSource, PIECE, PartReport, Plans, Weights, energy,
    gradients, learned, normals, surfaces,
};
use crate::channels::{self, Choice, Name, Rule, channel_label};
use crate::mask::Masks;
use crate::temporal::{Carrier, Neighbours, Reference, carriers};

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
    /// The frames before and after it.
    pub neighbours: Option<&'a Neighbours>,
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
    let carriers = along_motion(frame, work, &noisy, &mut done)?;
    let noiseless =
        (work.job.noise != NoiseSource::None).then(|| Job { noise: NoiseSource::None, ..work.job.clone() });
    let plain = Work { job: noiseless.as_ref().unwrap_or(work.job), ..*work };
    let mut filled = Vec::new();
    for (work, groups) in [(work, noisy), (&plain, telling)] {
        for (group, method) in learned::assign(part, groups, &work.job.method) {
            filled.extend(filter(frame, (work, &carriers), (&group, method), &mut targets, &mut done)?);
        }
    }
    // Sets of other masks come apart in the filter; the report has them in the order of the channels.
    let first = |group: &GroupReport| {
        let name = group.channels.first();
        done.report.channels.iter().position(|channel| Some(&channel.name) == name)
    };
    done.report.groups.sort_by_key(first);
    unit_normals(frame, work, &mut filled, &mut done)?;
    on_surfaces(frame, work, &mut filled, &mut done)?;
    let any = filled.iter().any(|filled| filled.all);
    for Filled { channel, mask, values, limited, all, .. } in filled {
        done.report.channels[channel].limit(limited);
        changes[channel] = Some(Change::Values { values, mask, all });
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
    if any {
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
        neighbours: Vec::new(),
    }
}

/// Fills a group of channels, and says in the report and in its targets what was found.
fn filter(
    frame: &Frame,
    (work, carriers): (&Work<'_>, &[Carrier<'_>]),
    (group, method): (&Group, Method),
    targets: &mut [Target],
    done: &mut Done,
) -> Result<Vec<Filled>, Error> {
    let part = &frame.parts[work.index];
    let fail = |source| failed(frame, work, group, source);
    let mask = &group.mask;
    let plane = |&channel: &usize| {
        let values = measured_floats(&part.channels[channel].samples, mask)?;
        Plane::new(mask.size(), values).map_err(fail)
    };
    let planes = group.channels.iter().map(plane).collect::<Result<_, _>>()?;
    let samples = Planes::new(mask.size(), planes).map_err(fail)?;
    let names = channel_names(part, group);
    let mut options = options(frame, work, (group, method), &names)?;
    let (noise, note) = work.job.noise.of(part, group, &samples)?;
    options.noise = noise;
    done.notes.extend(note);
    let carried: Vec<_> = carriers.iter().filter_map(|carrier| carrier.carried(&names)).collect();
    if group.values != Values::Directions {
        options.carried = &carried;
    }
    let answer = fill_with(&samples, mask, &options, work.plans, work.run).map_err(fail)?;
    let coordinates = names.iter().any(|name| channels::is_coordinate(name));
    let light = group.values == Values::Light && options.keeps_measured();
    for set in &answer.sets {
        let error = set.errors.as_ref().filter(|_| group.values == Values::Light);
        done.errors.extend(error.map(|error| (names[set.planes[0]].clone(), error.clone())));
        let names: Vec<_> = set.planes.iter().map(|&at| names[at].clone()).collect();
        if let Some(why) = untold(set).filter(|_| group.values == Values::Light) {
            done.untold.push((names.clone(), why));
        }
        done.notes.extend(set_notes(set, &names, work.job));
        if set.weightless > 0 {
            let missing = options.noise != Noise::None;
            let then = if missing { "are filled like missing ones" } else { "weigh nothing" };
            let what = format!("measured pixels count no sample and {then}");
            done.notes.push(format!("{}: {} {what}", names.join(", "), set.weightless));
        }
        done.report.groups.push(GroupReport {
            channels: names,
            domain: set.map.name(),
            guides: set.guides.clone(),
            guides_gain: set.gain,
            neighbours_gain: set.along,
            chosen: set.shares.iter().map(|(name, share)| ((*name).into(), *share)).collect(),
            settled: set.settled.iter().map(ToString::to_string).collect(),
            estimate: Estimated::of_set(set, options.estimate, coordinates),
            exponent: set.exponent,
            energy: light
                .then(|| energy::compare(&lights(&samples, &answer.planes, set), &set.mask))
                .flatten(),
            outcome: set.outcome,
            noiseless: options.noise != Noise::None
                && !(set.smoothed || work.run.interrupted().is_some())
                && set.settled.is_empty(),
        });
    }
    let smooths = |set: &&Set| set.smoothed || !set.method.keeps_measured();
    let smooths = answer.sets.iter().filter(smooths).flat_map(|set| &set.planes);
    let smoothed: Vec<usize> = smooths.map(|&at| group.channels[at]).collect();
    let masks: Vec<_> = (0..names.len()).map(|at| answer.mask(at).map_or(mask, |own| own).clone()).collect();
    let planes = samples.into_vec().into_iter().zip(answer.planes.into_vec()).zip(answer.limited);
    let counted = group.channels.iter().zip(masks).zip(answer.non_finite);
    let filled = counted.zip(planes).map(|(((&channel, mask), non_finite), ((samples, values), limited))| {
        for target in targets.iter_mut().filter(|target| target.channel == channel) {
            (target.mask, target.non_finite) = (Arc::clone(&mask), non_finite);
        }
        let all = smoothed.contains(&channel);
        Filled { channel, mask, samples: samples.into_pixels(), values: values.into_pixels(), limited, all }
    });
    Ok(filled.collect())
}

/// The samples of the frames beside it, at their places in this part; its colours tell which places are likely.
fn along_motion<'a>(
    frame: &Frame,
    work: &Work<'a>,
    groups: &[Group],
    done: &mut Done,
) -> Result<Vec<Carrier<'a>>, Error> {
    let light = |group: &&Group| group.values == Values::Light;
    let (Some(neighbours), Some(group)) = (
        work.neighbours.filter(|neighbours| !neighbours.all.is_empty()),
        groups.iter().filter(light).max_by_key(|group| group.channels.len()),
    ) else {
        return Ok(Vec::new());
    };
    let part = &frame.parts[work.index];
    let fail = |source| failed(frame, work, group, source);
    let plane = |&channel: &usize| {
        let values = measured_floats(&part.channels[channel].samples, &group.mask)?;
        Plane::new(group.mask.size(), values).map_err(fail)
    };
    let planes = group.channels.iter().map(plane).collect::<Result<_, _>>()?;
    let samples = Planes::new(group.mask.size(), planes).map_err(fail)?;
    let unlimited = |mut options: Options<'static>| {
        options.limit = false;
        options
    };
    let splines = unlimited(Options::of(lacuna_filters::variational::ss::Settings::default()));
    let filled = fill_with(&samples, &group.mask, &splines, work.plans, work.run).map_err(fail)?.planes;
    // Samples of a neighbour that are not finite count as missing, as they do here.
    let edges = unlimited(Options::of(lacuna_filters::variational::edge::Settings::default()));
    let sharp = |samples: &Planes, mask: &Arc<Mask>| {
        fill_with(samples, mask, &edges, work.plans, work.run).ok().map(|filled| filled.planes)
    };
    let names = channel_names(part, group);
    let reference = Reference { names, filled, samples: &samples, mask: &group.mask, sharp: &sharp };
    let own = (frame, work.masks, work.index);
    let (carriers, notes) = carriers(own, neighbours, work.job.temporal.motion, &reference);
    done.notes.extend(notes);
    done.report.neighbours = carriers.iter().map(|carrier| (carrier.number(), carrier.how.clone())).collect();
    Ok(carriers)
}

/// What was measured and what was made of it, for each plane of a set.
fn lights<'a>(samples: &'a Planes, filled: &'a Planes, set: &Set) -> Vec<(&'a [f32], &'a [f32])> {
    let pixels = |planes: &'a Planes, at: usize| planes.as_slice()[at].pixels();
    set.planes.iter().map(|&at| (pixels(samples, at), pixels(filled, at))).collect()
}

/// The full names of a group's channels.
pub fn channel_names(part: &Part, group: &Group) -> Vec<String> {
    group.channels.iter().map(|&at| part.channels[at].display_name().into_owned()).collect()
}

/// What a group asks of the filter.
fn options<'a>(
    frame: &Frame,
    work: &Work<'a>,
    (group, method): (&Group, Method),
    names: &[String],
) -> Result<Options<'a>, Error> {
    let masks = work.masks.channels.get(work.index).map_or(&[][..], Vec::as_slice);
    let mut options = values_options(group, names, work.job);
    options.gradients = gradients::find(&frame.parts[work.index], masks, group, &method);
    options.method = method;
    options.estimate = work.job.estimate;
    let counts: Option<&Weights> = match &work.job.noise {
        NoiseSource::Count(weights) => Some(weights),
        _ => work.job.weights.as_ref(),
    };
    options.weights = match counts {
        Some(weights) => Some(weights.plane(frame, work.index).map_err(|error| work.job.noise.named(error))?),
        None => None,
    };
    let steered = group.values != Values::Directions && names.iter().all(|name| !channels::is_position(name));
    options.guides = steered.then_some(work.guides).filter(|guides| !guides.is_empty());
    Ok(options)
}

/// What the values of a group are, and what of it the job decides.
pub fn values_options<'a>(group: &Group, names: &[String], job: &Job) -> Options<'a> {
    let mut options = Options::default();
    (options.values, options.domain, options.limit) = (group.values, job.domain, job.limit);
    let free = group.values == Values::Directions;
    let bounds = names.iter().map(|name| if free { Bounds::Free } else { bounds_of(name) });
    options.bounds = bounds.collect();
    options
}

/// What is told of channels that were filled together, by their names.
fn set_notes(set: &Set, names: &[String], job: &Job) -> Vec<String> {
    let smoothed = !set.method.keeps_measured() && !set.map.is_linear();
    let names = names.join(", ");
    let notes = [
        overflow_note(&names, set.mended),
        smoothed.then(|| format!("{names}: smoothed in the log domain, whose unit the setting has")),
        (set.smoothed && job.domain == Domain::Log)
            .then(|| format!("{names}: noise is smoothed in linear light, not in the log domain")),
        (set.smoothed && job.method.name() != Method::default().name()).then(|| {
            format!("{names}: noise is smoothed by filters of its own, not by --filter {}", job.method.name())
        }),
        (set.method.name() != job.method.name())
            .then(|| format!("{names}: not of the dictionary, filled by {}", set.method.name())),
    ];
    notes.into_iter().flatten().collect()
}

/// What is told of values that overflowed, if any did.
pub fn overflow_note(names: &str, count: usize) -> Option<String> {
    (count > 0)
        .then(|| format!("{names}: {count} values overflowed in the filter and took the nearest known one"))
}

/// Why a group cannot be filled.
fn failed(frame: &Frame, work: &Work<'_>, group: &Group, source: lacuna_filters::Error) -> Error {
    let label = |at: usize| channel_label(frame, work.index, group.channels[at]);
    match (source, &work.job.weights) {
        (lacuna_filters::Error::NothingFinite { plane }, _) => {
            let channel = &frame.parts[work.index].channels[group.channels[plane]];
            Error::NothingFinite { channel: label(plane), name: channel.display_name().into_owned() }
        }
        (lacuna_filters::Error::NothingWeighs, weights) => {
            let why = "it counts no sample in any measured pixel".into();
            let weights = weights.as_ref().map(ToString::to_string).unwrap_or_default();
            work.job.noise.named(Error::Weights { weights, why })
        }
        (source, _) => Error::Filter { channel: label(0), source },
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

/// Gives every whole normal the length that the measured ones around it have.
fn unit_normals(frame: &Frame, work: &Work<'_>, filled: &mut [Filled], done: &mut Done) -> Result<(), Error> {
    let part = &frame.parts[work.index];
    for channel in 0..part.channels.len() {
        let Some(triple) = channels::normal_triple(part, work.choices, channel) else { continue };
        let at = |wanted: usize| filled.iter().position(|filled| filled.channel == wanted);
        let (Some(x), Some(y), Some(z)) = (at(triple[0]), at(triple[1]), at(triple[2])) else { continue };
        if triple.iter().min() != Some(&channel) {
            continue;
        }
        let fail = |source| Error::Filter { channel: channel_label(frame, work.index, channel), source };
        let masks = [x, y, z].map(|at| Arc::clone(&filled[at].mask));
        let all = normals::kept(&masks, work.job.method.keeps_measured());
        let Some(both) = normals::both(&masks) else {
            let name = part.channels[channel].display_name();
            done.notes.push(format!("channel {name}: no pixel has all of a normal, so none is scaled"));
            continue;
        };
        let Some(lengths) = normals::lengths([x, y, z].map(|at| filled[at].samples.as_slice()), &both) else {
            let name = part.channels[channel].display_name();
            done.notes
                .push(format!("channel {name}: measured normals are not of unit length, so none is scaled"));
            continue;
        };
        let Ok([a, b, c]) = filled.get_disjoint_mut([x, y, z]) else { continue };
        let nearest = work.plans.nearest(&both).map_err(fail)?;
        let samples = [a.samples.as_slice(), &b.samples, &c.samples];
        let around = match lengths {
            Lengths::Unit => None,
            Lengths::Mixed => Some(work.plans.depth(&both).map_err(fail)?),
        };
        // Which pixels have a normal at all makes most of the error then, and is decided here, not by the filter that was estimated.
        let has_none = |(at, &flag): (usize, &bool)| flag && samples.iter().all(|samples| samples[at] == 0.0);
        if around.is_some() || both.as_slice().iter().enumerate().any(has_none) {
            done.report.estimate_none(channel);
        }
        let nearest = nearest.as_slice();
        let allowed = |at: usize| match &around {
            None => normals::unit_range(samples, nearest[at] as usize),
            Some(around) => normals::range(samples, around.around(at)),
        };
        normals::scale(
            [&mut a.values, &mut b.values, &mut c.values],
            samples,
            &all,
            nearest,
            (lengths, allowed),
        );
    }
    Ok(())
}

/// Brings filled coordinates, layer by layer, onto surfaces of the measured ones where that is due.
fn on_surfaces(frame: &Frame, work: &Work<'_>, filled: &mut [Filled], done: &mut Done) -> Result<(), Error> {
    let part = &frame.parts[work.index];
    if !work.job.method.keeps_measured() {
        return Ok(());
    }
    let mut layers: Vec<(String, Arc<Mask>, Vec<usize>)> = Vec::new();
    for (at, one) in filled.iter().enumerate() {
        let name = part.channels[one.channel].display_name();
        let filled = work.choices[one.channel].rule == Rule::Fill;
        if !filled || !channels::is_coordinate(&name) {
            continue;
        }
        let layer = Name::new(&name).layer;
        match layers.iter_mut().find(|(own, mask, _)| own == layer && **mask == *one.mask) {
            Some((.., all)) => all.push(at),
            None => layers.push((layer.to_owned(), Arc::clone(&one.mask), vec![at])),
        }
    }
    for (_, mask, all) in layers {
        let channel = filled[all[0]].channel;
        let fail = |source| Error::Filter { channel: channel_label(frame, work.index, channel), source };
        let own = filled.iter_mut().enumerate().filter(|(at, _)| all.contains(at));
        let (mut planes, samples): (Vec<&mut [f32]>, Vec<&[f32]>) =
            own.map(|(_, one)| (one.values.as_mut_slice(), one.samples.as_slice())).unzip();
        let (method, name) = (work.job.method.clone(), part.channels[channel].display_name());
        if !channels::is_position(&name)
            && !surfaces::are_near(&samples, &mask, method, (work.plans, work.run)).map_err(fail)?
        {
            continue;
        }
        let plan = work.plans.depth(&mask).map_err(fail)?;
        let missing: Vec<usize> = (0..mask.as_slice().len()).filter(|&at| !mask.as_slice()[at]).collect();
        let moved = surfaces::keep(&mut planes, &samples, (mask.size(), &missing), &plan);
        // The estimate is that of the filter alone.
        if moved > 0 {
            done.report.estimate_none(channel);
        }
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
