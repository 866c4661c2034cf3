//! One step of conjugate gradients on a tile in a single pass.
//!
//! With the energy `A` and a preconditioner `M` ([`Preconditioner`]) a step is
//!
//! ```text
//! p = u + b p      s = w + b s      x = x + a p      r = r - a s      u = M r      w = A u
//! ```
//!
//! with the sums `r' M r` and `u' A u` from which the next `a` and `b` follow; if `M = D (B + c) D`, `r`, `s` and `w` are
//! kept multiplied by `D`. This is the arrangement of A. Chronopoulos and C. Gear, whose two sums do not wait for each other,
//! so that all of a step can follow the rows down: row `i` is updated, then row `i - 2` blurred (with the sparse factor `i - 4`
//! is multiplied), then row `i - 3 - R` (or `i - 5 - R`) of `A u` is complete. What Horner's scheme ([`super::interior`]) needs
//! of the rows before stays in L1.
//!
//! Roofline, per vector at R = 3: 6 arithmetic instructions for the updates, 9 for the blur and its sums, 30 for `A u` and
//! its sum: 45, which two a cycle make 23 cycles, 1.4 a pixel with 16 lanes of f32. 30 loads and 17 stores meet L1 only;
//! 13 streams of 4 bytes a pixel go to and from L2, 17 to 21 cycles at 40 to 48 bytes a cycle. All rows begin at
//! multiples of a cache line, as vectors that lie across two would double the loads and stores.
//!
//! Source: A. Chronopoulos, C. Gear, "s-step iterative methods for symmetric linear systems", Journal of Computational
//! and Applied Mathematics 25, 1989.

use std::ops::Range;

use super::aligned::Aligned;
use super::factor::{BELOW, Carried, LATE, Placed, added};
use super::interior::{Interior, Scheme, Taps};
use super::preconditioner::Preconditioner;
use super::simd::{Lanes, MOST, Vector, Vectored, largest, pairs, sum, vectors};
use super::stencil::{Separable, near_ends};
use super::window::{PAD, Window};
use super::{Isa, Real};

/// Rows after which a sum's lanes are added up: few, so that f32 loses nothing that matters.
const RUN: usize = 4;

/// What a pass reads and changes: buffers of one window. `u` and `r` are zero in the rows of padding; elsewhere the padding
/// holds any finite numbers.
pub struct Buffers<'a, T> {
    /// The preconditioner.
    pub m: Preconditioner<'a, T>,
    /// The image.
    pub x: &'a mut [T],
    /// The residual: with a blur times `D`, else with any finite numbers where pixels are not free; so are `w` and `s`.
    pub r: &'a mut [T],
    /// The preconditioned residual.
    pub u: &'a mut [T],
    /// `A u`; when it begins, `A x`.
    pub w: &'a mut [T],
    /// The direction.
    pub p: &'a mut [T],
    /// `A p`.
    pub s: &'a mut [T],
}

/// What comes before the blur.
#[derive(Clone, Copy, Debug)]
pub enum Move {
    /// `w` is `A x` and `r` becomes `-w`.
    Begin,
    /// The first step, of this length: directions begin.
    First(f64),
    /// A step: its length `a` and the share `b` of the direction before.
    Step(f64, f64),
}

/// The sums of a pass.
#[derive(Clone, Copy, Debug)]
pub struct Sums {
    /// `r' M r`.
    pub square: f64,
    /// `u' A u`; 0 if it was not asked for.
    pub curvature: f64,
    /// The largest `|u|`.
    pub top: f64,
}

