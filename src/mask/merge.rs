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
use super::{ATTRIBUTE, MakeError, Masks, flags};
use crate::channels::{Rule, choose, dense, list_dense, part_label};
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
/// Frames that differ in parts, windows, channels or their types, or have their masks in other channels; a frame in which a part has a mask and in the
/// other not; channels of several masks that no channel of the frame holds.
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
        let alike = same_form(part, other).and_then(|()| same_masks(part, index, [first, second]));
        alike.map_err(|why| MakeError::Other(format!("{label}{why}")))?;
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
        let United { unions, complete, different, notes: own } = united;
        notes.extend(own.into_iter().map(|note| format!("{label}{note}")));
        if different > 0 {
            let pixels = if different == 1 { "1 pixel" } else { &format!("{different} pixels") };
            notes.push(format!(
                "{label}the renders differ in {pixels} that both measured: are they of one frame?"
            ));
        }
        measured += unions.iter().map(|(union, _)| union.count()).sum::<usize>();
        all += unions.iter().map(|(union, _)| union.as_slice().len()).sum::<usize>();
        if !unions.is_empty() {
            finish(part, (unions, &complete), from_elsewhere)
                .map_err(|why| MakeError::Other(format!("{label}{why}")))?;
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
    /// Pixels that either render measured, each different set once, and the first channel that has it.
    unions: Vec<(Mask, String)>,
    /// Channels that lack nothing.
    complete: Vec<String>,
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
    let (size, name) = (a.size(), a.channels[channel].display_name().into_owned());
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
            let union = union(own, new)?;
            if union.is_full() {
                united.complete.push(name.clone());
            }
            if united.unions.iter().all(|(other, _)| *other != union) {
                united.unions.push((union, name));
            }
        }
        [None, None] if target.same_bits(source) => {}
        [None, None] => {
            united.notes.push(format!("{name} has no mask and differs: the first render's is kept"));
        }
        _ => return Err(MakeError::Other(format!("only one of the renders has a mask for {name}"))),
    }
    Ok(())
}

fn same_form(a: &Part, b: &Part) -> Result<(), String> {
    if a.data_window != b.data_window {
        return Err("the data windows differ".into());
    }
    let lacks = |part: &Part, of: &Part| {
        let has = |wanted: &Channel| part.channels.iter().any(|channel| channel.name == wanted.name);
        of.channels.iter().find(|channel| !has(channel)).map(|channel| channel.display_name().into_owned())
    };
    for (which, missing) in [("first", lacks(a, b)), ("second", lacks(b, a))] {
        if let Some(name) = missing {
            return Err(format!(
                "the {which} render has no channel {name}: render both with the same channels"
            ));
        }
    }
    let mut pairs = a.channels.iter().zip(&b.channels);
    pairs.find(|(own, other)| own.samples.kind() != other.samples.kind()).map_or(Ok(()), |(own, _)| {
        let name = own.display_name();
        Err(format!("channel {name} is of another type in the second render: write both alike"))
    })
}

/// The masks of both renders are the same channels of a part.
fn same_masks(part: &Part, index: usize, masks: [&Masks; 2]) -> Result<(), String> {
    let [first, second] = masks.map(|masks| {
        let channels = masks.mask_channels[index].iter().filter_map(|&at| part.channels.get(at));
        let names: Vec<_> = channels.map(Channel::display_name).collect();
        if names.is_empty() { "no channel".into() } else { names.join(", ") }
    });
    if first == second {
        return Ok(());
    }
    Err(format!(
        "the mask of the first render is {first}, of the second {second}: name one that both have with --mask channel:NAME"
    ))
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

/// Adds a mask channel where the mask came from another file, beside a channel of that name that says something else, and drops what the attributes say
/// about the first pattern.
fn finish(
    part: &mut Part,
    (mut unions, complete): (Vec<(Mask, String)>, &[String]),
    add: bool,
) -> Result<(), String> {
    if add && unions.len() > 1 {
        // Its own alpha says so, but the mask that is added would not.
        unions.retain(|(mask, _)| !mask.is_full());
        let known = dense(part);
        list_dense(part, complete.iter().filter(|name| !known.contains(name)).map(String::as_str));
    }
    if let ([(mask, a), others @ ..], true) = (unions.as_slice(), add) {
        if let Some((_, b)) = others.first() {
            return Err(format!(
                "{a} and {b} have masks of their own, which one channel cannot hold: write them into the renders as LAYER.mask, or merge such \
                 layers as files of their own"
            ));
        }
        let of_name = |name: &str| part.channels.iter().find(|channel| channel.name == name.as_bytes());
        let says = |channel: &Channel| flags(&channel.samples, |value| value >= 0.5) == mask.as_slice();
        let mut names = (1_usize..).map(|n| if n == 1 { CHANNEL.into() } else { format!("{CHANNEL}{n}") });
        let name = names.find(|name| of_name(name).is_none_or(says)).unwrap_or_default();
        if of_name(&name).is_none() {
            let mut samples = Samples::Half(vec![f16::ZERO; mask.as_slice().len()]);
            set(&mut samples, mask);
            let channel = Channel { name: name.as_str().into(), perceptually_linear: false, samples };
            let at = part.channels.partition_point(|other| other.name < channel.name);
            part.channels.insert(at, channel);
        }
        part.attributes.set_text(ATTRIBUTE, &name);
    }
    part.attributes.remove(SEED);
    part.attributes.set_text(PATTERN, "merged");
    Ok(())
}

#[cfg(test)]
#[path = "merge/tests.rs"]
mod tests;
