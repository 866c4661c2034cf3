use super::*;
use crate::baseline::testing;
use crate::domain::Domain;
use crate::enlarge::{self, Options};
use crate::operator::taps::Taps;
use crate::upscale::{Geometry, Hint, Method, Question};
use crate::{Run, Size};

const LIGHT: Question<'static> =
    Question { mask: None, range: (0.0, f32::INFINITY), limit: true, map: Map::Linear };

/// A dim pattern with black in it, and a lamp of 22 unless it is put out.
fn scene(size: Size, lamp: bool) -> Plane {
    Plane::from_fn(size, |y, x| {
        let (v, u) = (y as f32, x as f32);
        if lamp && (v - 7.0).hypot(u - 9.0) < 1.8 {
            22.0
        } else if x > 24 && y < 6 {
            0.0
        } else {
            0.3 + 0.1 * (0.9 * u).sin() * (0.7 * v).cos()
        }
    })
}

fn plan(low: Size, factor: f64) -> Plan {
    Plan::new(Geometry::scaled(low, factor, Sampling::Box), Method::Ss).unwrap()
}

fn group(planes: Vec<Plane>) -> Planes {
    Planes::new(planes[0].size(), planes).unwrap()
}

/// Those of a group that no domain maps.
fn of(group: &Planes) -> Option<Highlights> {
    Highlights::of(group, Map::Linear)
}

fn wide(plane: &Plane) -> Vec<f64> {
    plane.pixels().iter().map(|value| f64::from(*value)).collect()
}

/// Rows, then columns.
fn both([vertical, horizontal]: &[Taps; 2], image: &[f64]) -> Vec<f64> {
    let rows: Vec<Vec<f64>> = image.chunks(horizontal.inputs()).map(|row| horizontal.apply(row)).collect();
    let columns: Vec<Vec<f64>> = (0..horizontal.outputs())
        .map(|x| vertical.apply(&rows.iter().map(|row| row[x]).collect::<Vec<_>>()))
        .collect();
    (0..vertical.outputs()).flat_map(|y| columns.iter().map(move |column| column[y])).collect()
}

/// The greatest and the least of 5 x 5 pixels, one by one.
fn extremes(image: &[f64], size: Size) -> Vec<(f64, f64)> {
    let around = |y: usize, x: usize| {
        let rows = y.saturating_sub(2)..size.height.min(y + 3);
        let pixels = rows.flat_map(|row| {
            (x.saturating_sub(2)..size.width.min(x + 3)).map(move |column| image[row * size.width + column])
        });
        pixels.fold((f64::MIN, f64::MAX), |(most, least), v| (most.max(v), least.min(v)))
    };
    (0..size.height).flat_map(|y| (0..size.width).map(move |x| (y, x))).map(|(y, x)| around(y, x)).collect()
}

/// The power mean of light.
fn mean(light: &[f64]) -> f64 {
    let lit: Vec<f64> = light.iter().copied().filter(|value| *value > 0.0).collect();
    (lit.iter().map(|value| value.powf(0.25)).sum::<f64>() / lit.len() as f64).powi(4)
}

/// The small pixels that each large one overlaps, along an axis.
fn overlaps(axis: &Axis, sampling: Sampling) -> Vec<Vec<usize>> {
    let factor = axis.outputs as f64 / axis.inputs as f64;
    let is_in = |at: usize, small: usize| {
        let (from, to) = (at as f64 / factor, (at + 1) as f64 / factor);
        to.min(small as f64 + 1.0) - from.max(small as f64) > 1e-6
    };
    let pixels = |at: usize| match sampling {
        Sampling::Grid => vec![axis.source(sampling, at)],
        _ => (0..axis.inputs).filter(|small| is_in(at, *small)).collect(),
    };
    (0..axis.outputs).map(pixels).collect()
}