/// Moves, and computes `u`; also `w = A u` if `applies`.
pub fn pass<T: Lanes>(
    isa: Isa,
    a: &Separable<T>,
    window: Window,
    (what, applies): (Move, bool),
    buffers: Buffers<'_, T>,
) -> Sums {
    let inside = if applies { a.inside(window) } else { 0..0 };
    let (length, share) = match what {
        Move::Begin => (0.0, 0.0),
        Move::First(length) => (length, 0.0),
        Move::Step(length, share) => (length, share),
    };
    let rows = (inside.start, inside.end);
    let numbers = (T::from_f64(length), T::from_f64(share));
    let mut pass = Pass { interior: a.interior(), window, what, numbers, rows, buffers };
    let mut sums = match (pass.buffers.m, a.terms) {
        (Preconditioner::Blur { .. }, 3) => pairs(isa, Sized::<T, 3, false>(&mut pass)),
        (Preconditioner::Blur { .. }, _) => pairs(isa, Sized::<T, 4, false>(&mut pass)),
        (Preconditioner::Factor(_), 3) => pairs(isa, Sized::<T, 3, true>(&mut pass)),
        (Preconditioner::Factor(_), _) => pairs(isa, Sized::<T, 4, true>(&mut pass)),
    };
    if applies {
        let Buffers { m, u, w, .. } = pass.buffers;
        for rows in [0..inside.start, inside.end..window.height] {
            if !rows.is_empty() {
                let own = window.at(rows.start, 0) - PAD..window.at(rows.end, 0) - PAD;
                sums.curvature += near_ends(isa, a, window, u, rows.start, &mut w[own.clone()]);
                if let Preconditioner::Blur { d, .. } = m {
                    w[own.clone()].iter_mut().zip(&d[own]).for_each(|(w, &d)| *w = d * *w);
                }
            }
        }
    }
    sums
}

/// The diagonal `D` of the preconditioner, `d = e (B e) / 16`: at free pixels the share of the blur's weights that falls
/// on free ones, so that a pixel beside measured ones, whose neighbours pull less, moves less. `e` is 1 at free pixels and 0
/// elsewhere, in whole strides of the window's rows; all of them are set in `d`.
///
/// Against `D = E` it saves a seventh of the steps at low-discrepancy samples, a third at random ones (20 %).
pub fn shares<T: Lanes>(isa: Isa, window: Window, e: &[T], d: &mut [T]) {
    vectors(isa, Shares { window, e, d });
}

struct Shares<'a, T> {
    window: Window,
    e: &'a [T],
    d: &'a mut [T],
}

impl<T: Real> Vectored<T> for Shares<'_, T> {
    type Output = ();

    #[inline(always)]
    fn run<V: Vector<Number = T>>(self) {
        let stride = self.window.stride();
        let mut line = vec![T::ZERO; stride + 2 * MOST];
        let none = vec![T::ZERO; stride];
        let row = |i: usize| &self.e[(i + PAD) * stride..][..stride];
        let (two, sixteenth) = (V::splat(T::from_f64(2.0)), V::splat(T::from_f64(1.0 / 16.0)));
        for i in 0..self.window.height {
            let above = if i > 0 { row(i - 1) } else { &none };
            let below = if i + 1 < self.window.height { row(i + 1) } else { &none };
            let rows = above.chunks_exact(V::LANES).zip(row(i).chunks_exact(V::LANES));
            let rows = rows.zip(below.chunks_exact(V::LANES));
            let lines = line[MOST..][..stride].chunks_exact_mut(V::LANES);
            for (((above, here), below), line) in rows.zip(lines) {
                two.fused(V::load(here), V::load(above).plus(V::load(below))).store(line);
            }
            let shifted = |by: usize| line[MOST + by - 1..][..stride].chunks_exact(V::LANES);
            let lines = shifted(0).zip(shifted(1)).zip(shifted(2));
            let out = self.d[(i + PAD) * stride..][..stride].chunks_exact_mut(V::LANES);
            for ((((left, middle), right), e), out) in lines.zip(row(i).chunks_exact(V::LANES)).zip(out) {
                let blurred = blurred(V::load(left), V::load(middle), V::load(right));
                V::load(e).times(blurred.times(sixteenth)).store(out);
            }
        }
    }
}

struct Pass<'a, T> {
    interior: Option<&'a Interior<T>>,
    window: Window,
    what: Move,
    /// Length and share.
    numbers: (T, T),
    /// The rows of `w` that are computed here: none of them is near an end.
    rows: (usize, usize),
    buffers: Buffers<'a, T>,
}

