//! Filled normals have the length that the measured ones around them have: one where those are unit vectors, less beside
//! antialiased ones, none in the background.

use std::sync::Arc;

use lacuna_filters::Mask;

/// Shorter measured vectors are "no normal", as a background has.
const NO_NORMAL: f32 = 1e-3;
/// Filled vectors shorter than this have no direction to trust.
const NO_DIRECTION: f32 = 1e-2;
/// Lengths within this of 1 are 1: the rounding of halves, twice.
const ROUNDING: f32 = 1.0 / 512.0;
/// Beside antialiased vectors one shorter than this share of all around may be an edge that none of them met, and stays.
const EDGE: f32 = 0.9;
/// One of so many measured vectors may be shorter where all are meant to be unit vectors.
const STRAY: usize = 100;

/// What the measured vectors of a normal are.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Lengths {
    /// Unit vectors, or none.
    Unit,
    /// Unit vectors and means of some: shorter at edges.
    Mixed,
}

/// The least and the greatest length that a vector may have.
pub type Range = (f32, f32);

impl Lengths {
    /// The length that a vector of this one gets.
    pub fn allowed(self, own: f32, (low, high): Range) -> f32 {
        if self == Self::Mixed && own < EDGE * low { own.min(high) } else { own.clamp(low, high) }
    }
}

/// What the lengths of the measured vectors are; nothing where most are not of unit length: normals that are coded otherwise
/// (0 to 1, say) are not to be scaled.
pub fn lengths(planes: [&[f32]; 3], mask: &Mask) -> Option<Lengths> {
    let (mut any, mut near, mut unit) = (0_usize, 0_usize, 0_usize);
    for at in (0..mask.as_slice().len()).filter(|&at| mask.as_slice()[at]) {
        let length = length(planes.map(|plane| plane[at]));
        any += usize::from(length > NO_NORMAL);
        near += usize::from((length - 1.0).abs() < 0.05);
        unit += usize::from((length - 1.0).abs() <= ROUNDING);
    }
    let whole = if (any - unit.min(any)) * STRAY <= any { Lengths::Unit } else { Lengths::Mixed };
    (near * 2 >= any).then_some(whole)
}

/// The lengths of the measured vectors at these pixels.
pub fn range(samples: [&[f32]; 3], around: impl Iterator<Item = usize>) -> Range {
    let whole = |length: f32| {
        if (length - 1.0).abs() <= ROUNDING {
            1.0
        } else if length < NO_NORMAL {
            0.0
        } else {
            length
        }
    };
    let lengths = around.map(|at| whole(length(samples.map(|plane| plane[at]))));
    let (low, high) =
        lengths.fold((f32::INFINITY, 0.0_f32), |(low, high), value| (value.min(low), value.max(high)));
    (low.min(high), high)
}

/// The same of unit vectors: what the nearest measured one has.
pub fn unit_range(samples: [&[f32]; 3], nearest: usize) -> Range {
    let length = if length(samples.map(|plane| plane[nearest])) < NO_NORMAL { 0.0 } else { 1.0 };
    (length, length)
}

/// The pixels at which all three components were measured; nothing if there is none.
pub fn both(masks: &[Arc<Mask>; 3]) -> Option<Arc<Mask>> {
    if masks.iter().all(|mask| Arc::ptr_eq(mask, &masks[0])) {
        return Some(Arc::clone(&masks[0]));
    }
    let all = Mask::from_fn(masks[0].size(), |y, x| masks.iter().all(|mask| mask.is_measured(y, x)));
    (!all.is_empty()).then(|| Arc::new(all))
}

/// A mask in which the pixels to be scaled are missing: those that miss all three components, or all if all three
/// were smoothed.
pub fn kept(masks: &[Arc<Mask>; 3], keeps_measured: bool) -> Mask {
    let any = |y: usize, x: usize| keeps_measured && masks.iter().any(|mask| mask.is_measured(y, x));
    Mask::from_fn(masks[0].size(), any)
}

