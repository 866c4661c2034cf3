//! Blocks of cells and how far each is from one in which there is something to see, so that rays leap over empty space.
//!
//! A block is `EDGE^3` cells. It is occupied if any value that the interpolant may take in it can be seen: the bounds of
//! its voxels, the kernel's support included, are asked of the transfer function. For every block the distance to the
//! nearest occupied one is kept, in blocks, by the largest component (Chebyshev). At distance d all blocks within d - 1
//! are empty. For maxima along rays the largest value of each block is kept instead.
//!
//! Cost: three passes over the voxels for the bounds, two over the blocks for the distances; 1 byte a block of 8 cells.
//! Sources: A. Rosenfeld, J. L. Pfaltz, "Distance functions on digital pictures", Pattern Recognition 1, 1968 (two
//! passes); D. Cohen, Z. Sheffer, "Proximity clouds, an acceleration technique for 3D grid traversal", The Visual Computer 11, 1994.

use super::grid::Grid;
use super::lanes::LANES;

/// Cells along each edge of a block.
pub const EDGE: usize = 2;
/// Distances beyond this are cut.
const FARTHEST: u8 = 255;

/// Distances to occupied blocks; see the module.
#[derive(Clone, Debug, PartialEq)]
pub struct Blocks {
    counts: [usize; 3],
    distances: Vec<u8>,
    /// Empty, or the largest value in each block.
    highest: Vec<f32>,
}

impl Blocks {
    /// Asks `visible` of the bounds of every block, where `support` voxels before and after a cell count.
    pub fn new(grid: &Grid, support: (usize, usize), visible: impl Fn(f32, f32) -> bool + Sync) -> Self {
        let counts = grid.size().map(|n| n.div_ceil(EDGE));
        let mut distances =
            grid.blocks(EDGE, support, |low, high| if visible(low, high) { 0 } else { FARTHEST });
        sweep(&mut distances, counts, false);
        sweep(&mut distances, counts, true);
        Self { counts, distances, highest: Vec::new() }
    }

    /// No block is empty; the largest value of each follows from the bounds of its voxels by `most`.
    pub fn with_highest(grid: &Grid, support: (usize, usize), most: impl Fn(f32, f32) -> f32 + Sync) -> Self {
        let counts = grid.size().map(|n| n.div_ceil(EDGE));
        let highest = grid.blocks(EDGE, support, most);
        Self { counts, distances: vec![0; highest.len()], highest }
    }

    /// The numbers of the blocks that hold some cells.
    #[inline(always)]
    pub fn numbers(&self, [x, y, z]: &[[i32; LANES]; 3]) -> [u32; LANES] {
        // 32 bits are enough for 2^35 cells, and side by side they are multiplied at once.
        let block = |cell: i32| cell as u32 / EDGE as u32;
        let (nx, ny) = (self.counts[0] as u32, self.counts[1] as u32);
        let number = |k: usize| {
            block(x[k]).wrapping_add(nx.wrapping_mul(block(y[k]).wrapping_add(ny.wrapping_mul(block(z[k])))))
        };
        std::array::from_fn(number)
    }

    /// Distance of the block of that number: 0 if it is occupied.
    #[inline(always)]
    pub fn distance(&self, number: u32) -> u8 {
        self.distances[number as usize]
    }

    /// Whether a value in that block may be larger than this one.
    #[inline(always)]
    pub fn may_beat(&self, number: u32, value: f32) -> bool {
        self.highest.is_empty() || self.highest[number as usize] > value
    }
}

/// Half of the distance: every block, in order or in reverse, takes what the 13 neighbours before it have, and one more.
fn sweep(distances: &mut [u8], [nx, ny, nz]: [usize; 3], reverse: bool) {
    let row = |y: usize, z: usize| (z * ny + y) * nx;
    let turned = |k: usize, n: usize| if reverse { n - 1 - k } else { k };
    // The least of the rows before, with one entry more at either end.
    let mut least = vec![FARTHEST; nx + 2];
    for (z, y) in (0..nz).flat_map(|z| (0..ny).map(move |y| (z, y))) {
        least.fill(FARTHEST);
        let beside = |z: usize| (y.saturating_sub(1)..(y + 2).min(ny)).map(move |y| (y, z));
        let before = z.checked_sub(1).into_iter().flat_map(beside).chain(y.checked_sub(1).map(|y| (y, z)));
        for (y, z) in before {
            let start = row(turned(y, ny), turned(z, nz));
            for (least, value) in least[1..].iter_mut().zip(&distances[start..start + nx]) {
                *least = (*least).min(*value);
            }
        }
        let own = row(turned(y, ny), turned(z, nz));
        let mut last = FARTHEST;
        for x in (0..nx).map(|x| turned(x, nx)) {
            let around = least[x].min(least[x + 1]).min(least[x + 2]).min(last);
            last = distances[own + x].min(around.saturating_add(1));
            distances[own + x] = last;
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{Affine, Values};

    #[test]
    fn distances_are_those_to_the_nearest_occupied_block() {
        let size = [40, 23, 31];
        let mut values = vec![0_u8; size.iter().product()];
        for at in [[3, 20, 7], [38, 2, 30], [17, 12, 1]] {
            let at: [usize; 3] = at;
            values[at[0] + size[0] * (at[1] + size[1] * at[2])] = 9;
        }
        let grid = Grid::new(size, &Values::U8(values), Affine::spacing([1.0; 3])).unwrap();
        for support in [(0, 1), (1, 2)] {
            let blocks = Blocks::new(&grid, support, |_, high| high > 5.0);
            let counts = blocks.counts;
            let all = || {
                (0..counts[2]).flat_map(move |z| {
                    (0..counts[1]).flat_map(move |y| (0..counts[0]).map(move |x| [x, y, z]))
                })
            };
            // A block is occupied if one of its cells has an occupied voxel in its support.
            let occupied = |block: [usize; 3]| {
                let near = |axis: usize, k: usize| {
                    let first = (block[axis] * EDGE).saturating_sub(support.0);
                    (first..=block[axis] * EDGE + EDGE - 1 + support.1).contains(&k)
                };
                [[3, 20, 7], [38, 2, 30], [17, 12, 1]]
                    .iter()
                    .any(|at: &[usize; 3]| (0..3).all(|k| near(k, at[k])))
            };
            for block in all() {
                let to = |other: [usize; 3]| (0..3).map(|k| block[k].abs_diff(other[k])).max().unwrap();
                let expected = all().filter(|&other| occupied(other)).map(to).min().unwrap();
                let cells = block.map(|k| [(k * EDGE) as i32; LANES]);
                let number = blocks.numbers(&cells)[LANES - 1];
                assert_eq!(usize::from(blocks.distance(number)), expected, "{block:?}");
            }
        }
    }
}
