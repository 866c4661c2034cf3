//! Motion by vectors in the file, whatever their convention: renderers count pixels or parts of the image, to the frame before or to the next one, y up
//! or down. Every convention is tried, and the one by which the frame agrees with its neighbour's samples most is taken.

use lacuna_filters::Size;

use super::Neighbour;
use crate::channels;

/// What components of a vector may be counted in.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Unit {
    Pixels,
    /// Parts of the width and of the height.
    Image,
    /// The same, from -1 to 1.
    Device,
}

/// A convention, with the channels that it is of.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Way {
    /// Across and down.
    channels: [usize; 2],
    unit: Unit,
    /// From the neighbour towards the frame: with the vector, or against it.
    along: bool,
    y_up: bool,
}

impl Way {
    /// What it is, in words: `vectors Vector.X, Vector.Y in pixels, y up`.
    pub fn name(&self, neighbour: &Neighbour, part: usize) -> String {
        let name = |at: usize| neighbour.frame.parts[part].channels[at].display_name().into_owned();
        let unit = match self.unit {
            Unit::Pixels => "in pixels",
            Unit::Image => "in parts of the image",
            Unit::Device => "in device coordinates",
        };
        // Seen from the neighbour, the frame is what lies before or after it.
        let to =
            if (neighbour.offset > 0) == self.along { "to the frame before" } else { "to the next frame" };
        let y = if self.y_up { "y up" } else { "y down" };
        format!("vectors {} and {} {unit} {to}, {y}", name(self.channels[0]), name(self.channels[1]))
    }

    /// Where each pixel of a neighbour's part lies in the frame: as many steps as it is frames away.
    pub fn places(&self, neighbour: &Neighbour, part: usize) -> Option<Vec<[f32; 2]>> {
        let own = &neighbour.frame.parts[part];
        let size = own.size();
        let plane = |at: usize| own.channels.get(at)?.samples.to_floats();
        let (across, down) = (plane(self.channels[0])?, plane(self.channels[1])?);
        let steps = neighbour.offset.unsigned_abs() as f32 * if self.along { 1.0 } else { -1.0 };
        let unit = |length: usize| match self.unit {
            Unit::Pixels => 1.0,
            Unit::Image => length as f32,
            Unit::Device => 0.5 * length as f32,
        };
        let Size { height, width } = size;
        let scale = [steps * unit(height) * if self.y_up { -1.0 } else { 1.0 }, steps * unit(width)];
        let place = |at: usize| {
            [(at / width) as f32 + scale[0] * down[at], (at % width) as f32 + scale[1] * across[at]]
        };
        Some((0..size.pixels()).map(place).collect())
    }
}

/// All conventions of all vectors of a neighbour's part that were measured.
pub fn ways(neighbour: &Neighbour, part: usize) -> Vec<Way> {
    let own = &neighbour.frame.parts[part];
    let axis = |at: usize| channels::motion_axis(own, at).filter(|_| neighbour.masks.get(part, at).is_some());
    let layer = |at: usize| channels::Name::new(&own.channels[at].display_name()).layer.to_owned();
    let mut all = Vec::new();
    let across: Vec<usize> = (0..own.channels.len()).filter(|&at| axis(at) == Some(0)).collect();
    let down: Vec<usize> = (0..own.channels.len()).filter(|&at| axis(at) == Some(1)).collect();
    for &x in &across {
        // In a layer of two motions, `Z` and `W` are the second one.
        let second = |at: usize| {
            let name = own.channels[at].display_name().to_ascii_lowercase();
            ["z", "w"].contains(&channels::Name::new(&name).component)
        };
        let partner = down.iter().find(|&&y| layer(y) == layer(x) && second(y) == second(x));
        let Some(&y) = partner else { continue };
        for unit in [Unit::Pixels, Unit::Image, Unit::Device] {
            for along in [true, false] {
                for y_up in [true, false] {
                    all.push(Way { channels: [x, y], unit, along, y_up });
                }
            }
        }
    }
    all
}
