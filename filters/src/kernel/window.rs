//! Windows of an image and the banded matrices of its axes: what the kernels of [`super::stencil`] and [`super::interior`] share.

use lacuna_core::parallel::prelude::*;

use super::Real;

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

    pub(super) fn cast<U: Real>(&self) -> Axis<U> {
        let cast = |taps: &Taps<T>| taps.map(|term| term.map(|x| U::from_f64(x.to_f64())));
        Axis { len: self.len, ends: self.ends, classes: self.classes.iter().map(cast).collect() }
    }
}

/// A rectangle of an image and how its values lie in a buffer.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
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

    /// Hands a buffer's rows, whole strides of so many rows each time, to a task with the number of the first.
    pub fn in_chunks<T: Send>(
        self,
        values: &mut [T],
        rows: usize,
        task: impl Fn(usize, &mut [T]) + Sync + Send,
    ) {
        let stride = self.stride();
        let values = &mut values[PAD * stride..][..self.height * stride];
        let chunks = values.par_chunks_mut(rows * stride).enumerate();
        chunks.shared_if(self.is_large()).for_each(|(k, chunk)| task(k * rows, chunk));
    }
}
