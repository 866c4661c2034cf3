use proptest::prelude::*;

use super::*;
use crate::{Size, baseline::testing};

/// A row with one value for each flag, all measured.
fn row(values: &[f32]) -> (Mask, Plane) {
    let size = Size::new(1, values.len());
    (Mask::from_fn(size, |_, _| true), Plane::new(size, values.to_vec()).unwrap())
}

fn auto(values: &[f32]) -> Map {
    let (mask, plane) = row(values);
    Domain::Auto.map(&mask, &[plane])
}

#[test]
fn auto_takes_the_logarithm_of_a_long_range_only() {
    let mut values = vec![0.1; 1000];
    assert_eq!(auto(&values), Map::Linear);
    values[7] = 1000.0;
    assert_eq!(auto(&values).name(), "log");
    values[..200].fill(1000.0);
    assert_eq!(auto(&values).name(), "log");
    values[..200].fill(-1000.0);
    assert_eq!(auto(&values).name(), "log");
    let ramp: Vec<f32> = (0..1000).map(|i| i as f32 / 1000.0).collect();
    assert_eq!(auto(&ramp), Map::Linear);
    // A soft volume: a quarter of what is not black lies below a thousandth.
    let soft: Vec<f32> = (1..1000).map(|i| (i as f32 / 1000.0).powi(5)).collect();
    assert_eq!(auto(&soft), Map::Linear);
    // Black does not count, nor a haze that looks like it.
    let mut sparse = vec![0.0; 10_000];
    sparse[..100].fill(0.5);
    assert_eq!(auto(&sparse), Map::Linear);
    for haze in [1e-12, 1e-5, -1e-5, 1e-4] {
        sparse[100..].fill(haze);
        assert_eq!(auto(&sparse), Map::Linear);
    }
    // Whoever asks for logarithms gets those of black, too.
    let (mask, plane) = row(&sparse);
    let Map::Log { scale } = Domain::Log.map(&mask, &[plane]) else { panic!("linear") };
    assert!(scale < 1e-3, "{scale}");
    // Of a dark frame, black is as much darker.
    let mut dark = vec![1e-8; 1000];
    dark[7] = 1e-5;
    assert_eq!(auto(&dark).name(), "log");
    assert_eq!(auto(&[0.0, -0.0]), Map::Linear);
    assert_eq!(Domain::Log.map(&row(&[0.0]).0, &[row(&[0.0]).1]), Map::Linear);
    assert_eq!(Domain::Linear.map(&row(&[0.1, 1e9]).0, &[row(&[0.1, 1e9]).1]), Map::Linear);
    assert_eq!(Domain::Log.map(&row(&[2.0]).0, &[row(&[2.0]).1]).name(), "log");
}

#[test]
fn the_channels_of_a_group_decide_together_and_by_measured_pixels_only() {
    let size = Size::new(1, 400);
    let mask = Mask::from_fn(size, |_, x| x != 3);
    let plane = |peak: f32| Plane::from_fn(size, |_, x| if x == 9 { peak } else { 0.1 });
    let group = [plane(0.1), plane(900.0), plane(0.1)];
    let map = Domain::Auto.map(&mask, &group);
    assert_eq!(map.name(), "log");
    // One map, so that equal values of two channels stay equal.
    assert_eq!(Domain::Auto.map(&mask, &[group[1].clone(), plane(0.1), plane(0.1)]), map);
    let unseen = Plane::from_fn(size, |_, x| if x == 3 { f32::NAN } else { 0.1 });
    assert_eq!(Domain::Auto.map(&mask, &[unseen]), Map::Linear);
}