/// Brings every missing vector into the range of lengths that is `allowed` at its pixel. One without a direction takes that of
/// the nearest measured one, whose place in `samples` is in `nearest`.
pub fn scale(
    planes: [&mut [f32]; 3],
    samples: [&[f32]; 3],
    mask: &Mask,
    nearest: &[u32],
    (lengths, range): (Lengths, impl Fn(usize) -> Range),
) {
    let [x, y, z] = planes;
    for (at, _) in mask.as_slice().iter().enumerate().filter(|(_, measured)| !**measured) {
        let near = samples.map(|plane| plane[nearest[at] as usize]);
        [x[at], y[at], z[at]] = within([x[at], y[at], z[at]], near, |own| lengths.allowed(own, range(at)));
    }
}

fn within(vector: [f32; 3], near: [f32; 3], allowed: impl Fn(f32) -> f32) -> [f32; 3] {
    let own = length(vector);
    let wanted = allowed(own);
    if wanted == own {
        return vector;
    }
    let towards = if own < NO_DIRECTION && length(near) >= NO_NORMAL { near } else { vector };
    let divisor = towards.iter().map(|v| f64::from(*v).powi(2)).sum::<f64>().sqrt();
    if divisor == 0.0 { vector } else { towards.map(|v| (f64::from(v) / divisor * f64::from(wanted)) as f32) }
}

fn length(vector: [f32; 3]) -> f32 {
    vector.iter().map(|v| f64::from(*v).powi(2)).sum::<f64>().sqrt() as f32
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
        assert_eq!(lengths(borrowed, &mask), Some(Lengths::Unit));
        let nearest = nearest.as_slice();
        let allowed = |at: usize| unit_range(borrowed, nearest[at] as usize);
        scale([&mut x, &mut y, &mut z], borrowed, &mask, nearest, (Lengths::Unit, allowed));
        let at = |i: usize| [x[i], y[i], z[i]].map(f32::to_bits);
        assert_eq!(at(0), bits([0.0, 0.6, 0.8]));
        assert_eq!(at(1), bits([0.6, 0.0, 0.8]));
        assert_eq!(at(2), bits([0.0, 0.6, 0.8]));
        assert_eq!(at(3), bits([0.0; 3]));
        assert_eq!(at(4), bits([0.0; 3]));
        assert_eq!(at(5), bits([0.0; 3]));
    }

    #[test]
    fn components_that_no_pixel_has_together_have_no_length() {
        let mask = |only: usize| Arc::new(Mask::from_fn(Size::new(1, 3), |_, x| x == only));
        assert_eq!(both(&[mask(0), mask(1), mask(1)]), None);
        assert_eq!(both(&[mask(1), mask(1), mask(1)]), Some(mask(1)));
    }

    #[test]
    fn coded_normals_are_recognised() {
        let mask = Mask::from_fn(Size::new(1, 4), |_, _| true);
        let half = [0.5_f32, 0.5, 0.9, 0.5];
        assert_eq!(lengths([&half, &half, &half], &mask), None);
    }

    #[test]
    fn a_vector_between_shorter_ones_is_no_unit() {
        let mask = Mask::from_fn(Size::new(1, 5), |_, x| x != 1 && x != 3);
        let (x, y) = ([0.0_f32; 5], [0.0_f32; 5]);
        let z = [1.0, 9.0, 0.5, 9.0, 0.0];
        let samples = [x.as_slice(), &y, &z];
        assert_eq!(lengths(samples, &mask), Some(Lengths::Mixed));
        let allowed = |at: usize| range(samples, [at - 1, at + 1].into_iter());
        assert_eq!((allowed(1), allowed(3)), ((0.5, 1.0), (0.0, 0.5)));
        let mut out = [[0.0; 5], [0.0, 0.48, 0.0, 0.0, 0.0], [1.0, 0.0, 0.5, 0.8, 0.0]];
        let [x, y, z] = &mut out;
        let nearest = [0, 0, 2, 2, 4];
        scale([x, y, z], samples, &mask, &nearest, (Lengths::Mixed, allowed));
        assert_eq!(bits([out[0][1], out[1][1], out[2][1]]), bits([0.0, 0.5, 0.0]));
        assert_eq!(bits([out[0][3], out[1][3], out[2][3]]), bits([0.0, 0.0, 0.5]));
        // Much shorter than all around: an edge that no sample met.
        assert_eq!(Lengths::Mixed.allowed(0.3, (0.5, 1.0)), 0.3);
        assert_eq!(Lengths::Unit.allowed(0.3, (1.0, 1.0)), 1.0);
    }
}
