//! Blocks of sweeps against one plain sweep after another, to the bit.

use super::{Ball, State, Sweeps};
use crate::Size;
use crate::kernel::tv::{Anisotropic, DualBall, Isa, Isotropic, Rates};

fn noise(n: usize, seed: usize) -> Vec<f32> {
    (0..n).map(|i| ((i * 7919 + seed * 104_729) % 1009) as f32 / 1009.0).collect()
}

/// One sweep as the formula has it, over whole planes; `ball` is the samples and the factor of the projection.
fn plain<B: DualBall>(state: &mut State, free: &[u8], rates: Rates, ball: Option<Ball<'_>>) {
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
    let mut keep = 0.0;
    if let Some(Ball { sample, ease, radius }) = ball {
        let mut total = 0.0;
        for y in 0..height {
            let mut row = 0.0;
            for i in at(y, 0)..at(y, 0) + width {
                let gap = f64::from(state.x[i] + ease[i] * rates.tau * flow[i] - sample[i]);
                row += f64::from(1 - free[i]) * gap * gap / f64::from(ease[i]);
            }
            total += row;
        }
        keep = if total.sqrt() > radius { (radius / total.sqrt()) as f32 } else { 1.0 };
    }
    let mut over = vec![0.0_f32; height * width];
    for i in 0..height * width {
        let step = match ball {
            None => f32::from(free[i]) * rates.tau * flow[i],
            Some(Ball { sample, ease, .. }) => {
                let there = state.x[i] + ease[i] * rates.tau * flow[i];
                let held = sample[i] + keep * (there - sample[i]);
                (if free[i] == 1 { there } else { held }) - state.x[i]
            }
        };
        over[i] = state.x[i] + 2.0 * step;
        state.x[i] += rates.rho * step;
    }
    for y in 0..height {
        for x in 0..width {
            let i = at(y, x);
            let down = if y + 1 < height { over[i + width] - over[i] } else { 0.0 };
            let (mut a, mut b) = (state.vertical[i] + rates.sigma * down, 0.0);
            if x + 1 < width {
                b = state.horizontal[i] + rates.sigma * (over[i + 1] - over[i]);
            }
            (a, b) = B::clip_roughly(a, b);
            state.vertical[i] += rates.rho * (a - state.vertical[i]);
            state.horizontal[i] += rates.rho * (b - state.horizontal[i]);
        }
    }
}

fn same(a: &State, b: &State) -> bool {
    let bits = |s: &State| {
        let all = s.x.iter().chain(&s.vertical).chain(&s.horizontal);
        all.map(|v| v.to_bits()).collect::<Vec<_>>()
    };
    bits(a) == bits(b)
}

fn check<B: DualBall>(height: usize, width: usize) {
    let size = Size::new(height, width);
    let n = size.pixels();
    let free: Vec<u8> = noise(n, 3).iter().map(|&v| u8::from(v > 0.2)).collect();
    let rates = Rates { tau: 0.3, sigma: 0.41, rho: 1.6 };
    for isa in Isa::all() {
        let sweeps = Sweeps { free: &free, rates, isa };
        for count in [1, 7, 8, 19] {
            let mut fast = State::new(size, noise(n, 1));
            let mut slow = fast.clone();
            fast.advance::<B>(sweeps, count);
            (0..count).for_each(|_| plain::<B>(&mut slow, &free, rates, None));
            assert!(same(&fast, &slow), "{height}x{width}, {count} sweeps");
        }
        let sample = noise(n, 5);
        let ease: Vec<f32> = noise(n, 7).iter().map(|v| 1.0 - 0.9 * v).collect();
        let ball = Ball { sample: &sample, ease: &ease, radius: 0.3 };
        let mut fast = State::new(size, sample.clone());
        let mut slow = fast.clone();
        fast.advance_in_ball::<B>(sweeps, ball, 5);
        (0..5).for_each(|_| plain::<B>(&mut slow, &free, rates, Some(ball)));
        assert!(same(&fast, &slow), "{height}x{width} in a ball");
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
