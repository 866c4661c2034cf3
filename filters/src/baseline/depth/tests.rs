//! The depth rule on edges, infinities, ramps and random masks.

use proptest::prelude::*;

use super::*;
use crate::baseline::testing;

/// The depths that the rule gives, with NaN put at missing pixels beforehand.
fn filled(mask: &Mask, depth: &Plane) -> Plane {
    let size = mask.size();
    let sparse = Plane::from_fn(size, |y, x| if mask.is_measured(y, x) { depth.at(y, x) } else { f32::NAN });
    let map = DepthPlan::new(mask).unwrap().choose(&sparse).unwrap();
    let mut out = Plane::filled(size, f32::NAN);
    map.copy(sparse.pixels(), out.pixels_mut()).unwrap();
    out
}

fn scattered(size: Size, one_in: usize) -> Mask {
    Mask::from_fn(size, |y, x| (y * 7919 + x * 104_729 + (y * x) % 31).is_multiple_of(one_in))
}

#[test]
fn a_step_edge_leaves_only_its_two_depths() {
    for (near, far) in [(1.0, 100.0), (2.0, f32::INFINITY), (f32::NEG_INFINITY, 3.0)] {
        let size = Size::new(60, 70);
        let mask = scattered(size, 5);
        let depth = Plane::from_fn(size, |y, x| if x * 2 + y < 90 { near } else { far });
        let out = filled(&mask, &depth);
        assert!(out.pixels().iter().all(|z| [near, far].map(f32::to_bits).contains(&z.to_bits())));
        // And each on its own side, but for a few pixels along the edge.
        let wrong =
            out.pixels().iter().zip(depth.pixels()).filter(|(a, b)| a.to_bits() != b.to_bits()).count();
        assert!(wrong < 2 * 60, "{wrong} pixels are on the wrong side");
    }
}

#[test]
fn a_plane_behind_a_few_foreground_pixels_is_not_pulled_forward() {
    // The pixel between four far ones, three of which agree.
    let mask = Mask::from_fn(Size::new(3, 3), |y, x| (y + x) % 2 == 0 && (y, x) != (1, 1));
    let depth = Plane::from_fn(mask.size(), |y, x| if (y, x) == (0, 0) { 1.0 } else { 9.0 });
    assert_eq!(filled(&mask, &depth).at(1, 1).to_bits(), 9.0_f32.to_bits());
}

#[test]
fn ties_go_to_the_foreground() {
    let mask = Mask::from_fn(Size::new(1, 3), |_, x| x != 1);
    for values in [[5.0, 0.0, 2.0], [2.0, 0.0, 5.0], [2.0, 0.0, f32::INFINITY]] {
        let depth = Plane::new(mask.size(), values.to_vec()).unwrap();
        assert_eq!(filled(&mask, &depth).at(0, 1).to_bits(), 2.0_f32.to_bits());
    }
}

#[test]
fn a_ramp_is_met_better_than_by_the_nearest() {
    let size = Size::new(80, 80);
    let mask = scattered(size, 6);
    let depth = Plane::from_fn(size, |y, x| 10.0 + 0.5 * y as f32 + 0.25 * x as f32);
    let error = |out: &[f32]| -> f64 {
        out.iter().zip(depth.pixels()).map(|(a, b)| f64::from(a - b).abs()).sum::<f64>()
            / size.pixels() as f64
    };
    let mut nearest = Plane::filled(size, 0.0);
    NearestMap::new(&mask).unwrap().copy(depth.pixels(), nearest.pixels_mut()).unwrap();
    let (ours, nearest) = (error(filled(&mask, &depth).pixels()), error(nearest.pixels()));
    assert!(ours < nearest, "{ours} against {nearest}");
    // The spacing is about sqrt(6) pixels, the slope 0.56 per pixel.
    assert!(ours < 0.56 * 6.0_f64.sqrt(), "{ours}");
}

proptest! {
    #[test]
    fn copies_only_from_the_neighbourhood(mask in testing::mask(24), seed in any::<u32>()) {
        let size = mask.size();
        let noise = |y: usize, x: usize| ((y * 53 + x * 97) as u32 ^ seed).wrapping_mul(2_654_435_761);
        let depth = Plane::from_fn(size, |y, x| match noise(y, x) >> 28 {
            0 => f32::INFINITY,
            high => high as f32,
        });
        let map = DepthPlan::new(&mask).unwrap().choose(&depth).unwrap();
        let nearest = NearestMap::new(&mask).unwrap();
        for (at, (&source, &nearest)) in map.as_slice().iter().zip(nearest.as_slice()).enumerate() {
            let (y, x) = (at / size.width, at % size.width);
            prop_assert!(mask.as_slice()[source as usize]);
            prop_assert!(!mask.as_slice()[at] || source as usize == at);
            // Three times the nearest that was found, which a sweep may miss by less than a pixel.
            let most = 3.0 * ((distance_squared(nearest, y, x, size.width) as f64).sqrt() + 1.0);
            prop_assert!((distance_squared(source, y, x, size.width) as f64).sqrt() <= most);
        }
    }

    #[test]
    fn each_quadrant_is_searched_to_less_than_a_pixel(mask in testing::mask(20)) {
        let Size { height, width } = mask.size();
        for (below, right) in [(false, false), (false, true), (true, false), (true, true)] {
            for (at, &found) in sweep(&mask, below, right).iter().enumerate() {
                let (y, x) = (at / width, at % width);
                let rows = if below { y..height } else { 0..y + 1 };
                let columns = if right { x..width } else { 0..x + 1 };
                let all = rows.flat_map(|v| columns.clone().map(move |u| (v, u)));
                let best = all
                    .filter(|&(v, u)| mask.is_measured(v, u))
                    .map(|(v, u)| distance_squared((v * width + u) as u32, y, x, width))
                    .min();
                match best {
                    None => prop_assert_eq!(found, NONE),
                    Some(best) => {
                        let found = distance_squared(found, y, x, width);
                        prop_assert!((found as f64).sqrt() < (best as f64).sqrt() + 1.0);
                    }
                }
            }
        }
    }
}

#[test]
fn every_size_and_no_size() {
    for (height, width) in [(1, 1), (1, 9), (9, 1), (2, 2), (5, 4)] {
        let size = Size::new(height, width);
        let mask = Mask::from_fn(size, |y, x| y * width + x == size.pixels() / 2);
        assert_eq!(filled(&mask, &Plane::filled(size, 4.0)), Plane::filled(size, 4.0));
    }
    let empty = Mask::from_fn(Size::new(2, 2), |_, _| false);
    assert_eq!(DepthPlan::new(&empty).err(), Some(Error::EmptyMask));
    let plan = DepthPlan::new(&Mask::from_fn(Size::new(2, 2), |_, _| true)).unwrap();
    assert!(plan.choose(&Plane::filled(Size::new(1, 4), 0.0)).is_err());
}

#[test]
fn threads_change_no_bit() {
    let size = Size::new(150, 90);
    let mask = scattered(size, 13);
    let depth = Plane::from_fn(size, |y, x| ((y * x) % 17) as f32);
    let with = |threads| testing::with_threads(threads, || filled(&mask, &depth));
    let one = with(1);
    assert_eq!(one, with(2));
    assert_eq!(one, with(5));
}
