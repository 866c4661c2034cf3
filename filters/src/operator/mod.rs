//! Linear maps on images, each with its adjoint or symmetric by construction.

pub mod energy;
pub mod fourier;
pub mod profile;
pub mod resample;
pub mod taps;
pub mod wavelet;