/// `E y` by its formula.
fn exposed(plan: &Plan, samples: &Plane, light: &[f64]) -> Vec<f64> {
    let Geometry { vertical, horizontal, sampling } = plan.geometry;
    let axes = [vertical, horizontal];
    let prefilter = axes.map(|axis| axis.prefilter(sampling));
    let onto = axes.map(|axis| axis.spline(sampling));
    let (y, limit) = (wide(samples), 3.0 * mean(light));
    let h: Vec<f64> = light.iter().map(|l| (l / limit).log2().clamp(0.0, 1.0)).collect();
    let spline = |factor: &dyn Fn(usize) -> f64| {
        let image: Vec<f64> = y.iter().enumerate().map(|(i, value)| factor(i) * value).collect();
        both(&onto, &both(&prefilter, &image))
    };
    let [all, own, others] =
        [spline(&|_| 1.0), spline(&|i| h[i]), spline(&|i| if h[i] > 0.0 { h[i] / light[i] } else { 0.0 })];
    let [down, across] = axes.map(|axis| overlaps(&axis, sampling));
    let width = horizontal.inputs;
    let least = |(rows, columns): (&Vec<usize>, &Vec<usize>)| {
        let pixels = rows.iter().flat_map(|y| columns.iter().map(move |x| y * width + x));
        pixels.map(|at| 1.0 - h[at]).fold(1.0, f64::min)
    };
    let shares = down.iter().flat_map(|rows| across.iter().map(move |columns| (rows, columns))).map(least);
    let parts = plan.geometry.sources().into_iter().map(|at| light[at as usize]).zip(shares);
    let parts = parts.zip(all.iter().zip(own.iter().zip(&others)));
    parts.map(|((l, share), (all, (own, others)))| all - share * own + share * l * others).collect()
}

/// `w` by its formula.
fn share(group: &[Vec<f64>], size: Size) -> Vec<f64> {
    let light: Vec<f64> =
        (0..size.pixels()).map(|i| group.iter().map(|c| c[i]).sum::<f64>() / group.len() as f64).collect();
    let mean = mean(&light);
    let octaves = |quotient: f64| quotient.log2().clamp(0.0, 1.0);
    let pairs = light.iter().zip(extremes(&light, size));
    let one = |(l, (a, b)): (&f64, (f64, f64))| {
        let (l, b) = (l.max(a / 1024.0), b.max(a / 1024.0));
        if a > 0.0 {
            let near = octaves(a / (3.0 * b)) * octaves(a / (2.0 * l)) * octaves(a / (3.0 * mean));
            near * (1.0 - octaves(a / (64.0 * l)))
        } else {
            0.0
        }
    };
    pairs.map(one).collect()
}

/// The blend by its formula.
fn reference(plan: &Plan, samples: &Plane, plane: &Plane, share: &[f64], means: &Plane) -> Vec<f64> {
    let axes = [plan.geometry.vertical, plan.geometry.horizontal];
    let lines = axes.map(|axis| bilinear(&axis, Sampling::Box));
    let reduce = axes.map(|axis| axis.reduce(Sampling::Box));
    let through = axes.map(|axis| Axis::whole(axis.inputs, axis.inputs).prefilter(Sampling::Point));
    let onto = axes.map(|axis| axis.spline(Sampling::Point));
    let y = wide(samples);
    let black = 1e-9 * y.iter().copied().fold(0.0, f64::max);
    let floors = extremes(&y, samples.size());
    let logs: Vec<f64> = y.iter().zip(floors).map(|(y, (a, _))| y.max(a / 1024.0).max(black).ln()).collect();
    let mut m: Vec<f64> = both(&onto, &both(&through, &logs)).into_iter().map(f64::exp).collect();
    for _ in 0..3 {
        let seen = both(&reduce, &m);
        let factors: Vec<f64> =
            wide(means).iter().zip(seen).map(|(mean, seen)| mean.max(0.0) / seen).collect();
        m.iter_mut().zip(both(&lines, &factors)).for_each(|(m, factor)| *m *= factor);
    }
    let share = both(&lines, share);
    wide(plane).iter().zip(m.iter().zip(share)).map(|(x, (m, w))| x + w * (m - x)).collect()
}

