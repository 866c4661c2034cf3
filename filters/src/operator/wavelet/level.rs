//! One level in two dimensions: rows first, then columns; the same lines back.

use lacuna_core::parallel::prelude::*;

use super::line::{Line, Term};
use super::{Bank, Boundary};
use crate::Size;

/// One level on images of one size.
#[derive(Clone, Debug)]
pub struct Level {
    size: Size,
    /// Along columns.
    vertical: Line,
    /// Along rows.
    horizontal: Line,
}

/// Where a row of coefficients goes: the approximation and the three details.
type Quarters<'a> = (&'a mut [f32], &'a mut [f32], &'a mut [f32], &'a mut [f32]);

impl Level {
    /// The level of a bank on images of `size`.
    pub fn new(bank: &Bank, boundary: Boundary, size: Size) -> Self {
        let line = |length| Line::new(bank, boundary, length);
        Self { size, vertical: line(size.height), horizontal: line(size.width) }
    }

    /// Height and width of the input.
    pub fn size(&self) -> Size {
        self.size
    }

    /// Height and width of the approximation.
    pub fn coarse(&self) -> Size {
        Size::new(self.vertical.half, self.horizontal.half)
    }

    /// Coefficients that are not the approximation's.
    pub fn details(&self) -> usize {
        self.vertical.coefficients() * self.horizontal.coefficients() - self.coarse().pixels()
    }

    /// Values between rows and columns.
    pub fn row_buffer(&self) -> usize {
        self.size.height * self.horizontal.coefficients()
    }

    /// Width of the fine half of a row.
    fn fine(&self) -> usize {
        self.horizontal.coefficients() - self.horizontal.half
    }

    /// Each row into its coarse and its fine half.
    pub fn rows_forward(&self, input: &[f32], out: &mut [f32]) {
        let line = &self.horizontal;
        let rows = input.par_chunks(line.length).zip(out.par_chunks_mut(line.coefficients()));
        rows.for_each(|(x, out)| {
            let (coarse, fine) = out.split_at_mut(line.half);
            for (k, coarse) in coarse.iter_mut().enumerate() {
                let mut sum = [0.0_f32; 2];
                for &(at, taps) in line.reads(k) {
                    sum[0] += taps[0] * x[at as usize];
                    sum[1] += taps[1] * x[at as usize];
                }
                *coarse = sum[0];
                if let Some(fine) = fine.get_mut(k) {
                    *fine = sum[1];
                }
            }
        });
    }

    /// The adjoint of [`Self::rows_forward`].
    pub fn rows_adjoint(&self, input: &[f32], out: &mut [f32]) {
        self.rows_back(input, out, Line::read_by);
    }

    /// The inverse of [`Self::rows_forward`].
    pub fn rows_inverse(&self, input: &[f32], out: &mut [f32]) {
        self.rows_back(input, out, Line::made_of);
    }

    fn rows_back(&self, input: &[f32], out: &mut [f32], list: fn(&Line, usize) -> &[Term]) {
        let line = &self.horizontal;
        let rows = input.par_chunks(line.coefficients()).zip(out.par_chunks_mut(line.length));
        rows.for_each(|(c, out)| {
            let (coarse, fine) = c.split_at(line.half);
            for (i, out) in out.iter_mut().enumerate() {
                *out = if fine.is_empty() {
                    coarse[i]
                } else {
                    list(line, i)
                        .iter()
                        .map(|&(k, taps)| taps[0] * coarse[k as usize] + taps[1] * fine[k as usize])
                        .sum()
                };
            }
        });
    }

    /// Each column into its halves: `rows` into the approximation and the details.
    pub fn columns_forward(&self, rows: &[f32], coarse: &mut [f32], details: &mut [f32]) {
        let (half, fine) = (self.horizontal.half, self.fine());
        let width = half + fine;
        let low = self.vertical.half;
        let (beside, below) = details.split_at_mut(low * fine);
        if self.vertical.length <= 1 {
            for (row, (coarse, beside)) in
                rows.chunks(width).zip(coarse.chunks_mut(half).zip(halves(beside, fine)))
            {
                coarse.copy_from_slice(&row[..half]);
                beside.copy_from_slice(&row[half..]);
            }
            return;
        }
        let (below_coarse, below_fine) = below.split_at_mut(low * half);
        let quarters: Vec<Quarters<'_>> = coarse
            .chunks_mut(half)
            .zip(halves(beside, fine))
            .zip(below_coarse.chunks_mut(half).zip(halves(below_fine, fine)))
            .map(|((a, b), (c, d))| (a, b, c, d))
            .collect();
        quarters.into_par_iter().enumerate().for_each(|(k, (a, b, c, d))| {
            for quarter in [&mut *a, &mut *b, &mut *c, &mut *d] {
                quarter.fill(0.0);
            }
            for &(at, taps) in self.vertical.reads(k) {
                let (left, right) = rows[at as usize * width..][..width].split_at(half);
                accumulate(a, left, taps[0]);
                accumulate(b, right, taps[0]);
                accumulate(c, left, taps[1]);
                accumulate(d, right, taps[1]);
            }
        });
    }

    /// The adjoint of [`Self::columns_forward`].
    pub fn columns_adjoint(&self, coarse: &[f32], details: &[f32], rows: &mut [f32]) {
        self.columns_back(coarse, details, rows, Line::read_by);
    }

    /// The inverse of [`Self::columns_forward`].
    pub fn columns_inverse(&self, coarse: &[f32], details: &[f32], rows: &mut [f32]) {
        self.columns_back(coarse, details, rows, Line::made_of);
    }

    fn columns_back(
        &self,
        coarse: &[f32],
        details: &[f32],
        rows: &mut [f32],
        list: fn(&Line, usize) -> &[Term],
    ) {
        let (half, fine) = (self.horizontal.half, self.fine());
        let width = half + fine;
        let low = self.vertical.half;
        let (beside, below) = details.split_at(low * fine);
        let below = (self.vertical.length > 1).then(|| below.split_at(low * half));
        rows.par_chunks_mut(width).enumerate().for_each(|(i, row)| {
            let (left, right) = row.split_at_mut(half);
            left.fill(0.0);
            right.fill(0.0);
            for &(k, taps) in list(&self.vertical, i) {
                let k = k as usize;
                accumulate(left, &coarse[k * half..][..half], taps[0]);
                accumulate(right, &beside[k * fine..][..fine], taps[0]);
                if let Some((below_coarse, below_fine)) = below {
                    accumulate(left, &below_coarse[k * half..][..half], taps[1]);
                    accumulate(right, &below_fine[k * fine..][..fine], taps[1]);
                }
            }
        });
    }
}

/// Rows of `width` values; as many empty rows as are asked for where the width is 0.
fn halves(values: &mut [f32], width: usize) -> impl Iterator<Item = &mut [f32]> {
    let empty = if width == 0 { usize::MAX } else { 0 };
    values.chunks_mut(width.max(1)).chain(std::iter::repeat_with(|| -> &mut [f32] { &mut [] }).take(empty))
}

fn accumulate(out: &mut [f32], values: &[f32], factor: f32) {
    for (out, value) in out.iter_mut().zip(values) {
        *out += factor * value;
    }
}
