//! The channels of one part onto the larger grid, each by its rule.

use std::sync::Arc;

use lacuna_core::parallel::prelude::*;
use lacuna_exr::{Channel, Frame, Part, SampleType, Samples};
use lacuna_filters::domain::Domain;
use lacuna_filters::upscale::{self, Enlarged, Geometry, Method, Question};
use lacuna_filters::{Mask, Plane};

use crate::channels::{self, Choice, Rule, channel_label};
use crate::reconstruct::groups::{Group, Target, groups};
use crate::reconstruct::part::{Done, Work};
use crate::reconstruct::solve::{mend, overflow_note};
use crate::reconstruct::values::to_halves;
use crate::reconstruct::{Bounds, Error, GroupReport, Kind, bounds_of, kind_for, normals};

/// Puts every channel of a part, which is complete, onto the larger grid; `kinds` are the types that they came with.
pub fn enlarge(
    frame: &mut Frame,
    (work, kinds): (&Work<'_>, &[SampleType]),
    (geometry, method): (Geometry, Method),
    done: &mut Done,
) -> Result<(), Error> {
    let fail = |source| Error::Filter { channel: channel_label(frame, work.index, 0), source };
    let plan = work.plans.enlarge(geometry, method).map_err(fail)?;
    // Where only colour is enlarged nothing is copied.
    let copies = work.choices.iter().any(|choice| choice.rule != Rule::Fill);
    let sources = if copies { geometry.sources() } else { Vec::new() };
    let mut planes: Vec<Option<Plane>> = vec![None; work.choices.len()];
    for group in groups(frame, work.index, &computed(&frame.parts[work.index], work.choices)) {
        let enlarged = solve(frame, work, &group, (&plan, geometry), done)?;
        for (&channel, enlarged) in group.channels.iter().zip(enlarged) {
            done.report.channels[channel].limited += enlarged.limited;
            planes[channel] = Some(enlarged.plane);
        }
    }
    let part = &mut frame.parts[work.index];
    unit_normals(part, work, geometry, &sources, &mut planes);
    let channels = part.channels.par_iter_mut().zip(planes).zip(work.choices).zip(kinds);
    let clamped = channels.map(|(((channel, plane), choice), kind)| match plane {
        None => {
            copy(channel, &sources);
            0
        }
        Some(plane) => {
            let asked = kind_for(choice.rule, work.job.kind);
            let half = asked.map_or(*kind == SampleType::Half, |kind| kind == Kind::Half);
            write(channel, plane, half)
        }
    });
    for (report, clamped) in done.report.channels.iter_mut().zip(clamped) {
        report.clamped_halves = clamped;
    }
    Ok(())
}

/// The channels that are computed, as if all of them missed something.
fn computed(part: &Part, choices: &[Choice]) -> Vec<Target> {
    let full = Arc::new(Mask::from_fn(part.size(), |_, _| true));
    let is = |choice: &Choice| matches!(choice.rule, Rule::Fill | Rule::Normal);
    let target = |(channel, choice): (usize, &Choice)| Target {
        channel,
        rule: choice.rule,
        mask: Arc::clone(&full),
        non_finite: 0,
    };
    choices.iter().enumerate().filter(|(_, choice)| is(choice)).map(target).collect()
}

/// Enlarges a group of channels. Values at points go through the value domain, means do not: a logarithm has others.
fn solve(
    frame: &Frame,
    work: &Work<'_>,
    group: &Group,
    (plan, geometry): (&upscale::Plan, Geometry),
    done: &mut Done,
) -> Result<Vec<Enlarged>, Error> {
    let part = &frame.parts[work.index];
    let fail =
        |source| Error::Filter { channel: channel_label(frame, work.index, group.channels[0]), source };
    let plane = |&channel: &usize| {
        let values = part.channels[channel].samples.to_floats().ok_or(Error::OtherFrame)?;
        Plane::new(part.size(), values).map_err(fail)
    };
    let samples = group.channels.par_iter().map(plane).into_iter().collect::<Result<Vec<_>, _>>()?;
    let names: Vec<_> =
        group.channels.iter().map(|&at| part.channels[at].display_name().into_owned()).collect();
    let domain =
        if group.light && geometry.sampling.is_pointwise() { work.job.domain } else { Domain::Linear };
    let map = domain.map(&group.mask, &samples);
    let one = |((&channel, sample), name): ((&usize, &Plane), &String)| {
        let bounds = if group.normal { Bounds::Free } else { bounds_of(name) };
        let (low, high) = bounds.range(sample.pixels().iter().copied());
        let mask = work.masks.get(work.index, channel).filter(|mask| !mask.is_full());
        let question = Question {
            mask: mask.map(AsRef::as_ref),
            range: (map.forward(low), map.forward(high)),
            limit: work.job.limit && !group.normal,
        };
        let mut mapped = sample.clone();
        map.forward_plane(&group.mask, &mut mapped);
        let mut enlarged = plan.enlarge(&mapped, &question, work.run)?;
        map.inverse_plane(&mut enlarged.plane);
        plan.restore(sample, &mut enlarged.plane);
        let sources = || Ok(geometry.sources());
        let mended = mend(sample, &mut enlarged.plane, sources, Vec::as_slice)?;
        Ok((enlarged, mended))
    };
    let channels = group.channels.par_iter().zip(&samples).zip(&names);
    let enlarged = channels.map(one).into_iter().collect::<Result<Vec<_>, _>>().map_err(fail)?;
    let (enlarged, mended): (Vec<_>, Vec<usize>) = enlarged.into_iter().unzip();
    done.notes.extend(overflow_note(&names, mended.into_iter().sum()));
    let outcome = enlarged.iter().map(|one| one.outcome).reduce(lacuna_filters::Outcome::worst);
    if let Some(outcome) = outcome {
        done.report.groups.push(GroupReport {
            channels: names,
            domain: map.name(),
            outcome,
            guides: Vec::new(),
            guides_gain: None,
        });
    }
    Ok(enlarged)
}

/// Gives every whole normal unit length again.
fn unit_normals(
    part: &Part,
    work: &Work<'_>,
    geometry: Geometry,
    sources: &[u32],
    planes: &mut [Option<Plane>],
) {
    let low = Mask::from_fn(geometry.low(), |_, _| true);
    let high = Mask::from_fn(geometry.high(), |_, _| false);
    for channel in 0..part.channels.len() {
        let Some(triple) = channels::normal_triple(part, work.choices, channel) else { continue };
        if triple.iter().min() != Some(&channel) {
            continue;
        }
        let floats = triple.map(|at| part.channels[at].samples.to_floats().unwrap_or_default());
        let samples = floats.each_ref().map(Vec::as_slice);
        if !samples.iter().all(|plane| plane.len() == low.as_slice().len())
            || !normals::are_unit(samples, &low)
        {
            continue;
        }
        let Ok([Some(x), Some(y), Some(z)]) = planes.get_disjoint_mut(triple) else { continue };
        normals::normalise([x.pixels_mut(), y.pixels_mut(), z.pixels_mut()], samples, &high, sources);
    }
}

/// The bits of the pixels that the new ones lie in.
fn copy(channel: &mut Channel, sources: &[u32]) {
    fn pick<T: Copy + Send + Sync>(values: &[T], sources: &[u32]) -> Vec<T> {
        sources.par_iter().map(|&source| values[source as usize])
    }
    channel.samples = match &channel.samples {
        Samples::Half(values) => Samples::Half(pick(values, sources)),
        Samples::Float(values) => Samples::Float(pick(values, sources)),
        Samples::Uint(values) => Samples::Uint(pick(values, sources)),
    };
}

/// Puts the values into the channel; returns how many a half could not hold.
fn write(channel: &mut Channel, plane: Plane, half: bool) -> usize {
    if half {
        let (halves, clamped) = to_halves(plane.pixels());
        channel.samples = Samples::Half(halves);
        clamped
    } else {
        channel.samples = Samples::Float(plane.into_pixels());
        0
    }
}
