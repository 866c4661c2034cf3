//! The filters `dictionary` and `dct`: missing pixels from the few atoms that explain a block's measured ones.
//!
//! Of each block `y = D x` of `n` numbers, some are known, `S y`. Its code is
//!
//! ```text
//! min_x |x|_0   subject to   S D x = S y        (equation 4.2 of the thesis)
//! ```
//!
//! by orthogonal matching pursuit; the block is `D x`, the image the mean of its blocks ([`super::blocks`]), and measured pixels
//! keep their bits.
//!
//! - `dictionary`: a learned dictionary over one channel, which every channel is filled with alone, or over all of them together.
//! - `dct`: [`super::dct`] over each channel alone.
//!
//! Boundary: the last blocks end with the image; one that is smaller than a block lies in the first corner of one. Blocks without a
//! measured pixel say nothing; pixels that no other block covers are filled by push-pull.
//!
//! Where many blocks have the same measured pixels (a periodic mask, or none missing) they share a Gram matrix
//! ([`super::pursuit`]); the others step together (`masked`).
//!
//! Source: X. Liu, "Compressive Volume Rendering", sections 3.2 and 4.1. Settings:
//! - `sparsity`: 1 or more, default 30: atoms of a block at most, and never more than a third of its measured values. Larger follows
//!   the samples closer.
//! - `error`: 0 or more, default 0, the unit of the (mapped) values: the root of the mean squared error of a block's measured
//!   values at which no more atoms are taken. Larger is smoother.
//! - `stride`: 1 to the block, default half of it; the block itself reproduces the thesis. Smaller is better and slower.
//! - `restore`: measured pixels leave as approximated, too; default off.
//!
//! Cost: `n K` multiplications an atom and block. Memory: the blocks of a part of the image, and 4 `K^2` bytes for each mask that many
//! blocks share.
//! Fails: with fewer than some ten measured values a block the pursuit has little to go by, and strides near the block show
//! seams; [`crate::variational::ss`] is better there.

mod settings;
pub use settings::{COSINES, Cosines, LEARNED, Learned, Use};
#[cfg(test)]
mod tests;

use std::sync::Arc;

use lacuna_core::parallel::prelude::*;
use ndarray::Array2;
use ndarray::linalg::general_mat_mul;

use super::blocks::{Average, Grid};
use super::masked::{Masked, TOGETHER};
use super::pursuit::{Code, Scratch, Selection, Shared};
use super::{Dictionary, dct};
use crate::baseline::push_pull;
use crate::{Error, Filter, Mask, Outcome, Plan, Plane, Planes, Problem, Run, check};

/// The part of an atom's squared length that must lie on measured values.
const FLOOR: f32 = 1e-3;
/// Gram matrices that a plan keeps.
const MOST_SHARED: usize = 4;
/// Parts of an image that are in memory at once.
const WAVE: usize = 8;

impl Filter for Learned {
    fn plan(&self, problem: &Problem, _run: &Run<'_>) -> Result<Box<dyn Plan>, Error> {
        let dictionary = self.dictionary.as_ref().ok_or(Error::NoDictionary)?;
        Ok(Box::new(Planned::new(Arc::clone(dictionary), self.how, problem)?))
    }
}

impl Filter for Cosines {
    fn plan(&self, problem: &Problem, _run: &Run<'_>) -> Result<Box<dyn Plan>, Error> {
        let dictionary = dct::dictionary(self.block, self.atoms);
        let dictionary = dictionary.map_err(|error| {
            Error::setting("block or atoms", &error, "blocks of 1 to 64, 1 to 16384 atoms")
        })?;
        Ok(Box::new(Planned::new(Arc::new(dictionary), self.how, problem)?))
    }
}

/// What depends on the mask alone.
struct Planned {
    dictionary: Arc<Dictionary>,
    how: Use,
    mask: Arc<Mask>,
    grid: Grid,
    /// Which of `shared` each block has; blocks without are coded together.
    group: Vec<Option<usize>>,
    shared: Vec<Shared>,
}

impl Planned {
    fn new(dictionary: Arc<Dictionary>, how: Use, problem: &Problem) -> Result<Self, Error> {
        check::at_least_one("sparsity", how.sparsity)?;
        check::not_negative("error", how.error)?;
        how.check(dictionary.block())?;
        let stride = how.stride.unwrap_or(dictionary.block().div_ceil(2));
        let mask = Arc::clone(&problem.mask);
        mask.require_samples()?;
        let grid = Grid::new(mask.size(), dictionary.block(), stride);
        let (group, shared) = share(&dictionary, &mask, &grid, how.sparsity);
        Ok(Self { dictionary, how, mask, grid, group, shared })
    }

    /// Atoms for a block of so many measured pixels.
    fn sparsity(&self, measured: usize) -> usize {
        (measured * self.dictionary.channels() / 3).clamp(usize::from(measured > 0), self.how.sparsity)
    }

