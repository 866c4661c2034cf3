//! Blocks of sweeps against one plain sweep after another, to the bit.

use super::{BLOCK, Ball, State, Steps, Sweeps, smooth};
use crate::Size;
use crate::kernel::Isa;
use crate::kernel::tv::{Anisotropic, DualBall, Isotropic};

fn noise(n: usize, seed: usize) -> Vec<f32> {
    (0..n).map(|i| ((i * 7919 + seed * 104_729) % 1009) as f32 / 1009.0).collect()
}

/// One sweep as the formula has it, over whole planes; `ball` is the samples and the factor of the projection.
fn plain<B: DualBall>(state: &mut State, free: &[u8], (steps, rho): (&Steps, f32), ball: Option<Ball<'_>>) {
    let Size { height, width } = state.size;
    let at = |y: usize, x: usize| y * width + x;
    let mut flow = vec![0.0_f32; height * width];
    for y in 0..height {
        for x in 0..width {
            let above = if y == 0 { 0.0 } else { state.vertical[at(y - 1, x)] };
            let left = if x == 0 { 0.0 } else { state.horizontal[at(y, x - 1)] };
            flow[at(y, x)] = (state.vertical[at(y, x)] - above) + (state.horizontal[at(y, x)] - left);
        }
    }
    let tau = |i: usize| steps.tau(i / width)[i % width];
    let mut keep = 0.0;
    if let Some(Ball { sample, ease, radius }) = ball {
        let mut total = 0.0;
        for y in 0..height {
            let mut row = 0.0;
            for i in at(y, 0)..at(y, 0) + width {
                let gap = f64::from(state.x[i] + ease[i] * tau(i) * flow[i] - sample[i]);
                row += f64::from(1 - free[i]) * gap * gap / f64::from(ease[i]);
            }
            total += row;
        }
        keep = if total.sqrt() > radius { (radius / total.sqrt()) as f32 } else { 1.0 };
    }
    let mut over = vec![0.0_f32; height * width];
    for i in 0..height * width {
        let step = match ball {
            None => f32::from(free[i]) * tau(i) * flow[i],
            Some(Ball { sample, ease, .. }) => {
                let there = state.x[i] + ease[i] * tau(i) * flow[i];
                let held = sample[i] + keep * (there - sample[i]);
                (if free[i] == 1 { there } else { held }) - state.x[i]
            }
        };
        over[i] = state.x[i] + 2.0 * step;
        state.x[i] += rho * step;
    }
    for y in 0..height {
        for x in 0..width {
            let i = at(y, x);
            let down = if y + 1 < height { over[i + width] - over[i] } else { 0.0 };
            let sigma = steps.sigma(y)[x];
            let (mut a, mut b) = (state.vertical[i] + sigma * down, 0.0);
            if x + 1 < width {
                b = state.horizontal[i] + sigma * (over[i + 1] - over[i]);
            }
            (a, b) = B::clip(a, b);
            state.vertical[i] += rho * (a - state.vertical[i]);
            state.horizontal[i] += rho * (b - state.horizontal[i]);
        }
    }
}

/// One step of repair as the formula has it.
fn plain_repair<B: DualBall>(state: &mut State, free: &[u8], alpha: f32) {
    let Size { height, width } = state.size;
    let (vertical, horizontal) = (state.vertical.clone(), state.horizontal.clone());
    let d = |i: usize| {
        let above = if i < width { 0.0 } else { vertical[i - width] };
        let left = if i.is_multiple_of(width) { 0.0 } else { horizontal[i - 1] };
        f32::from(free[i]) * alpha * ((vertical[i] - above) + (horizontal[i] - left))
    };
    for i in 0..height * width {
        let (last_row, last_column) = (i / width + 1 == height, i % width + 1 == width);
        let down = if last_row { 0.0 } else { d(i + width) - d(i) };
        let right = if last_column { 0.0 } else { d(i + 1) - d(i) };
        (state.vertical[i], state.horizontal[i]) = B::clip(vertical[i] + down, horizontal[i] + right);
    }
}

fn same(a: &State, b: &State) -> bool {
    let bits = |s: &State| {
        let all = s.x.iter().chain(s.vertical.iter()).chain(s.horizontal.iter());
        all.map(|v| v.to_bits()).collect::<Vec<_>>()
    };
    bits(a) == bits(b)
}

