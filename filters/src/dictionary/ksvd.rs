//! K-SVD: a dictionary that is learned from blocks.
//!
//! Given `N` blocks `y_i` of `n` numbers, find `K` atoms of length 1 and codes of at most `L` entries with
//!
//! ```text
//! min_{D, X}  sum_i |y_i - D x_i|^2   subject to   |x_i|_0 <= L        (equation 3.12 of the thesis)
//! ```
//!
//! by turns: codes by orthogonal matching pursuit ([`super::pursuit`]), then atom after atom with its factors (`update`): the
//! best rank-one approximation of what the other atoms leave of its blocks, by power iterations to 1e-6 of its square (the exact
//! variant), or one step of them (the approximate variant). Between the two, atoms that no block uses, and the lesser used of two
//! whose product exceeds 0.99, are replaced by the blocks that are represented worst (`replace`).
//!
//! The error never increases but for rounding: a pursuit is greedy, so a block keeps its old code where the new one is worse; an atom's update
//! cannot increase it; and an atom is replaced only where the block that it becomes gains as much as its users lose.
//!
//! Blocks of zeros are left out. The first atoms are blocks that the seed picks among those above 1e-9 of the mean squared length. Threads change no bit: blocks are coded in parts
//! of a fixed size, sums run in the order of the blocks.
//!
//! Cost of an iteration: `N n K` multiplications as dense products, `N K L^2 / 2` for the codes, `30 N L n` for the exact update
//! (3 `N L n` for the approximate). Memory: the blocks twice, and `K^2` numbers.
//! Fails: it finds a local minimum, another one for another seed. Atoms keep the level of their blocks: where contrast is below about 1 %
//! of it they are nearly collinear, the pursuit ends after one, and the texture is lost.
//!
//! Sources: M. Aharon, M. Elad, A. Bruckstein, "K-SVD: An Algorithm for Designing Overcomplete Dictionaries for Sparse
//! Representation", IEEE Transactions on Signal Processing 2006; R. Rubinstein, M. Zibulevsky, M. Elad, "Efficient Implementation
//! of the K-SVD Algorithm using Batch Orthogonal Matching Pursuit", Technion 2008 (the approximate variant).

mod replace;
mod update;

use lacuna_core::parallel::prelude::*;
use ndarray::linalg::general_mat_mul;
use ndarray::{Array2, ArrayView2};

use super::pursuit::{Code, Scratch, Selection, Shared};
use super::{Dictionary, Invalid};
use crate::kernel::dense::add_multiple;
use crate::sampling::random::Permutation;
use crate::{Error, Run, Stop};

/// Blocks that are coded together; part of the method.
const TOGETHER: usize = 256;

/// What is asked of the training.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Settings {
    /// Pixels of a block's side.
    pub block: usize,
    /// Channels of a block.
    pub channels: usize,
    /// Atoms, `K`.
    pub atoms: usize,
    /// Atoms of a block's code, at most.
    pub sparsity: usize,
    /// Iterations, those of a state that is continued included.
    pub iterations: usize,
    /// Which blocks the first atoms are.
    pub seed: u64,
    /// One power iteration an atom instead of as many as it takes.
    pub approximate: bool,
}

/// A training between two iterations.
#[derive(Clone, Debug, PartialEq)]
pub struct State {
    /// The atoms, `K x n`.
    pub atoms: Array2<f32>,
    /// A code for each block.
    pub codes: Vec<Code>,
    /// The root of the mean squared error of a number of a block, after each iteration.
    pub errors: Vec<f64>,
    /// Why it ended, if it ended early.
    pub stop: Stop,
}

/// Blocks without the zeros among them, in working order.
struct Work<'a> {
    settings: &'a Settings,
    /// `N x n`, row by row.
    blocks: &'a [f32],
    dimension: usize,
    atoms: Array2<f32>,
    codes: Vec<Code>,
    /// `y - D x`.
    residuals: Vec<f32>,
}