    fn selection(&self, sparsity: usize, measured: usize) -> Selection {
        let values = (measured * self.dictionary.channels()) as f64;
        Selection { sparsity, error: self.how.error.powi(2) * values, floor: FLOOR }
    }
}

/// Blocks in groups of the same measured pixels, where one Gram matrix costs less than stepping together.
fn share(
    dictionary: &Dictionary,
    mask: &Mask,
    grid: &Grid,
    sparsity: usize,
) -> (Vec<Option<usize>>, Vec<Shared>) {
    let flags: Vec<Vec<bool>> = (0..grid.len()).into_par_iter().map(|at| grid.flags(mask, at));
    let mut order: Vec<usize> = (0..flags.len()).collect();
    order.sort_by(|a, b| flags[*a].cmp(&flags[*b]).then(a.cmp(b)));
    let mut runs: Vec<&[usize]> = order.chunk_by(|a, b| flags[*a] == flags[*b]).collect();
    runs.sort_by_key(|run| (std::cmp::Reverse(run.len()), run[0]));
    let worth = |run: &&&[usize]| {
        run.len().saturating_mul(sparsity) >= 2 * dictionary.len() && flags[run[0]].contains(&true)
    };
    let mut group = vec![None; flags.len()];
    let mut shared = Vec::new();
    for run in runs.iter().take(MOST_SHARED).filter(worth) {
        run.iter().for_each(|block| group[*block] = Some(shared.len()));
        let flags = &flags[run[0]];
        let mut atoms = dictionary.atoms().clone();
        for mut atom in atoms.rows_mut() {
            let missing = atom.iter_mut().zip(flags.iter().cycle()).filter(|(_, measured)| !**measured);
            missing.for_each(|(x, _)| *x = 0.0);
        }
        shared.push(Shared::new(&atoms, FLOOR));
    }
    (group, shared)
}

/// A block of some of the planes.
#[derive(Clone, Copy)]
struct Item {
    /// The first plane.
    plane: usize,
    block: usize,
}

impl Plan for Planned {
    fn reconstruct(&self, samples: &Planes, out: &mut Planes, run: &Run<'_>) -> Result<Outcome, Error> {
        check::group(&self.mask, samples, out)?;
        let channels = self.dictionary.channels();
        if !samples.len().is_multiple_of(channels) {
            let found = format!("{} planes for a dictionary over {channels}", samples.len());
            return Err(Error::SizeMismatch { expected: self.mask.size(), found });
        }
        if self.mask.is_full() && !self.how.restore {
            out.as_mut_slice().clone_from_slice(samples.as_slice());
            return Ok(Outcome::direct());
        }
        let mut averages = vec![Average::new(samples.size()); samples.len()];
        let planes = (0..samples.len()).step_by(channels);
        let items =
            || planes.clone().flat_map(|plane| (0..self.grid.len()).map(move |block| Item { plane, block }));
        let (lit, dark): (Vec<Item>, Vec<Item>) = items().partition(|item| self.is_lit(samples, *item));
        let (alike, others): (Vec<Item>, Vec<Item>) =
            lit.into_iter().partition(|item| self.group[item.block].is_some());
        let black = vec![0.0; self.dictionary.dimension()];
        for item in dark {
            self.lay(&mut averages, item, &black);
        }
        let masked = Masked::new(&self.dictionary);
        let mut outcome = Outcome::direct();
        for (items, shared) in [(alike, true), (others, false)] {
            for wave in items.chunks(WAVE * TOGETHER) {
                // Parts that are left out are filled like blocks without a measured pixel.
                if let Some(stop) = run.interrupted() {
                    outcome.stop = outcome.stop.max(stop);
                    break;
                }
                let sums: Vec<Array2<f32>> = wave.par_chunks(TOGETHER).map(|part| {
                    let values = self.values(samples, part);
                    let codes =
                        if shared { self.alike(part, &values) } else { self.others(&masked, part, &values) };
                    self.sums(&codes)
                });
                for (part, sums) in wave.chunks(TOGETHER).zip(&sums) {
                    for (item, sum) in part.iter().zip(sums.rows()) {
                        self.lay(&mut averages, *item, sum.to_slice().unwrap_or(&black));
                    }
                }
            }
        }
        self.write(samples, &averages, out, run)?;
        Ok(outcome)
    }
}

impl Planned {
    fn grid_pixels(&self) -> usize {
        self.dictionary.block() * self.dictionary.block()
    }

    /// Whether a measured value of the block is not 0; all others have an empty code.
    fn is_lit(&self, samples: &Planes, item: Item) -> bool {
        let flags = self.grid.flags(&self.mask, item.block);
        let mut values = vec![0.0; self.grid_pixels()];
        (0..self.dictionary.channels()).any(|channel| {
            self.grid.take(samples.as_slice()[item.plane + channel].pixels(), item.block, &mut values);
            values.iter().zip(&flags).any(|(value, measured)| *measured && *value != 0.0)
        })
    }

