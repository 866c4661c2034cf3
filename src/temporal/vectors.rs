//! Motion by vectors in the files, whatever their convention: renderers count pixels or parts of the image, to the frame before or to the next one, y up
//! or down.

use lacuna_exr::Part;
use lacuna_filters::Size;

use super::neighbours::FrameRef;
use super::{Neighbour, fit};
use crate::channels::{self, Name, part_label};

/// What components of a vector may be counted in.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Unit {
    Pixels,
    /// Parts of the width and of the height.
    Image,
    /// The same, from -1 to 1.
    Device,
}

/// Two channels that are vectors.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Layer {
    /// The part that they stand in.
    pub part: usize,
    /// What the log calls that part, if it is another one than that whose samples go by them.
    of: String,
    /// Their full names: across and down.
    pub names: [String; 2],
}

/// A convention.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Reading {
    unit: Unit,
    /// Whether vectors lead to the next frame, not to the one before.
    pub next: bool,
    y_up: bool,
}

impl Reading {
    /// All of them, the most usual first.
    pub fn all() -> Vec<Self> {
        let mut all = Vec::new();
        for unit in [Unit::Pixels, Unit::Image, Unit::Device] {
            for next in [true, false] {
                for y_up in [false, true] {
                    all.push(Self { unit, next, y_up });
                }
            }
        }
        all
    }

    /// What it is, in words: `vectors Vector.X and Vector.Y in pixels to the next frame, y up`.
    pub fn name(self, Layer { of, names: [across, down], .. }: &Layer) -> String {
        let unit = match self.unit {
            Unit::Pixels => "in pixels",
            Unit::Image => "in parts of the image",
            Unit::Device => "in device coordinates",
        };
        let to = if self.next { "to the next frame" } else { "to the frame before" };
        let y = if self.y_up { "y up" } else { "y down" };
        format!("vectors {across} and {down}{of} {unit} {to}, {y}")
    }

    /// How many pixels down and across one of either component leads in a frame's time, in an image of that size: that of the display window,
    /// whatever is cropped.
    pub fn scale(self, size: Size) -> [f32; 2] {
        let unit = |length: usize| match self.unit {
            Unit::Pixels => 1.0,
            Unit::Image => length as f32,
            Unit::Device => 0.5 * length as f32,
        };
        let time = if self.next { 1.0 } else { -1.0 };
        [time * unit(size.height) * if self.y_up { -1.0 } else { 1.0 }, time * unit(size.width)]
    }
}

/// The vectors of a layer as they are in the file, down and across, for the pixels of a part.
pub fn raw(source: FrameRef<'_>, part: usize, layer: &Layer) -> Option<Vec<[f32; 2]>> {
    let frame = source.frame;
    let own = frame.parts.get(layer.part)?;
    if own.data_window != frame.parts.get(part)?.data_window {
        return None;
    }
    let plane = |name: &String| source.floats(layer.part, channel(own, name)?);
    let (across, down) = (plane(&layer.names[0])?, plane(&layer.names[1])?);
    Some(down.into_iter().zip(across).map(|(down, across)| [down, across]).collect())
}

/// Where a part has a channel of this name.
pub fn channel(part: &Part, name: &str) -> Option<usize> {
    part.channels.iter().position(|channel| channel.display_name() == name)
}

/// The layers of vectors by which the samples of a neighbour's part may go and that were measured: its own, or those of the first part of the
/// same pixels that has some.
pub fn layers(neighbour: &Neighbour, part: usize) -> Vec<Layer> {
    let mut all = fit::alike(&neighbour.frame, part).map(|other| {
        let of = if other == part { String::new() } else { part_label(&neighbour.frame, other) };
        let of = if of.is_empty() { of } else { format!(" of {of}") };
        let layer = |names| Layer { part: other, of: of.clone(), names };
        pairs(neighbour, other).into_iter().map(layer).collect::<Vec<_>>()
    });
    all.find(|layers| !layers.is_empty()).unwrap_or_default()
}

/// Why the samples of a neighbour's part go by no vectors.
pub fn why_none(neighbour: &Neighbour, part: usize) -> &'static str {
    let layers = layers(neighbour, part);
    let finite = |layer: &Layer| {
        let own = &neighbour.frame.parts[layer.part];
        let mask = channel(own, &layer.names[0]).and_then(|at| neighbour.masks.get(layer.part, at));
        let (Some(mask), Some(raw)) = (mask, raw(neighbour.source(), part, layer)) else { return false };
        let known = raw.iter().zip(mask.as_slice()).filter(|(_, flag)| **flag);
        known.into_iter().any(|(vector, _)| vector.iter().all(|v| v.is_finite()))
    };
    match &*layers {
        [] => "it has no motion vectors that were measured",
        all if !all.iter().any(finite) => "none of its motion vectors is finite",
        _ => "it has no motion vectors that the samples agree with better than with no motion",
    }
}

/// The full names of the vectors of a part.
fn pairs(neighbour: &Neighbour, part: usize) -> Vec<[String; 2]> {
    let own = &neighbour.frame.parts[part];
    let name = |at: usize| own.channels[at].display_name().into_owned();
    let axis = |at: usize| channels::motion_axis(own, at).filter(|_| neighbour.masks.get(part, at).is_some());
    let layer = |at: usize| Name::new(&name(at)).layer.to_owned();
    // In a layer of two motions, `Z` and `W` are the second one.
    let second = |at: usize| ["z", "w"].contains(&Name::new(&name(at).to_ascii_lowercase()).component);
    let of = |wanted: usize| (0..own.channels.len()).filter(move |&at| axis(at) == Some(wanted));
    let pair = |x: usize| {
        let y = of(1).find(|&y| layer(y) == layer(x) && second(y) == second(x))?;
        Some([name(x), name(y)])
    };
    of(0).filter_map(pair).collect()
}
