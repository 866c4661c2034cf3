//! `mask` and `next_mask`.

use std::sync::Arc;

use lacuna_filters::sampling::{self, Field, Pattern, Temporal, refine};
use lacuna_filters::variational::ss;
use lacuna_filters::{Mask, Size};
use pyo3::exceptions::PyValueError;
use pyo3::prelude::*;

use crate::arrays::{self, Bytes, Image, Order};
use crate::work::{pool, run};

const PATTERNS: [Pattern; 5] =
    [Pattern::Shuffle, Pattern::Random, Pattern::Poisson, Pattern::BlueNoise, Pattern::Grid];

/// A mask, as the tool makes it for a window that begins at 0, 0.
#[pyfunction]
#[pyo3(signature = (height, width, density, pattern, seed, temporal, frame, threads))]
pub fn mask<'py>(
    py: Python<'py>,
    height: usize,
    width: usize,
    density: f64,
    pattern: &str,
    seed: u64,
    temporal: &str,
    frame: i64,
    threads: usize,
) -> PyResult<Bound<'py, PyAny>> {
    let none = || {
        let names = PATTERNS.map(Pattern::name).join(", ");
        PyValueError::new_err(format!("pattern: '{pattern}' is none of {names}"))
    };
    let pattern = PATTERNS.into_iter().find(|known| known.name() == pattern).ok_or_else(none)?;
    let temporal = match temporal {
        "fixed" => Temporal::Fixed,
        "offset" => Temporal::Offset,
        "complementary" => Temporal::Complementary,
        _ => {
            let line = format!("temporal: '{temporal}' is none of fixed, offset, complementary");
            return Err(PyValueError::new_err(line));
        }
    };
    let pool = pool(threads)?;
    let mask =
        run(py, &pool, |_| sampling::mask(pattern, field(height, width), density, seed, temporal, frame))?;
    flags(py, &mask)
}

/// The pixels to compute next: `count` of those that neither mask nor `closed` has.
#[pyfunction]
#[pyo3(signature = (image, mask, count, closed, seed, frame, threads))]
pub fn next_mask<'py>(
    py: Python<'py>,
    image: Image<'py>,
    mask: Option<Bytes<'py>>,
    count: usize,
    closed: Option<Bytes<'py>>,
    seed: u64,
    frame: Option<i64>,
    threads: usize,
) -> PyResult<Bound<'py, PyAny>> {
    let pool = pool(threads)?;
    let samples = image.planes(Order::Colours, &pool);
    let finite = Mask::finite(&samples);
    let measured = arrays::measured(mask.as_ref(), &samples)?;
    let closed = closed.map(|closed| arrays::mask(&closed));
    if mask.is_none() && measured.is_full() {
        return Err(arrays::nothing_missing());
    }
    arrays::not_wrong(&measured, &samples)?;
    drop(image);
    let size = samples.size();
    // A pixel that is not finite is measured, so not computed again, but says nothing about its surroundings.
    let usable = Mask::from_fn(size, |y, x| measured.is_measured(y, x) && finite.is_measured(y, x));
    if usable.is_empty() {
        return Err(PyValueError::new_err("image: no measured pixel is finite in all channels"));
    }
    let next = run(py, &pool, |run| {
        let settings = ss::Settings::default();
        let estimate = refine::estimate_spline(&samples, &Arc::new(usable), &settings, run)?;
        let open = |pixel: usize| {
            !measured.as_slice()[pixel] && closed.as_ref().is_none_or(|closed| !closed.as_slice()[pixel])
        };
        let mut flags = vec![false; size.pixels()];
        let preference = refine::Preference::new(seed, frame);
        for pixel in estimate.next(count, field(size.height, size.width), preference, open) {
            flags[pixel] = true;
        }
        Mask::new(size, flags)
    })?;
    flags(py, &next)
}

fn field(height: usize, width: usize) -> Field {
    Field { x: 0, y: 0, size: Size::new(height, width) }
}

fn flags<'py>(py: Python<'py>, mask: &Mask) -> PyResult<Bound<'py, PyAny>> {
    let size = mask.size();
    arrays::shaped(py, mask.as_slice().to_vec(), [size.height, size.width])
}
