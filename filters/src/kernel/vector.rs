//! Passes over whole buffers, element by element, and their sums in a fixed order.
//!
//! Roofline: two to ten streams and one to eight flops an element; in L2 about 3 cycles a vector, in memory its bandwidth.

use lacuna_core::parallel::prelude::*;

use super::stencil::lanes_dot;
use super::{Body, Isa, Real, dispatch, fma};

/// Elements that one task of a large buffer takes; sums are formed per part and combined in order.
const PART: usize = 1 << 14;
/// Buffers longer than this are shared out among threads.
const LARGE: usize = 1 << 16;
/// Elements after which a sum's lanes are added up.
const RUN: usize = 1 << 10;

/// Runs `each` on parts of `x` and `y`.
fn in_parts<T: Real>(x: &[T], y: &mut [T], each: impl Fn(&[T], &mut [T]) + Sync) {
    debug_assert_eq!(x.len(), y.len());
    let large = y.len() > LARGE;
    x.par_chunks(PART).zip(y.par_chunks_mut(PART)).shared_if(large).for_each(|(x, y)| each(x, y));
}

/// `y = y + a x`.
pub fn add_scaled<T: Real>(isa: Isa, y: &mut [T], a: f64, x: &[T]) {
    let a = T::from_f64(a);
    in_parts(x, y, |x, y| dispatch(isa, AddScaled { y, a, x }));
}

/// The same by one task.
pub(super) struct AddScaled<'a, T> {
    pub(super) y: &'a mut [T],
    pub(super) a: T,
    pub(super) x: &'a [T],
}

impl<T: Real> Body for AddScaled<'_, T> {
    type Output = ();
    #[inline(always)]
    fn run<const FUSED: bool>(self) {
        for (y, &x) in self.y.iter_mut().zip(self.x) {
            *y = fma::<T, FUSED>(self.a, x, *y);
        }
    }
}

/// `y = x + b y`.
pub fn scale_add<T: Real>(isa: Isa, y: &mut [T], b: f64, x: &[T]) {
    let b = T::from_f64(b);
    in_parts(x, y, |x, y| dispatch(isa, ScaleAdd { y, b, x }));
}

struct ScaleAdd<'a, T> {
    y: &'a mut [T],
    b: T,
    x: &'a [T],
}

impl<T: Real> Body for ScaleAdd<'_, T> {
    type Output = ();
    #[inline(always)]
    fn run<const FUSED: bool>(self) {
        for (y, &x) in self.y.iter_mut().zip(self.x) {
            *y = fma::<T, FUSED>(self.b, *y, x);
        }
    }
}

/// The sum of `x y`.
pub fn dot<T: Real>(isa: Isa, x: &[T], y: &[T]) -> f64 {
    let parts = x.par_chunks(PART).zip(y.par_chunks(PART)).shared_if(x.len() > LARGE);
    parts.map(|(x, y)| dispatch(isa, Dot { x, y })).into_iter().sum()
}

/// The same by one task, for the body of another kernel, too.
pub(super) struct Dot<'a, T> {
    pub(super) x: &'a [T],
    pub(super) y: &'a [T],
}

impl<T: Real> Body for Dot<'_, T> {
    type Output = f64;
    #[inline(always)]
    fn run<const FUSED: bool>(self) -> f64 {
        let mut total = 0.0;
        // Lanes are emptied into f64 often enough for f32 to lose nothing that matters.
        for (x, y) in self.x.chunks(RUN).zip(self.y.chunks(RUN)) {
            total += lanes_dot::<T, FUSED>(x, y);
        }
        total
    }
}

/// `r = -scale product` where `free` is not zero, zero elsewhere; by one task.
pub fn lacking<T: Real>(isa: Isa, free: &[T], scale: f64, product: &[f64], r: &mut [T]) {
    dispatch(isa, Lacking { free, scale, product, r });
}

struct Lacking<'a, T> {
    free: &'a [T],
    scale: f64,
    product: &'a [f64],
    r: &'a mut [T],
}

impl<T: Real> Body for Lacking<'_, T> {
    type Output = ();
    #[inline(always)]
    fn run<const FUSED: bool>(self) {
        for (r, (&free, &product)) in self.r.iter_mut().zip(self.free.iter().zip(self.product)) {
            let value = T::from_f64(-self.scale * product);
            *r = if free == T::ZERO { T::ZERO } else { value };
        }
    }
}

/// `q = r - q` where `free` is not zero, zero elsewhere; by one task.
pub fn rest<T: Real>(isa: Isa, free: &[T], r: &[T], q: &mut [T]) {
    dispatch(isa, Rest { free, r, q });
}

struct Rest<'a, T> {
    free: &'a [T],
    r: &'a [T],
    q: &'a mut [T],
}

impl<T: Real> Body for Rest<'_, T> {
    type Output = ();
    #[inline(always)]
    fn run<const FUSED: bool>(self) {
        for (q, (&free, &r)) in self.q.iter_mut().zip(self.free.iter().zip(self.r)) {
            *q = if free == T::ZERO { T::ZERO } else { r - *q };
        }
    }
}
