//! `G' G r` on a tile, row by row, with a sparse lower triangular `G` whose rows differ from pixel to pixel.
//!
//! Row `k` of `G` holds a weight for pixel `k` and one for each of the nine pixels [`BEFORE`] it. `G` is the factor of an
//! approximate inverse of the energy among the free pixels (`solver/factor.rs`), zero in the rows and columns of the others.
//! With `y = G r`, a block of one vector of columns goes down row by row: the weights of row `i` give `y` there and, times
//! `y`, what `G' y` is to receive in rows `i`, `i - 1` and `i - 2`. That is summed by the column it stands in now, which is
//! one to the right of its place, there, or one or two to the left; the four sums of a row are complete two rows later, and
//! another row later, when the neighbouring blocks have theirs, they are put in place and added.
//!
//! Weights need few digits: two of them share a number ([`Real::packed`]), with 8 bits each in f32, which changes no
//! eigenvalue of the preconditioned energy by a hundredth.
//!
//! Roofline, per vector: 5 numbers unpacked by 15 shifts, 10 multiplications or multiply-adds for `y` and 10 for the sums, 3
//! additions: 38 instructions; 26 loads and 11 stores, of which 5 loads meet L2 (20 bytes a pixel).

use std::iter::Zip;
use std::slice::ChunksExact;

use super::aligned::Aligned;
use super::simd::{MOST, Vector};
use super::{Body, Isa, Real, dispatch};

/// The pixels before one that a row of `G` has weights for: rows above it, columns to its right.
pub const BEFORE: [(usize, isize); 9] =
    [(0, -2), (0, -1), (1, -2), (1, -1), (1, 0), (1, 1), (2, -1), (2, 0), (2, 1)];
/// Weights in a row: of the pixel itself, then of those before it.
pub const WEIGHTS: usize = 1 + BEFORE.len();
/// Buffers that hold the weights.
pub const PLANES: usize = WEIGHTS / 2;
/// Sets of free pixels among one and those before it.
pub const PATTERNS: usize = 1 << WEIGHTS;
/// Rows below the window where the planes must be zero.
pub const BELOW: usize = 2;
/// Rows between one whose residual is known and one whose `G' G r` is.
pub const LATE: usize = 4;
/// Columns to the left of a block that its rows of `G` see.
const ASIDE: usize = 2;
/// The same on both sides: there is one to the right.
const BESIDE: usize = ASIDE + 1;
/// How far `G' G` reaches.
pub const REACH: usize = BESIDE;
/// Columns that sums stand in, relative to their place: 2 or 1 to the left, there, 1 to the right.
const PLACES: usize = 4;

/// A row of weights as the planes hold it.
pub fn pack<T: Real>(weights: &[f64; WEIGHTS]) -> [T; PLANES] {
    std::array::from_fn(|k| T::packed(T::from_f64(weights[2 * k]), T::from_f64(weights[2 * k + 1])))
}

/// Which of each pixel in a row and those [`BEFORE`] it are free, as a number below [`PATTERNS`]: a bit for each of those
/// before it, then one for itself. The row begins at `start` in `e`, which is 1 at free pixels and 0 elsewhere.
pub fn patterns(isa: Isa, e: &[f32], (start, stride): (usize, usize), line: &mut [u32]) {
    dispatch(isa, Find { e, start, line: &mut line[..stride] });
}

struct Find<'a> {
    e: &'a [f32],
    start: usize,
    line: &'a mut [u32],
}

impl Body for Find<'_> {
    type Output = ();
    #[inline(always)]
    fn run<const FUSED: bool>(self) {
        let (e, stride) = (self.e, self.line.len());
        // A bit that 1 has and 0 has not.
        let one = 1.0_f32.to_bits().trailing_zeros();
        self.line.fill(0);
        for (bit, (up, right)) in BEFORE.into_iter().chain([(0, 0)]).enumerate() {
            let from = &e[(self.start - up * stride).wrapping_add_signed(right)..][..stride];
            for (pattern, e) in self.line.iter_mut().zip(from) {
                *pattern |= (e.to_bits() >> one & 1) << bit;
            }
        }
    }
}

/// What is carried down the rows.
pub struct Carried<V: Vector> {
    blocks: Vec<Sums<V>>,
    /// The complete sums of two rows, place by place.
    lines: [Aligned<V::Number>; 2],
    stride: usize,
}

impl<V: Vector> Carried<V> {
    /// Nothing yet, for windows with rows of this stride.
    #[inline(always)]
    pub fn new(stride: usize) -> Self {
        let line = || Aligned::zeros(PLACES * (stride + 2 * MOST));
        Self { blocks: vec![Sums::new(); stride / V::LANES], lines: [line(), line()], stride }
    }

