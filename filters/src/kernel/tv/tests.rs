//! Every row kernel against its definition in f64, and every instruction set against the others.

#![allow(clippy::float_cmp, reason = "exact values are asked for")]

use proptest::prelude::*;

use super::*;

/// Test images of one size: values in [-1, 1] from a hash, which differ by seed.
fn noise(n: usize, seed: u32) -> Vec<f32> {
    (0..n as u32)
        .map(|i| {
            let mut v = i.wrapping_mul(0x9E37_79B9) ^ seed.wrapping_mul(0x85EB_CA6B);
            v ^= v >> 15;
            v = v.wrapping_mul(0x2C1B_3C6D);
            v ^= v >> 12;
            v = v.wrapping_mul(0x297A_2D39);
            v ^= v >> 15;
            (v >> 8) as f32 / (1 << 23) as f32 - 1.0
        })
        .collect()
}

fn flags(n: usize, seed: u32) -> Vec<u8> {
    noise(n, seed).iter().map(|&v| u8::from(v > -0.4)).collect()
}

const SIZES: [(usize, usize); 12] =
    [(1, 1), (1, 2), (2, 1), (1, 7), (7, 1), (2, 2), (3, 5), (4, 4), (5, 17), (2, 33), (6, 40), (3, 18)];

/// Forward gradient of an image by the dual kernel: from 0, with unit steps, values too small to be clipped.
fn gradient(isa: Isa, height: usize, width: usize, x: &[f32]) -> (Vec<f32>, Vec<f32>) {
    let (mut vertical, mut horizontal) = (vec![0.0; x.len()], vec![0.0; x.len()]);
    let rates = Rates { tau: 1.0, sigma: 1.0, rho: 1.0 };
    for y in 0..height {
        let at = y * width..(y + 1) * width;
        let below = (y + 1).min(height - 1) * width;
        let row = DualRow { over: &x[at.clone()], below: &x[below..below + width] };
        dual_row::<Anisotropic>(isa, &mut vertical[at.clone()], &mut horizontal[at], row, rates);
    }
    (vertical, horizontal)
}

/// Adjoint gradient by the primal kernel: from 0, with unit steps, `x` becomes minus the adjoint.
fn adjoint(isa: Isa, height: usize, width: usize, vertical: &[f32], horizontal: &[f32]) -> Vec<f32> {
    let mut x = vec![0.0; vertical.len()];
    let (zeros, free, mut over) = (vec![0.0; width], vec![1; width], vec![0.0; width]);
    let rates = Rates { tau: 1.0, sigma: 1.0, rho: 1.0 };
    for y in 0..height {
        let at = y * width..(y + 1) * width;
        let above = if y == 0 { &zeros } else { &vertical[(y - 1) * width..y * width] };
        let row = PrimalRow {
            above,
            vertical: &vertical[at.clone()],
            horizontal: &horizontal[at.clone()],
            free: &free,
        };
        primal_row(isa, &mut x[at], &mut over, row, rates);
    }
    x.iter().map(|v| -v).collect()
}

fn dot(a: &[f32], b: &[f32]) -> f64 {
    a.iter().zip(b).map(|(&a, &b)| f64::from(a) * f64::from(b)).sum()
}

/// A dual variable as the solver holds it: 0 where a gradient does not exist.
fn dual_noise(height: usize, width: usize, seed: u32) -> (Vec<f32>, Vec<f32>) {
    let n = height * width;
    let (mut vertical, mut horizontal) = (noise(n, seed), noise(n, seed + 1));
    vertical[n - width..].fill(0.0);
    for y in 0..height {
        horizontal[y * width + width - 1] = 0.0;
    }
    (vertical, horizontal)
}

#[test]
fn gradient_and_primal_step_are_adjoint() {
    for isa in Isa::all() {
        for (height, width) in SIZES {
            let n = height * width;
            let x: Vec<f32> = noise(n, 1).iter().map(|v| v * 0.25).collect();
            let (p, q) = dual_noise(height, width, 2);
            let (gp, gq) = gradient(isa, height, width, &x);
            let left = dot(&gp, &p) + dot(&gq, &q);
            let right = dot(&x, &adjoint(isa, height, width, &p, &q));
            let bound = 8.0 * f64::from(f32::EPSILON) * n as f64;
            assert!((left - right).abs() <= bound, "{height}x{width}: {left} {right}");
        }
    }
}

