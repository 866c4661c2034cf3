//! Frames that were filled already, so that their missing pixels have values.

use lacuna_exr::{Frame, Part};

use super::{DENSITY, FILTER, Masks};
use crate::channels::{Rule, by_default};

/// The filter that filled the missing pixels of a frame already: its name stands in a part, and values stand at pixels that are missing.
pub fn filled_before(frame: &Frame, masks: &Masks) -> Option<String> {
    let mut parts = frame.parts.iter().enumerate();
    let filled = |(index, part): (usize, &Part)| {
        part.attributes.text(FILTER).filter(|_| values_at_missing(part, masks, index) == Some(true))
    };
    parts.find_map(filled)
}

/// The filter that filled a part, as far as masks, if there are any, do not say otherwise.
pub fn filled_by(part: &Part, masks: Option<&Masks>, index: usize) -> Option<String> {
    let filter = part.attributes.text(FILTER)?;
    let blank = masks.is_some_and(|masks| values_at_missing(part, masks, index) == Some(false));
    (!blank).then_some(filter)
}

/// Whether a channel that filling changes has a value at a missing pixel; nothing where none is missing.
fn values_at_missing(part: &Part, masks: &Masks, index: usize) -> Option<bool> {
    let mut any = None;
    for (number, channel) in part.channels.iter().enumerate() {
        let Some(mask) = masks.get(index, number).filter(|mask| !mask.is_full()) else { continue };
        if masks.is_mask_channel(index, number) || by_default(part, number).0 == Rule::Keep {
            continue;
        }
        let values = channel.samples.as_f32();
        let mut missing = values.iter().zip(mask.as_slice()).filter(|(_, measured)| !**measured);
        if missing.any(|(value, _)| value.is_finite() && *value != 0.0) {
            return Some(true);
        }
        any = Some(false);
    }
    any
}

/// The density that a part claims.
pub fn claimed_density(part: &Part) -> Option<f32> {
    let attribute = part.attributes.get(DENSITY).filter(|attribute| attribute.kind == b"float")?;
    Some(f32::from_le_bytes(attribute.value.as_slice().try_into().ok()?))
}
