//! Where a mask comes from: which pixels of each part and channel were measured. And how one is made: [`generate`] (from
//! a pattern), [`after`] (from a filled frame), [`merge`] (of two renders), [`output`] (as a file), [`judge`] (how good it is).
//!
//! A mask is found as one or more providers: flags over a window of absolute pixels, for one view and
//! perhaps one layer. Each channel is served by its own layer's, its own part's, then its view's providers.
//!
//! In a channel a value of at least one half is measured, everything below and every NaN is missing; so a mask that
//! was filtered or compressed with loss still says what it meant.

pub mod after;
pub mod canvas;
mod cover;
pub mod crop;
mod empty;
mod error;
mod file;
mod filled;
mod find;
pub mod generate;
pub mod judge;
pub mod layers;
mod make_error;
mod matte;
pub mod merge;
pub mod output;
pub mod plot;
mod provider;
pub mod rounds;
pub(crate) mod shared;
mod source;
#[cfg(test)]
mod tests;

use std::sync::Arc;

pub use empty::{check_any, why_empty};
pub use error::Error;
pub use file::MaskFile;
pub use filled::{claimed_density, filled_before, filled_by};
pub use find::{beside_element, find, seems_complete, told};
use half::slice::HalfFloatSliceExt;
use lacuna_core::parallel::prelude::*;
use lacuna_exr::{Frame, Part, Samples};
use lacuna_filters::Mask;
pub use make_error::MakeError;
pub(crate) use matte::is_scattered;
pub use source::{Source, SourceError};

/// The attribute that names the mask channel of a part.
pub const ATTRIBUTE: &str = "lacuna/mask";
/// The attribute that names the filter of a part that was filled.
pub const FILTER: &str = "lacuna/filter";
/// The attribute that holds measured pixels over all pixels of a part that was filled.
pub const DENSITY: &str = "lacuna/density";
/// The attribute that holds the seed of a generated pattern, as text.
pub const SEED: &str = "lacuna/seed";
/// The attribute that says which pattern the mask is.
pub const PATTERN: &str = "lacuna/pattern";

/// The masks of one frame: for every part and channel the mask that serves it.
#[derive(Clone, Debug, Default)]
pub struct Masks {
    /// Per part, per channel: the mask over the part's data window, or `None` where none serves
    /// (such a channel must be `keep`). Equal masks are one allocation.
    pub channels: Vec<Vec<Option<Arc<Mask>>>>,
    /// Where the mask was found, for people and for the attribute `lacuna/mask`.
    pub origin: String,
    /// Per part: the channels that are sampling masks in use.
    pub mask_channels: Vec<Vec<usize>>,
    /// Per part, per channel: why no mask serves it.
    pub why_none: Vec<Vec<Option<String>>>,
    /// What a reader of the log should know about the mask.
    pub notes: Vec<String>,
}

impl Masks {
    /// The masks of a frame in which nothing is missing.
    pub fn complete(frame: &Frame) -> Self {
        let full = |part: &Part| {
            let mask = Arc::new(Mask::from_fn(part.size(), |_, _| true));
            vec![Some(mask); part.channels.len()]
        };
        let channels: Vec<_> = frame.parts.iter().map(full).collect();
        Self {
            mask_channels: vec![Vec::new(); channels.len()],
            why_none: channels.iter().map(|part| vec![None; part.len()]).collect(),
            channels,
            origin: "none".into(),
            notes: Vec::new(),
        }
    }

    /// The same channels as masks of a frame whose missing pixels were filled already, so that nothing is missing.
    #[must_use]
    pub fn filled(self, frame: &Frame) -> Self {
        let Self { channels, why_none, .. } = Self::complete(frame);
        Self { channels, why_none, ..self }
    }

    /// The mask of a channel.
    pub fn get(&self, part: usize, channel: usize) -> Option<&Arc<Mask>> {
        self.channels.get(part)?.get(channel)?.as_ref()
    }

    /// Whether the channel is a sampling mask in use.
    pub fn is_mask_channel(&self, part: usize, channel: usize) -> bool {
        self.mask_channels.get(part).is_some_and(|channels| channels.contains(&channel))
    }

    /// Whether the mask channels are counts of samples, of which some number makes a pixel measured.
    pub fn are_counts(&self) -> bool {
        self.origin.starts_with("count:")
    }

