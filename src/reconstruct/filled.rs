//! Frames that were filled already: what was done to them, and how they become sparse again.

use half::f16;
use lacuna_exr::{Channel, Frame, Part, Samples};
use lacuna_filters::{Doubt, Fit, Mask};

use super::prefixed;
use super::stamp::{FILTER, Stamp, error_channel};
use crate::channels::{Choice, Name, Rule, dense, is_albedo, is_light, part_label};
use crate::guides;
use crate::mask::{Masks, claimed_density};

/// Whether a part of a frame says that its measured pixels were smoothed.
pub fn was_smoothed(frame: &Frame) -> bool {
    let smoothed = |part: &Part| Stamp::read(&part.attributes).is_some_and(|stamp| stamp.says_smoothed());
    frame.parts.iter().any(smoothed)
}

/// Whether a part says that it was enlarged.
pub fn is_enlarged(part: &Part) -> bool {
    Stamp::read(&part.attributes).is_some_and(|stamp| stamp.setting("upscale").is_some())
}

/// What made a part, for messages: `filled by auto`, `enlarged by ss`; nothing if nothing here did.
pub fn made_by(part: &Part) -> Option<String> {
    let filter = part.attributes.text(FILTER)?;
    Some(format!("{} by {filter}", if is_enlarged(part) { "enlarged" } else { "filled" }))
}

/// What to say of a frame in which every measured value is 0 and missing ones are not, as a wrong mask leaves it. A black frame may have
/// guides that are complete: only light tells.
pub fn wrong_mask(frame: &Frame, masks: &Masks, choices: &[Vec<Choice>]) -> Option<String> {
    let mut found: Option<Doubt> = None;
    for (index, (part, choices)) in frame.parts.iter().zip(choices).enumerate() {
        let dense = dense(part);
        for (number, (channel, choice)) in part.channels.iter().zip(choices).enumerate() {
            let name = channel.display_name();
            let kept = choice.rule == Rule::Keep || dense.iter().any(|listed| *listed == *name);
            let tells = choice.rule == Rule::Fill && is_light(&name) && !is_albedo(&name);
            let Some(mask) = masks.get(index, number).filter(|mask| !kept && !mask.is_full()) else {
                continue;
            };
            let values = channel.samples.as_f32();
            let zero = part.compression.zero_within(channel.samples.kind());
            match mask.fit(&values, zero) {
                // A measured value that is not 0 anywhere ends the doubt.
                Fit::Right => return None,
                Fit::Doubtful(doubt) if tells && found.is_none_or(|before| before.held < doubt.held) => {
                    found = Some(doubt);
                }
                _ => {}
            }
        }
    }
    found.map(|doubt| doubt.to_string())
}

/// Makes the missing pixels of a filled frame blank, so that none is taken for measured, nor a channel for complete.
pub fn blank(frame: &mut Frame, masks: &Masks, choices: &[Vec<Choice>]) {
    let made = guides::made(frame, choices);
    for (index, (part, made)) in frame.parts.iter_mut().zip(made).enumerate() {
        for (number, channel) in part.channels.iter_mut().enumerate() {
            let Some(mask) = masks.get(index, number).filter(|_| made[number]) else { continue };
            match &mut channel.samples {
                Samples::Half(values) => zero(values, mask, f16::ZERO),
                Samples::Float(values) => zero(values, mask, 0.0),
                Samples::Uint(values) => zero(values, mask, 0),
            }
        }
    }
}

/// Removes the estimated errors that a fill wrote into these parts: they are no light, and not those of what is made of them next. Returns what to
/// tell.
pub fn drop_errors(frame: &mut Frame, of: impl Fn(usize, &Part) -> bool) -> Vec<String> {
    let labels: Vec<_> = (0..frame.parts.len()).map(|index| part_label(frame, index)).collect();
    let parts = frame.parts.iter_mut().zip(labels).enumerate().filter(|(index, (part, _))| of(*index, part));
    parts.flat_map(|(_, (part, label))| prefixed(&label, errors_of(part).into_iter().collect())).collect()
}

fn errors_of(part: &mut Part) -> Option<String> {
    let component = error_channel(part)?;
    let density = claimed_density(part).map_or(1.0, f64::from);
    // A channel of the renderer may have that name; errors are 0 at measured pixels, but for a few that were not finite.
    let is_error = |channel: &Channel| match &channel.samples {
        Samples::Float(values) if Name::new(&channel.display_name()).component == component => {
            let zeros = values.iter().filter(|value| **value == 0.0).count() as f64;
            values.iter().all(|value| *value >= 0.0) && zeros >= 0.5 * density * values.len() as f64
        }
        _ => false,
    };
    let (errors, other): (Vec<_>, Vec<_>) =
        std::mem::take(&mut part.channels).into_iter().partition(is_error);
    part.channels = other;
    let names: Vec<_> = errors.iter().map(Channel::display_name).collect();
    (!names.is_empty())
        .then(|| format!("dropped {}: errors that the fill before was estimated to have", names.join(", ")))
}

fn zero<T: Copy>(values: &mut [T], mask: &Mask, zero: T) {
    let missing = values.iter_mut().zip(mask.as_slice()).filter(|(_, measured)| !**measured);
    missing.for_each(|(value, _)| *value = zero);
}
