//! Loops over pixels in vectors: the only place for `unsafe` SIMD.
//!
//! A kernel is one generic body, [`Body::run`], that is compiled once per instruction set; [`dispatch`] picks one at run
//! time. The bodies accumulate in a fixed number of lanes, so instruction sets differ only where one fuses a
//! multiplication with an addition and another does not.
#![allow(
    clippy::inline_always,
    reason = "a body must be compiled inside the function that enables the features"
)]
#![allow(unsafe_code, reason = "calling a function that was compiled for an instruction set the CPU has")]

pub mod aligned;
pub mod blur;
pub mod cascade;
pub mod chebyshev;
pub mod convolution;
pub mod curvature;
pub mod dense;
pub mod detail;
pub mod diffusion;
pub mod extremes;
pub mod factor;
pub(crate) mod fir;
pub mod gradients;
pub mod heap;
mod interior;
pub mod minima;
pub mod points;
pub mod preconditioner;
pub mod pyramid;
pub mod regress;
pub mod resample;
pub mod rows;
pub mod simd;
pub mod spans;
pub mod stencil;
pub mod step;
pub mod tile;
pub mod tv;
pub mod vector;
pub mod window;

use std::sync::OnceLock;

/// Numbers that the kernels compute with: `f32` and `f64`.
pub trait Real:
    Copy
    + Default
    + Send
    + Sync
    + PartialOrd
    + std::fmt::Debug
    + std::ops::Add<Output = Self>
    + std::ops::Sub<Output = Self>
    + std::ops::Mul<Output = Self>
    + std::ops::Div<Output = Self>
    + std::ops::Neg<Output = Self>
    + std::ops::AddAssign
    + 'static
{
    /// Zero.
    const ZERO: Self;
    /// The nearest number.
    fn from_f64(x: f64) -> Self;
    /// The same number.
    fn to_f64(self) -> f64;
    /// `self * a + b`, with one rounding.
    fn fused(self, a: Self, b: Self) -> Self;
    /// The absolute value.
    fn magnitude(self) -> Self;
    /// Two numbers in one: the upper halves of their bits, rounded.
    fn packed(upper: Self, lower: Self) -> Self;
    /// The two numbers that one holds.
    fn halves(self) -> (Self, Self);
}

macro_rules! real {
    ($t:ty, $half:expr) => {
        impl Real for $t {
            const ZERO: Self = 0.0;
            #[inline(always)]
            fn from_f64(x: f64) -> Self {
                x as $t
            }
            #[inline(always)]
            fn to_f64(self) -> f64 {
                f64::from(self)
            }
            #[inline(always)]
            fn fused(self, a: Self, b: Self) -> Self {
                self.mul_add(a, b)
            }
            #[inline(always)]
            fn magnitude(self) -> Self {
                self.abs()
            }
            #[inline(always)]
            fn packed(upper: Self, lower: Self) -> Self {
                let rounded = |x: Self| (x.to_bits() + (1 << ($half - 1))) >> $half;
                Self::from_bits(rounded(upper) << $half | rounded(lower))
            }
            #[inline(always)]
            fn halves(self) -> (Self, Self) {
                let bits = self.to_bits();
                (Self::from_bits(bits >> $half << $half), Self::from_bits(bits << $half))
            }
        }
    };
}
real!(f32, 16);
real!(f64, 32);

/// `a * b + c`, fused where the instruction set has it.
#[inline(always)]
pub fn fma<T: Real, const FUSED: bool>(a: T, b: T, c: T) -> T {
    if FUSED { a.fused(b, c) } else { a * b + c }
}

/// An instruction set that kernels are compiled for.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Isa {
    /// What the target guarantees: SSE2 on `x86_64`, NEON on `aarch64`.
    Portable,
    /// AVX2 with FMA.
    Avx2,
    /// AVX-512 (F, VL, DQ, BW) with FMA.
    Avx512,
}

impl Isa {
    /// Whether this machine has it.
    pub fn available(self) -> bool {
        match self {
            Self::Portable => true,
            #[cfg(target_arch = "x86_64")]
            Self::Avx2 => is_x86_feature_detected!("avx2") && is_x86_feature_detected!("fma"),
            #[cfg(target_arch = "x86_64")]
            Self::Avx512 => {
                Self::Avx2.available()
                    && is_x86_feature_detected!("avx512f")
                    && is_x86_feature_detected!("avx512vl")
                    && is_x86_feature_detected!("avx512dq")
                    && is_x86_feature_detected!("avx512bw")
            }
            #[cfg(not(target_arch = "x86_64"))]
            _ => false,
        }
    }

    /// Every one that this machine has.
    #[cfg(test)]
    pub fn all() -> impl Iterator<Item = Self> {
        [Self::Portable, Self::Avx2, Self::Avx512].into_iter().filter(|isa| isa.available())
    }

    /// The best one that this machine has.
    pub fn best() -> Self {
        static BEST: OnceLock<Isa> = OnceLock::new();
        *BEST.get_or_init(|| {
            [Self::Avx512, Self::Avx2].into_iter().find(|isa| isa.available()).unwrap_or(Self::Portable)
        })
    }
}

/// A kernel's body, to be inlined whole into one function per instruction set.
pub trait Body {
    /// What it returns.
    type Output;
    /// Does it. `FUSED`: a multiplication and an addition may be fused.
    fn run<const FUSED: bool>(self) -> Self::Output;
}

/// Runs a body compiled for `isa`, or for the portable set if this machine lacks `isa`.
#[inline]
pub fn dispatch<B: Body>(isa: Isa, body: B) -> B::Output {
    match isa {
        #[cfg(target_arch = "x86_64")]
        Isa::Avx2 if isa.available() => {
            // SAFETY: `available` has just found the features that `avx2` is compiled for.
            unsafe { avx2(body) }
        }
        #[cfg(target_arch = "x86_64")]
        Isa::Avx512 if isa.available() => {
            // SAFETY: `available` has just found the features that `avx512` is compiled for.
            unsafe { avx512(body) }
        }
        _ => body.run::<false>(),
    }
}

#[cfg(target_arch = "x86_64")]
#[target_feature(enable = "avx2,fma")]
fn avx2<B: Body>(body: B) -> B::Output {
    body.run::<true>()
}

#[cfg(target_arch = "x86_64")]
#[target_feature(enable = "avx512f,avx512vl,avx512dq,avx512bw,avx2,fma")]
fn avx512<B: Body>(body: B) -> B::Output {
    body.run::<true>()
}