    /// Lays a block on the planes; nothing is known of one without a measured pixel.
    fn lay(&self, averages: &mut [Average], item: Item, values: &[f32]) {
        if self.measured(item.block) > 0 {
            let planes = averages[item.plane..].iter_mut().zip(values.chunks_exact(self.grid_pixels()));
            planes.for_each(|(average, values)| average.add(&self.grid, item.block, values));
        }
    }

    fn measured(&self, block: usize) -> usize {
        self.grid.flags(&self.mask, block).into_iter().filter(|flag| *flag).count()
    }

    /// The measured values of blocks, `B x n`; zeros where missing.
    fn values(&self, samples: &Planes, items: &[Item]) -> Array2<f32> {
        let pixels = self.grid_pixels();
        let mut values = Array2::zeros((items.len(), self.dictionary.dimension()));
        for (item, mut row) in items.iter().zip(values.rows_mut()) {
            let flags = self.grid.flags(&self.mask, item.block);
            let Some(row) = row.as_slice_mut() else { continue };
            for (channel, values) in row.chunks_exact_mut(pixels).enumerate() {
                self.grid.take(samples.as_slice()[item.plane + channel].pixels(), item.block, values);
                values.iter_mut().zip(&flags).filter(|(_, flag)| !**flag).for_each(|(x, _)| *x = 0.0);
            }
        }
        values
    }

    /// The codes of blocks that share Gram matrices.
    fn alike(&self, items: &[Item], values: &Array2<f32>) -> Vec<Code> {
        let mut products = Array2::<f32>::zeros((items.len(), self.dictionary.len()));
        general_mat_mul(1.0, values, &self.dictionary.atoms().t(), 0.0, &mut products);
        let mut scratch = Scratch::default();
        let rows = items.iter().zip(values.rows()).zip(products.rows_mut());
        rows.map(|((item, values), mut products)| {
            let (Some(products), Some(group)) = (products.as_slice_mut(), self.group[item.block]) else {
                return Code::new();
            };
            let energy = values.iter().map(|x| f64::from(*x).powi(2)).sum();
            let measured = self.measured(item.block);
            let selection = self.selection(self.sparsity(measured), measured);
            self.shared[group].code(products, energy, &selection, &mut scratch)
        })
        .collect()
    }

    /// The codes of blocks that have each its own mask.
    fn others(&self, masked: &Masked<'_>, items: &[Item], values: &Array2<f32>) -> Vec<Code> {
        let pixels = self.grid_pixels();
        let flags: Vec<f32> = items
            .iter()
            .flat_map(|item| self.grid.flags(&self.mask, item.block))
            .map(|flag| f32::from(u8::from(flag)))
            .collect();
        let Ok(flags) = Array2::from_shape_vec((items.len(), pixels), flags) else { return Vec::new() };
        let measured: Vec<usize> = items.iter().map(|item| self.measured(item.block)).collect();
        let selections: Vec<Selection> =
            measured.iter().map(|count| self.selection(self.sparsity(*count), *count)).collect();
        masked.codes(values, &flags, &selections)
    }

    /// The blocks that codes stand for, `B x n`.
    fn sums(&self, codes: &[Code]) -> Array2<f32> {
        let mut sums = Array2::zeros((codes.len(), self.dictionary.dimension()));
        for (code, mut row) in codes.iter().zip(sums.rows_mut()) {
            if let Some(row) = row.as_slice_mut() {
                self.dictionary.sum(code, row);
            }
        }
        sums
    }

    fn write(
        &self,
        samples: &Planes,
        averages: &[Average],
        out: &mut Planes,
        run: &Run<'_>,
    ) -> Result<(), Error> {
        let mut bare = false;
        let mut holes = Vec::new();
        for ((average, out), samples) in averages.iter().zip(out.as_mut_slice()).zip(samples.as_slice()) {
            let hole = average.write(out);
            let known =
                out.pixels_mut().iter_mut().zip(samples.pixels()).zip(self.mask.as_slice()).zip(&hole);
            for (((value, sample), measured), hole) in known {
                if *measured && (*hole || !self.how.restore) {
                    *value = *sample;
                }
            }
            bare |= hole.contains(&true);
            holes.push(hole);
        }
        if !bare {
            return Ok(());
        }
        let plan = push_pull::Settings.plan(&Problem::fill(Arc::clone(&self.mask)), run)?;
        let mut coarse = Planes::zeros(samples.size(), samples.len());
        plan.reconstruct(samples, &mut coarse, run)?;
        let planes = out.as_mut_slice().iter_mut().zip(coarse.as_slice()).zip(&holes);
        planes.for_each(|((out, coarse), hole): ((&mut Plane, &Plane), _)| {
            let pixels = out.pixels_mut().iter_mut().zip(coarse.pixels()).zip(hole);
            pixels.filter(|(_, hole)| **hole).for_each(|((to, from), _)| *to = *from);
        });
        Ok(())
    }
}
