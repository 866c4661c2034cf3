//! Tiles against the energy as it is defined, in f64, and every instruction set against the others.

#![allow(clippy::float_cmp, reason = "where bits are promised, bits are compared")]

use super::*;
use crate::kernel::{Isa, dispatch};

const SIZES: [(usize, usize); 12] =
    [(1, 1), (1, 2), (2, 1), (1, 9), (9, 1), (2, 2), (2, 7), (3, 3), (3, 19), (8, 5), (17, 16), (21, 34)];

const HOW: Weighting =
    Weighting { inverse: 40.0, slope: 0.1, floor: 0.01, blur: [0.28, 0.2, 0.1, 0.04, 0.02] };

/// Values in [-1, 1] that look random.
fn noise(n: usize, seed: u32) -> Vec<f32> {
    let hash = |i: u32| {
        let mut v = i.wrapping_mul(0x9E37_79B9) ^ seed.wrapping_mul(0x85EB_CA6B);
        for _ in 0..3 {
            v = (v ^ v >> 15).wrapping_mul(0x2C1B_3C6D);
        }
        (v >> 8) as f32 / (1 << 23) as f32 - 1.0
    };
    (0..n as u32).map(hash).collect()
}

/// A tile with two channels, an edge and some noise, two of three pixels free.
fn tile(h: usize, w: usize) -> Tile {
    let mut tile = Tile::default();
    tile.resize(h, w, 2);
    for (k, (value, noise)) in tile.values.iter_mut().zip(noise(2 * h * w, 5)).enumerate() {
        let (y, x) = (k / w % h, k % w);
        *value = 0.1 * noise + if 2 * x > y + w / 2 { 0.8 } else { 0.1 };
    }
    tile.free.iter_mut().enumerate().for_each(|(k, free)| *free = if k % 3 == 0 { 0.0 } else { 1.0 });
    tile
}

fn weighed(isa: Isa, h: usize, w: usize) -> (Tile, f32) {
    let mut tile = tile(h, w);
    let least = dispatch(isa, Weigh { tile: &mut tile, how: HOW, sought: 2.0 });
    (tile, least)
}

/// The energy by its definition: at each pixel, for each of the cells around it, the root of `D`, times `H`, times the root.
fn energy(u: &[f64], matrix: &[Vec<f32>; 3], (h, w): (usize, usize)) -> f64 {
    let at = |y: usize, x: usize| u[y * w + x];
    let mut sum = 0.0;
    for (y, x) in (0..h).flat_map(|y| (0..w).map(move |x| (y, x))) {
        let xx = if x > 0 && x + 1 < w { at(y, x - 1) - 2.0 * at(y, x) + at(y, x + 1) } else { 0.0 };
        let yy = if y > 0 && y + 1 < h { at(y - 1, x) - 2.0 * at(y, x) + at(y + 1, x) } else { 0.0 };
        let [p, q, r] = [0, 1, 2].map(|k: usize| f64::from(matrix[k][y * w + x]));
        // The root of a positive definite matrix of 2 x 2.
        let s = (p * r - q * q).max(0.0).sqrt();
        let t = (p + r + 2.0 * s).sqrt();
        let root = [(p + s) / t, q / t, (r + s) / t];
        for (cy, cx) in [(0, 0), (0, 1), (1, 0), (1, 1)] {
            let inside = y + cy > 0 && x + cx > 0 && y + cy < h && x + cx < w;
            let xy = if inside {
                let (y, x) = (y + cy - 1, x + cx - 1);
                at(y, x) - at(y, x + 1) - at(y + 1, x) + at(y + 1, x + 1)
            } else {
                0.0
            };
            let [a, b, c] = root;
            let (k, l, m, n) = (a * xx + b * xy, a * xy + b * yy, b * xx + c * xy, b * xy + c * yy);
            let product = [k * a + l * b, k * b + l * c, m * a + n * b, m * b + n * c];
            sum += 0.25 * product.iter().map(|v| v * v).sum::<f64>();
        }
    }
    sum
}

struct Apply<'a>(&'a [f32], &'a mut Tile);

impl Body for Apply<'_> {
    type Output = [Vec<f32>; 2];
    #[inline(always)]
    fn run<const FUSED: bool>(self) -> [Vec<f32>; 2] {
        let Self(u, Tile { height, width, matrix, operator, .. }) = self;
        operator.find(matrix, (*height, *width));
        operator.applied(u)
    }
}

fn applied(u: &[f32], tile: &mut Tile) -> Vec<f32> {
    let [out, _] = dispatch(Isa::Portable, Apply(u, tile));
    out
}

