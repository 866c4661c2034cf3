//! The methods as a whole.

use proptest::prelude::*;

use super::*;
use crate::baseline::testing;
use crate::variational::tv;

const ALL: Question<'static> =
    Question { mask: None, range: (f32::NEG_INFINITY, f32::INFINITY), limit: false, map: Map::Linear };
/// As for light.
const LIGHT: Question<'static> = Question { range: (0.0, f32::INFINITY), limit: true, ..ALL };

fn geometry(low: Size, high: Size, sampling: Sampling) -> Geometry {
    let vertical = Axis::whole(low.height, high.height);
    Geometry { vertical, horizontal: Axis::whole(low.width, high.width), sampling }
}

fn sizes() -> [(Size, Size); 6] {
    [
        (Size::new(1, 1), Size::new(2, 2)),
        (Size::new(1, 9), Size::new(3, 18)),
        (Size::new(8, 1), Size::new(12, 1)),
        (Size::new(7, 10), Size::new(14, 30)),
        (Size::new(12, 21), Size::new(18, 32)),
        (Size::new(33, 40), Size::new(66, 80)),
    ]
}

const MODELS: [Sampling; 5] =
    [Sampling::Point, Sampling::Grid, Sampling::Box, Sampling::Gaussian(1.0), Sampling::Mitchell];

/// Smooth with a hard edge and a black half.
fn scene(size: Size) -> Plane {
    Plane::from_fn(size, |y, x| {
        let (v, u) = (y as f32 / size.height as f32, x as f32 / size.width as f32);
        if u + 0.3 * v > 0.6 { 0.0 } else { 0.4 + 0.3 * (7.0 * u).sin() * (5.0 * v).cos() }
    })
}

fn off(plan: &Plan, x: &Plane, y: &Plane) -> f64 {
    let back = plan.model.reduce(x);
    let pairs = back.pixels().iter().zip(y.pixels());
    let worst = pairs.map(|(a, b)| f64::from((a - b).abs())).fold(0.0, f64::max);
    worst / y.pixels().iter().map(|v| f64::from(v.abs())).fold(0.0, f64::max)
}

#[test]
fn the_fast_path_is_the_slow_one() {
    for (low, high) in sizes() {
        for sampling in MODELS {
            let geometry = geometry(low, high, sampling);
            let Ok(plan) = Plan::new(geometry, Method::Ss) else { continue };
            let y = Plane::from_fn(low, |i, j| ((i * 31 + j * 17) % 13) as f32 / 13.0);
            let fast = plan.spline(&y);
            // Line by line, in f64.
            let line = |axis: &Axis, line: &[f64]| {
                axis.spline(sampling).apply(&axis.prefilter(sampling).apply(line))
            };
            let rows: Vec<Vec<f64>> = (0..low.height)
                .map(|i| {
                    line(&geometry.horizontal, &y.row(i).iter().map(|v| f64::from(*v)).collect::<Vec<_>>())
                })
                .collect();
            for x in 0..high.width {
                let column: Vec<f64> = rows.iter().map(|row| row[x]).collect();
                for (i, value) in line(&geometry.vertical, &column).into_iter().enumerate() {
                    let error = (f64::from(fast.at(i, x)) - value).abs();
                    assert!(error < 64.0 * f64::from(f32::EPSILON), "{sampling} {low} {error}");
                }
            }
        }
    }
}

