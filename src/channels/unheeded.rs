//! What `--channels` asks for in vain, told to whoever wrote it.

use super::{Choice, INCOMPLETE, Override, Rule};
use crate::frame::{Frame, Samples};
use crate::mask::Masks;

/// One line for each override that does nothing in this frame, or not what it says; `choices` are those that
/// [`super::choose`] made with them.
pub fn unheeded(
    frame: &Frame,
    masks: &Masks,
    overrides: &[Override],
    choices: &[Vec<Choice>],
) -> Vec<String> {
    overrides.iter().enumerate().filter_map(|(at, _)| reason(frame, masks, overrides, choices, at)).collect()
}

fn reason(
    frame: &Frame,
    masks: &Masks,
    overrides: &[Override],
    choices: &[Vec<Choice>],
    at: usize,
) -> Option<String> {
    let asked = &overrides[at];
    let (mut matched, mut taken, mut masked) = (0, 0, 0);
    let (mut alone, mut whole) = (Vec::new(), Vec::new());
    for (index, (part, choices)) in frame.parts.iter().zip(choices).enumerate() {
        for (number, (channel, choice)) in part.channels.iter().zip(choices).enumerate() {
            let name = channel.display_name();
            if !asked.matches(&name) {
                continue;
            }
            matched += 1;
            if masks.is_mask_channel(index, number) {
                masked += 1;
            } else if overrides[..at].iter().any(|other| other.matches(&name)) {
                taken += 1;
            } else if asked.rule == Rule::Normal && choice.why.ends_with(INCOMPLETE) {
                alone.push(name.into_owned());
            } else if asked.rule != choice.rule && matches!(channel.samples, Samples::Uint(_)) {
                whole.push(name.into_owned());
            }
        }
    }
    let why = if matched == 0 {
        "no channel matches".into()
    } else if masked == matched && asked.rule != Rule::Keep {
        "the sampling mask in use is always kept".into()
    } else if taken == matched {
        "an earlier --channels matches the same channels".into()
    } else if !alone.is_empty() {
        format!("{}: {INCOMPLETE}, so it is filled as it is", alone.join(", "))
    } else if !whole.is_empty() {
        format!("{} has whole numbers, which are copied from the nearest pixel", whole.join(", "))
    } else {
        return None;
    };
    Some(format!("--channels '{asked}': {why}"))
}