fn product(a: &[f32], b: &[f32]) -> f64 {
    a.iter().zip(b).map(|(a, b)| f64::from(*a) * f64::from(*b)).sum()
}

#[test]
fn the_operator_is_that_of_the_energy() {
    for (h, w) in SIZES {
        let (mut tile, _) = weighed(Isa::Portable, h, w);
        let (u, v) = (noise(h * w, 1), noise(h * w, 2));
        let (au, av) = (applied(&u, &mut tile), applied(&v, &mut tile));
        // The operator's norm is at most 64, and an entry takes about 40 roundings.
        let tolerance = 40.0 * 64.0 * f64::from(f32::EPSILON) * (h * w) as f64;
        let wide: Vec<f64> = u.iter().map(|v| f64::from(*v)).collect();
        assert!((product(&u, &au) - energy(&wide, &tile.matrix, (h, w))).abs() <= tolerance, "{h} x {w}");
        assert!((product(&u, &av) - product(&v, &au)).abs() <= tolerance, "{h} x {w}: not symmetric");
        let [_, diagonal] = dispatch(Isa::Portable, Apply(&u, &mut tile));
        let within = |k: &usize| (1..h.max(1) - 1).contains(&(k / w)) && (1..w.max(1) - 1).contains(&(k % w));
        for k in (0..h * w).filter(within) {
            let unit: Vec<f32> = (0..h * w).map(|i| if i == k { 1.0 } else { 0.0 }).collect();
            let expected = applied(&unit, &mut tile)[k];
            assert!((diagonal[k] - expected).abs() <= 40.0 * 64.0 * f32::EPSILON, "{h} x {w}: {k}");
        }
    }
}

#[test]
fn planes_have_no_energy() {
    for (h, w) in SIZES {
        let (mut tile, _) = weighed(Isa::Portable, h, w);
        let plane: Vec<f32> = (0..h * w).map(|k| 3.0 + 2.0 * (k / w) as f32 - 5.0 * (k % w) as f32).collect();
        assert_eq!(applied(&plane, &mut tile), vec![0.0; h * w], "{h} x {w}");
    }
}

#[test]
fn tiles_of_little_range_need_no_matrices() {
    for scale in [1.0_f32, 0.3, 0.1, 0.03, 0.01, 0.0] {
        let with = |sought: f32| {
            let mut tile = tile(21, 34);
            tile.values.iter_mut().for_each(|value| *value = 0.4 + scale * *value);
            dispatch(Isa::best(), Weigh { tile: &mut tile, how: HOW, sought })
        };
        let (all, found) = (with(2.0), with(0.7));
        assert!(found == all || (found == 1.0 && all >= 0.7), "{scale}: {found} for {all}");
        assert!(scale > 0.0 || found == 1.0);
    }
}

/// The matrices by their definition.
fn matrices(values: &[f32], h: usize, w: usize) -> Vec<[f64; 3]> {
    let side = 0.106_507_f64;
    let mut sums = vec![[0.0; 3]; h * w];
    for channel in values.chunks(h * w).filter(|_| h > 2 && w > 2) {
        let raw = |y: usize, x: usize| f64::from(channel[y * w + x]);
        let rows = |y: usize, x: usize| match x {
            x if x > 0 && x + 1 < w => raw(y, x) + side * (raw(y, x - 1) - 2.0 * raw(y, x) + raw(y, x + 1)),
            _ => raw(y, x),
        };
        let u = |y: usize, x: usize| match y {
            y if y > 0 && y + 1 < h => {
                rows(y, x) + side * (rows(y - 1, x) - 2.0 * rows(y, x) + rows(y + 1, x))
            }
            _ => rows(y, x),
        };
        for (i, sum) in sums.iter_mut().enumerate() {
            let (y, x) = ((i / w).clamp(1, h - 2), (i % w).clamp(1, w - 2));
            let xx = u(y, x - 1) - 2.0 * u(y, x) + u(y, x + 1);
            let yy = u(y - 1, x) - 2.0 * u(y, x) + u(y + 1, x);
            let xy = 0.25 * (u(y + 1, x + 1) - u(y + 1, x - 1) - u(y - 1, x + 1) + u(y - 1, x - 1));
            let (gx, gy) = (0.5 * (u(y, x + 1) - u(y, x - 1)), 0.5 * (u(y + 1, x) - u(y - 1, x)));
            let slope = f64::from(HOW.slope);
            sum[0] += xx * xx + xy * xy + slope * gx * gx;
            sum[1] += xy * (xx + yy) + slope * gx * gy;
            sum[2] += yy * yy + xy * xy + slope * gy * gy;
        }
    }
    let tap = |k: isize| f64::from(HOW.blur[k.unsigned_abs()]);
    let clamped = |k: usize, by: isize, n: usize| k.saturating_add_signed(by).min(n - 1);
    let blurred = |y: usize, x: usize, k: usize| -> f64 {
        let all = (-4..=4).flat_map(|dy| (-4..=4).map(move |dx| (dy, dx)));
        all.map(|(dy, dx)| tap(dy) * tap(dx) * sums[clamped(y, dy, h) * w + clamped(x, dx, w)][k]).sum()
    };
    let weight = |j: f64| (1.0 / (1.0 + j.max(0.0) * f64::from(HOW.inverse))).max(f64::from(HOW.floor));
    let each = |(y, x)| {
        let [a, b, c] = [0, 1, 2].map(|k| blurred(y, x, k));
        let angle = 0.5 * (2.0 * b).atan2(a - c);
        let (sin, cos) = angle.sin_cos();
        let high = weight(a * cos * cos + 2.0 * b * sin * cos + c * sin * sin);
        let low = weight(a * sin * sin - 2.0 * b * sin * cos + c * cos * cos);
        [high * cos * cos + low * sin * sin, (high - low) * sin * cos, high * sin * sin + low * cos * cos]
    };
    (0..h).flat_map(|y| (0..w).map(move |x| (y, x))).map(each).collect()
}

