//! Vectors of an instruction set, for kernels whose speed depends on what stays in registers.
//!
//! [`Body`](super::Body) leaves the choice of vectors to the compiler, which is good enough for plain loops. A kernel that
//! carries a dozen vectors from row to row is written against [`Vector`] instead and compiled once per instruction set by
//! [`vectors`].

use super::{Isa, Real};

/// A few numbers that are computed with together.
pub trait Vector: Copy {
    /// The numbers.
    type Number: Real;
    /// How many there are.
    const LANES: usize;
    /// The same number in every lane.
    fn splat(x: Self::Number) -> Self;
    /// The first [`Self::LANES`] numbers; zeros if there are fewer.
    fn load(from: &[Self::Number]) -> Self;
    /// Sets the first [`Self::LANES`] numbers; none if there are fewer.
    fn store(self, to: &mut [Self::Number]);
    /// The sum.
    fn plus(self, other: Self) -> Self;
    /// The difference.
    fn minus(self, other: Self) -> Self;
    /// The product.
    fn times(self, other: Self) -> Self;
    /// `self a + b`, fused where the instruction set has it.
    fn fused(self, a: Self, b: Self) -> Self;
    /// The quotient.
    fn over(self, other: Self) -> Self;
    /// The larger one.
    fn larger(self, other: Self) -> Self;
    /// The larger of `self` and the absolute value of `other`.
    fn top(self, other: Self) -> Self;
    /// The two numbers that each lane holds: see [`Real::packed`].
    fn halves(self) -> (Self, Self);
}

/// The sum of all lanes, in order.
#[inline(always)]
pub fn sum<V: Vector>(v: V) -> f64 {
    let mut lanes = [V::Number::ZERO; MOST];
    v.store(&mut lanes);
    lanes[..V::LANES].iter().map(|x| x.to_f64()).sum()
}

/// The largest lane, of lanes that are not negative.
#[inline(always)]
pub fn largest<V: Vector>(v: V) -> f64 {
    let mut lanes = [V::Number::ZERO; MOST];
    v.store(&mut lanes);
    lanes[..V::LANES].iter().fold(0.0, |top, x| f64::max(top, x.to_f64()))
}

/// Lanes of the longest vector.
pub const MOST: usize = 16;

/// Asks for numbers that are wanted soon to be brought nearer, where the processor can.
#[inline(always)]
pub fn prefetch<T: Real>(values: &[T]) {
    #[cfg(target_arch = "x86_64")]
    {
        use std::arch::x86_64::{_MM_HINT_T1, _mm_prefetch};
        const LINE: usize = 64;
        for line in values.chunks(LINE / size_of::<T>()) {
            // SAFETY: a hint, which reads nothing; every x86-64 processor has it.
            unsafe { _mm_prefetch::<_MM_HINT_T1>(line.as_ptr().cast()) };
        }
    }
    #[cfg(not(target_arch = "x86_64"))]
    let _ = values;
}

/// A kernel's body over vectors of any length.
pub trait Vectored<T> {
    /// What it returns.
    type Output;
    /// Does it.
    fn run<V: Vector<Number = T>>(self) -> Self::Output;
}

/// Numbers of which every instruction set has vectors.
pub trait Lanes: Real {
    /// Vectors of what the target guarantees.
    type Portable: Vector<Number = Self>;
    /// Vectors of AVX2.
    #[cfg(target_arch = "x86_64")]
    type Avx2: Vector<Number = Self>;
    /// Vectors of AVX-512.
    #[cfg(target_arch = "x86_64")]
    type Avx512: Vector<Number = Self>;
}

impl Lanes for f32 {
    type Portable = Pack<f32, 4>;
    #[cfg(target_arch = "x86_64")]
    type Avx2 = x86::F32x8;
    #[cfg(target_arch = "x86_64")]
    type Avx512 = x86::F32x16;
}

impl Lanes for f64 {
    type Portable = Pack<f64, 2>;
    #[cfg(target_arch = "x86_64")]
    type Avx2 = x86::F64x4;
    #[cfg(target_arch = "x86_64")]
    type Avx512 = x86::F64x8;
}

/// Runs a body compiled for `isa`, or for the portable set if this machine lacks `isa`.
#[inline]
pub fn vectors<T: Lanes, B: Vectored<T>>(isa: Isa, body: B) -> B::Output {
    match isa {
        #[cfg(target_arch = "x86_64")]
        Isa::Avx2 if isa.available() => {
            // SAFETY: `available` has just found the features that `avx2` is compiled for.
            unsafe { avx2::<T::Avx2, B>(body) }
        }
        _ => but_avx2(isa, body),
    }
}

