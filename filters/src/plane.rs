//! Planes: one channel's pixels, and groups of them.

use ndarray::ArrayView2;

use crate::Error;

/// Height and width of an image in pixels.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub struct Size {
    /// Number of rows.
    pub height: usize,
    /// Number of columns.
    pub width: usize,
}

impl Size {
    /// `height` rows of `width` pixels.
    pub const fn new(height: usize, width: usize) -> Self {
        Self { height, width }
    }

    /// Number of pixels.
    pub const fn pixels(self) -> usize {
        self.height * self.width
    }
}

impl std::fmt::Display for Size {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        write!(f, "{}x{}", self.width, self.height)
    }
}

/// One channel: `height x width` values, row-major, `y` down.
#[derive(Clone, Debug, PartialEq)]
pub struct Plane {
    size: Size,
    pixels: Vec<f32>,
}

impl Plane {
    /// Takes `size.height * size.width` values, row by row.
    ///
    /// # Errors
    /// [`Error::SizeMismatch`] if the number of values is another.
    pub fn new(size: Size, pixels: Vec<f32>) -> Result<Self, Error> {
        if pixels.len() == size.pixels() {
            Ok(Self { size, pixels })
        } else {
            Err(Error::SizeMismatch { expected: size, found: format!("{} values", pixels.len()) })
        }
    }

    /// A plane with the same value everywhere.
    pub fn filled(size: Size, value: f32) -> Self {
        Self { size, pixels: vec![value; size.pixels()] }
    }

    /// A plane whose pixel at row `y`, column `x` is `value(y, x)`.
    pub fn from_fn(size: Size, mut value: impl FnMut(usize, usize) -> f32) -> Self {
        let mut pixels = Vec::with_capacity(size.pixels());
        for y in 0..size.height {
            pixels.extend((0..size.width).map(|x| value(y, x)));
        }
        Self { size, pixels }
    }

    /// Height and width.
    pub const fn size(&self) -> Size {
        self.size
    }

    /// All values, row by row.
    pub fn pixels(&self) -> &[f32] {
        &self.pixels
    }

    /// All values, row by row, to be changed.
    pub fn pixels_mut(&mut self) -> &mut [f32] {
        &mut self.pixels
    }

    /// Row `y`.
    pub fn row(&self, y: usize) -> &[f32] {
        &self.pixels[y * self.size.width..][..self.size.width]
    }

    /// Row `y`, to be changed.
    pub fn row_mut(&mut self, y: usize) -> &mut [f32] {
        &mut self.pixels[y * self.size.width..][..self.size.width]
    }

    /// The value at row `y`, column `x`.
    pub fn at(&self, y: usize, x: usize) -> f32 {
        self.pixels[y * self.size.width + x]
    }

    /// The values, row by row, without a copy.
    pub fn into_pixels(self) -> Vec<f32> {
        self.pixels
    }

    /// The plane as a two-dimensional array (row, column), without a copy.
    pub fn view(&self) -> Option<ArrayView2<'_, f32>> {
        ArrayView2::from_shape((self.size.height, self.size.width), &self.pixels).ok()
    }
}

/// A group of channels of one size, in a fixed order.
#[derive(Clone, Debug, PartialEq)]
pub struct Planes {
    size: Size,
    planes: Vec<Plane>,
}

impl Planes {
    /// Groups planes.
    ///
    /// # Errors
    /// [`Error::SizeMismatch`] if a plane's size is not `size`.
    pub fn new(size: Size, planes: Vec<Plane>) -> Result<Self, Error> {
        match planes.iter().find(|plane| plane.size() != size) {
            None => Ok(Self { size, planes }),
            Some(other) => Err(Error::SizeMismatch { expected: size, found: other.size().to_string() }),
        }
    }

    /// `count` planes of zeros.
    pub fn zeros(size: Size, count: usize) -> Self {
        Self { size, planes: vec![Plane::filled(size, 0.0); count] }
    }

    /// Height and width of every plane.
    pub const fn size(&self) -> Size {
        self.size
    }

    /// Number of planes.
    pub fn len(&self) -> usize {
        self.planes.len()
    }

    /// Whether there is no plane.
    pub fn is_empty(&self) -> bool {
        self.planes.is_empty()
    }

    /// The planes, in order.
    pub fn as_slice(&self) -> &[Plane] {
        &self.planes
    }

    /// The planes, in order, to be changed; their sizes stay.
    pub fn as_mut_slice(&mut self) -> &mut [Plane] {
        &mut self.planes
    }

    /// The planes, without a copy.
    pub fn into_vec(self) -> Vec<Plane> {
        self.planes
    }
}
