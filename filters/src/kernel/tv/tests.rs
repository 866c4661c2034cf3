//! Every row kernel against its definition in f64, and every instruction set against the others.

#![allow(clippy::float_cmp, reason = "exact values are asked for")]

use proptest::prelude::*;

use super::*;
use crate::kernel::Isa;

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
    let ones = vec![1.0; width];
    for y in 0..height {
        let at = y * width..(y + 1) * width;
        let below = (y + 1).min(height - 1) * width;
        let row = DualRow { over: &x[at.clone()], below: &x[below..below + width], sigma: &ones };
        dual_row::<Anisotropic>(isa, &mut vertical[at.clone()], &mut horizontal[at], row, 1.0);
    }
    (vertical, horizontal)
}

/// Adjoint gradient by the primal step of the fused kernel: from 0, with unit steps, `x` becomes minus the adjoint.
fn adjoint(isa: Isa, height: usize, width: usize, vertical: &[f32], horizontal: &[f32]) -> Vec<f32> {
    let mut x = vec![0.0; vertical.len()];
    let (ones, free) = (vec![1.0; width], vec![1; width]);
    for y in 0..height {
        let at = y * width..(y + 1) * width;
        let mut above = if y == 0 { vec![0.0; width] } else { vertical[at.start - width..at.start].to_vec() };
        let (mut over, mut beside) = (vec![0.0; width + 1], vec![0.0; width]);
        let row =
            SweepRow { vertical: &vertical[at.clone()], horizontal: &horizontal[at.clone()], free: &free };
        let rates = Rates { tau: &ones, sigma: &ones, rho: 1.0 };
        sweep_row::<Isotropic>(isa, &mut x[at], &mut over, &mut above, &mut beside, row, rates);
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
fn bound_sums_the_masked_adjoint() {
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
                let mut want = Bound::default();
                for j in 0..width {
                    let d = f64::from(full[y * width + j]);
                    if free[y * width + j] == 1 {
                        want.missing += d.min(0.0);
                    } else {
                        want.measured += d * f64::from(sample[y * width + j]);
                        want.squares += d * d;
                    }
                }
                let tolerance = 32.0 * f64::from(f32::EPSILON) * width as f64;
                let got = bound_row(isa, &sample[at], row);
                assert!((got.measured - want.measured).abs() <= tolerance);
                assert!((got.missing - want.missing).abs() <= tolerance);
                assert!((got.squares - want.squares).abs() <= tolerance);
            }
        }
    }
}

