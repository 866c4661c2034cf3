//! One step of the polynomial smoother on a tile in one pass after the operator's.
//!
//! ```text
//! t = e (r - q),   s = b s + a e (B + c) t,   x = x + s          q = (A + D) x is given
//! ```
//!
//! `t` is zero outside the tile; three of its rows stay in L1. `E` is a diagonal of factors from 0 (not to be changed) to 1, `B` the
//! stencil `(1 2 1; 2 4 2; 1 2 1)`, which is large where the energies are small and the reverse, so that the product's
//! spectrum is flat from about a quarter of the sampling rate up; it is positive semi-definite, and `c > 0` makes it definite.
//!
//! Roofline, per vector: 13 arithmetic instructions, 14 loads and 6 stores, of which 5 and 2 go to L2 (28 bytes a pixel in
//! f32): at 40 bytes a cycle 11 cycles a vector of 16 lanes, so the cache decides.

use super::simd::{Lanes, MOST, Vector, Vectored, vectors};
use super::stencil::{PAD, Window};
use super::{Isa, Real};

/// Rows of a tile in a larger buffer.
#[derive(Clone, Copy, Debug)]
pub struct Part<'a, T> {
    /// The buffer.
    pub values: &'a [T],
    /// Where the tile's first row begins in it.
    pub start: usize,
    /// Values from one row to the next.
    pub stride: usize,
}

impl<'a, T> Part<'a, T> {
    /// The tile whose first pixel is row `i`, column `j` of the window that `values` belong to.
    pub fn new(values: &'a [T], window: Window, (i, j): (usize, usize)) -> Self {
        Self { values, start: window.at(i, j), stride: window.stride() }
    }

    /// From row `i` of the tile on.
    #[inline(always)]
    pub fn row(self, i: usize) -> &'a [T] {
        &self.values[self.start + i * self.stride..]
    }
}

/// What [`relax`] reads and changes. `q`, `s` and `x` are buffers of the tile; columns beyond the tile that share a vector
/// of 16 with its last ones must have `e = 0`.
pub struct Buffers<'a, T> {
    /// Factors from 0 (not to be changed) to 1.
    pub e: Part<'a, T>,
    /// The right-hand side.
    pub r: Part<'a, T>,
    /// The operator's image of `x`.
    pub q: &'a [T],
    /// The last step.
    pub s: &'a mut [T],
    /// The unknowns.
    pub x: &'a mut [T],
}

/// Takes the step with the factors `a` and `b`.
pub fn relax<T: Lanes>(isa: Isa, window: Window, (a, b): (f64, f64), c: f64, buffers: Buffers<'_, T>) {
    vectors(isa, Relax { window, a: T::from_f64(a), b: T::from_f64(b), c: T::from_f64(c), buffers });
}

struct Relax<'a, T> {
    window: Window,
    a: T,
    b: T,
    c: T,
    buffers: Buffers<'a, T>,
}

impl<T: Real> Vectored<T> for Relax<'_, T> {
    type Output = ();

    #[inline(always)]
    fn run<V: Vector<Number = T>>(mut self) {
        let Window { height, width, .. } = self.window;
        let columns = width.next_multiple_of(MOST);
        let length = columns + 2 * MOST;
        let mut lines = vec![T::ZERO; 4 * length];
        let (sums, lines) = lines.split_at_mut(length);
        // Row `i` of `t` stands in line `i % 3`; before the first and after the last row stand zeros.
        for i in 0..=height {
            let line = &mut lines[i % 3 * length..][MOST..][..columns];
            if i < height {
                let Buffers { e, r, q, .. } = &self.buffers;
                let (e, r, q) = (e.row(i), r.row(i), &q[self.window.at(i, 0)..]);
                for k in (0..columns).step_by(V::LANES) {
                    V::load(&e[k..]).times(V::load(&r[k..]).minus(V::load(&q[k..]))).store(&mut line[k..]);
                }
                // The neighbours of a narrow last vector.
                line[width..].fill(T::ZERO);
            } else {
                line.fill(T::ZERO);
            }
            if i > 0 {
                self.update::<V>(i - 1, lines, sums);
            }
        }
    }
}

