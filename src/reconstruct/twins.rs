//! Complete channels whose values missing pixels take as they are: as planes for the filters, and what is said of them.

use std::sync::Arc;

use lacuna_exr::{Attributes, Frame, Samples};
use lacuna_filters::Plane;
use lacuna_filters::fill::agrees;

use super::groups::Target;
use super::part::{Work, measured_floats};
use super::{Error, PartReport, to_halves};
use crate::guides::Twin;

/// The attribute that says from which channels others of a part were copied.
pub const ATTRIBUTE: &str = "lacuna/copied";

/// The values of a channel's twin, in the channel's type; nothing if it has none.
pub fn twin(frame: &Frame, work: &Work<'_>, channel: usize) -> Option<Arc<Plane>> {
    let part = &frame.parts[work.index];
    let twin = work.twins.iter().find(|twin| twin.channel == channel)?;
    let values = twin.samples(frame, work.second)?.to_floats()?;
    let values = match part.channels[channel].samples {
        Samples::Half(_) => Samples::Half(to_halves(&values).0).as_f32(),
        _ => values,
    };
    Plane::new(part.size(), values).ok().map(Arc::new)
}

/// The values of a depth that its twin holds, if it does.
pub fn depth(frame: &Frame, work: &Work<'_>, target: &Target) -> Result<Option<Vec<f32>>, Error> {
    let Some(twin) = twin(frame, work, target.channel) else { return Ok(None) };
    let samples = &frame.parts[work.index].channels[target.channel].samples;
    let agree = agrees(&target.mask, &measured_floats(samples, &target.mask)?, twin.pixels());
    Ok(agree.then(|| twin.pixels().to_vec()))
}

/// Says in the report that a channel was copied from its twin.
pub fn tell(frame: &Frame, work: &Work<'_>, channel: usize, report: &mut PartReport) {
    let name = frame.parts[work.index].channels[channel].display_name().into_owned();
    let from = |twin: &Twin| {
        let file = if twin.second { " of the guides' file" } else { "" };
        format!("{}{file}", twin.name)
    };
    let twin = work.twins.iter().find(|twin| twin.channel == channel);
    report.copied.extend(twin.map(|twin| (name, from(twin))));
}

/// What was copied, and from where: `A from dense.A, Z from dense.Z`; nothing if nothing was.
pub fn line(report: &PartReport) -> Option<String> {
    let all: Vec<String> = report.copied.iter().map(|(name, twin)| format!("{name} from {twin}")).collect();
    (!all.is_empty()).then(|| all.join(", "))
}

/// The channels that a part says were copied, each with the one that it was copied from.
pub fn read(attributes: &Attributes) -> Vec<(String, String)> {
    let line = attributes.text(ATTRIBUTE).unwrap_or_default();
    let pair = |text: &str| text.split_once(" from ").map(|(name, twin)| (name.to_owned(), twin.to_owned()));
    line.split(", ").filter_map(pair).collect()
}

#[cfg(test)]
mod tests;
