//! Between NumPy's arrays (row, column, channel) and planes. Each value is copied once, as planes are no parts of arrays.

use half::f16;
use lacuna_core::parallel::prelude::*;
use lacuna_filters::{Doubt, Fit, Mask, Plane, Planes, Size};
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

    /// A plane for each channel, in the order of a file, read by the threads of a pool.
    pub fn planes(&self, pool: &ThreadPool) -> Planes {
        self.ordered(pool, place)
    }

    /// A plane for each channel, in the order of the array.
    pub fn plain_planes(&self, pool: &ThreadPool) -> Planes {
        self.ordered(pool, |channel, _| channel)
    }

    fn ordered(&self, pool: &ThreadPool, place: fn(usize, usize) -> usize) -> Planes {
        match self {
            Self::Single(array) => {
                let array = array.as_array();
                pool.install(|| planes(&array, place, |value| value))
            }
            Self::Half(array) => {
                let array = array.as_array();
                pool.install(|| planes(&array, place, f16::to_f32))
            }
        }
    }
}

/// Where a channel of so many stands in a file, which has them by name: blue, green, red. Sums over channels then round as the tool's do.
pub fn place(channel: usize, channels: usize) -> usize {
    if channels == 3 { 2 - channel } else { channel }
}

fn planes<T: Copy + Sync>(
    array: &ArrayView3<'_, T>,
    place: fn(usize, usize) -> usize,
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
                .zip(array.slice(s![y, .., place(at, channels)]))
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
    /// The planes, in the order of a file, as channels. A lone plane of 32 bits is not copied.
    pub fn new(planes: Planes, kind: Kind) -> Self {
        let (size, channels) = (planes.size(), planes.len());
        let shape = [size.height, size.width, channels];
        let values = match kind {
            Kind::Single if channels == 1 => {
                Values::Single(planes.into_vec().pop().map(Plane::into_pixels).unwrap_or_default())
            }
            Kind::Single => Values::Single(interleaved(&planes, |value| value)),
            Kind::Half => Values::Half(interleaved(&planes, to_half)),
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

fn interleaved<T: Copy + Default + Send>(planes: &Planes, value: impl Fn(f32) -> T + Sync) -> Vec<T> {
    let (size, channels) = (planes.size(), planes.len());
    let mut values = vec![T::default(); size.pixels() * channels];
    values.par_chunks_mut((size.width * channels).max(1)).enumerate().for_each(|(y, row)| {
        for (at, plane) in planes.as_slice().iter().enumerate() {
            let places = row.iter_mut().skip(place(at, channels)).step_by(channels);
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
    found.map_or(Ok(()), |doubt| Err(PyValueError::new_err(format!("mask: {doubt}"))))
}
