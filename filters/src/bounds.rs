//! Bounds that filled values keep because every measured value keeps them.

/// Which bounds are asked of a plane.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Bounds {
    /// None: positions, normals.
    Free,
    /// Nowhere negative if measured so: light.
    #[default]
    Positive,
    /// Within 0 and 1, each if measured so: alpha and mattes.
    Unit,
}

impl Bounds {
    /// The smallest and the largest value allowed beside those `measured` values.
    pub fn range(self, measured: impl Iterator<Item = f32>) -> (f32, f32) {
        let (smallest, largest) = measured
            .fold((f32::INFINITY, f32::NEG_INFINITY), |(low, high), value| (value.min(low), value.max(high)));
        let low = if self != Self::Free && smallest >= 0.0 { 0.0 } else { f32::NEG_INFINITY };
        let high = if self == Self::Unit && smallest >= 0.0 && largest <= 1.0 { 1.0 } else { f32::INFINITY };
        (low, high)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn bounds_hold_only_where_the_measured_values_keep_them() {
        let range = |bounds: Bounds, measured: [f32; 2]| bounds.range(measured.into_iter());
        let (least, most) = (f32::NEG_INFINITY, f32::INFINITY);
        for (bounds, measured, expected) in [
            (Bounds::Unit, [0.0, 1.0], (0.0, 1.0)),
            (Bounds::Unit, [0.0, 1.25], (0.0, most)),
            (Bounds::Unit, [-1.0, 0.5], (least, most)),
            (Bounds::Positive, [0.0, 1.0], (0.0, most)),
            (Bounds::Positive, [-0.1, 1.0], (least, most)),
            (Bounds::Free, [0.0, 1.0], (least, most)),
        ] {
            assert_eq!(range(bounds, measured), expected, "{bounds:?} {measured:?}");
        }
    }
}
