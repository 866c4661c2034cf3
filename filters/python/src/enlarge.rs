//! `upscale`.

use std::sync::Arc;

use lacuna_filters::Plans;
use lacuna_filters::descriptor::Configured;
use lacuna_filters::enlarge::{Options, upscale_with};
use lacuna_filters::fill::Values;
use lacuna_filters::upscale::plain::Kernel;
use lacuna_filters::upscale::{Axis, Geometry, Method, Sampling};
use lacuna_filters::variational::tv;
use pyo3::exceptions::PyValueError;
use pyo3::prelude::*;

use crate::arrays::{self, Array, Bytes, Guide, Image};
use crate::fill::{End, Settings, domain, method, steering, values};
use crate::work::{pool, run};

/// Enlarges an image to `height` and `width`; what is not finite, or not in the mask, is filled on the way.
#[pyfunction]
#[pyo3(signature = (image, height, width, mask, guides, sampling, filter, settings, values, domain, limit, threads))]
pub fn upscale<'py>(
    py: Python<'py>,
    image: Image<'py>,
    height: usize,
    width: usize,
    mask: Option<Bytes<'py>>,
    guides: Vec<(String, Guide<'py>)>,
    sampling: &str,
    filter: &str,
    settings: Settings,
    values: &str,
    domain: &str,
    limit: bool,
    threads: usize,
) -> PyResult<(Bound<'py, PyAny>, End)> {
    let pool = pool(threads)?;
    let (values, bounds, order) = self::values(values)?;
    let stand = (order, image.kind());
    let samples = image.planes(order, &pool);
    let sampling: Sampling =
        sampling.parse().map_err(|error| PyValueError::new_err(format!("sampling: {error}")))?;
    let low = samples.size();
    let geometry = Geometry {
        vertical: Axis::whole(low.height, height),
        horizontal: Axis::whole(low.width, width),
        sampling,
    };
    let mut options = Options::new(geometry);
    let mask = Arc::new(arrays::measured(mask.as_ref(), &samples)?);
    if values == Values::Light {
        arrays::not_wrong(&mask, &samples)?;
    }
    options.mask = Some(mask);
    options.method = enlarging(filter, &settings)?;
    options.fill.values = values;
    options.fill.bounds = bounds.map(|bounds| vec![bounds; samples.len()]).unwrap_or_default();
    options.fill.domain = self::domain(domain)?;
    options.fill.limit = limit;
    if !(guides.is_empty() || options.method == Method::Ss && values != Values::Directions) {
        return Err(PyValueError::new_err("guides: only ss takes some, and not for directions"));
    }
    let guides = steering(guides, geometry.high(), &pool)?;
    options.guides = (!guides.is_empty()).then_some(&guides);
    drop(image);
    let (array, outcome) = run(py, &pool, |run| {
        let large = upscale_with(&samples, &options, &Plans::new(), run);
        let large = large.map_err(|error| order.back(error, samples.len()))?;
        Ok((Array::new(large.planes, stand), large.outcome))
    })?;
    Ok((array.into_python(py)?, outcome.into()))
}

/// What makes the larger image.
fn enlarging(name: &str, settings: &Settings) -> PyResult<Method> {
    let plain = |method: Method| match settings.first() {
        None => Ok(method),
        Some((setting, _)) => {
            Err(PyValueError::new_err(format!("settings: {name} has no setting '{setting}'")))
        }
    };
    match name {
        "ss" => plain(Method::Ss),
        "tv" => {
            let mut settings_of = tv::Settings::default();
            set(&mut settings_of, name, settings)?;
            Ok(Method::Tv(settings_of))
        }
        "lanczos3" => plain(Method::Plain(Kernel::Lanczos3)),
        "cubic" => plain(Method::Plain(Kernel::Cubic)),
        "linear" => plain(Method::Plain(Kernel::Linear)),
        _ => {
            Err(PyValueError::new_err(format!("filter: '{name}' is none of ss, tv, lanczos3, cubic, linear")))
        }
    }
}

/// Sets what is in range, and keeps measured values.
fn set(of: &mut dyn Configured, name: &str, settings: &Settings) -> PyResult<()> {
    let checked = method(name, settings)?;
    if !checked.keeps_measured() {
        let line = "settings: they smooth what was measured, and upscale keeps it; fill first";
        return Err(PyValueError::new_err(line));
    }
    for (name, value) in settings {
        of.field(name).map(|field| field.read(value));
    }
    Ok(())
}
