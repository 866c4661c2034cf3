//! Two sparse renders of one frame united, bit for bit: what either measured is measured.
//!
//! A pixel takes the bits of the first render where that measured it, of the second where only that did, and those of
//! the first where neither did, unless they were filled: then it is 0. The mask channels say so; counts of samples are values like others. Everything
//! else (parts, windows, attributes, channels that are complete or have no mask) is the first render's; the second must have the same parts, windows
//! and channels.

use std::sync::Arc;

use half::f16;
use lacuna_exr::{Attributes, CAMERA, Channel, Frame, Part, Samples};
use lacuna_filters::Mask;

use super::filled::filled_by;
use super::{ATTRIBUTE, MakeError, Masks};
use crate::channels::{Rule, choose, part_label};
use crate::mask::{PATTERN, SEED};

/// The channel that is added to a part without one.
const CHANNEL: &str = "mask";

/// The union, and what a reader of the log should know.
#[derive(Clone, Debug, PartialEq)]
pub struct Merged {
    /// The frame.
    pub frame: Frame,
    /// Measured pixels over all pixels of its parts.
    pub density: f64,
    /// One line each.
    pub notes: Vec<String>,
}

/// Unites `b` into `a`; `forget` removes the attributes that would lie about a united part, and says so.
///
/// # Errors
/// Frames that differ in parts, windows, channels or their types; a frame in which a part has a mask and in the other not.
pub fn merge(
    a: (Frame, &Masks),
    b: (&Frame, &Masks),
    forget: impl Fn(&mut Attributes) -> Option<String>,
) -> Result<Merged, MakeError> {
    let ((mut frame, first), (other, second)) = (a, b);
    if frame.parts.len() != other.parts.len() {
        let (a, b) = (frame.parts.len(), other.parts.len());
        return Err(MakeError::Other(format!("the first render has {a} parts, the second {b}")));
    }
    let (mut notes, mut measured, mut all) = (Vec::new(), 0, 0);
    // A mask channel serves other parts as well.
    let from_elsewhere = first.mask_channels.iter().all(Vec::is_empty);
    let choices = choose(&frame, &first.mask_channels, &[]);
    for (index, other) in other.parts.iter().enumerate() {
        let label = part_label(&frame, index);
        let label = if label.is_empty() { label } else { format!("{label}: ") };
        let part = &mut frame.parts[index];
        let filter = filled_by(part, Some(first), index);
        if let Some(filter) = &filter {
            notes.push(format!("{label}filled by {filter}: what no render measured is missing again"));
        }
        same_form(part, other).map_err(|why| MakeError::Other(format!("{label}{why}")))?;
        let differs = |name: &&str| part.attributes.get(name) != other.attributes.get(name);
        if let Some(name) = CAMERA.iter().find(|name| differs(name)) {
            notes.push(format!("{label}the renders differ in {name}: are they of one frame?"));
        }
        let filled = [filter.is_some(), filled_by(other, Some(second), index).is_some()];
        let mut united = United::default();
        for (channel, choice) in choices[index].iter().enumerate() {
            let masks = [first, second].map(|masks| masks.get(index, channel).map(Arc::as_ref));
            let is_mask = first.is_mask_channel(index, channel) && !first.are_counts();
            let held = Held::of(is_mask, choice.rule, filled);
            unite((part, other), (channel, held), masks, &mut united).map_err(|error| match error {
                MakeError::Other(why) => MakeError::Other(format!("{label}{why}")),
                other => other,
            })?;
        }
        let United { mask: united, different, notes: own, .. } = united;
        notes.extend(own.into_iter().map(|note| format!("{label}{note}")));
        if different > 0 {
            let pixels = if different == 1 { "1 pixel" } else { &format!("{different} pixels") };
            notes.push(format!(
                "{label}the renders differ in {pixels} that both measured: are they of one frame?"
            ));
        }
        if let Some(union) = united {
            measured += union.count();
            all += union.as_slice().len();
            finish(part, &union, from_elsewhere);
            notes.extend(forget(&mut part.attributes).map(|note| format!("{label}{note}")));
        }
    }
    if all == 0 {
        return Err(MakeError::Other("neither render has a sampling mask: nothing to unite".into()));
    }
    Ok(Merged { frame, density: measured as f64 / all as f64, notes })
}

/// What a channel of the first render holds.
#[derive(Clone, Copy, PartialEq, Eq)]
enum Held {
    /// A mask.
    Mask,
    /// Where neither measured, what a renderer wrote.
    Rendered,
    /// There, what was filled.
    Filled,
    /// The same, unless the second render, which was not filled, holds it, too: then the channel is complete.
    FilledUnlessEqual,
}

impl Held {
    /// By whether the renders were filled.
    fn of(is_mask: bool, rule: Rule, filled: [bool; 2]) -> Self {
        match filled {
            _ if is_mask => Self::Mask,
            _ if rule == Rule::Keep => Self::Rendered,
            [false, _] => Self::Rendered,
            [true, true] => Self::Filled,
            [true, false] => Self::FilledUnlessEqual,
        }
    }
}

/// What is found while the channels of a part are united.
#[derive(Default)]
struct United {
    /// Pixels that either render measured.
    mask: Option<Mask>,
    /// The most pixels of a channel in which the renders differ, though both measured them.
    different: usize,
    /// One line each.
    notes: Vec<String>,
}

