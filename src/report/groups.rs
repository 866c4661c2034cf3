//! Which channels of two frames are compared with which, and together with which others.

use lacuna_exr::{Frame, Part, Samples};
use serde::Serialize;

use crate::channels::{
    Name, Rule, Shown, by_default, channel_label, is_alpha, is_code, is_colour, is_light, part_label, shown,
};

/// How the values of a group are understood; those that people look at first come first.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Serialize)]
#[serde(rename_all = "kebab-case")]
pub enum Kind {
    /// Scene-linear colour: the peak and the clipping are the caller's.
    Colour,
    /// Coverage: as colour, but 1 is white whatever the peak, and never through a display curve.
    Alpha,
    /// Depths, normals, positions, motion: the peak is the reference's largest absolute value, nothing is clipped.
    Data,
    /// Whole numbers and identifiers: equal or not.
    Codes,
}

/// A group of channels that both frames have.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Group {
    /// The part of the reference and that of the test image.
    pub parts: (usize, usize),
    /// The layer's name.
    pub layer: String,
    /// How values are understood.
    pub kind: Kind,
    /// Channel numbers in reference and test image; colours and axes in their usual order.
    pub channels: Vec<(usize, usize)>,
}

/// The groups of two frames, and notes on what has no partner.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Pairing {
    /// In the order of the reference.
    pub groups: Vec<Group>,
    /// What the reference has and the test image has not.
    pub missing: Vec<String>,
    /// What only the test image has.
    pub extra: Vec<String>,
}

/// Pairs parts (by name, or by number if either has none) and channels (by name).
pub fn pair(reference: &Frame, test: &Frame) -> Pairing {
    let mut pairing = Pairing::default();
    let mut used = vec![false; test.parts.len()];
    for (index, part) in reference.parts.iter().enumerate() {
        match partner(reference, test, index) {
            Some(other) => {
                used[other] = true;
                of_part(reference, test, (index, other), &mut pairing);
            }
            None => pairing.missing.push(describe(part_label(reference, index), part)),
        }
    }
    for (index, part) in test.parts.iter().enumerate().filter(|(index, _)| !used[*index]) {
        pairing.extra.push(describe(part_label(test, index), part));
    }
    pairing
}

impl Pairing {
    /// The group that stands for the frame in pictures, plots and sums: colours first, of these the colour itself ([`shown`]). A part without
    /// layers may say by its own name what it shows.
    pub fn main(&self, reference: &Frame) -> Option<usize> {
        let rank = |group: &Group| {
            let part = &reference.parts[group.parts.0];
            let of_part = part.name().filter(|_| group.layer.is_empty() && reference.parts.len() > 1);
            let name = |&(channel, _): &(usize, usize)| {
                let name = part.channels[channel].display_name();
                of_part.as_ref().map_or_else(|| name.to_string(), |layer| format!("{layer}.{name}"))
            };
            let names: Vec<String> = group.channels.iter().map(name).collect();
            let whole = group.layer.is_empty() && of_part.is_none();
            let what = || shown(&names, &(0..names.len()).collect::<Vec<_>>()).0;
            (group.kind, if whole { Shown::Colour } else { what() })
        };
        (0..self.groups.len()).min_by_key(|&at| rank(&self.groups[at]))
    }
}

fn describe(label: String, part: &Part) -> String {
    if label.is_empty() { format!("a part of {} channels", part.channels.len()) } else { label }
}

fn partner(reference: &Frame, test: &Frame, index: usize) -> Option<usize> {
    let name = |frame: &Frame, index: usize| frame.parts.get(index).and_then(Part::name);
    if reference.parts.len() == 1 && test.parts.len() == 1 {
        return Some(0);
    }
    match name(reference, index) {
        Some(wanted) => (0..test.parts.len())
            .find(|&other| name(test, other).as_ref() == Some(&wanted))
            .or_else(|| (index < test.parts.len() && name(test, index).is_none()).then_some(index)),
        None => (index < test.parts.len()).then_some(index),
    }
}