/// The body for a reach and a kind of preconditioner that the compiler knows.
struct Sized<'a, 'b, T, const R: usize, const FACTOR: bool>(&'a mut Pass<'b, T>);

/// Lanes of the sums.
struct Totals<V> {
    square: V,
    curvature: V,
    top: V,
}

impl<T: Real, const R: usize, const FACTOR: bool> Vectored<T> for Sized<'_, '_, T, R, FACTOR> {
    type Output = Sums;

    #[inline(always)]
    fn run<V: Vector<Number = T>>(self) -> Sums {
        let pass = self.0;
        let (height, stride) = (pass.window.height, pass.window.stride());
        let zero = V::splat(T::ZERO);
        // Sums of three rows, of the latest two rows, and room beside their ends.
        let length = stride + 2 * MOST;
        let mut lines = Aligned::zeros(2 * length);
        let (even, odd) = lines.split_at_mut(length);
        let lines = [even, odd];
        let taps = pass.interior.map(Taps::<V, R>::new);
        let mut schemes = vec![Scheme::<V, R>::new(); stride / V::LANES];
        let mut sums = Sums { square: 0.0, curvature: 0.0, top: 0.0 };
        let mut totals = Totals { square: zero, curvature: zero, top: zero };
        let (from, to) = pass.rows;
        let last = if from < to { to + R } else { height };
        let mut carried = FACTOR.then(|| Carried::<V>::new(stride));
        let late = if FACTOR { LATE } else { 2 };
        let rows = last.max(height) + late + 1;
        // Every loop works on what the one before it has left a row earlier: what lies across two vectors cannot be loaded
        // before both have reached the cache.
        for row in 0..rows {
            if row <= height {
                let line = &mut *lines[row % 2];
                match pass.what {
                    Move::Begin => pass.update::<V, 0, FACTOR>(row, line),
                    Move::First(_) => pass.update::<V, 1, FACTOR>(row, line),
                    Move::Step(..) => pass.update::<V, 2, FACTOR>(row, line),
                }
            }
            if let Some(row) = row.checked_sub(late + 1) {
                // Rows from `from - R` on reach the first that is asked for.
                if let (Some(taps), true) = (&taps, from < to && row + R >= from && row < to + R) {
                    pass.matrix::<V, R, FACTOR>(row, taps, &mut schemes, &mut totals);
                }
            }
            if let (Some(carried), Some(row)) = (&mut carried, row.checked_sub(1)) {
                pass.take(row, carried, &mut totals);
            }
            if let Some(above) = row.checked_sub(late).filter(|&row| row < height) {
                match &carried {
                    Some(carried) => pass.place(above, carried.row(above), &mut totals),
                    None => pass.blur::<V>(above, &*lines[(row - 1) % 2], &mut totals),
                }
            }
            if row % RUN == 0 || row + 1 == rows {
                sums.square += sum(totals.square);
                sums.curvature += sum(totals.curvature);
                totals = Totals { square: zero, curvature: zero, ..totals };
            }
        }
        sums.top = largest(totals.top);
        sums
    }
}

/// A row of the blur from the vertical sums at its columns and beside them.
#[inline(always)]
pub fn blurred<V: Vector>(left: V, middle: V, right: V) -> V {
    V::splat(V::Number::from_f64(2.0)).fused(middle, left.plus(right))
}

