//! Numbers that begin at a line of the cache, as rows do whose length is a multiple of a line's: a vector that straddles two
//! lines costs two accesses.

use std::ops::{Deref, DerefMut};

use rayon::prelude::*;

/// Bytes of a line, and of the longest vector.
const LINE: usize = 64;

/// Numbers that are worth a task of their own.
const LEAST: usize = 1 << 14;

/// A slice that knows where it begins.
#[derive(Debug)]
pub struct Aligned {
    values: Vec<f32>,
    first: usize,
    length: usize,
}

impl Aligned {
    /// Zeros.
    pub fn zeros(length: usize) -> Self {
        let values = vec![0.0_f32; length + LINE / size_of::<f32>()];
        let first = values.as_ptr().align_offset(LINE).min(values.len() - length);
        Self { values, first, length }
    }

    /// What `f` makes of some numbers.
    pub fn map(from: &[f32], f: impl Fn(f32) -> f32 + Sync) -> Self {
        let mut all = Self::zeros(from.len());
        all.par_iter_mut().zip(from).with_min_len(LEAST).for_each(|(to, from)| *to = f(*from));
        all
    }
}

impl Clone for Aligned {
    fn clone(&self) -> Self {
        Self::map(self, |value| value)
    }
}

impl Deref for Aligned {
    type Target = [f32];

    fn deref(&self) -> &[f32] {
        &self.values[self.first..][..self.length]
    }
}

impl DerefMut for Aligned {
    fn deref_mut(&mut self) -> &mut [f32] {
        &mut self.values[self.first..][..self.length]
    }
}
