//! The sampling mask: which pixels were measured.

use lacuna_core::parallel::prelude::*;

use crate::{Error, Plane, Planes, Size};

/// Pixels that one task takes.
const PIECE: usize = 1 << 14;

/// Which pixels of an image were measured: `height x width` flags, row-major.
#[derive(Clone, Debug, PartialEq, Eq, Hash)]
pub struct Mask {
    size: Size,
    measured: Vec<bool>,
    count: usize,
}

impl Mask {
    /// Takes `size.height * size.width` flags, row by row; `true` is measured.
    ///
    /// # Errors
    /// [`Error::SizeMismatch`] if the number of flags is another.
    pub fn new(size: Size, measured: Vec<bool>) -> Result<Self, Error> {
        if measured.len() == size.pixels() {
            Ok(Self::of(size, measured))
        } else {
            Err(Error::SizeMismatch { expected: size, found: format!("{} flags", measured.len()) })
        }
    }

    /// As many flags as the size has pixels.
    pub(crate) fn of(size: Size, measured: Vec<bool>) -> Self {
        let count = measured.iter().filter(|&&flag| flag).count();
        Self { size, measured, count }
    }

    /// All pixels of an image.
    pub(crate) fn full(size: Size) -> Self {
        Self { size, measured: vec![true; size.pixels()], count: size.pixels() }
    }

    /// The pixels at which every plane of a group is finite: for arrays that say by NaN what was not measured.
    pub fn finite(planes: &Planes) -> Self {
        let mut flags = vec![true; planes.size().pixels()];
        for plane in planes.as_slice() {
            flags.iter_mut().zip(plane.pixels()).for_each(|(flag, value)| *flag &= value.is_finite());
        }
        Self::of(planes.size(), flags)
    }

    /// Whether a mask that is the other way round would leave these values: all measured ones within `zero` of 0, and several others at
    /// missing pixels (one value there is what a buffer was cleared to). Nothing if a measured value shows that it is right. What is not
    /// finite shows nothing.
    pub fn seems_inverted(&self, values: &[f32], zero: f32) -> Option<bool> {
        let finite = |wanted: bool| {
            let own = values.iter().zip(&self.measured).filter(move |(_, flag)| **flag == wanted);
            own.map(|(value, _)| *value).filter(|value| value.is_finite())
        };
        if finite(true).any(|value| value.abs() > zero) {
            return None;
        }
        let first = finite(false).next().unwrap_or_default();
        let blank = finite(true).next().is_some();
        Some(
            blank
                && finite(false).any(|value| value.abs() > zero)
                && finite(false).any(|value| value != first),
        )
    }

    /// A mask whose pixel at row `y`, column `x` is measured where `measured(y, x)`.
    pub fn from_fn(size: Size, mut measured: impl FnMut(usize, usize) -> bool) -> Self {
        let mut flags = Vec::with_capacity(size.pixels());
        for y in 0..size.height {
            flags.extend((0..size.width).map(|x| measured(y, x)));
        }
        let count = flags.iter().filter(|&&flag| flag).count();
        Self { size, measured: flags, count }
    }

    /// Puts the bits of measured pixels back into a plane.
    pub(crate) fn restore(&self, samples: &Plane, out: &mut Plane) {
        let pieces = self.measured.par_chunks(PIECE).zip(samples.pixels().par_chunks(PIECE));
        out.pixels_mut().par_chunks_mut(PIECE).zip(pieces).for_each(|(out, (flags, samples))| {
            for ((out, &flag), &sample) in out.iter_mut().zip(flags).zip(samples) {
                *out = if flag { sample } else { *out };
            }
        });
    }

    /// Height and width.
    pub const fn size(&self) -> Size {
        self.size
    }

    /// All flags, row by row.
    pub fn as_slice(&self) -> &[bool] {
        &self.measured
    }

    /// The flags of row `y`.
    pub fn row(&self, y: usize) -> &[bool] {
        &self.measured[y * self.size.width..][..self.size.width]
    }