#[test]
fn the_fast_path_is_the_slow_one() {
    for (low, factor) in [((16, 31), 2.0), ((21, 27), 1.4), ((1, 12), 3.0), ((14, 1), 2.0)] {
        let low = Size::new(low.0, low.1);
        let mut samples = scene(low, true);
        let at = low.pixels() / 2;
        samples.pixels_mut()[at] = 22.0;
        let dim = Plane::from_fn(low, |y, x| 0.5 * samples.at(y, x) + 0.01);
        let planes = group(vec![samples.clone(), dim]);
        let fast = of(&planes).unwrap().dark;
        let slow = share(&planes.as_slice().iter().map(wide).collect::<Vec<_>>(), low);
        for (fast, slow) in fast.pixels().iter().zip(&slow) {
            assert!((f64::from(*fast) - slow).abs() < 1e-5, "{low} {fast} {slow}");
        }
        let plan = plan(low, factor);
        let spline = plan.spline(&samples);
        let means = plan.model.reduce(&spline);
        let mut plane = spline.clone();
        soften(&plan, &fast, (&samples, &means), &spline, &mut plane);
        let expected = reference(&plan, &samples, &spline, &wide(&fast), &means);
        for (fast, slow) in plane.pixels().iter().zip(&expected) {
            // The exponent of an f32 logarithm of up to 20 has 20 roundings of an f32 as its relative error, the means add theirs.
            assert!((f64::from(*fast) - slow).abs() < 2e-5 * slow.abs().max(1.0), "{low} {fast} {slow}");
        }
    }
}

#[test]
fn means_stay_and_nothing_becomes_negative() {
    for (low, factor) in [((16, 31), 2.0), ((20, 33), 3.0), ((19, 30), 1.25), ((19, 30), 2.5)] {
        let low = Size::new(low.0, low.1);
        let (plan, samples) = (plan(low, factor), scene(low, true));
        let highlights = of(&group(vec![samples.clone()])).unwrap();
        let [plain, done] = [Hint::None, Hint::Highlights(&highlights)]
            .map(|hint| plan.enlarge_with(&samples, hint, &LIGHT, &Run::default()).unwrap().plane);
        assert!(plain != done && done.pixels().iter().all(|value| *value >= 0.0));
        let back = plan.model.reduce(&done);
        if plan.cells.is_some() {
            for (back, sample) in back.pixels().iter().zip(samples.pixels()) {
                assert!((back - sample).abs() <= 2e-6 * sample, "{factor} {back} {sample}");
            }
        } else {
            // Straddling pixels: about the light in all stays that does without. At some factors more has to be given back beside lamps, of which
            // clamping takes more.
            let sum = |plane: &Plane| wide(plane).iter().sum::<f64>();
            let asked = sum(&plan.model.reduce(&plan.spline(&samples)));
            let [plain, done] =
                [&plan.model.reduce(&plain), &back].map(|plane| (sum(plane) / asked - 1.0).abs());
            assert!(done < 1.25 * plain.max(5e-3), "{factor} {plain} {done}");
        }
    }
}