/// Unites a channel of `b` into the same of `a`, by the masks of the two; one that is a mask itself takes the pixels of both.
fn unite(
    (a, b): (&mut Part, &Part),
    (channel, held): (usize, Held),
    masks: [Option<&Mask>; 2],
    united: &mut United,
) -> Result<(), MakeError> {
    let size = a.size();
    let (target, source) = (&mut a.channels[channel].samples, &b.channels[channel].samples);
    if held == Held::Mask {
        let measured = |samples| Mask::new(size, super::flags(samples, |value| value >= 0.5));
        set(target, &union(&measured(target)?, &measured(source)?)?);
        return Ok(());
    }
    match masks {
        [Some(own), Some(new)] => {
            let both = |pixel: usize| new.as_slice()[pixel] && own.as_slice()[pixel];
            united.different = united.different.max(differing(target, source, both));
            let only_new = |pixel: usize| new.as_slice()[pixel] && !own.as_slice()[pixel];
            take(target, source, only_new);
            let neither = |pixel: usize| !own.as_slice()[pixel] && !new.as_slice()[pixel];
            let clears = match held {
                Held::FilledUnlessEqual => differing(target, source, neither) > 0,
                _ => held == Held::Filled,
            };
            if clears {
                clear(target, neither);
            }
            if united.mask.is_none() {
                united.mask = Some(union(own, new)?);
            }
        }
        [None, None] if target.same_bits(source) => {}
        [None, None] => {
            let name = a.channels[channel].display_name();
            united.notes.push(format!("{name} has no mask and differs: the first render's is kept"));
        }
        _ => return Err(MakeError::Other("only one of the renders has a mask for it".into())),
    }
    Ok(())
}

fn same_form(a: &Part, b: &Part) -> Result<(), String> {
    if a.data_window != b.data_window {
        return Err("the data windows differ".into());
    }
    let form =
        |part: &Part| part.channels.iter().map(|c| (c.name.clone(), c.samples.kind())).collect::<Vec<_>>();
    if form(a) == form(b) { Ok(()) } else { Err("the channels or their types differ".into()) }
}

fn union(a: &Mask, b: &Mask) -> Result<Mask, MakeError> {
    let flags = a.as_slice().iter().zip(b.as_slice()).map(|(a, b)| *a || *b);
    Ok(Mask::new(a.size(), flags.collect())?)
}

/// Copies the bits of some pixels.
fn take(target: &mut Samples, source: &Samples, from: impl Fn(usize) -> bool) {
    fn copy<T: Copy>(target: &mut [T], source: &[T], from: impl Fn(usize) -> bool) {
        let pixels = target.iter_mut().zip(source).enumerate().filter(|(pixel, _)| from(*pixel));
        pixels.for_each(|(_, (target, source))| *target = *source);
    }
    match (target, source) {
        (Samples::Half(target), Samples::Half(source)) => copy(target, source, from),
        (Samples::Float(target), Samples::Float(source)) => copy(target, source, from),
        (Samples::Uint(target), Samples::Uint(source)) => copy(target, source, from),
        // The forms were compared before.
        _ => {}
    }
}

/// Sets some pixels to 0.
fn clear(samples: &mut Samples, which: impl Fn(usize) -> bool) {
    fn zero<T: Copy + Default>(values: &mut [T], which: impl Fn(usize) -> bool) {
        values
            .iter_mut()
            .enumerate()
            .filter(|(pixel, _)| which(*pixel))
            .for_each(|(_, value)| *value = T::default());
    }
    match samples {
        Samples::Half(values) => zero(values, which),
        Samples::Float(values) => zero(values, which),
        Samples::Uint(values) => zero(values, which),
    }
}

/// How many of some pixels have other bits.
fn differing(a: &Samples, b: &Samples, of: impl Fn(usize) -> bool) -> usize {
    fn count<T: Copy, B: PartialEq>(a: &[T], b: &[T], bits: fn(T) -> B, of: impl Fn(usize) -> bool) -> usize {
        let pairs = a.iter().zip(b).enumerate();
        pairs.filter(|(pixel, (a, b))| of(*pixel) && bits(**a) != bits(**b)).count()
    }
    match (a, b) {
        (Samples::Half(a), Samples::Half(b)) => count(a, b, f16::to_bits, of),
        (Samples::Float(a), Samples::Float(b)) => count(a, b, f32::to_bits, of),
        (Samples::Uint(a), Samples::Uint(b)) => count(a, b, |value| value, of),
        _ => 0,
    }
}

/// Writes a mask into its channel.
fn set(samples: &mut Samples, mask: &Mask) {
    fn flags<T: Copy>(values: &mut [T], mask: &Mask, missing: T, measured: T) {
        for (value, &flag) in values.iter_mut().zip(mask.as_slice()) {
            *value = if flag { measured } else { missing };
        }
    }
    match samples {
        Samples::Half(values) => flags(values, mask, f16::ZERO, f16::ONE),
        Samples::Float(values) => flags(values, mask, 0.0, 1.0),
        Samples::Uint(values) => flags(values, mask, 0, 1),
    }
}

/// Adds a mask channel where the mask came from another file, and drops what the attributes say about the first pattern.
fn finish(part: &mut Part, mask: &Mask, add: bool) {
    if add {
        let mut samples = Samples::Half(vec![f16::ZERO; mask.as_slice().len()]);
        set(&mut samples, mask);
        let channel = Channel { name: CHANNEL.into(), perceptually_linear: false, samples };
        part.channels.retain(|channel| channel.name != CHANNEL.as_bytes());
        let at = part.channels.partition_point(|other| other.name < channel.name);
        part.channels.insert(at, channel);
        part.attributes.set_text(ATTRIBUTE, CHANNEL);
    }
    part.attributes.remove(SEED);
    part.attributes.set_text(PATTERN, "merged");
}

#[cfg(test)]
#[path = "merge/tests.rs"]
mod tests;
