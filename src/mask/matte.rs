//! Whether what looks like a sampling mask is an ordinary matte beside complete colour, and whether flags are scattered.

use std::collections::BTreeMap;

use lacuna_core::Size;
use lacuna_exr::{Channel, Frame, Part};
use lacuna_filters::Mask;

use super::find::{at_least_half, finite};
use super::{Masks, flags};
use crate::channels::{self, Name, Rule, is_alpha, is_light};

/// The least part of the pixels outside a matte that has values of its own: splats of measured pixels into their neighbours have less.
const COMPLETE: f64 = 0.1;
/// The least changes along rows or columns of scattered flags, over those that a random pattern of that density has.
const SCATTERED: f64 = 0.25;
/// The least part of missing pixels that makes a pattern; fewer are faults of a shader.
const PATTERN: f64 = 0.05;

/// Whether the masks are mattes: regions outside of which all colour has values, in a frame that lacuna did not write.
pub fn is_matte(frame: &Frame, masks: &Masks) -> bool {
    if is_ours(frame) || masks.of_parts().any(is_scattered) {
        return false;
    }
    let mut colour = Vec::new();
    for (index, part) in frame.parts.iter().enumerate() {
        for (number, channel) in lights(part) {
            let mask = masks.get(index, number).filter(|mask| !mask.is_full());
            colour.extend(mask.map(|mask| (layer_of(channel).is_empty(), is_complete(part, channel, mask))));
        }
    }
    // Layers may well be complete beside sparse colour, which they are to guide.
    let main = colour.iter().any(|(main, _)| *main);
    let counts = |is_main: bool| is_main || !main;
    colour.retain(|(is_main, _)| counts(*is_main));
    let mut lit = frame.parts.iter().flat_map(lit).filter(|(layer, _)| counts(layer.is_empty()));
    !colour.is_empty()
        && colour.iter().all(|(_, complete)| *complete)
        && !lit.any(|(_, mask)| is_scattered(&mask))
}

/// Whether the masks leave out regions of a frame that says nothing of them, as a matte does that lies over black.
pub fn may_be_mattes(frame: &Frame, masks: &Masks) -> bool {
    let regions = || masks.of_parts().filter(|mask| !mask.is_full());
    !is_ours(frame)
        && regions().next().is_some()
        && !regions().any(is_spread)
        // A pixel that is not finite was not rendered.
        && finite(frame).is_ok_and(|masks| masks.is_full())
}

/// Whether masks that may be mattes are those of an element over black: alpha says the same as each of them.
pub fn is_element(frame: &Frame, masks: &Masks) -> bool {
    let channels = frame.parts.iter().flat_map(|part| &part.channels);
    let alphas: Vec<_> = channels
        .filter(|channel| is_alpha(&channel.display_name()))
        .map(|channel| flags(&channel.samples, at_least_half))
        .collect();
    let agrees = |mask: &Mask| mask.is_full() || alphas.iter().any(|alpha| alpha == mask.as_slice());
    may_be_mattes(frame, masks) && masks.of_parts().all(agrees)
}

/// Whether lacuna wrote the frame, or another program attributes for it.
fn is_ours(frame: &Frame) -> bool {
    let mut attributes = frame.parts.iter().flat_map(|part| part.attributes.iter());
    attributes.any(|attribute| attribute.name.starts_with(b"lacuna/"))
}

fn layer_of(channel: &Channel) -> String {
    Name::new(&channel.display_name()).layer.into()
}

/// The channels that are light and would be filled.
fn lights(part: &Part) -> impl Iterator<Item = (usize, &Channel)> {
    let is = |number: usize, channel: &Channel| {
        channels::by_default(part, number).0 == Rule::Fill && is_light(&channel.display_name())
    };
    part.channels.iter().enumerate().filter(move |(number, channel)| is(*number, channel))
}

/// The pixels in which any light is not 0, layer by layer.
pub fn lit(part: &Part) -> Vec<(String, Mask)> {
    let mut layers: BTreeMap<String, Vec<bool>> = BTreeMap::new();
    for (_, channel) in lights(part) {
        let own = flags(&channel.samples, is_set(part, channel));
        let all = layers.entry(layer_of(channel)).or_insert_with(|| vec![false; own.len()]);
        all.iter_mut().zip(own).for_each(|(all, own)| *all |= own);
    }
    layers
        .into_iter()
        .filter_map(|(layer, flags)| Some((layer, Mask::new(part.size(), flags).ok()?)))
        .collect()
}

/// Whether a value of a channel is more than what compression may have made of 0.
fn is_set(part: &Part, channel: &Channel) -> impl Fn(f64) -> bool + Sync + use<> {
    let zero = f64::from(part.compression.zero_within(channel.samples.kind()));
    move |value| value.abs() > zero
}

/// Whether many missing pixels have values, and not all the same one.
fn is_complete(part: &Part, channel: &Channel, mask: &Mask) -> bool {
    let is_set = is_set(part, channel);
    let values = channel.samples.as_f32();
    let missing = values.iter().zip(mask.as_slice()).filter(|(_, measured)| !**measured);
    let set: Vec<f32> = missing
        .map(|(value, _)| *value)
        .filter(|value| value.is_finite() && is_set((*value).into()))
        .collect();
    let count = mask.as_slice().len() - mask.count();
    set.iter().any(|value| Some(value) != set.first()) && set.len() as f64 >= COMPLETE * count as f64
}

/// Whether missing pixels are many and spread among measured ones, as no region is.
pub fn is_scattered(mask: &Mask) -> bool {
    1.0 - mask.density() >= PATTERN && is_spread(mask)
}

/// Whether missing pixels are spread among measured ones.
fn is_spread(mask: &Mask) -> bool {
    let Size { width, height } = mask.size();
    let flags = mask.as_slice();
    let density = mask.density();
    let random = 2.0 * density * (1.0 - density);
    let rows = flags.chunks_exact(width.max(1));
    let along: usize = rows.map(|row| row.windows(2).filter(|pair| pair[0] != pair[1]).count()).sum();
    let across = flags.iter().zip(flags.iter().skip(width)).filter(|(a, b)| a != b).count();
    let often = |changes: usize, pairs: usize| changes as f64 > SCATTERED * random * pairs as f64;
    often(along, height * width.saturating_sub(1)) || often(across, width * height.saturating_sub(1))
}