#[test]
fn planes_follow_the_values() {
    let size = Size::new(3, 2000);
    let mask = Mask::from_fn(size, |y, x| (y + x) % 3 == 0);
    let plane = Plane::from_fn(size, |y, x| if (y + x) % 3 == 0 { x as f32 - 900.0 } else { f32::NAN });
    let map = Map::Log { scale: 0.7 };
    let mut mapped = plane.clone();
    map.forward_plane(&mask, &mut mapped);
    for ((mapped, flag), value) in mapped.pixels().iter().zip(mask.as_slice()).zip(plane.pixels()) {
        assert_eq!(mapped.to_bits(), if *flag { map.forward(*value) } else { 0.0 }.to_bits());
    }
    let mut back = mapped.clone();
    map.inverse_plane(&mut back);
    for (back, mapped) in back.pixels().iter().zip(mapped.pixels()) {
        assert_eq!(back.to_bits(), map.inverse(*mapped).to_bits());
    }
    let mut same = plane.clone();
    Map::Linear.forward_plane(&mask, &mut same);
    Map::Linear.inverse_plane(&mut same);
    assert!(same.pixels().iter().zip(plane.pixels()).all(|(a, b)| a.to_bits() == b.to_bits()));
}

#[test]
fn the_slope_is_that_of_the_map() {
    let map = Map::Log { scale: 0.5 };
    for value in [-3.0_f32, -0.1, 0.0, 0.2, 40.0] {
        let h = 1e-2 * (1.0 + value.abs());
        let difference = (map.forward(value + h) - map.forward(value - h)) / (2.0 * h);
        assert!((map.slope(value) - difference).abs() <= 1e-2 * difference, "{value}");
    }
    assert_eq!(Map::Linear.slope(7.0), 1.0);
}

#[test]
fn what_is_shown_ends_at_white() {
    for (scale, white) in [(0.01, 1.0), (0.25, 1.0), (3.0, 12.0)] {
        let map = Map::Log { scale };
        let shown = |value: f32| map.shown(f64::from(map.forward(value)));
        for (value, expected) in
            [(-9.0, -1.0), (-0.25, -0.5), (0.0, 0.0), (0.25, 0.5), (1.0, 1.0), (50.0, 1.0)]
        {
            let found = shown(value * white);
            assert!((found - expected).abs() <= 8.0 * f64::from(f32::EPSILON), "{value} {found}");
        }
    }
    assert_eq!(Map::Linear.shown(-7.0), -7.0);
}

#[test]
fn what_is_too_large_becomes_the_largest() {
    let map = Map::Log { scale: 1.0 };
    assert_eq!(map.inverse(1e9).to_bits(), f32::MAX.to_bits());
    assert_eq!(map.inverse(-1e9).to_bits(), f32::MIN.to_bits());
    assert_eq!(map.forward(0.0).to_bits(), 0.0_f32.to_bits());
    assert_eq!(map.inverse(-0.0).to_bits(), (-0.0_f32).to_bits());
}

#[test]
fn samples_that_crowd_onto_highlights_speak_for_their_pixels_alone() {
    let size = Size::new(200, 200);
    let is_light = |y: usize, x: usize| y < 40 && x < 40;
    let plane = Plane::from_fn(size, |y, x| if is_light(y, x) { 30.0 } else { 0.1 });
    let auto = |mask: &Mask| Domain::Auto.map(mask, std::slice::from_ref(&plane));
    assert!(auto(&Mask::full(size)).is_log());
    // As rounds choose: all of the highlight, and a pixel in 64 of the rest.
    let crowded = |y, x| is_light(y, x) || (y % 8 == 3 && x % 8 == 3);
    assert!(auto(&Mask::from_fn(size, crowded)).is_log());
    // Even samples count alike, so that their bits stay.
    assert_eq!(cells(&Mask::from_fn(size, |y, x| y % 2 == 0 && x % 2 == 0)), None);
}

