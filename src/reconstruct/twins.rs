//! Complete channels whose values missing pixels take as they are: which hold them, as planes for the filters, and what is said of them.

use std::sync::Arc;

use half::f16;
use lacuna_exr::{Frame, Samples};
use lacuna_filters::fill::agrees;
use lacuna_filters::{Bounds, Plane};

use super::groups::usable;
use super::part::Work;
use super::{Error, Estimated, Job, Kind, PartReport, bounds_of, kind_for, to_halves, value};
use crate::channels::{Choice, Rule};
use crate::guides::{Copied, Place, Twin};
use crate::mask::Masks;

/// A channel whose values its twin holds.
#[derive(Clone, Debug)]
pub struct Known {
    /// Both.
    pub twin: Twin,
    /// The measured pixels that showed it.
    pub equal: usize,
}

/// Which channels of a part are held by their twins; of several candidates the first that holds them. Told over all of the part, so that its bands agree.
pub fn known(
    frame: &Frame,
    (index, masks, choices): (usize, &Masks, &[Choice]),
    candidates: Vec<Twin>,
    second: Option<&Frame>,
    job: &Job,
) -> Result<Vec<Known>, Error> {
    let part = &frame.parts[index];
    let mut found: Vec<Known> = Vec::new();
    for twin in candidates {
        let channel = twin.channel;
        let (own, rule) = (&part.channels[channel], choices[channel].rule);
        let Some(mask) = masks.get(index, channel).filter(|mask| !mask.is_full()) else { continue };
        let complete = twin.samples(frame, second).filter(|complete| complete.len() == own.samples.len());
        let Some(complete) = complete.filter(|_| found.iter().all(|known| known.twin.channel != channel))
        else {
            continue;
        };
        let mask = usable(rule, &own.samples, mask)?;
        let is_half = matches!(own.samples, Samples::Half(_));
        let ends_half = is_half || kind_for(rule, job.kind) == Some(Kind::Half);
        let stored = |value: f32| match f16::from_f32(value) {
            half if ends_half && half.is_infinite() && value.is_finite() => f32::NAN,
            half if is_half => half.to_f32(),
            _ => value,
        };
        let pixels = mask.as_slice().iter().enumerate();
        let pixels = pixels.map(|(at, &flag)| (flag, value(&own.samples, at), stored(value(complete, at))));
        let bounds = if rule == Rule::Fill { bounds_of(&own.display_name()) } else { Bounds::Free };
        if agrees(pixels, bounds) {
            found.push(Known { twin, equal: mask.count() });
        }
    }
    Ok(found)
}

/// The values of a channel's twin, in the channel's type; nothing if none holds them.
pub fn twin(frame: &Frame, work: &Work<'_>, channel: usize) -> Option<Arc<Plane>> {
    let part = &frame.parts[work.index];
    let values = of(work, channel)?.twin.samples(frame, work.second)?.to_floats()?;
    let values = match part.channels[channel].samples {
        Samples::Half(_) => Samples::Half(to_halves(&values).0).as_f32(),
        _ => values,
    };
    Plane::new(part.size(), values).ok().map(Arc::new)
}

fn of<'a>(work: &Work<'a>, channel: usize) -> Option<&'a Known> {
    work.twins.iter().find(|known| known.twin.channel == channel)
}

/// What is said of a channel that was copied from its twin.
fn copied(frame: &Frame, work: &Work<'_>, channel: usize) -> Option<Copied> {
    let twin = &of(work, channel)?.twin;
    let place = match twin.part {
        _ if twin.second => Place::OtherFile,
        index if index == work.index => Place::ThisPart,
        index => Place::Part { index, name: frame.parts.get(index)?.name().filter(|name| !name.is_empty()) },
    };
    let channel = frame.parts[work.index].channels[channel].display_name().into_owned();
    Some(Copied { channel, twin: twin.name.clone(), place })
}

/// Says in the report that a channel was copied from its twin.
pub fn tell(frame: &Frame, work: &Work<'_>, channel: usize, report: &mut PartReport) {
    report.copied.extend(copied(frame, work, channel));
}

/// What stands where an error is estimated for channels that were copied.
pub fn estimate(frame: &Frame, work: &Work<'_>, channels: &[usize]) -> Estimated {
    let all = || channels.iter().filter_map(|&channel| of(work, channel));
    let copied_from = channels.iter().filter_map(|&channel| copied(frame, work, channel));
    Estimated::Copied {
        copied_from: copied_from.map(|copied| copied.source()).collect(),
        equal_pixels: all().map(|known| known.equal).min().unwrap_or(0),
    }
}

/// What was copied, and from where, for people: `A from dense.A, Z from dense.Z`; nothing if nothing was.
pub fn line(copied: &[Copied]) -> Option<String> {
    let one = |copied: &Copied| format!("{} from {}", copied.channel, copied.source());
    (!copied.is_empty()).then(|| copied.iter().map(one).collect::<Vec<_>>().join(", "))
}

#[cfg(test)]
mod tests;
