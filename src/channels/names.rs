//! Channel names taken apart: layers, components, views, and the words they are made of.

use lacuna_exr::{Frame, Part};

/// A channel's name split at its last full stop: `layer.component`, both as they stand in the file.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Name<'a> {
    /// What stands before the last full stop, or nothing.
    pub layer: &'a str,
    /// What stands after it.
    pub component: &'a str,
}

impl<'a> Name<'a> {
    /// Splits a full name.
    pub fn new(full: &'a str) -> Self {
        match full.rsplit_once('.') {
            Some((layer, component)) => Self { layer, component },
            None => Self { layer: "", component: full },
        }
    }
}

/// The words of a name, in lower case: runs of letters, split at every other character, before a capital that
/// follows a small letter, and before the last capital of a run of them (`VRayMtlID` is v, ray, mtl, id), unless only the s of a plural follows (`UVs`). The end of
/// an ordinal belongs to its number (`1st_bounce` is bounce).
pub fn words(name: &str) -> Vec<String> {
    let letters: Vec<char> = name.chars().collect();
    let (mut words, mut word) = (Vec::new(), String::new());
    let mut ends = |word: &mut String, end: usize| {
        let word = std::mem::take(word);
        let number = end.checked_sub(3).is_some_and(|digit| letters[digit].is_ascii_digit());
        let ordinal = number && ["st", "nd", "rd", "th"].contains(&word.as_str());
        words.extend((!word.is_empty() && !ordinal).then_some(word));
    };
    for (i, &letter) in letters.iter().enumerate() {
        let after_small = i > 0 && letters[i - 1].is_lowercase();
        let small = |at: usize| letters.get(at).is_some_and(|letter| letter.is_lowercase());
        let plural =
            i > 0 && letters[i - 1].is_uppercase() && letters.get(i + 1) == Some(&'s') && !small(i + 2);
        let before_small = small(i + 1) && !plural;
        if !letter.is_alphabetic() || (letter.is_uppercase() && (after_small || before_small)) {
            ends(&mut word, i);
        }
        word.extend(letter.to_lowercase().filter(|_| letter.is_alphabetic()));
    }
    ends(&mut word, letters.len());
    words
}

/// The view that a channel belongs to: its part's `view`, else what the `multiView` attribute makes of its name
/// (the second last component or the first if it is a listed view, otherwise the first view, which is the default one).
pub fn view_of(part: &Part, name: &str) -> Option<String> {
    if let Some(view) = part.view() {
        return Some(view);
    }
    let first = multi_view(part).into_iter().next()?;
    Some(listed_view(part, name).unwrap_or(first))
}

/// The views that channels of a part belong to; one that is none where it has no views.
pub fn views(part: &Part) -> Vec<Option<String>> {
    let mut views: Vec<_> = part.channels.iter().map(|one| view_of(part, &one.display_name())).collect();
    views.sort();
    views.dedup();
    views
}

/// A channel's name without the view that the `multiView` attribute makes of a component.
pub fn without_view(part: &Part, name: &str) -> String {
    let Some(view) = listed_view(part, name) else { return name.into() };
    let mut words: Vec<&str> = name.split('.').collect();
    let last = words.len().saturating_sub(2);
    words.remove(if words[last] == view { last } else { 0 });
    words.join(".")
}

/// Whether a view is said: by the part, or in the channel's name.
pub fn names_view(part: &Part, name: &str) -> bool {
    part.view().is_some() || listed_view(part, name).is_some()
}

/// The view in a channel's name, if the `multiView` attribute lists it: the second last component, as the standard says, or the first, as some write
/// it (`right.Vector.X`).
fn listed_view(part: &Part, name: &str) -> Option<String> {
    let layer = Name::new(name).layer;
    let (last, first) = (Name::new(layer).component, layer.split('.').next().unwrap_or_default());
    let views = multi_view(part);
    [last, first].into_iter().find_map(|word| views.iter().find(|view| *view == word).cloned())
}

/// The views that the attribute `multiView` lists, the default one first; empty where there is none.
fn multi_view(part: &Part) -> Vec<String> {
    let Some(attribute) = part.attributes.get("multiView") else { return Vec::new() };
    if attribute.kind != b"stringvector" {
        return Vec::new();
    }
    let mut views = Vec::new();
    let mut rest = attribute.value.as_slice();
    while let Some((length, tail)) = rest.split_first_chunk::<4>() {
        let length = u32::from_le_bytes(*length) as usize;
        let Some(text) = tail.get(..length) else { break };
        views.push(String::from_utf8_lossy(text).into_owned());
        rest = &tail[length..];
    }
    views
}

