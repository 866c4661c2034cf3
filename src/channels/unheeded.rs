//! What `--channels` and the attribute `lacuna/dense` ask for in vain, told to whoever wrote it.

use lacuna_exr::{Frame, Part, Samples};

use super::{
    Choice, DENSE, DecidedBy, INCOMPLETE, Override, Rule, dense, is_mask_channel, part_label, visible,
};

/// One line for each override that does nothing in this frame, or not what it says, and for each list of complete channels with
/// names of none; `choices` are those that
/// [`super::choose`] made with them.
pub fn unheeded(
    frame: &Frame,
    mask_channels: &[Vec<usize>],
    overrides: &[Override],
    choices: &[Vec<Choice>],
) -> Vec<String> {
    let asked = (0..overrides.len()).filter_map(|at| reason(frame, mask_channels, overrides, choices, at));
    let listed = frame.parts.iter().enumerate().filter_map(|(index, part)| unknown(frame, index, part));
    asked.chain(listed).collect()
}

/// What the attribute [`DENSE`] of a part lists and is not there.
fn unknown(frame: &Frame, index: usize, part: &Part) -> Option<String> {
    let is = |name: &String| part.channels.iter().any(|channel| channel.display_name() == name.as_str());
    let names: Vec<String> =
        dense(part).iter().filter(|name| !is(name)).map(|name| visible(name).into_owned()).collect();
    let label = part_label(frame, index);
    let label = if label.is_empty() { label } else { format!("{label}: ") };
    (!names.is_empty())
        .then(|| format!("{label}the attribute {DENSE} lists {}, which is no channel here", names.join(", ")))
}

fn reason(
    frame: &Frame,
    mask_channels: &[Vec<usize>],
    overrides: &[Override],
    choices: &[Vec<Choice>],
    at: usize,
) -> Option<String> {
    let asked = &overrides[at];
    // A show's file has rules for channels of other frames.
    if asked.reason.is_some() {
        return None;
    }
    let (mut matched, mut taken, mut masked) = (0, 0, 0);
    let (mut alone, mut whole) = (Vec::new(), Vec::new());
    for (index, (part, choices)) in frame.parts.iter().zip(choices).enumerate() {
        for (number, (channel, choice)) in part.channels.iter().zip(choices).enumerate() {
            let name = channel.display_name();
            if !asked.matches(&name) {
                continue;
            }
            matched += 1;
            if is_mask_channel(mask_channels, index, number) {
                masked += 1;
            } else if overrides[..at].iter().any(|other| other.matches(&name)) {
                taken += 1;
            } else if asked.rule == Rule::Normal && choice.by == DecidedBy::IncompleteNormal {
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
