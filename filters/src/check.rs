//! What plans demand of the planes and the settings that they are given.

use lacuna_core::parallel::prelude::*;

use crate::kernel::extremes;
use crate::{Error, Mask, Planes};

/// A finite value of 0 or more.
pub(crate) fn not_negative(name: &'static str, value: f64) -> Result<(), Error> {
    if value >= 0.0 && value.is_finite() {
        Ok(())
    } else {
        Err(Error::setting(name, &value, "0 or more, finite"))
    }
}

/// A finite value above 0.
pub(crate) fn positive(name: &'static str, value: f64) -> Result<(), Error> {
    if value > 0.0 && value.is_finite() {
        Ok(())
    } else {
        Err(Error::setting(name, &value, "above 0, finite"))
    }
}

/// A count of 1 or more.
pub(crate) fn at_least_one(name: &'static str, value: usize) -> Result<(), Error> {
    if value > 0 { Ok(()) } else { Err(Error::setting(name, &value, "1 or more")) }
}

/// Sizes agree and measured values are finite; `out` has as many planes as `samples`.
pub(crate) fn group(mask: &Mask, samples: &Planes, out: &Planes) -> Result<(), Error> {
    for (name, size) in [("samples", samples.size()), ("an output", out.size())] {
        if size != mask.size() {
            return Err(Error::size(mask.size(), name, size));
        }
    }
    if samples.len() != out.len() {
        let found = format!("{} planes where {} were expected", out.len(), samples.len());
        return Err(Error::SizeMismatch { expected: mask.size(), found });
    }
    let planes = samples.as_slice();
    // The first that is wrong, whatever the threads.
    planes.par_iter().map(|plane| finite(mask, plane.pixels())).into_iter().collect()
}

/// Measured values are finite.
pub(crate) fn finite(mask: &Mask, values: &[f32]) -> Result<(), Error> {
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
