//! Gradients that a renderer measured: layers `dx` and `dy` beside a layer, as `lacuna render --gradients` writes them.
//!
//! `dx.R` and `dy.R` are the derivatives of `R` per pixel, at pixel centres, x to the right and y down; those of `diffuse.R` are
//! `diffuse.dx.R` and `diffuse.dy.R`. Few filters use them (`cs-gradient`); they are samples then, and stay as they are.

use std::sync::Arc;

use lacuna_exr::Part;
use lacuna_filters::{Mask, Method, Plane};

use super::groups::{Group, Target};
use crate::channels::{Name, Rule};

/// The layers, along x and along y.
const LAYERS: [&str; 2] = ["dx", "dy"];

/// The channel of a layer that stands beside a channel: `dx.R` beside `R`, `diffuse.dx.R` beside `diffuse.R`.
pub fn sibling(part: &Part, channel: usize, layer: &str) -> Option<usize> {
    let full = part.channels.get(channel)?.display_name().into_owned();
    let name = Name::new(&full);
    let wanted = match name.layer {
        "" => format!("{layer}.{}", name.component),
        outer => format!("{outer}.{layer}.{}", name.component),
    };
    part.channels.iter().position(|channel| channel.display_name() == wanted.as_str())
}

/// The channels `dx` and `dy` of a channel, if there are both.
fn siblings(part: &Part, channel: usize) -> Option<[usize; 2]> {
    Some([sibling(part, channel, LAYERS[0])?, sibling(part, channel, LAYERS[1])?])
}

/// The channels of a part that are samples of a gradient for this method.
pub fn used(part: &Part, targets: &[Target], method: &Method) -> Vec<usize> {
    if !method.descriptor().takes.gradients {
        return Vec::new();
    }
    let filled = targets.iter().filter(|target| target.rule == Rule::Fill);
    filled.filter_map(|target| siblings(part, target.channel)).flatten().collect()
}

/// The gradients of each channel of a group that has both components, NaN where they were not measured; nothing if the method
/// uses none.
pub fn find(
    part: &Part,
    masks: &[Option<Arc<Mask>>],
    group: &Group,
    method: &Method,
) -> Vec<Option<[Plane; 2]>> {
    if !method.descriptor().takes.gradients {
        return Vec::new();
    }
    let plane = |channel: usize| {
        let mask = masks.get(channel)?.as_ref()?;
        let values = part.channels[channel].samples.to_floats()?.into_iter().zip(mask.as_slice());
        let values = values.map(|(value, &measured)| if measured { value } else { f32::NAN });
        Plane::new(mask.size(), values.collect()).ok()
    };
    let both = |&channel: &usize| {
        let [x, y] = siblings(part, channel)?;
        Some([plane(x)?, plane(y)?])
    };
    group.channels.iter().map(both).collect()
}