/// What a channel is to the pairing; nothing for a sampling mask.
fn kind_of(part: &Part, channel: usize) -> Option<Kind> {
    let name = part.channels[channel].display_name();
    let (rule, why) = by_default(part, channel);
    Some(match rule {
        _ if matches!(part.channels[channel].samples, Samples::Uint(_)) => Kind::Codes,
        Rule::Keep if why.contains("mask") => return None,
        Rule::Nearest if is_code(part, channel) => Kind::Codes,
        Rule::Fill if is_alpha(&name) => Kind::Alpha,
        Rule::Fill if is_light(&name) && is_colour(part, channel) => Kind::Colour,
        _ => Kind::Data,
    })
}

/// Which place of its group a component takes; nothing for one that stands alone.
fn place(name: &str, kind: Kind) -> Option<usize> {
    const COLOURS: [[&str; 2]; 3] = [["r", "red"], ["g", "green"], ["b", "blue"]];
    const LUMINANCE: [&str; 3] = ["y", "ry", "by"];
    const AXES: [&str; 3] = ["x", "y", "z"];
    let component = Name::new(name).component.to_ascii_lowercase();
    let colour = || COLOURS.iter().position(|names| names.contains(&component.as_str()));
    match kind {
        Kind::Colour => {
            colour().or_else(|| LUMINANCE.iter().position(|&name| name == component).map(|at| at + 3))
        }
        Kind::Data => AXES.iter().position(|&name| name == component).or_else(colour),
        Kind::Alpha | Kind::Codes => None,
    }
}

