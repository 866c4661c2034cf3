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

/// What values say about the mask that they were measured with.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Fit {
    /// A measured value shows that it is right.
    Right,
    /// Nothing.
    Unknown,
    /// It is hardly the one that they were measured with.
    Doubtful(Doubt),
}

/// All measured pixels are 0, and missing ones are not. As text it says so, what it may come from, and which mask is wanted.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Doubt {
    /// Missing pixels with another value than 0.
    pub held: usize,
    /// Missing pixels.
    pub missing: usize,
    /// Measured pixels.
    pub measured: usize,
}

impl Doubt {
    /// Whether the inverse explains it better than a mask of another frame, which has about as many pixels as this one: the pixels
    /// with values are then nearer in number to the missing than to the measured ones. Those of a dark frame are fewer than either.
    fn seems_inverted(self) -> bool {
        self.missing <= self.measured || self.held.abs_diff(self.missing) < self.held.abs_diff(self.measured)
    }
}

impl std::fmt::Display for Doubt {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        let Self { held, missing, .. } = self;
        let seems = if self.seems_inverted() {
            "inverted, or that of another frame or seed"
        } else {
            "that of another frame or seed, or inverted"
        };
        write!(
            f,
            "all measured pixels are 0, and {held} of {missing} missing ones have values: the mask seems {seems}; \
             give the one that these pixels were rendered with, 1 where they are measured"
        )
    }
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

    /// What the values of a channel say about the mask, taking what is within `zero` of 0 for 0. One that is the other way round, or of
    /// another frame, leaves 0 at all measured pixels and several values at missing ones (one value there is what a buffer was
    /// cleared to). What is not finite says nothing.
    pub fn fit(&self, values: &[f32], zero: f32) -> Fit {
        let finite = |wanted: bool| {
            let own = values.iter().zip(&self.measured).filter(move |(_, flag)| **flag == wanted);
            own.map(|(value, _)| *value).filter(|value| value.is_finite())
        };
        if finite(true).any(|value| value.abs() > zero) {
            return Fit::Right;
        }
        let first = finite(false).next().unwrap_or_default();
        let held = finite(false).filter(|value| value.abs() > zero).count();
        if held == 0 || finite(true).next().is_none() || finite(false).all(|value| value == first) {
            return Fit::Unknown;
        }
        Fit::Doubtful(Doubt { held, missing: values.len() - self.count, measured: self.count })
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
    fn values_at_missing_pixels_alone_make_a_mask_doubtful() {
        let mask = Mask::new(Size::new(1, 4), vec![true, true, false, false]).unwrap();
        let doubtful = |held| Fit::Doubtful(Doubt { held, missing: 2, measured: 2 });
        for (values, zero, expected) in [
            ([0.0, 0.0, 0.5, 0.75], 0.0, doubtful(2)),
            ([0.0, 0.1, 0.5, 0.75], 0.0, Fit::Right),
            ([0.0, -0.1, 0.5, 0.75], 0.2, doubtful(2)),
            ([0.0, 0.0, 0.1, 0.75], 0.2, doubtful(1)),
            ([0.0, f32::NAN, 0.5, f32::INFINITY], 0.0, Fit::Unknown),
            ([0.0, f32::NAN, 0.5, 0.75], 0.0, doubtful(2)),
            ([f32::INFINITY, f32::NAN, 0.5, 0.75], 0.0, Fit::Unknown),
            ([0.0, 0.0, 0.5, 0.5], 0.0, Fit::Unknown),
            ([0.0, 0.0, 0.0, -0.0], 0.0, Fit::Unknown),
        ] {
            assert_eq!(mask.fit(&values, zero), expected, "{values:?}");
        }
    }

    #[test]
    fn the_likelier_explanation_comes_first() {
        for (held, missing, measured, expected) in [
            (20, 20, 80, "the mask seems inverted, or that of another frame"),
            // Most of the frame is black.
            (3, 20, 80, "the mask seems inverted, or"),
            (75, 80, 20, "the mask seems inverted, or"),
            (50, 50, 50, "the mask seems inverted, or"),
            (20, 80, 20, "the mask seems that of another frame or seed, or inverted"),
            (40, 60, 40, "the mask seems that of another"),
        ] {
            let text = Doubt { held, missing, measured }.to_string();
            assert!(text.contains(expected), "{held} {missing} {measured}: {text}");
            assert!(
                text.contains(&format!("all measured pixels are 0, and {held} of {missing} missing")),
                "{text}"
            );
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
