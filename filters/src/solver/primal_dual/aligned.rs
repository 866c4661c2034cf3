//! Numbers that begin at a line of the cache, as rows do whose length is a multiple of a line's: a vector that straddles two
//! lines costs two accesses.

use std::ops::{Deref, DerefMut};

/// Bytes of a line, and of the longest vector.
const LINE: usize = 64;

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

    /// A copy.
    pub fn copy(from: &[f32]) -> Self {
        let mut copy = Self::zeros(from.len());
        copy.copy_from_slice(from);
        copy
    }
}

impl Clone for Aligned {
    fn clone(&self) -> Self {
        Self::copy(self)
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
