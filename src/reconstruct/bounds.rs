//! Bounds that filled values keep because every measured value keeps them.

use crate::channels;

/// Which bounds are asked of a channel.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Bounds {
    /// None: positions, normals.
    Free,
    /// Nowhere negative if measured so: light.
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

/// The bounds of a channel that is filled, by its name.
pub fn bounds_of(name: &str) -> Bounds {
    if channels::is_light(name) {
        Bounds::Positive
    } else if channels::is_alpha(name) || channels::is_matte(name) {
        Bounds::Unit
    } else {
        Bounds::Free
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

    #[test]
    fn names_have_bounds() {
        let of = |bounds: Bounds, names: &[&str]| names.iter().all(|name| bounds_of(name) == bounds);
        assert!(of(Bounds::Unit, &["A", "spec.alpha", "hair.mask", "AR"]));
        assert!(of(Bounds::Positive, &["R", "Diffuse Direct.G", "uv.U", "Variance.R"]));
        assert!(of(Bounds::Free, &["P.X", "Px", "position.Z"]));
    }
}
