//! Which channels guide which part.

use lacuna_exr::{Compression, Frame, Part, Samples, Window};
use lacuna_filters::Mask;

use super::complete::{complete, left_out};
use super::filled::made;
use super::{Asked, Error};
use crate::channels::{self, Choice, DecidedBy, Name, Rule, list_channels, view_of, views, visible};
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
    /// The view that it is of; nothing if it serves all.
    pub view: Option<String>,
}

impl Guide {
    /// Whether it may steer channels of a view.
    pub fn serves(&self, view: Option<&str>) -> bool {
        self.view.as_deref().is_none_or(|own| view.is_none_or(|view| own == view))
    }
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
    let own = found.parts.iter().flatten().filter(|guide| !guide.second);
    own.for_each(|guide| keep(guide, choices, true));
    for note in keep_complete(frame, masks, choices) {
        if !found.notes.contains(&note) {
            found.notes.push(note);
        }
    }
    Ok(found)
}

/// Makes the rules of complete channels `keep`, whether they guide or not. Returns what a reader of the log should know.
pub fn keep_complete(frame: &Frame, masks: &Masks, choices: &mut [Vec<Choice>]) -> Vec<String> {
    let mut notes = Vec::new();
    for index in 0..frame.parts.len() {
        let missing = missing(masks, index);
        if missing.is_empty() {
            continue;
        }
        let found = of_part(frame, index, (&missing, masks), choices, &Asked::Auto, &mut notes);
        found.into_iter().flatten().for_each(|guide| keep(&guide, choices, false));
        channels::demote_incomplete_normals(&frame.parts[index], &mut choices[index]);
    }
    notes
}

fn keep(guide: &Guide, choices: &mut [Vec<Choice>], guides: bool) {
    for &at in &guide.channels {
        let choice = &mut choices[guide.part][at];
        if choice.rule != Rule::Keep {
            choice.complete(guides);
        }
    }
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
        if alike(&frame.parts[index], own) {
            found.extend(of_part(frame, part, (missing, masks), choices, asked, notes)?);
        }
    }
    check_asked(frame, asked, &found, |guide| &frame.parts[guide.part])?;
    Ok(found)
}

/// The complete channels of a part.
fn of_part(
    frame: &Frame,
    part: usize,
    (missing, masks): (&[&Mask], &Masks),
    choices: &[Vec<Choice>],
    asked: &Asked,
    notes: &mut Vec<String>,
) -> Result<Vec<Guide>, Error> {
    let (own, mut found) = (&frame.parts[part], Vec::new());
    // A rule that was asked for goes before.
    let overridden = |at: usize| choices[part][at].by == DecidedBy::Override;
    for (guide, why) in candidates(own, part, asked, |at| masks.is_mask_channel(part, at), overridden) {
        let ruled = |&at: &usize| choices[part][at].rule != Rule::Keep && overridden(at);
        if matches!(asked, Asked::Auto) && guide.channels.iter().any(ruled) {
            continue;
        }
        let judges = judges(Some(masks), &guide, missing);
        let guide = if why == Why::Name { without_left_out(own, guide, &judges) } else { guide };
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

/// The channels of a candidate that were not left out, if these are only some.
fn without_left_out(part: &Part, guide: Guide, judges: &[&Mask]) -> Guide {
    let samples = |at: usize| &part.channels[at].samples;
    let is_there = |at: &usize| !judges.iter().any(|mask| left_out(samples(*at), part.compression, mask));
    let channels: Vec<usize> = guide.channels.iter().copied().filter(is_there).collect();
    if channels.is_empty() || channels.len() == guide.channels.len() {
        return guide;
    }
    let names: Vec<_> = channels.iter().map(|&at| part.channels[at].display_name()).collect();
    Guide { name: names.join(", "), channels, ..guide }
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
        listed
            || self.holds(&Guide { name, second: true, part, channels, kind: Kind::Values, view: None }, &[])
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
    over((own, window), &[], second, asked, notes)?.ok_or_else(|| of_other_pixels(own, window))
}

/// Why no part of a second frame serves one that is enlarged to a window.
pub fn of_other_pixels(own: &Part, window: Window) -> Error {
    Error::LargerWindow { window: shown(own, window) }
}

fn of_second(
    own: &Part,
    missing: &[&Mask],
    second: &Second<'_>,
    asked: &Asked,
    notes: &mut Vec<String>,
) -> Result<Vec<Guide>, Error> {
    let window = own.data_window;
    over((own, window), missing, second, asked, notes)?
        .ok_or_else(|| Error::Window { window: shown(own, window) })
}

/// What a part of the guides' file must have, which none has.
fn shown(own: &Part, window: Window) -> String {
    let views: Vec<String> = views(own).into_iter().flatten().collect();
    let of = match views.as_slice() {
        [] => String::new(),
        views => format!("the view {} and ", visible(&views.join(" or "))),
    };
    format!("{of}the data window {} at ({}, {})", window.size(), window.x_min, window.y_min)
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
        // Parts without a view serve all, as does a file of one.
        let of_one = frame.parts.len() == 1 && views(other).len() == 1;
        let meets = || views(other).iter().any(|view| view.is_none() || views(own).contains(view));
        if other.data_window != window || (frame.parts.len() > 1 && !meets()) {
            continue;
        }
        fits = true;
        for (guide, why) in candidates(other, part, asked, |at| second.is_mask(part, at), |_| false) {
            let view = guide.view.clone().filter(|_| !of_one);
            let guide = Guide { second: true, view, ..guide };
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
    a.data_window == b.data_window && views(a).iter().any(|view| views(b).contains(view))
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
    is_apart: impl Fn(usize) -> bool,
) -> Vec<(Guide, Why)> {
    let listed = channels::dense(part);
    let mut found: Vec<((String, bool), Guide, Why, bool)> = Vec::new();
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
        // Siblings that the file or the caller says something else of are no group.
        let (key, apart) = ((stem.to_owned(), layer.is_empty()), is_apart(at));
        let same = found.iter_mut().filter(|_| !alone).find(|(other, guide, group, ruled)| {
            (&key, kind, &view, why, apart) == (other, guide.kind, &guide.view, *group, *ruled)
        });
        if let Some((_, guide, ..)) = same {
            guide.channels.push(at);
        } else {
            let shown = if alone || stem.is_empty() { name.clone() } else { stem.to_owned() };
            let guide = Guide { name: shown, second: false, part: index, channels: vec![at], kind, view };
            found.push((key, guide, why, apart));
        }
    }
    found.into_iter().map(|(_, guide, why, _)| (guide, why)).collect()
}

/// Whether `auto` takes a channel for its name.
fn guides_by_name(part: &Part, at: usize, name: &str) -> bool {
    let (rule, _) = channels::by_default(part, at);
    rule == Rule::Normal
        || rule == Rule::Depth
        || channels::is_main_alpha(part, name)
        || channels::is_position(name)
        || channels::is_albedo(name)
        || channels::is_label(part, at)
}
