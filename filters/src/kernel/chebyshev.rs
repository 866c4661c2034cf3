//! One step of a Chebyshev iteration on a tile in a single pass.
//!
//! With the energy `A` and a preconditioner `M` ([`Preconditioner`]), a step is
//!
//! ```text
//! r = r - A p      u = M r      q = a p + b u      x = x + p + q      p = q
//! ```
//!
//! where `r` is kept multiplied by `D` if `M = D (B + c) D`, and the image `x` takes two corrections every other step: nothing
//! else reads it. No sum is waited for, so row `i` of `p` enters Horner's scheme ([`super::interior`]), row `i - R` of `r` moves,
//! and row `i - R - 2` of `p` is replaced (with the sparse factor row `i - R - 4`): all that `A` needs of it is in the scheme.
//!
//! Roofline, per vector at R = 3: 28 arithmetic instructions for `A p`, 12 for the rest: 20 cycles at two a cycle, 1.3 a pixel
//! with 16 lanes of f32, 2.5 with 8. 6 streams of 4 bytes a pixel go to and from L2, against 13 of conjugate gradients: 10 cycles.
//! A vector that crosses a cache line counts twice: 36 loads take 18 cycles, and stores, one a cycle, 13. Where registers are too
//! few for the 16 taps, as with AVX2, loads would be the limit: 44 for a vector of 8, 22 cycles, 2.8 a pixel; pairs of vectors
//! that share the taps ([`super::simd::Pair`]) need 36. At R = 4 with the sparse factor: 41 instructions for `A p`, 38 for `M r`,
//! 5 for the rest, 10 streams.

use super::aligned::Aligned;
use super::factor::{BELOW, Carried, LATE, Placed, added};
use super::interior::{Interior, Scheme, Taps};
use super::preconditioner::Preconditioner;
use super::simd::{Lanes, MOST, Vector, Vectored, largest, pairs};
use super::stencil::{Separable, near_ends};
use super::step::blurred;
use super::window::{PAD, Window};
use super::{Isa, Real};

/// What a pass reads and changes: buffers of one window. `p` is zero in the rows of padding, `r` in those above; elsewhere the
/// padding holds any finite numbers.
pub struct Buffers<'a, T> {
    /// The preconditioner.
    pub m: Preconditioner<'a, T>,
    /// The image.
    pub x: &'a mut [T],
    /// The residual: with a blur times `D`, else with any finite numbers where pixels are not free.
    pub r: &'a mut [T],
    /// The correction to come.
    pub p: &'a mut [T],
    /// Scratch for rows near the ends of the image.
    pub q: &'a mut [T],
}

/// What a pass begins from, and whether the image changes.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Turn {
    /// `r = -A x` and `p = b u`; the image stays. It is a step from `p = x` and `r = 0` with `a = 0`.
    Begin,
    /// The image stays, and lacks the correction before as well as the one to come.
    Hold,
    /// The image takes both.
    Take,
}

/// A pass with factors `(a, b)`. Returns the largest `|u|`.
pub fn pass<T: Lanes>(
    isa: Isa,
    a: &Separable<T>,
    window: Window,
    turn: Turn,
    factors: (f64, f64),
    buffers: Buffers<'_, T>,
) -> f64 {
    let inside = a.inside(window);
    let factors = if turn == Turn::Begin {
        let own = window.at(0, 0) - PAD..window.at(window.height, 0) - PAD;
        buffers.r[own.clone()].fill(T::ZERO);
        buffers.p[own.clone()].copy_from_slice(&buffers.x[own]);
        (T::ZERO, T::from_f64(factors.1))
    } else {
        (T::from_f64(factors.0), T::from_f64(factors.1))
    };
    for rows in [0..inside.start, inside.end..window.height] {
        if !rows.is_empty() {
            let own = window.at(rows.start, 0) - PAD..window.at(rows.end, 0) - PAD;
            near_ends(isa, a, window, &*buffers.p, rows.start, &mut buffers.q[own]);
        }
    }
    let rows = (inside.start, inside.end);
    let mut pass = Pass { interior: a.interior(), window, turn, factors, rows, buffers };
    match (pass.buffers.m, a.terms) {
        (Preconditioner::Blur { .. }, 3) => pairs(isa, Sized::<T, 3, false>(&mut pass)),
        (Preconditioner::Blur { .. }, _) => pairs(isa, Sized::<T, 4, false>(&mut pass)),
        (Preconditioner::Factor(_), 3) => pairs(isa, Sized::<T, 3, true>(&mut pass)),
        (Preconditioner::Factor(_), _) => pairs(isa, Sized::<T, 4, true>(&mut pass)),
    }
}

