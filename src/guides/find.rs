//! Which channels guide which part.

use lacuna_exr::{Compression, Frame, Part, Samples, Window};
use lacuna_filters::Mask;

use super::complete::complete;
use super::filled::made;
use super::{Asked, Error};
use crate::channels::{self, Choice, DecidedBy, Name, Rule, list_channels, view_of};
use crate::mask::{self, Masks, claimed_density};

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
    /// Planes that guide a part, of that with most.
    pub fn most_planes(&self) -> u64 {
        let planes = |guides: &Vec<Guide>| guides.iter().map(|guide| guide.channels.len() as u64).sum();
        self.parts.iter().map(planes).max().unwrap_or(0)
    }

    /// The names of a part's guides.
    pub fn names(&self, part: usize) -> Vec<String> {
        self.parts.get(part).into_iter().flatten().map(|guide| guide.name.clone()).collect()
    }
}

/// Finds the guides of a frame, and makes the rules of its channels that are complete `keep`.
///
/// # Errors
/// What was asked for by name and is not there, or is sparse; a second frame without the pixels of the first, or with nothing complete.
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
    let second = second.map(Second::new);
    for index in 0..frame.parts.len() {
        let filled = |choice: &Choice| choice.rule == Rule::Fill;
        let missing = missing(masks, index);
        if missing.is_empty() || !choices[index].iter().any(filled) {
            continue;
        }
        found.parts[index] = match &second {
            Some(second) => of_second(&frame.parts[index], &missing, second, asked, &mut found.notes)?,
            None => of_frame(frame, index, (&missing, masks), choices, asked, &mut found.notes)?,
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

/// The masks of the part's channels that miss something.
fn missing(masks: &Masks, part: usize) -> Vec<&Mask> {
    if part >= masks.channels.len() {
        return Vec::new();
    }
    let different = masks.different(part).into_iter();
    different.filter(|mask| !mask.is_full() && !mask.is_empty()).collect()
}

fn of_frame(
    frame: &Frame,
    index: usize,
    (missing, masks): (&[&Mask], &Masks),
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
            // A rule that was asked for goes before.
            let overridden = |&at: &usize| {
                let choice = &choices[part][at];
                choice.rule != Rule::Keep && choice.by == DecidedBy::Override
            };
            if matches!(asked, Asked::Auto) && guide.channels.iter().any(overridden) {
                continue;
            }
            let judges = judges(Some(masks), &guide, missing);
            let holds = |compression| why == Why::Listed || is_held(own, &guide, compression, &judges);
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

/// The masks that tell whether a candidate is complete: those that serve its channels, else those of what it is to guide.
fn judges<'a>(own: Option<&'a Masks>, guide: &Guide, missing: &[&'a Mask]) -> Vec<&'a Mask> {
    let serving = guide.channels.iter().filter_map(|&at| own?.get(guide.part, at));
    let mut judges: Vec<&Mask> = Vec::new();
    for mask in serving.map(|mask| &**mask) {
        if !judges.iter().any(|other| std::ptr::eq(*other, mask)) {
            judges.push(mask);
        }
    }
    if judges.is_empty() { missing.to_vec() } else { judges }
}

/// Whether a candidate of a part is complete by all of these masks.
fn is_held(part: &Part, guide: &Guide, compression: Compression, judges: &[&Mask]) -> bool {
    let samples: Vec<&Samples> = guide.channels.iter().map(|&at| &part.channels[at].samples).collect();
    judges.iter().all(|mask| complete(&samples, compression, mask))
}

/// A second frame, and what it says of its pixels.
#[derive(Debug)]
pub struct Second<'a> {
    /// The frame.
    pub frame: &'a Frame,
    masks: Option<Masks>,
    /// Per part and channel, whether a fill made its missing pixels.
    made: Vec<Vec<bool>>,
}

impl<'a> Second<'a> {
    /// Looks for masks and stamps in it.
    pub fn new(frame: &'a Frame) -> Self {
        let masks = mask::told(frame);
        let mask_channels = masks.as_ref().map(|masks| masks.mask_channels.as_slice()).unwrap_or_default();
        let mut made = made(frame, &channels::choose(frame, mask_channels, &[]));
        for (part, made) in frame.parts.iter().zip(&mut made) {
            if claimed_density(part) == Some(1.0) {
                made.fill(false);
            }
        }
        Self { frame, masks, made }
    }

    /// Whether channels of it are complete, by a mask of its own or else by those of what they are to guide. One that is no pattern may be a
    /// matte, and is asked last.
    fn holds(&self, guide: &Guide, missing: &[&Mask]) -> bool {
        let part = &self.frame.parts[guide.part];
        if guide.channels.iter().any(|&at| self.made[guide.part][at]) {
            return false;
        }
        let mut judges = judges(self.masks.as_ref(), guide, missing);
        if !missing.is_empty() && !judges.iter().all(|mask| mask.is_full() || mask::is_scattered(mask)) {
            judges = missing.to_vec();
        }
        is_held(part, guide, part.compression, &judges)
    }

    fn is_mask(&self, part: usize, channel: usize) -> bool {
        self.masks.as_ref().is_some_and(|masks| masks.is_mask_channel(part, channel))
    }

    /// Whether a channel, with the others of its layer, is complete by the masks of its own that it has.
    pub fn is_complete(&self, part: usize, channel: usize) -> bool {
        let own = &self.frame.parts[part];
        let name = own.channels[channel].display_name().into_owned();
        let layer = |at: usize| Name::new(&own.channels[at].display_name()).layer.to_owned();
        let same =
            |at: usize| !layer(at).is_empty() && layer(at) == layer(channel) && !self.is_mask(part, at);
        let beside = |&at: &usize| at == channel || same(at);
        let channels = (0..own.channels.len()).filter(beside).collect();
        let listed = channels::dense(own).contains(&name);
        listed || self.holds(&Guide { name, second: true, part, channels, kind: Kind::Values }, &[])
    }
}

/// The guides of a part that is enlarged to a window: those of the second frame over the same pixels.
///
/// # Errors
/// As [`find`].
pub fn of_larger(
    own: &Part,
    window: Window,
    second: &Second<'_>,
    asked: &Asked,
    notes: &mut Vec<String>,
) -> Result<Vec<Guide>, Error> {
    over((own, window), &[], second, asked, notes)?.ok_or_else(|| of_other_pixels(window))
}

/// Why no part of a second frame serves one that is enlarged to a window.
pub fn of_other_pixels(window: Window) -> Error {
    Error::LargerWindow { window: shown(window) }
}

fn of_second(
    own: &Part,
    missing: &[&Mask],
    second: &Second<'_>,
    asked: &Asked,
    notes: &mut Vec<String>,
) -> Result<Vec<Guide>, Error> {
    let window = own.data_window;
    over((own, window), missing, second, asked, notes)?.ok_or_else(|| Error::Window { window: shown(window) })
}

fn shown(window: Window) -> String {
    format!("{} at ({}, {})", window.size(), window.x_min, window.y_min)
}

/// What guides a part over those pixels, of which some are missing; nothing if the second frame has no part with them.
fn over(
    (own, window): (&Part, Window),
    missing: &[&Mask],
    second: &Second<'_>,
    asked: &Asked,
    notes: &mut Vec<String>,
) -> Result<Option<Vec<Guide>>, Error> {
    let frame = second.frame;
    let (mut found, mut sparse, mut fits) = (Vec::new(), Vec::new(), false);
    for (part, other) in frame.parts.iter().enumerate() {
        if other.data_window != window || (frame.parts.len() > 1 && other.view() != own.view()) {
            continue;
        }
        fits = true;
        for (guide, why) in candidates(other, part, asked, |at| second.is_mask(part, at)) {
            let guide = Guide { second: true, ..guide };
            if why == Why::Listed || second.holds(&guide, missing) {
                found.push(guide);
            } else {
                sparse.push(guide.name);
            }
        }
    }
    if !fits {
        return Ok(None);
    }
    if !sparse.is_empty() {
        let channels = sparse.join(", ");
        if found.is_empty() || *asked != Asked::Auto {
            return Err(Error::SparseFile { channels });
        }
        notes.push(format!("{channels}: sparse in the guides' file, and no guide"));
    }
    check_asked(frame, asked, &found, |guide| &frame.parts[guide.part])?;
    Ok(Some(found))
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
