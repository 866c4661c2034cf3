//! The linear interpolation against closed forms and a search for the triangle.

use proptest::prelude::*;

use super::*;
use crate::{Plane, Size, baseline::testing};

fn fill(mask: &Mask, plane: &Plane) -> Plane {
    let size = mask.size();
    let mut out = Planes::zeros(size, 1);
    let plan = Settings.plan(&Problem::fill(Arc::new(mask.clone())), &Run::default()).unwrap();
    let samples = Planes::new(size, vec![plane.clone()]).unwrap();
    assert_eq!(plan.reconstruct(&samples, &mut out, &Run::default()), Ok(Outcome::direct()));
    out.into_vec().remove(0)
}

/// Where a mask's pixels are measured, the plane; NaN elsewhere.
fn sparse(mask: &Mask, value: impl Fn(usize, usize) -> f32) -> Plane {
    Plane::from_fn(mask.size(), |y, x| if mask.is_measured(y, x) { value(y, x) } else { f32::NAN })
}

proptest! {
    #[test]
    fn ramps_are_exact_inside_the_hull_and_nearest_outside(mask in testing::mask(24), a in -2.0..2.0_f32, b in -2.0..2.0_f32) {
        let ramp = |y: usize, x: usize| 0.5 + a * x as f32 + b * y as f32;
        let samples = sparse(&mask, ramp);
        let out = fill(&mask, &samples);
        let scattered = Scattered::new(&Arc::new(mask.clone())).unwrap();
        for y in 0..mask.size().height {
            for x in 0..mask.size().width {
                let at = y * mask.size().width + x;
                if scattered.triangulation.at[at] == NONE {
                    let source = scattered.nearest.as_slice()[at] as usize;
                    prop_assert_eq!(out.at(y, x).to_bits(), samples.pixels()[source].to_bits());
                } else {
                    // Values of up to 97, in f32; three products and two sums.
                    prop_assert!((out.at(y, x) - ramp(y, x)).abs() <= 8.0 * f32::EPSILON * 97.0);
                }
            }
        }
    }

    #[test]
    fn values_stay_within_those_measured(mask in testing::mask(24), seed in any::<u32>()) {
        let value = |y: usize, x: usize| ((y * 131 + x * 37 + seed as usize % 1000) % 101) as f32 / 7.0;
        let samples = sparse(&mask, value);
        let range = samples.pixels().iter().filter(|value| value.is_finite());
        let (low, high) = range.fold((f32::INFINITY, f32::NEG_INFINITY), |(a, b), &v| (a.min(v), b.max(v)));
        prop_assert!(fill(&mask, &samples).pixels().iter().all(|value| (low..=high).contains(value)));
    }
}

#[test]
fn collinear_samples_are_copied() {
    let mask = Mask::from_fn(Size::new(3, 5), |y, x| y == 1 && x % 2 == 0);
    let out = fill(&mask, &sparse(&mask, |_, x| x as f32));
    assert_eq!(out.row(0), [0.0, 0.0, 2.0, 2.0, 4.0]);
    assert_eq!(out.row(1), out.row(2));
}

#[test]
fn empty_masks_and_other_sizes_are_refused() {
    let size = Size::new(4, 4);
    let empty = Arc::new(Mask::from_fn(size, |_, _| false));
    assert_eq!(Settings.plan(&Problem::fill(empty), &Run::default()).err(), Some(Error::EmptyMask));
    let full = Arc::new(Mask::from_fn(size, |_, _| true));
    let plan = Settings.plan(&Problem::fill(full), &Run::default()).unwrap();
    let other = Planes::zeros(Size::new(4, 5), 1);
    assert!(plan.reconstruct(&other, &mut Planes::zeros(size, 1), &Run::default()).is_err());
}

#[test]
fn threads_change_no_bit() {
    let mask = Mask::from_fn(Size::new(101, 83), |y, x| (y * 31 + x * 17 + y * x) % 23 == 0);
    let samples = sparse(&mask, |y, x| ((y * y + 3 * x) % 19) as f32);
    let one = testing::with_threads(1, || fill(&mask, &samples));
    assert_eq!(one, testing::with_threads(3, || fill(&mask, &samples)));
}
