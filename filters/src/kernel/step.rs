//! One step of conjugate gradients on a tile in as few passes as its sums allow.
//!
//! With the energy `A`, the preconditioner `E (B + c) E` of [`super::relax`] and the residual `r`, a step is the three passes
//!
//! ```text
//! p = z + b p                                            [`direction`]
//! q = A p,  p' q                                         [`super::stencil::apply`]
//! x = x + a p,  r = E (r - a q),  z = E (B + c) r,  r' z, max |z|       [`advance`]
//! ```
//!
//! Roofline of `advance`, per vector: 15 arithmetic instructions, 14 loads, 4 stores; 8 streams of 4 bytes a pixel to and
//! from L2, which at 40 bytes a cycle are 13 cycles a vector of 16 lanes: the cache decides. `direction`: 3 streams, 5 cycles.

use super::simd::{Lanes, MOST, Vector, Vectored, largest, sum, vectors};
use super::stencil::{PAD, Window};
use super::vector::scale_add;
use super::{Isa, Real};

/// Rows after which a sum's lanes are added up: few, so that f32 loses nothing that matters.
const RUN: usize = 4;

/// `p = z + b p`; with `b = 0` what was in `p` is not read.
pub fn direction<T: Real>(isa: Isa, b: f64, z: &[T], p: &mut [T]) {
    if b == 0.0 {
        p.copy_from_slice(z);
    } else {
        scale_add(isa, p, b, z);
    }
}

/// What [`advance`] reads and changes: buffers of one window. In the columns of padding and in the row below the last `e` is
/// zero, `r` is so in the two rows above the first; elsewhere the padding holds any finite numbers.
pub struct Buffers<'a, T> {
    /// 1 at free pixels, 0 elsewhere.
    pub e: &'a [T],
    /// `A p`.
    pub q: &'a [T],
    /// The direction.
    pub p: &'a [T],
    /// The image.
    pub x: &'a mut [T],
    /// The residual.
    pub r: &'a mut [T],
    /// The preconditioned residual.
    pub z: &'a mut [T],
}

/// `x = x + a p`, `r = e (r - a q)`, `z = e (B + c) r`; returns the sum of `r z` and the largest `|z|`.
///
/// Without `a` it begins: `q = A x`, `r = -E q`, and `x` stays.
pub fn advance<T: Lanes>(
    isa: Isa,
    window: Window,
    a: Option<f64>,
    c: f64,
    buffers: Buffers<'_, T>,
) -> (f64, f64) {
    vectors(isa, Advance { window, a: a.map(T::from_f64), c: T::from_f64(c), buffers })
}

struct Advance<'a, T> {
    window: Window,
    a: Option<T>,
    c: T,
    buffers: Buffers<'a, T>,
}

impl<T: Real> Vectored<T> for Advance<'_, T> {
    type Output = (f64, f64);

    #[inline(always)]
    fn run<V: Vector<Number = T>>(mut self) -> (f64, f64) {
        let stride = self.window.stride();
        // Sums of three rows, and what stands beside their ends.
        let mut line = vec![T::ZERO; stride + 2 * MOST];
        let zero = V::splat(T::ZERO);
        let (mut total, mut dot, mut top) = (0.0, zero, zero);
        // Below the last row stands one of zeros, which stay zeros.
        for row in PAD..=PAD + self.window.height {
            match self.a {
                Some(a) => self.update::<V, true>(row * stride, a, &mut line),
                None => self.update::<V, false>(row * stride, T::ZERO, &mut line),
            }
            if row > PAD {
                (dot, top) = self.blur::<V>((row - 1) * stride, &line, (dot, top));
            }
            if row % RUN == 0 {
                total += sum(dot);
                dot = zero;
            }
        }
        (total + sum(dot), largest(top))
    }
}