#[test]
fn reduced_again_it_is_the_input_within_bounds_too() {
    for (low, high) in sizes() {
        // Points are those of the continuous spline.
        for sampling in MODELS.into_iter().filter(|model| *model != Sampling::Point) {
            let Ok(plan) = Plan::new(geometry(low, high, sampling), Method::Ss) else { continue };
            // Pixels that such a footprint can have made: those of an image without negative light.
            let y = plan.model.reduce(&scene(high));
            let lowest = y.pixels().iter().copied().fold(f32::INFINITY, f32::min);
            for question in [ALL, Question { range: (0.0, f32::INFINITY), ..LIGHT }] {
                let done = plan.enlarge(&y, &question, &Run::default()).unwrap();
                if plan.is_continuous() {
                    // Pixels are shared, and the means are the spline's: the light in all stays.
                    let mean = |plane: &Plane| {
                        plane.pixels().iter().map(|v| f64::from(*v)).sum::<f64>()
                            / plane.size().pixels() as f64
                    };
                    let (given, got) = (mean(&y), mean(&done.plane));
                    let is_box = sampling == Sampling::Box;
                    let most = if question.limit || !is_box { 2e-2 } else { 1e-5 };
                    assert!((given - got).abs() < most * given, "{sampling} {low} {given} {got}");
                    // What bounds take beside the edge.
                    let off = off(&plan, &done.plane, &y);
                    assert!(is_box || off < 3e-2, "{sampling} {low} {off}");
                    assert!(!question.limit || done.plane.pixels().iter().all(|value| *value >= 0.0));
                    continue;
                }
                // These footprints overlap and change their sign: where bounds cut into them the dual creeps.
                let creeps = sampling == Sampling::Mitchell && question.limit;
                let off = off(&plan, &done.plane, &y);
                let most = match sampling {
                    Sampling::Mitchell if creeps => 1e-3,
                    _ => 2e-5,
                };
                assert!(off < most, "{sampling} {low} {off}");
                assert!(creeps || done.outcome.stop == crate::Stop::Converged, "{sampling} {low}");
                if let Some(told) = done.outcome.off_input {
                    assert!((off - told).abs() < 1e-6, "{sampling} {low} {off} {told}");
                }
                if lowest >= 0.0 && question.limit {
                    assert!(done.plane.pixels().iter().all(|value| *value >= 0.0), "{sampling} {low}");
                }
            }
        }
    }
}

/// At odd factors a pixel of the result stands at each sample.
#[test]
fn the_spline_of_points_runs_through_them() {
    let low = Size::new(23, 31);
    let y = scene(low);
    for factor in [3, 5] {
        let high = Size::new(factor * low.height, factor * low.width);
        let plan = Plan::new(geometry(low, high, Sampling::Point), Method::Ss).unwrap();
        let done = plan.enlarge(&y, &LIGHT, &Run::default()).unwrap();
        assert!(done.limited.values > 0 && done.outcome == Outcome::direct());
        for i in 0..low.height {
            for j in 0..low.width {
                let at = done.plane.at(factor * i + factor / 2, factor * j + factor / 2);
                assert!((at - y.at(i, j)).abs() < 1e-6, "{factor} {i} {j}");
            }
        }
        assert!(done.plane.pixels().iter().all(|value| *value >= 0.0));
    }
}

/// Pixels that no footprint of such a sign can have made, beside hard edges: what is made of them stays near the samples.
#[test]
fn hard_edges_of_a_wrong_model_stay_calm() {
    let low = Size::new(40, 40);
    let y = Plane::from_fn(low, |i, j| {
        if (i as f32 - 12.0).hypot(j as f32 - 12.0) < 8.0 || (i + j == 60) { 1.0 } else { 0.0 }
    });
    for sampling in [Sampling::Point, Sampling::Gaussian(1.0), Sampling::Mitchell] {
        for factor in [1.1, 1.25, 1.5, 2.0] {
            let plan = Plan::new(Geometry::scaled(low, factor, sampling), Method::Ss).unwrap();
            let done = plan.enlarge(&y, &LIGHT, &Run::default()).unwrap();
            let greatest = done.plane.pixels().iter().copied().fold(0.0, f32::max);
            // A multiplier moves its mean by twice the largest value at most; without a limit there are tens.
            assert!(greatest < 5.0, "{sampling} {factor} {greatest}");
        }
    }
}

#[test]
fn a_highlight_keeps_its_energy_and_rings_into_nothing_darker() {
    let low = Size::new(16, 16);
    let y = Plane::from_fn(low, |i, j| if i == 8 && j == 7 { 1000.0 } else { 0.1 });
    for factor in [2, 3] {
        let high = Size::new(16 * factor, 16 * factor);
        let plan = Plan::new(geometry(low, high, Sampling::Box), Method::Ss).unwrap();
        let done = plan.enlarge(&y, &LIGHT, &Run::default()).unwrap();
        assert!(done.limited.values > 0 && done.limited.most > 0.0);
        for (i, row) in (0..high.height).map(|i| (i, done.plane.row(i))) {
            for (j, value) in row.iter().enumerate() {
                let light = i / factor == 8 && j / factor == 7;
                assert!(*value >= 0.05 - 1e-6 && (light || *value < 0.6), "{i} {j} {value}");
            }
        }
        // Each mean to its own rounding, the dark ones beside the highlight too.
        let back = plan.model.reduce(&done.plane);
        for (a, b) in back.pixels().iter().zip(y.pixels()) {
            assert!((a - b).abs() <= 1e-5 * b, "{a} {b}");
        }
    }
}

