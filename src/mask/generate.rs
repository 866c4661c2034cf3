//! Masks and rank images from nothing but a window: a pattern, narrowed to a region, with pixels that are always in.

use std::path::Path;

use lacuna_exr::{Frame, Limits, Part, Samples, Window};
use lacuna_filters::sampling::{self, Band, Field, Order, Pattern, Temporal, shuffle};
use lacuna_filters::{Mask, Size};

use super::file::Content;
use super::{Error, MakeError, MaskFile};

/// A mask that is asked for.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Request {
    /// The pixels, in absolute coordinates.
    pub window: Window,
    /// How they are chosen.
    pub pattern: Pattern,
    /// Measured pixels over all pixels (of the region), 0 to 1.
    pub density: f64,
    /// Which pattern.
    pub seed: u64,
    /// How the masks of frames are related.
    pub temporal: Temporal,
    /// Each pixel comes with its right and its lower neighbour; the density counts them all.
    pub paired: bool,
}

impl Request {
    /// Whether the pattern has what is asked of it: an order, for pairs and for the image of its ranks.
    ///
    /// # Errors
    /// A pattern that is not progressive.
    pub fn check(&self, rank: bool) -> Result<(), MakeError> {
        let name = self.pattern.name();
        let lacks = match (rank, self.paired) {
            _ if self.pattern.is_progressive() => return Ok(()),
            (true, _) => "no rank image",
            (_, true) => "no pairs",
            _ => return Ok(()),
        };
        Err(MakeError::Other(format!(
            "the pattern {name} is not progressive: it has {lacks}; use shuffle, blue-noise or random"
        )))
    }
}

/// Pixels that are in or out whatever the pattern says.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Bounds {
    /// Only these; all if nothing.
    pub inside: Option<Mask>,
    /// These as well, also where they are not inside.
    pub always: Option<Mask>,
    /// The outermost so many pixels of the window as well.
    pub border: usize,
}

/// The place of a pixel in the order in which a list names it, 0 to 1.
pub type Rank<'a> = Box<dyn Fn(usize, usize) -> f64 + Sync + 'a>;

/// The field that a window is.
pub fn field(window: Window) -> Field {
    Field { x: window.x_min, y: window.y_min, size: window.size() }
}

impl Bounds {
    /// Whether nothing is bound.
    pub fn is_empty(&self) -> bool {
        self.inside.is_none() && self.always.is_none() && self.border == 0
    }

    /// Whether a pixel is in whatever the pattern says.
    pub fn forces(&self, size: Size, row: usize, column: usize) -> bool {
        let edge = row.min(size.height - 1 - row).min(column).min(size.width - 1 - column);
        edge < self.border || self.always.as_ref().is_some_and(|mask| mask.is_measured(row, column))
    }

    /// Whether the pattern decides about a pixel that is not forced.
    pub fn admits(&self, row: usize, column: usize) -> bool {
        self.inside.as_ref().is_none_or(|mask| mask.is_measured(row, column))
    }

    /// The mask within the bounds.
    pub fn apply(&self, mask: Mask) -> Mask {
        if self.is_empty() {
            return mask;
        }
        let size = mask.size();
        Mask::from_fn(size, |row, column| {
            self.forces(size, row, column) || mask.is_measured(row, column) && self.admits(row, column)
        })
    }
}

/// The mask of a frame.
///
/// # Errors
/// A density outside 0 to 1, or of no pixel; `complementary` with a pattern that is not progressive.
pub fn generate(request: &Request, frame: i64, bounds: &Bounds) -> Result<Mask, MakeError> {
    let Request { window, pattern, density, seed, temporal, paired } = *request;
    let size = window.size();
    request.check(false)?;
    let mask = if paired {
        sampling::paired::mask(size, density, order(request, frame))?
    } else {
        sampling::mask(pattern, field(window), density, seed, temporal, frame)?
    };
    let mask = bounds.apply(mask);
    super::check_any(&mask).map_err(MakeError::Other)?;
    Ok(mask)
}

/// The order of a frame's pixels; for patterns without one that of the shuffle, which spreads any prefix of a list.
pub fn order(request: &Request, frame: i64) -> Rank<'static> {
    let field = field(request.window);
    let offset = if request.temporal == Temporal::Offset { frame } else { 0 };
    let step = if request.temporal == Temporal::Complementary { frame } else { 0 };
    let start = Band::of_frame(request.density, step).start();
    match Order::new(request.pattern, field, request.seed, offset) {
        Some(order) => Box::new(move |row, column| (order.rank(row, column) - start).rem_euclid(1.0)),
        None => shuffled(field, request.seed),
    }
}

