//! One level of the transform on a line: the index maps of its boundary, along contiguous values and across rows.

use super::{Bank, Boundary};

/// The place of a value or coefficient, and its taps in the coarse and the fine half.
pub type Term = (u32, [f32; 2]);

/// One level on lines of `length` values.
#[derive(Clone, Debug)]
pub struct Line {
    /// Values of a line.
    pub length: usize,
    /// Coefficients of either half; 0 of the second on a line of one value, which is its own coarse half.
    pub half: usize,
    /// Per coefficient the values that it reads, with the taps of both filters.
    reads: Vec<Vec<Term>>,
    /// Per value the coefficients that read it, with the same taps: the adjoint.
    read_by: Vec<Vec<Term>>,
    /// Per value the coefficients that make it up, with the synthesis taps: the inverse.
    made_of: Vec<Vec<Term>>,
}

impl Line {
    /// The level of a bank on lines of `length` values.
    pub fn new(bank: &Bank, boundary: Boundary, length: usize) -> Self {
        let taps = bank.low.len();
        let half = match boundary {
            _ if length <= 1 => length,
            Boundary::Symmetric => usize::midpoint(length, taps - 1),
            Boundary::Periodic => length.div_ceil(2),
        };
        if length <= 1 {
            let own = vec![vec![(0, [1.0, 0.0])]; length];
            return Self { length, half, reads: own.clone(), read_by: own.clone(), made_of: own };
        }
        let centre = match boundary {
            Boundary::Symmetric => 1,
            Boundary::Periodic => taps as isize / 2,
        };
        let mut reads = vec![Vec::new(); half];
        let mut read_by = vec![Vec::new(); length];
        for (k, list) in reads.iter_mut().enumerate() {
            for j in 0..taps {
                let at = boundary.fold(2 * k as isize + centre - j as isize, length);
                add(list, at, [bank.low[j] as f32, bank.high[j] as f32]);
            }
            for &(at, taps) in &*list {
                read_by[at as usize].push((k as u32, taps));
            }
        }
        let made_of = synthesis(bank, boundary, length, half);
        Self { length, half, reads, read_by, made_of }
    }

    /// Coefficients in all: those of the coarse half, then those of the fine one.
    pub fn coefficients(&self) -> usize {
        if self.length <= 1 { self.length } else { 2 * self.half }
    }

    /// What coefficient `k` of either half reads.
    pub fn reads(&self, k: usize) -> &[Term] {
        &self.reads[k]
    }

    /// Which coefficients read value `i`.
    pub fn read_by(&self, i: usize) -> &[Term] {
        &self.read_by[i]
    }

    /// Which coefficients value `i` is made of.
    pub fn made_of(&self, i: usize) -> &[Term] {
        &self.made_of[i]
    }
}

/// Adds to an entry, or makes it: a short line is read several times by one coefficient.
fn add(list: &mut Vec<Term>, at: usize, taps: [f32; 2]) {
    match list.iter_mut().find(|entry| entry.0 == at as u32) {
        Some((_, sum)) => {
            sum[0] += taps[0];
            sum[1] += taps[1];
        }
        None => list.push((at as u32, taps)),
    }
}

fn synthesis(bank: &Bank, boundary: Boundary, length: usize, half: usize) -> Vec<Vec<Term>> {
    let taps = bank.low.len();
    let mut made_of = vec![Vec::new(); length];
    for k in 0..half {
        for j in 0..taps {
            let at = match boundary {
                Boundary::Symmetric => (2 * k + j) as isize - (taps as isize - 2),
                Boundary::Periodic => {
                    let at = (2 * k + j) as isize - (taps as isize / 2 - 1);
                    at.rem_euclid(2 * half as isize)
                }
            };
            if (0..length as isize).contains(&at) {
                let both = [bank.low_back[j] as f32, bank.high_back[j] as f32];
                add(&mut made_of[at as usize], k, both);
            }
        }
    }
    made_of
}
