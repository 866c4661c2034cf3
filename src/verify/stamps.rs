//! The attributes that `fill` adds: they agree with the mask that was found and name a filter that there is.

use lacuna_filters::METHODS;

use super::{Difference, Pair};
use crate::channels::{Name, Rule};
use crate::mask::Source;
use crate::mask::claimed_density;
use crate::reconstruct::{DENSITY, Stamp, error_channel, estimate, value};

/// What the attributes of a part say that is not so. Attributes that the sparse part had already are not `fill`'s.
pub fn compare(pair: &Pair<'_>) -> Vec<Difference> {
    let Some(stamp) = Stamp::read(&pair.filled.attributes) else { return Vec::new() };
    if Stamp::read(&pair.sparse.attributes).is_some_and(|before| before == stamp) {
        return Vec::new();
    }
    let mut differences = Vec::new();
    let mut add = |what: String| differences.push(pair.differ(None, None, what));
    if METHODS.iter().all(|method| method.name != stamp.filter) {
        add(format!("the attribute lacuna/filter is '{}', which is no filter", stamp.filter));
    }
    if stamp.says_smoothed() && !stamp.smooths() {
        add(format!(
            "the attribute lacuna/settings says that measured pixels were smoothed, but {} as it is set there keeps them",
            stamp.filter
        ));
    }
    let expected = pair.masks.part_density(pair.index).unwrap_or(1.0) as f32;
    match claimed_density(pair.filled) {
        Some(found) if found.to_bits() == expected.to_bits() => {}
        Some(found) => add(format!("the attribute {DENSITY} is {found}, but the mask's is {expected}")),
        None => add(format!("the attribute {DENSITY} is not there")),
    }
    if !is_there(pair, &stamp.mask) {
        let found = &pair.masks.origin;
        add(format!("the attribute lacuna/mask names '{}', which is not there; found: {found}", stamp.mask));
    }
    let told = pair.filled.attributes.text(estimate::ATTRIBUTE);
    let peak = stamp.setting("peak").and_then(|peak| peak.parse().ok()).unwrap_or(1.0);
    if let Some(group) = told.as_deref().and_then(|line| estimate::contradiction(line, peak)) {
        add(format!("the attribute {} contradicts itself: '{group}'", estimate::ATTRIBUTE));
    }
    differences
}

/// The channels of estimated errors that the fill added, where they cannot be errors: negative, not finite, or not 0 at pixels that every
/// filled channel of their layer measured.
pub fn compare_errors(pair: &Pair<'_>) -> Vec<Difference> {
    let Some(component) = error_channel(pair.filled) else { return Vec::new() };
    let mut differences = Vec::new();
    for channel in &pair.filled.channels {
        let name = channel.display_name();
        let own = Name::new(&name);
        let is_new = !pair.sparse.channels.iter().any(|other| other.name == channel.name);
        let Some(errors) = channel.samples.to_floats().filter(|_| is_new && own.component == component)
        else {
            continue;
        };
        // Smoothed pixels are known no better than others, and those that count no sample are missing.
        let mut measured = vec![!pair.claims.smoothed; errors.len()];
        for (at, sparse) in pair.sparse.channels.iter().enumerate() {
            let filled = pair.choices.get(at).is_some_and(|choice| choice.rule == Rule::Fill);
            if !filled || Name::new(&sparse.display_name()).layer != own.layer {
                continue;
            }
            let Some(mask) = pair.masks.get(pair.index, at) else { continue };
            let flags = mask.as_slice().iter().enumerate();
            let known = flags.map(|(at, flag)| *flag && value(&sparse.samples, at).is_finite());
            measured.iter_mut().zip(known).for_each(|(all, own)| *all &= own);
        }
        let wrong = |at: &usize| {
            let error = errors[*at];
            !(error.is_finite() && error >= 0.0) || error != 0.0 && measured[*at]
        };
        let wrong: Vec<usize> = (0..errors.len()).filter(wrong).collect();
        let what = "an estimated error is negative, not finite, or not 0 at a measured pixel";
        differences.extend(pair.first_of(&name, what, &wrong));
    }
    differences
}

/// Whether a mask of that name was found, or could have been: another mask may have been given to verify with.
fn is_there(pair: &Pair<'_>, mask: &str) -> bool {
    let channel = |name: &str| pair.sparse.channels.iter().any(|channel| channel.display_name() == name);
    if mask == pair.masks.origin || channel(mask) {
        return true;
    }
    match mask.parse() {
        Ok(Source::Count { channel: name, .. }) => channel(&name),
        Ok(Source::File { .. }) => mask.starts_with("file:"),
        Ok(Source::Channel(_)) | Err(_) => false,
        Ok(Source::Auto | Source::Alpha | Source::Finite) => true,
    }
}
