//! Whether a filled frame is what `fill` promises of its sparse one, told from the two frames alone.
//!
//! Promised: parts, names, windows, types and attributes are those of the sparse frame, except for what the filled
//! one says was asked for (its attribute `lacuna/settings`); kept channels and measured pixels have the same bits; what
//! was filled is finite and within its bounds; identifiers and depths are values that were measured in that channel; what
//! the filled frame says was copied (`lacuna/copied`) is what stands in that complete channel, unless that is in another file; filled normals are of
//! unit length where the measured ones are; the attributes that `fill` adds agree with the mask and with each other;
//! estimated errors are none at measured pixels.
//!
//! Not told from the two frames: which filter ran with which settings, whether a copied value is the nearest one, and
//! whether measured pixels were smoothed as much as the filled frame's attributes allow.

mod normals;
mod pixels;
#[cfg(test)]
mod properties;
mod stamps;
#[cfg(test)]
mod tests;

use lacuna_exr::{Attribute, Compression, Frame, Part, REQUIRED, Window};
use serde::Serialize;

use crate::channels::{Choice, Name, Override, Rule, part_label, visible};
use crate::guides::Asked;
use crate::guides::{Copied, copied};
use crate::mask::{Masks, Source};
use crate::reconstruct::{ADDED, DERIVED, FILLED_BY, Kind, RENDER, Stamp, error_channel, output_compression};

/// One difference between what is and what should be.
#[derive(Clone, Debug, PartialEq, Eq, Serialize)]
pub struct Difference {
    /// The part, as messages call it; nothing if it concerns the frame, or its only part.
    pub part: Option<String>,
    /// The channel's full name.
    pub channel: Option<String>,
    /// The first pixel (column, row) in absolute coordinates.
    pub pixel: Option<(i64, i64)>,
    /// What is wrong.
    pub what: String,
}

impl std::fmt::Display for Difference {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        let part = self.part.clone();
        let channel = self.channel.as_ref().map(|name| format!("channel {}", visible(name)));
        let pixel = self.pixel.map(|(x, y)| format!("pixel ({x}, {y})"));
        let place: Vec<_> = [part, channel, pixel].into_iter().flatten().collect();
        let colon = if place.is_empty() { "" } else { ": " };
        write!(f, "{}{colon}{}", place.join(", "), visible(&self.what))
    }
}

/// What a filled frame says was asked for.
#[derive(Clone, Debug, PartialEq)]
pub struct Claims {
    /// Where its mask came from; a file's path is as it was resolved.
    pub mask: Source,
    /// The channel rules.
    pub overrides: Vec<Override>,
    /// The type of filled channels.
    pub kind: Option<Kind>,
    /// The compression.
    pub compression: Option<Compression>,
    /// Whether the mask's channels were left out.
    pub drop_mask: bool,
    /// The guides that were looked for in the frame itself, which are kept.
    pub guides: Asked,
    /// Whether measured pixels were smoothed.
    pub smoothed: bool,
    /// The filter's name; empty if nothing says it.
    pub filter: String,
    /// The channels that were copied from those of another file.
    pub elsewhere: Vec<String>,
}

impl Default for Claims {
    fn default() -> Self {
        let (mask, overrides) = (Source::Auto, Vec::new());
        Self {
            mask,
            overrides,
            kind: None,
            compression: None,
            drop_mask: false,
            guides: Asked::None,
            smoothed: false,
            filter: String::new(),
            elsewhere: Vec::new(),
        }
    }
}

impl Claims {
    /// Reads the attributes of a filled frame; one without them claims nothing but the defaults.
    pub fn read(filled: &Frame) -> Self {
        let Some(stamp) = filled.parts.iter().find_map(|part| Stamp::read(&part.attributes)) else {
            return Self::default();
        };
        let elsewhere = filled.parts.iter().enumerate().flat_map(|(at, part)| {
            copied(&part.attributes).into_iter().filter(move |copied| copied.part(at).is_none())
        });
        let setting = |name: &str, value: &str| stamp.setting(name).is_some_and(|found| found == value);
        let kinds = [("half", Kind::Half), ("float", Kind::Float)];
        Self {
            mask: stamp.source().unwrap_or(Source::Auto),
            overrides: stamp.overrides(),
            kind: kinds.into_iter().find(|kind| setting("type", kind.0)).map(|kind| kind.1),
            compression: stamp.setting("compression").and_then(|name| Compression::from_name(&name)),
            drop_mask: setting("mask-channel", "dropped"),
            guides: stamp
                .setting("guides")
                .filter(|_| setting("guides-from", "frame"))
                .and_then(|guides| guides.parse().ok())
                .unwrap_or(Asked::None),
            smoothed: stamp.says_smoothed(),
            filter: stamp.filter,
            elsewhere: elsewhere.map(|copied| copied.channel).collect(),
        }
    }