/// A text from a file as people may see it: control characters, which could move the cursor or break the line, as
/// escapes.
pub fn visible(text: &str) -> std::borrow::Cow<'_, str> {
    if !text.contains(char::is_control) {
        return text.into();
    }
    let escaped = |letter: char| -> String {
        if letter.is_control() { letter.escape_default().collect() } else { letter.into() }
    };
    text.chars().map(escaped).collect::<String>().into()
}

/// The full names of a part's channels.
pub fn full_names(part: &Part) -> Vec<String> {
    part.channels.iter().map(|channel| channel.display_name().into_owned()).collect()
}

/// The place of a channel among R, G and B, by the last word of its full name.
pub fn rgb_place(full: &str) -> Option<usize> {
    let component = Name::new(full).component.to_ascii_lowercase();
    let names = [["r", "red"], ["g", "green"], ["b", "blue"]];
    names.iter().position(|names| names.contains(&component.as_str()))
}

/// A part as messages call it: `part 2 (depth_left)`; nothing for the only part of a frame.
pub fn part_label(frame: &Frame, part: usize) -> String {
    match frame.parts.get(part).and_then(Part::name) {
        _ if frame.parts.len() <= 1 => String::new(),
        Some(name) if !name.is_empty() => format!("part {part} ({})", visible(&name)),
        _ => format!("part {part}"),
    }
}

/// A channel as messages call it: `part 2 (depth_left), channel Z`, or `channel Z` in a frame of one part.
pub fn channel_label(frame: &Frame, part: usize, channel: usize) -> String {
    let name = frame.parts.get(part).and_then(|part| part.channels.get(channel));
    let name = name.map_or_else(|| channel.to_string(), |channel| channel.display_name().into_owned());
    let name = visible(&name);
    let part = part_label(frame, part);
    if part.is_empty() { format!("channel {name}") } else { format!("{part}, channel {name}") }
}

/// The channels of a frame on one line, part by part; long lists are cut and say so.
pub fn list_channels(frame: &Frame) -> String {
    const MOST: usize = 40;
    let mut left = MOST;
    let mut parts = Vec::new();
    for (index, part) in frame.parts.iter().enumerate() {
        let names: Vec<_> = part
            .channels
            .iter()
            .take(left)
            .map(|channel| visible(&channel.display_name()).into_owned())
            .collect();
        left -= names.len();
        let label = part_label(frame, index);
        let names = names.join(", ");
        if !names.is_empty() {
            parts.push(if label.is_empty() { names } else { format!("{label}: {names}") });
        }
    }
    let all: usize = frame.parts.iter().map(|part| part.channels.len()).sum();
    let more = if all > MOST { format!(" and {} more", all - MOST) } else { String::new() };
    format!("{}{more}", parts.join("; "))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn words_are_whole_words() {
        let of = |name: &str| words(name).join(" ");
        assert_eq!(of("objectId"), "object id");
        assert_eq!(of("material_id"), "material id");
        assert_eq!(of("VRayMtlID"), "v ray mtl id");
        assert_eq!(of("CryptoObject00.r"), "crypto object r");
        assert_eq!(of("fluid.R"), "fluid r");
        assert_eq!(of("ZBack"), "z back");
        assert_eq!(of("SAMPLECOUNT"), "samplecount");
        assert_eq!(of("Diffuse Direct.R"), "diffuse direct r");
        assert_eq!(of("..7"), "");
        assert_eq!(of("1st_bounce.R"), "bounce r");
        assert_eq!(of("st.R"), "st r");
        assert_eq!(of("lgt_2nd"), "lgt");
        assert_eq!(of("1stBounce"), "bounce");
        assert_eq!(of("objectIDs UVs.R"), "object ids uvs r");
        assert_eq!(of("IDsOfAStone"), "ids of a stone");
    }

    #[test]
    fn control_characters_are_seen() {
        assert_eq!(visible("a\x1b[2J\nb"), "a\\u{1b}[2J\\nb");
        assert_eq!(visible("größe b"), "größe b");
    }

    #[test]
    fn names_split_at_the_last_full_stop() {
        assert_eq!(Name::new("R"), Name { layer: "", component: "R" });
        assert_eq!(Name::new("a.b.R"), Name { layer: "a.b", component: "R" });
        assert_eq!(Name::new("a."), Name { layer: "a", component: "" });
    }
}