/// Learns from blocks, `N x n` numbers in one row after another; `tell` hears of each iteration. Between iterations, `run` may
/// end it; the state can be continued with the same blocks and settings, or more iterations, to the same end as without a break.
///
/// # Errors
/// [`Error::Setting`] for settings out of range, fewer usable blocks than atoms, and a state of other blocks.
pub fn learn(
    blocks: &[f32],
    settings: &Settings,
    start: Option<State>,
    run: &Run<'_>,
    mut tell: impl FnMut(&State),
) -> Result<State, Error> {
    check(settings)?;
    let dimension = settings.channels * settings.block * settings.block;
    let count = blocks.len() / dimension;
    let mut state = match start {
        Some(state) => fitting(state, settings, dimension, count)?,
        None => State {
            atoms: first_atoms(blocks, dimension, settings)?,
            codes: vec![Code::new(); count],
            errors: Vec::new(),
            stop: Stop::Converged,
        },
    };
    state.stop = Stop::Converged;
    let mut work = Work {
        settings,
        blocks,
        dimension,
        atoms: state.atoms,
        codes: state.codes,
        residuals: vec![0.0; count * dimension],
    };
    let mut errors = state.errors;
    loop {
        let stop =
            if errors.len() >= settings.iterations { Some(Stop::Converged) } else { run.interrupted() };
        if let Some(stop) = stop {
            return Ok(State { atoms: work.atoms, codes: work.codes, errors, stop });
        }
        let shared = work.code();
        work.replace(&shared);
        work.update();
        let squared = work.squared_errors().iter().sum::<f64>();
        errors.push((squared / (count * dimension).max(1) as f64).sqrt());
        let state = State { atoms: work.atoms, codes: work.codes, errors, stop: Stop::Cancelled };
        tell(&state);
        (work.atoms, work.codes, errors) = (state.atoms, state.codes, state.errors);
    }
}

/// How often each atom is used.
pub fn usage(codes: &[Code], atoms: usize) -> Vec<usize> {
    let mut usage = vec![0; atoms];
    codes.iter().flatten().for_each(|entry| usage[entry.0 as usize] += 1);
    usage
}

fn check(settings: &Settings) -> Result<(), Error> {
    let Settings { block, channels, atoms, sparsity, .. } = *settings;
    // A dictionary of one atom tells whether the shape is one.
    let one = Array2::from_shape_fn((1, channels * block * block), |(_, i)| if i == 0 { 1.0 } else { 0.0 });
    match Dictionary::new(block, channels, one) {
        Err(Invalid::Range { name: "block", value, .. }) => {
            return Err(Error::setting("block", &value, "1 to 64"));
        }
        Err(_) => return Err(Error::setting("channels", &channels, "1 to 8")),
        Ok(_) => {}
    }
    if !(1..=super::MOST_ATOMS).contains(&atoms) {
        return Err(Error::setting("atoms", &atoms, "1 to 16384"));
    }
    if sparsity == 0 || sparsity > atoms.min(channels * block * block) {
        return Err(Error::setting("sparsity", &sparsity, "1 to the atoms and to the numbers of a block"));
    }
    Ok(())
}

fn fitting(state: State, settings: &Settings, dimension: usize, count: usize) -> Result<State, Error> {
    let entry = |entry: &(u32, f32)| (entry.0 as usize) < settings.atoms && entry.1.is_finite();
    let code = |code: &Code| code.len() <= settings.sparsity && code.iter().all(entry);
    let fits = state.atoms.dim() == (settings.atoms, dimension) && state.codes.len() == count;
    if fits && state.codes.iter().all(code) {
        Ok(state)
    } else {
        Err(Error::setting("resume", &"the state", "that of a training with the same blocks and settings"))
    }
}

