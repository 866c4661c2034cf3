//! Separable FIR filters over a plane, borders repeated.
//!
//! Reckoning, for `n` taps and both directions: `4 n` flops a pixel against 16 bytes of traffic; from about 7 taps on
//! arithmetic decides, so the sums of a block of pixels stay in registers over all taps. Each pixel is computed by itself,
//! so that threads change no bit.

use lacuna_core::parallel::prelude::*;

use super::{Body, Isa, Real, dispatch};
use crate::{Plane, Size};

/// Convolves rows with `along_x` and columns with `along_y` (odd numbers of taps, their centre in the middle), each
/// `out[i] = sum_k taps[k] in[i + k - radius]`, indices clamped to the image.
pub(crate) fn separable(image: &Plane, along_x: &[f32], along_y: &[f32]) -> Plane {
    let rows = horizontal(image, along_x);
    vertical(&rows, along_y)
}

/// Filters each row.
pub(crate) fn horizontal(image: &Plane, taps: &[f32]) -> Plane {
    let (size, radius) = (image.size(), taps.len() / 2);
    let mut out = Plane::filled(size, 0.0);
    if size.pixels() == 0 {
        return out;
    }
    out.pixels_mut().par_chunks_mut(size.width).zip(image.pixels().par_chunks(size.width)).for_each_init(
        Vec::new,
        |padded, (out, row)| {
            pad(row, radius, padded);
            along(padded, taps, out);
        },
    );
    out
}

/// Filters each column.
pub(crate) fn vertical(image: &Plane, taps: &[f32]) -> Plane {
    let (Size { height, width }, radius) = (image.size(), taps.len() / 2);
    let mut out = Plane::filled(image.size(), 0.0);
    if image.size().pixels() == 0 {
        return out;
    }
    out.pixels_mut().par_chunks_mut(width).enumerate().for_each(|(y, out)| {
        let row = |k: usize| image.row((y + k).saturating_sub(radius).min(height - 1));
        let rows: Vec<&[f32]> = (0..taps.len()).map(row).collect();
        across(&rows, taps, out);
    });
    out
}

/// `out[x] = sum_k taps[k] padded[x + k]`.
pub(crate) fn along<T: Real>(padded: &[T], taps: &[T], out: &mut [T]) {
    let rows: Vec<&[T]> = (0..taps.len()).map(|k| &padded[k..]).collect();
    across(&rows, taps, out);
}

/// `out[x] = sum_k taps[k] rows[k][x]`.
pub(crate) fn across<T: Real>(rows: &[&[T]], taps: &[T], out: &mut [T]) {
    dispatch(Isa::best(), Weighted { out, rows, taps });
}

/// Pixels whose sums are kept in registers.
const BLOCK: usize = 32;

/// `out[x] = sum_k taps[k] rows[k][x]`; every row is at least as long as `out`.
struct Weighted<'a, T> {
    out: &'a mut [T],
    rows: &'a [&'a [T]],
    taps: &'a [T],
}

impl<T: Real> Body for Weighted<'_, T> {
    type Output = ();

    #[inline(always)]
    fn run<const FUSED: bool>(self) {
        let width = self.out.len();
        let term = |sum: T, tap: T, value: T| {
            if FUSED { tap.fused(value, sum) } else { sum + tap * value }
        };
        for start in (0..width - width % BLOCK).step_by(BLOCK) {
            let mut sums = [T::ZERO; BLOCK];
            for (row, &tap) in self.rows.iter().zip(self.taps) {
                let block = &row[start..start + BLOCK];
                for (sum, &value) in sums.iter_mut().zip(block) {
                    *sum = term(*sum, tap, value);
                }
            }
            self.out[start..start + BLOCK].copy_from_slice(&sums);
        }
        for x in width - width % BLOCK..width {
            let pairs = self.rows.iter().zip(self.taps);
            self.out[x] = pairs.fold(T::ZERO, |sum, (row, &tap)| term(sum, tap, row[x]));
        }
    }
}

/// The row with its ends repeated `radius` times.
pub(crate) fn pad<T: Copy>(row: &[T], radius: usize, padded: &mut Vec<T>) {
    padded.clear();
    padded.extend(std::iter::repeat_n(row[0], radius));
    padded.extend_from_slice(row);
    padded.extend(std::iter::repeat_n(row[row.len() - 1], radius));
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_instruction_set_agrees() {
        let values: Vec<f32> = (0..90).map(|k| ((k * 37) % 23) as f32 / 7.0 - 1.0).collect();
        let rows: Vec<&[f32]> = (0..5).map(|k| &values[k..]).collect();
        let taps = [0.3, -0.2, 1.0, 0.5, 0.125];
        for isa in Isa::all() {
            let mut out = vec![f32::NAN; 75];
            dispatch(isa, Weighted { out: &mut out, rows: &rows, taps: &taps });
            for (x, out) in out.iter().enumerate() {
                let sum: f64 = (0..5).map(|k| f64::from(taps[k]) * f64::from(values[x + k])).sum();
                assert!((f64::from(*out) - sum).abs() < 32.0 * f64::from(f32::EPSILON), "{isa:?} {x}");
            }
        }
    }

    #[test]
    fn agrees_with_the_definition_at_every_size() {
        let (tx, ty) = ([0.2_f32, -0.5, 1.0, 0.25, 0.125], [0.5_f32, 0.25, -0.75]);
        for (height, width) in [(1, 1), (1, 7), (6, 1), (5, 8), (9, 4)] {
            let image =
                Plane::from_fn(Size::new(height, width), |y, x| ((y * 31 + x * 17) % 11) as f32 - 5.0);
            let out = separable(&image, &tx, &ty);
            for y in 0..height {
                for x in 0..width {
                    let mut sum = 0.0_f64;
                    for (j, &b) in ty.iter().enumerate() {
                        for (i, &a) in tx.iter().enumerate() {
                            let at =
                                |p: usize, k: usize, r: usize, n: usize| (p + k).saturating_sub(r).min(n - 1);
                            let value = image.at(at(y, j, 1, height), at(x, i, 2, width));
                            sum += f64::from(a) * f64::from(b) * f64::from(value);
                        }
                    }
                    assert!((sum - f64::from(out.at(y, x))).abs() < 64.0 * f64::from(f32::EPSILON));
                }
            }
        }
    }
}
