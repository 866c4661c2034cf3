//! One row of a prolongation from a grid to one twice as fine, and of its adjoint.
//!
//! Weights along rows stand in planes, so that neighbouring cells are computed together: the cells that a weight is for are
//! one apart on the coarse grid. Cells of the fine grid are taken by turns into two lines, even and odd.
//!
//! Roofline: a fine pixel costs 2 (up: 4) multiply-adds down the columns and 4 along rows, and one load of a weight for each of
//! the latter; everything but the rows themselves is in L1.

use super::window::PAD;
use super::{Body, Real, fma};

/// Adds a row of the prolongation, times `share` if there is one, to `out`.
#[derive(Debug)]
pub struct Prolong<'a, T> {
    /// Weights of the rows.
    pub vertical: &'a [T; 4],
    /// Rows of the coarse buffer, whole strides.
    pub sources: [&'a [T]; 4],
    /// Per coarse cell four weights of its first fine cell, four of its second.
    pub horizontal: [&'a [T]; 8],
    /// What the row is multiplied by.
    pub share: Option<&'a [T]>,
    /// The row.
    pub out: &'a mut [T],
    /// Room for a row of the coarse buffer and one of its cells, twice.
    pub room: &'a mut Vec<T>,
}

impl<T: Real> Body for Prolong<'_, T> {
    type Output = ();

    #[inline(always)]
    fn run<const FUSED: bool>(self) {
        let [a, b, c, d] = *self.vertical;
        let [first, second, third, fourth] = self.sources;
        let length = first.len();
        let (second, third, fourth) = (&second[..length], &third[..length], &fourth[..length]);
        let n = self.horizontal[0].len();
        self.room.resize(self.room.len().max(length + 2 * n), T::ZERO);
        let (line, halves) = self.room.split_at_mut(length);
        for k in 0..length {
            let sum = fma::<T, FUSED>(b, second[k], a * first[k]);
            line[k] = fma::<T, FUSED>(d, fourth[k], fma::<T, FUSED>(c, third[k], sum));
        }
        let (even, odd) = halves[..2 * n].split_at_mut(n);
        for (half, out) in [&mut *even, &mut *odd].into_iter().enumerate() {
            let near = &line[PAD - 2 + half..][..n + 3];
            let w: [&[T]; 4] = std::array::from_fn(|k| &self.horizontal[4 * half + k][..n]);
            for j in 0..n {
                let sum = fma::<T, FUSED>(w[1][j], near[j + 1], w[0][j] * near[j]);
                out[j] = fma::<T, FUSED>(w[3][j], near[j + 3], fma::<T, FUSED>(w[2][j], near[j + 2], sum));
            }
        }
        let (even, odd) = (&*even, &*odd);
        let (pairs, rest) = self.out.as_chunks_mut::<2>();
        let Some(share) = self.share else {
            for ((out, &even), &odd) in pairs.iter_mut().zip(even).zip(odd) {
                (out[0], out[1]) = (out[0] + even, out[1] + odd);
            }
            if let [out] = rest {
                *out += even[n - 1];
            }
            return;
        };
        let (shares, last) = share.as_chunks::<2>();
        for (((out, share), &even), &odd) in pairs.iter_mut().zip(shares).zip(even).zip(odd) {
            out[0] = fma::<T, FUSED>(share[0], even, out[0]);
            out[1] = fma::<T, FUSED>(share[1], odd, out[1]);
        }
        if let ([out], [share]) = (rest, last) {
            *out = fma::<T, FUSED>(*share, even[n - 1], *out);
        }
    }
}

/// Sets `out` to a row of the adjoint.
#[derive(Debug)]
pub struct Restrict<'a, T> {
    /// Weights of the rows.
    pub vertical: &'a [T; 8],
    /// Rows of the fine buffer, whole strides.
    pub sources: [&'a [T]; 8],
    /// Per coarse cell its eight weights.
    pub horizontal: [&'a [T]; 8],
    /// The row.
    pub out: &'a mut [T],
    /// Room for two rows of the fine buffer.
    pub room: &'a mut Vec<T>,
}

impl<T: Real> Body for Restrict<'_, T> {
    type Output = ();

    #[inline(always)]
    fn run<const FUSED: bool>(self) {
        let length = self.sources[0].len();
        let sources = self.sources.map(|source| &source[..length]);
        // Coarse cell `j` takes the places `2 j + PAD - 3 ..`, the first of which is odd.
        let n = self.out.len();
        let half = n + PAD;
        self.room.resize(self.room.len().max(length + 2 * PAD + 2 * half), T::ZERO);
        let (line, halves) = self.room.split_at_mut(length + 2 * PAD);
        line[length..].fill(T::ZERO);
        for k in 0..length {
            let mut sum = T::ZERO;
            for (&weight, source) in self.vertical.iter().zip(&sources) {
                sum = fma::<T, FUSED>(weight, source[k], sum);
            }
            line[k] = sum;
        }
        let (even, odd) = halves[..2 * half].split_at_mut(half);
        for ((pair, even), odd) in line.as_chunks::<2>().0.iter().zip(&mut *even).zip(&mut *odd) {
            (*even, *odd) = (pair[0], pair[1]);
        }
        let w: [&[T]; 8] = std::array::from_fn(|k| &self.horizontal[k][..n]);
        let out = &mut self.out[..n];
        for j in 0..n {
            let mut sum = w[0][j] * odd[j];
            for k in 1..4 {
                sum = fma::<T, FUSED>(w[2 * k][j], odd[j + k], sum);
            }
            for k in 0..4 {
                sum = fma::<T, FUSED>(w[2 * k + 1][j], even[j + k + 1], sum);
            }
            out[j] = sum;
        }
    }
}
