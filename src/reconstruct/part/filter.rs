//! A group of channels through the filter: what it is asked, and what is said of its answer.

use std::sync::Arc;

use lacuna_exr::{Frame, Part};
use lacuna_filters::domain::Domain;
use lacuna_filters::estimate::Repeated;
use lacuna_filters::fill::{Estimate, Options, Set, Values, fill_with};
use lacuna_filters::noise::Noise;
use lacuna_filters::{Bounds, Mask, Method, Plane, Planes};

use super::{Done, Filled, Work, measured_floats};
use crate::channels::{self, channel_label};
use crate::reconstruct::bounds::bounds_of;
use crate::reconstruct::estimate::{Estimated, untold};
use crate::reconstruct::groups::{Group, Target, speaks};
use crate::reconstruct::{Error, GroupReport, Job, NoiseSource, Weights, energy, gradients, twins};
use crate::temporal::{Carrier, Guided, Reference, carriers};

/// Fills a group of channels, and says in the report and in its targets what was found.
pub fn filter(
    frame: &Frame,
    (work, carriers, repeated): (&Work<'_>, &[Carrier<'_>], &Repeated),
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
    if let Some(weights) = counts(work.job).filter(|_| options.weights.is_none()) {
        let names = names.join(", ");
        done.notes.push(format!("{names}: no {weights} of its pixels, which weigh the same"));
    }
    let (noise, note) = work.job.noise.of(part, group, &samples)?;
    options.noise = noise;
    done.notes.extend(note);
    let guided = options.guides.map(|guides| {
        let view = names.first().and_then(|name| channels::view_of(part, name));
        let found = work.guide_channels.iter().filter(|guide| guide.serves(view.as_deref())).collect();
        Guided { guides, found, part }
    });
    let carried = |carrier: &Carrier<'_>| carrier.carried(&names, guided.as_ref());
    let carried: Vec<_> = carriers.iter().filter_map(carried).collect();
    if group.values != Values::Directions {
        options.carried = &carried;
    }
    options.twins = group.channels.iter().map(|&channel| twins::twin(frame, work, channel)).collect();
    (options.known, options.repeated) = (true, Some(repeated));
    let answer = fill_with(&samples, mask, &options, work.plans, work.run).map_err(fail)?;
    for set in &answer.sets {
        tell(set, (&samples, &answer.planes), (group, &options), &names, (frame, work), done);
    }
    if group.values == Values::Light {
        let errors = answer.errors().filter(|_| speaks(part, group));
        done.errors.extend(errors.map(|errors| (names[0].clone(), errors)));
    }
    let copies = answer.sets.iter().filter(|set| set.copied).flat_map(|set| &set.planes);
    let copies: Vec<usize> = copies.map(|&at| group.channels[at]).collect();
    for &channel in &copies {
        twins::tell(frame, work, channel, &mut done.report);
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
        let (all, copied) = (smoothed.contains(&channel), copies.contains(&channel));
        let (samples, values) = (samples.into_pixels(), values.into_pixels());
        Filled { channel, mask, samples, values, limited, all, copied }
    });
    Ok(filled.collect())
}

/// Says what was done to a set of a group's channels, whose `names` are all of the group.
fn tell(
    set: &Set,
    (samples, filled): (&Planes, &Planes),
    (group, options): (&Group, &Options<'_>),
    names: &[String],
    (frame, work): (&Frame, &Work<'_>),
    done: &mut Done,
) {
    let coordinates = names.iter().any(|name| channels::is_coordinate(name));
    let names: Vec<_> = set.planes.iter().map(|&at| names[at].clone()).collect();
    let light = group.values == Values::Light;
    if light {
        let copied = set.copied.then(|| "they are copied".to_owned());
        done.untold.extend(copied.or_else(|| untold(set)).map(|why| (names.clone(), why)));
    }
    let missing = options.noise != Noise::None;
    done.notes.extend(set_notes(set, &names, work.job));
    if set.weightless > 0 {
        let then = if missing { "are filled like missing ones" } else { "weigh nothing" };
        let what = format!("measured pixels count no sample and {then}");
        done.notes.push(format!("{}: {} {what}", names.join(", "), set.weightless));
    }
    let copied: Vec<usize> = set.planes.iter().map(|&at| group.channels[at]).collect();
    // A scalar beyond white, such as `cputime`, has a unit of its own.
    let beyond = light && set.unclipped.is_some() && !speaks(&frame.parts[work.index], group);
    let estimate = match options.estimate {
        Estimate::No => None,
        _ if beyond => None,
        _ if set.copied => Some(twins::estimate(frame, work, &copied)),
        asked => Estimated::of_set(set, (asked, options.peak), coordinates),
    };
    let energy = || energy::compare(&lights(samples, filled, set), &set.mask);
    done.report.groups.push(GroupReport {
        channels: names,
        domain: set.map.name(),
        guides: set.guides.clone(),
        guides_gain: set.gain,
        neighbours_gain: set.along,
        chosen: set.shares.iter().map(|(name, share)| ((*name).into(), *share)).collect(),
        settled: set.settled.iter().map(ToString::to_string).collect(),
        estimate,
        exponent: set.exponent,
        energy: (light && options.keeps_measured()).then(energy).flatten(),
        outcome: set.outcome,
        noiseless: missing && !(set.smoothed || work.run.interrupted().is_some()) && set.settled.is_empty(),
    });
}

/// The samples of the frames beside it, at their places in this part; its colours tell which places are likely.
pub fn along_motion<'a>(
    frame: &Frame,
    work: &Work<'a>,
    groups: &[Group],
    done: &mut Done,
) -> Result<Vec<Carrier<'a>>, Error> {
    let light = |group: &&Group| group.values == Values::Light;
    let (Some(neighbours), Some(group)) = (
        work.neighbours.filter(|neighbours| !neighbours.all.is_empty()),
        groups.iter().filter(light).max_by_key(|group| (group.colours, group.channels.len())),
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
    let window = part.data_window;
    let reference = Reference { window, names, filled, samples: &samples, mask: &group.mask, sharp: &sharp };
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

/// Where the samples of a pixel are counted, if anywhere.
fn counts(job: &Job) -> Option<&Weights> {
    match &job.noise {
        NoiseSource::Count(weights) => Some(weights),
        _ => job.weights.as_ref(),
    }
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
    let view = names.first().and_then(|name| channels::view_of(&frame.parts[work.index], name));
    let view = view.as_deref();
    options.weights = match counts(work.job) {
        Some(weights) => {
            weights.plane(frame, work.index, view).map_err(|error| work.job.noise.named(error))?
        }
        None => None,
    };
    let steered = group.values != Values::Directions && names.iter().all(|name| !channels::is_position(name));
    options.guides = work.guides_of(view).filter(|_| steered);
    Ok(options)
}

/// What the values of a group are, and what of it the job decides.
pub fn values_options<'a>(group: &Group, names: &[String], job: &Job) -> Options<'a> {
    let mut options = Options::default();
    (options.values, options.domain, options.limit) = (group.values, job.domain, job.limit);
    options.peak = if group.values == Values::Light { job.peak } else { 1.0 };
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