#[test]
fn a_grid_keeps_its_samples_bits_at_their_places() {
    let (low, high) = (Size::new(9, 14), Size::new(27, 28));
    let plan = Plan::new(geometry(low, high, Sampling::Grid), Method::Ss).unwrap();
    let y = scene(low);
    let x = plan.enlarge(&y, &LIGHT, &Run::default()).unwrap().plane;
    for i in 0..low.height {
        for j in 0..low.width {
            assert_eq!(x.at(3 * i, 2 * j).to_bits(), y.at(i, j).to_bits());
        }
    }
}

#[test]
fn ramps_and_constants_stay_what_they_are() {
    let low = Size::new(12, 20);
    let cases = [
        (Size::new(24, 60), Sampling::Box, Method::Ss),
        (Size::new(24, 60), Sampling::Gaussian(1.0), Method::Ss),
        (Size::new(24, 60), Sampling::Mitchell, Method::Ss),
        (Size::new(18, 50), Sampling::Point, Method::Ss),
        (Size::new(18, 50), Sampling::Box, Method::Ss),
        (Size::new(14, 27), Sampling::Box, Method::Ss),
        (Size::new(18, 50), Sampling::Box, Method::Plain(plain::Kernel::Linear)),
    ];
    for (high, sampling, method) in cases {
        let plan = Plan::new(geometry(low, high, sampling), method).unwrap();
        let value = |y: f64, x: f64| (1.0 + 0.02 * y + 0.01 * x) as f32;
        let y = Plane::from_fn(low, |i, j| value(i as f64 + 0.5, j as f64 + 0.5));
        let x = plan.enlarge(&y, &LIGHT, &Run::default()).unwrap().plane;
        // A plain filter repeats the border.
        let edge = if method == Method::Ss { 0 } else { 3 };
        let (tall, wide) = (high.height as f64 / 12.0, high.width as f64 / 20.0);
        for i in edge..high.height - edge {
            for j in edge..high.width - edge {
                let expected = value((i as f64 + 0.5) / tall, (j as f64 + 0.5) / wide);
                let error = (x.at(i, j) - expected).abs();
                assert!(error < 2e-6, "{sampling} {method:?} {i} {j} {error}");
            }
        }
        let flat = plan.enlarge(&Plane::filled(low, 0.7), &LIGHT, &Run::default()).unwrap().plane;
        assert!(flat.pixels().iter().all(|v| (v - 0.7).abs() < 1e-6));
    }
}

#[test]
fn plain_filters_are_placed_like_the_others() {
    let low = Size::new(20, 20);
    let shifted = Axis { inputs: 20, outputs: 31, scale: 62.0 / 41.0, shift: 7.0 - 5.0 * 62.0 / 41.0 };
    let geometry = Geometry { vertical: shifted, horizontal: shifted, sampling: Sampling::Point };
    let y = Plane::from_fn(low, |i, j| ((i as f32 * 0.2).sin() + (j as f32 * 0.15).cos()) * 0.3 + 1.0);
    let of = |method| Plan::new(geometry, method).unwrap().enlarge(&y, &ALL, &Run::default()).unwrap().plane;
    let spline = of(Method::Ss);
    for kernel in [plain::Kernel::Lanczos3, plain::Kernel::Cubic, plain::Kernel::Linear] {
        let plain = of(Method::Plain(kernel));
        for i in 6..25 {
            for j in 6..25 {
                assert!((plain.at(i, j) - spline.at(i, j)).abs() < 6e-3, "{kernel:?} {i} {j}");
            }
        }
    }
}

fn total_variation(x: &Plane) -> f64 {
    let size = x.size();
    let at = |y: usize, c: usize| f64::from(x.at(y.min(size.height - 1), c.min(size.width - 1)));
    let length = |y, c| (at(y + 1, c) - at(y, c)).hypot(at(y, c + 1) - at(y, c));
    (0..size.height).flat_map(|y| (0..size.width).map(move |c| (y, c))).map(|(y, c)| length(y, c)).sum()
}

