//! All steps of the polynomial smoother on a strip in one way down its rows.
//!
//! With the energy and its points `A + P`, the diagonal `E` of factors (zero where unknowns are held) and the stencil
//! `B = (1 2 1; 2 4 2; 1 2 1)`, which is large where the energies are small and the reverse, step `k` is
//!
//! ```text
//! x = x + p      r = r - E (A + P) p      u = E (B + c) r      p = a_k p + b_k u
//! ```
//!
//! where `r` is the residual times `E`. It begins with `p = x` as given, or with `u` of the right-hand side where `x` is zero,
//! which spares a product. A step follows the one before a few rows later, [`CHUNK`] rows at a time: `p` of every step and `r` are
//! rings of rows in L2, so that memory sees the right-hand side and `E` once on their way in, and `x`, the sum of all `p`, and the
//! residual on their way out. The residual comes with `x`: nobody has to apply the energy again for it.
//!
//! A strip is cut out of the window with as many rows and columns around it as the steps reach ([`reach`]), so that nothing
//! shows in the result where strips meet; what does not count there is taken as held. Their places must not depend on threads: near
//! the ends of the image the order of sums depends on where a strip begins.
//!
//! Roofline, per vector and step at R = 3: 28 arithmetic instructions for the energy, 12 for the rest: 20 cycles at two a
//! cycle, 2.5 a pixel with 8 lanes of f32, 1.3 with 16. 11 streams go to and from L1 or L2; the scheme stays in registers.

use std::ops::Range;

use super::aligned::Aligned;
use super::interior::{Scheme, Taps};
use super::points::Points;
use super::simd::{Lanes, MOST, Vector, Vectored, prefetch, vectors};
use super::spans::Spans;
use super::stencil::{Part, Separable, near_ends};
use super::step::blurred;
use super::window::{PAD, Window};
use super::{Isa, Real};

/// Rows that a step takes at a time.
const CHUNK: usize = 8;
/// Rows by which the blur follows the residual: what lies across two vectors cannot be loaded at once.
const LATE: usize = 2;

/// Pixels around a strip that its results depend on after so many steps of an energy with so many terms.
pub fn reach(terms: usize, steps: usize) -> usize {
    steps * (terms + 1) + terms
}

/// What a cascade reads and writes.
pub struct Strip<'a, T> {
    /// The energy.
    pub a: &'a Separable<T>,
    /// What is added to it, and where the strip begins in the window of its planes.
    pub points: Option<(&'a Points<T>, Window, (usize, usize))>,
    /// The strip and what is around it. The columns begin at a multiple of 16 in the windows of all inputs.
    pub window: Window,
    /// Which pixels are not held at zero, and where the strip begins among them.
    pub spans: (&'a Spans, (usize, usize)),
    /// The factors `E`.
    pub e: Part<'a, T>,
    /// The right-hand side.
    pub r: Part<'a, T>,
    /// The unknowns; zero if there are none.
    pub x: Option<Part<'a, T>>,
    /// Per step the share of the step before, and the factor of `u`.
    pub factors: &'a [(f64, f64)],
    /// Added to the middle of the blur.
    pub c: f64,
    /// Rows whose results are wanted.
    pub rows: Range<usize>,
    /// Columns whose results are wanted.
    pub columns: Range<usize>,
    /// Whether what is left of the right-hand side is wanted as it is, not times `E^2`.
    pub plain: bool,
    /// The results.
    pub out: Out<'a, T>,
}

/// Where results go: the columns wanted of each of the rows wanted.
pub struct Out<'a, T> {
    /// The unknowns.
    pub x: Vec<&'a mut [T]>,
    /// What is left of the right-hand side where unknowns are not held; empty if nobody asks.
    pub rest: Vec<&'a mut [T]>,
}

/// All rows of a window's buffer, without padding.
pub fn rows<T>(window: Window, values: &mut [T]) -> Vec<&mut [T]> {
    let stride = window.stride();
    let rows = values[PAD * stride..].chunks_mut(stride).take(window.height);
    rows.map(|row| &mut row[PAD..][..window.width]).collect()
}

/// Buffers that one strip after another uses.
#[derive(Debug, Default)]
pub struct Scratch<T: Real>(Vec<Ring<T>>);

