//! Which channels guide which part.

use lacuna_exr::{Compression, Frame, Part, Samples, Window};
use lacuna_filters::Mask;

use super::complete::complete;
use super::{Asked, Error};
use crate::channels::{self, Choice, DecidedBy, Name, Rule, list_channels, view_of};
use crate::mask::Masks;

/// What a guide is, which says how it is used.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Kind {
    /// Numbers that colour may follow.
    Values,
    /// Labels of surfaces: borders.
    Labels,
}

/// Channels that guide together.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Guide {
    /// What people call it: the layer, or the channel's full name where it is alone.
    pub name: String,
    /// Whether it stands in the second frame.
    pub second: bool,
    /// The part.
    pub part: usize,
    /// The channels in it.
    pub channels: Vec<usize>,
    /// What it is.
    pub kind: Kind,
}

/// The guides of every part.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Found {
    /// Per part, in the order of files, parts and channels.
    pub parts: Vec<Vec<Guide>>,
    /// What a reader of the log should know, one line each.
    pub notes: Vec<String>,
}

impl Found {
    /// The names of a part's guides.
    pub fn names(&self, part: usize) -> Vec<String> {
        self.parts.get(part).into_iter().flatten().map(|guide| guide.name.clone()).collect()
    }
}

/// Finds the guides of a frame, and makes the rules of its channels that are complete `keep`.
///
/// # Errors
/// What was asked for by name and is not there, or is sparse; a second frame without the pixels of the first.
pub fn find(
    frame: &Frame,
    masks: &Masks,
    choices: &mut [Vec<Choice>],
    asked: &Asked,
    second: Option<&Frame>,
) -> Result<Found, Error> {
    let mut found = Found { parts: vec![Vec::new(); frame.parts.len()], notes: Vec::new() };
    if *asked == Asked::None {
        return Ok(found);
    }
    for index in 0..frame.parts.len() {
        let filled = |choice: &Choice| choice.rule == Rule::Fill;
        let Some(mask) = part_mask(masks, index).filter(|_| choices[index].iter().any(filled)) else {
            continue;
        };
        found.parts[index] = match second {
            Some(second) => of_second(frame, index, second, asked)?,
            None => of_frame(frame, index, (mask, masks), choices, asked, &mut found.notes)?,
        };
    }
    for guide in found.parts.iter().flatten().filter(|guide| !guide.second) {
        for &at in &guide.channels {
            let choice = &mut choices[guide.part][at];
            if choice.rule != Rule::Keep {
                choice.guide();
            }
        }
    }
    Ok(found)
}

/// The mask of the part's channels that miss something.
fn part_mask(masks: &Masks, part: usize) -> Option<&Mask> {
    let channels = masks.channels.get(part)?;
    channels
        .iter()
        .flatten()
        .find(|mask| !mask.is_full() && !mask.is_empty())
        .map(std::convert::AsRef::as_ref)
}

fn of_frame(
    frame: &Frame,
    index: usize,
    (mask, masks): (&Mask, &Masks),
    choices: &[Vec<Choice>],
    asked: &Asked,
    notes: &mut Vec<String>,
) -> Result<Vec<Guide>, Error> {
    let mut found = Vec::new();
    for (part, own) in frame.parts.iter().enumerate() {
        if !alike(&frame.parts[index], own) {
            continue;
        }
        for (guide, why) in candidates(own, part, asked, |at| masks.is_mask_channel(part, at)) {
            let samples: Vec<&Samples> = guide.channels.iter().map(|&at| &own.channels[at].samples).collect();
            // A rule that was asked for goes before.
            let overridden = |&at: &usize| {
                let choice = &choices[part][at];
                choice.rule != Rule::Keep && choice.by == DecidedBy::Override
            };
            if matches!(asked, Asked::Auto) && guide.channels.iter().any(overridden) {
                continue;
            }
            let holds = |compression| why == Why::Listed || complete(&samples, compression, mask);
            if holds(own.compression) {
                found.push(guide);
            } else if why == Why::Asked {
                return Err(Error::Sparse { channel: guide.name });
            } else if holds(Compression::None) {
                let (name, compression) = (guide.name, own.compression.name());
                let note =
                    format!("{name}: sparse, as values near zero count as zeros that {compression} changed");
                if !notes.contains(&note) {
                    notes.push(note);
                }
            }
        }
    }
    check_asked(frame, asked, &found, |guide| &frame.parts[guide.part])?;
    Ok(found)
}

/// The guides of a part that is enlarged to a window: those of the second frame over the same pixels.
///
/// # Errors
/// As [`find`], and parts with a mask that misses pixels.
pub fn of_larger(own: &Part, window: Window, second: &Frame, asked: &Asked) -> Result<Vec<Guide>, Error> {
    let Some(found) = over(own, window, second, asked) else {
        let size = window.size();
        let window = format!("{size} at ({}, {})", window.x_min, window.y_min);
        return Err(Error::LargerWindow { window });
    };
    for guide in &found {
        let part = &second.parts[guide.part];
        let masks = part.channels.iter().filter(|channel| channel.name == b"mask");
        if masks.map(|channel| channel.samples.as_f32()).any(|values| values.contains(&0.0)) {
            return Err(Error::SparseFile { part: guide.part });
        }
    }
    check_asked(second, asked, &found, |guide| &second.parts[guide.part])?;
    Ok(found)
}