/// The shuffle's order of a field.
pub fn shuffled(field: Field, seed: u64) -> Rank<'static> {
    Box::new(move |row, column| {
        let (x, y) = field.at(row, column);
        shuffle::rank(x, y, seed)
    })
}

/// The rank image of a frame, row by row: `rank < D` is the mask of every density D, within the bounds.
///
/// Forced pixels have rank 0, those that are not admitted 1. Rounded down to f32, so that a rank below D stays below.
///
/// # Errors
/// A pattern that is not progressive.
pub fn ranks(request: &Request, frame: i64, bounds: &Bounds) -> Result<Vec<f32>, MakeError> {
    request.check(true)?;
    let (rank, size) = (order(request, frame), request.window.size());
    let value = |row: usize, column: usize| {
        if bounds.forces(size, row, column) {
            0.0
        } else if bounds.admits(row, column) {
            below(rank(row, column))
        } else {
            1.0
        }
    };
    let mut ranks = vec![0.0; size.pixels()];
    if size.width > 0 {
        use lacuna_core::parallel::prelude::*;
        ranks.par_chunks_mut(size.width).enumerate().for_each(|(row, ranks)| {
            ranks.iter_mut().enumerate().for_each(|(column, rank)| *rank = value(row, column));
        });
    }
    Ok(ranks)
}

/// The largest f32 that is not above a value of [0, 1).
fn below(value: f64) -> f32 {
    let near = value as f32;
    if f64::from(near) > value { near.next_down() } else { near }
}

/// The pixels of `window` where an image is above 0: a channel of an EXR file (by default `mask`, else `A`, else the only
/// one) by absolute coordinates, nothing outside its data window; or a PNG image of the window's size.
///
/// # Errors
/// A file that cannot be read or does not fit.
pub fn region(path: &str, channel: Option<&str>, window: Window, limits: Limits) -> Result<Mask, MakeError> {
    let fail = |why: String| MakeError::Other(format!("{path}: {why}"));
    let file = MaskFile::read(Path::new(path), limits).map_err(|error| fail(reason(error)))?;
    match file.content(channel).map_err(|error| fail(reason(error)))? {
        Content::Exr(frame) => of_frame(frame, channel, window).map_err(fail),
        Content::Grey { size, values, .. } if *size == window.size() => {
            Mask::new(*size, values.iter().map(|&value| value > 0).collect())
                .map_err(|error| fail(error.to_string()))
        }
        Content::Grey { size, .. } => Err(fail(format!("has {size} pixels, the mask has {}", window.size()))),
    }
}

/// A mask file as it stands, by the rules of filling.
///
/// # Errors
/// A file that cannot be read.
pub fn load(path: &str, channel: Option<&str>, limits: Limits) -> Result<Mask, MakeError> {
    let file = MaskFile::read(Path::new(path), limits);
    file.and_then(|file| file.mask(channel)).map_err(|error| MakeError::Other(reason(error)))
}

/// What is wrong with a file, which whoever asked for it names.
fn reason(error: Error) -> String {
    match error {
        Error::File { why, .. } => why,
        other => other.to_string(),
    }
}

/// A channel by its name, else `mask`, else `A`, else the only one.
fn pick<'a>(frame: &'a Frame, channel: Option<&str>) -> Result<(&'a Part, &'a Samples), String> {
    let named = |wanted: &str| {
        let mut all = frame.parts.iter().flat_map(|part| part.channels.iter().map(move |c| (part, c)));
        all.find(|(_, channel)| channel.display_name() == wanted)
    };
    let only = || match frame.parts.as_slice() {
        [part] if part.channels.len() == 1 => Some((part, &part.channels[0])),
        _ => None,
    };
    let found = match channel {
        Some(name) => named(name).ok_or_else(|| format!("has no channel '{name}'"))?,
        None => named("mask").or_else(|| named("A")).or_else(only).ok_or("name a channel: FILE:CHANNEL")?,
    };
    Ok((found.0, &found.1.samples))
}

fn of_frame(frame: &Frame, channel: Option<&str>, window: Window) -> Result<Mask, String> {
    let (part, samples) = pick(frame, channel)?;
    let (own, above) = (part.data_window, super::flags(samples, |value| value > 0.0));
    let size = own.size();
    Ok(Mask::from_fn(window.size(), |row, column| {
        let y = i64::from(window.y_min) + row as i64 - i64::from(own.y_min);
        let x = i64::from(window.x_min) + column as i64 - i64::from(own.x_min);
        let (y, x) = (usize::try_from(y).unwrap_or(usize::MAX), usize::try_from(x).unwrap_or(usize::MAX));
        y < size.height && x < size.width && above[y * size.width + x]
    }))
}

#[cfg(test)]
#[path = "generate/tests.rs"]
mod tests;