impl<T: Real> Advance<'_, T> {
    /// Updates the row that begins at `start`; `line` becomes the one above it, twice, and its neighbours.
    #[inline(always)]
    fn update<V: Vector<Number = T>, const STEP: bool>(&mut self, start: usize, a: T, line: &mut [T]) {
        let stride = self.window.stride();
        let Buffers { e, q, p, x, r, .. } = &mut self.buffers;
        let own = start..start + stride;
        let (e, q, p, x) = (&e[own.clone()], &q[own.clone()], &p[own.clone()], &mut x[own]);
        let (above, here) = r.split_at_mut(start);
        let (above, here) = (&above[start - 2 * stride..], &mut here[..stride]);
        let (far, near) = above.split_at(stride);
        let line = &mut line[MOST..][..stride];
        let (minus, two, zero) = (V::splat(-a), V::splat(T::from_f64(2.0)), V::splat(T::ZERO));
        let a = V::splat(a);
        for k in (0..stride).step_by(V::LANES) {
            let end = k + V::LANES;
            let (r, product) = (&mut here[k..end], V::load(&q[k..end]));
            let left = if STEP {
                let x = &mut x[k..end];
                a.fused(V::load(&p[k..end]), V::load(x)).store(x);
                minus.fused(product, V::load(r))
            } else {
                zero.minus(product)
            };
            let residual = V::load(&e[k..end]).times(left);
            residual.store(r);
            let outer = V::load(&far[k..end]).plus(residual);
            two.fused(V::load(&near[k..end]), outer).store(&mut line[k..end]);
        }
    }

    /// Computes the row of `z` that begins at `start`; adds to the sum of `r z` and the largest `|z|`.
    #[inline(always)]
    fn blur<V: Vector<Number = T>>(
        &mut self,
        start: usize,
        line: &[T],
        (mut dot, mut top): (V, V),
    ) -> (V, V) {
        let stride = self.window.stride();
        let own = start..start + stride;
        let Buffers { e, r, z, .. } = &mut self.buffers;
        let (e, r, z) = (&e[own.clone()], &r[own.clone()], &mut z[own]);
        let line = &line[MOST - 1..][..stride + 2];
        let (c, two) = (V::splat(self.c), V::splat(T::from_f64(2.0)));
        for k in (0..stride).step_by(V::LANES) {
            let end = k + V::LANES;
            let near = &line[k..end + 2];
            let beside = V::load(&near[..V::LANES]).plus(V::load(&near[2..]));
            let blurred = two.fused(V::load(&near[1..]), beside);
            let residual = V::load(&r[k..end]);
            let value = V::load(&e[k..end]).times(c.fused(residual, blurred));
            value.store(&mut z[k..end]);
            dot = residual.fused(value, dot);
            top = top.top(value);
        }
        (dot, top)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Every instruction set against the definition in f64, at sizes that do not fill a vector.
    #[test]
    fn every_instruction_set_takes_the_same_step() {
        for (height, width) in [(1, 1), (1, 40), (7, 3), (12, 29)] {
            let window = Window { y: 0, x: 0, height, width };
            let cells = || (0..height).flat_map(move |i| (0..width).map(move |j| (i, j)));
            let image = |seed: f64| {
                let mut image = window.zeros::<f32>();
                for (i, j) in cells() {
                    image[window.at(i, j)] = ((i * 31 + j * 17) as f64 * seed).sin() as f32;
                }
                image
            };
            let mut e = image(0.9);
            for e in &mut e {
                *e = f32::from(u8::from(*e > 0.0));
            }
            for isa in [Isa::Portable, Isa::Avx2, Isa::Avx512].into_iter().filter(|isa| isa.available()) {
                for a in [None, Some(0.3)] {
                    let (q, p, mut x, mut r, mut z) =
                        (image(0.37), image(0.21), image(0.53), image(0.71), window.zeros());
                    r.iter_mut().zip(&e).for_each(|(r, e)| *r *= e);
                    let old = (x.clone(), r.clone());
                    let buffers = Buffers { e: &e, q: &q, p: &p, x: &mut x, r: &mut r, z: &mut z };
                    let (dot, top) = advance(isa, window, a, 1.5, buffers);
                    // The residual and then the blur, entry by entry.
                    let wide = |values: &[f32], k: usize| f64::from(values[k]);
                    let mut residual = vec![0.0; window.len()];
                    for (i, j) in cells() {
                        let k = window.at(i, j);
                        let before = if a.is_some() { wide(&old.1, k) } else { 0.0 };
                        residual[k] = wide(&e, k) * (before - a.unwrap_or(1.0) * wide(&q, k));
                        let moved = wide(&old.0, k) + a.unwrap_or(0.0) * wide(&p, k);
                        assert!((wide(&x, k) - moved).abs() <= 4.0 * f64::from(f32::EPSILON), "{isa:?} {k}");
                    }
                    let (mut sum, mut most) = (0.0, 0.0_f64);
                    for (i, j) in cells() {
                        let k = window.at(i, j);
                        let weigh = |di: usize, dj: usize| [1.0, 2.0, 1.0][di] * [1.0, 2.0, 1.0][dj];
                        let around = (0..3).flat_map(|di| (0..3).map(move |dj| (di, dj)));
                        let blurred: f64 = around
                            .map(|(di, dj)| {
                                weigh(di, dj) * residual[k + di * window.stride() + dj - window.stride() - 1]
                            })
                            .sum();
                        let value = wide(&e, k) * (blurred + 1.5 * residual[k]);
                        assert!((wide(&z, k) - value).abs() <= 64.0 * f64::from(f32::EPSILON), "{isa:?} {k}");
                        sum += residual[k] * value;
                        most = most.max(value.abs());
                    }
                    let bound = 64.0 * f64::from(f32::EPSILON);
                    assert!(
                        (top - most).abs() <= bound && (dot - sum).abs() <= bound * window.pixels() as f64
                    );
                }
            }
        }
    }
}