/// Takes all steps.
pub fn cascade<T: Lanes>(isa: Isa, strip: Strip<'_, T>, scratch: &mut Scratch<T>) {
    match strip.a.terms {
        3 => vectors(isa, Sized::<T, 3>(isa, strip, scratch)),
        _ => vectors(isa, Sized::<T, 4>(isa, strip, scratch)),
    }
}

/// The latest rows of a buffer, and two of zeros, for those beyond either end.
#[derive(Debug, Default)]
struct Ring<T: Real> {
    values: Aligned<T>,
    stride: usize,
    slots: usize,
    height: usize,
}

impl<T: Real> Ring<T> {
    fn prepare(&mut self, stride: usize, slots: usize, height: usize) {
        let length = (slots + 2) * stride + 2 * MOST;
        if self.values.len() < length {
            self.values = Aligned::zeros(length);
        }
        // The rows of zeros, and what is read beside the first row and the last.
        self.values[..MOST].fill(T::ZERO);
        self.values[MOST + slots * stride..length].fill(T::ZERO);
        (self.stride, self.slots, self.height) = (stride, slots, height);
    }

    /// Where a row begins; rows beyond the strip are zero.
    #[inline(always)]
    fn at(&self, row: isize) -> usize {
        let inside = row >= 0 && row < self.height as isize;
        let zeros = self.slots + (row & 1) as usize;
        MOST + self.stride * if inside { row as usize & (self.slots - 1) } else { zeros }
    }

    #[inline(always)]
    fn row(&self, row: isize) -> &[T] {
        &self.values[self.at(row)..][..self.stride]
    }

    #[inline(always)]
    fn row_mut(&mut self, row: isize) -> &mut [T] {
        let at = self.at(row);
        &mut self.values[at..][..self.stride]
    }

    /// A row with so many values to either side.
    #[inline(always)]
    fn around(&self, row: isize, by: usize) -> &[T] {
        &self.values[self.at(row) - by..][..self.stride + 2 * by]
    }
}

/// The body for a reach that the compiler knows.
struct Sized<'a, 'b, T: Real, const R: usize>(Isa, Strip<'a, T>, &'b mut Scratch<T>);

impl<T: Lanes, const R: usize> Vectored<T> for Sized<'_, '_, T, R> {
    type Output = ();

    #[inline(always)]
    fn run<V: Vector<Number = T>>(self) {
        let Self(isa, strip, scratch) = self;
        let count = strip.factors.len() + 1;
        let (stride, height) = (strip.window.stride(), strip.window.height);
        let blocks = (PAD + strip.window.width).div_ceil(V::LANES);
        // Per step: whether it applies the energy, and by how many rows it follows those that are loaded.
        let (mut late, mut stages) = (0, Vec::with_capacity(count));
        for k in 0..count {
            let product =
                if k == 0 { strip.x.is_some() } else { k + 1 < count || !strip.out.rest.is_empty() };
            late += if k > 0 { LATE } else { 0 } + if product { R } else { 0 };
            let schemes = vec![Scheme::<V, R>::new(); if product { blocks } else { 0 }];
            let line = || Aligned::zeros(stride + 2 * MOST);
            stages.push(Stage { late, product, schemes, lines: [line(), line()] });
        }
        scratch.0.resize_with(2 + count, Ring::default);
        let Some(([e, r], steps)) = scratch.0.split_first_chunk_mut() else { return };
        let prepare =
            |ring: &mut Ring<T>, rows: usize| ring.prepare(stride, rows.next_power_of_two(), height);
        prepare(&mut *e, CHUNK + late);
        prepare(&mut *r, CHUNK + late);
        for (k, ring) in steps.iter_mut().enumerate() {
            // The last step reads it when it writes the sum; the energy reads rows to either side.
            let first: usize = if k == 0 { 0 } else { stages[k - 1].late + LATE };
            prepare(ring, CHUNK + (late - first).max(2 * R));
        }
        // The first step reads it, times zero.
        if let (None, Some(ring)) = (strip.x, steps.first_mut()) {
            ring.values.fill(T::ZERO);
        }
        let taps = strip.a.interior().map(Taps::<V, R>::new);
        let inside = strip.a.inside(strip.window);
        let products = Aligned::zeros(CHUNK * stride);
        let near = (Window { height: CHUNK, ..strip.window }.zeros(), vec![T::ZERO; CHUNK * stride]);
        let rows_end = strip.rows.end;
        let mut all = Cascade { isa, strip, rings: Rings { e, r, steps }, taps, inside, products, near };
        let end = rows_end + late;
        for top in (0..end).step_by(CHUNK) {
            all.load(top);
            for (k, stage) in stages.iter_mut().enumerate() {
                all.chunk(k, stage, top as isize - stage.late as isize);
            }
        }
    }
}

