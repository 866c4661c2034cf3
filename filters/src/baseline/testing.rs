//! What the tests of the baselines share.

use proptest::prelude::*;

use crate::{Mask, Size};

/// Masks of up to `largest` rows and columns and any density, with at least one measured pixel.
pub(crate) fn mask(largest: usize) -> impl Strategy<Value = Mask> {
    (1..=largest, 1..=largest, 0.0..1.0_f64).prop_flat_map(|(height, width, density)| {
        let size = Size::new(height, width);
        // The fourth power: sparse masks are the hard ones.
        let flags = prop::collection::vec(prop::bool::weighted(density.powi(4)), size.pixels());
        (flags, 0..size.pixels()).prop_map(move |(mut flags, one)| {
            flags[one] = true;
            Mask::new(size, flags).unwrap()
        })
    })
}

/// What `work` returns in a pool of that many threads.
pub(crate) fn with_threads<T: Send>(threads: usize, work: impl FnOnce() -> T + Send) -> T {
    rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap().install(work)
}