    /// Whether the pixel at row `y`, column `x` was measured.
    pub fn is_measured(&self, y: usize, x: usize) -> bool {
        self.measured[y * self.size.width + x]
    }

    /// Number of measured pixels.
    pub const fn count(&self) -> usize {
        self.count
    }

    /// Measured pixels over all pixels, 0 to 1; 0 for an image without pixels.
    pub fn density(&self) -> f64 {
        if self.measured.is_empty() { 0.0 } else { self.count as f64 / self.measured.len() as f64 }
    }

    /// Whether every pixel was measured.
    pub fn is_full(&self) -> bool {
        self.count == self.measured.len()
    }

    /// Whether no pixel was measured.
    pub const fn is_empty(&self) -> bool {
        self.count == 0
    }

    /// That some pixel was measured.
    ///
    /// # Errors
    /// [`Error::EmptyMask`] if none was.
    pub const fn require_samples(&self) -> Result<(), Error> {
        if self.is_empty() { Err(Error::EmptyMask) } else { Ok(()) }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn counts_and_shows_what_was_measured() {
        let size = Size::new(2, 3);
        let mask = Mask::new(size, vec![true, false, false, true, true, false]).unwrap();
        assert_eq!(mask, Mask::from_fn(size, |y, x| x == 0 || (y, x) == (1, 1)));
        assert_eq!((mask.size(), mask.count(), mask.density().to_bits()), (size, 3, 0.5_f64.to_bits()));
        assert_eq!((mask.is_full(), mask.is_empty()), (false, false));
        assert_eq!(mask.row(1), [true, true, false]);
        assert!(mask.is_measured(1, 1) && !mask.is_measured(0, 1));
        assert_eq!(mask.as_slice().len(), 6);
    }

    #[test]
    fn values_at_missing_pixels_alone_make_a_mask_seem_inverted() {
        let mask = Mask::new(Size::new(1, 4), vec![true, true, false, false]).unwrap();
        for (values, zero, expected) in [
            ([0.0, 0.0, 0.5, 0.75], 0.0, Some(true)),
            ([0.0, 0.1, 0.5, 0.75], 0.0, None),
            ([0.0, -0.1, 0.5, 0.75], 0.2, Some(true)),
            ([0.0, f32::NAN, 0.5, f32::INFINITY], 0.0, Some(false)),
            ([0.0, f32::NAN, 0.5, 0.75], 0.0, Some(true)),
            ([f32::INFINITY, f32::NAN, 0.5, 0.75], 0.0, Some(false)),
            ([0.0, 0.0, 0.5, 0.5], 0.0, Some(false)),
            ([0.0, 0.0, 0.0, -0.0], 0.0, Some(false)),
        ] {
            assert_eq!(mask.seems_inverted(&values, zero), expected, "{values:?}");
        }
    }

    #[test]
    fn full_empty_and_nothing_at_all() {
        let size = Size::new(1, 4);
        let (full, empty) = (Mask::from_fn(size, |_, _| true), Mask::from_fn(size, |_, _| false));
        assert_eq!(
            (full.is_full(), full.is_empty(), full.density().to_bits()),
            (true, false, 1.0_f64.to_bits())
        );
        assert_eq!((empty.is_full(), empty.is_empty(), empty.density().to_bits()), (false, true, 0));
        assert!(matches!(empty.require_samples(), Err(Error::EmptyMask)) && full.require_samples().is_ok());
        let nothing = Mask::from_fn(Size::new(0, 4), |_, _| true);
        assert_eq!((nothing.is_empty(), nothing.density().to_bits()), (true, 0));
    }

    #[test]
    fn another_number_of_flags_is_refused() {
        let size = Size::new(2, 2);
        let error = Error::SizeMismatch { expected: size, found: "3 flags".into() };
        assert_eq!(Mask::new(size, vec![true; 3]), Err(error));
    }
}
