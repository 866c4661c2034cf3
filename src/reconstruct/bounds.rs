//! Bounds that filled values keep because every measured value keeps them.

use lacuna_filters::Mask;

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

/// Moves missing values inside the bounds that all measured `samples` keep; returns how many moved.
pub fn apply(bounds: Bounds, samples: &[f32], mask: &Mask, values: &mut [f32]) -> usize {
    let measured = || samples.iter().zip(mask.as_slice()).filter(|(_, measured)| **measured).map(|(v, _)| *v);
    let low = bounds != Bounds::Free && measured().all(|value| value >= 0.0);
    let high = bounds == Bounds::Unit && measured().all(|value| value <= 1.0);
    let mut moved = 0;
    for (value, _) in values.iter_mut().zip(mask.as_slice()).filter(|(_, measured)| !**measured) {
        if low && *value < 0.0 {
            *value = 0.0;
            moved += 1;
        } else if high && *value > 1.0 {
            *value = 1.0;
            moved += 1;
        }
    }
    moved
}

#[cfg(test)]
mod tests {
    use lacuna_filters::Size;

    use super::*;

    #[test]
    fn bounds_hold_only_where_the_measured_values_keep_them() {
        let mask = Mask::from_fn(Size::new(1, 4), |_, x| x < 2);
        let run = |bounds, measured: [f32; 2]| {
            let samples = [measured[0], measured[1], 0.0, 0.0];
            let mut values = [measured[0], measured[1], -0.5, 1.5];
            let moved = apply(bounds, &samples, &mask, &mut values);
            (values[2], values[3], moved)
        };
        assert_eq!(run(Bounds::Unit, [0.0, 1.0]), (0.0, 1.0, 2));
        assert_eq!(run(Bounds::Unit, [0.0, 1.25]), (0.0, 1.5, 1));
        assert_eq!(run(Bounds::Unit, [-1.0, 0.5]), (-0.5, 1.0, 1));
        assert_eq!(run(Bounds::Positive, [0.0, 1.0]), (0.0, 1.5, 1));
        assert_eq!(run(Bounds::Positive, [-0.1, 1.0]), (-0.5, 1.5, 0));
        assert_eq!(run(Bounds::Free, [0.0, 1.0]), (-0.5, 1.5, 0));
    }
}