/// A step on its way down.
struct Stage<V: Vector, const R: usize> {
    late: usize,
    product: bool,
    schemes: Vec<Scheme<V, R>>,
    /// Sums of three rows of the residual, of the latest two rows.
    lines: [Aligned<V::Number>; 2],
}

struct Rings<'a, T: Real> {
    e: &'a mut Ring<T>,
    r: &'a mut Ring<T>,
    /// `p` of every step.
    steps: &'a mut [Ring<T>],
}

struct Cascade<'a, 'b, V: Vector<Number = T>, T: Real, const R: usize> {
    isa: Isa,
    strip: Strip<'a, T>,
    rings: Rings<'b, T>,
    taps: Option<Taps<'a, V, R>>,
    /// The rows where Horner's scheme holds.
    inside: Range<usize>,
    /// Rows of `(A + P) p`.
    products: Aligned<T>,
    /// Near the ends of the image: rows of `p` and their products.
    near: (Vec<T>, Vec<T>),
}

impl<'a, V: Vector<Number = T>, T: Lanes, const R: usize> Cascade<'a, '_, V, T, R> {
    /// Brings rows of the inputs into the rings, from `top` on.
    #[inline(always)]
    fn load(&mut self, top: usize) {
        let (stride, height) = (self.strip.window.stride(), self.strip.window.height);
        let input =
            |part: Part<'a, T>, i: usize| &part.values[part.start + i * part.stride - PAD..][..stride];
        // Rows are too short for the processor to see them coming.
        for i in (top + CHUNK).min(height)..(top + 2 * CHUNK).min(height) {
            for part in [Some(self.strip.e), Some(self.strip.r), self.strip.x].into_iter().flatten() {
                prefetch(input(part, i));
            }
        }
        for i in top..(top + CHUNK).min(self.strip.window.height) {
            let (from, row) = (input(self.strip.e, i), i as isize);
            let e = self.rings.e.row_mut(row);
            let r = self.rings.r.row_mut(row);
            let (spans, (y, x)) = self.strip.spans;
            let clear = |row: &mut [T]| spans.clear_row(y + i, x as isize - PAD as isize, row);
            e.copy_from_slice(from);
            clear(e);
            for ((r, &e), &from) in r.iter_mut().zip(&*e).zip(input(self.strip.r, i)) {
                *r = e * from;
            }
            clear(r);
            if let (Some(x), Some(p)) = (self.strip.x, self.rings.steps.first_mut()) {
                let p = p.row_mut(row);
                p.copy_from_slice(input(x, i));
                clear(p);
            }
        }
    }

    /// Step `k` moves [`CHUNK`] rows from `first` on.
    #[inline(always)]
    fn chunk(&mut self, k: usize, stage: &mut Stage<V, R>, first: isize) {
        let (height, last) = (self.strip.window.height as isize, k + 1 == self.rings.steps.len());
        if stage.product {
            self.products(k, stage, first);
        }
        for row in first.max(0)..(first + CHUNK as isize).min(height + 2) {
            if row < height {
                let product = stage.product.then(|| (row - first) as usize * self.rings.r.stride);
                if last {
                    self.write(product, row);
                    continue;
                }
                if let Some(product) = product {
                    self.advance(product, row);
                }
            }
            if !last {
                self.sum(row, &mut stage.lines[row as usize % 2]);
                if row >= LATE as isize {
                    self.replace(k, row - LATE as isize, &stage.lines[(row as usize + 1) % 2]);
                }
            }
        }
    }

    /// Computes `(A + P) p` of the rows from `first` on. A vector of columns goes down these rows by itself: what the scheme
    /// carries stays in registers.
    #[inline(always)]
    fn products(&mut self, k: usize, stage: &mut Stage<V, R>, first: isize) {
        let (window, stride) = (self.strip.window, self.strip.window.stride());
        let (steps, below) = (&self.rings.steps[k], R as isize);
        // Rows for the scheme: from `R` above those that it computes to `R` below them.
        let (from, to) = (self.inside.start as isize - 2 * below, self.inside.end as isize);
        let rows = first.max(from).max(-below)..(first + CHUNK as isize).min(to);
        if let (Some(taps), false) = (&self.taps, self.inside.is_empty() || rows.is_empty()) {
            let mut near = [0; CHUNK];
            for (near, row) in near.iter_mut().zip(rows.clone()) {
                *near = steps.at(row + below) - R;
            }
            let near = &near[..rows.clone().count()];
            let start = (rows.start - first) as usize * stride;
            let middle = taps.inside(window);
            for (block, scheme) in stage.schemes.iter_mut().enumerate() {
                let at = block * V::LANES;
                let out = &mut self.products[start + at..];
                if middle.contains(&block) {
                    down::<V, R, true>(taps, scheme, &steps.values[at..], near, 0, (out, stride));
                } else {
                    down::<V, R, false>(
                        taps,
                        scheme,
                        &steps.values[at..],
                        near,
                        window.x + at,
                        (out, stride),
                    );
                }
            }
        }
        self.ends(k, first);
        let Some((points, whole, (y, x))) = self.strip.points else { return };
        for row in first.max(0)..(first + CHUNK as isize).min(window.height as isize) {
            let steps = &self.rings.steps[k];
            let p = [steps.around(row - 1, 1), steps.around(row, 1), steps.around(row + 1, 1)];
            let line = &mut self.products[(row - first) as usize * stride..][..stride];
            points.add_row::<V>(whole, whole.at(y + row as usize, x) - PAD, p, line);
        }
    }

    /// The energy of those of the rows from `first` on that are near the ends of the image.
    #[inline(always)]
    fn ends(&mut self, k: usize, first: isize) {
        let height = self.strip.window.height as isize;
        let (from, to) =
            (first.clamp(0, height) as usize, (first + CHUNK as isize).clamp(0, height) as usize);
        let own = |row: &usize| !self.inside.contains(row);
        let (Some(from), Some(last)) = ((from..to).find(own), (from..to).rfind(own)) else { return };
        let (stride, window) = (self.strip.window.stride(), self.strip.window);
        let part = Window { y: window.y + from, height: last + 1 - from, ..window };
        let (p, q) = &mut self.near;
        for i in PAD - R..part.height + PAD + R {
            let row = (from + i) as isize - PAD as isize;
            p[i * stride..][..stride].copy_from_slice(self.rings.steps[k].row(row));
        }
        near_ends(self.isa, self.strip.a, part, p, 0, &mut q[..part.height * stride]);
        for row in (from..=last).filter(own) {
            let to = &mut self.products[(row as isize - first) as usize * stride..][..stride];
            to.copy_from_slice(&q[(row - from) * stride..][..stride]);
        }
    }

    /// Moves a row of `r` by the product that begins there.
    #[inline(always)]
    fn advance(&mut self, product: usize, row: isize) {
        let Rings { e, r, .. } = &mut self.rings;
        let zero = V::splat(T::ZERO);
        let products = self.products[product..][..r.stride].chunks_exact(V::LANES);
        let r = r.row_mut(row).chunks_exact_mut(V::LANES);
        for ((r, e), product) in r.zip(e.row(row).chunks_exact(V::LANES)).zip(products) {
            zero.minus(V::load(e)).fused(V::load(product), V::load(r)).store(r);
        }
    }

    /// The results of a row, if it is wanted.
    #[inline(always)]
    fn write(&mut self, product: Option<usize>, row: isize) {
        let Strip { rows, columns, out, x, plain, .. } = &mut self.strip;
        let Some(index) = (row as usize).checked_sub(rows.start).filter(|&index| index < rows.len()) else {
            return;
        };
        let (width, own) = (columns.len(), PAD + columns.start);
        let Rings { e, r, steps } = &self.rings;
        // Without unknowns to begin with, the first step sets them.
        let step = |k: usize| &steps[k].row(row)[own..][..width];
        let to = &mut *out.x[index];
        let first = usize::from(x.is_none());
        to.copy_from_slice(step(first));
        for k in first + 1..steps.len() {
            for (to, &p) in to.iter_mut().zip(step(k)) {
                *to += p;
            }
        }
        if let (Some(rest), Some(product)) = (out.rest.get_mut(index), product) {
            let line = &self.products[product + own..][..width];
            let inputs = e.row(row)[own..][..width].iter().zip(&r.row(row)[own..]).zip(line);
            if *plain {
                for (rest, ((&e, &r), &line)) in rest.iter_mut().zip(inputs) {
                    let left = (r - e * line) / e;
                    *rest = if e == T::ZERO { T::ZERO } else { left };
                }
            } else {
                for (rest, ((&e, &r), &line)) in rest.iter_mut().zip(inputs) {
                    *rest = e * (r - e * line);
                }
            }
        }
    }

    /// Sums the residual of a row and the two above, `1 2 1`.
    #[inline(always)]
    fn sum(&mut self, row: isize, line: &mut [T]) {
        let r = &self.rings.r;
        let rows = r.row(row - 2).chunks_exact(V::LANES).zip(r.row(row - 1).chunks_exact(V::LANES));
        let two = V::splat(T::from_f64(2.0));
        let line = line[MOST..].chunks_exact_mut(V::LANES);
        for (((far, near), here), line) in rows.zip(r.row(row).chunks_exact(V::LANES)).zip(line) {
            two.fused(V::load(near), V::load(far).plus(V::load(here))).store(line);
        }
    }

    /// Computes a row of `u` and of the next step; `line` holds the residual's sums down the columns.
    #[inline(always)]
    fn replace(&mut self, k: usize, row: isize, line: &[T]) {
        let (b, a) = self.strip.factors[k];
        let (a, b, c) =
            (V::splat(T::from_f64(a)), V::splat(T::from_f64(b)), V::splat(T::from_f64(self.strip.c)));
        let Rings { e, r, steps, .. } = &mut self.rings;
        let stride = r.stride;
        let (before, after) = steps.split_at_mut(k + 1);
        let (before, next) = (&before[k], &mut after[0]);
        let shifted = |by: usize| line[MOST + by - 1..][..stride].chunks_exact(V::LANES);
        let lines = shifted(0).zip(shifted(1)).zip(shifted(2));
        let inputs = e.row(row).chunks_exact(V::LANES).zip(r.row(row).chunks_exact(V::LANES));
        let steps = before.row(row).chunks_exact(V::LANES).zip(next.row_mut(row).chunks_exact_mut(V::LANES));
        for ((((left, middle), right), (e, r)), (before, next)) in lines.zip(inputs).zip(steps) {
            let blurred = blurred(V::load(left), V::load(middle), V::load(right));
            let u = a.times(V::load(e).times(c.fused(V::load(r), blurred)));
            b.fused(V::load(before), u).store(next);
        }
    }
}

/// Takes a vector of columns of some rows into the scheme and stores the sums, those of the rows `R` above. Rows begin `R`
/// columns before. `INSIDE`: none of the columns, which begin with `x - PAD` of the image, is near a border.
#[inline(always)]
fn down<V: Vector, const R: usize, const INSIDE: bool>(
    taps: &Taps<'_, V, R>,
    scheme: &mut Scheme<V, R>,
    values: &[V::Number],
    rows: &[usize],
    x: usize,
    (out, stride): (&mut [V::Number], usize),
) {
    let two = V::splat(V::Number::from_f64(2.0));
    let mut own = scheme.clone();
    for (&row, out) in rows.iter().zip(out.chunks_mut(stride)) {
        let near = &values[row..][..V::LANES + 2 * R];
        let c = if INSIDE { taps.middle(near) } else { taps.near_border(near, x) };
        own.push(&c, two).store(out);
    }
    *scheme = own;
}

#[cfg(test)]
mod tests;