#[test]
fn what_sees_highlights_is_what_the_formula_says() {
    for (low, factor, sampling) in [
        ((16, 31), 2.0, Sampling::Box),
        ((21, 27), 3.0, Sampling::Point),
        ((13, 1), 2.0, Sampling::Grid),
        ((1, 1), 2.0, Sampling::Box),
        ((21, 27), 1.4, Sampling::Box),
        ((16, 30), 2.5, Sampling::Box),
        ((16, 30), 2.5, Sampling::Point),
    ] {
        let low = Size::new(low.0, low.1);
        let mut samples = scene(low, true);
        let at = low.pixels() / 2;
        samples.pixels_mut()[at] = 1.7;
        let plan = Plan::new(Geometry::scaled(low, factor, sampling), Method::Ss).unwrap();
        let Some(highlights) = of(&group(vec![samples.clone()])) else {
            assert!(low.pixels() == 1);
            continue;
        };
        let mut fast = plan.spline(&samples);
        highlights.expose(&plan, &samples, &mut fast);
        for (fast, slow) in fast.pixels().iter().zip(exposed(&plan, &samples, &wide(&samples))) {
            assert!((f64::from(*fast) - slow).abs() < 2e-5, "{low} {fast} {slow}");
        }
        if factor.fract() == 0.0 && (sampling != Sampling::Point || factor % 2.0 == 1.0) {
            let back = plan.model.reduce(&fast);
            let pairs = back.pixels().iter().zip(samples.pixels());
            assert!(pairs.into_iter().all(|(back, sample)| (back - sample).abs() < 2e-5), "{low}");
        }
    }
}

/// Lamps of 1000 in a room of about 0.1, and in front of black: what is dark stays what it is, however near, at whole factors and of points. At
/// broken ones most does.
#[test]
fn a_dark_room_keeps_its_light_around_lamps() {
    let lit = |y: f64, x: f64| 0.1 + 0.04 * (0.11 * x).cos() * (0.09 * y + 0.6).cos();
    let cases = [
        (2.0, Sampling::Box, 0.0),
        (3.0, Sampling::Box, 0.0),
        (2.5, Sampling::Box, 0.2),
        (2.0, Sampling::Point, 0.0),
        (3.0, Sampling::Point, 0.0),
        (1.5, Sampling::Point, 0.0),
    ];
    for (factor, sampling, allowed) in cases {
        let of = |room: &dyn Fn(f64, f64) -> f64| wrong_around_lamps(room, factor, sampling);
        for (name, wrong) in [("lit", of(&lit)), ("black", of(&|_, _| 0.0)), ("haze", of(&|_, _| 2e-4))] {
            assert!(wrong <= allowed, "{name} {sampling} {factor}: {wrong}");
        }
    }
}

/// The part of the large pixels beside lamps that is seen to be off the room.
fn wrong_around_lamps(room: &dyn Fn(f64, f64) -> f64, factor: f64, sampling: Sampling) -> f64 {
    let is_lamp = |y: usize, x: usize| {
        (y as f64 - 14.0).hypot(x as f64 - 15.0) < 4.0 || (y == 30 && x % 7 == 3) || (y == 40 && x < 20)
    };
    let low = Size::new(48, 50);
    let value = |y, x| if is_lamp(y, x) { 1000.0 } else { room(y as f64 + 0.5, x as f64 + 0.5) as f32 };
    let samples = Plane::from_fn(low, value);
    let options = Options::new(Geometry::scaled(low, factor, sampling));
    let large = enlarge::upscale(&group(vec![samples]), &options).unwrap();
    let (plane, size) = (&large.planes.as_slice()[0], options.geometry.high());
    let lines = [options.geometry.vertical, options.geometry.horizontal];
    let wrong = |at: &usize| {
        let places = [at / size.width, at % size.width];
        let [mut rows, columns] = [0, 1].map(|k| lines[k].touched(Sampling::Box, places[k]));
        let [y, x] = places.map(|place| (place as f64 + 0.5) / factor);
        let lit = rows.any(|y| columns.clone().any(|x| is_lamp(y, x)));
        // A display of 8 bits shows 3e-4 as black.
        !lit && (f64::from(plane.pixels()[*at]) - room(y, x)).abs() > (0.1 * room(y, x)).max(3e-4)
    };
    (0..size.pixels()).filter(wrong).count() as f64 / size.pixels() as f64
}

