//! What baselines and compressed sensing demand of the planes that it is given.

use rayon::prelude::*;

use crate::kernel::extremes;
use crate::{Error, Mask, Planes};

/// Sizes agree and measured values are finite; `out` has as many planes as `samples`.
pub(crate) fn group(mask: &Mask, samples: &Planes, out: &Planes) -> Result<(), Error> {
    for size in [samples.size(), out.size()] {
        if size != mask.size() {
            return Err(Error::SizeMismatch { expected: mask.size(), found: size.to_string() });
        }
    }
    if samples.len() != out.len() {
        let found = format!("{} planes where {} were expected", out.len(), samples.len());
        return Err(Error::SizeMismatch { expected: mask.size(), found });
    }
    let planes = samples.as_slice();
    if planes.par_iter().all(|plane| finite(mask, plane.pixels()).is_ok()) {
        return Ok(());
    }
    // Again in order, for the first that is wrong.
    planes.iter().try_for_each(|plane| finite(mask, plane.pixels()))
}

/// Measured values are finite.
fn finite(mask: &Mask, values: &[f32]) -> Result<(), Error> {
    let width = mask.size().width.max(1);
    for (row, (flags, values)) in mask.as_slice().chunks(width).zip(values.chunks(width)).enumerate() {
        if !extremes::finite(flags, values) {
            let bad = |(flag, value): (&bool, &f32)| *flag && !value.is_finite();
            let column = flags.iter().zip(values).position(bad).unwrap_or(0);
            return Err(Error::NotFinite { row, column });
        }
    }
    Ok(())
}