/// Blocks of length 1, picked by the seed among those that are not zero.
fn first_atoms(blocks: &[f32], dimension: usize, settings: &Settings) -> Result<Array2<f32>, Error> {
    let squared = |block: &[f32]| block.iter().map(|x| f64::from(*x).powi(2)).sum::<f64>();
    let lengths: Vec<f64> = blocks.par_chunks(dimension).map(squared);
    let mean = lengths.iter().sum::<f64>() / lengths.len().max(1) as f64;
    let usable: Vec<usize> = (0..lengths.len()).filter(|at| lengths[*at] > 1e-9 * mean).collect();
    if usable.len() < settings.atoms {
        let range = "at most the blocks that are not black or nearly so: take more frames, a smaller stride, or fewer atoms";
        let value = format!("{} of {} blocks", settings.atoms, usable.len());
        return Err(Error::setting("atoms", &value, range));
    }
    let order = Permutation::new(usable.len() as u64, settings.seed);
    let mut atoms = Array2::zeros((settings.atoms, dimension));
    for (at, mut atom) in atoms.rows_mut().into_iter().enumerate() {
        let pick = usable[order.apply(at as u64) as usize];
        let length = lengths[pick].sqrt();
        let block = &blocks[pick * dimension..][..dimension];
        atom.iter_mut().zip(block).for_each(|(atom, x)| *atom = (f64::from(*x) / length) as f32);
    }
    Ok(atoms)
}

/// `y - D x`; returns its squared length.
fn residual(block: &[f32], atoms: &Array2<f32>, code: &Code, out: &mut [f32]) -> f64 {
    out.copy_from_slice(block);
    for &(atom, factor) in code {
        if let Some(atom) = atoms.row(atom as usize).to_slice() {
            add_multiple(-factor, atom, out);
        }
    }
    squared(out)
}

fn squared(values: &[f32]) -> f64 {
    values.iter().map(|x| f64::from(*x).powi(2)).sum()
}

impl Work<'_> {
    /// Codes every block anew where that is better, and computes the residuals.
    fn code(&mut self) -> Shared {
        let (dimension, atoms) = (self.dimension, &self.atoms);
        let shared = Shared::new(atoms, 0.0);
        let selection = Selection::atoms(self.settings.sparsity);
        let blocks = self.blocks.par_chunks(TOGETHER * dimension);
        let residuals = self.residuals.par_chunks_mut(TOGETHER * dimension);
        let codes = self.codes.par_chunks_mut(TOGETHER);
        blocks.zip(residuals).zip(codes).for_each(|((blocks, residuals), codes)| {
            let Ok(values) = ArrayView2::from_shape((codes.len(), dimension), blocks) else { return };
            let mut products = Array2::<f32>::zeros((codes.len(), atoms.nrows()));
            general_mat_mul(1.0, &values, &atoms.t(), 0.0, &mut products);
            let mut scratch = Scratch::default();
            let mut old = vec![0.0; dimension];
            let each = blocks.chunks_exact(dimension).zip(residuals.chunks_exact_mut(dimension));
            for ((block, out), (code, mut products)) in each.zip(codes.iter_mut().zip(products.rows_mut())) {
                let before = residual(block, atoms, code, &mut old);
                let Some(products) = products.as_slice_mut() else { continue };
                let new = shared.code(products, squared(block), &selection, &mut scratch);
                if residual(block, atoms, &new, out) < before {
                    *code = new;
                } else {
                    out.copy_from_slice(&old);
                }
            }
        });
        shared
    }

    fn squared_errors(&self) -> Vec<f64> {
        self.residuals.par_chunks(self.dimension).map(squared)
    }

    /// For each atom, the blocks that use it and where in their codes.
    fn users(&self) -> Vec<Vec<(u32, u32)>> {
        let mut users = vec![Vec::new(); self.atoms.nrows()];
        for (block, code) in self.codes.iter().enumerate() {
            for (place, (atom, _)) in code.iter().enumerate() {
                users[*atom as usize].push((block as u32, place as u32));
            }
        }
        users
    }
}

#[cfg(test)]
mod tests;
