//! Whether what looks like a sampling mask is an ordinary matte beside complete colour, and whether flags are scattered.

use lacuna_core::Size;
use lacuna_exr::{Frame, Samples};
use lacuna_filters::Mask;

use super::Masks;
use crate::channels::{self, Name, Rule, is_light};

/// The least part of the pixels outside a matte that has values of its own: splats of measured pixels into their neighbours have less.
const COMPLETE: f64 = 0.1;
/// The least changes along rows or columns of scattered flags, over those that a random pattern of that density has.
const SCATTERED: f64 = 0.25;
/// The least part of missing pixels that makes a pattern; fewer are faults of a shader.
const PATTERN: f64 = 0.05;

/// Whether the masks are mattes: regions outside of which all colour has values, in a frame that lacuna did not write.
pub fn is_matte(frame: &Frame, masks: &Masks) -> bool {
    let ours = |name: &[u8]| name.starts_with(b"lacuna/");
    let attributes = || frame.parts.iter().flat_map(|part| part.attributes.iter());
    // Compression with loss gives values to missing pixels, too.
    if attributes().any(|attribute| ours(&attribute.name))
        || !frame.parts.iter().all(|part| part.compression.is_lossless())
        || masks.all().any(|mask| is_scattered(mask))
    {
        return false;
    }
    let mut colour = Vec::new();
    for (index, part) in frame.parts.iter().enumerate() {
        for (number, channel) in part.channels.iter().enumerate() {
            let name = channel.display_name();
            let light = channels::by_default(part, number).0 == Rule::Fill && is_light(&name);
            let mask = masks.get(index, number).filter(|mask| light && !mask.is_full());
            colour.extend(mask.map(|mask| (Name::new(&name).layer.is_empty(), &channel.samples, &**mask)));
        }
    }
    // Layers may well be complete beside sparse colour, which they are to guide.
    let main = colour.iter().any(|(main, ..)| *main);
    colour.retain(|(is_main, ..)| *is_main || !main);
    !colour.is_empty() && colour.iter().all(|(_, samples, mask)| is_complete(samples, mask))
}

/// Whether many missing pixels have values, and not all the same one.
fn is_complete(samples: &Samples, mask: &Mask) -> bool {
    let values = samples.as_f32();
    let missing = || values.iter().zip(mask.as_slice()).filter(|(_, measured)| !**measured).map(|(v, _)| *v);
    let set = || missing().filter(|value| value.is_finite() && *value != 0.0);
    let first = set().next();
    let count = mask.as_slice().len() - mask.count();
    set().any(|value| Some(value) != first) && set().count() as f64 >= COMPLETE * count as f64
}

/// Whether missing pixels are many and spread among measured ones, as no region is.
pub fn is_scattered(mask: &Mask) -> bool {
    let Size { width, height } = mask.size();
    let flags = mask.as_slice();
    let density = mask.count() as f64 / flags.len().max(1) as f64;
    let random = 2.0 * density * (1.0 - density);
    let rows = flags.chunks_exact(width.max(1));
    let along: usize = rows.map(|row| row.windows(2).filter(|pair| pair[0] != pair[1]).count()).sum();
    let across = flags.iter().zip(flags.iter().skip(width)).filter(|(a, b)| a != b).count();
    let often = |changes: usize, pairs: usize| changes as f64 > SCATTERED * random * pairs as f64;
    let [along, across] =
        [(along, height * width.saturating_sub(1)), (across, width * height.saturating_sub(1))]
            .map(|(changes, pairs)| often(changes, pairs));
    1.0 - density >= PATTERN && (along || across)
}
