//! Tiles of an image: where they are, and how what was rendered of their pixels becomes planes.

use lacuna_core::Size;
use lacuna_core::parallel::prelude::*;

/// Pixels along each edge of a tile.
const TILE: usize = 16;

/// Number of tiles of an image.
pub const fn tiles(size: Size) -> usize {
    size.width.div_ceil(TILE) * size.height.div_ceil(TILE)
}

/// The pixels of a tile that the mask (`size`, row-major) asks for, all without one: row and column, row by row.
#[inline(always)]
pub fn pixels(size: Size, mask: Option<&[bool]>, number: usize) -> impl Iterator<Item = (usize, usize)> {
    let columns = size.width.div_ceil(TILE);
    let (top, left) = (number / columns * TILE, number % columns * TILE);
    let (bottom, right) = ((top + TILE).min(size.height), (left + TILE).min(size.width));
    (top..bottom)
        .flat_map(move |y| (left..right).map(move |x| (y, x)))
        .filter(move |&(y, x)| mask.is_none_or(|mask| mask[y * size.width + x]))
}

/// Planes from `count` numbers for every rendered pixel, tile by tile; zeros elsewhere and where a tile has none.
pub fn planes(size: Size, mask: Option<&[bool]>, tiles: &[Vec<f32>], count: usize) -> Vec<Vec<f32>> {
    let plane = |k: usize| {
        let mut plane = vec![0.0; size.pixels()];
        for (number, numbers) in tiles.iter().enumerate() {
            for ((y, x), numbers) in pixels(size, mask, number).zip(numbers.chunks_exact(count)) {
                plane[y * size.width + x] = numbers[k];
            }
        }
        plane
    };
    (0..count).into_par_iter().map(plane)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_pixel_has_its_numbers_in_the_planes() {
        for (height, width) in [(1, 1), (1, 40), (33, 1), (16, 32), (35, 50)] {
            let size = Size::new(height, width);
            let flag = |at: usize| !(3 * (at / width) + at % width).is_multiple_of(4);
            let mask: Vec<bool> = (0..size.pixels()).map(flag).collect();
            for mask in [None, Some(mask.as_slice())] {
                let of = |(y, x): (usize, usize)| [y as f32, x as f32, 1.0];
                let numbers: Vec<Vec<f32>> =
                    (0..tiles(size)).map(|tile| pixels(size, mask, tile).flat_map(of).collect()).collect();
                let planes = planes(size, mask, &numbers, 3);
                for (y, x) in (0..height).flat_map(|y| (0..width).map(move |x| (y, x))) {
                    let found = [0, 1, 2].map(|k| planes[k][y * width + x]);
                    let measured = mask.is_none_or(|mask| mask[y * width + x]);
                    assert_eq!(found, if measured { of((y, x)) } else { [0.0; 3] }, "{size:?} {y} {x}");
                }
            }
        }
    }
}