    /// Whether a frame was filled and the other, which should be, was not.
    pub fn are_swapped(first: &Frame, filled: &Frame) -> bool {
        Self::read(filled).filter.is_empty() && !Self::read(first).filter.is_empty()
    }

    /// What is not compared because the filled frame says so, for people.
    pub fn not_compared(&self) -> Vec<String> {
        let by = if self.filter.is_empty() { String::new() } else { format!(" by {}", self.filter) };
        let smoothed = self
            .smoothed
            .then(|| format!("measured pixels were not compared: the file says that they were smoothed{by}"));
        let names = self.elsewhere.join(", ");
        let elsewhere = (!names.is_empty()).then(|| {
            format!(
                "{names}: copied pixels were not compared: the file says that they are those of another one"
            )
        });
        smoothed.into_iter().chain(elsewhere).collect()
    }
}

/// Attributes that the typed fields of a part stand for, and those that follow from them.
const TYPED: &[&str] = &["channels", "compression", "dataWindow", "displayWindow", "chunkCount", "tiles"];

/// Attributes that writing adds to a part of several that lacks them.
const OF_PARTS: &[&str] = &["name", "type"];

/// Whether writing gives an attribute that a part lacks, or has in another type.
fn is_given(name: &[u8], kind: &[u8]) -> bool {
    let own = |(other, of): &(&str, &str)| other.as_bytes() == name && of.as_bytes() == kind;
    OF_PARTS.iter().any(|other| other.as_bytes() == name) || REQUIRED.iter().any(own)
}

/// The part at hand, on both sides.
struct Pair<'a> {
    index: usize,
    label: Option<String>,
    frame: &'a Frame,
    sparse: &'a Part,
    filled: &'a Part,
    masks: &'a Masks,
    choices: &'a [Choice],
    claims: &'a Claims,
}

impl Pair<'_> {
    fn differ(&self, channel: Option<&str>, pixel: Option<(i64, i64)>, what: String) -> Difference {
        Difference { part: self.label.clone(), channel: channel.map(Into::into), pixel, what }
    }

    /// The first of the `wrong` pixels and their number; nothing if there is none.
    fn first_of(&self, channel: &str, what: &str, wrong: &[usize]) -> Option<Difference> {
        let first = *wrong.first()?;
        let width = self.sparse.size().width.max(1);
        let window = self.sparse.data_window;
        let x = i64::from(window.x_min) + (first % width) as i64;
        let y = i64::from(window.y_min) + (first / width) as i64;
        let more = if wrong.len() > 1 { format!(" ({} pixels in all)", wrong.len()) } else { String::new() };
        Some(self.differ(Some(channel), Some((x, y)), format!("{what}{more}")))
    }

    /// Whether a channel of the sparse part is to be filled and misses something.
    fn misses(&self, channel: usize) -> bool {
        let rule = self.choices.get(channel).map_or(Rule::Keep, |choice| choice.rule);
        rule != Rule::Keep && self.masks.get(self.index, channel).is_none_or(|mask| !mask.is_full())
    }

    /// What the filled part says a channel's missing pixels were copied from.
    fn copied(&self, name: &str) -> Option<Copied> {
        copied(&self.filled.attributes).into_iter().find(|copied| copied.channel == name)
    }

    /// Whether a channel of the sparse part is left out of the filled one.
    fn dropped(&self, channel: usize) -> bool {
        let masks = self.masks.droppable(self.index);
        self.claims.drop_mask && masks.contains(&channel) && masks.len() < self.sparse.channels.len()
    }
}

/// Everything in `filled` that is not as `fill` promises; `masks` and `choices` are those of `sparse`, found with what
/// [`Claims::read`] says.
pub fn compare(sparse: &Frame, filled: &Frame, masks: &Masks, choices: &[Vec<Choice>]) -> Vec<Difference> {
    let whole = |what: String| Difference { part: None, channel: None, pixel: None, what };
    if sparse.parts.len() != filled.parts.len() {
        let (expected, found) = (sparse.parts.len(), filled.parts.len());
        return vec![whole(format!("the number of parts is {found}, not {expected}"))];
    }
    if choices.len() != sparse.parts.len() {
        return vec![whole("the masks or the channel rules belong to another frame".into())];
    }
    let claims = Claims::read(filled);
    let mut differences = Vec::new();
    for (index, (sparse_part, filled_part)) in sparse.parts.iter().zip(&filled.parts).enumerate() {
        let label = Some(part_label(sparse, index)).filter(|label| !label.is_empty());
        let pair = Pair {
            index,
            label,
            frame: sparse,
            sparse: sparse_part,
            filled: filled_part,
            masks,
            choices: &choices[index],
            claims: &claims,
        };
        compare_header(&pair, &mut differences);
        compare_attributes(&pair, &mut differences);
        // Pixels of other places are not those that were promised.
        if sparse_part.data_window != filled_part.data_window {
            continue;
        }
        differences.extend(stamps::compare(&pair));
        compare_channels(&pair, &mut differences);
        differences.extend(normals::compare(&pair));
        differences.extend(stamps::compare_errors(&pair));
    }
    differences
}

