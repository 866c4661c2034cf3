//! Between the shapes of this crate and arrays of `ndarray`: (row, column), and (row, column, channel) for groups.
//!
//! Arrays become planes and masks without a copy where they are owned and lie row by row.

use ndarray::{Array2, Array3, ArrayView2, ArrayView3, ShapeError};

use crate::{Error, Mask, Plane, Planes, Size};

/// Height and width, and the values row by row.
fn parts<T: Clone>(array: Array2<T>) -> (Size, Vec<T>) {
    let (height, width) = array.dim();
    let size = Size::new(height, width);
    if array.is_standard_layout() && array.len() == size.pixels() {
        let (mut values, offset) = array.into_raw_vec_and_offset();
        let first = offset.unwrap_or(0);
        if first == 0 && values.len() >= size.pixels() {
            values.truncate(size.pixels());
            return (size, values);
        }
        return (size, values.drain(first..).take(size.pixels()).collect());
    }
    (size, array.iter().cloned().collect())
}

fn shape(size: Size) -> (usize, usize) {
    (size.height, size.width)
}

impl From<Array2<f32>> for Plane {
    fn from(array: Array2<f32>) -> Self {
        let (size, pixels) = parts(array);
        Self::of(size, pixels)
    }
}

impl From<ArrayView2<'_, f32>> for Plane {
    fn from(view: ArrayView2<'_, f32>) -> Self {
        let (height, width) = view.dim();
        Self::of(Size::new(height, width), view.iter().copied().collect())
    }
}

impl TryFrom<Plane> for Array2<f32> {
    type Error = ShapeError;

    fn try_from(plane: Plane) -> Result<Self, ShapeError> {
        Self::from_shape_vec(shape(plane.size()), plane.into_pixels())
    }
}

impl<'a> TryFrom<&'a Plane> for ArrayView2<'a, f32> {
    type Error = ShapeError;

    fn try_from(plane: &'a Plane) -> Result<Self, ShapeError> {
        Self::from_shape(shape(plane.size()), plane.pixels())
    }
}

/// A group of one plane.
impl From<Plane> for Planes {
    fn from(plane: Plane) -> Self {
        Self::of(plane.size(), vec![plane])
    }
}

/// A group of one plane.
impl From<Array2<f32>> for Planes {
    fn from(array: Array2<f32>) -> Self {
        Plane::from(array).into()
    }
}

/// A group of one plane.
impl From<ArrayView2<'_, f32>> for Planes {
    fn from(view: ArrayView2<'_, f32>) -> Self {
        Plane::from(view).into()
    }
}

/// (row, column, channel): a plane for each channel.
impl From<ArrayView3<'_, f32>> for Planes {
    fn from(view: ArrayView3<'_, f32>) -> Self {
        let (height, width, _) = view.dim();
        let planes = view.axis_iter(ndarray::Axis(2)).map(Plane::from).collect();
        Self::of(Size::new(height, width), planes)
    }
}

/// (row, column, channel).
impl TryFrom<&Planes> for Array3<f32> {
    type Error = ShapeError;

    fn try_from(planes: &Planes) -> Result<Self, ShapeError> {
        let views = planes.as_slice().iter().map(ArrayView2::try_from).collect::<Result<Vec<_>, _>>()?;
        if views.is_empty() {
            let (height, width) = shape(planes.size());
            return Self::from_shape_vec((height, width, 0), Vec::new());
        }
        ndarray::stack(ndarray::Axis(2), &views)
    }
}

/// The only plane of a group.
impl TryFrom<Planes> for Array2<f32> {
    type Error = Error;

    fn try_from(planes: Planes) -> Result<Self, Error> {
        let (size, found) = (planes.size(), planes.len());
        let wrong = |_| Error::SizeMismatch { expected: size, found: format!("{found} planes") };
        let [plane] = <[Plane; 1]>::try_from(planes.into_vec()).map_err(wrong)?;
        let wrong = |_| Error::TooLarge { size };
        Self::try_from(plane).map_err(wrong)
    }
}

