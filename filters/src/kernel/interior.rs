//! A sum of products of banded matrices away from the upper and lower end of the image, where it is a polynomial.
//!
//! There the rows of every vertical matrix repeat and are symmetric, so each matrix is a polynomial in the negative second
//! difference `d` along columns (`d a = 2 a_i - a_(i-1) - a_(i+1)`), and so is the sum, with filters along rows as
//! coefficients. Horner's scheme evaluates it:
//!
//! ```text
//! sum over t of V_t p H_t'  =  c_0 + d (c_1 + d (c_2 + ... + d c_R))        c_l = p C_l',  C_l = sum over t of v_tl H_t
//! ```
//!
//! where `v_tl` is the coefficient of `d^l` in `V_t`. A block of one vector of columns goes down row by row and what the
//! scheme needs of the rows before stays in registers: `R (R + 3) / 2` vectors, 9 for R = 3. Near the left and the right
//! border the filters `C_l` differ from column to column, and each lane takes its own taps.
//!
//! Roofline, per vector and row at R = 3: along rows 3 additions and 16 multiply-adds, down the columns 9, 1 for `p q`: 29
//! arithmetic instructions, 8 loads from L1 and a store, against 37 and 31 in [`super::stencil`]. Two arithmetic
//! instructions a cycle give 15 cycles a vector, about one cycle a pixel with 16 lanes of f32; a tile in L2 streams 8 bytes a pixel.
//!
//! Source: W. Horner, "A new method of solving numerical equations of all orders, by continuous approximation",
//! Philosophical Transactions 109, 1819.

use std::ops::Range;

use super::simd::{Lanes, MOST, Vector, Vectored, sum, vectors};
use super::window::{Axis, PAD, REACH, WIDTH, Window};
use super::{Isa, Real};

/// Powers of `d`.
const POWERS: usize = REACH + 1;

/// Most coefficients that wait in Horner's scheme.
const WAITING: usize = REACH * (REACH - 1) / 2;

/// The filters along rows.
#[derive(Clone, Debug)]
pub struct Interior<T> {
    /// Per power of `d` the taps of a column away from the borders: in the middle, one beside it, and so on.
    taps: [[T; POWERS]; POWERS],
    /// Per tap and power, one for each column of the image behind [`PAD`] zeros and before others: used near its borders.
    columns: Vec<T>,
    /// Columns at either border that have taps of their own.
    ends: usize,
    /// Rows at either end where none of this holds.
    pub rows: usize,
    len: usize,
}

/// The coefficients of the powers of `d` in a matrix whose rows are these taps.
fn polynomial(taps: &[f64; WIDTH]) -> [f64; POWERS] {
    let t = |k: usize| taps[REACH + k];
    // 2 cos(k w) in powers of d = 2 - 2 cos(w).
    [
        t(0) + 2.0 * (t(1) + t(2) + t(3) + t(4)),
        -(t(1) + 4.0 * t(2) + 9.0 * t(3) + 16.0 * t(4)),
        t(2) + 6.0 * t(3) + 20.0 * t(4),
        -(t(3) + 8.0 * t(4)),
        t(4),
    ]
}

impl<T: Real> Interior<T> {
    /// `None` if every row of the image is near an end.
    pub fn new(vertical: &Axis<f64>, horizontal: &Axis<f64>, terms: usize) -> Option<Self> {
        if vertical.len <= 2 * vertical.ends {
            return None;
        }
        let rows = vertical.row(vertical.ends);
        let powers: Vec<[f64; POWERS]> = (0..terms).map(|t| polynomial(&rows[t])).collect();
        let tap = |l: usize, x: usize, k: usize| -> f64 {
            let row = horizontal.row(x);
            (0..terms).map(|t| powers[t][l] * row[t][k]).sum()
        };
        let middle = horizontal.len / 2;
        let taps = std::array::from_fn(|l| std::array::from_fn(|k| T::from_f64(tap(l, middle, REACH + k))));
        let mut columns = Vec::new();
        for k in REACH - terms..=REACH + terms {
            for l in 0..=terms {
                columns.extend(std::iter::repeat_n(T::ZERO, PAD));
                columns.extend((0..horizontal.len).map(|x| T::from_f64(tap(l, x, k))));
                columns.extend(std::iter::repeat_n(T::ZERO, 2 * MOST));
            }
        }
        let (ends, len) = (horizontal.ends, horizontal.len);
        Some(Self { taps, columns, ends, rows: vertical.ends, len })
    }