    /// The channels of a part that are nothing but masks: counts of samples tell more than that.
    pub fn droppable(&self, part: usize) -> &[usize] {
        let channels = self.mask_channels.get(part).filter(|_| !self.are_counts());
        channels.map_or(&[], Vec::as_slice)
    }

    /// Measured and all pixels over the different masks of one part.
    pub fn part_counts(&self, part: usize) -> (usize, usize) {
        let add = |sum: (usize, usize), mask: &Mask| (sum.0 + mask.count(), sum.1 + mask.as_slice().len());
        self.different(part).into_iter().fold((0, 0), add)
    }

    /// The different masks of one part.
    pub fn different(&self, part: usize) -> Vec<&Mask> {
        let mut seen: Vec<&Arc<Mask>> = Vec::new();
        for mask in self.channels.get(part).into_iter().flatten().flatten() {
            if !seen.iter().any(|other| Arc::ptr_eq(other, mask)) {
                seen.push(mask);
            }
        }
        seen.into_iter().map(|mask| &**mask).collect()
    }

    /// The pixels of a part that were measured in any channel; nothing if it has no mask.
    pub fn any(&self, part: usize) -> Option<Arc<Mask>> {
        let mut all = self.channels.get(part).into_iter().flatten().flatten();
        let first = all.next()?;
        if all.all(|other| Arc::ptr_eq(first, other)) {
            return Some(Arc::clone(first));
        }
        let masks = self.different(part);
        let any = |row: usize, column: usize| masks.iter().any(|mask| mask.is_measured(row, column));
        Some(Arc::new(Mask::from_fn(first.size(), any)))
    }

    /// The different masks of each part.
    pub fn of_parts(&self) -> impl Iterator<Item = &Mask> {
        (0..self.channels.len()).flat_map(|part| self.different(part))
    }

    /// Measured pixels over all pixels of one part; nothing where no mask serves it.
    pub fn part_density(&self, part: usize) -> Option<f64> {
        let (measured, all) = self.part_counts(part);
        (all > 0).then(|| measured as f64 / all as f64)
    }

    /// Measured pixels over all pixels of the frame; nothing where no mask serves any part.
    pub fn density(&self) -> Option<f64> {
        let counts = (0..self.channels.len()).map(|part| self.part_counts(part));
        let (measured, all) = counts.fold((0, 0), |sum, count| (sum.0 + count.0, sum.1 + count.1));
        (all > 0).then(|| measured as f64 / all as f64)
    }

    /// Whether every mask is full: there is nothing to fill.
    pub fn is_full(&self) -> bool {
        self.all().all(|mask| mask.is_full())
    }

    /// Whether no pixel at all was measured.
    pub fn is_empty(&self) -> bool {
        self.all().all(|mask| mask.is_empty())
    }

    fn all(&self) -> impl Iterator<Item = &Arc<Mask>> {
        self.channels.iter().flatten().flatten()
    }
}

/// Pixels that one task takes.
const PIECE: usize = 1 << 14;

/// The pixels of a channel whose value says so.
fn flags(samples: &Samples, measured: impl Fn(f64) -> bool + Sync) -> Vec<bool> {
    fn each<T: Copy + Sync>(values: &[T], flags: &mut [bool], measured: impl Fn(T) -> bool + Sync) {
        let pieces = flags.par_chunks_mut(PIECE).zip(values.par_chunks(PIECE));
        pieces.for_each(|(flags, values)| {
            flags.iter_mut().zip(values).for_each(|(flag, &value)| *flag = measured(value));
        });
    }
    let mut flags = vec![false; samples.len()];
    match samples {
        Samples::Half(values) => {
            let pieces = flags.par_chunks_mut(PIECE).zip(values.par_chunks(PIECE));
            pieces.for_each_init(Vec::new, |floats, (flags, values)| {
                floats.resize(values.len(), 0.0);
                values.convert_to_f32_slice(floats);
                flags.iter_mut().zip(floats).for_each(|(flag, value)| *flag = measured(f64::from(*value)));
            });
        }
        Samples::Float(values) => each(values, &mut flags, |value| measured(f64::from(value))),
        Samples::Uint(values) => each(values, &mut flags, |value| measured(f64::from(value))),
    }
    flags
}
