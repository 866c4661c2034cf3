//! Prolongation of a coarse image to twice its resolution, and its adjoint, on windows.
//!
//! Pixels are cells: coarse cell `c` covers fine cells `2c` and `2c + 1`, whose centres lie a quarter of a coarse pixel
//! to either side of its own. Along each axis a fine value is the cubic through four coarse ones (dual four-point
//! scheme: weights -5, 35, 105, -7 over 128). Beyond the image coarse values go on linearly; beyond a window they are
//! zero. The restriction is the transpose, so a value's weights sum to 2 along each axis.
//!
//! Source: N. Dyn, M. Floater, K. Hormann, "A C2 four-point subdivision scheme with fourth order accuracy and its
//! extensions", Mathematical Methods for Curves and Surfaces, 2005.

use crate::kernel::resample::{Prolong, Restrict};
use crate::kernel::spans::Spans;
use crate::kernel::window::{PAD, Window};
use crate::kernel::{Isa, Real, dispatch};

/// Rows that one task computes.
const CHUNK: usize = 16;

/// Weights for fine cells and for coarse cells along one axis; a cell's sources begin at `2`-fold known places.
#[derive(Clone, Debug)]
struct Axis<T> {
    /// Per fine cell: its four sources begin at coarse cell `cell / 2 - 2 + cell % 2`.
    up: Vec<[T; 4]>,
    /// Per coarse cell: its eight sources begin at fine cell `2 cell - 3`.
    down: Vec<[T; 8]>,
}

impl<T: Real> Axis<T> {
    /// For a window of `fine` cells from cell `first` (even) of an image of `image` cells.
    fn new(first: usize, fine: usize, image: usize) -> Self {
        let coarse_image = image.div_ceil(2);
        let mut down = vec![[0.0; 8]; fine.div_ceil(2)];
        let up = (0..fine)
            .map(|i| {
                let weights = weights(first + i, image, coarse_image);
                for (k, &weight) in weights.iter().enumerate() {
                    let coarse = (i / 2 + i % 2 + k).wrapping_sub(2);
                    if let Some(row) = down.get_mut(coarse) {
                        row[i + 3 - 2 * coarse] = weight;
                    }
                }
                weights.map(T::from_f64)
            })
            .collect();
        Self { up, down: down.into_iter().map(|row| row.map(T::from_f64)).collect() }
    }
}

/// The weights of coarse cells `cell / 2 - 2 + cell % 2 ..` for a fine cell.
fn weights(cell: usize, image: usize, coarse_image: usize) -> [f64; 4] {
    let mut result = [0.0; 4];
    let start = (cell / 2 + cell % 2) as isize - 2;
    let mut add = |node: isize, weight: f64| {
        if let Some(sum) = result.get_mut((node - start) as usize) {
            *sum += weight;
        }
    };
    if image == 1 {
        add(0, 1.0);
        return result;
    }
    let cubic = if cell.is_multiple_of(2) { [-5.0, 35.0, 105.0, -7.0] } else { [-7.0, 105.0, 35.0, -5.0] };
    let last = coarse_image as isize - 1;
    for (k, weight) in cubic.into_iter().enumerate() {
        let node = start + k as isize;
        let weight = weight / 128.0;
        let (edge, beyond, inward) = if node < 0 { (0, -node, 1) } else { (last, (node - last).max(0), -1) };
        if (0..=last).contains(&node) {
            add(node, weight);
        } else if last == 0 {
            add(0, weight);
        } else {
            add(edge, weight * (1.0 + beyond as f64));
            add(edge + inward, -weight * beyond as f64);
        }
    }
    result
}

/// Prolongation from a coarse window to a fine one, and its adjoint.
#[derive(Clone, Debug)]
pub struct Resample<T> {
    isa: Isa,
    fine: Window,
    coarse: Window,
    vertical: Axis<T>,
    /// Along rows, per coarse cell: four weights of its first fine cell, four of its second.
    up: [Vec<T>; 8],
    /// Along rows, per coarse cell: its eight weights.
    down: [Vec<T>; 8],
}

impl<T: Real> Resample<T> {
    /// Between `fine`, a window of an image of `height x width` whose first row and column are even, and the window
    /// of coarse cells that cover it.
    pub fn new(isa: Isa, fine: Window, height: usize, width: usize) -> Self {
        let coarse = Window {
            y: fine.y / 2,
            x: fine.x / 2,
            height: fine.height.div_ceil(2),
            width: fine.width.div_ceil(2),
        };
        let horizontal = Axis::new(fine.x, fine.width, width);
        let none = [T::ZERO; 4];
        let up = std::array::from_fn(|k| {
            let cell = |c: usize| horizontal.up.get(2 * c + k / 4).unwrap_or(&none)[k % 4];
            (0..coarse.width).map(cell).collect()
        });
        let down = std::array::from_fn(|k| horizontal.down.iter().map(|row| row[k]).collect());
        Self { isa, fine, coarse, vertical: Axis::new(fine.y, fine.height, height), up, down }
    }

