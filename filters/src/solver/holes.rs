//! Where the mask has holes: blocks without a measured pixel, and rectangles around them.

use lacuna_core::parallel::prelude::*;

use crate::kernel::window::Window;
use crate::{Mask, Size};

/// Side of the blocks. A gap that contains no whole block is left to the tiles.
pub const BLOCK: usize = 8;
/// Blocks by which a rectangle exceeds its hole on each side.
const MARGIN: usize = 2;
/// Share of the image above which one rectangle takes all of it.
const MOST: f64 = 0.4;
/// Cells along a side of the grid that multigrid solves directly.
const DIRECT: usize = 12;

/// How the image is divided.
pub enum Division {
    /// No holes.
    Dense,
    /// Rectangles around holes, disjoint, and the pixels in holes or next to them.
    Holes(Vec<Window>, Vec<bool>),
    /// Holes everywhere.
    Sparse,
}

/// The share of the image that rectangles around holes take.
pub fn share(mask: &Mask) -> f64 {
    match divide(mask) {
        Division::Dense => 0.0,
        Division::Holes(windows, _) => {
            let area: usize = windows.iter().map(|window| window.pixels()).sum();
            area as f64 / mask.size().pixels() as f64
        }
        Division::Sparse => 1.0,
    }
}

/// Finds the holes of a mask.
pub fn divide(mask: &Mask) -> Division {
    let size = mask.size();
    let grid = Size::new(size.height.div_ceil(BLOCK), size.width.div_ceil(BLOCK));
    let mut empty = vec![true; grid.pixels()];
    empty.par_chunks_mut(grid.width.max(1)).enumerate().for_each(|(row, empty)| {
        for y in row * BLOCK..size.height.min((row + 1) * BLOCK) {
            for (empty, block) in empty.iter_mut().zip(mask.row(y).chunks(BLOCK)) {
                *empty &= !block.contains(&true);
            }
        }
    });
    if !empty.contains(&true) {
        return Division::Dense;
    }
    let near = dilate(&empty, grid, MARGIN);
    if near.iter().filter(|&&near| near).count() as f64 > MOST * near.len() as f64 {
        return Division::Sparse;
    }
    let windows = rectangles(near, grid, size);
    let area: usize = windows.iter().map(|window| window.pixels()).sum();
    if area as f64 > MOST * size.pixels() as f64 {
        return Division::Sparse;
    }
    let close = dilate(&empty, grid, 1);
    let mut held = Vec::with_capacity(size.pixels());
    for y in 0..size.height {
        held.extend((0..size.width).map(|x| close[y / BLOCK * grid.width + x / BLOCK]));
    }
    Division::Holes(windows, held)
}

/// Marks the blocks within `radius` of marked ones.
fn dilate(marks: &[bool], grid: Size, radius: usize) -> Vec<bool> {
    let mut result = vec![false; marks.len()];
    for (k, _) in marks.iter().enumerate().filter(|(_, marked)| **marked) {
        let (y, x) = (k / grid.width, k % grid.width);
        for i in y.saturating_sub(radius)..grid.height.min(y + radius + 1) {
            result
                [i * grid.width + x.saturating_sub(radius)..i * grid.width + grid.width.min(x + radius + 1)]
                .fill(true);
        }
    }
    result
}

/// Disjoint rectangles in pixels around the connected sets of marked blocks.
fn rectangles(mut marks: Vec<bool>, grid: Size, size: Size) -> Vec<Window> {
    let mut boxes = Vec::new();
    for start in 0..marks.len() {
        if !marks[start] {
            continue;
        }
        let mut stack = vec![start];
        marks[start] = false;
        let (mut low, mut high) = ((usize::MAX, usize::MAX), (0, 0));
        while let Some(k) = stack.pop() {
            let (y, x) = (k / grid.width, k % grid.width);
            low = (low.0.min(y), low.1.min(x));
            high = (high.0.max(y + 1), high.1.max(x + 1));
            for (i, j) in [(y.wrapping_sub(1), x), (y + 1, x), (y, x.wrapping_sub(1)), (y, x + 1)] {
                if i < grid.height && j < grid.width && marks[i * grid.width + j] {
                    marks[i * grid.width + j] = false;
                    stack.push(i * grid.width + j);
                }
            }
        }
        boxes.push(pixels(low, high, size));
    }
    merge(boxes, size)
}

/// A rectangle of blocks in pixels; see [`aligned`].
fn pixels(low: (usize, usize), high: (usize, usize), size: Size) -> Window {
    let (y, x) = (low.0 * BLOCK, low.1 * BLOCK);
    let (bottom, right) = ((high.0 * BLOCK).min(size.height), (high.1 * BLOCK).min(size.width));
    aligned(Window { y, x, height: bottom - y, width: right - x }, size)
}

/// The rectangle, larger by as little as makes it begin and end where the coarse cells of its multigrid do.
fn aligned(window: Window, size: Size) -> Window {
    let step = window.height.max(window.width).div_ceil(DIRECT).next_power_of_two().max(BLOCK);
    let span = |from: usize, length: usize, n: usize| {
        let start = from / step * step;
        (start, (from + length).next_multiple_of(step).min(n) - start)
    };
    let ((y, height), (x, width)) =
        (span(window.y, window.height, size.height), span(window.x, window.width, size.width));
    Window { y, x, height, width }
}

/// Joins rectangles that overlap until none do.
fn merge(mut boxes: Vec<Window>, size: Size) -> Vec<Window> {
    let overlap = |a: &Window, b: &Window| {
        a.y < b.y + b.height && b.y < a.y + a.height && a.x < b.x + b.width && b.x < a.x + a.width
    };
    let mut done: Vec<Window> = Vec::new();
    while let Some(mut window) = boxes.pop() {
        while let Some(k) = done.iter().position(|other| overlap(&window, other)) {
            let other = done.swap_remove(k);
            let (y, x) = (window.y.min(other.y), window.x.min(other.x));
            let bottom = (window.y + window.height).max(other.y + other.height);
            let right = (window.x + window.width).max(other.x + other.width);
            window = aligned(Window { y, x, height: bottom - y, width: right - x }, size);
        }
        done.push(window);
    }
    done
}
