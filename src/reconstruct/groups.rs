//! Which channels of a part go through the filter together, and which of their values count as measured.

use std::collections::HashSet;
use std::sync::Arc;

use half::f16;
use half::slice::HalfFloatSliceExt;
use lacuna_core::parallel::prelude::*;
use lacuna_exr::{Channel, Frame, Part, Samples};
use lacuna_filters::Mask;
use lacuna_filters::fill::Values;

use super::{Error, PIECE};
use crate::channels::{self, Choice, Name, Rule, channel_label};
use crate::mask::{self, Masks};

/// Values that are converted at once.
const ROW: usize = 256;

/// A channel that is to be filled.
#[derive(Clone, Debug)]
pub struct Target {
    /// Its place in the part.
    pub channel: usize,
    /// What is done with it; never `keep`.
    pub rule: Rule,
    /// The values that count as measured; before the filters have run, those that are not finite among them.
    pub mask: Arc<Mask>,
    /// Measured values that do not count because they are NaN or infinite, or are not copied for that.
    pub non_finite: usize,
}

/// Channels of one layer, rule and mask: its colours, or what else belongs together.
#[derive(Clone, Debug)]
pub struct Group {
    /// Their places in the part.
    pub channels: Vec<usize>,
    /// The measured pixels.
    pub mask: Arc<Mask>,
    /// What they are: light is no alpha, matte, position or normal.
    pub values: Values,
    /// Whether they are colours, which speak for their layer.
    pub colours: bool,
}

/// The channels of a part that miss something, with the masks that are true for their values.
/// Those that miss nothing belong to them where a method restores.
pub fn targets(
    frame: &Frame,
    part: usize,
    masks: &Masks,
    choices: &[Choice],
    restores: bool,
) -> Result<Vec<Target>, Error> {
    let mut found: Vec<Target> = Vec::new();
    for (index, choice) in choices.iter().enumerate() {
        if choice.rule == Rule::Keep {
            continue;
        }
        let channel = &frame.parts[part].channels[index];
        let label = || channel_label(frame, part, index);
        let name = || channel.display_name().into_owned();
        let Some(mask) = masks.get(part, index) else {
            let why = masks.why_none.get(part).and_then(|why| why.get(index)?.clone());
            let why = why.unwrap_or_else(|| "no mask".into());
            return Err(Error::NoMask { channel: label(), name: name(), why });
        };
        if mask.is_full() && !(restores && choice.rule == Rule::Fill) {
            continue;
        }
        if mask.is_empty() {
            let why = mask::why_empty(frame, masks, part);
            return Err(Error::EmptyMask { channel: label(), origin: masks.origin.clone(), why });
        }
        // What is computed, the filters look through.
        let (usable, non_finite) = match choice.rule {
            Rule::Depth => {
                let numbers = numbers(&channel.samples, mask)?;
                let non_finite = mask.count() - numbers.count();
                (numbers, non_finite)
            }
            Rule::Nearest if !channels::is_bits(&frame.parts[part], index) => {
                (Arc::clone(mask), mask.count() - finite(&channel.samples, mask)?.count())
            }
            _ => (Arc::clone(mask), 0),
        };
        if usable.is_empty() {
            return Err(Error::NothingFinite { channel: label(), name: name() });
        }
        let known = found.iter().map(|target| &target.mask).find(|other| ***other == *usable);
        let mask = known.cloned().unwrap_or(usable);
        found.push(Target { channel: index, rule: choice.rule, mask, non_finite });
    }
    Ok(found)
}

/// The measured pixels whose value the rule can use: finite ones for what is computed, anything but NaN for depth,
/// all for what is only copied.
pub fn usable(rule: Rule, samples: &Samples, mask: &Arc<Mask>) -> Result<Arc<Mask>, Error> {
    match rule {
        Rule::Fill | Rule::Normal => finite(samples, mask),
        Rule::Depth => numbers(samples, mask),
        Rule::Nearest | Rule::Keep => Ok(Arc::clone(mask)),
    }
}

/// The measured pixels that missing ones of a channel with the rule `nearest` are copied from: without those where it or
/// another such channel of its layer is not finite, so that the components of a vector stay together, while any is left; else its
/// own finite ones, and all if there is none.
pub fn copyable(part: &Part, target: &Target, targets: &[Target]) -> Result<Arc<Mask>, Error> {
    let layer = |target: &Target| Name::new(&part.channels[target.channel].display_name()).layer.to_owned();
    let own = layer(target);
    let beside = |other: &&Target| other.rule == Rule::Nearest && other.non_finite > 0 && layer(other) == own;
    let mut mask = Arc::clone(&target.mask);
    for other in targets.iter().filter(beside) {
        mask = finite(&part.channels[other.channel].samples, &mask)?;
    }
    if mask.is_empty() {
        mask = finite(&part.channels[target.channel].samples, &target.mask)?;
    }
    Ok(if mask.is_empty() { Arc::clone(&target.mask) } else { mask })
}