impl From<Array2<bool>> for Mask {
    fn from(array: Array2<bool>) -> Self {
        let (size, flags) = parts(array);
        Self::of(size, flags)
    }
}

impl From<ArrayView2<'_, bool>> for Mask {
    fn from(view: ArrayView2<'_, bool>) -> Self {
        let (height, width) = view.dim();
        Self::of(Size::new(height, width), view.iter().copied().collect())
    }
}

impl<'a> TryFrom<&'a Mask> for ArrayView2<'a, bool> {
    type Error = ShapeError;

    fn try_from(mask: &'a Mask) -> Result<Self, ShapeError> {
        Self::from_shape(shape(mask.size()), mask.as_slice())
    }
}

#[cfg(test)]
mod tests {
    use ndarray::{array, s};

    use super::*;

    #[test]
    fn planes_and_masks_go_there_and_back() {
        let array = array![[1.0_f32, 2.0, 3.0], [4.0, 5.0, 6.0]];
        let plane = Plane::from(array.clone());
        assert_eq!((plane.size(), plane.row(1)), (Size::new(2, 3), &[4.0, 5.0, 6.0][..]));
        assert_eq!(ArrayView2::try_from(&plane).unwrap(), array.view());
        assert_eq!(Array2::try_from(plane).unwrap(), array);
        assert_eq!(Array2::try_from(Planes::from(array.clone())).unwrap(), array);
        let flags = array.mapv(|value| value > 2.5);
        assert_eq!(ArrayView2::try_from(&Mask::from(flags.clone())).unwrap(), flags.view());
        assert_eq!(Mask::from(flags.view()).count(), 4);
    }

    /// Columns that are stored one after the other, parts of larger arrays, arrays that begin within their buffer.
    #[test]
    fn any_layout_is_read_row_by_row() {
        let array = Array2::from_shape_fn((4, 5), |(y, x)| (10 * y + x) as f32);
        for (name, view) in [
            ("transposed", array.t()),
            ("a part", array.slice(s![1..3, 1..4])),
            ("rows", array.slice(s![1..3, ..])),
            ("upside down", array.slice(s![..;-1, ..;2])),
        ] {
            let expected: Vec<f32> = view.iter().copied().collect();
            assert_eq!(Plane::from(view).pixels(), expected, "{name}");
            assert_eq!(Plane::from(view.to_owned()).pixels(), expected, "{name}");
        }
        let rows = array.clone().slice_move(s![1..3, ..]);
        assert_eq!(Plane::from(rows).pixels(), &array.as_slice().unwrap()[5..15]);
        let turned = array.clone().reversed_axes();
        assert_eq!(Plane::from(turned.clone()).pixels(), turned.iter().copied().collect::<Vec<_>>());
    }

    #[test]
    fn channels_are_the_last_axis() {
        let image = Array3::from_shape_fn((2, 3, 4), |(y, x, c)| (100 * y + 10 * x + c) as f32);
        let planes = Planes::from(image.view());
        assert_eq!((planes.len(), planes.as_slice()[2].at(1, 2)), (4, 122.0));
        assert_eq!(Array3::try_from(&planes).unwrap(), image);
        assert!(matches!(Array2::try_from(planes), Err(Error::SizeMismatch { .. })));
        let none = Planes::zeros(Size::new(2, 3), 0);
        assert_eq!(Array3::try_from(&none).unwrap().dim(), (2, 3, 0));
    }

    #[test]
    fn arrays_without_pixels_are_planes_without_pixels() {
        let plane = Plane::from(Array2::<f32>::zeros((0, 7)));
        assert_eq!((plane.size(), plane.pixels().len()), (Size::new(0, 7), 0));
        assert_eq!(Array2::try_from(plane).unwrap().dim(), (0, 7));
    }
}
