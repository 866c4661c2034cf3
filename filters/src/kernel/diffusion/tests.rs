use super::*;
use crate::Size;
use crate::baseline::testing;

/// A disc, a slanted edge and a texture.
fn scene(size: Size) -> Plane {
    Plane::from_fn(size, |y, x| {
        let (v, u) = (y as f32, x as f32);
        let disc = if (v - 9.0).hypot(u - 8.0) < 5.5 { 0.7 } else { 0.1 };
        let edge = if u + 0.4 * v > 23.0 { 0.9 } else { 0.0 };
        disc + edge + 0.02 * ((u * 1.3).sin() * (v * 0.9).cos())
    })
}

fn shares(size: Size) -> Plane {
    Plane::from_fn(size, |y, x| 1.0 - ((y * 7 + x * 5) % 11) as f32 / 20.0)
}

fn everywhere(image: &Plane) -> Plane {
    smooth(image, &Plane::filled(image.size(), 1.0), &|| false)
}

/// The formulas, in f64 and pixel by pixel.
fn slow(image: &Plane, share: &Plane) -> Vec<f64> {
    let (height, width) = (image.size().height, image.size().width);
    let mut now: Vec<f64> = image.pixels().iter().map(|value| f64::from(*value)).collect();
    if height < 2 || width < 2 {
        return now;
    }
    let corners = |image: &[f64], y: usize, x: usize| {
        let at = |i: usize, j: usize| image[(y + i) * width + x + j];
        let g_x = 0.5 * (at(0, 1) - at(0, 0) + at(1, 1) - at(1, 0));
        let g_y = 0.5 * (at(1, 0) - at(0, 0) + at(1, 1) - at(0, 1));
        (g_x, g_y, 0.25 * (at(0, 0) + at(0, 1) + at(1, 0) + at(1, 1)))
    };
    let start = now.clone();
    let tensor = |y: usize, x: usize| {
        let mut sums = [0.0; 4];
        for (i, v) in BINOMIAL.iter().enumerate() {
            for (j, h) in BINOMIAL.iter().enumerate() {
                let (y, x) = ((y + i).max(REACH) - REACH, (x + j).max(REACH) - REACH);
                let (g_x, g_y, m) = corners(&start, y.min(height - 2), x.min(width - 2));
                let weight = f64::from(v * h);
                for (sum, value) in sums.iter_mut().zip([g_x * g_x, g_x * g_y, g_y * g_y, m * m]) {
                    *sum += weight * value;
                }
            }
        }
        let [a, b, c, e] = sums;
        let half = (0.25 * (a - c) * (a - c) + b * b).sqrt();
        let (most, least) = (0.5 * (a + c) + half, 0.5 * (a + c) - half);
        if most <= 0.0 {
            return [0.0; 3];
        }
        let share = [(0, 0), (0, 1), (1, 0), (1, 1)].map(|(i, j)| f64::from(share.at(y + i, x + j)));
        let share = 0.25 * share.iter().sum::<f64>();
        let weight = share * (most - least) / (most + least) * most / (most + f64::from(KNEE).powi(2) * e);
        // Along the edge: across the direction of the larger eigenvalue.
        let angle = 0.5 * (2.0 * b).atan2(a - c) + std::f64::consts::FRAC_PI_2;
        let (sine, cosine) = angle.sin_cos();
        [weight * cosine * cosine, weight * cosine * sine, weight * sine * sine]
    };
    let mut field = Vec::new();
    for y in 0..height - 1 {
        field.extend((0..width - 1).map(|x| tensor(y, x)));
    }
    for _ in 0..STEPS {
        let mut next = now.clone();
        for y in 0..height - 1 {
            for x in 0..width - 1 {
                let (g_x, g_y, _) = corners(&now, y, x);
                let [a, b, c] = field[y * (width - 1) + x];
                let (j_x, j_y) = (a * g_x + b * g_y, b * g_x + c * g_y);
                for (i, j, flux) in
                    [(0, 0, j_x + j_y), (0, 1, j_y - j_x), (1, 0, j_x - j_y), (1, 1, -j_x - j_y)]
                {
                    next[(y + i) * width + x + j] += 0.5 * f64::from(TAU) * flux;
                }
            }
        }
        now = next;
    }
    now
}

#[test]
fn rows_in_bands_are_the_formulas() {
    let sizes = [(1, 1), (1, 9), (9, 1), (2, 2), (3, 7), (19, 40), (BAND + 1, 33), (2 * BAND + 3, 30)];
    for (height, width) in sizes {
        let image = scene(Size::new(height, width));
        let share = shares(image.size());
        let fast = smooth(&image, &share, &|| false);
        for (at, (fast, slow)) in fast.pixels().iter().zip(slow(&image, &share)).enumerate() {
            // Where nothing is an edge its direction is a matter of rounding, and so is what little flows.
            let error = (f64::from(*fast) - slow).abs();
            assert!(error < 256.0 * f64::from(f32::EPSILON), "{height}x{width} {at} {error}");
        }
    }
}

#[test]
fn every_instruction_set_agrees() {
    let image = scene(Size::new(21, 45));
    let share = shares(image.size());
    let with = |isa| {
        let mut out = vec![f32::NAN; image.pixels().len()];
        dispatch(isa, Steps { image: &image, share: &share, rows: 0..21, out: &mut out });
        out
    };
    let portable = with(Isa::Portable);
    for isa in Isa::all() {
        for (a, b) in portable.iter().zip(with(isa)) {
            assert!((a - b).abs() < 128.0 * f32::EPSILON, "{isa:?} {a} {b}");
        }
    }
}

#[test]
fn light_stays_and_steps_along_an_edge_shrink() {
    // A slanted edge in pixels that are inside or outside.
    let size = Size::new(60, 80);
    let jagged = Plane::from_fn(size, |y, x| f32::from(u8::from(x * 4 > 100 + y)));
    let smoothed = everywhere(&jagged);
    let sum = |plane: &Plane| plane.pixels().iter().map(|value| f64::from(*value)).sum::<f64>();
    assert!((sum(&jagged) - sum(&smoothed)).abs() < 1e-6 * sum(&jagged));
    let true_ = |y: usize, x: usize| {
        let edge = 25.0 + (y as f32 + 0.5) / 4.0;
        (x as f32 + 1.0 - edge).clamp(0.0, 1.0)
    };
    let error = |plane: &Plane| {
        let inside = (8..52).flat_map(|y| (8..72).map(move |x| (y, x)));
        inside.map(|(y, x)| f64::from(plane.at(y, x) - true_(y, x)).powi(2)).sum::<f64>()
    };
    assert!(error(&smoothed) < 0.85 * error(&jagged), "{} {}", error(&smoothed), error(&jagged));
}

#[test]
fn the_result_is_in_proportion_and_huge_values_stay() {
    let image = scene(Size::new(20, 30));
    let scaled = |factor: f32| {
        let mut image = image.clone();
        image.pixels_mut().iter_mut().for_each(|value| *value *= factor);
        image
    };
    let (one, many) = (everywhere(&image), everywhere(&scaled(4096.0)));
    for (one, many) in one.pixels().iter().zip(many.pixels()) {
        assert_eq!((one * 4096.0).to_bits(), many.to_bits());
    }
    let huge = scaled(1e38);
    assert_eq!(everywhere(&huge), huge);
}

#[test]
fn threads_change_nothing() {
    let image = scene(Size::new(3 * BAND + 5, 31));
    let share = shares(image.size());
    let run = |threads| testing::with_threads(threads, || smooth(&image, &share, &|| false));
    assert_eq!(run(1), run(3));
}