#[test]
fn weights_are_those_of_the_tensor() {
    for (h, w) in SIZES {
        let (tile, least) = weighed(Isa::Portable, h, w);
        let expected = matrices(&self::tile(h, w).values, h, w);
        // A relative rounding of the tensor moves a weight by at most a quarter of it; where eigenvalues are near, the direction that is
        // lost does not matter.
        let tolerance = 400.0 * f64::from(f32::EPSILON);
        let mut smallest = 1.0_f64;
        for (k, expected) in expected.iter().enumerate() {
            for (found, expected) in tile.matrix.iter().zip(expected) {
                assert!((f64::from(found[k]) - expected).abs() <= tolerance, "{h} x {w}: {k}");
            }
            let [p, q, r] = expected;
            smallest = smallest.min(0.5 * (p + r) - (0.25 * (p - r).powi(2) + q * q).sqrt());
        }
        assert!((f64::from(least) - smallest).abs() <= tolerance, "{h} x {w}: least");
    }
}

#[test]
fn what_is_solved_has_no_pull_left() {
    for (h, w) in SIZES {
        let (mut tile, _) = weighed(Isa::Portable, h, w);
        let before = tile.values.clone();
        dispatch(Isa::Portable, Solve { tile: &mut tile, steps: 20 * h * w, tolerance: 1e-5 });
        let after = tile.values.clone();
        let (old, new): (Vec<_>, Vec<_>) = before
            .chunks(h * w)
            .zip(after.chunks(h * w))
            .map(|(old, new)| (applied(old, &mut tile), applied(new, &mut tile)))
            .unzip();
        let norm = |pulls: &[Vec<f32>], free: &[f32]| {
            let squares =
                |pull: &Vec<f32>| pull.iter().zip(free).map(|(v, f)| f64::from(v * f).powi(2)).sum::<f64>();
            pulls.iter().map(squares).sum::<f64>().sqrt()
        };
        let rounding = 40.0 * 64.0 * f64::from(f32::EPSILON) * ((h * w) as f64).sqrt();
        // The diagonal lies between 1e-4 and 64.
        assert!(norm(&new, &tile.free) <= 1e-2 * norm(&old, &tile.free) + rounding, "{h} x {w}");
        let kept = before.iter().zip(&after).zip(tile.free.iter().cycle()).filter(|(_, free)| **free == 0.0);
        assert!(kept.into_iter().all(|((old, new), _)| old.to_bits() == new.to_bits()), "{h} x {w}");
    }
}

#[test]
fn instruction_sets_agree() {
    for (h, w) in SIZES {
        let solved = |isa| {
            let (mut tile, least) = weighed(isa, h, w);
            let ended = dispatch(isa, Solve { tile: &mut tile, steps: 6, tolerance: 0.0 });
            (least, ended, tile.values)
        };
        let portable = solved(Isa::Portable);
        assert!(Isa::all().all(|isa| solved(isa) == portable), "{h} x {w}");
    }
}