impl<T: Real> Relax<'_, T> {
    /// Takes the step in row `i`.
    #[inline(always)]
    fn update<V: Vector<Number = T>>(&mut self, i: usize, lines: &[T], sums: &mut [T]) {
        let columns = self.window.width.next_multiple_of(MOST);
        let length = columns + 2 * MOST;
        let line = |i: usize| &lines[i % 3 * length..][MOST..][..columns];
        let (above, here, below) = (line(i + 2), line(i), line(i + 1));
        let (a, b, c) = (V::splat(self.a), V::splat(self.b), V::splat(self.c));
        let two = V::splat(T::from_f64(2.0));
        for k in (0..columns).step_by(V::LANES) {
            let outer = V::load(&above[k..]).plus(V::load(&below[k..]));
            two.fused(V::load(&here[k..]), outer).store(&mut sums[MOST..][k..]);
        }
        let at = self.window.at(i, 0);
        let Buffers { e, s, x, .. } = &mut self.buffers;
        let (e, s, x) = (e.row(i), &mut s[at..], &mut x[at..]);
        for k in (0..columns).step_by(V::LANES) {
            let near = &sums[MOST - 1 + k..][..V::LANES + 2];
            let beside = V::load(&near[..V::LANES]).plus(V::load(&near[2..]));
            let blurred = two.fused(V::load(&near[1..]), beside);
            let z = V::load(&e[k..]).times(c.fused(V::load(&here[k..]), blurred));
            let step = b.fused(V::load(&s[k..]), a.times(z));
            step.store(&mut s[k..]);
            V::load(&x[k..]).plus(step).store(&mut x[k..]);
        }
    }
}

/// Copies the part of a buffer that a tile and its padding take: `tile` begins at `(i, j)` of `window`, which has the
/// same padding.
pub fn load<T: Real>(values: &[T], window: Window, (i, j): (usize, usize), tile: Window, to: &mut [T]) {
    let (stride, own) = (window.stride(), tile.stride());
    let length = tile.width + 2 * PAD;
    for k in 0..tile.height + 2 * PAD {
        to[k * own..][..length].copy_from_slice(&values[(i + k) * stride + j..][..length]);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Every instruction set against the definition in f64, on tiles at and away from the right border.
    #[test]
    fn every_instruction_set_takes_the_same_step() {
        let window = Window { y: 0, x: 0, height: 9, width: 45 };
        let image = |window: Window, seed: f64| {
            let mut image = window.zeros::<f32>();
            for i in 0..window.height {
                for j in 0..window.width {
                    image[window.at(i, j)] = ((i * 31 + j * 17) as f64 * seed).sin() as f32;
                }
            }
            image
        };
        let e: Vec<f32> = image(window, 0.9).into_iter().map(|e| e.max(0.0)).collect();
        let r = image(window, 0.71);
        for (at, height, width) in [((0, 0), 9, 45), ((2, 0), 5, 32), ((3, 32), 6, 13), ((8, 16), 1, 16)] {
            let tile = Window { y: at.0, x: at.1, height, width };
            let q = image(tile, 0.37);
            for isa in [Isa::Portable, Isa::Avx2, Isa::Avx512].into_iter().filter(|isa| isa.available()) {
                let (mut s, mut x) = (image(tile, 0.21), image(tile, 0.53));
                let old = (s.clone(), x.clone());
                let (a, b, c) = (0.3, 0.7, 1.5);
                let part = |values| Part::new(values, window, at);
                let buffers = Buffers { e: part(&e), r: part(&r), q: &q, s: &mut s, x: &mut x };
                relax(isa, tile, (a, b), c, buffers);
                let rest = |i: usize, j: usize| {
                    let (whole, own) = (window.at(at.0 + i, at.1 + j), tile.at(i, j));
                    f64::from(e[whole]) * (f64::from(r[whole]) - f64::from(q[own]))
                };
                for i in 0..height {
                    for j in 0..width {
                        let mut blurred = c * rest(i, j);
                        for (di, dj) in (0..3).flat_map(|di| (0..3).map(move |dj| (di, dj))) {
                            let (k, l) = ((i + di).wrapping_sub(1), (j + dj).wrapping_sub(1));
                            if k < height && l < width {
                                blurred += [1.0, 2.0, 1.0][di] * [1.0, 2.0, 1.0][dj] * rest(k, l);
                            }
                        }
                        let own = tile.at(i, j);
                        let z = f64::from(e[window.at(at.0 + i, at.1 + j)]) * blurred;
                        let step = b * f64::from(old.0[own]) + a * z;
                        let bound = 64.0 * f64::from(f32::EPSILON);
                        assert!((f64::from(s[own]) - step).abs() <= bound, "{isa:?} {at:?} {i} {j}");
                        let moved = f64::from(old.1[own]) + step;
                        assert!((f64::from(x[own]) - moved).abs() <= bound, "{isa:?} {at:?} {i} {j}");
                    }
                }
            }
        }
    }
}
