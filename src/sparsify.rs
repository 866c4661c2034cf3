//! Sparse frames from full ones: test input for everything that fills.
//!
//! Missing pixels become zero in every channel of every part, each part gets a channel `mask` of halves (1 measured,
//! 0 missing), and attributes record how. The pattern is anchored to absolute pixels, so that parts and overscan agree.

use std::sync::Arc;

use half::f16;
use lacuna_exr::{Channel, Frame, Part, Samples};
use lacuna_filters::sampling::{self, Temporal, adaptive};
use lacuna_filters::{Mask, Run};

use crate::channels::{DENSE, list_dense, part_label};
use crate::mask::generate::field;
use crate::mask::rounds::{ROUNDS, Rounds};
use crate::mask::{self, MaskFile, PATTERN, SEED};
use crate::reconstruct::{Stamp, drop_errors, dropped_note, make_writable, of_other_pixels, remove};

mod in_rounds;

use in_rounds::InRounds;

/// The channel that is added.
const CHANNEL: &str = "mask";

/// Which pixels stay.
#[derive(Clone, Copy, Debug)]
pub enum Pattern<'a> {
    /// A nested low-discrepancy pattern.
    Shuffle {
        /// Measured pixels over all pixels, 0 to 1.
        density: f64,
        /// Which pattern.
        seed: u64,
        /// The frame's number in a sequence: the masks of frames in a row complete each other.
        frame: i64,
    },
    /// The pixels of a mask image.
    File {
        /// The image.
        file: &'a MaskFile,
        /// Its channel, if not the obvious one.
        channel: Option<&'a str>,
    },
    /// Pixels that are chosen in rounds, with the frame as renderer.
    Adaptive {
        /// How many, and in which rounds.
        settings: &'a adaptive::Settings,
        /// How to run.
        run: &'a Run<'a>,
    },
    /// A mask that is there already, of every part's size.
    Given {
        /// The mask.
        mask: &'a Arc<Mask>,
        /// What the attribute calls it.
        name: &'a str,
    },
}

/// A frame that cannot be made sparse.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum Error {
    /// There is a mask already.
    #[error(
        "{0}has a channel '{1}': the frame looks sparse; fill it first, with --drop-mask, or remove that channel"
    )]
    HasMask(String, String),
    /// The mask image does not fit.
    #[error(transparent)]
    Mask(#[from] mask::Error),
    /// The mask image leaves pixels out.
    #[error("{part}{why}: give a mask that covers every part")]
    Uncovered {
        /// The part.
        part: String,
        /// What is wrong.
        why: String,
    },
    /// Parts whose windows have hardly anything in common.
    #[error("its parts lie too far apart to choose their pixels together; give --density without --adaptive")]
    FarApart,
    /// There is no colour to choose pixels by.
    #[error(
        "no part has a channel of colours, halves or floats, to choose pixels by; give --density without --adaptive"
    )]
    Colourless,
    /// No pixel would stay.
    #[error("{0}{1}")]
    Empty(String, String),
    /// The pattern's settings are out of range.
    #[error(transparent)]
    Pattern(#[from] lacuna_filters::Error),
}

/// A sparse frame, and what a reader of the log should know.
#[derive(Clone, Debug, PartialEq)]
pub struct Sparse {
    /// The frame.
    pub frame: Frame,
    /// Measured pixels over all pixels of all parts.
    pub density: f64,
    /// In which rounds pixels were chosen, if they were.
    pub rounds: Option<Rounds>,
    /// One line each.
    pub notes: Vec<String>,
}

/// Makes a frame sparse.
pub fn sparsify(frame: Frame, pattern: Pattern<'_>) -> Result<Sparse, Error> {
    sparsify_but(frame, pattern, &[])
}