    /// Takes row `i`, which begins at `start` in the buffers; rows to `BELOW` below the window must be taken, too. Returns
    /// `square` and the squares of `y`.
    #[inline(always)]
    pub fn take(
        &mut self,
        (i, start): (usize, usize),
        planes: &[&[V::Number]; PLANES],
        r: &[V::Number],
        square: V,
    ) -> V {
        let (stride, length) = (self.stride, self.stride + 2 * MOST);
        let near = |up: usize| &r[start - up * stride - ASIDE..][..stride + BESIDE];
        let near = (near(0), near(1), near(2));
        let weights = |k: usize| &planes[k][start..][..stride];
        let (far, rest) = self.lines[i % 2].split_at_mut(length);
        let (left, rest) = rest.split_at_mut(length);
        let (here, right) = rest.split_at_mut(length);
        // One by one, so that the compiler sees how long a block is.
        let lines = far[MOST..][..stride].chunks_exact_mut(V::LANES);
        let lines = lines.zip(left[MOST..][..stride].chunks_exact_mut(V::LANES));
        let lines = lines.zip(here[MOST..][..stride].chunks_exact_mut(V::LANES));
        let lines = lines.zip(right[MOST..][..stride].chunks_exact_mut(V::LANES));
        let weights = weights(0)
            .chunks_exact(V::LANES)
            .zip(weights(1).chunks_exact(V::LANES))
            .zip(weights(2).chunks_exact(V::LANES).zip(weights(3).chunks_exact(V::LANES)))
            .zip(weights(4).chunks_exact(V::LANES));
        let mut square = square;
        for (block, (sums, ((((a, b), (c, d)), e), (((far, left), here), right)))) in
            self.blocks.iter_mut().zip(weights.zip(lines)).enumerate()
        {
            let from = block * V::LANES;
            let own_row = &near.0[from..from + V::LANES + BESIDE];
            let above = &near.1[from..from + V::LANES + BESIDE];
            let over = &near.2[from..from + V::LANES + BESIDE];
            let (own, w0) = V::load(a).halves();
            let ((w1, w2), (w3, w4)) = (V::load(b).halves(), V::load(c).halves());
            let ((w5, w6), (w7, w8)) = (V::load(d).halves(), V::load(e).halves());
            let mut y = own.times(V::load(&own_row[2..]));
            y = w0.fused(V::load(own_row), y);
            y = w1.fused(V::load(&own_row[1..]), y);
            let mut z = w2.times(V::load(above));
            z = w3.fused(V::load(&above[1..]), z);
            z = w4.fused(V::load(&above[2..]), z);
            z = w5.fused(V::load(&above[3..]), z);
            y = w6.fused(V::load(&over[1..]), y);
            y = w7.fused(V::load(&over[2..]), y);
            z = w8.fused(V::load(&over[3..]), z);
            let y = y.plus(z);
            square = y.fused(y, square);
            let complete = sums.push(y, [w0, w2], [w1, w3, w6], [own, w4, w7], [w5, w8]);
            complete[0].store(far);
            complete[1].store(left);
            complete[2].store(here);
            complete[3].store(right);
        }
        square
    }

    /// The sums of row `i`, each moved to its place, once row `i + 2` was taken and before row `i + 4` is: blocks whose
    /// [`added`] is `G' G r`.
    #[inline(always)]
    pub fn row(&self, i: usize) -> Placed<'_, V::Number> {
        let (length, line) = (self.stride + 2 * MOST, &self.lines[i % 2]);
        let from = |place: usize| place * length + MOST + ASIDE - place;
        let far = line[from(0)..][..self.stride].chunks_exact(V::LANES);
        let left = line[from(1)..][..self.stride].chunks_exact(V::LANES);
        let here = line[from(2)..][..self.stride].chunks_exact(V::LANES);
        let right = line[from(3)..][..self.stride].chunks_exact(V::LANES);
        far.zip(left).zip(here.zip(right))
    }
}

/// The four sums of blocks in their place.
pub type Placed<'a, T> = Zip<Zip<Chunks<'a, T>, Chunks<'a, T>>, Zip<Chunks<'a, T>, Chunks<'a, T>>>;
type Chunks<'a, T> = ChunksExact<'a, T>;
type Blocks<'a, T> = (&'a [T], &'a [T]);

/// A block of `G' G r`.
#[inline(always)]
pub fn added<V: Vector>(((far, left), (here, right)): (Blocks<'_, V::Number>, Blocks<'_, V::Number>)) -> V {
    V::load(far).plus(V::load(left)).plus(V::load(here).plus(V::load(right)))
}

/// Sums of a block that lack what rows to come add.
#[derive(Clone, Copy)]
struct Sums<V> {
    /// Of the latest row: two to the left, one to the left, in place.
    latest: [V; 3],
    /// Of the row above it, in all places.
    above: [V; PLACES],
}

impl<V: Vector> Sums<V> {
    #[inline(always)]
    fn new() -> Self {
        let zero = V::splat(V::Number::ZERO);
        Self { latest: [zero; 3], above: [zero; PLACES] }
    }

    /// Takes `y` of a row and its weights, by place and by how far above they reach; returns the sums of the row two above.
    #[inline(always)]
    fn push(&mut self, y: V, far: [V; 2], left: [V; 3], here: [V; 3], right: [V; 2]) -> [V; PLACES] {
        let Self { latest, above } = self;
        let complete =
            [above[0], left[2].fused(y, above[1]), here[2].fused(y, above[2]), right[1].fused(y, above[3])];
        *above = [
            far[1].fused(y, latest[0]),
            left[1].fused(y, latest[1]),
            here[1].fused(y, latest[2]),
            right[0].times(y),
        ];
        *latest = [far[0].times(y), left[0].times(y), here[0].times(y)];
        complete
    }
}

#[cfg(test)]
mod tests;