    /// The same with other numbers.
    pub fn cast<U: Real>(&self) -> Interior<U> {
        let cast = |x: &T| U::from_f64(x.to_f64());
        Interior {
            taps: self.taps.each_ref().map(|taps| taps.each_ref().map(cast)),
            columns: self.columns.iter().map(cast).collect(),
            ends: self.ends,
            rows: self.rows,
            len: self.len,
        }
    }
}

/// Rows of a window that are to be computed, all of them away from the ends of the image.
pub struct Rows<'a, T> {
    /// The filters.
    pub interior: &'a Interior<T>,
    /// The window.
    pub window: Window,
    /// Its values.
    pub p: &'a [T],
    /// Added to the diagonal, if anything.
    pub d: Option<&'a [T]>,
    /// The first row.
    pub first: usize,
    /// The rows that are computed, whole strides.
    pub q: &'a mut [T],
}

/// Computes the rows; returns the sum of `p q`.
pub fn apply<T: Lanes>(isa: Isa, terms: usize, rows: Rows<'_, T>) -> f64 {
    match terms {
        3 => vectors(isa, Sized::<T, 3>(rows)),
        _ => vectors(isa, Sized::<T, 4>(rows)),
    }
}

/// The body for a reach that the compiler knows.
struct Sized<'a, T, const R: usize>(Rows<'a, T>);

impl<T: Real, const R: usize> Vectored<T> for Sized<'_, T, R> {
    type Output = f64;

    #[inline(always)]
    fn run<V: Vector<Number = T>>(mut self) -> f64 {
        let (interior, window) = (self.0.interior, self.0.window);
        let mut total = 0.0;
        for j in (0..window.width).step_by(V::LANES) {
            let x = window.x + j;
            let inside = x >= interior.ends && x + V::LANES + interior.ends <= interior.len;
            total += match (inside, j + V::LANES <= window.width) {
                (true, true) => self.block::<V, true, true>(j),
                (true, false) => self.block::<V, true, false>(j),
                (false, true) => self.block::<V, false, true>(j),
                (false, false) => self.block::<V, false, false>(j),
            };
        }
        total
    }
}

impl<T: Real, const R: usize> Sized<'_, T, R> {
    /// The columns from `j` on that fill a vector. `INSIDE`: none of them is near a border; `WHOLE`: none is beyond the window.
    #[inline(always)]
    fn block<V: Vector<Number = T>, const INSIDE: bool, const WHOLE: bool>(&mut self, j: usize) -> f64 {
        let Rows { interior, window, p, d, first, ref mut q } = self.0;
        let stride = window.stride();
        let valid = V::LANES.min(window.width - j);
        let zero = V::splat(T::ZERO);
        let two = V::splat(T::from_f64(2.0));
        let taps = Taps::<V, R>::new(interior);
        let mut scheme = Scheme::<V, R>::new();
        let mut dot = zero;
        for step in 0..q.len() / stride + 2 * R {
            let start = (first + step + PAD - R) * stride + PAD + j;
            let near = &p[start - R..][..V::LANES + 2 * R];
            let c = if INSIDE { taps.middle(near) } else { taps.near_border(near, window.x + j + PAD) };
            let mut sum = scheme.push(&c, two);
            let Some(i) = step.checked_sub(2 * R) else { continue };
            let here = start - R * stride;
            let mut centre = V::load(&p[here..]);
            if !WHOLE {
                let mut lanes = [T::ZERO; MOST];
                lanes[..valid].copy_from_slice(&p[here..here + valid]);
                centre = V::load(&lanes);
            }
            if let Some(d) = d {
                sum = centre.fused(V::load(&d[here..]), sum);
            }
            dot = centre.fused(sum, dot);
            let out = &mut q[i * stride + PAD + j..];
            if WHOLE {
                sum.store(out);
            } else {
                let mut lanes = [T::ZERO; MOST];
                sum.store(&mut lanes);
                out[..valid].copy_from_slice(&lanes[..valid]);
            }
        }
        self::sum(dot)
    }
}

/// The filters along rows in vectors.
pub struct Taps<'a, V: Vector, const R: usize> {
    interior: &'a Interior<V::Number>,
    middle: [[V; POWERS]; POWERS],
}

