//! Push-pull: each hole takes the mean of its measured surroundings, found in a pyramid.
//!
//! Given samples `y` at the pixels where the mask `m` is 1 (`H x W`, row-major), level 0 is `(y, m)`;
//! level k+1 is the weighted 2x2 mean of level k, its weight min(1, sum of the four). Coming back up, a pixel
//! keeps `w` of itself and takes `1 - w` of the bilinear sample one level above. As `m` is 0 or 1, so is every
//! weight, and a pixel is either kept or taken from above: the pyramid holds the weights of all levels.
//!
//! Boundary: an odd last row or column forms blocks of its own; the bilinear sample repeats the border.
//! Exact on constants; not on ramps. The result lies within the range of the samples, to the bit: means are
//! taken in f64, and the bilinear weights 3/4 and 1/4 as `a + (b/4 - a/4)`, which neither overflows nor overshoots.
//! Cost: 8/3 passes over the plane, 4/3 planes of scratch. No settings, no iterations.
//! Fails: visible blocks in gaps wider than about 16 pixels; use [`crate::variational::ss`] there.
//!
//! Source: S. Gortler, R. Grzeszczuk, R. Szeliski, M. Cohen, "The Lumigraph", SIGGRAPH 1996 (rebinning).

use std::sync::Arc;

use lacuna_core::parallel::prelude::*;

use crate::descriptor::Kind;
use crate::descriptor::{Configured, Descriptor, Memory, Takes};
use crate::kernel::Isa;
use crate::kernel::pyramid::{self, Pull};
use crate::{Error, Filter, Mask, Outcome, Plan, Plane, Planes, Problem, Run, Size, check};

/// No settings.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Settings;

/// What is to be known of it.
pub static DESCRIPTOR: Descriptor = Descriptor {
    name: "pushpull",
    help: "Push-pull pyramid: fast and plain",
    settings: &[],
    even: Memory { image: 20, channel: 4 },
    uneven: Memory { image: 88, channel: 4 },
    takes: Takes::NOTHING,
    restores: false,
    held_out: Some(Kind::Distance),
    new: || Box::new(Settings),
};

impl Configured for Settings {
    fn descriptor(&self) -> &'static Descriptor {
        &DESCRIPTOR
    }

    fn boxed(&self) -> Box<dyn Configured> {
        Box::new(*self)
    }
}

impl Filter for Settings {
    fn plan(&self, problem: &Problem, _run: &Run<'_>) -> Result<Box<dyn Plan>, Error> {
        Ok(Box::new(Planned { pyramid: Pyramid::new(&problem.mask)?, mask: problem.mask.clone() }))
    }
}

/// Pixels that one task takes.
const PIECE: usize = 1 << 14;

/// Gives those of the `wanted` pixels that are not finite what push-pull makes of the samples.
pub(crate) fn complete(
    out: &mut Planes,
    (mask, wanted): (&Arc<Mask>, &Mask),
    samples: &Planes,
    run: &Run<'_>,
) -> Result<(), Error> {
    let lacks = |plane: &Plane| {
        let pieces = plane.pixels().par_chunks(PIECE).zip(wanted.as_slice().par_chunks(PIECE));
        !pieces.all(|(values, wanted)| {
            !values.iter().zip(wanted).any(|(value, wanted)| *wanted & !value.is_finite())
        })
    };
    if !out.as_slice().iter().any(lacks) {
        return Ok(());
    }
    let mut plain = Planes::zeros(samples.size(), samples.len());
    Settings.plan(&Problem::fill(Arc::clone(mask)), run)?.reconstruct(samples, &mut plain, run)?;
    for (out, plain) in out.as_mut_slice().iter_mut().zip(plain.as_slice()) {
        let pieces = out.pixels_mut().par_chunks_mut(PIECE).zip(plain.pixels().par_chunks(PIECE));
        pieces.for_each(|(out, plain)| {
            let pairs = out.iter_mut().zip(plain).filter(|(value, _)| !value.is_finite());
            pairs.for_each(|(value, plain)| *value = *plain);
        });
    }
    Ok(())
}

struct Planned {
    mask: std::sync::Arc<Mask>,
    pyramid: Pyramid,
}

impl Plan for Planned {
    fn reconstruct(&self, samples: &Planes, out: &mut Planes, _run: &Run<'_>) -> Result<Outcome, Error> {
        check::group(&self.mask, samples, out)?;
        let mut scratch = Scratch::default();
        for (samples, out) in samples.as_slice().iter().zip(out.as_mut_slice()) {
            self.pyramid.fill_into(&self.mask, samples.pixels(), out.pixels_mut(), &mut scratch);
        }
        Ok(Outcome::direct())
    }
}

/// The pixels of one level for which a mean of measured pixels exists.
struct Level {
    size: Size,
    known: Vec<bool>,
}

/// What push-pull knows of a mask: the levels above the image, finest first, up to a single pixel.
pub(crate) struct Pyramid {
    levels: Vec<Level>,
}

/// The values of the levels above the image; one serves any number of planes in turn.
#[derive(Default)]
pub(crate) struct Scratch {
    levels: Vec<Vec<f32>>,
}

