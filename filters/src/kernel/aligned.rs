//! Numbers that begin at a line of the cache, as rows do whose length is a multiple of a line's: a vector that straddles two
//! lines costs two accesses.

use std::ops::{Deref, DerefMut};

use lacuna_core::parallel::prelude::*;

use super::Real;

/// Bytes of a line, and of the longest vector.
const LINE: usize = 64;

/// Numbers that are worth a task of their own.
const LEAST: usize = 1 << 14;

/// A slice that knows where it begins.
#[derive(Debug)]
pub struct Aligned<T> {
    values: Vec<T>,
    first: usize,
    length: usize,
}

impl<T: Real> Aligned<T> {
    /// Zeros.
    pub fn zeros(length: usize) -> Self {
        let values = vec![T::ZERO; length + LINE / size_of::<T>()];
        let first = values.as_ptr().align_offset(LINE).min(values.len() - length);
        Self { values, first, length }
    }

    /// What `f` makes of some numbers.
    pub fn map(from: &[T], f: impl Fn(T) -> T + Sync) -> Self {
        let mut all = Self::zeros(from.len());
        all.par_iter_mut().zip(from).with_min_len(LEAST).for_each(|(to, from)| *to = f(*from));
        all
    }
}

impl<T: Real> Default for Aligned<T> {
    fn default() -> Self {
        Self::zeros(0)
    }
}

impl<T: Real> Clone for Aligned<T> {
    fn clone(&self) -> Self {
        Self::map(self, |value| value)
    }
}

impl<T> Deref for Aligned<T> {
    type Target = [T];

    fn deref(&self) -> &[T] {
        &self.values[self.first..][..self.length]
    }
}

impl<T> DerefMut for Aligned<T> {
    fn deref_mut(&mut self) -> &mut [T] {
        &mut self.values[self.first..][..self.length]
    }
}