#[test]
fn values_far_from_one_take_another_unit_without_a_bit_changed() {
    let of = |exponent: i32| {
        let values = [0.3, 1.0, -7.0, 0.0, 1e-3].map(|value: f32| value * 2.0_f32.powi(exponent));
        let (mask, plane) = row(&values);
        (Map::Linear.in_range(&mask, std::slice::from_ref(&plane)), values)
    };
    for exponent in [-126, -110, -40, -18, 0, 18, 40, 110, 124] {
        let (map, values) = of(exponent);
        assert_eq!(map.is_linear(), exponent.abs() <= 18, "{exponent}");
        assert!(map.name() == "linear" && !map.is_log());
        for value in values {
            assert_eq!(map.inverse(map.forward(value)).to_bits(), value.to_bits(), "{exponent}");
            assert_eq!(map.shown(f64::from(map.forward(value))), f64::from(value));
        }
        // About 1, whatever it was.
        assert!((1.0..=32.0).contains(&map.forward(values[2]).abs()) || map.is_linear(), "{exponent}");
    }
    // One value that is far larger is not what the others are squared for.
    let (mask, plane) = row(&[vec![1.0; 10_000], vec![1e20]].concat());
    assert!(Map::Linear.in_range(&mask, &[plane]).is_linear());
    let (mask, black) = row(&[0.0]);
    assert!(Map::Linear.in_range(&mask, &[black]).is_linear());
    let log = Map::Log { scale: 1e-30 };
    assert_eq!(log.in_range(&row(&[1e-30]).0, &[row(&[1e-30]).1]), log);
}

/// Normal values of every size and both signs.
fn value() -> impl Strategy<Value = f32> {
    (-60.0..60.0_f32, any::<bool>()).prop_map(|(log, sign)| if sign { log.exp2() } else { -log.exp2() })
}

proptest! {
    #[test]
    fn there_and_back_within_the_stated_error(value in value(), log in -20.0..20.0_f64) {
        let scale = log.exp2();
        let map = Map::Log { scale };
        let back = map.inverse(map.forward(value));
        let size = f64::from(value).abs();
        let bound = (2.0 + (size / scale).asinh()) * f64::from(f32::EPSILON) / 2.0 * size;
        // Second-order terms and the 1e-12 of the f64 functions.
        prop_assert!(f64::from(back - value).abs() <= 1.0001 * bound, "{value} {back}");
    }

    #[test]
    fn the_functions_are_those_of_the_library(log in -40.0..8.0_f64) {
        let t = log.exp2();
        prop_assert!((asinh(t) / t.asinh() - 1.0).abs() < 4e-12);
        prop_assert!((sinh(t) / t.sinh() - 1.0).abs() < 4e-12);
    }

    #[test]
    fn it_is_odd_and_monotone(a in value(), b in value(), step in 1..1000_u32) {
        let map = Map::Log { scale: 0.3 };
        prop_assert_eq!(map.forward(-a).to_bits(), (-map.forward(a)).to_bits());
        prop_assert!(a > b || map.forward(a) <= map.forward(b));
        // Also between neighbours, and where the series takes over.
        for start in [a.abs(), 0.3 * SMALL as f32] {
            let next = f32::from_bits(start.to_bits() + step);
            prop_assert!(map.forward(start) <= map.forward(next));
            prop_assert!(map.inverse(start.min(50.0)) <= map.inverse(next.min(50.0)));
        }
    }

    #[test]
    fn a_factor_does_not_change_the_decision_below_white(
        values in prop::collection::vec(value(), 1..40), exponent in 0..30_i32,
    ) {
        let largest = values.iter().fold(0.0, |largest: f32, v| largest.max(v.abs()));
        // Powers of two multiply without rounding.
        let below = (-largest.log2().ceil()).exp2();
        let times = |factor: f32| auto(&values.iter().map(|v| v * factor).collect::<Vec<_>>());
        prop_assert_eq!(times(below).is_linear(), times(below * (-exponent as f32).exp2()).is_linear());
    }
}

#[test]
fn threads_change_no_bit() {
    let size = Size::new(300, 111);
    let mask = Mask::from_fn(size, |y, x| (y * x) % 3 == 1);
    let plane = Plane::from_fn(size, |y, x| ((y * 131 + x * 17) % 1009) as f32 / 3.0 + 0.01);
    let with =
        |threads| testing::with_threads(threads, || Domain::Log.map(&mask, std::slice::from_ref(&plane)));
    let one = with(1);
    assert!(!one.is_linear());
    assert_eq!(one, with(2));
    assert_eq!(one, with(5));
}