/// A step of repair, row after row, against `q <- clip(q - alpha grad (M grad* q))` made of the other kernels, in f64.
#[test]
fn repair_descends_along_the_gradient_of_the_masked_divergence() {
    for isa in Isa::all() {
        for (height, width) in SIZES {
            let n = height * width;
            let free = flags(n, 3);
            let (p, q) = dual_noise(height, width, 4);
            let alpha = 0.3_f32;
            let masked: Vec<f32> = adjoint(isa, height, width, &p, &q)
                .iter()
                .zip(&free)
                .map(|(d, &free)| 0.125 * f32::from(free) * d)
                .collect();
            // The gradient's own kernel clips to 1: an eighth of a divergence is at most a half.
            let (down, along) = gradient(isa, height, width, &masked);
            let norm = crate::prox::Norm::Isotropic;
            let want: Vec<[f64; 2]> = (0..n)
                .map(|i| {
                    let moved = |q: f32, d: f32| f64::from(q) - f64::from(alpha) * 8.0 * f64::from(d);
                    norm.clip([moved(p[i], down[i]), moved(q[i], along[i])])
                })
                .collect();
            let (mut vertical, mut horizontal) = (p.clone(), q.clone());
            let (mut over, ones) = (vec![0.0; width + 1], vec![1.0; width]);
            for y in 0..height {
                let (above, rest) = vertical.split_at_mut(y * width);
                let (beside, right) = horizontal.split_at_mut(y * width);
                let (mut zeros, mut more) = (vec![0.0; width], vec![0.0; width]);
                let above = if y == 0 { &mut zeros[..] } else { &mut above[(y - 1) * width..] };
                let beside = if y == 0 { &mut more[..] } else { &mut beside[(y - 1) * width..] };
                let row = SweepRow {
                    vertical: &rest[..width],
                    horizontal: &right[..width],
                    free: &free[y * width..(y + 1) * width],
                };
                repair_row::<Isotropic>(isa, &mut over, above, beside, row, alpha);
            }
            let row = DualRow { over: &over[..width], below: &over[..width], sigma: &ones };
            let last = (height - 1) * width..;
            dual_row::<Isotropic>(isa, &mut vertical[last.clone()], &mut horizontal[last], row, 1.0);
            for i in 0..n {
                for (got, want) in [(vertical[i], want[i][0]), (horizontal[i], want[i][1])] {
                    let tolerance = 16.0 * f64::from(f32::EPSILON);
                    assert!((f64::from(got) - want).abs() <= tolerance, "{height}x{width} {i}: {got} {want}");
                }
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
    let rows: Vec<Vec<f32>> = (0..8).map(|k| noise(width, seed + k)).collect();
    let free = flags(width, seed);
    let steps = |scale: f32, row: &[f32]| row.iter().map(|v| scale * (1.5 + v)).collect::<Vec<f32>>();
    let (tau, sigma) = (steps(0.25, &rows[6]), steps(0.2, &rows[7]));
    let row = PrimalRow { above: &rows[0], vertical: &rows[1], horizontal: &rows[2], free: &free };
    let fused = SweepRow { vertical: &rows[1], horizontal: &rows[2], free: &free };
    let rates = Rates { tau: &tau, sigma: &sigma, rho: 1.6 };
    let (mut x, mut over, mut above, mut beside) =
        (rows[3].clone(), noise(width + 1, seed + 9), rows[4].clone(), rows[5].clone());
    sweep_row::<B>(isa, &mut x, &mut over, &mut above, &mut beside, fused, rates);
    let (mut d, mut up, mut along) = (noise(width + 1, seed + 10), rows[4].clone(), rows[5].clone());
    repair_row::<B>(isa, &mut d, &mut up, &mut along, fused, 0.23);
    let (mut held, mut over_held) = (rows[3].clone(), vec![0.0; width]);
    let ease: Vec<f32> = rows[5].iter().map(|v| 1.0 - 0.5 * v.abs().min(1.0)).collect();
    let samples = HeldRow { sample: &rows[4], ease: &ease };
    ball_row(isa, &mut held, &mut over_held, samples, row, [0.37, 1.6, 0.3]);
    let (mut vertical, mut horizontal) = (rows[5].clone(), rows[6].clone());
    let dual = DualRow { over: &over[..width], below: &rows[7], sigma: &sigma };
    dual_row::<B>(isa, &mut vertical, &mut horizontal, dual, 1.6);
    let bound = bound_row(isa, &rows[3], row);
    let sums = [
        distance_row(isa, &rows[3], samples, row, 0.37),
        squares_row(isa, &ease, row),
        variation_row::<B>(isa, &rows[3], &rows[4]),
        bound.measured,
        bound.missing,
        bound.squares,
    ];
    let all = [x, over, above, beside, d, up, along, held, over_held, vertical, horizontal].concat();
    all.iter().map(|v| u64::from(v.to_bits())).chain(sums.iter().map(|v| v.to_bits())).collect()
}

proptest! {
    #[test]
    fn instruction_sets_agree_to_the_bit(width in 1_usize..80, seed in 0_u32..1000) {
        let all: Vec<Isa> = Isa::all().collect();
        for &isa in &all[1..] {
            prop_assert_eq!(everything::<Isotropic>(all[0], width, seed), everything::<Isotropic>(isa, width, seed));
            prop_assert_eq!(everything::<Anisotropic>(all[0], width, seed), everything::<Anisotropic>(isa, width, seed));
        }
    }

    /// The clip is the proximal map, and leaves nothing outside the ball by more than rounding.
    #[test]
    fn clip_agrees_with_the_proximal_map(a in -4.0_f32..4.0, b in -4.0_f32..4.0) {
        let norms = [crate::prox::Norm::Isotropic, crate::prox::Norm::Anisotropic];
        for (norm, got) in norms.into_iter().zip([Isotropic::clip(a, b), Anisotropic::clip(a, b)]) {
            let want = norm.clip([f64::from(a), f64::from(b)]);
            let got = [got.0, got.1].map(f64::from);
            prop_assert!((got[0] - want[0]).abs() <= 2.0 * f64::from(f32::EPSILON));
            prop_assert!((got[1] - want[1]).abs() <= 2.0 * f64::from(f32::EPSILON));
            if norm == crate::prox::Norm::Isotropic {
                prop_assert!(got[0].hypot(got[1]) <= 1.0 + 4.0 * f64::from(f32::EPSILON));
            }
        }
    }
}
