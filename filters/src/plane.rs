//! Planes: one channel's pixels, and groups of them.

use crate::Error;
use lacuna_core::Size;
use lacuna_core::parallel::prelude::*;

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

    /// As many values as the size has pixels.
    pub(crate) const fn of(size: Size, pixels: Vec<f32>) -> Self {
        Self { size, pixels }
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
}

/// A group of channels of one size, in a fixed order.
#[derive(Debug, PartialEq)]
pub struct Planes {
    size: Size,
    planes: Vec<Plane>,
}

impl Clone for Planes {
    fn clone(&self) -> Self {
        Self { size: self.size, planes: self.planes.par_iter().map(Plane::clone) }
    }
}

/// Pixels that one task looks at.
const PIECE: usize = 1 << 14;

impl Planes {
    /// Whether all values are finite.
    pub(crate) fn are_finite(&self) -> bool {
        let piece = |values: &[f32]| values.iter().all(|value| value.is_finite());
        self.planes.iter().all(|plane| plane.pixels().par_chunks(PIECE).all(piece))
    }

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

    /// Planes of that size.
    pub(crate) const fn of(size: Size, planes: Vec<Plane>) -> Self {
        Self { size, planes }
    }

    /// `count` planes of zeros.
    pub fn zeros(size: Size, count: usize) -> Self {
        // Each by itself: memory that comes zeroed is not touched, a copy would be.
        Self { size, planes: (0..count).map(|_| Plane::filled(size, 0.0)).collect() }
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

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn pixels_lie_row_by_row() {
        let size = Size::new(2, 3);
        let mut plane = Plane::from_fn(size, |y, x| (10 * y + x) as f32);
        assert_eq!(plane.pixels(), [0.0, 1.0, 2.0, 10.0, 11.0, 12.0]);
        assert_eq!(plane.row(1), [10.0, 11.0, 12.0]);
        assert_eq!(plane.at(1, 2).to_bits(), 12.0_f32.to_bits());
        plane.row_mut(0)[2] = 7.0;
        plane.pixels_mut()[3] = 8.0;
        assert_eq!(plane.into_pixels(), [0.0, 1.0, 7.0, 8.0, 11.0, 12.0]);
        assert_eq!(Plane::filled(size, 2.0).pixels(), [2.0; 6]);
    }

    #[test]
    fn another_number_of_values_is_refused() {
        let size = Size::new(2, 3);
        assert!(Plane::new(size, vec![0.0; 6]).is_ok());
        for wrong in [0, 5, 7] {
            let error = Error::SizeMismatch { expected: size, found: format!("{wrong} values") };
            assert_eq!(Plane::new(size, vec![0.0; wrong]), Err(error));
        }
    }

    #[test]
    fn planes_of_a_group_have_one_size() {
        let size = Size::new(2, 3);
        let planes = vec![Plane::filled(size, 1.0), Plane::filled(size, 2.0)];
        let mut group = Planes::new(size, planes.clone()).unwrap();
        assert_eq!((group.size(), group.len(), group.is_empty()), (size, 2, false));
        group.as_mut_slice()[0].pixels_mut().fill(2.0);
        assert_eq!(group.as_slice()[0], planes[1]);
        assert_eq!(group.into_vec(), vec![planes[1].clone(), planes[1].clone()]);
        // As many pixels in another shape are another size.
        let other = vec![planes[0].clone(), Plane::filled(Size::new(3, 2), 0.0)];
        let error = Error::SizeMismatch { expected: size, found: "2x3".into() };
        assert_eq!(Planes::new(size, other), Err(error));
        assert!(Planes::zeros(size, 0).is_empty());
        assert_eq!(Planes::zeros(size, 2).as_slice()[1].pixels(), [0.0; 6]);
    }
}
