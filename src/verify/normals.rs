//! The length of filled normals: that of the measured ones around them.

use std::sync::Arc;

use lacuna_exr::{Channel, Samples};
use lacuna_filters::Mask;
use lacuna_filters::baseline::depth::DepthPlan;

use super::pixels::any_changed;
use super::{Difference, Pair};
use crate::channels::normal_triple;
use crate::reconstruct::normals::Lengths;
use crate::reconstruct::{measured_floats, normals, usable, value};

/// How far the length of a vector may be from the right one, of that or of 1, if a component is a half: its rounding error.
const HALF: f64 = 1.0 / 1024.0;
/// The same for 32-bit floats.
const FLOAT: f64 = 1e-6;

/// A normal whose filled vectors are of another length: one difference, with the first pixel and the number.
pub fn compare(pair: &Pair<'_>) -> Vec<Difference> {
    let part = pair.sparse;
    let first = |channel: &usize| {
        let triple = normal_triple(part, pair.choices, *channel)?;
        (triple.iter().min() == Some(channel)).then_some(triple)
    };
    (0..part.channels.len()).filter_map(|channel| first(&channel)).filter_map(|t| one(pair, t)).collect()
}

fn one(pair: &Pair<'_>, triple: [usize; 3]) -> Option<Difference> {
    let part = pair.sparse;
    if triple.iter().all(|&at| pair.copied(&part.channels[at].display_name()).is_some()) {
        return None;
    }
    let samples = triple.map(|channel| &part.channels[channel].samples);
    let mut masks: Vec<Arc<Mask>> = Vec::new();
    for channel in triple {
        // What a full mask serves is not filled, so nothing is scaled.
        let mask = pair.masks.get(pair.index, channel).filter(|mask| !mask.is_full())?;
        masks.push(usable(pair.choices[channel].rule, &part.channels[channel].samples, mask).ok()?);
    }
    let masks: [Arc<Mask>; 3] = masks.try_into().ok()?;
    let mut planes = Vec::new();
    for (samples, mask) in samples.iter().zip(&masks) {
        planes.push(measured_floats(samples, mask).ok()?);
    }
    let (both, measured) = (normals::both(&masks)?, [planes[0].as_slice(), &planes[1], &planes[2]]);
    let lengths = normals::lengths(measured, &both)?;
    let around = match lengths {
        Lengths::Unit => None,
        Lengths::Mixed => Some(DepthPlan::new(&both).ok()?),
    };
    let filled = |channel: usize| -> Option<&Channel> {
        let name = &part.channels[channel].name;
        let found = pair.filled.channels.iter().find(|other| other.name == *name)?;
        (found.samples.len() == part.channels[channel].samples.len()).then_some(found)
    };
    let filled = [filled(triple[0])?, filled(triple[1])?, filled(triple[2])?];
    let half = filled.iter().any(|channel| matches!(channel.samples, Samples::Half(_)));
    let tolerance = if half { HALF } else { FLOAT };
    let wrong = |at: &usize| {
        let squares = filled.map(|channel| f64::from(value(&channel.samples, *at)).powi(2));
        let length = squares.iter().sum::<f64>().sqrt();
        // What is not finite is told of its channel.
        length.is_finite()
            && match &around {
                None => length != 0.0 && (length - 1.0).abs() > tolerance,
                Some(around) => {
                    let range = normals::range(measured, around.around(*at));
                    !fits(length, tolerance, |own| lengths.allowed(own, range))
                }
            }
    };
    // Smoothed vectors are scaled as well; the attributes do not say which were, but measured pixels show it.
    let changed = |at: usize| any_changed(pair, triple[at], filled[at], &masks[at]);
    let kept = normals::kept(&masks, !(pair.claims.smoothed && (0..3).all(changed)));
    let all = (0..kept.as_slice().len()).filter(|&at| !kept.as_slice()[at]).filter(wrong);
    let all: Vec<usize> = all.collect();
    let what = match &around {
        None => "a filled normal is not of unit length, as the measured ones are",
        Some(_) => "a filled normal is longer or shorter than the measured ones around it",
    };
    let name = part.channels[triple[0]].display_name();
    pair.first_of(&name, what, &all)
}

/// Whether a vector has a length that is allowed. Rounding may have taken it over the edge between what is scaled and what is not.
fn fits(length: f64, tolerance: f64, allowed: impl Fn(f32) -> f32) -> bool {
    let off = tolerance * length.max(1.0);
    let before = [length - 0.5 * off, length + 0.5 * off];
    before.iter().any(|&own| (f64::from(allowed(own as f32)) - length).abs() <= off)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn rounding_takes_no_length_out_of_what_is_allowed() {
        let fits = |length: f64| fits(length, HALF, |own| Lengths::Mixed.allowed(own, (0.712_609_6, 1.0)));
        for (length, right) in
            [(0.5, true), (0.641_392_6, true), (0.66, false), (0.713, true), (1.0005, true), (1.01, false)]
        {
            assert_eq!(fits(length), right, "{length}");
        }
    }
}
