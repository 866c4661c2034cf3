//! What a preconditioner must be, and that the parts of a cycle fit.

use super::*;
use crate::operator::energy::Form;
use crate::operator::profile::Kernel;
use crate::solver::conjugate::{self, Goal};
use crate::{Run, Size, Stop};

/// A reproducible number in [0, 1) for each place.
fn noise(i: usize, j: usize, seed: usize) -> f64 {
    ((i * 31 + j * 17 + 5 * seed + 1) as f64 * 12.9898).sin().mul_add(43758.5453, 0.0).rem_euclid(1.0)
}

fn grids(window: Window, size: Size, density: f64, pull: bool) -> Multigrid<f64> {
    let form = Form::new(Kernel::Bspline, 2, 0.03);
    let (mut tall, mut wide, mut spacing) = (size.height, size.width, 1.0);
    let mut matrix = |level: usize| {
        if level > 0 {
            (tall, wide, spacing) = (tall.div_ceil(2), wide.div_ceil(2), 2.0 * spacing);
        }
        form.energy(Size::new(tall, wide), (spacing, spacing))
    };
    let (mut free, mut d) = (window.zeros(), window.zeros());
    for i in 0..window.height {
        for j in 0..window.width {
            let measured = noise(i, j, 0) < density;
            free[window.at(i, j)] = if measured && !pull { 0.0 } else { 1.0 };
            d[window.at(i, j)] = if measured { 10.0 } else { 0.0 };
        }
    }
    Multigrid::new(Isa::best(), window, &mut matrix, free, pull.then_some(d))
}

fn image(grids: &Multigrid<f64>, seed: usize) -> Vec<f64> {
    let window = grids.window();
    let mut image = window.zeros();
    for i in 0..window.height {
        for j in 0..window.width {
            image[window.at(i, j)] = grids.free()[window.at(i, j)].ceil() * (noise(i, j, seed) - 0.5);
        }
    }
    image
}

fn cycle(grids: &Multigrid<f64>, r: &[f64]) -> Vec<f64> {
    let mut workspace = grids.workspace();
    workspace.residual().copy_from_slice(r);
    grids.cycle(&mut workspace);
    workspace.vectors().z.to_vec()
}

fn dot(a: &[f64], b: &[f64]) -> f64 {
    a.iter().zip(b).map(|(a, b)| a * b).sum()
}

#[test]
fn a_cycle_is_symmetric_and_positive() {
    let whole = |height, width| (Window { y: 0, x: 0, height, width }, Size::new(height, width));
    let inside = (Window { y: 16, x: 32, height: 48, width: 80 }, Size::new(90, 130));
    for (window, size) in [whole(9, 7), whole(67, 150), whole(301, 29), whole(40, 700), inside] {
        for (density, pull) in [(0.01, false), (0.3, false), (0.05, true)] {
            let grids = grids(window, size, density, pull);
            let (a, b) = (image(&grids, 1), image(&grids, 2));
            let (left, right) = (dot(&cycle(&grids, &a), &b), dot(&a, &cycle(&grids, &b)));
            let own = dot(&cycle(&grids, &a), &a);
            assert!(own > 0.0, "{window:?} {density}");
            assert!((left - right).abs() <= 1e-10 * own, "{window:?} {density}: {left} {right} of {own}");
        }
    }
}

/// The constraints of the coarse grids stand for the samples whatever their density.
#[test]
fn conjugate_gradients_converge_at_any_density() {
    let window = Window { y: 0, x: 0, height: 200, width: 211 };
    for density in [0.002, 0.01, 0.05, 0.2, 0.7] {
        let grids = grids(window, Size::new(200, 211), density, false);
        let mut workspace = grids.workspace();
        workspace.residual().copy_from_slice(&image(&grids, 3));
        let goal = Goal { tolerance: 0.0, error: 0.0, least: None, gain: 1e-6, patience: 3 };
        let ending = conjugate::solve(&grids, &mut workspace, goal, &Run::default());
        assert_eq!(ending.stop, Stop::Converged);
        assert!(ending.iterations <= 15, "density {density}: {}", ending.iterations);
    }
}

/// What coarse grids make of the samples of a smooth image is near what the finest makes of them; of a constant it is that.
#[test]
fn the_start_is_near_the_solution() {
    let window = Window { y: 0, x: 0, height: 200, width: 211 };
    let wave = |i: usize, j: usize| (i as f64 / 31.0).sin() * (j as f64 / 23.0).cos();
    for density in [0.01, 0.05] {
        let grids = grids(window, Size::new(200, 211), density, false);
        for (height, bound) in [(0.0, 1e-9), (1.0, 0.05)] {
            let image = |i: usize, j: usize| 2.0 + height * wave(i, j);
            let mut workspace = grids.workspace();
            assert!(grids.start(&mut workspace, &image));
            let start = workspace.correction().to_vec();
            // The solution: the samples, and what they lack.
            let (mut samples, mut product) = (window.zeros(), window.zeros());
            for i in 0..window.height {
                for j in 0..window.width {
                    let at = window.at(i, j);
                    samples[at] = if grids.free()[at] > 0.0 { 0.0 } else { image(i, j) };
                }
            }
            grids.levels[0].product(grids.isa, window, &samples, &mut product);
            vector::rest(grids.isa, grids.free(), &window.zeros(), &mut product);
            workspace.residual().copy_from_slice(&product);
            let goal = Goal { tolerance: 0.0, error: 0.0, least: None, gain: 1e-10, patience: 9 };
            assert_eq!(conjugate::solve(&grids, &mut workspace, goal, &Run::default()).stop, Stop::Converged);
            let free = (0..window.len()).filter(|&at| grids.free()[at] > 0.0);
            let error = free.map(|at| (start[at] - workspace.correction()[at]).abs()).fold(0.0, f64::max);
            assert!(error <= bound, "density {density}: {error}");
        }
    }
}
