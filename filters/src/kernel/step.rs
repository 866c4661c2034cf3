//! One step of conjugate gradients on a tile in as few passes as its sums allow.
//!
//! With the energy `A`, the preconditioner `E (B + c) E` of [`super::blur`] and the residual `r`, a step is the three passes
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
use super::{Isa, Real};

/// `p = z + b p`; with `b = 0` what was in `p` is not read.
pub fn direction<T: Lanes>(isa: Isa, b: f64, z: &[T], p: &mut [T]) {
    if b == 0.0 {
        p.copy_from_slice(z);
    } else {
        vectors(isa, Direction { b: T::from_f64(b), z, p });
    }
}

struct Direction<'a, T> {
    b: T,
    z: &'a [T],
    p: &'a mut [T],
}

impl<T: Real> Vectored<T> for Direction<'_, T> {
    type Output = ();

    #[inline(always)]
    fn run<V: Vector<Number = T>>(self) {
        let b = V::splat(self.b);
        // The length of a window's buffer is a multiple of any vector's.
        for (p, z) in self.p.chunks_exact_mut(V::LANES).zip(self.z.chunks_exact(V::LANES)) {
            b.fused(V::load(p), V::load(z)).store(p);
        }
    }
}

/// What [`advance`] reads and changes: buffers of one window. In the padding `e`, `p` and `r` are zero and `q` is finite.
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
pub fn advance<T: Lanes>(isa: Isa, window: Window, a: f64, c: f64, buffers: Buffers<'_, T>) -> (f64, f64) {
    vectors(isa, Advance { window, a: T::from_f64(a), c: T::from_f64(c), buffers })
}

struct Advance<'a, T> {
    window: Window,
    a: T,
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
        let (mut total, mut most) = (0.0, 0.0_f64);
        // Below the last row stands one of zeros, which stay zeros.
        for row in PAD..=PAD + self.window.height {
            self.update::<V>(row * stride, &mut line);
            if row > PAD {
                let (dot, top) = self.blur::<V>((row - 1) * stride, &line);
                total += dot;
                most = most.max(top);
            }
        }
        (total, most)
    }
}

impl<T: Real> Advance<'_, T> {
    /// Updates the row that begins at `start`; `line` becomes the one above it, twice, and its neighbours.
    #[inline(always)]
    fn update<V: Vector<Number = T>>(&mut self, start: usize, line: &mut [T]) {
        let stride = self.window.stride();
        let Buffers { e, q, p, x, r, .. } = &mut self.buffers;
        let own = start..start + stride;
        let (e, q, p, x) = (&e[own.clone()], &q[own.clone()], &p[own.clone()], &mut x[own]);
        let (above, here) = r.split_at_mut(start);
        let (above, here) = (&above[start - 2 * stride..], &mut here[..stride]);
        let (far, near) = above.split_at(stride);
        let line = &mut line[MOST..][..stride];
        let (a, minus, two) = (V::splat(self.a), V::splat(-self.a), V::splat(T::from_f64(2.0)));
        for k in (0..stride).step_by(V::LANES) {
            let end = k + V::LANES;
            let x = &mut x[k..end];
            a.fused(V::load(&p[k..end]), V::load(x)).store(x);
            let r = &mut here[k..end];
            let residual = V::load(&e[k..end]).times(minus.fused(V::load(&q[k..end]), V::load(r)));
            residual.store(r);
            let outer = V::load(&far[k..end]).plus(residual);
            two.fused(V::load(&near[k..end]), outer).store(&mut line[k..end]);
        }
    }

    /// Computes the row of `z` that begins at `start`.
    #[inline(always)]
    fn blur<V: Vector<Number = T>>(&mut self, start: usize, line: &[T]) -> (f64, f64) {
        let stride = self.window.stride();
        let own = start..start + stride;
        let Buffers { e, r, z, .. } = &mut self.buffers;
        let (e, r, z) = (&e[own.clone()], &r[own.clone()], &mut z[own]);
        let line = &line[MOST - 1..][..stride + 2];
        let (c, two) = (V::splat(self.c), V::splat(T::from_f64(2.0)));
        let (mut dot, mut top) = (V::splat(T::ZERO), V::splat(T::ZERO));
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
        (sum(dot), largest(top))
    }
}