/// The same, but channels that match one of `complete` stay as they are, and the attribute [`DENSE`] lists them.
pub fn sparsify_but(
    mut frame: Frame,
    pattern: Pattern<'_>,
    complete: &[glob::Pattern],
) -> Result<Sparse, Error> {
    for (index, part) in frame.parts.iter().enumerate() {
        let is_mask = |channel: &&Channel| channel.name.eq_ignore_ascii_case(CHANNEL.as_bytes());
        if let Some(channel) = part.channels.iter().find(is_mask) {
            return Err(has_mask(&frame, index, &channel.display_name()));
        }
    }
    let mut notes = drop_errors(&mut frame, |_, _| true);
    let rounds = match pattern {
        Pattern::Adaptive { settings, run } => Some(InRounds::new(&frame, settings, run)?),
        _ => None,
    };
    let masks = masks(&frame, pattern, rounds.as_ref())?;
    let (mut measured, mut all) = (0, 0);
    for (index, mask) in masks.iter().enumerate() {
        let label = prefix(&frame, index, "", ": ", "");
        if let Err(why) = mask::check_any(mask) {
            return Err(Error::Empty(label, why));
        }
        let part = &mut frame.parts[index];
        notes.extend(
            make_sparse(part, mask, pattern, complete).into_iter().map(|note| format!("{label}{note}")),
        );
        if let (Some(rounds), Pattern::Adaptive { settings, .. }) = (&rounds, pattern) {
            let text = rounds.found.pattern(settings) + &of_frame(settings.frame.unwrap_or(0));
            part.attributes.set_text(PATTERN, &text);
            part.attributes.set_text(ROUNDS, &rounds.found.line());
        }
        measured += mask.count();
        all += mask.as_slice().len();
    }
    let names = || frame.parts.iter().flat_map(|part| &part.channels).map(Channel::display_name);
    let is_complete = |name: &str| name == CHANNEL || complete.iter().any(|glob| glob.matches(name));
    if names().all(|name| is_complete(&name)) {
        notes.push("every channel stays complete: nothing is missing in this frame".into());
    }
    let idle = complete.iter().filter(|glob| !names().any(|name| glob.matches(&name)));
    notes.extend(idle.map(|glob| format!("--channels '{glob}=keep': no channel matches")));
    let density = if all == 0 { 0.0 } else { measured as f64 / all as f64 };
    notes.extend(rounds.as_ref().and_then(InRounds::note));
    Ok(Sparse { frame, density, rounds: rounds.map(|rounds| rounds.found), notes })
}

/// Refuses a frame that is to be complete, where a mask says that pixels are missing and no attribute that they were filled.
///
/// # Errors
/// [`Error::HasMask`].
pub fn check_complete(frame: &Frame) -> Result<(), Error> {
    let masks = match mask::find(frame, &mask::Source::Auto, None) {
        Ok(masks) => masks,
        Err(mask::Error::Several { names }) => return Err(has_mask(frame, 0, &names)),
        Err(_) => return Ok(()),
    };
    for (index, part) in frame.parts.iter().enumerate() {
        let filled = Stamp::read(&part.attributes).is_some();
        let own = masks.mask_channels[index].first().map(|&at| part.channels[at].display_name());
        if !filled && masks.part_density(index).is_some_and(|density| density < 1.0) {
            return Err(has_mask(frame, index, &own.unwrap_or_else(|| masks.origin.as_str().into())));
        }
    }
    Ok(())
}

fn has_mask(frame: &Frame, part: usize, channel: &str) -> Error {
    Error::HasMask(prefix(frame, part, "", " ", "the frame "), channel.into())
}

/// The part's label between two texts, or another text if the frame has one part only.
fn prefix(frame: &Frame, part: usize, before: &str, after: &str, otherwise: &str) -> String {
    let label = part_label(frame, part);
    if label.is_empty() { otherwise.into() } else { format!("{before}{label}{after}") }
}

