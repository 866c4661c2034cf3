//! Limiter: keeps missing pixels within reach of the measured ones around them.
//!
//! Splines overshoot beside a highlight, in a logarithmic domain too: by a factor then. This runs last, in the linear
//! domain, on missing pixels only. [`local`] can be switched off, and gives way to [`whole`] where guides gained; [`range`] states what always holds.
//!
//! [`local`]: with `[a, b]` the range of the measured pixels around a missing one, it is moved into `[lo, hi]` if it is
//! outside:
//!
//! - a channel without negative values to speak of (colour, alpha): `lo = a / 2`, `hi = 2 b`; where a or b is negative
//!   the factor goes the other way, so that the bounds always enclose `[a, b]`;
//! - a signed channel (positions, normals), which is one whose smallest measured value is below -1/64 of its largest:
//!   `lo = a - c`, `hi = b + c` with `c = (b - a) / 2 + (B - A) / 16`, `[A, B]` being the range of the whole plane.
//!
//! `on_black`: contours on black that clustered samples leave.
//!
//! Around means in the disc of radius R about the pixel, its rim included. R is 8, and larger in sparse planes:
//! `2 / sqrt(density)`, at most 64, about 12 measured pixels. Of a channel without negative values, `a` is nevertheless that of
//! the disc of radius 8 if anything was measured there: nothing gets darker than half the darkest measured pixel near it.
//! A disc without any measured pixel takes the bounds of the whole plane, `a = A`, `b = B`. A reconstruction within its
//! bounds keeps every bit. A value that is not a number becomes lo.
//!
//! Algorithm: a disc is a stack of chords. Minima of a row over windows that grow by a pixel to either side give, one width
//! after the other, the chords of the discs around the pixels of the rows above and below. Minima do not depend on the
//! order, so that strips and threads change nothing.
//! Where a small block of pixels is within the bounds that its own measured pixels give, nothing is searched.
//! Cost: two passes over the plane; where pixels are moved, about 6 R comparisons per pixel for each bound, in vectors, twice
//! in sparse planes; O(R W) scratch per thread.
//! Fails: a true highlight that no sample hit is held down to twice its surroundings, a true shadow up to half of them.

use std::ops::Range;

use lacuna_core::parallel::prelude::*;

use crate::kernel::Isa;
use crate::kernel::extremes::{least, range as extremes};
use crate::kernel::minima::outside;
use crate::{Error, Mask, Plane, Size};

mod blocks;
mod disc;
mod moved;
mod ringing;

pub use moved::Moved;
pub(crate) use ringing::on_black;

/// The disc in which the darkest measured pixel counts, at any density; its radius in pixels.
const NEAR: usize = 8;

/// Moves missing pixels of `out` that are out of reach of the measured pixels around them, see the head of this file.
///
/// `samples` holds finite values at measured pixels; what it holds elsewhere is not read. Measured pixels of `out`
/// are neither read nor changed. Returns which pixels were moved: how many, and how far.
///
/// # Errors
/// [`Error::SizeMismatch`] and [`Error::EmptyMask`].
pub fn local(mask: &Mask, samples: &Plane, out: &mut Plane) -> Result<Moved, Error> {
    let size = check(mask, samples, out)?;
    let bounds = Bounds::new(extremes(mask.as_slice(), samples.pixels()));
    let radius = radius(mask.density());
    let block = blocks::side(if bounds.margin.is_some() { radius } else { NEAR });
    // Tall strips share more work, flat ones fit the cache and give every thread some.
    let rows = radius.next_multiple_of(block) * 2;
    let strips = out.pixels_mut().par_chunks_mut(size.width * rows).enumerate();
    let counts = strips.map(|(strip, out)| {
        let first = strip * rows;
        let suspects = blocks::suspects(&bounds, (mask, samples), first, out, (block, 2 * radius));
        let rows = first..first + out.len() / size.width;
        let search = |columns: Range<usize>| {
            let discs = |radius| disc::Ranges::new((mask, samples), rows.clone(), columns.clone(), radius);
            let mut ranges = discs(radius);
            if radius > NEAR && bounds.margin.is_none() {
                ranges.raise(&discs(NEAR));
            }
            let mut moved = Moved::default();
            for ((y, row), out) in rows.clone().enumerate().zip(out.chunks_mut(size.width)) {
                let (low, high) = ranges.row_mut(y);
                bounds.widen(low, high);
                moved += limit_row(&mask.row(row)[columns.clone()], low, high, &mut out[columns.clone()]);
            }
            moved
        };
        suspects.into_iter().map(search).sum::<Moved>()
    });
    Ok(counts.into_iter().sum())
}

/// The same by the range of all measured pixels: for what knows more of a pixel than the samples around it show.
///
/// # Errors
/// [`Error::SizeMismatch`] and [`Error::EmptyMask`].
pub fn whole(mask: &Mask, samples: &Plane, out: &mut Plane) -> Result<Moved, Error> {
    let size = check(mask, samples, out)?;
    let (lowest, highest) = extremes(mask.as_slice(), samples.pixels());
    let (mut bottom, mut top) = (vec![lowest; size.width], vec![highest; size.width]);
    Bounds::new((lowest, highest)).widen(&mut bottom, &mut top);
    Ok(within(mask, (&bottom, &top), out))
}

