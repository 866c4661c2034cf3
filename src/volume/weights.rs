//! The weights of cubic interpolation along one axis, and their derivatives, for eight samples side by side.

use super::lanes::{Lanes, all};

/// Four weights of a cubic kernel and their derivatives.
pub trait Weights: Copy + Send + Sync {
    /// The largest sum of absolute weights over all three axes: 1 where no weight is negative.
    const GAIN: f32;
    /// Weights of the voxels -1, 0, 1, 2 at `f`, 0 to 1.
    fn weights(f: Lanes) -> [Lanes; 4];
    /// Their derivatives.
    fn derivatives(f: Lanes) -> [Lanes; 4];
}

/// The uniform cubic B-spline.
#[derive(Clone, Copy, Debug)]
pub struct BSpline;
/// The cubic of Catmull and Rom: goes through the voxels.
#[derive(Clone, Copy, Debug)]
pub struct CatmullRom;

impl Weights for BSpline {
    const GAIN: f32 = 1.0;

    #[inline(always)]
    fn weights(f: Lanes) -> [Lanes; 4] {
        let (sixth, g) = (all(1.0 / 6.0), all(1.0) - f);
        let (f2, g2) = (f * f, g * g);
        [
            g2 * g * sixth,
            all(2.0 / 3.0) - f2 * (all(1.0) - all(0.5) * f),
            all(2.0 / 3.0) - g2 * (all(1.0) - all(0.5) * g),
            f2 * f * sixth,
        ]
    }

    #[inline(always)]
    fn derivatives(f: Lanes) -> [Lanes; 4] {
        let g = all(1.0) - f;
        [g * g * all(-0.5), f * (all(1.5) * f - all(2.0)), g * (all(2.0) - all(1.5) * g), f * f * all(0.5)]
    }
}

impl Weights for CatmullRom {
    // 1.25 per axis, at one half.
    const GAIN: f32 = 1.953_125;

    #[inline(always)]
    fn weights(f: Lanes) -> [Lanes; 4] {
        [
            f * (all(-0.5) + f * (all(1.0) - all(0.5) * f)),
            all(1.0) + f * f * (all(1.5) * f - all(2.5)),
            f * (all(0.5) + f * (all(2.0) - all(1.5) * f)),
            f * f * (all(0.5) * f - all(0.5)),
        ]
    }

    #[inline(always)]
    fn derivatives(f: Lanes) -> [Lanes; 4] {
        [
            all(-0.5) + f * (all(2.0) - all(1.5) * f),
            f * (all(4.5) * f - all(5.0)),
            all(0.5) + f * (all(4.0) - all(4.5) * f),
            f * (all(1.5) * f - all(1.0)),
        ]
    }
}