fn compare_header(pair: &Pair<'_>, differences: &mut Vec<Difference>) {
    let (sparse, filled) = (pair.sparse, pair.filled);
    let mut add = |what: String| differences.push(pair.differ(None, None, what));
    let show = |w: Window| format!("({}, {})-({}, {})", w.x_min, w.y_min, w.x_max, w.y_max);
    for (name, expected, found) in [
        ("data window", sparse.data_window, filled.data_window),
        ("display window", sparse.display_window, filled.display_window),
    ] {
        if expected != found {
            add(format!("the {name} is {}, not {}", show(found), show(expected)));
        }
    }
    let expected = output_compression(sparse.compression, pair.claims.compression);
    if filled.compression != expected {
        let (found, expected) = (filled.compression.name(), expected.name());
        add(format!("the compression is {found}, not {expected}"));
    }
    if filled.layout != sparse.layout {
        add(format!("the layout is {:?}, not {:?}", filled.layout, sparse.layout));
    }
}

fn compare_attributes(pair: &Pair<'_>, differences: &mut Vec<Difference>) {
    let misses = (0..pair.sparse.channels.len()).any(|channel| pair.misses(channel));
    let stamped = Stamp::read(&pair.filled.attributes).is_some();
    let mut add = |what: String| differences.push(pair.differ(None, None, what));
    if misses && !stamped {
        add("the attributes lacuna/version, filter, settings and mask are not all there: not filled by lacuna".into());
    }
    let is = |list: &[&str], name: &[u8]| list.iter().any(|other| other.as_bytes() == name);
    let find = |part: &'_ Part, name: &[u8]| part.attributes.iter().find(|other| other.name == name).cloned();
    let show = |attribute: &Attribute| String::from_utf8_lossy(&attribute.name).into_owned();
    for attribute in pair.sparse.attributes.iter().filter(|attribute| !is(TYPED, &attribute.name)) {
        if stamped && is(ADDED, &attribute.name) {
            continue;
        }
        match find(pair.filled, &attribute.name) {
            None if stamped && is(DERIVED, &attribute.name) => {}
            None => add(format!("the attribute {} is lost", show(attribute))),
            Some(found) if stamped && is_same_render(&found, attribute) => {}
            Some(found) if found.kind != attribute.kind && is_given(&found.name, &found.kind) => {}
            Some(found) if found != *attribute => {
                add(format!("the attribute {} has changed", show(attribute)));
            }
            Some(_) if misses && is(DERIVED, &attribute.name) => {
                add(format!("the attribute {} was made from other pixels", show(attribute)));
            }
            Some(_) => {}
        }
    }
    for attribute in pair.filled.attributes.iter().filter(|attribute| !is(TYPED, &attribute.name)) {
        let promised = (stamped && is(ADDED, &attribute.name)) || is_given(&attribute.name, &attribute.kind);
        if !promised && find(pair.sparse, &attribute.name).is_none() {
            add(format!("the attribute {} is new", show(attribute)));
        }
    }
}

/// Whether both say that the same pixels were rendered in the same way, whatever filled the others.
fn is_same_render(a: &Attribute, b: &Attribute) -> bool {
    let pixels = |attribute: &Attribute| {
        let text = std::str::from_utf8(&attribute.value).ok()?;
        text.rsplit_once(FILLED_BY).map(|(before, _)| before.to_owned())
    };
    a.name == RENDER.as_bytes() && a.kind == b.kind && pixels(a).is_some() && pixels(a) == pixels(b)
}

fn compare_channels(pair: &Pair<'_>, differences: &mut Vec<Difference>) {
    for (index, channel) in pair.sparse.channels.iter().enumerate() {
        let found = pair.filled.channels.iter().find(|other| other.name == channel.name);
        match found {
            None if pair.dropped(index) => {}
            None => {
                let name = channel.display_name();
                differences.push(pair.differ(Some(&name), None, "the channel is lost".into()));
            }
            Some(found) => differences.extend(pixels::compare(pair, index, found)),
        }
    }
    let errors = error_channel(pair.filled);
    for channel in &pair.filled.channels {
        let name = channel.display_name();
        let promised = errors.as_deref() == Some(Name::new(&name).component);
        if !promised && !pair.sparse.channels.iter().any(|other| other.name == channel.name) {
            differences.push(pair.differ(Some(&name), None, "the channel is new".into()));
        }
    }
}
