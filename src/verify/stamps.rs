//! The attributes that `fill` adds: they agree with the mask that was found and name a filter that there is.

use lacuna_exr::Part;
use lacuna_filters::METHODS;

use super::{Difference, Pair};
use crate::mask::Source;
use crate::reconstruct::{DENSITY, Stamp};

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
    let expected = pair.masks.part_density(pair.index).unwrap_or(1.0) as f32;
    match density(pair.filled) {
        Some(found) if found.to_bits() == expected.to_bits() => {}
        Some(found) => add(format!("the attribute {DENSITY} is {found}, but the mask's is {expected}")),
        None => add(format!("the attribute {DENSITY} is not there")),
    }
    if !is_there(pair, &stamp.mask) {
        let found = &pair.masks.origin;
        add(format!("the attribute lacuna/mask names '{}', which is not there; found: {found}", stamp.mask));
    }
    differences
}

/// The density that a part claims.
pub fn density(part: &Part) -> Option<f32> {
    let attribute = part.attributes.get(DENSITY).filter(|attribute| attribute.kind == b"float")?;
    Some(f32::from_le_bytes(attribute.value.as_slice().try_into().ok()?))
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