/// The same with vectors of AVX2 in pairs, for a body that has few vectors of its own but more taps than registers.
#[inline]
pub fn pairs<T: Lanes, B: Vectored<T>>(isa: Isa, body: B) -> B::Output {
    match isa {
        #[cfg(target_arch = "x86_64")]
        Isa::Avx2 if isa.available() => {
            // SAFETY: `available` has just found the features that `avx2` is compiled for.
            unsafe { avx2::<Pair<T::Avx2>, B>(body) }
        }
        _ => but_avx2(isa, body),
    }
}

#[inline]
fn but_avx2<T: Lanes, B: Vectored<T>>(isa: Isa, body: B) -> B::Output {
    match isa {
        #[cfg(target_arch = "x86_64")]
        Isa::Avx512 if isa.available() => {
            // SAFETY: `available` has just found the features that `avx512` is compiled for.
            unsafe { avx512(body) }
        }
        _ => body.run::<T::Portable>(),
    }
}

#[cfg(target_arch = "x86_64")]
#[target_feature(enable = "avx2,fma")]
fn avx2<V: Vector, B: Vectored<V::Number>>(body: B) -> B::Output {
    body.run::<V>()
}

#[cfg(target_arch = "x86_64")]
#[target_feature(enable = "avx512f,avx512vl,avx512dq,avx512bw,avx2,fma")]
fn avx512<T: Lanes, B: Vectored<T>>(body: B) -> B::Output {
    body.run::<T::Avx512>()
}

/// A vector that the compiler maps to what every machine of the target has.
#[derive(Clone, Copy, Debug)]
pub struct Pack<T, const N: usize>([T; N]);

impl<T: Real, const N: usize> Pack<T, N> {
    #[inline(always)]
    fn with(self, other: Self, f: impl Fn(T, T) -> T) -> Self {
        Self(std::array::from_fn(|i| f(self.0[i], other.0[i])))
    }
}

impl<T: Real, const N: usize> Vector for Pack<T, N> {
    type Number = T;
    const LANES: usize = N;
    #[inline(always)]
    fn splat(x: T) -> Self {
        Self([x; N])
    }
    #[inline(always)]
    fn load(from: &[T]) -> Self {
        Self(from.first_chunk().copied().unwrap_or([T::ZERO; N]))
    }
    #[inline(always)]
    fn store(self, to: &mut [T]) {
        if let Some(to) = to.first_chunk_mut() {
            *to = self.0;
        }
    }
    #[inline(always)]
    fn plus(self, other: Self) -> Self {
        self.with(other, |a, b| a + b)
    }
    #[inline(always)]
    fn minus(self, other: Self) -> Self {
        self.with(other, |a, b| a - b)
    }
    #[inline(always)]
    fn times(self, other: Self) -> Self {
        self.with(other, |a, b| a * b)
    }
    #[inline(always)]
    fn fused(self, a: Self, b: Self) -> Self {
        self.times(a).plus(b)
    }
    #[inline(always)]
    fn over(self, other: Self) -> Self {
        self.with(other, |a, b| a / b)
    }
    #[inline(always)]
    fn larger(self, other: Self) -> Self {
        self.with(other, |a, b| if a > b { a } else { b })
    }
    #[inline(always)]
    fn top(self, other: Self) -> Self {
        self.with(other, |a, b| {
            let b = b.magnitude();
            if b > a { b } else { a }
        })
    }
    #[inline(always)]
    fn halves(self) -> (Self, Self) {
        (Self(self.0.map(|x| x.halves().0)), Self(self.0.map(|x| x.halves().1)))
    }
}

/// Two vectors as one. What is the same for both, as the taps of a filter, is read once where the instruction set has too few
/// registers to keep it: with AVX2 that saves a third of all loads of a step on a tile, which its two a cycle make the limit. A
/// body that carries a scheme's vectors from row to row besides (`cascade`) is a quarter slower so, as those no longer stay.
#[derive(Clone, Copy, Debug)]
pub struct Pair<V>(V, V);