    /// The coarse window.
    pub fn coarse(&self) -> Window {
        self.coarse
    }

    /// Adds the prolonged `coarse`, times `share` if there is one, to those rows of `fine` that have spans.
    pub fn prolong_add(&self, coarse: &[T], share: Option<&[T]>, spans: &Spans, fine: &mut [T]) {
        let (stride, from) = (self.fine.stride(), self.coarse.stride());
        self.fine.in_chunks(fine, CHUNK, |top, rows| {
            let mut room = Vec::new();
            for (k, out) in rows.chunks_mut(stride).enumerate() {
                let i = top + k;
                let Some(columns) = spans.columns(i..i + 1, 0..self.fine.width) else { continue };
                let (first, cells) = (i / 2 + i % 2 + PAD - 2, columns.start / 2..columns.end.div_ceil(2));
                let own = 2 * cells.start..columns.end;
                let body = Prolong {
                    vertical: &self.vertical.up[i],
                    sources: std::array::from_fn(|k| {
                        &coarse[(first + k) * from..][cells.start..cells.end + 2 * PAD]
                    }),
                    horizontal: self.up.each_ref().map(|weights| &weights[cells.clone()]),
                    share: share.map(|share| &share[self.fine.at(i, own.start)..][..own.len()]),
                    out: &mut out[PAD + own.start..][..own.len()],
                    room: &mut room,
                };
                dispatch(self.isa, body);
            }
        });
    }

    /// Sets rows of `coarse`, whole strides from row `first` of its window on, to those of the adjoint's image of `fine`. This
    /// begins with row `2 first - 3` of the fine window (counted in its padding) and is zero beside the window. Rows without spans, and
    /// what is beside the spans of others, may become anything.
    pub fn restrict(&self, first: usize, fine: &[T], spans: &Spans, coarse: &mut [T]) {
        let (from, width) = (self.fine.stride(), self.coarse.width);
        let mut room = Vec::new();
        for (k, out) in coarse.chunks_mut(self.coarse.stride()).enumerate() {
            let Some(cells) = spans.columns(first + k..first + k + 1, 0..width) else { continue };
            // What a cell takes begins three fine ones before it; in the padding, four before the first.
            let near = 2 * cells.start..from.min(2 * cells.end + 2 * PAD);
            let body = Restrict {
                vertical: &self.vertical.down[first + k],
                sources: std::array::from_fn(|tap| &fine[(2 * k + tap) * from..][near.clone()]),
                horizontal: self.down.each_ref().map(|weights| &weights[cells.clone()]),
                out: &mut out[PAD + cells.start..][..cells.len()],
                room: &mut room,
            };
            dispatch(self.isa, body);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn window(height: usize, width: usize) -> Window {
        Window { y: 0, x: 0, height, width }
    }

    fn fill(window: Window, value: impl Fn(usize, usize) -> f64) -> Vec<f64> {
        let mut buffer = window.zeros();
        for i in 0..window.height {
            for j in 0..window.width {
                buffer[window.at(i, j)] = value(i, j);
            }
        }
        buffer
    }

    #[test]
    fn restriction_is_the_adjoint() {
        for (height, width) in [(1, 1), (1, 7), (8, 1), (2, 2), (3, 5), (16, 9), (300, 301)] {
            let fine = window(height, width);
            for isa in Isa::all() {
                let resample = Resample::<f64>::new(isa, fine, height, width);
                let coarse = resample.coarse();
                let noise = |seed: f64| move |i: usize, j: usize| ((i * 37 + j * 101) as f64 * seed).sin();
                let (f, c) = (fill(fine, noise(0.7)), fill(coarse, noise(0.3)));
                let (mut up, mut down) = (fine.zeros(), coarse.zeros());
                resample.prolong_add(&c, None, &Spans::all(fine), &mut up);
                let (from, to) = (fine.stride(), coarse.stride());
                resample.restrict(
                    0,
                    &f[(PAD - 3) * from..],
                    &Spans::all(coarse),
                    &mut down[PAD * to..][..coarse.height * to],
                );
                let dot = |a: &[f64], b: &[f64]| a.iter().zip(b).map(|(a, b)| a * b).sum::<f64>();
                let (left, right) = (dot(&f, &up), dot(&down, &c));
                assert!((left - right).abs() <= 1e-13 * (height * width) as f64, "{left} {right}");
            }
        }
    }

    #[test]
    fn planes_are_prolonged_exactly() {
        let fine = window(9, 14);
        let resample = Resample::<f64>::new(Isa::best(), fine, 9, 14);
        let plane = |y: f64, x: f64| 1.0 + 0.25 * y - 0.5 * x;
        let centre = |c: usize| 2.0 * c as f64 + 0.5;
        let coarse = fill(resample.coarse(), |i, j| plane(centre(i), centre(j)));
        let mut up = fine.zeros();
        resample.prolong_add(&coarse, None, &Spans::all(fine), &mut up);
        for i in 0..9 {
            for j in 0..14 {
                assert!((up[fine.at(i, j)] - plane(i as f64, j as f64)).abs() < 1e-13);
            }
        }
    }
}
