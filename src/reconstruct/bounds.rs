//! Which bounds the values of a channel keep, by its name.

use lacuna_filters::Bounds;

use crate::channels;

/// The bounds of a channel that is filled, by its name.
pub fn bounds_of(name: &str) -> Bounds {
    if channels::is_chroma(name) {
        Bounds::Free
    } else if channels::is_light(name) {
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
    fn names_have_bounds() {
        let of = |bounds: Bounds, names: &[&str]| names.iter().all(|name| bounds_of(name) == bounds);
        assert!(of(Bounds::Unit, &["A", "spec.alpha", "hair.mask", "AR"]));
        assert!(of(
            Bounds::Positive,
            &["R", "Diffuse Direct.G", "Variance.R", "point_light.R", "1st_bounce.G"]
        ));
        assert!(of(Bounds::Free, &["P.X", "Px", "position.Z", "uv.U", "RY", "spec.by"]));
    }
}