#[test]
fn total_variation_is_shorter_than_the_spline_and_keeps_the_means() {
    let settings = tv::Settings::default();
    for (low, high) in sizes() {
        for sampling in [Sampling::Box, Sampling::Grid, Sampling::Gaussian(1.0)] {
            let geometry = geometry(low, high, sampling);
            let Ok(plan) = Plan::new(geometry, Method::Tv(settings)) else { continue };
            let y = plan.model.reduce(&scene(high));
            let tv = plan.enlarge(&y, &ALL, &Run::default()).unwrap();
            let ss = Plan::new(geometry, Method::Ss).unwrap().enlarge(&y, &ALL, &Run::default()).unwrap();
            assert!(off(&plan, &tv.plane, &y) < 2e-5, "{sampling} {low} {}", off(&plan, &tv.plane, &y));
            if plan.is_continuous() {
                // The spline is another problem's solution there.
                continue;
            }
            let (short, long) = (total_variation(&tv.plane), total_variation(&ss.plane));
            assert!(short <= long * 1.001, "{sampling} {low} {short} {long}");
            if low.pixels() > 1000 {
                assert!(short < 0.98 * long, "{sampling} {low} {short} {long}");
            }
        }
    }
}

#[test]
fn the_gap_bounds_the_distance_from_the_least_variation() {
    let (low, high) = (Size::new(12, 14), Size::new(24, 28));
    let mut settings = tv::Settings::default();
    let geometry = geometry(low, high, Sampling::Box);
    let y = Plan::new(geometry, Method::Ss).unwrap().model.reduce(&scene(high));
    let mut of = |sweeps: usize, gap: f64| {
        settings.max_iterations = sweeps;
        settings.gap = gap;
        let plan = Plan::new(geometry, Method::Tv(settings)).unwrap();
        let done = plan.enlarge(&y, &ALL, &Run::default()).unwrap();
        (total_variation(&done.plane), done.outcome)
    };
    let (short, _) = of(20, 1e-9);
    let (least, outcome) = of(4000, 1e-3);
    let gap = outcome.gap.unwrap();
    assert!(gap > 0.0 && short >= least * (1.0 - gap), "{short} {least} {gap}");
}

/// Flat regions are where a bound is slow to come near, and one sweep is no reason to stop.
#[test]
fn total_variation_stops_at_its_gap_and_nowhere_else() {
    let high = Size::new(120, 144);
    for factor in [2, 3] {
        let low = Size::new(high.height / factor, high.width / factor);
        let matte = Plane::from_fn(high, |y, x| {
            let radius = (y as f32 - 50.0).hypot(x as f32 - 60.0);
            if radius < 33.0 { 0.9 } else { 0.0 }
        });
        let geometry = geometry(low, high, Sampling::Box);
        let of = |gap: f64, max_iterations: usize| {
            let settings = tv::Settings { gap, max_iterations, ..tv::Settings::default() };
            let plan = Plan::new(geometry, Method::Tv(settings)).unwrap();
            let y = plan.model.reduce(&matte);
            let done = plan.enlarge(&y, &LIGHT, &Run::default()).unwrap();
            (total_variation(&done.plane), done.outcome)
        };
        let (long, coarse) = of(1e-2, 2000);
        let (short, fine) = of(1e-3, 2000);
        for (gap, outcome) in [(1e-2, coarse), (1e-3, fine)] {
            assert!(outcome.stop == crate::Stop::Converged && outcome.gap.unwrap() <= gap, "{outcome:?}");
        }
        assert!(fine.iterations > coarse.iterations && short >= long * (1.0 - 1e-2), "{short} {long}");
        let (_, one) = of(1e-2, 1);
        assert!(one.stop == crate::Stop::IterationLimit && one.iterations == 1, "{one:?}");
        assert!(one.gap.unwrap() > 1e-2);
    }
}