impl<V: Vector> Vector for Pair<V> {
    type Number = V::Number;
    const LANES: usize = 2 * V::LANES;
    #[inline(always)]
    fn splat(x: V::Number) -> Self {
        let v = V::splat(x);
        Self(v, v)
    }
    #[inline(always)]
    fn load(from: &[V::Number]) -> Self {
        match from.get(..Self::LANES) {
            Some(from) => Self(V::load(&from[..V::LANES]), V::load(&from[V::LANES..])),
            None => Self::splat(V::Number::ZERO),
        }
    }
    #[inline(always)]
    fn store(self, to: &mut [V::Number]) {
        if let Some(to) = to.get_mut(..Self::LANES) {
            self.0.store(&mut to[..V::LANES]);
            self.1.store(&mut to[V::LANES..]);
        }
    }
    #[inline(always)]
    fn plus(self, other: Self) -> Self {
        Self(self.0.plus(other.0), self.1.plus(other.1))
    }
    #[inline(always)]
    fn minus(self, other: Self) -> Self {
        Self(self.0.minus(other.0), self.1.minus(other.1))
    }
    #[inline(always)]
    fn times(self, other: Self) -> Self {
        Self(self.0.times(other.0), self.1.times(other.1))
    }
    #[inline(always)]
    fn fused(self, a: Self, b: Self) -> Self {
        Self(self.0.fused(a.0, b.0), self.1.fused(a.1, b.1))
    }
    #[inline(always)]
    fn over(self, other: Self) -> Self {
        Self(self.0.over(other.0), self.1.over(other.1))
    }
    #[inline(always)]
    fn larger(self, other: Self) -> Self {
        Self(self.0.larger(other.0), self.1.larger(other.1))
    }
    #[inline(always)]
    fn top(self, other: Self) -> Self {
        Self(self.0.top(other.0), self.1.top(other.1))
    }
    #[inline(always)]
    fn halves(self) -> (Self, Self) {
        let (first, second) = (self.0.halves(), self.1.halves());
        (Self(first.0, second.0), Self(first.1, second.1))
    }
}

#[cfg(target_arch = "x86_64")]
mod x86 {
    //! The vectors of AVX2 and AVX-512. They are made and used only within functions that [`super::vectors`] calls after
    //! asking the machine, which is why their intrinsics may be called.

    use std::arch::x86_64::{
        __m256, __m256d, __m512, __m512d, _mm256_add_pd, _mm256_add_ps, _mm256_andnot_pd, _mm256_andnot_ps,
        _mm256_castpd_si256, _mm256_castps_si256, _mm256_castsi256_pd, _mm256_castsi256_ps, _mm256_div_pd,
        _mm256_div_ps, _mm256_fmadd_pd, _mm256_fmadd_ps, _mm256_loadu_pd, _mm256_loadu_ps, _mm256_max_pd,
        _mm256_max_ps, _mm256_mul_pd, _mm256_mul_ps, _mm256_set1_pd, _mm256_set1_ps, _mm256_slli_epi32,
        _mm256_slli_epi64, _mm256_srli_epi32, _mm256_srli_epi64, _mm256_storeu_pd, _mm256_storeu_ps,
        _mm256_sub_pd, _mm256_sub_ps, _mm512_add_pd, _mm512_add_ps, _mm512_andnot_pd, _mm512_andnot_ps,
        _mm512_castpd_si512, _mm512_castps_si512, _mm512_castsi512_pd, _mm512_castsi512_ps, _mm512_div_pd,
        _mm512_div_ps, _mm512_fmadd_pd, _mm512_fmadd_ps, _mm512_loadu_pd, _mm512_loadu_ps, _mm512_max_pd,
        _mm512_max_ps, _mm512_mul_pd, _mm512_mul_ps, _mm512_set1_pd, _mm512_set1_ps, _mm512_slli_epi32,
        _mm512_slli_epi64, _mm512_srli_epi32, _mm512_srli_epi64, _mm512_storeu_pd, _mm512_storeu_ps,
        _mm512_sub_pd, _mm512_sub_ps,
    };

    use super::Vector;