impl<T: Real> Pass<'_, T> {
    /// Updates a row of the window, or the one of zeros below; `line` becomes the one above it, twice, and its neighbours.
    #[inline(always)]
    fn update<V: Vector<Number = T>, const STEP: usize, const FACTOR: bool>(
        &mut self,
        row: usize,
        line: &mut [T],
    ) {
        let stride = self.window.stride();
        let start = (row + PAD) * stride;
        let Buffers { m, x, r, u, w, p, s } = &mut self.buffers;
        let (above, here) = r.split_at_mut(start);
        let (far, near) = above[start - 2 * stride..].split_at(stride);
        let around = far.chunks_exact(V::LANES).zip(near.chunks_exact(V::LANES));
        let lines = line[MOST..][..stride].chunks_exact_mut(V::LANES);
        let two = V::splat(T::from_f64(2.0));
        if row == self.window.height {
            for (line, (far, near)) in lines.zip(around) {
                two.fused(V::load(near), V::load(far)).store(line);
            }
            return;
        }
        let (minus, length, share) =
            (V::splat(-self.numbers.0), V::splat(self.numbers.0), V::splat(self.numbers.1));
        let own = start..start + stride;
        let residuals = here[..stride].chunks_exact_mut(V::LANES);
        let w = w[own.clone()].chunks_exact(V::LANES);
        if STEP == 0 {
            let d = m.diagonal()[own].chunks_exact(V::LANES);
            for ((((line, (far, near)), r), w), d) in lines.zip(around).zip(residuals).zip(w).zip(d) {
                let product = if FACTOR { V::load(w) } else { V::load(d).times(V::load(w)) };
                let residual = V::splat(T::ZERO).minus(product);
                residual.store(r);
                two.fused(V::load(near), V::load(far).plus(residual)).store(line);
            }
            return;
        }
        let u = u[own.clone()].chunks_exact(V::LANES);
        let x = x[own.clone()].chunks_exact_mut(V::LANES);
        let p = p[own.clone()].chunks_exact_mut(V::LANES);
        let s = s[own].chunks_exact_mut(V::LANES);
        let changed = residuals.zip(x).zip(p).zip(s);
        for (((line, (far, near)), (((r, x), p), s)), (u, w)) in lines.zip(around).zip(changed).zip(u.zip(w))
        {
            let (mut direction, mut product) = (V::load(u), V::load(w));
            if STEP == 2 {
                direction = share.fused(V::load(p), direction);
                product = share.fused(V::load(s), product);
            }
            direction.store(p);
            product.store(s);
            length.fused(direction, V::load(x)).store(x);
            let residual = minus.fused(product, V::load(r));
            residual.store(r);
            two.fused(V::load(near), V::load(far).plus(residual)).store(line);
        }
    }

    /// Takes a row of the residual, or one of the zeros below, for the sparse factor.
    #[inline(always)]
    fn take<V: Vector<Number = T>>(&self, row: usize, carried: &mut Carried<V>, totals: &mut Totals<V>) {
        let Buffers { m: Preconditioner::Factor(planes), r, .. } = &self.buffers else { return };
        if row < self.window.height + BELOW {
            let start = (row + PAD) * self.window.stride();
            totals.square = carried.take((row, start), planes, r, totals.square);
        }
    }

    /// Stores a row of `u`.
    #[inline(always)]
    fn place<V: Vector<Number = T>>(&mut self, row: usize, sums: Placed<'_, T>, totals: &mut Totals<V>) {
        let stride = self.window.stride();
        let u = self.buffers.u[(row + PAD) * stride..][..stride].chunks_exact_mut(V::LANES);
        for (u, sums) in u.zip(sums) {
            let value: V = added(sums);
            value.store(u);
            totals.top = totals.top.top(value);
        }
    }

    /// Computes a row of `u` by the blur.
    #[inline(always)]
    fn blur<V: Vector<Number = T>>(&mut self, row: usize, line: &[T], totals: &mut Totals<V>) {
        let Preconditioner::Blur { d, c } = self.buffers.m else { return };
        let stride = self.window.stride();
        let start = (row + PAD) * stride;
        let own = start..start + stride;
        let Buffers { r, u, .. } = &mut self.buffers;
        let c = V::splat(T::from_f64(c));
        let shifted = |by: usize| line[MOST + by - 1..][..stride].chunks_exact(V::LANES);
        let lines = shifted(0).zip(shifted(1)).zip(shifted(2));
        let inputs = d[own.clone()].chunks_exact(V::LANES).zip(r[own.clone()].chunks_exact(V::LANES));
        let (mut square, mut top) = (totals.square, totals.top);
        for ((((left, middle), right), (d, r)), u) in lines.zip(inputs).zip(u[own].chunks_exact_mut(V::LANES))
        {
            let blurred = blurred(V::load(left), V::load(middle), V::load(right));
            let residual = V::load(r);
            let value = c.fused(residual, blurred);
            square = residual.fused(value, square);
            let value = V::load(d).times(value);
            value.store(u);
            top = top.top(value);
        }
        (totals.square, totals.top) = (square, top);
    }

    /// Takes a row of `u` and computes the row of `w` that lies `R` above.
    #[inline(always)]
    fn matrix<V: Vector<Number = T>, const R: usize, const FACTOR: bool>(
        &mut self,
        row: usize,
        taps: &Taps<'_, V, R>,
        schemes: &mut [Scheme<V, R>],
        totals: &mut Totals<V>,
    ) {
        let (window, stride) = (self.window, self.window.stride());
        let start = (row + PAD) * stride;
        let Buffers { m, u, w, .. } = &mut self.buffers;
        let own = start - R * stride..start - (R - 1) * stride;
        let blocks = Blocks {
            near: &u[start - MOST..],
            d: &m.diagonal()[own.clone()],
            centre: &u[own.clone()],
            w: &mut w[own],
            x: window.x,
            outputs: row >= self.rows.0 + R,
        };
        totals.curvature = blocks.run::<V, R, FACTOR>(taps, taps.inside(window), schemes, totals.curvature);
    }
}

