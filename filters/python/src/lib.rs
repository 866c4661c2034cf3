//! The extension module `lacuna._lacuna`: the calls of `lacuna_filters` on NumPy arrays.
//!
//! Arguments come checked and in one shape from the package around it (`package/lacuna/`), which is what users see.

mod arrays;
mod compare;
mod enlarge;
mod fill;
mod sampling;
mod work;

use pyo3::prelude::*;

/// What `lacuna` is made of.
#[pymodule]
fn _lacuna(module: &Bound<'_, PyModule>) -> PyResult<()> {
    module.add("__version__", env!("CARGO_PKG_VERSION"))?;
    module.add("FEWEST_GUIDED", lacuna_filters::upscale::guided::FEWEST)?;
    module.add_function(wrap_pyfunction!(fill::fill, module)?)?;
    module.add_function(wrap_pyfunction!(fill::filters, module)?)?;
    module.add_function(wrap_pyfunction!(fill::bytes_per_pixel, module)?)?;
    module.add_function(wrap_pyfunction!(enlarge::upscale, module)?)?;
    module.add_function(wrap_pyfunction!(sampling::mask, module)?)?;
    module.add_function(wrap_pyfunction!(sampling::next_mask, module)?)?;
    module.add_function(wrap_pyfunction!(compare::compare, module)?)
}