#[test]
fn missing_pixels_do_not_bind_total_variation() {
    let (low, high) = (Size::new(20, 24), Size::new(30, 48));
    let plan = Plan::new(geometry(low, high, Sampling::Box), Method::Tv(tv::Settings::default())).unwrap();
    let y = plan.model.reduce(&scene(high));
    let mask = crate::sampling::shuffle::mask(0, 0, low, 0.5, 1).unwrap();
    // A guess that is far off must not show.
    let given = Plane::from_fn(low, |i, j| if mask.is_measured(i, j) { y.at(i, j) } else { 0.3 });
    let question = Question { mask: Some(&mask), ..ALL };
    let x = plan.enlarge(&given, &question, &Run::default()).unwrap().plane;
    let back = plan.model.reduce(&x);
    let mut moved = 0;
    for (at, flag) in mask.as_slice().iter().enumerate() {
        let error = (back.pixels()[at] - given.pixels()[at]).abs();
        assert!(!flag || error < 1e-4, "{at} {error}");
        moved += usize::from(!flag && error > 0.05);
    }
    assert!(moved > 20, "{moved}");
}

#[test]
fn threads_change_nothing() {
    let (low, high) = (Size::new(40, 37), Size::new(60, 74));
    for method in [Method::Ss, Method::Tv(tv::Settings::default())] {
        let plan = Plan::new(geometry(low, high, Sampling::Box), method).unwrap();
        let y = plan.model.reduce(&scene(high));
        let with = |threads: usize| {
            let ask = || plan.enlarge(&y, &LIGHT, &Run::default()).unwrap();
            testing::with_threads(threads, ask)
        };
        assert_eq!(with(1), with(3));
    }
}

#[test]
fn sizes_and_values_are_checked() {
    let plan = Plan::new(geometry(Size::new(4, 4), Size::new(8, 8), Sampling::Box), Method::Ss).unwrap();
    let other = plan.enlarge(&Plane::filled(Size::new(4, 5), 0.0), &ALL, &Run::default());
    assert!(matches!(other, Err(Error::SizeMismatch { .. })));
    let nan = plan.enlarge(&Plane::filled(Size::new(4, 4), f32::NAN), &ALL, &Run::default());
    assert_eq!(nan, Err(Error::NotFinite { row: 0, column: 0 }));
    let lamp = |size| Plane::from_fn(size, |y, x| if y + x == 0 { 50.0 } else { 0.1 });
    let highlights = |size| {
        Highlights::of(&crate::Planes::of(size, vec![lamp(size)]), crate::domain::Map::Linear).unwrap()
    };
    let with = |hint: Hint<'_>| {
        plan.enlarge_with(&lamp(Size::new(4, 4)), hint, &ALL, &Run::default()).map(|large| large.plane.size())
    };
    assert_eq!(with(Hint::Highlights(&highlights(Size::new(4, 4)))), Ok(Size::new(8, 8)));
    for size in [(4, 3), (3, 4), (8, 8)] {
        let other = with(Hint::Highlights(&highlights(Size::new(size.0, size.1))));
        assert!(matches!(other, Err(Error::SizeMismatch { .. })));
    }
    let other = with(Hint::Guides(&lamp(Size::new(4, 4))));
    assert!(matches!(other, Err(Error::SizeMismatch { .. })));
}

/// Boxes that share pixels ask for light and for none in the same place beside a hard edge. What is made of them stays calm.
#[test]
fn hard_edges_at_broken_factors_stay_calm() {
    let (low, high) = (Size::new(40, 40), Size::new(50, 50));
    let y = Plane::from_fn(low, |i, j| {
        if (i as f32 - 12.0).hypot(j as f32 - 12.0) < 8.0 || (i + j == 60) { 1.0 } else { 0.0 }
    });
    let plan = Plan::new(geometry(low, high, Sampling::Box), Method::Ss).unwrap();
    let done = plan.enlarge(&y, &LIGHT, &Run::default()).unwrap();
    assert!(done.outcome.iterations < 400, "{:?}", done.outcome);
    let light = |plane: &Plane| plane.pixels().iter().map(|v| f64::from(*v)).sum::<f64>();
    let (given, got) = (light(&y) * 1.25 * 1.25, light(&done.plane));
    assert!((given - got).abs() < 0.02 * given, "{given} {got}");
    for (at, value) in done.plane.pixels().iter().enumerate() {
        assert!((0.0..1.6).contains(value), "{at} {value}");
        let inside = ((at / 50) as f32 * 0.8 - 12.0).hypot((at % 50) as f32 * 0.8 - 12.0) < 5.5;
        assert!(!inside || (value - 1.0).abs() < 0.2, "{at} {value}");
    }
}

