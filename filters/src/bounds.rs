//! Bounds that filled values keep because every measured value keeps them.

/// Which bounds are asked of a plane.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Bounds {
    /// None: positions, normals.
    Free,
    /// Nowhere negative if measured so: light.
    #[default]
    Positive,
    /// Within 0 and 1, and no farther beyond than what was measured: alpha and mattes.
    Unit,
}

impl Bounds {
    /// The smallest and the largest value allowed beside those `measured` values.
    pub fn range(self, measured: impl Iterator<Item = f32>) -> (f32, f32) {
        let (smallest, largest) = measured
            .fold((f32::INFINITY, f32::NEG_INFINITY), |(low, high), value| (value.min(low), value.max(high)));
        self.around((smallest, largest))
    }

    /// The same of the smallest and the largest value measured.
    pub fn around(self, (smallest, largest): (f32, f32)) -> (f32, f32) {
        // A value that rounding took beyond 0 or 1 moves the bound, and does not free the others.
        match self {
            Self::Unit => {
                (if smallest < 0.0 { smallest } else { 0.0 }, if largest > 1.0 { largest } else { 1.0 })
            }
            Self::Positive if smallest >= 0.0 => (0.0, f32::INFINITY),
            Self::Positive | Self::Free => (f32::NEG_INFINITY, f32::INFINITY),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn bounds_enclose_the_measured_values() {
        let range = |bounds: Bounds, measured: [f32; 2]| bounds.range(measured.into_iter());
        let (least, most) = (f32::NEG_INFINITY, f32::INFINITY);
        for (bounds, measured, expected) in [
            (Bounds::Unit, [0.0, 1.0], (0.0, 1.0)),
            (Bounds::Unit, [0.0, 1.000_000_1], (0.0, 1.000_000_1)),
            (Bounds::Unit, [-1.0, 0.5], (-1.0, 1.0)),
            (Bounds::Positive, [0.0, 1.0], (0.0, most)),
            (Bounds::Positive, [-0.1, 1.0], (least, most)),
            (Bounds::Free, [0.0, 1.0], (least, most)),
        ] {
            assert_eq!(range(bounds, measured), expected, "{bounds:?} {measured:?}");
        }
    }
}
