//! Complete channels whose values missing pixels take as they are: which hold them, as planes for the filters, and what is said of them.

use std::sync::Arc;

use half::f16;
use lacuna_exr::{Attributes, Frame, Samples};
use lacuna_filters::fill::agrees;
use lacuna_filters::{Bounds, Plane};
use serde::{Deserialize, Serialize};

use super::groups::usable;
use super::part::Work;
use super::{Error, Estimated, Job, Kind, PartReport, bounds_of, kind_for, to_halves, value};
use crate::channels::{Choice, Rule};
use crate::guides::Twin;
use crate::mask::Masks;

/// The attribute that says from which channels others of a part were copied, in JSON.
pub const ATTRIBUTE: &str = "lacuna/copied";

/// A channel whose values its twin holds.
#[derive(Clone, Debug)]
pub struct Known {
    /// Both.
    pub twin: Twin,
    /// The measured pixels that showed it.
    pub equal: usize,
}

/// A channel that was copied.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct Copied {
    /// Its full name.
    pub channel: String,
    /// That of the complete one.
    pub twin: String,
    /// Where that stands.
    pub place: Place,
}

/// Where a complete channel stands, seen from a part that was filled.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Place {
    /// In that part.
    ThisPart,
    /// In another one.
    Part {
        /// Its number, from 0.
        index: usize,
        /// Its name, if it has one.
        name: Option<String>,
    },
    /// In the file that guides came from.
    OtherFile,
}

impl Copied {
    /// The number of the part in which the complete channel stands; nothing if that is in another file.
    pub fn part(&self, own: usize) -> Option<usize> {
        match self.place {
            Place::ThisPart => Some(own),
            Place::Part { index, .. } => Some(index),
            Place::OtherFile => None,
        }
    }

    /// What it was copied from, for people.
    pub fn source(&self) -> String {
        let twin = &self.twin;
        match &self.place {
            Place::ThisPart => twin.clone(),
            Place::Part { index, name: None } => format!("{twin} of part {index}"),
            Place::Part { name: Some(name), .. } => format!("{twin} of part {name}"),
            Place::OtherFile => format!("{twin} of the guides' file"),
        }
    }
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

/// Writes which channels of a part were copied; parts of which none was have no such attribute.
pub fn write(attributes: &mut Attributes, copied: &[Copied]) {
    match serde_json::to_string(copied).ok().filter(|_| !copied.is_empty()) {
        Some(text) => attributes.set_text(ATTRIBUTE, &text),
        None => drop(attributes.remove(ATTRIBUTE)),
    }
}

/// The channels that a part says were copied.
pub fn read(attributes: &Attributes) -> Vec<Copied> {
    attributes.text(ATTRIBUTE).and_then(|text| serde_json::from_str(&text).ok()).unwrap_or_default()
}

#[cfg(test)]
mod tests;