#[test]
fn means_beside_the_range_by_a_rounding_are_taken_into_it() {
    let (low, high) = (Size::new(4, 6), Size::new(8, 12));
    let y = Plane::from_fn(low, |i, j| if (i + j) % 3 == 0 { 1.0 } else { -2e-6 });
    let plan = Plan::new(geometry(low, high, Sampling::Box), Method::Ss).unwrap();
    let large = plan.enlarge(&y, &LIGHT, &Run::default()).unwrap().plane;
    assert!(large.pixels().iter().all(|value| (0.0..f32::INFINITY).contains(value)));
}

#[test]
fn a_geometry_out_of_range_has_sources_and_is_refused() {
    for axis in
        [Axis { inputs: 2, outputs: 4, scale: f64::NAN, shift: 0.0 }, Axis::whole(0, 4), Axis::whole(4, 0)]
    {
        let geometry = Geometry { vertical: axis, horizontal: axis, sampling: Sampling::Box };
        assert_eq!(geometry.sources().len(), geometry.high().pixels());
        assert!(geometry.check().is_err());
    }
}

#[test]
fn whoever_wants_the_end_gets_it_soon_and_is_told() {
    use std::sync::atomic::{AtomicUsize, Ordering};
    let samples = scene(Size::new(33, 40));
    let models = [Sampling::Box, Sampling::Grid, Sampling::Point, Sampling::Gaussian(1.0)];
    for (sampling, factor) in models.into_iter().map(|model| (model, 2.0)).chain([(Sampling::Box, 1.5)]) {
        for method in [Method::Ss, Method::Tv(tv::Settings { gap: 1e-12, ..tv::Settings::default() })] {
            let plan = Plan::new(Geometry::scaled(samples.size(), factor, sampling), method).unwrap();
            for patience in [0, 1] {
                let asked = AtomicUsize::new(0);
                let stop = || (asked.fetch_add(1, Ordering::Relaxed) >= patience).then_some(Stop::Cancelled);
                let run = Run { interrupt: Some(&stop) };
                let large = plan.enlarge(&samples, &LIGHT, &run).unwrap();
                assert_eq!(large.outcome.stop, Stop::Cancelled, "{sampling} {factor} {method:?} {patience}");
                assert_eq!(large.outcome.iterations, 0);
                assert!(large.plane.pixels().iter().all(|value| value.is_finite() && *value >= 0.0));
            }
        }
    }
}

/// Of narrow Gaussians some share no pixel, and have cells of several sizes.
fn any_model() -> impl Strategy<Value = Sampling> {
    prop_oneof![
        2 => (0.5..0.6).prop_map(Sampling::Gaussian),
        1 => (0.6..=1.5).prop_map(Sampling::Gaussian),
        1 => Just(Sampling::Box),
        1 => Just(Sampling::Point),
        1 => Just(Sampling::Mitchell),
    ]
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(192))]

    #[test]
    fn any_factor_and_any_model_give_finite_images_and_cells_their_means(
        height in 1..12_usize, width in 1..12_usize, factor in 1.0..2.5_f64, sampling in any_model(),
        first in -0.99..=0.0_f64,
    ) {
        let samples = scene(Size::new(height, width));
        let mut geometry = Geometry::scaled(samples.size(), factor, sampling);
        for shift in [0.0, first] {
            // As far as the last given pixel reaches.
            let Axis { inputs, scale, .. } = geometry.vertical;
            let outputs = (inputs as f64 * scale - shift - 1e-9).ceil() as usize;
            geometry.vertical = Axis { inputs, outputs, scale, shift };
            for method in [Method::Ss, Method::Tv(tv::Settings { max_iterations: 20, ..tv::Settings::default() })] {
                let plan = Plan::new(geometry, method).unwrap();
                let large = plan.enlarge(&samples, &LIGHT, &Run::default()).unwrap();
                prop_assert_eq!(large.plane.size(), geometry.high());
                prop_assert!(large.plane.pixels().iter().all(|value| value.is_finite()));
                prop_assert!(plan.cells.is_none() || off(&plan, &large.plane, &samples) < 1e-5);
            }
        }
    }
}