fn of_second(frame: &Frame, index: usize, second: &Frame, asked: &Asked) -> Result<Vec<Guide>, Error> {
    let own = &frame.parts[index];
    let Some(found) = over(own, own.data_window, second, asked) else {
        let size = own.data_window.size();
        let window = format!("{size} at ({}, {})", own.data_window.x_min, own.data_window.y_min);
        return Err(Error::Window { window });
    };
    check_asked(second, asked, &found, |guide| &second.parts[guide.part])?;
    Ok(found)
}

/// What guides a part over those pixels; nothing if the second frame has no part with them.
fn over(own: &Part, window: Window, second: &Frame, asked: &Asked) -> Option<Vec<Guide>> {
    let mut found = Vec::new();
    let mut fits = false;
    for (part, other) in second.parts.iter().enumerate() {
        if other.data_window != window || (second.parts.len() > 1 && other.view() != own.view()) {
            continue;
        }
        fits = true;
        let is_mask = |at: usize| other.channels[at].name == b"mask";
        let guides = candidates(other, part, asked, is_mask);
        found.extend(guides.into_iter().map(|(guide, _)| Guide { second: true, ..guide }));
    }
    fits.then_some(found)
}

/// Whether pixels of one part lie on those of another.
fn alike(a: &Part, b: &Part) -> bool {
    a.data_window == b.data_window && a.view() == b.view()
}

/// Every pattern must have found a channel.
fn check_asked<'a>(
    frame: &Frame,
    asked: &Asked,
    found: &[Guide],
    part: impl Fn(&Guide) -> &'a Part,
) -> Result<(), Error> {
    let Asked::Channels(patterns) = asked else { return Ok(()) };
    let matched = |pattern: &glob::Pattern| {
        found.iter().any(|guide| {
            let name = |&at: &usize| part(guide).channels[at].display_name();
            guide.channels.iter().any(|at| pattern.matches(&name(at)))
        })
    };
    match patterns.iter().find(|pattern| !matched(pattern)) {
        Some(pattern) => {
            Err(Error::NoChannel { asked: pattern.as_str().into(), channels: list_channels(frame) })
        }
        None => Ok(()),
    }
}

/// Why a channel is a candidate.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Why {
    Asked,
    Listed,
    Name,
}

/// The channels of a part that may guide, in groups of a layer.
fn candidates(
    part: &Part,
    index: usize,
    asked: &Asked,
    is_mask: impl Fn(usize) -> bool,
) -> Vec<(Guide, Why)> {
    let listed = channels::dense(part);
    let mut found: Vec<(String, Guide, Why)> = Vec::new();
    // By name, as files have them: guides that are rendered with the frame come in another order.
    let mut channels: Vec<usize> = (0..part.channels.len()).filter(|&at| !is_mask(at)).collect();
    channels.sort_by_key(|&at| &part.channels[at].name);
    for (at, channel) in channels.into_iter().map(|at| (at, &part.channels[at])) {
        let name = channel.display_name().into_owned();
        let why = match asked {
            Asked::Channels(patterns) if patterns.iter().any(|pattern| pattern.matches(&name)) => Why::Asked,
            Asked::Auto if listed.contains(&name) => Why::Listed,
            Asked::Auto if guides_by_name(part, at, &name) => Why::Name,
            Asked::Auto | Asked::None | Asked::Channels(_) => continue,
        };
        let labels = channels::is_label(part, at);
        let kind = if labels { Kind::Labels } else { Kind::Values };
        // Depths, alphas and labels stand alone; so do channels without a layer, except for the normals and positions of pbrt.
        let alone = labels || channels::is_alpha(&name) || channels::by_default(part, at).0 == Rule::Depth;
        let layer = Name::new(&name).layer;
        let view = view_of(part, &name);
        let stem = if layer.is_empty() {
            name.trim_end_matches(['x', 'y', 'z', 'X', 'Y', 'Z', 'R', 'G', 'B'])
        } else {
            layer
        };
        let key = if alone { name.clone() } else { format!("{stem}\n{view:?}") };
        let same = found.iter_mut().find(|(other, guide, _)| *other == key && guide.kind == kind && !alone);
        if let Some((_, guide, _)) = same {
            guide.channels.push(at);
        } else {
            let shown = if alone || stem.is_empty() { name.clone() } else { stem.to_owned() };
            let guide = Guide { name: shown, second: false, part: index, channels: vec![at], kind };
            found.push((key, guide, why));
        }
    }
    found.into_iter().map(|(_, guide, why)| (guide, why)).collect()
}

/// Whether `auto` takes a channel for its name.
fn guides_by_name(part: &Part, at: usize, name: &str) -> bool {
    let (rule, _) = channels::by_default(part, at);
    rule == Rule::Normal
        || rule == Rule::Depth
        || name == "A"
        || channels::is_position(name)
        || channels::is_albedo(name)
        || channels::is_label(part, at)
}
