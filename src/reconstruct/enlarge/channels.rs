//! The channels of one part onto the larger grid, each by its rule.

use std::sync::Arc;

use lacuna_core::parallel::prelude::*;
use lacuna_exr::{Channel, Frame, Part, SampleType, Samples};
use lacuna_filters::enlarge::{self, Options, Upscaled};
use lacuna_filters::upscale::{Geometry, Method};
use lacuna_filters::{Mask, Plane, Planes, Size};

use crate::channels::{self, Choice, Name, Rule, channel_label};
use crate::reconstruct::groups::{Group, Target, groups};
use crate::reconstruct::normals::Lengths;
use crate::reconstruct::part::{
    Done, EMPTY, Work, channel_names, is_black_where_empty, overflow_note, values_options,
};
use crate::reconstruct::values::to_halves;
use crate::reconstruct::{Error, GroupReport, Kind, kind_for, normals};

/// Puts every channel of a part, which is complete, onto the larger grid; `kinds` are the types that they came with.
pub fn enlarge(
    frame: &mut Frame,
    (work, kinds): (&Work<'_>, &[SampleType]),
    (geometry, method): (Geometry, Method),
    taken: Vec<Option<Samples>>,
    done: &mut Done,
) -> Result<(), Error> {
    // Where only colour is enlarged nothing is copied.
    let copies = work.choices.iter().any(|choice| choice.rule != Rule::Fill);
    let sources = if copies { geometry.sources() } else { Vec::new() };
    let mut planes: Vec<Option<Plane>> = vec![None; work.choices.len()];
    for group in groups(frame, work.index, &computed(&frame.parts[work.index], work.choices)) {
        let large = solve(frame, work, &group, (geometry, method), done)?;
        let large = large.planes.into_vec().into_iter().zip(large.limited);
        for (&channel, (plane, limited)) in group.channels.iter().zip(large) {
            done.report.channels[channel].limit(limited);
            planes[channel] = Some(plane);
        }
    }
    let part = &mut frame.parts[work.index];
    unit_normals(part, work, geometry, &sources, &mut planes);
    if !matches!(method, Method::Plain(_)) {
        empty_stays_black(part, geometry, &taken, &mut planes);
    }
    let sourced = planes.into_iter().zip(taken).collect::<Vec<_>>();
    let channels = part.channels.par_iter_mut().zip(sourced).zip(work.choices).zip(kinds);
    let clamped = channels.map(|(((channel, (plane, taken)), choice), kind)| match plane {
        None => {
            match taken {
                Some(samples) => channel.samples = samples,
                None => copy(channel, &sources),
            }
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

/// Enlarges a group of channels.
fn solve(
    frame: &Frame,
    work: &Work<'_>,
    group: &Group,
    (geometry, method): (Geometry, Method),
    done: &mut Done,
) -> Result<Upscaled, Error> {
    let part = &frame.parts[work.index];
    let fail =
        |source| Error::Filter { channel: channel_label(frame, work.index, group.channels[0]), source };
    let plane = |&channel: &usize| {
        let values = part.channels[channel].samples.to_floats().ok_or(Error::OtherFrame)?;
        Plane::new(part.size(), values).map_err(fail)
    };
    let samples = group.channels.par_iter().map(plane).into_iter().collect::<Result<Vec<_>, _>>()?;
    let samples = Planes::new(part.size(), samples).map_err(fail)?;
    let names = channel_names(part, group);
    let masks: Vec<_> = group.channels.iter().map(|&at| work.masks.get(work.index, at).cloned()).collect();
    let mut options = Options::new(geometry);
    options.method = method;
    options.guides = work.guides_of(None);
    options.fill = values_options(group, &names, work.job);
    let large = enlarge::complete(&samples, &masks, &options, work.plans, work.run).map_err(fail)?;
    done.notes.extend(overflow_note(&names.join(", "), large.mended));
    done.report.groups.push(GroupReport {
        chosen: Vec::new(),
        settled: Vec::new(),
        estimate: None,
        exponent: None,
        energy: None,
        channels: names,
        domain: large.map.name(),
        outcome: large.outcome,
        noiseless: false,
        guides: large.guides.clone(),
        guides_gain: large.guides_gain,
        neighbours_gain: None,
    });
    Ok(large)
}

/// Gives every whole normal the length that those around it had.
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
        if !samples.iter().all(|plane| plane.len() == low.as_slice().len()) {
            continue;
        }
        let Some(lengths) = normals::lengths(samples, &low) else { continue };
        let Ok([Some(x), Some(y), Some(z)]) = planes.get_disjoint_mut(triple) else { continue };
        let allowed = |at: usize| match lengths {
            Lengths::Unit => normals::unit_range(samples, sources[at] as usize),
            Lengths::Mixed => normals::range(samples, block(geometry.low(), sources[at] as usize)),
        };
        let planes = [x.pixels_mut(), y.pixels_mut(), z.pixels_mut()];
        normals::scale(planes, samples, &high, sources, (lengths, allowed));
    }
}

/// Makes light 0 where the alpha of its layer is, if the small pixels without alpha are black.
fn empty_stays_black(
    part: &Part,
    geometry: Geometry,
    taken: &[Option<Samples>],
    planes: &mut [Option<Plane>],
) {
    let names: Vec<_> = part.channels.iter().map(Channel::display_name).collect();
    let layer = |at: usize| Name::new(&names[at]).layer;
    // One whose pixels are copied is no outline of the larger image.
    let alpha = |at: usize| {
        let large = match (&planes[at], &taken[at]) {
            (Some(plane), _) => plane.pixels().to_vec(),
            (None, samples) => samples.as_ref()?.to_floats()?,
        };
        Some((at, part.channels[at].samples.to_floats()?, large))
    };
    let alphas = (0..names.len()).filter(|&at| channels::is_alpha(&names[at])).filter_map(alpha);
    let alphas: Vec<_> = alphas.collect();
    for (at, plane) in planes.iter_mut().enumerate() {
        let is_light = channels::is_light(&names[at]) && !channels::is_alpha(&names[at]);
        let own = alphas.iter().find(|(other, ..)| is_light && layer(*other) == layer(at));
        let (Some(plane), Some((_, small, large))) = (plane, own) else { continue };
        let samples = part.channels[at].samples.to_floats().unwrap_or_default();
        if is_black_where_empty(small.iter().zip(&samples), EMPTY) {
            blacken(plane, large, geometry);
        }
    }
}

/// Takes the light where alpha is 0; of pixels that are means the others of the small pixel get it, in proportion to their alpha.
fn blacken(plane: &mut Plane, alpha: &[f32], geometry: Geometry) {
    let sources = geometry.sources();
    // What each small pixel loses, and the alpha that it has.
    let mut cells = vec![(0.0_f64, 0.0_f64); geometry.low().pixels()];
    for ((value, &alpha), &source) in plane.pixels_mut().iter_mut().zip(alpha).zip(&sources) {
        let (lost, sum) = &mut cells[source as usize];
        *sum += f64::from(alpha);
        if alpha == 0.0 {
            *lost += f64::from(std::mem::take(value));
        }
    }
    if geometry.sampling.is_pointwise() {
        return;
    }
    for ((value, &alpha), &source) in plane.pixels_mut().iter_mut().zip(alpha).zip(&sources) {
        let (lost, sum) = cells[source as usize];
        if lost != 0.0 && sum > 0.0 && alpha != 0.0 {
            *value = (f64::from(*value) + lost * f64::from(alpha) / sum) as f32;
        }
    }
}

/// The 3 x 3 pixels around one.
fn block(size: Size, at: usize) -> impl Iterator<Item = usize> {
    let (y, x) = (at / size.width, at % size.width);
    let columns = x.saturating_sub(1)..size.width.min(x + 2);
    (y.saturating_sub(1)..size.height.min(y + 2))
        .flat_map(move |y| columns.clone().map(move |x| y * size.width + x))
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
