//! A dictionary: its atoms and what they stand for.

use lacuna_core::parallel::prelude::*;
use ndarray::linalg::general_mat_mul;
use ndarray::{Array2, Axis};

/// The largest block, in pixels of a side.
pub const MOST_BLOCK: usize = 64;
/// The most channels that an atom spans.
pub const MOST_CHANNELS: usize = 8;
/// The most atoms: their products fill a matrix of 1 GiB.
pub const MOST_ATOMS: usize = 16384;

/// How far the length of an atom may be from 1.
const LENGTH_TOLERANCE: f64 = 1e-3;
/// Rows of a product that one task computes.
const ROWS: usize = 256;

/// Atoms of length 1 over blocks of one size.
#[derive(Clone, Debug, PartialEq)]
pub struct Dictionary {
    block: usize,
    channels: usize,
    /// `K x n`, an atom a row.
    atoms: Array2<f32>,
}

/// Why numbers are no dictionary.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[non_exhaustive]
pub enum Invalid {
    /// The block, the channels or the number of atoms is out of range.
    #[error("{name} = {value} is out of range ({range})")]
    Range {
        /// Which.
        name: &'static str,
        /// What it is.
        value: usize,
        /// What it may be.
        range: String,
    },
    /// The matrix does not fit block and channels.
    #[error(
        "atoms of {found} numbers where blocks of {block}x{block} in {channels} channels have {expected}"
    )]
    Shape {
        /// Numbers of an atom.
        found: usize,
        /// Numbers of a block.
        expected: usize,
        /// Pixels of a block's side.
        block: usize,
        /// Channels.
        channels: usize,
    },
    /// An atom is not finite or not of length 1.
    #[error("atom {0} has not the length 1")]
    Length(usize),
}

impl Dictionary {
    /// Takes `K x n` numbers, an atom a row.
    ///
    /// # Errors
    /// [`Invalid`], for numbers of another count or atoms that are not of length 1 to 1e-3.
    pub fn new(block: usize, channels: usize, atoms: Array2<f32>) -> Result<Self, Invalid> {
        check_range("block", block, 1, MOST_BLOCK)?;
        check_range("channels", channels, 1, MOST_CHANNELS)?;
        check_range("atoms", atoms.nrows(), 1, MOST_ATOMS)?;
        let expected = channels * block * block;
        if atoms.ncols() != expected {
            return Err(Invalid::Shape { found: atoms.ncols(), expected, block, channels });
        }
        let atoms = if atoms.is_standard_layout() { atoms } else { atoms.as_standard_layout().into_owned() };
        let wrong = |atom: ndarray::ArrayView1<'_, f32>| {
            let length = atom.iter().map(|x| f64::from(*x).powi(2)).sum::<f64>().sqrt();
            length.is_nan() || (length - 1.0).abs() > LENGTH_TOLERANCE
        };
        match atoms.rows().into_iter().position(wrong) {
            Some(at) => Err(Invalid::Length(at)),
            None => Ok(Self { block, channels, atoms }),
        }
    }

    /// Pixels of a block's side.
    pub const fn block(&self) -> usize {
        self.block
    }

    /// Channels that an atom spans.
    pub const fn channels(&self) -> usize {
        self.channels
    }

    /// Number of atoms, `K`.
    pub fn len(&self) -> usize {
        self.atoms.nrows()
    }

    /// Whether there is no atom; never.
    pub fn is_empty(&self) -> bool {
        self.len() == 0
    }

    /// Numbers of an atom, `n`.
    pub fn dimension(&self) -> usize {
        self.atoms.ncols()
    }

    /// The atoms, `K x n`, one a row.
    pub const fn atoms(&self) -> &Array2<f32> {
        &self.atoms
    }

    /// Atom `at`.
    pub fn atom(&self, at: usize) -> &[f32] {
        &self.values()[at * self.dimension()..][..self.dimension()]
    }

    /// All numbers, atom by atom.
    pub fn values(&self) -> &[f32] {
        self.atoms.as_slice().unwrap_or_default()
    }

    /// The sum of some atoms.
    pub fn sum(&self, code: &[(u32, f32)], out: &mut [f32]) {
        out.fill(0.0);
        for &(atom, factor) in code {
            crate::kernel::dense::add_multiple(factor, self.atom(atom as usize), out);
        }
    }

    /// For each atom, the largest absolute inner product with another one: 0 are orthogonal, 1 the same.
    pub fn coherences(&self) -> Vec<f32> {
        let gram = gram(&self.atoms);
        let rows: Vec<_> = gram.axis_iter(Axis(0)).enumerate().collect();
        rows.into_par_iter().map(|(at, row)| {
            let others = row.iter().enumerate().filter(|(other, _)| *other != at);
            others.fold(0.0_f32, |top, (_, product)| top.max(product.abs()))
        })
    }
}

fn check_range(name: &'static str, value: usize, least: usize, most: usize) -> Result<(), Invalid> {
    if (least..=most).contains(&value) {
        Ok(())
    } else {
        Err(Invalid::Range { name, value, range: format!("{least} to {most}") })
    }
}

/// The products of all pairs of rows, `K x K`. Each block of rows is one task, whatever the threads.
pub fn gram(atoms: &Array2<f32>) -> Array2<f32> {
    let mut gram = Array2::zeros((atoms.nrows(), atoms.nrows()));
    let tasks: Vec<_> =
        gram.axis_chunks_iter_mut(Axis(0), ROWS).zip(atoms.axis_chunks_iter(Axis(0), ROWS)).collect();
    tasks.into_par_iter().for_each(|(mut out, rows)| {
        general_mat_mul(1.0, &rows, &atoms.t(), 0.0, &mut out);
    });
    gram
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn atoms_have_length_one_and_fit_their_block() {
        let unit = Array2::from_shape_fn((3, 8), |(k, i)| if i == k { 1.0 } else { 0.0 });
        let dictionary = Dictionary::new(2, 2, unit.clone()).unwrap();
        assert_eq!((dictionary.len(), dictionary.dimension()), (3, 8));
        assert_eq!(dictionary.atom(1)[1], 1.0);
        assert_eq!(Dictionary::new(2, 2, &unit * 1.01), Err(Invalid::Length(0)));
        let mut nan = unit.clone();
        nan[(2, 0)] = f32::NAN;
        assert_eq!(Dictionary::new(2, 2, nan), Err(Invalid::Length(2)));
        assert!(matches!(Dictionary::new(2, 1, unit.clone()), Err(Invalid::Shape { expected: 4, .. })));
        for (block, channels) in [(0, 1), (65, 1), (2, 0), (2, 9)] {
            assert!(matches!(Dictionary::new(block, channels, unit.clone()), Err(Invalid::Range { .. })));
        }
    }

    #[test]
    fn sums_and_coherences_are_those_of_the_formula() {
        let half = 0.5_f32.sqrt();
        let atoms = Array2::from_shape_vec(
            (3, 4),
            vec![
                1.0, 0.0, 0.0, 0.0, //
                half, half, 0.0, 0.0, //
                0.0, 0.0, 0.0, 1.0,
            ],
        );
        let dictionary = Dictionary::new(2, 1, atoms.unwrap()).unwrap();
        let mut out = [7.0; 4];
        dictionary.sum(&[(0, 2.0), (2, -1.0)], &mut out);
        assert_eq!(out, [2.0, 0.0, 0.0, -1.0]);
        let coherences = dictionary.coherences();
        assert!((coherences[0] - half).abs() < 1e-6 && (coherences[1] - half).abs() < 1e-6);
        assert_eq!(coherences[2], 0.0);
    }
}