impl<'a, V: Vector, const R: usize> Taps<'a, V, R> {
    #[inline(always)]
    pub fn new(interior: &'a Interior<V::Number>) -> Self {
        let mut middle = [[V::splat(V::Number::ZERO); POWERS]; POWERS];
        for (taps, own) in middle.iter_mut().zip(&interior.taps).take(R + 1) {
            for (tap, &own) in taps.iter_mut().zip(own).take(R + 1) {
                *tap = V::splat(own);
            }
        }
        Self { interior, middle }
    }

    /// The vectors of a row of a window's buffer none of whose columns in the window is near a border of the image.
    #[inline(always)]
    pub fn inside(&self, window: Window) -> Range<usize> {
        let Interior { ends, len, .. } = *self.interior;
        // Numbers of the row, counted from its padding.
        let first = if window.x >= ends { 0 } else { ends - window.x + PAD };
        let last = len - ends;
        let end = if window.x + window.width <= last {
            window.stride()
        } else {
            (last.saturating_sub(window.x) + PAD).min(window.stride())
        };
        let first = first.div_ceil(V::LANES).min(window.stride() / V::LANES);
        first..(end / V::LANES).max(first)
    }

    /// The coefficients of a row for a vector of columns away from the borders; `near` begins `R` columns before.
    #[inline(always)]
    pub fn middle(&self, near: &[V::Number]) -> [V; POWERS] {
        let mut c = [V::splat(V::Number::ZERO); POWERS];
        let mut pairs = [V::load(&near[R..]); POWERS];
        for k in 1..=R {
            pairs[k] = V::load(&near[R - k..]).plus(V::load(&near[R + k..]));
        }
        for (c, taps) in c.iter_mut().zip(&self.middle).take(R + 1) {
            *c = pairs[0].times(taps[0]);
            for k in 1..=R {
                *c = pairs[k].fused(taps[k], *c);
            }
        }
        c
    }

    /// The same for any columns; the first is column `x - PAD` of the image.
    #[inline(always)]
    pub fn near_border(&self, near: &[V::Number], x: usize) -> [V; POWERS] {
        let mut c = [V::splat(V::Number::ZERO); POWERS];
        let length = PAD + self.interior.len + 2 * MOST;
        for (k, taps) in self.interior.columns.chunks_exact((R + 1) * length).enumerate() {
            let value = V::load(&near[k..]);
            for (c, own) in c.iter_mut().zip(taps[x..].chunks(length)) {
                *c = value.fused(V::load(own), *c);
            }
        }
        c
    }
}

/// Horner's scheme down the rows. With `a_R = c_R` and `a_l = c_l + d a_(l+1)`, `a_l` of a row needs `a_(l+1)` of the next,
/// so every level is one row later than the one above.
#[derive(Clone)]
pub struct Scheme<V, const R: usize> {
    /// Per level what `a_l` of the row to come lacks but for `a_(l+1)` of the row after it.
    open: [V; R],
    /// `a_(l+1)` of the row before.
    before: [V; R],
    /// `c_l` of the rows that level `l` has not come to, the latest first: `R - 1` rows for level 0, one less for the next, and
    /// so on, without gaps, as the schemes of a row's blocks share L1 with what else a pass needs.
    waiting: [V; WAITING],
}

impl<V: Vector, const R: usize> Scheme<V, R> {
    #[inline(always)]
    pub fn new() -> Self {
        let zero = V::splat(V::Number::ZERO);
        Self { open: [zero; R], before: [zero; R], waiting: [zero; WAITING] }
    }

    /// Takes the coefficients of a row; returns the sum of the row `R` above.
    #[inline(always)]
    pub fn push(&mut self, c: &[V; POWERS], two: V) -> V {
        let mut a = c[R];
        for l in (0..R).rev() {
            let late = R - 1 - l;
            let mut own = c[l];
            if late > 0 {
                let first = l * (2 * R - 1 - l) / 2;
                own = self.waiting[first + late - 1];
                for m in (first + 1..first + late).rev() {
                    self.waiting[m] = self.waiting[m - 1];
                }
                self.waiting[first] = c[l];
            }
            let next = self.open[l].minus(a);
            self.open[l] = a.fused(two, own).minus(self.before[l]);
            self.before[l] = a;
            a = next;
        }
        a
    }
}