/// A haze, which is not black as a logarithm, makes no highlights of what is lit.
#[test]
fn highlights_of_logarithms_are_those_of_light() {
    let low = Size::new(24, 24);
    let samples = Plane::from_fn(low, |y, x| match (y, x) {
        (8, 8) => 1000.0,
        _ if x < 12 => 0.1,
        _ => 4e-4,
    });
    let planes = group(vec![samples.clone()]);
    let map = Domain::Auto.map(&Mask::full(low), planes.as_slice());
    assert!(!map.is_linear());
    let bright = Highlights::of(&planes, map).unwrap().bright;
    for (bright, sample) in bright.pixels().iter().zip(samples.pixels()) {
        assert_eq!(*bright, if *sample > 1.0 { 1.0 } else { 0.0 });
    }
}

/// What is held, and the means beside highlights, pixel by pixel at whole and at broken factors.
#[test]
fn what_is_held_and_means_are_what_they_say() {
    for factor in [2.0, 1.4, 2.5] {
        let low = Size::new(16, 30);
        let (plan, samples) = (plan(low, factor), scene(low, true));
        let highlights = of(&group(vec![samples.clone()])).unwrap();
        let h: Vec<f64> = wide(&samples).iter().map(|l| (l / (3.0 * mean(&wide(&samples)))).log2()).collect();
        let h: Vec<f64> = h.into_iter().map(|h| h.clamp(0.0, 1.0)).collect();
        let around = extremes(&h, low);
        let before = plan.spline(&samples);
        let mut fast = Plane::filled(before.size(), 0.25);
        highlights.hold(&plan, &before, &mut fast);
        let parts = plan.geometry.sources().into_iter().map(|at| at as usize).zip(wide(&before));
        for (fast, (at, before)) in wide(&fast).into_iter().zip(parts) {
            let slow = 0.25 + (1.0 - h[at]) * around[at].0 * (before - 0.25);
            assert!((fast - slow).abs() < 2e-5, "{factor} {fast} {slow}");
        }
        let (spline, exposed) = (Plane::filled(low, 1.0), Plane::filled(low, 2.0));
        let means = highlights.means(&spline, exposed);
        for (y, x) in (0..low.height).flat_map(|y| (0..low.width).map(move |x| (y, x))) {
            let mut rows = y.saturating_sub(1)..low.height.min(y + 2);
            let columns = x.saturating_sub(1)..low.width.min(x + 2);
            let beside = rows.any(|y| columns.clone().any(|x| h[y * low.width + x] > 0.0));
            assert_eq!(means.at(y, x), if beside { 1.0 } else { 2.0 }, "{y} {x}");
        }
    }
}

#[test]
fn without_highlights_no_bit_changes() {
    let low = Size::new(40, 48);
    assert!(of(&group(vec![scene(low, false)])).is_none());
    assert!(of(&group(vec![Plane::filled(low, 0.0)])).is_none());
    assert!(of(&group(vec![Plane::from_fn(low, |y, x| if y == x { -1.0 } else { 0.0 })])).is_none());
    // A haze that looks black makes no highlight of what is lit.
    let haze = |y: usize, x: usize| if x < 8 { 0.3 + 0.01 * (y as f32).sin() } else { 1e-5 };
    assert!(of(&group(vec![Plane::from_fn(low, haze)])).is_none());
    for factor in [2.0, 1.5] {
        let (plan, samples) = (plan(low, factor), scene(low, false));
        let plain = plan.enlarge(&samples, &LIGHT, &Run::default()).unwrap().plane;
        let options = Options::new(*plan.geometry());
        let whole = enlarge::upscale(&group(vec![samples]), &options).unwrap();
        assert_eq!(whole.planes.as_slice()[0], plain);
    }
}

#[test]
fn negative_light_counts_as_black() {
    let low = Size::new(40, 48);
    let samples = scene(low, true);
    let bright = |below: f32| {
        let value = |y, x| match (y, x) {
            (_, 5) => below,
            (30, 30) => 1.7,
            _ => samples.at(y, x),
        };
        of(&group(vec![Plane::from_fn(low, value)])).unwrap().bright
    };
    assert_eq!(bright(-50.0), bright(0.0));
}