/// One mask per part.
fn masks(frame: &Frame, pattern: Pattern<'_>, rounds: Option<&InRounds>) -> Result<Vec<Arc<Mask>>, Error> {
    match pattern {
        Pattern::Shuffle { density, seed, frame: number } => {
            let one = |part: &Part| {
                let field = field(part.data_window);
                let pattern = sampling::Pattern::Shuffle;
                sampling::mask(pattern, field, density, seed, Temporal::Complementary, number).map(Arc::new)
            };
            Ok(frame.parts.iter().map(one).collect::<Result<_, _>>()?)
        }
        Pattern::File { file, channel } => {
            let source =
                mask::Source::File { pattern: file.path().into(), channel: channel.map(ToOwned::to_owned) };
            let found = mask::find(frame, &source, Some(file))?;
            let one = |index| {
                let uncovered = || Error::Uncovered {
                    part: prefix(frame, index, "", ": ", ""),
                    why: found.why_none.get(index).and_then(|why| why.first()?.clone()).unwrap_or_default(),
                };
                found.get(index, 0).cloned().ok_or_else(uncovered)
            };
            (0..frame.parts.len()).map(one).collect()
        }
        Pattern::Given { mask, .. } => of_every_part(frame, mask),
        Pattern::Adaptive { .. } => Ok(rounds.map_or_else(Vec::new, |rounds| rounds.masks(frame))),
    }
}

/// The same mask for every part.
fn of_every_part(frame: &Frame, mask: &Arc<Mask>) -> Result<Vec<Arc<Mask>>, Error> {
    let one = |index: usize| {
        if frame.parts[index].size() == mask.size() {
            return Ok(Arc::clone(mask));
        }
        let why = format!("its size is not the mask's, {}", mask.size());
        Err(Error::Uncovered { part: prefix(frame, index, "", ": ", ""), why })
    };
    (0..frame.parts.len()).map(one).collect()
}

fn make_sparse(
    part: &mut Part,
    mask: &Mask,
    pattern: Pattern<'_>,
    complete: &[glob::Pattern],
) -> Vec<String> {
    let (mut notes, mut kept) = (Vec::new(), Vec::new());
    for channel in &mut part.channels {
        let name = channel.display_name();
        if complete.iter().any(|glob| glob.matches(&name)) {
            kept.push(name.into_owned());
            continue;
        }
        match &mut channel.samples {
            Samples::Half(values) => clear(values, mask, f16::ZERO),
            Samples::Float(values) => clear(values, mask, 0.0),
            Samples::Uint(values) => clear(values, mask, 0),
        }
    }
    let flags = mask.as_slice().iter().map(|&measured| if measured { f16::ONE } else { f16::ZERO });
    let channel =
        Channel { name: CHANNEL.into(), perceptually_linear: false, samples: Samples::Half(flags.collect()) };
    let at = part.channels.partition_point(|other| other.name < channel.name);
    part.channels.insert(at, channel);
    if part.attributes.get(mask::ATTRIBUTE).is_some() {
        part.attributes.set_text(mask::ATTRIBUTE, CHANNEL);
    }
    match pattern {
        Pattern::Shuffle { density, seed, frame } => {
            part.attributes.set_text(PATTERN, &format!("shuffle density={density}{}", of_frame(frame)));
            part.attributes.set_text(SEED, &seed.to_string());
        }
        Pattern::File { file, .. } => part.attributes.set_text(PATTERN, &format!("file:{}", file.path())),
        Pattern::Adaptive { settings, .. } => part.attributes.set_text(SEED, &settings.seed.to_string()),
        Pattern::Given { name, .. } => part.attributes.set_text(PATTERN, name),
    }
    let mut dropped = remove(&mut part.attributes, of_other_pixels().chain([DENSE]));
    // The list of complete channels is written anew.
    dropped.retain(|name| *name != DENSE || kept.is_empty());
    notes.extend(dropped_note(&dropped));
    if !kept.is_empty() {
        list_dense(part, kept.iter().map(|name| &**name));
    }
    notes.extend(make_writable(part, None));
    notes
}

/// Which frame a pattern is of, if it is one of a sequence.
fn of_frame(number: i64) -> String {
    if number == 0 { String::new() } else { format!(" frame={number}") }
}

fn clear<T: Copy>(values: &mut [T], mask: &Mask, zero: T) {
    for (value, _) in values.iter_mut().zip(mask.as_slice()).filter(|(_, measured)| !**measured) {
        *value = zero;
    }
}

#[cfg(test)]
#[path = "sparsify/tests.rs"]
mod tests;
