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
    grids_of(window, size, |i, j| noise(i, j, 0) < density, pull)
}

fn grids_of(
    window: Window,
    size: Size,
    measured: impl Fn(usize, usize) -> bool,
    pull: bool,
) -> Multigrid<f64> {
    let form = Form::new(Kernel::Bspline, 2, 0.03);
    let matrix = |level: usize| {
        let side = |n: usize| (0..level).fold(n, |n, _| n.div_ceil(2));
        let spacing = f64::from(1 << level);
        let energy = form.energy(Size::new(side(size.height), side(size.width)), (spacing, spacing));
        let energy = Arc::new(energy);
        (Arc::clone(&energy), energy)
    };
    let (mut free, mut d) = (window.zeros(), window.zeros());
    for i in 0..window.height {
        for j in 0..window.width {
            let measured = measured(i, j);
            free[window.at(i, j)] = if measured && !pull { 0.0 } else { 1.0 };
            d[window.at(i, j)] = if measured { 10.0 } else { 0.0 };
        }
    }
    Multigrid::new(Isa::best(), window, &matrix, free, pull.then_some(d))
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

/// A cycle on some cells, or on all.
fn cycle(grids: &Multigrid<f64>, cells: Option<&[bool]>, r: &[f64]) -> Vec<f64> {
    let mut workspace = grids.workspace();
    if let Some(cells) = cells {
        // What others left behind must not matter.
        workspace.vectors().c.fill(3.0);
        grids.cycle(&mut workspace);
        grids.work_on(&mut workspace, cells.to_vec());
    }
    workspace.residual().1.copy_from_slice(r);
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
            let (left, right) = (dot(&cycle(&grids, None, &a), &b), dot(&a, &cycle(&grids, None, &b)));
            let own = dot(&cycle(&grids, None, &a), &a);
            assert!(own > 0.0, "{window:?} {density}");
            assert!((left - right).abs() <= 1e-10 * own, "{window:?} {density}: {left} {right} of {own}");
        }
    }
}

/// On some cells it is so, too, and has no correction elsewhere.
#[test]
fn a_cycle_on_some_cells_is_symmetric_and_stays_there() {
    for (height, width) in [(67, 150), (301, 290)] {
        let window = Window { y: 0, x: 0, height, width };
        let grids = grids(window, Size::new(height, width), 0.02, false);
        let count = height.div_ceil(CELL.0) * width.div_ceil(CELL.1);
        for every in [2, 3, 11] {
            let cells: Vec<bool> = (0..count).map(|k| (k * 7919 + 13) % 101 % every == 0).collect();
            let spans = Spans::of_cells(window, CELL, &cells);
            let (mut a, mut b) = (image(&grids, 1), image(&grids, 2));
            let found = cycle(&grids, Some(&cells), &a);
            let mut inside = found.clone();
            spans.clear(window, &mut inside);
            assert_eq!(inside, found, "{every}");
            // Only what counts of the residual is seen.
            spans.clear(window, &mut a);
            spans.clear(window, &mut b);
            assert_eq!(cycle(&grids, Some(&cells), &a), found, "{every}");
            let (left, own) = (dot(&found, &b), dot(&found, &a));
            let right = dot(&a, &cycle(&grids, Some(&cells), &b));
            assert!(own > 0.0);
            assert!((left - right).abs() <= 1e-10 * own, "{every}: {left} {right} of {own}");
        }
    }
}

/// Leaving cells out makes a difference of what they may be left with, and less work.
#[test]
fn cells_are_left_out_when_little_is_left() {
    let window = Window { y: 0, x: 0, height: 400, width: 410 };
    let grids = grids(window, Size::new(400, 410), 0.01, false);
    // Something to correct in one corner.
    let mut r = image(&grids, 3);
    for i in 0..window.height {
        for j in 0..window.width {
            if i > 60 || j > 90 {
                r[window.at(i, j)] = 0.0;
            }
        }
    }
    let solve = |spare: f64, error: f64| {
        let mut workspace = grids.workspace();
        workspace.residual().1.copy_from_slice(&r);
        let goal = Goal { tolerance: 0.0, error, least: None, gain: 0.0, spare, patience: 9 };
        let ending = conjugate::solve(&grids, &mut workspace, goal, &Run::default());
        assert_eq!(ending.stop, Stop::Converged);
        assert!(ending.left <= error);
        let cells = workspace.active.cells.iter().filter(|cell| **cell).count();
        (workspace.correction().to_vec(), cells)
    };
    let (exact, all) = solve(0.0, 1e-12);
    assert_eq!(all, grids.all.cells.len());
    let size = exact.iter().fold(0.0_f64, |size, x| size.max(x.abs()));
    for error in [1e-3 * size, 1e-5 * size] {
        let (found, cells) = solve(0.4 * error, error);
        assert!(cells < all / 4, "{cells} of {all}");
        let off = exact.iter().zip(&found).fold(0.0_f64, |off, (a, b)| off.max((a - b).abs()));
        assert!(off <= error, "{off} for {error}");
    }
}

