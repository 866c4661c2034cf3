//! Between NumPy's arrays (row, column, channel) and planes. Each value is copied once, as planes are no parts of arrays.

use half::f16;
use lacuna_core::parallel::prelude::*;
use lacuna_filters::{Doubt, Error, Fit, Mask, Plane, Planes, Size};
use ndarray::{ArrayView3, s};
use numpy::{Element, PyArray1, PyArrayMethods, PyReadonlyArray2, PyReadonlyArray3};
use pyo3::exceptions::PyValueError;
use pyo3::prelude::*;
use rayon::ThreadPool;

/// An image of one of the types that are taken, of any strides.
#[derive(FromPyObject)]
pub enum Image<'py> {
    /// 32 bits.
    Single(PyReadonlyArray3<'py, f32>),
    /// 16 bits.
    Half(PyReadonlyArray3<'py, f16>),
}

/// A guide: values, or labels of surfaces.
#[derive(FromPyObject)]
pub enum Guide<'py> {
    /// Labels.
    Labels(PyReadonlyArray2<'py, u32>),
    /// Values.
    Values(Image<'py>),
}

/// Rows and columns that a mask or a plane of bytes has, true where a byte is not 0. Booleans come as bytes, as NumPy lets others than
/// 0 and 1 stand in them.
pub type Bytes<'py> = PyReadonlyArray2<'py, u8>;

/// The type of an image's values.
#[derive(Clone, Copy, PartialEq, Eq)]
pub enum Kind {
    /// 32 bits.
    Single,
    /// 16 bits.
    Half,
}

/// The order in which a file has the channels of an array, which is that of their names. Sums over channels then round as the tool's do.
#[derive(Clone, Copy, PartialEq, Eq)]
pub enum Order {
    /// Red, green and blue: turned round.
    Colours,
    /// As they come: x, y and z, or whatever else.
    Plain,
}

impl Order {
    /// Where a channel of so many stands.
    pub fn place(self, channel: usize, channels: usize) -> usize {
        if self == Self::Colours && channels == 3 { 2 - channel } else { channel }
    }

    /// An error of so many planes as one of the channels of the array.
    pub fn back(self, error: Error, channels: usize) -> Error {
        match error {
            Error::NothingFinite { plane } => Error::NothingFinite { plane: self.place(plane, channels) },
            other => other,
        }
    }
}

/// An array that Python is to have: row, column, channel.
pub struct Array {
    shape: [usize; 3],
    values: Values,
}

enum Values {
    Single(Vec<f32>),
    Half(Vec<f16>),
}

impl Image<'_> {
    /// The type of its values.
    pub fn kind(&self) -> Kind {
        if let Self::Single(_) = self { Kind::Single } else { Kind::Half }
    }

    /// A plane for each channel, in an order, read by the threads of a pool.
    pub fn planes(&self, order: Order, pool: &ThreadPool) -> Planes {
        match self {
            Self::Single(array) => {
                let array = array.as_array();
                pool.install(|| planes(&array, order, |value| value))
            }
            Self::Half(array) => {
                let array = array.as_array();
                pool.install(|| planes(&array, order, f16::to_f32))
            }
        }
    }
}

fn planes<T: Copy + Sync>(
    array: &ArrayView3<'_, T>,
    order: Order,
    value: impl Fn(T) -> f32 + Sync,
) -> Planes {
    let (height, width, channels) = array.dim();
    let mut planes = Planes::zeros(Size::new(height, width), channels);
    // All channels of a row together: an array that holds them side by side is read once.
    let mut rows: Vec<Vec<&mut [f32]>> = (0..height).map(|_| Vec::with_capacity(channels)).collect();
    for plane in planes.as_mut_slice() {
        for (row, pixels) in rows.iter_mut().zip(plane.pixels_mut().chunks_mut(width.max(1))) {
            row.push(pixels);
        }
    }
    rows.par_iter_mut().enumerate().for_each(|(y, row)| {
        for (at, out) in row.iter_mut().enumerate() {
            out.iter_mut()
                .zip(array.slice(s![y, .., order.place(at, channels)]))
                .for_each(|(out, &from)| *out = value(from));
        }
    });
    planes
}

/// A mask.
pub fn mask(bytes: &Bytes<'_>) -> Mask {
    Mask::from(bytes.as_array().mapv(|byte| byte != 0))
}

/// The given mask, or else the pixels that are finite in all channels, of which there must be one.
pub fn measured(given: Option<&Bytes<'_>>, samples: &Planes) -> PyResult<Mask> {
    if let Some(given) = given {
        return Ok(mask(given));
    }
    let mask = Mask::finite(samples);
    if mask.is_empty() {
        return Err(PyValueError::new_err("image: no pixel is finite in all channels"));
    }
    Ok(mask)
}

/// Labels, row by row.
pub fn labels(array: &PyReadonlyArray2<'_, u32>) -> Vec<u32> {
    array.as_array().iter().copied().collect()
}

impl Array {
    /// The planes, which stand in an order, as channels. A lone plane of 32 bits is not copied.
    pub fn new(planes: Planes, (order, kind): (Order, Kind)) -> Self {
        let (size, channels) = (planes.size(), planes.len());
        let shape = [size.height, size.width, channels];
        let values = match kind {
            Kind::Single if channels == 1 => {
                Values::Single(planes.into_vec().pop().map(Plane::into_pixels).unwrap_or_default())
            }
            Kind::Single => Values::Single(interleaved(&planes, order, |value| value)),
            Kind::Half => Values::Half(interleaved(&planes, order, to_half)),
        };
        Self { shape, values }
    }

    /// For Python, without a copy.
    pub fn into_python(self, py: Python<'_>) -> PyResult<Bound<'_, PyAny>> {
        match self.values {
            Values::Single(values) => shaped(py, values, self.shape),
            Values::Half(values) => shaped(py, values, self.shape),
        }
    }
}

/// Rounded to the nearest; a finite value stays finite, as in files.
fn to_half(value: f32) -> f16 {
    let half = f16::from_f32(value);
    if half.is_infinite() && value.is_finite() {
        return if value > 0.0 { f16::MAX } else { f16::MIN };
    }
    half
}

fn interleaved<T: Copy + Default + Send>(
    planes: &Planes,
    order: Order,
    value: impl Fn(f32) -> T + Sync,
) -> Vec<T> {
    let (size, channels) = (planes.size(), planes.len());
    let mut values = vec![T::default(); size.pixels() * channels];
    values.par_chunks_mut((size.width * channels).max(1)).enumerate().for_each(|(y, row)| {
        for (at, plane) in planes.as_slice().iter().enumerate() {
            let places = row.iter_mut().skip(order.place(at, channels)).step_by(channels);
            places.zip(plane.row(y)).for_each(|(out, &from)| *out = value(from));
        }
    });
    values
}

/// An array that owns the values.
pub fn shaped<T: Element, const N: usize>(
    py: Python<'_>,
    values: Vec<T>,
    shape: [usize; N],
) -> PyResult<Bound<'_, PyAny>>
where
    [usize; N]: ndarray::IntoDimension,
{
    Ok(PyArray1::from_vec(py, values).reshape(shape)?.into_any())
}

/// What is said of an image without a mask whose values are all finite.
pub fn nothing_missing() -> PyErr {
    PyValueError::new_err(
        "image: nothing is missing: no pixel is NaN or infinite; give the mask of the measured ones",
    )
}

/// Refuses a mask of light that has all of it at missing pixels, as one that is the other way round or of another frame has.
pub fn not_wrong(mask: &Mask, samples: &Planes) -> PyResult<()> {
    let mut found: Option<Doubt> = None;
    for plane in samples.as_slice() {
        match mask.fit(plane.pixels(), 0.0) {
            Fit::Right => return Ok(()),
            Fit::Doubtful(doubt) if found.is_none_or(|before| before.held < doubt.held) => {
                found = Some(doubt);
            }
            _ => {}
        }
    }
    found.map_or(Ok(()), |doubt| {
        let line = format!("mask: {doubt} (if it is right, put NaN or 0 at missing pixels)");
        Err(PyValueError::new_err(line))
    })
}