impl Pyramid {
    /// Weights of all levels.
    ///
    /// # Errors
    /// [`Error::EmptyMask`].
    pub(crate) fn new(mask: &Mask) -> Result<Self, Error> {
        mask.require_samples()?;
        let mut levels: Vec<Level> = Vec::new();
        let mut size = mask.size();
        while size.height > 1 || size.width > 1 {
            let known = levels.last().map_or(mask.as_slice(), |level| level.known.as_slice());
            let next = Level { size: halved(size), known: any_of_four(size, known) };
            size = next.size;
            levels.push(next);
        }
        Ok(Self { levels })
    }

    /// Fills `out` from `samples`, both row-major and of the size of `mask`, the mask this pyramid was made for.
    /// Values of `samples` at missing pixels are not used.
    pub(crate) fn fill_into(&self, mask: &Mask, samples: &[f32], out: &mut [f32], scratch: &mut Scratch) {
        scratch.levels.resize_with(self.levels.len(), Vec::new);
        let (mut size, mut known, mut values) = (mask.size(), mask.as_slice(), samples);
        for (level, above) in self.levels.iter().zip(&mut scratch.levels) {
            above.resize(level.size.pixels(), 0.0);
            push(size, known, values, above);
            (size, known, values) = (level.size, &level.known, above);
        }
        for index in (1..self.levels.len()).rev() {
            let (finer, coarser) = scratch.levels.split_at_mut(index);
            let level = &self.levels[index - 1];
            pull(level.size, &level.known, None, &mut finer[index - 1], &coarser[0]);
        }
        match scratch.levels.first() {
            Some(above) => pull(mask.size(), mask.as_slice(), Some(samples), out, above),
            None => out.copy_from_slice(samples),
        }
    }
}

/// The plane that push-pull makes of `samples`, for instance as the start of an iteration.
///
/// `samples` has the size of `mask`; what it holds at missing pixels is not used. A mask without a measured
/// pixel gives zeros.
pub fn fill(mask: &Mask, samples: &Plane) -> Plane {
    let mut out = Plane::filled(mask.size(), 0.0);
    if let Ok(pyramid) = Pyramid::new(mask) {
        pyramid.fill_into(mask, samples.pixels(), out.pixels_mut(), &mut Scratch::default());
    }
    out
}

/// Size of the level above.
fn halved(size: Size) -> Size {
    Size::new(size.height.div_ceil(2), size.width.div_ceil(2))
}

/// Rows that one task takes: enough pixels to be worth a task. Every pixel is computed by itself, so that this
/// does not change a bit.
fn rows_per_task(width: usize) -> usize {
    16_384_usize.div_ceil(width.max(1))
}

/// For each 2x2 block, whether any of its pixels is known.
fn any_of_four(size: Size, known: &[bool]) -> Vec<bool> {
    let above = halved(size);
    let mut any = vec![false; above.pixels()];
    any.par_chunks_mut(above.width).with_min_len(rows_per_task(size.width)).enumerate().for_each(
        |(y, any)| {
            for row in known[2 * y * size.width..].chunks(size.width).take(2) {
                for (any, block) in any.iter_mut().zip(row.chunks(2)) {
                    *any |= block[0] | block[block.len() - 1];
                }
            }
        },
    );
    any
}

/// One level down the image size: the mean of the known among each 2x2 block, 0 where there is none.
fn push(size: Size, known: &[bool], values: &[f32], above: &mut [f32]) {
    let (width, isa) = (halved(size).width, Isa::best());
    above.par_chunks_mut(width).with_min_len(rows_per_task(size.width)).enumerate().for_each(|(y, above)| {
        let row = |y: usize| {
            let range = y * size.width..(y + 1) * size.width;
            (&known[range.clone()], &values[range])
        };
        let (upper_known, upper) = row(2 * y);
        if 2 * y + 1 < size.height {
            let (lower_known, lower) = row(2 * y + 1);
            pyramid::push(isa, above, [upper_known, lower_known], [upper, lower]);
        } else {
            pyramid::push(isa, above, [upper_known], [upper]);
        }
    });
}

/// One level up the image size: unknown pixels of `values` take the bilinear sample of `above`. With `samples`, the
/// known pixels are copied from there first.
fn pull(size: Size, known: &[bool], samples: Option<&[f32]>, values: &mut [f32], above: &[f32]) {
    let (coarse, isa) = (halved(size), Isa::best());
    let per_task = rows_per_task(size.width);
    values.par_chunks_mut(size.width * per_task).enumerate().for_each(|(task, rows)| {
        let mut between = vec![0.0; coarse.width + 2];
        for (row, values) in rows.chunks_mut(size.width).enumerate() {
            let y = task * per_task + row;
            let own = y * size.width..(y + 1) * size.width;
            let known = &known[own.clone()];
            let samples = samples.map(|samples| &samples[own]);
            let near = &above[y / 2 * coarse.width..][..coarse.width];
            let far = &above[neighbour(y, coarse.height) * coarse.width..][..coarse.width];
            pyramid::pull(isa, Pull { values, known, samples, near, far, between: &mut between });
        }
    });
}

/// The second of the two coarse rows or columns between which the centre of the fine one `at` lies; the border
/// repeats itself.
fn neighbour(at: usize, coarse: usize) -> usize {
    if at.is_multiple_of(2) { (at / 2).saturating_sub(1) } else { (at / 2 + 1).min(coarse - 1) }
}

#[cfg(test)]
mod tests;
