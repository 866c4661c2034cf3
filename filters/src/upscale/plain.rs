//! Resampling filters without a model of a pixel: the plain choices, and what the others are held against.
//!
//! Each value of the result is a weighted mean of the pixels around its centre, as [`Geometry`] places it; beyond the border
//! the outermost pixels are repeated. Reduced again, the result is not the input. Overshoot (of Lanczos and the cubic) is
//! clamped to the range given. The filters are those of the crate `fast_image_resize`.
//!
//! Cost: 2, 4 or 6 taps along each axis.

use fast_image_resize::images::{TypedImage, TypedImageRef};
use fast_image_resize::pixels::F32;
use fast_image_resize::{FilterType, ResizeAlg, ResizeOptions, Resizer};

use super::{Axis, Enlarged, Geometry, Question};
use crate::limiter::Moved;
use crate::{Error, Outcome, Plane, Size};

/// Repeated pixels at each border: as far as the widest filter reaches from the half pixel beyond it.
const BORDER: usize = 5;

/// A resampling filter.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Kernel {
    /// A windowed sinc over six pixels: sharp, rings at edges.
    Lanczos3,
    /// The cubic of Catmull and Rom over four pixels.
    Cubic,
    /// Straight lines between pixels: never rings, blurs.
    Linear,
}

impl Kernel {
    /// The name that `--filter` takes.
    pub const fn name(self) -> &'static str {
        match self {
            Self::Lanczos3 => "lanczos3",
            Self::Cubic => "cubic",
            Self::Linear => "linear",
        }
    }
}

/// Enlarges one channel.
pub(super) fn enlarge(
    geometry: &Geometry,
    kernel: Kernel,
    samples: &Plane,
    question: &Question<'_>,
) -> Result<Enlarged, Error> {
    let (low, high) = (geometry.low(), geometry.high());
    let padded = Size::new(low.height + 2 * BORDER, low.width + 2 * BORDER);
    let inside = |at: usize, count: usize| at.saturating_sub(BORDER).min(count - 1);
    let mut pixels = Vec::with_capacity(padded.pixels());
    for y in 0..padded.height {
        let row = samples.row(inside(y, low.height));
        pixels.extend((0..padded.width).map(|x| F32::new(row[inside(x, low.width)])));
    }
    let filter = match kernel {
        Kernel::Lanczos3 => FilterType::Lanczos3,
        Kernel::Cubic => FilterType::CatmullRom,
        Kernel::Linear => FilterType::Bilinear,
    };
    let crop = |axis: &Axis| (BORDER as f64 + axis.shift / axis.scale, axis.outputs as f64 / axis.scale);
    let ((left, width), (top, height)) = (crop(&geometry.horizontal), crop(&geometry.vertical));
    let options = ResizeOptions::new()
        .resize_alg(ResizeAlg::Convolution(filter))
        .crop(left, top, width, height)
        .use_alpha(false);
    let too_large = |_| Error::TooLarge { size: high };
    let source = TypedImageRef::<F32>::new(padded.width as u32, padded.height as u32, &pixels)
        .map_err(|_| Error::TooLarge { size: low })?;
    let mut target = TypedImage::<F32>::new(high.width as u32, high.height as u32);
    Resizer::new().resize_typed(&source, &mut target, &options).map_err(too_large)?;
    let mut limited = Moved::default();
    let (map, (least, most)) = (question.map, question.range);
    let values = target.pixels().iter().map(|pixel| {
        let inside = pixel.0.clamp(least, most.max(least));
        if inside != pixel.0 {
            limited += Moved::from_to(map.inverse(pixel.0), map.inverse(inside));
        }
        inside
    });
    let plane = Plane::new(high, values.collect())?;
    Ok(Enlarged { plane, limited, outcome: Outcome::direct() })
}