/// Keeps what is true of all measured pixels true of the missing ones, as far as the bounds ask for it: light that is nowhere negative
/// stays so, alpha stays within [0, 1]. Returns how many missing pixels were moved, and how far.
///
/// # Errors
/// [`Error::SizeMismatch`] and [`Error::EmptyMask`].
pub fn range(mask: &Mask, samples: &Plane, out: &mut Plane, bounds: crate::Bounds) -> Result<Moved, Error> {
    let size = check(mask, samples, out)?;
    let (low, high) = bounds.around(extremes(mask.as_slice(), samples.pixels()));
    if low == f32::NEG_INFINITY {
        return Ok(Moved::default());
    }
    Ok(within(mask, (&vec![low; size.width], &vec![high.min(f32::MAX); size.width]), out))
}

/// Moves every missing pixel of `out` into these bounds, the same for each row.
fn within(mask: &Mask, (bottom, top): (&[f32], &[f32]), out: &mut Plane) -> Moved {
    let width = mask.size().width;
    let rows = out.pixels_mut().par_chunks_mut(width).zip(mask.as_slice().par_chunks(width));
    rows.map(|(out, flags)| limit_row(flags, bottom, top, out)).into_iter().sum()
}

/// Per pixel of a plane that is complete, the values that [`local`] would allow for the range of the 3 x 3 pixels around
/// it: the least and the greatest.
pub(crate) fn around(samples: &Plane) -> [Plane; 2] {
    let size = samples.size();
    let bounds = Bounds::new(extremes(&vec![true; size.pixels()], samples.pixels()));
    let (mut low, mut high) = (samples.clone(), samples.clone());
    let width = size.width.max(1);
    let rows = low.pixels_mut().par_chunks_mut(width).zip(high.pixels_mut().par_chunks_mut(width));
    rows.enumerate().for_each(|(y, (low, high))| {
        let columns = |pick: fn(f32, f32) -> f32| -> Vec<f32> {
            let near = y.saturating_sub(1)..size.height.min(y + 2);
            (0..size.width)
                .map(|x| near.clone().map(|row| samples.at(row, x)).fold(samples.at(y, x), pick))
                .collect()
        };
        for (row, pick) in [(&mut *low, f32::min as fn(f32, f32) -> f32), (&mut *high, f32::max)] {
            let columns = columns(pick);
            for (x, out) in row.iter_mut().enumerate() {
                let near = &columns[x.saturating_sub(1)..size.width.min(x + 2)];
                *out = near.iter().copied().fold(columns[x], pick);
            }
        }
        bounds.widen(low, high);
    });
    [low, high]
}

/// Sizes agree and something was measured.
fn check(mask: &Mask, samples: &Plane, out: &Plane) -> Result<Size, Error> {
    let size = mask.size();
    for found in [samples.size(), out.size()] {
        if found != size {
            return Err(Error::SizeMismatch { expected: size, found: found.to_string() });
        }
    }
    mask.require_samples().map(|()| size)
}

/// The radius of the disc in which measured pixels count.
fn radius(density: f64) -> usize {
    ((2.0 / density.sqrt()).ceil() as usize).clamp(NEAR, 64)
}

/// From the range of the measured pixels around to the values allowed.
struct Bounds {
    whole: (f32, f32),
    /// For a signed channel, the part of the margin that is the same everywhere.
    margin: Option<f32>,
}

impl Bounds {
    fn new(whole: (f32, f32)) -> Self {
        // Halves and sixteenths before differences, so that nothing overflows.
        let signed = whole.0 < -whole.1 / 64.0;
        Self { whole, margin: signed.then(|| whole.1 / 16.0 - whole.0 / 16.0) }
    }

    /// Turns ranges of measured pixels into the values allowed; an empty range has its low above its high.
    fn widen(&self, low: &mut [f32], high: &mut [f32]) {
        // Two loops, so that each runs in vectors.
        if let Some(margin) = self.margin {
            self.each(low, high, |low, high| {
                let margin = margin + (0.5 * high - 0.5 * low);
                (low - margin, high + margin)
            });
        } else {
            self.each(low, high, |low, high| {
                (low * if low < 0.0 { 2.0 } else { 0.5 }, high * if high < 0.0 { 0.5 } else { 2.0 })
            });
        }
    }

    fn each(&self, low: &mut [f32], high: &mut [f32], rule: impl Fn(f32, f32) -> (f32, f32)) {
        for (low, high) in low.iter_mut().zip(high) {
            let empty = *low > *high;
            let from = if empty { self.whole.0 } else { *low };
            let to = if empty { self.whole.1 } else { *high };
            let (bottom, top) = rule(from, to);
            (*low, *high) = (-least(-bottom, f32::MAX), least(top, f32::MAX));
        }
    }
}

/// Moves the missing pixels of one row into their bounds.
fn limit_row(flags: &[bool], bottom: &[f32], top: &[f32], out: &mut [f32]) -> Moved {
    // Looking runs in vectors and finds nothing in most rows.
    if !outside(Isa::best(), flags, (bottom, top), out) {
        return Moved::default();
    }
    let bounds = bottom.iter().zip(top);
    let moves = out.iter_mut().zip(flags).zip(bounds);
    moves.map(|((value, flag), (bottom, top))| limit(value, *bottom, *top, *flag)).sum()
}

/// Moves a value into `[bottom, top]` unless it is `kept`. NaN becomes `bottom`.
fn limit(value: &mut f32, bottom: f32, top: f32, kept: bool) -> Moved {
    let inside = if *value >= bottom { *value } else { bottom };
    let inside = least(inside, top);
    // Compared as bits: NaN is not equal to itself, and a zero of either sign is inside a bound of zero.
    let outside = !kept & (inside.to_bits() != value.to_bits());
    let free = *value;
    *value = if outside { inside } else { free };
    if outside { Moved::from_to(free, inside) } else { Moved::default() }
}

#[cfg(test)]
mod tests;
