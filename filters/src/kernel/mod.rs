//! Loops over rows: the only place for SIMD and for threads over pixels.

pub(crate) mod fir;
pub mod tv;