fn check<B: DualBall>(height: usize, width: usize) {
    let size = Size::new(height, width);
    let n = size.pixels();
    let free: Vec<u8> = noise(n, 3).iter().map(|&v| u8::from(v > 0.2)).collect();
    let blocks = height.div_ceil(BLOCK) * width.div_ceil(BLOCK);
    let varied: Vec<f64> = noise(blocks, 9).iter().map(|&v| f64::from(0.1 + v)).collect();
    let (varied, uniform) = (Steps::of_blocks(size, &varied, 0.99), Steps::uniform(size, 0.3, 0.99));
    for isa in Isa::all() {
        let sweeps = Sweeps { free: &free, steps: &varied, rho: 1.6, isa };
        for count in [1, 7, 8, 19] {
            let mut fast = State::new(size, &noise(n, 1), |v| v);
            let mut slow = fast.clone();
            fast.advance::<B>(sweeps, count);
            (0..count).for_each(|_| plain::<B>(&mut slow, &free, (&varied, 1.6), None));
            assert!(same(&fast, &slow), "{height}x{width}, {count} sweeps");
            let alphas: Vec<f32> = (0..count).map(|k| 0.1 + 0.01 * k as f32).collect();
            fast.repair::<B>(isa, &free, &alphas);
            for &alpha in &alphas {
                plain_repair::<B>(&mut slow, &free, alpha);
            }
            assert!(same(&fast, &slow), "{height}x{width}, {count} steps of repair");
        }
        let sample = noise(n, 5);
        let ease: Vec<f32> = noise(n, 7).iter().map(|v| 1.0 - 0.9 * v).collect();
        let ball = Ball { sample: &sample, ease: &ease, radius: 0.3 };
        let mut fast = State::new(size, &sample, |v| v);
        let mut slow = fast.clone();
        let sweeps = Sweeps { steps: &uniform, ..sweeps };
        fast.advance_in_ball::<B>(sweeps, ball, 5);
        (0..5).for_each(|_| plain::<B>(&mut slow, &free, (&uniform, 1.6), Some(ball)));
        assert!(same(&fast, &slow), "{height}x{width} in a ball");
    }
}

/// What the sweeps converge by: no gradient's step is too large for a pixel that it depends on.
#[test]
fn steps_are_within_their_product() {
    for (height, width) in [(1, 1), (1, 40), (40, 1), (16, 16), (17, 33), (50, 47)] {
        let size = Size::new(height, width);
        let columns = width.div_ceil(BLOCK);
        let mut tau: Vec<f64> =
            noise(height.div_ceil(BLOCK) * columns, 2).iter().map(|&v| f64::from(0.01 + v)).collect();
        let range = |tau: &[f64]| tau.iter().fold((f64::MAX, 0.0_f64), |(a, b), &v| (a.min(v), b.max(v)));
        let before = range(&tau);
        for _ in 0..2 {
            let steps = Steps::of_blocks(size, &tau, 0.99);
            for y in 0..height {
                for x in 0..width {
                    let (right, below) = ((x + 1).min(width - 1), (y + 1).min(height - 1));
                    for tau in [steps.tau(y)[x], steps.tau(y)[right], steps.tau(below)[x]] {
                        let product = 8.0 * f64::from(tau) * f64::from(steps.sigma(y)[x]);
                        assert!(
                            product <= 0.99 * (1.0 + 2.0 * f64::from(f32::EPSILON)),
                            "{y} {x}: {product}"
                        );
                    }
                    let own = tau[y / BLOCK * columns + x / BLOCK] as f32;
                    assert_eq!(steps.tau(y)[x].to_bits(), own.to_bits());
                }
            }
            smooth(columns, &mut tau);
            let after = range(&tau);
            assert!(after.0 >= before.0 * (1.0 - 1e-12) && after.1 <= before.1 * (1.0 + 1e-12));
        }
    }
}

#[test]
fn blocks_are_plain_sweeps() {
    let heights = [1, 2, 3, 9, super::BAND - 1, super::BAND, super::BAND + 1, 2 * super::BAND + 3];
    for height in heights {
        for width in [1, 2, 5, 18] {
            check::<Isotropic>(height, width);
            check::<Anisotropic>(height, width);
        }
    }
}

/// Rows so wide that a block is one sweep deep.
#[test]
fn wide_rows_take_shallow_blocks() {
    check::<Isotropic>(3, super::CACHE / (super::ROW_PLANES * 4) + 1);
}