#[test]
fn the_dark_around_a_lamp_is_nearer_to_its_light() {
    let low = Size::new(40, 48);
    let (plan, samples) = (plan(low, 2.0), scene(low, true));
    let highlights = of(&group(vec![samples.clone()])).unwrap();
    let [plain, done] = [Hint::None, Hint::Highlights(&highlights)]
        .map(|hint| plan.enlarge_with(&samples, hint, &LIGHT, &Run::default()).unwrap().plane);
    // The dark pixels around the lamp, whose light is known.
    let wrong = |plane: &Plane| {
        let dark = (6..26).flat_map(|y| (10..30).map(move |x| (y, x)));
        let dark = dark.filter(|&(y, x)| samples.at(y / 2, x / 2) < 1.0);
        dark.map(|(y, x)| (plane.at(y, x) - 0.3).powi(2)).sum::<f32>()
    };
    assert!(wrong(&done) < 0.6 * wrong(&plain), "{} {}", wrong(&done), wrong(&plain));
}

#[test]
fn channels_share_one_weight_and_other_data_has_none() {
    let low = Size::new(16, 31);
    let red = scene(low, true);
    let grey = Plane::from_fn(low, |y, x| 0.25 * red.at(y, x));
    let blue = scene(low, false);
    let mut options = Options::new(Geometry::scaled(low, 2.0, Sampling::Box));
    let large = |planes: Vec<Plane>, options: &Options<'_>| {
        enlarge::upscale(&group(planes), options).unwrap().planes.into_vec()
    };
    // What is in proportion stays so, and a channel without a lamp of its own is blended as the others are.
    let colours = large(vec![red.clone(), grey, blue.clone()], &options);
    let pairs = colours[0].pixels().iter().zip(colours[1].pixels());
    assert!(pairs.into_iter().all(|(red, grey)| (0.25 * red - grey).abs() < 1e-5 * red.max(1e-3)));
    assert!(colours[2] != large(vec![blue], &options)[0]);
    let light = large(vec![red.clone()], &options);
    options.fill.values = crate::fill::Values::Other;
    let [other] = &large(vec![red.clone()], &options)[..] else { panic!("one plane") };
    let plain = plan(low, 2.0).enlarge(&red, &LIGHT, &Run::default()).unwrap().plane;
    assert!(light[0] != plain && *other != light[0]);
}

#[test]
fn threads_and_the_unit_change_nothing() {
    let low = Size::new(61, 43);
    let enlarged = |samples: &Plane| {
        let plan = plan(low, 2.0);
        let highlights = of(&group(vec![samples.clone()])).unwrap();
        plan.enlarge_with(samples, Hint::Highlights(&highlights), &LIGHT, &Run::default()).unwrap().plane
    };
    let samples = scene(low, true);
    let one = testing::with_threads(1, || enlarged(&samples));
    assert_eq!(one, testing::with_threads(3, || enlarged(&samples)));
    let twice = Plane::from_fn(low, |y, x| 2.0 * samples.at(y, x));
    let pairs = enlarged(&twice).into_pixels().into_iter().zip(one.pixels().to_vec());
    assert!(pairs.into_iter().all(|(twice, one)| (0.5 * twice - one).abs() <= 2e-5 * one.max(1e-3)));
    // Values whose powers overflow are no panic, and no value that is none.
    let huge = Plane::from_fn(low, |y, x| if (y + x) % 9 == 0 { 1e38 } else { 1e-3 });
    let share = of(&group(vec![huge.clone()])).unwrap().dark;
    let mut plane = plan(low, 2.0).spline(&huge);
    plane.pixels_mut().iter_mut().filter(|v| !v.is_finite()).for_each(|v| *v = 0.0);
    let means = huge.clone();
    let bounded = plane.clone();
    soften(&plan(low, 2.0), &share, (&huge, &means), &bounded, &mut plane);
    assert!(plane.pixels().iter().all(|value| value.is_finite()));
}