    macro_rules! vector {
        ($(#[$doc:meta])* $name:ident, $inner:ty, $number:ty, $lanes:expr, $splat:ident, $load:ident, $store:ident,
         $add:ident, $sub:ident, $mul:ident, $fma:ident, $max:ident, $andnot:ident, $div:ident,
         $bits:ident, $right:ident, $left:ident, $number_of:ident, $half:expr) => {
            $(#[$doc])*
            #[derive(Clone, Copy, Debug)]
            pub struct $name($inner);

            impl Vector for $name {
                type Number = $number;
                const LANES: usize = $lanes;
                #[inline(always)]
                fn splat(x: $number) -> Self {
                    // SAFETY: see the head of this module.
                    Self(unsafe { $splat(x) })
                }
                #[inline(always)]
                fn load(from: &[$number]) -> Self {
                    match from.first_chunk::<$lanes>() {
                        // SAFETY: as many numbers can be read; for the rest see the head of this module.
                        Some(from) => Self(unsafe { $load(from.as_ptr()) }),
                        None => Self::splat(0.0),
                    }
                }
                #[inline(always)]
                fn store(self, to: &mut [$number]) {
                    if let Some(to) = to.first_chunk_mut::<$lanes>() {
                        // SAFETY: as many numbers can be written; for the rest see the head of this module.
                        unsafe { $store(to.as_mut_ptr(), self.0) }
                    }
                }
                #[inline(always)]
                fn plus(self, other: Self) -> Self {
                    // SAFETY: see the head of this module.
                    Self(unsafe { $add(self.0, other.0) })
                }
                #[inline(always)]
                fn minus(self, other: Self) -> Self {
                    // SAFETY: see the head of this module.
                    Self(unsafe { $sub(self.0, other.0) })
                }
                #[inline(always)]
                fn times(self, other: Self) -> Self {
                    // SAFETY: see the head of this module.
                    Self(unsafe { $mul(self.0, other.0) })
                }
                #[inline(always)]
                fn fused(self, a: Self, b: Self) -> Self {
                    // SAFETY: see the head of this module.
                    Self(unsafe { $fma(self.0, a.0, b.0) })
                }
                #[inline(always)]
                fn over(self, other: Self) -> Self {
                    // SAFETY: see the head of this module.
                    Self(unsafe { $div(self.0, other.0) })
                }
                #[inline(always)]
                fn larger(self, other: Self) -> Self {
                    // SAFETY: see the head of this module.
                    Self(unsafe { $max(self.0, other.0) })
                }
                #[inline(always)]
                fn top(self, other: Self) -> Self {
                    // SAFETY: see the head of this module.
                    Self(unsafe { $max(self.0, $andnot($splat(-0.0), other.0)) })
                }
                #[inline(always)]
                fn halves(self) -> (Self, Self) {
                    // SAFETY: see the head of this module.
                    unsafe {
                        let bits = $bits(self.0);
                        let upper = $left::<$half>($right::<$half>(bits));
                        (Self($number_of(upper)), Self($number_of($left::<$half>(bits))))
                    }
                }
            }
        };
    }

    vector!(
        /// Eight `f32`.
        F32x8, __m256, f32, 8, _mm256_set1_ps, _mm256_loadu_ps, _mm256_storeu_ps, _mm256_add_ps, _mm256_sub_ps,
        _mm256_mul_ps, _mm256_fmadd_ps, _mm256_max_ps, _mm256_andnot_ps, _mm256_div_ps,
        _mm256_castps_si256, _mm256_srli_epi32, _mm256_slli_epi32, _mm256_castsi256_ps, 16
    );
    vector!(
        /// Four `f64`.
        F64x4, __m256d, f64, 4, _mm256_set1_pd, _mm256_loadu_pd, _mm256_storeu_pd, _mm256_add_pd, _mm256_sub_pd,
        _mm256_mul_pd, _mm256_fmadd_pd, _mm256_max_pd, _mm256_andnot_pd, _mm256_div_pd,
        _mm256_castpd_si256, _mm256_srli_epi64, _mm256_slli_epi64, _mm256_castsi256_pd, 32
    );
    vector!(
        /// Sixteen `f32`.
        F32x16, __m512, f32, 16, _mm512_set1_ps, _mm512_loadu_ps, _mm512_storeu_ps, _mm512_add_ps, _mm512_sub_ps,
        _mm512_mul_ps, _mm512_fmadd_ps, _mm512_max_ps, _mm512_andnot_ps, _mm512_div_ps,
        _mm512_castps_si512, _mm512_srli_epi32, _mm512_slli_epi32, _mm512_castsi512_ps, 16
    );
    vector!(
        /// Eight `f64`.
        F64x8, __m512d, f64, 8, _mm512_set1_pd, _mm512_loadu_pd, _mm512_storeu_pd, _mm512_add_pd, _mm512_sub_pd,
        _mm512_mul_pd, _mm512_fmadd_pd, _mm512_max_pd, _mm512_andnot_pd, _mm512_div_pd,
        _mm512_castpd_si512, _mm512_srli_epi64, _mm512_slli_epi64, _mm512_castsi512_pd, 32
    );
}