fn of_part(reference: &Frame, test: &Frame, parts: (usize, usize), pairing: &mut Pairing) {
    let (part, other) = (&reference.parts[parts.0], &test.parts[parts.1]);
    // Per group: layer, kind, and its channels with their places.
    let mut found: Vec<(Group, Vec<usize>)> = Vec::new();
    for (index, channel) in part.channels.iter().enumerate() {
        let Some(kind) = kind_of(part, index) else { continue };
        let Some(at) = other.channels.iter().position(|other| other.name == channel.name) else {
            pairing.missing.push(channel_label(reference, parts.0, index));
            continue;
        };
        let name = channel.display_name();
        let layer = Name::new(&name).layer;
        let place = place(&name, kind).filter(|_| kind != Kind::Data || !layer.is_empty());
        let with_others = place.and_then(|place| {
            let fits = |(group, places): &(Group, Vec<usize>)| {
                group.kind == kind
                    && group.layer == layer
                    && places.iter().all(|&other| other != place && (other < 3) == (place < 3))
            };
            Some((found.iter_mut().find(|group| fits(group))?, place))
        });
        if let Some(((group, places), place)) = with_others {
            let before = places.iter().filter(|&&other| other < place).count();
            group.channels.insert(before, (index, at));
            places.insert(before, place);
        } else {
            let group = Group { parts, layer: layer.to_owned(), kind, channels: vec![(index, at)] };
            found.push((group, vec![place.unwrap_or(usize::MAX)]));
        }
    }
    for (index, channel) in other.channels.iter().enumerate() {
        let known = part.channels.iter().any(|known| known.name == channel.name);
        if !known && kind_of(other, index).is_some() {
            pairing.extra.push(channel_label(test, parts.1, index));
        }
    }
    found.sort_by_key(|(group, _)| (!group.layer.is_empty(), group.kind));
    pairing.groups.extend(found.into_iter().map(|(group, _)| group));
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::testing::{float, frame, named, part, uint, window};

    fn names(frame: &Frame, pairing: &Pairing) -> Vec<(Kind, String)> {
        let name = |group: &Group| {
            let part = &frame.parts[group.parts.0];
            let names = group.channels.iter().map(|&(channel, _)| part.channels[channel].display_name());
            (group.kind, names.collect::<Vec<_>>().join(" "))
        };
        pairing.groups.iter().map(name).collect()
    }

    #[test]
    fn colours_and_axes_come_together_in_their_order() {
        let window = window(0, 0, 1, 1);
        let all = [
            "A",
            "B",
            "G",
            "R",
            "N.X",
            "N.Y",
            "N.Z",
            "Z",
            "mask",
            "spec.B",
            "spec.G",
            "spec.R",
            "Y",
            "Tangent.X",
            "Tangent.Y",
            "Tangent.Z",
        ];
        let mut channels: Vec<_> = all.iter().map(|name| float(name, &[0.0])).collect();
        channels.push(uint("objectId", &[1]));
        let one = frame(vec![part(window, channels)]);
        let pairing = pair(&one, &one);
        let expected = [
            (Kind::Colour, "R G B"),
            (Kind::Colour, "Y"),
            (Kind::Alpha, "A"),
            (Kind::Data, "Z"),
            (Kind::Codes, "objectId"),
            (Kind::Colour, "spec.R spec.G spec.B"),
            (Kind::Data, "N.X N.Y N.Z"),
            (Kind::Data, "Tangent.X Tangent.Y Tangent.Z"),
        ];
        assert_eq!(names(&one, &pairing), expected.map(|(kind, name)| (kind, name.to_owned())));
        assert!(pairing.missing.is_empty() && pairing.extra.is_empty());
    }

    #[test]
    fn the_colour_itself_stands_for_a_frame() {
        let window = window(0, 0, 1, 1);
        let of = |layers: &[&str]| {
            let name = |layer: &&str| ["R", "G", "B"].map(|component| format!("{layer}{component}"));
            let channels = layers.iter().flat_map(name).map(|name| float(&name, &[0.0])).collect();
            part(window, channels)
        };
        let main = |frame: Frame| {
            let pairing = pair(&frame, &frame);
            let group = &pairing.groups[pairing.main(&frame).unwrap()];
            (group.parts.0, group.layer.clone())
        };
        let one = |layers: &[&str]| main(frame(vec![of(layers)])).1;
        assert_eq!(one(&["ViewLayer.AO.", "ViewLayer.Combined."]), "ViewLayer.Combined");
        assert_eq!(one(&["albedo.", "diffuse.", "specular."]), "diffuse");
        assert_eq!(one(&["beauty.", ""]), "");
        let parts = frame(["albedo", "rgba"].map(|name| named(name, "", of(&[""]))).into());
        assert_eq!(main(parts), (1, String::new()));
        let data = frame(vec![part(window, vec![float("N.X", &[0.5]), uint("id", &[1])])]);
        assert_eq!(main(data).1, "N");
    }

    #[test]
    fn what_has_no_partner_is_named() {
        let window = window(0, 0, 1, 1);
        let of = |names: &[&str]| part(window, names.iter().map(|name| float(name, &[0.0])).collect());
        let reference = frame(vec![of(&["R", "G", "A"])]);
        let test = frame(vec![of(&["R", "G", "Z", "mask"])]);
        let pairing = pair(&reference, &test);
        assert_eq!(pairing.missing, ["channel A"]);
        assert_eq!(pairing.extra, ["channel Z"]);
    }

    #[test]
    fn parts_pair_by_name() {
        let window = window(0, 0, 1, 1);
        let of = |name: &str| named(name, "", part(window, vec![float("R", &[0.0])]));
        let pairing = pair(&frame(vec![of("a"), of("b"), of("c")]), &frame(vec![of("b"), of("a"), of("d")]));
        assert_eq!(pairing.groups.iter().map(|group| group.parts).collect::<Vec<_>>(), [(0, 1), (1, 0)]);
        assert_eq!((pairing.missing, pairing.extra), (vec!["part 2 (c)".into()], vec!["part 2 (d)".into()]));
    }
}
