//! Dictionaries: square blocks of an image as sums of few atoms.
//!
//! A block of `b x b` pixels in `c` channels is the vector `y` of `n = c b^2` numbers, channel after channel, row by row. A
//! dictionary is a matrix `D` of `n x K` numbers whose columns, the atoms, have length 1; `y ~ D x` with at most `L` entries
//! of `x` other than 0. The files, in the order of the work:
//!
//! - [`Dictionary`]: the atoms; [`dct`]: atoms that are made, [`ksvd`]: atoms that are learned.
//! - [`blocks`]: an image cut into blocks, and put together again by averaging.
//! - [`pursuit`]: the few atoms of a block by orthogonal matching pursuit, all its values given or some.
//! - [`fill`]: the filters `dictionary` and `dct`; [`whole`]: images without a missing pixel as codes.

mod atoms;
pub mod blocks;
pub mod dct;
pub mod fill;
pub mod ksvd;
mod masked;
pub mod pursuit;
pub mod whole;

pub use atoms::{Dictionary, Invalid, MOST_ATOMS, MOST_BLOCK, MOST_CHANNELS};
