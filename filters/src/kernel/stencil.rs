//! A sum of products of banded matrices, applied to a window of an image.
//!
//! ```text
//! q = sum over t of  V_t p H_t'      V_t: H x H, along columns;  H_t: W x W, along rows;  both banded, reach R <= 4
//! ```
//!
//! The window is a rectangle of the image; what lies outside it counts as zero. Its values stand in a buffer with
//! [`PAD`] rows and columns of zeros around them, see [`Window`].
//!
//! Roofline, per pixel and application at R = 3 with three terms: along rows 3 additions (the taps are symmetric away
//! from the borders) and 12 multiply-adds, along columns 21 multiply-adds: 36 instructions a vector, 69 flops. Lines
//! filtered along rows stay in a ring of 2R+1 lines (10 kB at 128 columns), so a window that fits L2 streams 4 bytes in
//! and 4 bytes out. The loads from L1 (7 + 21 a vector, two a cycle) and the arithmetic (two a cycle) balance: about 18
//! cycles a vector, 1.1 a pixel with 16 lanes; memory bandwidth is no limit.

use rayon::prelude::*;

use super::{Body, Isa, Real, dispatch, fma};
use crate::Size;

/// Longest reach of a row to either side.
pub const REACH: usize = 4;
/// Entries of a row, the diagonal in the middle.
pub const WIDTH: usize = 2 * REACH + 1;
/// Largest number of terms.
pub const TERMS: usize = 4;
/// Zeros around a window.
pub const PAD: usize = 4;
/// Values that a buffer holds beyond its last row, so that whole blocks may be read.
const SLACK: usize = 64;
/// Values in a block: accumulators that stay in registers.
const BLOCK: usize = 32;
/// Rows of a large window that one task computes.
const CHUNK: usize = 48;
/// Windows with more pixels than this are shared out among threads.
const LARGE: usize = 1 << 16;

/// Per term the entries of one row: `REACH + j - i` is that of row `i`, column `j`.
pub type Taps<T> = [[T; WIDTH]; TERMS];

/// The banded matrices of one axis, all terms: rows near the ends of their own, one row inside.
#[derive(Clone, Debug)]
pub struct Axis<T> {
    /// Number of samples.
    pub len: usize,
    /// Rows at either end that differ from those inside; `len` if all are listed.
    pub ends: usize,
    /// Rows `0 .. ends`, then the one inside, then the last, the last but one, and so on.
    classes: Vec<Taps<T>>,
}

impl<T: Real> Axis<T> {
    /// `term(t, class)` gives the entries of a term's row; classes are numbered as in [`Self::row`].
    pub fn new(len: usize, ends: usize, term: impl Fn(usize, usize) -> [f64; WIDTH]) -> Self {
        let count = if ends < len { 2 * ends + 1 } else { len };
        let classes =
            (0..count).map(|class| std::array::from_fn(|t| term(t, class).map(T::from_f64))).collect();
        Self { len, ends, classes }
    }

    /// Per term the entries of row `i`.
    #[inline(always)]
    pub fn row(&self, i: usize) -> &Taps<T> {
        let class = if i < self.ends {
            i
        } else if i + self.ends < self.len {
            self.ends
        } else {
            self.ends + self.len - i
        };
        &self.classes[class]
    }

    fn cast<U: Real>(&self) -> Axis<U> {
        let cast = |taps: &Taps<T>| taps.map(|term| term.map(|x| U::from_f64(x.to_f64())));
        Axis { len: self.len, ends: self.ends, classes: self.classes.iter().map(cast).collect() }
    }
}

/// A sum of products of banded matrices.
#[derive(Clone, Debug)]
pub struct Separable<T> {
    /// Along columns.
    pub vertical: Axis<T>,
    /// Along rows.
    pub horizontal: Axis<T>,
    /// Terms in use, which is also how far a row reaches to either side: 3 or 4.
    pub terms: usize,
}

impl<T: Real> Separable<T> {
    /// The size of the image.
    pub fn size(&self) -> Size {
        Size::new(self.vertical.len, self.horizontal.len)
    }

    /// The same with other numbers.
    pub fn cast<U: Real>(&self) -> Separable<U> {
        Separable { vertical: self.vertical.cast(), horizontal: self.horizontal.cast(), terms: self.terms }
    }