/// The mask without the pixels whose value is not finite.
fn finite(samples: &Samples, mask: &Arc<Mask>) -> Result<Arc<Mask>, Error> {
    measured_and(samples, mask, f32::is_finite)
}

/// The mask without the pixels whose value is NaN.
fn numbers(samples: &Samples, mask: &Arc<Mask>) -> Result<Arc<Mask>, Error> {
    measured_and(samples, mask, |value| !value.is_nan())
}

/// The mask without the pixels whose value does not fit; the same one if all do.
fn measured_and(
    samples: &Samples,
    mask: &Arc<Mask>,
    fits: impl Fn(f32) -> bool + Sync,
) -> Result<Arc<Mask>, Error> {
    let flags = mask.as_slice();
    // Counted without leaving early, so that it runs in vectors.
    let bad = |value: f32, measured: bool| usize::from(measured & !fits(value));
    let misfits: usize = match samples {
        Samples::Half(values) => {
            let pieces = values.par_chunks(PIECE).zip(flags.par_chunks(PIECE));
            // Converted one by one, each would ask what the processor has.
            let piece = |values: &[f16], flags: &[bool]| {
                let mut floats = [0.0; ROW];
                let rows = values.chunks(ROW).zip(flags.chunks(ROW)).map(|(values, flags)| {
                    let floats = &mut floats[..values.len()];
                    values.convert_to_f32_slice(floats);
                    floats.iter().zip(flags).map(|(&value, &flag)| bad(value, flag)).sum::<usize>()
                });
                rows.sum::<usize>()
            };
            pieces.map(|(values, flags)| piece(values, flags)).into_iter().sum()
        }
        Samples::Float(values) => {
            let pieces = values.par_chunks(PIECE).zip(flags.par_chunks(PIECE));
            pieces
                .map(|(v, f)| v.iter().zip(f).map(|(&value, &flag)| bad(value, flag)).sum::<usize>())
                .into_iter()
                .sum()
        }
        Samples::Uint(_) => 0,
    };
    if misfits == 0 {
        return Ok(Arc::clone(mask));
    }
    let values = samples.to_floats().ok_or(Error::OtherFrame)?;
    let flags = values.iter().zip(flags).map(|(&value, &flag)| flag && fits(value)).collect();
    Mask::new(mask.size(), flags).map(Arc::new).map_err(|_| Error::OtherFrame)
}

/// Whether a group may speak for its layer: where there are colours, they do.
pub fn speaks(part: &Part, group: &Group) -> bool {
    let name = |at: usize| part.channels[at].display_name();
    let own = name(group.channels[0]);
    let beside =
        |at: usize| Name::new(&name(at)).layer == Name::new(&own).layer && channels::is_colour(part, at);
    group.colours || !(0..part.channels.len()).any(beside)
}

/// The groups that go through the filter, in the order of their first channels. A scalar without a layer or in one of colours, such as `cputime`, is
/// alone: it has a scale of its own, and would choose for them. Components of a layer without colours are a spectrum or a vector.
pub fn groups(frame: &Frame, part: usize, targets: &[Target]) -> Vec<Group> {
    let part = &frame.parts[part];
    let names: Vec<_> = part.channels.iter().map(Channel::display_name).collect();
    let layer = |at: usize| Name::new(&names[at]).layer;
    let coloured: HashSet<&str> =
        (0..names.len()).filter(|&at| channels::is_colour(part, at)).map(layer).collect();
    let mut groups: Vec<Group> = Vec::new();
    for target in targets.iter().filter(|target| matches!(target.rule, Rule::Fill | Rule::Normal)) {
        let at = target.channel;
        let values = match target.rule {
            Rule::Normal => Values::Directions,
            // Differences of light: below 0 as well.
            _ if channels::is_chroma(&names[at]) => Values::Other,
            _ if channels::is_light(&names[at]) => Values::Light,
            _ => Values::Other,
        };
        let colours = values == Values::Light && channels::is_colour(part, at);
        let alone =
            values == Values::Light && !colours && (layer(at).is_empty() || coloured.contains(layer(at)));
        let same = groups.iter_mut().filter(|_| !alone).find(|group| {
            layer(group.channels[0]) == layer(at)
                && (group.values, group.colours) == (values, colours)
                && Arc::ptr_eq(&group.mask, &target.mask)
        });
        if let Some(group) = same {
            group.channels.push(at);
        } else {
            let mask = Arc::clone(&target.mask);
            groups.push(Group { channels: vec![at], mask, values, colours });
        }
    }
    groups
}
