//! What a filled frame says of its channels: which were copied from complete ones, and which the fill made.

use lacuna_exr::{Attributes, Channel, Frame, Part};
use serde::{Deserialize, Serialize};

use super::ATTRIBUTE as GUIDES;
use crate::channels::{Choice, Name, Rule};
use crate::mask::FILTER;

/// The attribute that says from which channels others of a part were copied, in JSON.
pub const COPIED: &str = "lacuna/copied";

/// The attribute that names the channels of a filled part that the fill left as they came, in JSON.
pub const KEPT: &str = "lacuna/kept";

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

/// Writes which channels of a part were copied; parts of which none was have no such attribute.
pub fn write(attributes: &mut Attributes, copied: &[Copied]) {
    match serde_json::to_string(copied).ok().filter(|_| !copied.is_empty()) {
        Some(text) => attributes.set_text(COPIED, &text),
        None => drop(attributes.remove(COPIED)),
    }
}

/// The channels that a part says were copied.
pub fn read(attributes: &Attributes) -> Vec<Copied> {
    attributes.text(COPIED).and_then(|text| serde_json::from_str(&text).ok()).unwrap_or_default()
}

/// Writes which channels of a part were kept.
pub fn write_kept(attributes: &mut Attributes, kept: &[&str]) {
    attributes.set_text(KEPT, &serde_json::Value::from(kept).to_string());
}

/// Per part and channel, whether its missing pixels were filled. A part that nothing filled is as it came. Frames that name no channels that were kept
/// are older: what guided their fill, or others were copied from, was complete before.
pub fn made(frame: &Frame, choices: &[Vec<Choice>]) -> Vec<Vec<bool>> {
    let twins = frame.parts.iter().enumerate().flat_map(|(own, part)| {
        let copied = read(&part.attributes).into_iter();
        copied.filter_map(move |copied| Some((copied.part(own)?, copied.twin)))
    });
    let twins: Vec<(usize, String)> = twins.collect();
    let of_part = |(index, part): (usize, &Part)| {
        let filled = part.attributes.text(FILTER).is_some();
        let guided = part.attributes.text(GUIDES).unwrap_or_default();
        let kept = part.attributes.text(KEPT);
        let kept = kept.and_then(|text| serde_json::from_str::<Vec<String>>(&text).ok());
        let is_guide = |name: &str| {
            let guides = guided
                .split(", ")
                .any(|guide| guide == name || guide == Name::new(name).layer && !guide.is_empty());
            guides || twins.iter().any(|(part, twin)| *part == index && twin == name)
        };
        let channels = part.channels.iter().zip(&choices[index]);
        let was_kept = |name: &str| match &kept {
            Some(kept) => kept.iter().any(|one| one == name),
            None => is_guide(name),
        };
        let made = |(channel, choice): (&Channel, &Choice)| {
            filled && choice.rule != Rule::Keep && !was_kept(&channel.display_name())
        };
        channels.map(made).collect()
    };
    frame.parts.iter().enumerate().map(of_part).collect()
}