/// With samples that pull, too, what a cycle says it leaves of the residual is that.
#[test]
fn a_cycle_tells_what_it_leaves() {
    let window = Window { y: 0, x: 0, height: 90, width: 101 };
    for (density, pull) in [(0.1, false), (0.1, true), (1.0, true)] {
        let grids = grids(window, Size::new(90, 101), density, pull);
        let mut workspace = grids.workspace();
        let r = image(&grids, 3);
        workspace.residual().1.copy_from_slice(&r);
        grids.cycle(&mut workspace);
        let (x, rest) = (workspace.vectors().z.to_vec(), workspace.vectors().rest.to_vec());
        let mut product = window.zeros();
        grids.levels[0].product(grids.isa, window, &x, &mut product);
        vector::rest(grids.isa, grids.free(), &r, &mut product);
        // Entries of the matrix reach 50, their rows' sums a few times that, over as many products as a cycle takes steps.
        let size = 4e2 * x.iter().fold(1.0, |top: f64, x| top.max(x.abs()));
        for (at, (rest, expected)) in rest.iter().zip(&product).enumerate() {
            assert!(
                (rest - expected).abs() <= 16.0 * size * f64::EPSILON,
                "{density} {pull} {at}: {rest} {expected}"
            );
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
        workspace.residual().1.copy_from_slice(&image(&grids, 3));
        let goal = Goal { tolerance: 0.0, error: 0.0, least: None, gain: 1e-6, spare: 0.0, patience: 3 };
        let ending = conjugate::solve(&grids, &mut workspace, goal, &Run::default());
        assert_eq!(ending.stop, Stop::Converged);
        assert!(ending.iterations <= 15, "density {density}: {}", ending.iterations);
    }
}

/// So do they where samples are clustered, wherever that is.
#[test]
fn conjugate_gradients_converge_beside_clusters() {
    let window = Window { y: 0, x: 0, height: 330, width: 420 };
    for (y, x) in [(40.0, 60.0), (160.0, 210.0), (300.0, 380.0)] {
        let near = |i: usize, j: usize| (i as f64 - y).hypot(j as f64 - x) < 30.0;
        let measured = |i: usize, j: usize| noise(i, j, 0) < if near(i, j) { 0.6 } else { 0.01 };
        let grids = grids_of(window, Size::new(330, 420), measured, false);
        let mut workspace = grids.workspace();
        workspace.residual().1.copy_from_slice(&image(&grids, 3));
        let goal = Goal { tolerance: 0.0, error: 0.0, least: None, gain: 1e-6, spare: 0.0, patience: 3 };
        let ending = conjugate::solve(&grids, &mut workspace, goal, &Run::default());
        assert_eq!(ending.stop, Stop::Converged, "({y}, {x})");
        assert!(ending.iterations <= 20, "({y}, {x}): {}", ending.iterations);
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
            workspace.residual().1.copy_from_slice(&product);
            let goal = Goal { tolerance: 0.0, error: 0.0, least: None, gain: 1e-10, spare: 0.0, patience: 9 };
            assert_eq!(conjugate::solve(&grids, &mut workspace, goal, &Run::default()).stop, Stop::Converged);
            let free = (0..window.len()).filter(|&at| grids.free()[at] > 0.0);
            let error = free.map(|at| (start[at] - workspace.correction()[at]).abs()).fold(0.0, f64::max);
            assert!(error <= bound, "density {density}: {error}");
        }
    }
}