struct Pass<'a, T> {
    interior: Option<&'a Interior<T>>,
    window: Window,
    turn: Turn,
    /// Of `p` and of `u`.
    factors: (T, T),
    /// The rows of `A p` that are computed here: none of them is near an end.
    rows: (usize, usize),
    buffers: Buffers<'a, T>,
}

/// The body for a reach and a kind of preconditioner that the compiler knows.
struct Sized<'a, 'b, T, const R: usize, const FACTOR: bool>(&'a mut Pass<'b, T>);

impl<T: Real, const R: usize, const FACTOR: bool> Vectored<T> for Sized<'_, '_, T, R, FACTOR> {
    type Output = f64;

    #[inline(always)]
    fn run<V: Vector<Number = T>>(self) -> f64 {
        self.0.all::<V, R, FACTOR>()
    }
}

impl<T: Real> Pass<'_, T> {
    #[inline(always)]
    fn all<V: Vector<Number = T>, const R: usize, const FACTOR: bool>(&mut self) -> f64 {
        let (height, stride) = (self.window.height, self.window.stride());
        // Sums of three rows, of the latest two rows, and room beside their ends.
        let length = stride + 2 * MOST;
        let mut lines = Aligned::zeros(2 * length);
        let (even, odd) = lines.split_at_mut(length);
        let lines = [even, odd];
        let taps = self.interior.map(Taps::<V, R>::new);
        let mut schemes = vec![Scheme::<V, R>::new(); stride / V::LANES];
        let mut carried = FACTOR.then(|| Carried::<V>::new(stride));
        let (from, to) = self.rows;
        let mut top = V::splat(T::ZERO);
        // The row that enters the scheme is `step`; row `step - R` moves. The first rows are those that only enter.
        let late = if FACTOR { LATE } else { 2 };
        for step in 0..height + R + late {
            let moved = step.checked_sub(R);
            let inside = moved.is_some_and(|row| row >= from && row < to);
            if let (Some(taps), true) = (&taps, from < to && step + R >= from && step < to + R) {
                let line = &mut *lines[step % 2];
                if inside {
                    self.enter::<V, R, FACTOR, true>(step, taps, &mut schemes, line);
                } else {
                    self.enter::<V, R, FACTOR, false>(step, taps, &mut schemes, line);
                }
            }
            if let Some(row) = moved.filter(|&row| !inside && row <= height) {
                self.near_end::<V, FACTOR>(row, &mut *lines[step % 2]);
            }
            // What lies across two vectors cannot be loaded before both have reached the cache: a row later.
            if let (Some(carried), Some(row)) = (&mut carried, moved.and_then(|row| row.checked_sub(1))) {
                self.take(row, carried);
            }
            if let Some(row) = moved.and_then(|row| row.checked_sub(late)).filter(|&row| row < height) {
                let (takes, line) = (self.turn == Turn::Take, &*lines[(step - 1) % 2]);
                top = match (&carried, takes) {
                    (Some(carried), true) => self.replace::<V, true>(row, carried.row(row), top),
                    (Some(carried), false) => self.replace::<V, false>(row, carried.row(row), top),
                    (None, true) => self.blur::<V, true>(row, line, top),
                    (None, false) => self.blur::<V, false>(row, line, top),
                };
            }
        }
        largest(top)
    }

    /// Takes a row into the scheme; with `MOVES`, moves the row `R` above.
    #[inline(always)]
    fn enter<V: Vector<Number = T>, const R: usize, const FACTOR: bool, const MOVES: bool>(
        &mut self,
        row: usize,
        taps: &Taps<'_, V, R>,
        schemes: &mut [Scheme<V, R>],
        line: &mut [T],
    ) {
        let (window, stride) = (self.window, self.window.stride());
        let inside = taps.inside(window);
        let (before, rest) = schemes.split_at_mut(inside.start);
        let (within, after) = rest.split_at_mut(inside.len());
        let row = (row + PAD) * stride;
        self.part::<V, R, FACTOR, MOVES, true>(row, inside.start, taps, within, line);
        for (first, beside) in [(0, before), (inside.end, after)] {
            self.part::<V, R, FACTOR, MOVES, false>(row, first, taps, beside, line);
        }
    }

    /// The same for the vectors from `first` on. `INSIDE`: none of their columns is near a border.
    #[inline(always)]
    fn part<
        V: Vector<Number = T>,
        const R: usize,
        const FACTOR: bool,
        const MOVES: bool,
        const INSIDE: bool,
    >(
        &mut self,
        row: usize,
        first: usize,
        taps: &Taps<'_, V, R>,
        schemes: &mut [Scheme<V, R>],
        line: &mut [T],
    ) {
        let stride = self.window.stride();
        let two = V::splat(T::from_f64(2.0));
        let (first, length) = (first * V::LANES, schemes.len() * V::LANES);
        let Buffers { m, r, p, .. } = &mut self.buffers;
        let moved = row - if MOVES { R * stride } else { 0 } + first;
        let own = moved..moved + length;
        let (above, here) = r.split_at_mut(moved);
        let (far, near) = (&above[moved - 2 * stride..][..length], &above[moved - stride..][..length]);
        let here = here[..length].chunks_exact_mut(V::LANES);
        let rows = far.chunks_exact(V::LANES).zip(near.chunks_exact(V::LANES)).zip(here);
        let lines = line[MOST + first..][..length].chunks_exact_mut(V::LANES);
        let d = m.diagonal()[own].chunks_exact(V::LANES);
        let at = row + first;
        for (block, (((scheme, ((far, near), here)), line), d)) in
            schemes.iter_mut().zip(rows).zip(lines).zip(d).enumerate()
        {
            let k = block * V::LANES;
            let near_row = &p[at + k - R..at + k + V::LANES + R];
            let c = if INSIDE {
                taps.middle(near_row)
            } else {
                taps.near_border(near_row, self.window.x + first + k)
            };
            let product = scheme.push(&c, two);
            if MOVES {
                let residual = moved_by::<V, FACTOR>(here, product, d);
                residual.store(here);
                if !FACTOR {
                    two.fused(V::load(near), V::load(far).plus(residual)).store(line);
                }
            }
        }
    }

    /// Moves a row near an end of the image, or takes the one of zeros below the last.
    #[inline(always)]
    fn near_end<V: Vector<Number = T>, const FACTOR: bool>(&mut self, row: usize, line: &mut [T]) {
        let stride = self.window.stride();
        let start = (row + PAD) * stride;
        let Buffers { m, r, q, .. } = &mut self.buffers;
        let d = m.diagonal();
        let (above, here) = r.split_at_mut(start);
        let (far, near) = above[start - 2 * stride..].split_at(stride);
        let two = V::splat(T::from_f64(2.0));
        for k in (0..stride).step_by(V::LANES) {
            let mut sum = V::load(&far[k..]);
            if row < self.window.height {
                let product = V::load(&q[start + k..]);
                let residual = moved_by::<V, FACTOR>(&here[k..], product, &d[start + k..]);
                residual.store(&mut here[k..]);
                sum = sum.plus(residual);
            }
            two.fused(V::load(&near[k..]), sum).store(&mut line[MOST + k..]);
        }
    }

    /// Takes a row of the residual, or one of the zeros below, for the sparse factor.
    #[inline(always)]
    fn take<V: Vector<Number = T>>(&self, row: usize, carried: &mut Carried<V>) {
        let Buffers { m: Preconditioner::Factor(planes), r, .. } = &self.buffers else { return };
        if row < self.window.height + BELOW {
            let start = (row + PAD) * self.window.stride();
            carried.take((row, start), planes, r, V::splat(T::ZERO));
        }
    }

    /// Computes a row of `u` by the blur, and of `p`; with `TAKES`, of `x`.
    #[inline(always)]
    fn blur<V: Vector<Number = T>, const TAKES: bool>(&mut self, row: usize, line: &[T], top: V) -> V {
        let Preconditioner::Blur { d, c } = self.buffers.m else { return top };
        let stride = self.window.stride();
        let start = (row + PAD) * stride;
        let own = start..start + stride;
        let c = V::splat(T::from_f64(c));
        let Buffers { x, r, p, .. } = &mut self.buffers;
        let factors = (V::splat(self.factors.0), V::splat(self.factors.1));
        let shifted = |by: usize| line[MOST + by - 1..][..stride].chunks_exact(V::LANES);
        let lines = shifted(0).zip(shifted(1)).zip(shifted(2));
        let inputs = d[own.clone()].chunks_exact(V::LANES).zip(r[own.clone()].chunks_exact(V::LANES));
        let outputs = p[own.clone()].chunks_exact_mut(V::LANES).zip(x[own].chunks_exact_mut(V::LANES));
        let mut top = top;
        for ((((left, middle), right), (d, r)), (p, x)) in lines.zip(inputs).zip(outputs) {
            let blurred = blurred(V::load(left), V::load(middle), V::load(right));
            let value = V::load(d).times(c.fused(V::load(r), blurred));
            top = top.top(value);
            corrected::<V, TAKES>(factors, value, p, x);
        }
        top
    }

    /// Computes a row of `u` from the sums of the sparse factor, and of `p`; with `TAKES`, of `x`.
    #[inline(always)]
    fn replace<V: Vector<Number = T>, const TAKES: bool>(
        &mut self,
        row: usize,
        sums: Placed<'_, T>,
        top: V,
    ) -> V {
        let stride = self.window.stride();
        let start = (row + PAD) * stride;
        let factors = (V::splat(self.factors.0), V::splat(self.factors.1));
        let Buffers { x, p, .. } = &mut self.buffers;
        let outputs = p[start..][..stride].chunks_exact_mut(V::LANES);
        let outputs = outputs.zip(x[start..][..stride].chunks_exact_mut(V::LANES));
        let mut top = top;
        for (sums, (p, x)) in sums.zip(outputs) {
            let value: V = added(sums);
            top = top.top(value);
            corrected::<V, TAKES>(factors, value, p, x);
        }
        top
    }
}

/// The residual after a step.
#[inline(always)]
fn moved_by<V: Vector, const FACTOR: bool>(here: &[V::Number], product: V, d: &[V::Number]) -> V {
    let before = V::load(here);
    if FACTOR {
        return before.minus(product);
    }
    V::splat(V::Number::ZERO).minus(V::load(d)).fused(product, before)
}

/// Makes a block of `p` from one of `u`, and moves one of `x`.
#[inline(always)]
fn corrected<V: Vector, const TAKES: bool>((a, b): (V, V), u: V, p: &mut [V::Number], x: &mut [V::Number]) {
    let (before, value) = (V::load(p), b.times(u));
    let next = a.fused(before, value);
    if TAKES {
        V::load(x).plus(before.plus(next)).store(x);
    }
    next.store(p);
}

#[cfg(test)]
mod tests;
