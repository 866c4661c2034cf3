//! Masks without a measured pixel: that they are no masks to make, and why one has none, for messages.

use lacuna_exr::{Frame, Part};
use lacuna_filters::Mask;

use super::find::told_by;
use super::{Masks, Source};
use crate::channels::{is_alpha, non_finite, visible};

/// Refuses a mask by which nothing would be rendered.
///
/// # Errors
/// What is wrong and the way out.
pub fn check_any(mask: &Mask) -> Result<(), String> {
    if mask.count() > 0 {
        return Ok(());
    }
    let size = mask.size();
    Err(format!(
        "none of {} x {} pixels would be measured: take a higher --density or another mask",
        size.width, size.height
    ))
}

/// What a message about a part's empty mask ends with.
pub fn why_empty(frame: &Frame, masks: &Masks, index: usize) -> String {
    let Some(part) = frame.parts.get(index) else { return String::new() };
    let hopeless = hopeless(part, masks, index);
    if !hopeless.is_empty() {
        let names: Vec<_> = hopeless.iter().map(|&at| part.channels[at].display_name()).collect();
        let names: Vec<_> = names.iter().map(|name| visible(name)).collect();
        return format!(
            "as no value of {} is finite: render the frame again, or name another mask with --mask",
            names.join(", ")
        );
    }
    if masks.origin == Source::Finite.to_string() {
        return "as every pixel has a value that is not finite: name another mask with --mask".into();
    }
    let matte = if masks.droppable(index).is_empty() {
        ""
    } else {
        " (nan, if it is a matte beside complete colour)"
    };
    format!("so nothing says what the image is: check --mask{matte}")
}

/// The channels that the mask is made of, where they hold nothing that could tell a measured pixel.
fn hopeless(part: &Part, masks: &Masks, index: usize) -> Vec<usize> {
    let all = 0..part.channels.len();
    if masks.origin == Source::Finite.to_string() {
        // One of them is enough, as a pixel has to be finite in all.
        let tells_none = |at: &usize| told_by(part, *at).is_some_and(|flags| !flags.contains(&true));
        return all.filter(tells_none).collect();
    }
    let by_alpha = masks.origin == Source::Alpha.to_string();
    let is_source = |at: &usize| {
        masks.is_mask_channel(index, *at) || by_alpha && is_alpha(&part.channels[*at].display_name())
    };
    let sources: Vec<usize> = all.filter(is_source).collect();
    let tells_none = |at: &usize| {
        let samples = &part.channels[*at].samples;
        non_finite(samples) == samples.len()
    };
    if sources.iter().all(tells_none) { sources } else { Vec::new() }
}