    /// The diagonal entry of pixel `(y, x)`.
    pub fn diagonal(&self, y: usize, x: usize) -> f64 {
        let (rows, columns) = (self.vertical.row(y), self.horizontal.row(x));
        (0..self.terms).map(|t| rows[t][REACH].to_f64() * columns[t][REACH].to_f64()).sum()
    }

    /// The entry between pixels `(y, x)` and `(v, u)`.
    pub fn entry(&self, (y, x): (usize, usize), (v, u): (usize, usize)) -> f64 {
        let (dy, dx) = ((v + REACH).wrapping_sub(y), (u + REACH).wrapping_sub(x));
        if dy >= WIDTH || dx >= WIDTH {
            return 0.0;
        }
        let (rows, columns) = (self.vertical.row(y), self.horizontal.row(x));
        (0..self.terms).map(|t| rows[t][dy].to_f64() * columns[t][dx].to_f64()).sum()
    }
}

/// A rectangle of an image and how its values lie in a buffer.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Window {
    /// First row in the image.
    pub y: usize,
    /// First column in the image.
    pub x: usize,
    /// Number of rows.
    pub height: usize,
    /// Number of columns.
    pub width: usize,
}

impl Window {
    /// Values from one row of a buffer to the next.
    pub const fn stride(self) -> usize {
        (self.width + 2 * PAD).next_multiple_of(16)
    }

    /// Length of a buffer.
    pub const fn len(self) -> usize {
        (self.height + 2 * PAD) * self.stride() + SLACK
    }

    /// Where row `i`, column `j` of the window stands in a buffer.
    #[inline(always)]
    pub const fn at(self, i: usize, j: usize) -> usize {
        (i + PAD) * self.stride() + PAD + j
    }

    /// A buffer of zeros.
    pub fn zeros<T: Real>(self) -> Vec<T> {
        vec![T::ZERO; self.len()]
    }

    /// Number of pixels.
    pub const fn pixels(self) -> usize {
        self.height * self.width
    }

    /// Whether work on it is shared out among threads.
    pub const fn is_large(self) -> bool {
        self.pixels() > LARGE
    }
}

/// `q = (A + diag(d)) p` on a window; returns the sum of `p q`. The padding of `q` stays as it is.
pub fn apply<T: Real>(
    isa: Isa,
    a: &Separable<T>,
    window: Window,
    p: &[T],
    d: Option<&[T]>,
    q: &mut [T],
) -> f64 {
    let stride = window.stride();
    let rows = &mut q[PAD * stride..][..window.height * stride];
    let chunk = |(index, q): (usize, &mut [T])| {
        let body = Apply { a, window, p, d, first: index * CHUNK, q };
        match a.terms {
            3 => dispatch(isa, Sized::<T, 3>(body)),
            _ => dispatch(isa, Sized::<T, 4>(body)),
        }
    };
    let sums: Vec<Vec<f64>> = if window.is_large() {
        rows.par_chunks_mut(CHUNK * stride).enumerate().map(chunk).collect()
    } else {
        rows.chunks_mut(CHUNK * stride).enumerate().map(chunk).collect()
    };
    sums.iter().flatten().sum()
}

struct Apply<'a, T> {
    a: &'a Separable<T>,
    window: Window,
    p: &'a [T],
    d: Option<&'a [T]>,
    first: usize,
    q: &'a mut [T],
}

/// The body for a number of terms that the compiler knows.
struct Sized<'a, T, const R: usize>(Apply<'a, T>);

impl<T: Real, const R: usize> Body for Sized<'_, T, R> {
    type Output = Vec<f64>;

    #[inline(always)]
    fn run<const FUSED: bool>(self) -> Vec<f64> {
        let Apply { a, window, p, d, first, q } = self.0;
        let stride = window.stride();
        let count = q.len() / stride;
        let span = window.width.next_multiple_of(BLOCK);
        let depth = 2 * R + 1;
        let mut ring = vec![T::ZERO; R * depth * span];
        let mut sums = Vec::with_capacity(count);
        // Row `first + step - R` of the window goes into the ring; then row `first + step - 2R` can be computed.
        for step in 0..count + 2 * R {
            let slot = step % depth;
            let lines = &mut ring[slot * R * span..][..R * span];
            match (first + step).checked_sub(R).filter(|&i| i < window.height) {
                Some(i) => along_row::<T, R, FUSED>(a, window, &p[(i + PAD) * stride..], lines),
                None => lines.fill(T::ZERO),
            }
            let Some(output) = step.checked_sub(2 * R) else { continue };
            let i = first + output;
            let taps = a.vertical.row(window.y + i);
            let from = window.at(i, 0);
            let row = Row { ring: &ring, span, oldest: (slot + 1) % depth, width: window.width };
            let d = d.map(|d| &d[from..]);
            sums.push(along_columns::<T, R, FUSED>(
                row,
                taps,
                &p[from..],
                d,
                &mut q[output * stride + PAD..],
            ));
        }
        sums
    }
}

