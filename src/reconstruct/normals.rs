//! Filled normals become unit vectors again, and the background's zero stays zero.

use std::sync::Arc;

use lacuna_filters::Mask;

/// Shorter measured vectors are "no normal", as a background has.
const NO_NORMAL: f32 = 1e-3;
/// Filled vectors shorter than this have no direction to trust.
const NO_DIRECTION: f32 = 1e-2;

/// Whether most measured vectors that are any are of unit length; normals that are coded otherwise (0 to 1, say) are
/// not to be scaled.
pub fn are_unit(planes: [&[f32]; 3], mask: &Mask) -> bool {
    let (mut any, mut unit) = (0_usize, 0_usize);
    for at in (0..mask.as_slice().len()).filter(|&at| mask.as_slice()[at]) {
        let length = length(planes.map(|plane| plane[at]));
        any += usize::from(length > NO_NORMAL);
        unit += usize::from((length - 1.0).abs() < 0.05);
    }
    unit * 2 >= any
}

/// The pixels at which all three components were measured (or the first mask if there is no such pixel).
pub fn both(masks: &[Arc<Mask>; 3]) -> Arc<Mask> {
    if masks.iter().all(|mask| Arc::ptr_eq(mask, &masks[0])) {
        return Arc::clone(&masks[0]);
    }
    let all = Mask::from_fn(masks[0].size(), |y, x| masks.iter().all(|mask| mask.is_measured(y, x)));
    if all.is_empty() { Arc::clone(&masks[0]) } else { Arc::new(all) }
}

/// A mask in which the pixels to be scaled are missing: those that miss all three components, or all if the method
/// smooths.
pub fn kept(masks: &[Arc<Mask>; 3], keeps_measured: bool) -> Mask {
    let any = |y: usize, x: usize| keeps_measured && masks.iter().any(|mask| mask.is_measured(y, x));
    Mask::from_fn(masks[0].size(), any)
}

/// Scales every missing vector to unit length. Where the nearest measured vector is none, the filled one is none; one
/// without a direction takes the nearest measured one, whose place in `samples` is in `nearest`.
pub fn normalise(planes: [&mut [f32]; 3], samples: [&[f32]; 3], mask: &Mask, nearest: &[u32]) {
    let [x, y, z] = planes;
    for (at, _) in mask.as_slice().iter().enumerate().filter(|(_, measured)| !**measured) {
        let source = nearest[at] as usize;
        let near = samples.map(|plane| plane[source]);
        let vector = [x[at], y[at], z[at]];
        let new = if length(near) < NO_NORMAL {
            [0.0; 3]
        } else if length(vector) < NO_DIRECTION {
            unit(near)
        } else {
            unit(vector)
        };
        [x[at], y[at], z[at]] = new;
    }
}

fn length(vector: [f32; 3]) -> f32 {
    vector.iter().map(|v| f64::from(*v).powi(2)).sum::<f64>().sqrt() as f32
}

fn unit(vector: [f32; 3]) -> [f32; 3] {
    let length = vector.iter().map(|v| f64::from(*v).powi(2)).sum::<f64>().sqrt();
    vector.map(|v| (f64::from(v) / length) as f32)
}

#[cfg(test)]
mod tests {
    use lacuna_filters::Size;
    use lacuna_filters::baseline::nearest::NearestMap;

    use super::*;

    fn bits(vector: [f32; 3]) -> [u32; 3] {
        vector.map(f32::to_bits)
    }

    #[test]
    fn missing_vectors_become_units_and_the_background_stays_empty() {
        let mask = Mask::from_fn(Size::new(1, 6), |_, x| x == 0 || x == 5);
        let nearest = NearestMap::new(&mask).unwrap();
        let samples = [[0.0, 9., 9., 9., 9., 0.0], [0.6, 9., 9., 9., 9., 0.0], [0.8, 9., 9., 9., 9., 0.0]];
        let mut x = [0.0, 0.3, 0.0, 1e-4, 0.2, 0.0];
        let mut y = [0.6, 0.0, 1e-5, 0.0, 0.2, 0.0];
        let mut z = [0.8, 0.4, 0.0, 0.0, 0.2, 0.0];
        let borrowed = [samples[0].as_slice(), &samples[1], &samples[2]];
        assert!(are_unit(borrowed, &mask));
        normalise([&mut x, &mut y, &mut z], borrowed, &mask, nearest.as_slice());
        let at = |i: usize| [x[i], y[i], z[i]].map(f32::to_bits);
        assert_eq!(at(0), bits([0.0, 0.6, 0.8]));
        assert_eq!(at(1), bits([0.6, 0.0, 0.8]));
        assert_eq!(at(2), bits([0.0, 0.6, 0.8]));
        assert_eq!(at(3), bits([0.0; 3]));
        assert_eq!(at(4), bits([0.0; 3]));
        assert_eq!(at(5), bits([0.0; 3]));
    }

    #[test]
    fn coded_normals_are_recognised() {
        let mask = Mask::from_fn(Size::new(1, 4), |_, _| true);
        let half = [0.5_f32, 0.5, 0.9, 0.5];
        assert!(!are_unit([&half, &half, &half], &mask));
    }
}
