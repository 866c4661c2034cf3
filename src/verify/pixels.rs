//! The pixels of one channel, sparse and filled.

use std::collections::HashSet;

use half::f16;
use lacuna_exr::{Channel, Samples};
use lacuna_filters::{Bounds, Mask};

use super::{Difference, Pair};
use crate::channels::Rule;
use crate::guides::Copied;
use crate::info::kind;
use crate::reconstruct::{bounds_of, convert, kind_for, to_half, usable, value};

/// Whether a measured pixel of a channel has other bits than in the type that it is to have.
pub fn any_changed(pair: &Pair<'_>, index: usize, filled: &Channel, measured: &Mask) -> bool {
    let to = kind_for(pair.choices[index].rule, pair.claims.kind);
    let expected = convert(pair.sparse.channels[index].samples.clone(), to, None).0;
    let pixels = bits(&expected).into_iter().zip(bits(&filled.samples)).zip(measured.as_slice());
    pixels.into_iter().any(|((before, after), flag)| *flag && before != after)
}

/// The differences of one channel: of each sort the first pixel and the number.
pub fn compare(pair: &Pair<'_>, index: usize, filled: &Channel) -> Vec<Difference> {
    let sparse = &pair.sparse.channels[index];
    let name = sparse.display_name().into_owned();
    let whole = |what: String| vec![pair.differ(Some(&name), None, what)];
    let Some(rule) = pair.choices.get(index).map(|choice| choice.rule) else {
        return whole("no rule is known for it".into());
    };
    let expected = convert(sparse.samples.clone(), kind_for(rule, pair.claims.kind), None).0;
    if kind(&expected) != kind(&filled.samples) {
        return whole(format!("the type is {}, not {}", kind(&filled.samples), kind(&expected)));
    }
    if sparse.perceptually_linear != filled.perceptually_linear {
        return whole("the flag pLinear has changed".into());
    }
    let (expected, found) = (bits(&expected), bits(&filled.samples));
    if expected.len() != found.len() {
        return whole(format!("it has {} pixels, not {}", found.len(), expected.len()));
    }
    let report = |what: &str, wrong: Vec<usize>| -> Option<Difference> { pair.first_of(&name, what, &wrong) };
    let differ = |at: &usize| expected[*at] != found[*at];
    let all = 0..expected.len();
    if rule == Rule::Keep {
        return report("a kept pixel has changed", all.filter(differ).collect()).into_iter().collect();
    }
    let Some(mask) = pair.masks.get(pair.index, index) else {
        return whole("no mask says which pixels were measured".into());
    };
    if mask.is_full() {
        return report("a measured pixel has changed", all.filter(differ).collect()).into_iter().collect();
    }
    let Ok(usable) = usable(rule, &sparse.samples, mask) else {
        return whole("its values cannot be told".into());
    };
    let measured = |at: &usize| usable.as_slice()[*at];
    let smoothed = pair.claims.smoothed && matches!(rule, Rule::Fill | Rule::Normal);
    let changed: Vec<usize> =
        all.clone().filter(|at| !smoothed && measured(at)).filter(|at| differ(at)).collect();
    let missing = all.filter(|at| smoothed || !measured(at));
    let mut differences = Vec::new();
    differences.extend(report("a measured pixel has changed", changed));
    let missing: Vec<usize> = missing.collect();
    let copied = pair.copied(&name);
    if let Some(copied) = &copied {
        let source = copied.source();
        match wrong_copies(pair, copied, (sparse, filled), &missing) {
            Some(wrong) => {
                let what = format!("a pixel is not that of {source}, which it is said to be copied from");
                differences.extend(report(&what, wrong));
            }
            None => differences
                .extend(whole(format!("it is said to be copied from {source}, which is not there"))),
        }
    }
    let (what, wrong) = wrong_fills((rule, copied.is_some()), &name, (sparse, filled), &usable, missing);
    differences.extend(report(what, wrong));
    differences
}

/// The missing pixels that differ from those of the complete channel that they are said to be copied from, in the channel's type; none if that stands in
/// another file, nothing if it is not there.
fn wrong_copies(
    pair: &Pair<'_>,
    copied: &Copied,
    (sparse, filled): (&Channel, &Channel),
    missing: &[usize],
) -> Option<Vec<usize>> {
    let Some(part) = copied.part(pair.index) else { return Some(Vec::new()) };
    let twins = &pair.frame.parts.get(part)?.channels;
    let twin = twins.iter().find(|channel| channel.display_name() == copied.twin)?;
    if twin.samples.len() != sparse.samples.len() {
        return None;
    }
    let is_half = |channel: &Channel| matches!(channel.samples, Samples::Half(_));
    let halves = is_half(sparse) || is_half(filled);
    let expected = |at: usize| match value(&twin.samples, at) {
        value if halves => to_half(value, &mut 0).to_f32(),
        value => value,
    };
    Some(missing.iter().copied().filter(|&at| value(&filled.samples, at) != expected(at)).collect())
}

/// The filled pixels that cannot be right, and what is wrong with them.
fn wrong_fills(
    (rule, copied): (Rule, bool),
    name: &str,
    (sparse, filled): (&Channel, &Channel),
    mask: &Mask,
    mut missing: Vec<usize>,
) -> (&'static str, Vec<usize>) {
    if matches!(rule, Rule::Nearest | Rule::Depth) {
        let bits = bits(&filled.samples);
        let known: HashSet<u32> = bits
            .iter()
            .zip(mask.as_slice())
            .filter(|(_, measured)| **measured)
            .map(|(bits, _)| *bits)
            .collect();
        missing.retain(|&at| !known.contains(&bits[at]));
        if rule == Rule::Depth && copied {
            // Other surfaces have other depths.
            missing.retain(|&at| !value(&filled.samples, at).is_finite());
            return ("a filled pixel is not finite, as no measured one is", missing);
        }
        return ("a filled pixel has a value that was measured nowhere", missing);
    }
    let not_finite: Vec<usize> =
        missing.iter().copied().filter(|&at| !value(&filled.samples, at).is_finite()).collect();
    if !not_finite.is_empty() {
        return ("a filled pixel is not finite", not_finite);
    }
    let bounds = if rule == Rule::Fill { bounds_of(name) } else { Bounds::Free };
    let places = mask.as_slice().iter().enumerate().filter(|(_, measured)| **measured);
    let (low, high) = bounds.range(places.map(|(at, _)| value(&sparse.samples, at)));
    // A bound that was measured is rounded as what was filled is.
    let rounded = |bound: f32| match filled.samples {
        Samples::Half(_) => f16::from_f32(bound).to_f32(),
        _ => bound,
    };
    let (low, high) = (rounded(low), rounded(high));
    missing.retain(|&at| !(low..=high).contains(&value(&filled.samples, at)));
    ("a filled pixel leaves the bounds that all measured ones keep", missing)
}

/// The bits of every pixel.
fn bits(samples: &Samples) -> Vec<u32> {
    match samples {
        Samples::Half(values) => values.iter().map(|value| u32::from(value.to_bits())).collect(),
        Samples::Float(values) => values.iter().map(|value| value.to_bits()).collect(),
        Samples::Uint(values) => values.clone(),
    }
}