/// A row of `u` and what is made of it.
struct Blocks<'a, T> {
    /// Begins [`MOST`] numbers before the row that is taken.
    near: &'a [T],
    d: &'a [T],
    centre: &'a [T],
    w: &'a mut [T],
    /// First column of the window.
    x: usize,
    /// Whether a row comes out.
    outputs: bool,
}

impl<T: Real> Blocks<'_, T> {
    /// `inside`: the blocks none of whose columns is near a border.
    #[inline(always)]
    fn run<V: Vector<Number = T>, const R: usize, const FACTOR: bool>(
        mut self,
        taps: &Taps<'_, V, R>,
        inside: Range<usize>,
        schemes: &mut [Scheme<V, R>],
        mut sum: V,
    ) -> V {
        let (before, rest) = schemes.split_at_mut(inside.start);
        let (within, after) = rest.split_at_mut(inside.len());
        for (first, beside) in [(0, before), (inside.end, after)] {
            sum = self.part::<V, R, FACTOR, false>(taps, first, beside, sum);
        }
        self.part::<V, R, FACTOR, true>(taps, inside.start, within, sum)
    }

    #[inline(always)]
    fn part<V: Vector<Number = T>, const R: usize, const FACTOR: bool, const INSIDE: bool>(
        &mut self,
        taps: &Taps<'_, V, R>,
        first: usize,
        schemes: &mut [Scheme<V, R>],
        mut sum: V,
    ) -> V {
        let two = V::splat(T::from_f64(2.0));
        let start = first * V::LANES;
        let length = schemes.len() * V::LANES;
        let d = self.d[start..][..length].chunks_exact(V::LANES);
        let centre = self.centre[start..][..length].chunks_exact(V::LANES);
        let w = self.w[start..][..length].chunks_exact_mut(V::LANES);
        for (block, (((scheme, d), centre), w)) in schemes.iter_mut().zip(d).zip(centre).zip(w).enumerate() {
            let k = start + block * V::LANES;
            let near = &self.near[k + MOST - R..][..V::LANES + 2 * R];
            let c = if INSIDE { taps.middle(near) } else { taps.near_border(near, self.x + k) };
            let row = scheme.push(&c, two);
            if self.outputs {
                sum = V::load(centre).fused(row, sum);
                let row = if FACTOR { row } else { V::load(d).times(row) };
                row.store(w);
            }
        }
        sum
    }
}

#[cfg(test)]
pub(super) mod tests;