#[test]
fn source_is_the_masked_adjoint_and_bound_sums_it() {
    for isa in Isa::all() {
        for (height, width) in SIZES {
            let (p, q) = dual_noise(height, width, 5);
            let full = adjoint(isa, height, width, &p, &q);
            let free = flags(height * width, 6);
            let sample = noise(height * width, 7);
            let zeros = vec![0.0; width];
            for y in 0..height {
                let at = y * width..(y + 1) * width;
                let above = if y == 0 { &zeros[..] } else { &p[(y - 1) * width..y * width] };
                let row = PrimalRow {
                    above,
                    vertical: &p[at.clone()],
                    horizontal: &q[at.clone()],
                    free: &free[at.clone()],
                };
                let mut out = vec![9.0; width];
                let norm = source_row(isa, &mut out, row);
                let mut want = Bound::default();
                for j in 0..width {
                    let d = f64::from(full[y * width + j]);
                    if free[y * width + j] == 1 {
                        assert!((f64::from(out[j]) - d).abs() <= 4.0 * f64::from(f32::EPSILON));
                        want.missing += d.min(0.0);
                    } else {
                        assert_eq!(out[j], 0.0);
                        want.measured += d * f64::from(sample[y * width + j]);
                        want.squares += d * d;
                    }
                }
                let tolerance = 32.0 * f64::from(f32::EPSILON) * width as f64;
                assert!((norm - dot(&out, &out)).abs() <= tolerance);
                let got = bound_row(isa, &sample[at], row);
                assert!((got.measured - want.measured).abs() <= tolerance);
                assert!((got.missing - want.missing).abs() <= tolerance);
                assert!((got.squares - want.squares).abs() <= tolerance);
            }
        }
    }
}

#[test]
fn laplacian_is_adjoint_of_gradient_after_gradient() {
    for isa in Isa::all() {
        for (height, width) in SIZES {
            let n = height * width;
            let free = flags(n, 3);
            let p: Vec<f32> = noise(n, 4).iter().zip(&free).map(|(v, &f)| v * 0.25 * f32::from(f)).collect();
            let (a, b) = gradient(isa, height, width, &p);
            let want = adjoint(isa, height, width, &a, &b);
            let at = |y: usize| y * width..(y + 1) * width;
            for y in 0..height {
                let mut out = vec![9.0; width];
                let (above, below) = (&p[at(y.saturating_sub(1))], &p[at((y + 1).min(height - 1))]);
                let product = laplacian_row(isa, &mut out, &p[at(y)], above, below, &free[at(y)]);
                for j in 0..width {
                    let want = want[y * width + j] * f32::from(free[y * width + j]);
                    assert!((out[j] - want).abs() <= 8.0 * f32::EPSILON, "{height}x{width} {y} {j}");
                }
                let tolerance = 16.0 * f64::from(f32::EPSILON) * width as f64;
                assert!((product - dot(&p[at(y)], &out)).abs() <= tolerance);
            }
        }
    }
}

#[test]
fn variation_counts_every_difference_once() {
    for isa in Isa::all() {
        // A step of 1 between columns 2 and 3 and one of 2 between rows 0 and 1.
        let top: Vec<f32> = (0..21).map(|j| if j < 3 { 0.0 } else { 1.0 }).collect();
        let bottom: Vec<f32> = top.iter().map(|v| v + 2.0).collect();
        let got = variation_row::<Anisotropic>(isa, &top, &bottom);
        assert_eq!(got, 21.0 * 2.0 + 1.0);
        let got = variation_row::<Isotropic>(isa, &top, &bottom);
        assert!((got - (20.0 * 2.0 + 5.0_f64.sqrt())).abs() < 1e-12);
        assert_eq!(variation_row::<Isotropic>(isa, &[3.0], &[3.0]), 0.0);
    }
}