/// Filters a row with each term's taps.
#[inline(always)]
fn along_row<T: Real, const R: usize, const FUSED: bool>(
    a: &Separable<T>,
    window: Window,
    row: &[T],
    lines: &mut [T],
) {
    let axis = &a.horizontal;
    let span = lines.len() / R;
    let taps = axis.row(axis.len / 2);
    let mut lines: [&mut [T]; R] = {
        let mut parts = lines.chunks_exact_mut(span);
        std::array::from_fn(|_| parts.next().unwrap_or_default())
    };
    if window.width > 2 * axis.ends || axis.ends < axis.len {
        for j in (0..span).step_by(BLOCK) {
            let source = &row[j..j + BLOCK + 2 * PAD];
            let mut sums = [[T::ZERO; BLOCK]; R];
            for k in 0..=R {
                let mut pair = [T::ZERO; BLOCK];
                for (i, value) in pair.iter_mut().enumerate() {
                    *value = if k == 0 { source[PAD + i] } else { source[PAD + i - k] + source[PAD + i + k] };
                }
                for (sum, term) in sums.iter_mut().zip(taps) {
                    for (sum, value) in sum.iter_mut().zip(&pair) {
                        *sum = fma::<T, FUSED>(term[REACH + k], *value, *sum);
                    }
                }
            }
            for (line, sum) in lines.iter_mut().zip(&sums) {
                line[j..j + BLOCK].copy_from_slice(sum);
            }
        }
    }
    // Columns near the image's borders have rows of their own.
    let left = axis.ends.saturating_sub(window.x).min(window.width);
    let right = (axis.len - axis.ends).saturating_sub(window.x).clamp(left, window.width);
    for j in (0..left).chain(right..window.width) {
        let taps = axis.row(window.x + j);
        for (line, term) in lines.iter_mut().zip(taps) {
            let mut sum = T::ZERO;
            for k in 0..=2 * R {
                sum = fma::<T, FUSED>(term[REACH - R + k], row[PAD - R + j + k], sum);
            }
            line[j] = sum;
        }
    }
}

/// The ring of filtered lines: `(slot * R + term) * span`.
#[derive(Clone, Copy)]
struct Row<'a, T> {
    ring: &'a [T],
    span: usize,
    oldest: usize,
    width: usize,
}

/// Sums the lines around a row, each with its tap, into `q`; returns the sum of `p q`.
#[inline(always)]
fn along_columns<T: Real, const R: usize, const FUSED: bool>(
    row: Row<'_, T>,
    taps: &Taps<T>,
    p: &[T],
    d: Option<&[T]>,
    q: &mut [T],
) -> f64 {
    let depth = 2 * R + 1;
    let mut dots = [T::ZERO; BLOCK];
    for j in (0..row.width).step_by(BLOCK) {
        let mut sums = [T::ZERO; BLOCK];
        for k in 0..depth {
            let slot = if row.oldest + k < depth { row.oldest + k } else { row.oldest + k - depth };
            for (t, term) in taps.iter().enumerate().take(R) {
                let line = &row.ring[(slot * R + t) * row.span + j..][..BLOCK];
                for (sum, value) in sums.iter_mut().zip(line) {
                    *sum = fma::<T, FUSED>(term[REACH - R + k], *value, *sum);
                }
            }
        }
        let n = BLOCK.min(row.width - j);
        if let Some(d) = d {
            for i in 0..n {
                sums[i] = fma::<T, FUSED>(d[j + i], p[j + i], sums[i]);
            }
        }
        if n == BLOCK {
            let p = &p[j..j + BLOCK];
            for i in 0..BLOCK {
                dots[i] = fma::<T, FUSED>(p[i], sums[i], dots[i]);
            }
            q[j..j + BLOCK].copy_from_slice(&sums);
        } else {
            for i in 0..n {
                dots[i] = fma::<T, FUSED>(p[j + i], sums[i], dots[i]);
            }
            q[j..j + n].copy_from_slice(&sums[..n]);
        }
    }
    dots.iter().map(|x| x.to_f64()).sum()
}
