//! Row kernels of total variation: the primal-dual sweep and its certificate.
//!
//! Every kernel is a plain loop that is compiled once per instruction set, as other kernels are; but no loop contracts a product and a
//! sum, so all instruction sets give the same bits.
#![allow(clippy::inline_always, reason = "a body must be compiled with the instruction set of its caller")]
#![allow(
    unsafe_code,
    reason = "calls of functions compiled for an instruction set that was detected at run time"
)]

mod bound;
mod fused;
mod sweep;

pub use bound::{Bound, bound_row, squares_row, variation_row};
pub use fused::{Rates, SweepRow, repair_row, sweep_row};
pub use sweep::{DualRow, HeldRow, PrimalRow, ball_row, distance_row, dual_row};

/// The pointwise map of the dual variable: the nearest vector whose dual norm is at most 1.
pub trait DualBall: Copy + Send + Sync {
    /// Projects (vertical, horizontal).
    fn clip(a: f32, b: f32) -> (f32, f32);
    /// The norm of the gradient (vertical, horizontal) whose dual ball this is.
    fn norm(a: f64, b: f64) -> f64;
}

/// The Euclidean norm of each gradient; its dual ball is the unit disc.
#[derive(Clone, Copy, Debug)]
pub struct Isotropic;

/// The sum of the gradient's absolute components; its dual ball is the square [-1, 1] x [-1, 1].
#[derive(Clone, Copy, Debug)]
pub struct Anisotropic;

impl DualBall for Isotropic {
    #[inline(always)]
    fn clip(a: f32, b: f32) -> (f32, f32) {
        let shrink = 1.0 / (a * a + b * b).sqrt().max(1.0);
        (a * shrink, b * shrink)
    }

    #[inline(always)]
    fn norm(a: f64, b: f64) -> f64 {
        (a * a + b * b).sqrt()
    }
}

impl DualBall for Anisotropic {
    #[inline(always)]
    fn clip(a: f32, b: f32) -> (f32, f32) {
        (a.clamp(-1.0, 1.0), b.clamp(-1.0, 1.0))
    }

    #[inline(always)]
    fn norm(a: f64, b: f64) -> f64 {
        a.abs() + b.abs()
    }
}

/// Compiles `$body` for every instruction set and calls the one that is asked for.
macro_rules! dispatch {
    ($(#[$doc:meta])* $name:ident $(<$ball:ident>)? = $body:ident($($arg:ident: $type:ty),*) $(-> $result:ty)?) => {
        $(#[$doc])*
        #[inline]
        pub fn $name $(<$ball: $crate::kernel::tv::DualBall>)? (
            isa: $crate::kernel::Isa, $($arg: $type),*
        ) $(-> $result)? {
            #[cfg(target_arch = "x86_64")]
            {
                #[target_feature(enable = "avx2,fma")]
                fn avx2 $(<$ball: $crate::kernel::tv::DualBall>)? ($($arg: $type),*) $(-> $result)? {
                    $body $(::<$ball>)? ($($arg),*)
                }
                #[target_feature(enable = "avx512f,avx512vl,avx512dq,avx512bw,avx2,fma")]
                fn avx512 $(<$ball: $crate::kernel::tv::DualBall>)? ($($arg: $type),*) $(-> $result)? {
                    $body $(::<$ball>)? ($($arg),*)
                }
                match isa {
                    // SAFETY: `available` has just found the features.
                    $crate::kernel::Isa::Avx512 if isa.available() => return unsafe { avx512 $(::<$ball>)? ($($arg),*) },
                    // SAFETY: as above.
                    $crate::kernel::Isa::Avx2 if isa.available() => return unsafe { avx2 $(::<$ball>)? ($($arg),*) },
                    _ => {}
                }
            }
            let _ = isa;
            $body $(::<$ball>)? ($($arg),*)
        }
    };
}
use dispatch;

/// Lanes of the partial sums within a row: part of the result's definition, whatever the instruction set.
const LANES: usize = 8;

#[cfg(test)]
mod tests;