/// Runs all kernels on one row and returns every bit that they wrote.
fn everything<B: DualBall>(isa: Isa, width: usize, seed: u32) -> Vec<u64> {
    let rates = Rates { tau: 0.37, sigma: 0.31, rho: 1.6 };
    let rows: Vec<Vec<f32>> = (0..8).map(|k| noise(width, seed + k)).collect();
    let free = flags(width, seed);
    let row = PrimalRow { above: &rows[0], vertical: &rows[1], horizontal: &rows[2], free: &free };
    let (mut x, mut over) = (rows[3].clone(), vec![0.0; width]);
    primal_row(isa, &mut x, &mut over, row, rates);
    let (mut held, mut over_held) = (rows[3].clone(), vec![0.0; width]);
    let ease: Vec<f32> = rows[5].iter().map(|v| 1.0 - 0.5 * v.abs().min(1.0)).collect();
    let samples = HeldRow { sample: &rows[4], ease: &ease };
    ball_row(isa, &mut held, &mut over_held, samples, row, rates, 0.3);
    let (mut vertical, mut horizontal) = (rows[5].clone(), rows[6].clone());
    dual_row::<B>(isa, &mut vertical, &mut horizontal, DualRow { over: &over, below: &rows[7] }, rates);
    let mut lap = vec![0.0; width];
    let mut sums = vec![laplacian_row(isa, &mut lap, &rows[1], &rows[2], &rows[3], &free)];
    let (mut phi, mut r) = (rows[0].clone(), rows[1].clone());
    sums.push(descend_row(isa, &mut phi, &mut r, &rows[2], &lap, 0.21));
    let mut p = rows[4].clone();
    direction_row(isa, &mut p, &r, 0.83);
    let (mut a, mut b) = (rows[5].clone(), rows[6].clone());
    correct_row::<B>(isa, &mut a, &mut b, &phi, &p);
    sums.push(distance_row(isa, &rows[3], samples, row, 0.37));
    sums.push(squares_row(isa, &ease, row));
    sums.push(variation_row::<B>(isa, &rows[3], &rows[4]));
    let bound = bound_row(isa, &rows[3], row);
    sums.extend([bound.measured, bound.missing, bound.squares, source_row(isa, &mut lap, row)]);
    let all = [x, over, held, over_held, vertical, horizontal, lap, phi, r, p, a, b].concat();
    all.iter().map(|v| u64::from(v.to_bits())).chain(sums.iter().map(|v| v.to_bits())).collect()
}

proptest! {
    #[test]
    fn instruction_sets_agree_to_the_bit(width in 1_usize..80, seed in 0_u32..1000) {
        let all = Isa::all();
        for &isa in &all[1..] {
            prop_assert_eq!(everything::<Isotropic>(all[0], width, seed), everything::<Isotropic>(isa, width, seed));
            prop_assert_eq!(everything::<Anisotropic>(all[0], width, seed), everything::<Anisotropic>(isa, width, seed));
        }
    }

    /// The fast clip is the proximal map, and leaves nothing outside the ball by more than rounding.
    #[test]
    fn clip_agrees_with_the_proximal_map(a in -4.0_f32..4.0, b in -4.0_f32..4.0) {
        let norms = [crate::prox::Norm::Isotropic, crate::prox::Norm::Anisotropic];
        for (norm, got) in norms.into_iter().zip([Isotropic::clip(a, b), Anisotropic::clip(a, b)]) {
            let want = norm.clip([f64::from(a), f64::from(b)]);
            let got = [got.0, got.1].map(f64::from);
            prop_assert!((got[0] - want[0]).abs() <= 2.0 * f64::from(f32::EPSILON));
            prop_assert!((got[1] - want[1]).abs() <= 2.0 * f64::from(f32::EPSILON));
            let rough = match norm {
                crate::prox::Norm::Isotropic => Isotropic::clip_roughly(a, b),
                crate::prox::Norm::Anisotropic => Anisotropic::clip_roughly(a, b),
            };
            prop_assert!((f64::from(rough.0) - want[0]).abs() <= 5e-6 && (f64::from(rough.1) - want[1]).abs() <= 5e-6);
            prop_assert!(norm.of([rough.0, rough.1].map(f64::from)) <= 1.0 + 4.0 * f64::from(f32::EPSILON) || norm == crate::prox::Norm::Anisotropic);
            if norm == crate::prox::Norm::Isotropic {
                prop_assert!(got[0].hypot(got[1]) <= 1.0 + 4.0 * f64::from(f32::EPSILON));
            }
        }
    }
}
