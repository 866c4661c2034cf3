//! An image as overlapping square blocks, and back by averaging.
//!
//! Blocks start every `stride` rows and columns from the first pixel on; the last ones end with the image. An image that is
//! smaller than a block lies in the first corner of one, the rest of which counts as missing.

use crate::{Mask, Plane, Size};

/// Where the blocks of an image lie.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Grid {
    size: Size,
    block: usize,
    rows: Vec<usize>,
    columns: Vec<usize>,
}

impl Grid {
    /// Blocks of `block x block` pixels every `stride` pixels, both at least 1; strides above the block count as the block.
    pub fn new(size: Size, block: usize, stride: usize) -> Self {
        let block = block.max(1);
        let stride = stride.clamp(1, block);
        let starts = |length: usize| {
            let last = length.saturating_sub(block);
            let mut starts: Vec<usize> = (0..last).step_by(stride).collect();
            starts.push(last);
            starts
        };
        Self { size, block, rows: starts(size.height), columns: starts(size.width) }
    }

    /// Number of blocks.
    pub fn len(&self) -> usize {
        self.rows.len() * self.columns.len()
    }

    /// Whether there is no block; never.
    pub fn is_empty(&self) -> bool {
        self.len() == 0
    }

    /// The lines of block `at` inside the image: for each, where it begins in the image and in the block, and its length.
    fn lines(&self, at: usize) -> impl Iterator<Item = (usize, usize, usize)> + use<> {
        let (y, x) = (self.rows[at / self.columns.len()], self.columns[at % self.columns.len()]);
        let (Size { height, width }, block) = (self.size, self.block);
        let (rows, columns) = (block.min(height - y), block.min(width - x));
        (0..rows).map(move |row| ((y + row) * width + x, row * block, columns))
    }

    /// The values of block `at`; zeros beyond the image.
    pub fn take(&self, plane: &[f32], at: usize, out: &mut [f32]) {
        out.fill(0.0);
        for (from, to, length) in self.lines(at) {
            out[to..to + length].copy_from_slice(&plane[from..from + length]);
        }
    }

    /// The measured pixels of block `at`; none beyond the image.
    pub fn flags(&self, mask: &Mask, at: usize) -> Vec<bool> {
        let mut flags = vec![false; self.block * self.block];
        for (from, to, length) in self.lines(at) {
            flags[to..to + length].copy_from_slice(&mask.as_slice()[from..from + length]);
        }
        flags
    }
}

/// A plane that blocks are laid on.
#[derive(Clone, Debug)]
pub struct Average {
    sums: Vec<f32>,
    counts: Vec<f32>,
}

impl Average {
    /// Nothing yet.
    pub fn new(size: Size) -> Self {
        Self { sums: vec![0.0; size.pixels()], counts: vec![0.0; size.pixels()] }
    }

    /// Lays block `at` on it.
    pub fn add(&mut self, grid: &Grid, at: usize, values: &[f32]) {
        for (to, from, length) in grid.lines(at) {
            let sums = self.sums[to..to + length].iter_mut().zip(&mut self.counts[to..to + length]);
            for ((sum, count), value) in sums.zip(&values[from..from + length]) {
                *sum += value;
                *count += 1.0;
            }
        }
    }

    /// Writes the means; returns which pixels no block lies on, which stay as they are.
    pub fn write(&self, plane: &mut Plane) -> Vec<bool> {
        let pixels = plane.pixels_mut().iter_mut().zip(self.sums.iter().zip(&self.counts));
        pixels
            .map(|(pixel, (sum, count))| {
                if *count > 0.0 {
                    *pixel = sum / count;
                }
                *count == 0.0
            })
            .collect()
    }
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    proptest! {
        #[test]
        fn blocks_cover_the_image_and_average_back_to_it(
            height in 1..40_usize, width in 1..40_usize, block in 1..12_usize, stride in 1..14_usize,
        ) {
            let size = Size::new(height, width);
            let grid = Grid::new(size, block, stride);
            let plane = Plane::from_fn(size, |y, x| (y * 41 + x) as f32);
            let full = Mask::from_fn(size, |_, _| true);
            let mut average = Average::new(size);
            let mut values = vec![0.0; block * block];
            let mut measured = 0;
            for at in 0..grid.len() {
                grid.take(plane.pixels(), at, &mut values);
                average.add(&grid, at, &values);
                measured += grid.flags(&full, at).iter().filter(|flag| **flag).count();
            }
            prop_assert_eq!(measured, grid.len() * block.min(height) * block.min(width));
            let mut back = Plane::filled(size, -1.0);
            prop_assert!(!average.write(&mut back).contains(&true));
            // Sums of one small whole number, again and again, are exact.
            prop_assert_eq!(back, plane);
        }
    }

    #[test]
    fn a_whole_block_as_stride_tiles_the_image() {
        assert_eq!(Grid::new(Size::new(288, 512), 16, 16).len(), 18 * 32);
        assert_eq!(Grid::new(Size::new(288, 512), 16, 8).len(), 35 * 63);
        // The last block ends with the image.
        assert_eq!(Grid::new(Size::new(17, 16), 16, 16).len(), 2);
    }
}
