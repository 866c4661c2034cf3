//! Orthogonal matching pursuit where every block has its own measured values: many blocks step together.
//!
//! The same pursuit as [`super::pursuit`]. Without a shared Gram matrix a step needs the products of all atoms with each
//! residual; those of many blocks at once are one dense product `A = R D` (`B x n` times `n x K`), in which residuals are 0 where
//! nothing was measured. Per block, the directions of the atoms taken are kept as vectors over its values, made orthogonal by
//! the modified Gram-Schmidt process, whose triangle is the Cholesky factor.
//!
//! Cost: `n K` multiplications a block and step, at the speed of dense products; memory `n` numbers a step.

use ndarray::linalg::general_mat_mul;
use ndarray::{Array2, s};

use super::Dictionary;
use super::pursuit::{Code, DEPENDENT, NOTHING_LEFT, Selection, back_substitute, weights};
use crate::kernel::dense::{add_multiple, dot, strongest};

/// Blocks that step together; part of the method, as products of other shapes may round otherwise. Each step packs the atoms once
/// for all of them.
pub const TOGETHER: usize = 192;

/// A block on its way.
struct Block {
    /// What is not explained yet; 0 where nothing was measured.
    residual: Vec<f32>,
    measured: Vec<f32>,
    weights: Vec<f32>,
    selection: Selection,
    energy: f64,
    directions: Vec<f32>,
    factor: Vec<f32>,
    along: Vec<f32>,
    code: Code,
}

/// Dictionary-wide preparations for blocks whose masks differ.
pub struct Masked<'a> {
    dictionary: &'a Dictionary,
    /// Squared atoms, summed over channels: `K x b^2`.
    squares: Array2<f32>,
}

impl<'a> Masked<'a> {
    /// Prepares a dictionary.
    pub fn new(dictionary: &'a Dictionary) -> Self {
        let pixels = dictionary.block() * dictionary.block();
        let squares = Array2::from_shape_fn((dictionary.len(), pixels), |(atom, pixel)| {
            dictionary.atom(atom).iter().skip(pixel).step_by(pixels).map(|x| x * x).sum()
        });
        Self { dictionary, squares }
    }

    /// The codes of at most [`TOGETHER`] blocks: values (`B x n`, 0 where missing), flags per pixel (`B x b^2`, 1 where measured),
    /// and how many atoms each gets.
    pub fn codes(&self, values: &Array2<f32>, flags: &Array2<f32>, selections: &[Selection]) -> Vec<Code> {
        let (count, atoms) = (values.nrows(), self.dictionary.len());
        let mut products = Array2::<f32>::zeros((count, atoms));
        general_mat_mul(1.0, flags, &self.squares.t(), 0.0, &mut products);
        let block = |at: usize| {
            let residual = values.row(at).to_vec();
            let energy = residual.iter().map(|x| f64::from(*x).powi(2)).sum();
            let flags = flags.row(at);
            let measured = (0..self.dictionary.channels()).flat_map(|_| flags.iter().copied()).collect();
            Block {
                residual,
                measured,
                weights: weights(products.row(at).iter().copied(), selections[at].floor),
                selection: selections[at],
                energy,
                directions: Vec::new(),
                factor: Vec::new(),
                along: Vec::new(),
                code: Vec::new(),
            }
        };
        let mut blocks: Vec<Block> = (0..count).map(block).collect();
        let mut active: Vec<usize> = (0..count).filter(|at| blocks[*at].wants_more()).collect();
        let mut residuals = Array2::<f32>::zeros(values.dim());
        while !active.is_empty() {
            for (row, at) in active.iter().enumerate() {
                let mut row = residuals.row_mut(row);
                row.iter_mut().zip(&blocks[*at].residual).for_each(|(to, from)| *to = *from);
            }
            let rows = s![..active.len(), ..];
            general_mat_mul(
                1.0,
                &residuals.slice(rows),
                &self.dictionary.atoms().t(),
                0.0,
                &mut products.slice_mut(rows),
            );
            let mut row = 0;
            active.retain(|at| {
                let mut products = products.row_mut(row);
                row += 1;
                let Some(products) = products.as_slice_mut() else { return false };
                let block = &mut blocks[*at];
                block.step(products, self.dictionary) && block.wants_more()
            });
        }
        blocks.into_iter().map(Block::finish).collect()
    }
}

impl Block {
    fn wants_more(&self) -> bool {
        let left: f64 = self.residual.iter().map(|x| f64::from(*x).powi(2)).sum();
        self.code.len() < self.selection.sparsity
            && left > self.selection.error
            && left > NOTHING_LEFT * self.energy
    }

    /// Takes the next atom; false if there is none.
    fn step(&mut self, products: &mut [f32], dictionary: &Dictionary) -> bool {
        self.code.iter().for_each(|&(taken, _)| products[taken as usize] = 0.0);
        let Some((atom, top)) = strongest(products, &self.weights) else { return false };
        if f64::from(top).powi(2) <= NOTHING_LEFT * self.energy {
            return false;
        }
        let mut direction: Vec<f32> =
            dictionary.atom(atom).iter().zip(&self.measured).map(|(x, measured)| x * measured).collect();
        let squared = dot(&direction, &direction);
        let start = self.factor.len();
        for taken in self.directions.chunks_exact(direction.len()) {
            let entry = dot(taken, &direction);
            add_multiple(-entry, taken, &mut direction);
            self.factor.push(entry);
        }
        let left = dot(&direction, &direction);
        if left <= DEPENDENT * squared {
            self.factor.truncate(start);
            return false;
        }
        let length = left.sqrt();
        for x in &mut direction {
            *x /= length;
        }
        let along = dot(&direction, &self.residual);
        add_multiple(-along, &direction, &mut self.residual);
        self.factor.push(length);
        self.along.push(along);
        self.code.push((atom as u32, 0.0));
        self.directions.extend_from_slice(&direction);
        true
    }

    fn finish(mut self) -> Code {
        back_substitute(&self.factor, &self.along, &mut self.code);
        self.code
    }
}
