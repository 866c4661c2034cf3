//! What the passes over a tile multiply the residual with: a rough inverse of the energy among the free pixels.

use super::factor::PLANES;

/// A preconditioner `M`, in buffers of the tile's window. It is zero in the rows and columns of pixels that are not free.
#[derive(Clone, Copy, Debug)]
pub enum Preconditioner<'a, T> {
    /// `D (B + c) D` with the blur `B` of 3 x 3 pixels, weights (1 2 1): enough for energies of order 2.
    Blur {
        /// The diagonal `D`, zero in all padding.
        d: &'a [T],
        /// Added to the middle of the blur.
        c: f64,
    },
    /// `G' G` with the sparse factor of [`super::factor`]: for energies of order 3.
    Factor([&'a [T]; PLANES]),
}

impl<'a, T> Preconditioner<'a, T> {
    /// Numbers that are zero where pixels are not free: of the blur the diagonal.
    pub const fn diagonal(&self) -> &'a [T] {
        match self {
            Self::Blur { d, .. } => d,
            Self::Factor(planes) => planes[0],
        }
    }
}
