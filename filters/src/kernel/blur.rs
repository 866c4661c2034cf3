//! The masked blur that preconditions the energies: `z = E (B + c) E r`.
//!
//! `B` is the stencil `(1 2 1; 2 4 2; 1 2 1)`, `E` a diagonal of factors from 0 (not to be changed) to 1. `B` is large
//! where the energies are small and the reverse, so the product's spectrum is flat from about a quarter of the sampling
//! rate up; it is positive semi-definite, and `c > 0` makes it definite.
//!
//! Roofline: per pixel 4 multiply-adds, 5 additions, 2 multiplications; 8 loads from L1; 3 streams to L2.

use rayon::prelude::*;

use super::stencil::{PAD, Window};
use super::{Body, Isa, Real, dispatch, fma};

/// Rows of a large window that one task computes.
const CHUNK: usize = 48;

/// `z = E (B + c) t`, where `t = E r` is given; the padding of `t` is zero, that of `z` stays as it is.
pub fn blur<T: Real>(isa: Isa, window: Window, c: f64, e: &[T], t: &[T], z: &mut [T]) {
    let stride = window.stride();
    let c = T::from_f64(c);
    let rows = &mut z[PAD * stride..][..window.height * stride];
    let chunk = |(index, z): (usize, &mut [T])| {
        dispatch(isa, Blur { window, c, e, t, first: index * CHUNK, z });
    };
    if window.is_large() {
        rows.par_chunks_mut(CHUNK * stride).enumerate().for_each(chunk);
    } else {
        rows.chunks_mut(CHUNK * stride).enumerate().for_each(chunk);
    }
}

struct Blur<'a, T> {
    window: Window,
    c: T,
    e: &'a [T],
    t: &'a [T],
    first: usize,
    z: &'a mut [T],
}

impl<T: Real> Body for Blur<'_, T> {
    type Output = ();

    #[inline(always)]
    fn run<const FUSED: bool>(self) {
        let stride = self.window.stride();
        let two = T::from_f64(2.0);
        let mut line = vec![T::ZERO; stride];
        for (k, z) in self.z.chunks_exact_mut(stride).enumerate() {
            let start = (self.first + k + PAD) * stride;
            let above = &self.t[start - stride..][..stride];
            let here = &self.t[start..][..stride];
            let below = &self.t[start + stride..][..stride];
            let e = &self.e[start..][..stride];
            for j in 0..stride {
                line[j] = fma::<T, FUSED>(two, here[j], above[j] + below[j]);
            }
            let n = self.window.width;
            let (left, middle, right) = (&line[PAD - 1..][..n], &line[PAD..][..n], &line[PAD + 1..][..n]);
            let (here, e, z) = (&here[PAD..][..n], &e[PAD..][..n], &mut z[PAD..][..n]);
            for j in 0..n {
                let sum = fma::<T, FUSED>(two, middle[j], left[j] + right[j]);
                z[j] = e[j] * fma::<T, FUSED>(self.c, here[j], sum);
            }
        }
    }
}
