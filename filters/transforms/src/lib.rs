//! Plans of fast Fourier transforms, for the numbers that the filters use.
//!
//! The planners of `rustfft` are generic: a crate that calls one compiles every butterfly for every instruction set itself, more than
//! a quarter of what there was to compile in the filters, and as much again for their tests. Here that is done once. Callers get trait
//! objects, which bring no code along.

use std::sync::Arc;

use realfft::RealFftPlanner;
use rustfft::FftPlanner;

pub use realfft::{ComplexToReal, RealToComplex};
pub use rustfft::Fft;
pub use rustfft::num_complex::Complex;

/// Numbers that transforms are planned for: `f32` and `f64`.
pub trait Planned: rustfft::FftNum {
    /// The transform of `length` complex numbers.
    fn forward(length: usize) -> Arc<dyn Fft<Self>>;
    /// Its inverse, times `length`.
    fn inverse(length: usize) -> Arc<dyn Fft<Self>>;
    /// The transform of `length` real numbers.
    fn real_forward(length: usize) -> Arc<dyn RealToComplex<Self>>;
    /// Its inverse, times `length`.
    fn real_inverse(length: usize) -> Arc<dyn ComplexToReal<Self>>;
}

macro_rules! planned {
    ($t:ty) => {
        impl Planned for $t {
            #[inline(never)]
            fn forward(length: usize) -> Arc<dyn Fft<Self>> {
                FftPlanner::new().plan_fft_forward(length)
            }
            #[inline(never)]
            fn inverse(length: usize) -> Arc<dyn Fft<Self>> {
                FftPlanner::new().plan_fft_inverse(length)
            }
            #[inline(never)]
            fn real_forward(length: usize) -> Arc<dyn RealToComplex<Self>> {
                RealFftPlanner::new().plan_fft_forward(length)
            }
            #[inline(never)]
            fn real_inverse(length: usize) -> Arc<dyn ComplexToReal<Self>> {
                RealFftPlanner::new().plan_fft_inverse(length)
            }
        }
    };
}
planned!(f32);
planned!(f64);
