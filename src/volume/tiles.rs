//! Tiles of an image: where they are, and how what was rendered of their pixels becomes planes.

use lacuna_core::Size;
use lacuna_core::parallel::prelude::*;

/// Pixels along each edge of a tile.
const TILE: usize = 16;

/// Number of tiles of an image.
pub const fn tiles(size: Size) -> usize {
    size.width.div_ceil(TILE) * size.height.div_ceil(TILE)
}

/// What was rendered of a tile.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Done {
    /// Which of its pixels, row by row.
    pub places: Vec<u8>,
    /// Of each as many numbers as there are planes.
    pub numbers: Vec<f32>,
}

/// First row and column of a tile.
fn corner(size: Size, number: usize) -> (usize, usize) {
    let columns = size.width.div_ceil(TILE);
    (number / columns * TILE, number % columns * TILE)
}

/// The pixels of a tile that the mask (`size`, row-major) asks for, all without one: place in the tile, row and column, row by row.
#[inline(always)]
pub fn pixels(
    size: Size,
    mask: Option<&[bool]>,
    number: usize,
) -> impl Iterator<Item = (u8, (usize, usize))> {
    let (top, left) = corner(size, number);
    let (bottom, right) = ((top + TILE).min(size.height), (left + TILE).min(size.width));
    (top..bottom)
        .flat_map(move |y| (left..right).map(move |x| (((y - top) * TILE + x - left) as u8, (y, x))))
        .filter(move |&(_, (y, x))| mask.is_none_or(|mask| mask[y * size.width + x]))
}

/// Brings the numbers of rendered pixels into the planes.
pub fn put(size: Size, tiles: &[Done], mut planes: Vec<&mut Vec<f32>>) {
    let count = planes.len();
    planes.par_chunks_mut(1).enumerate().for_each(|(k, planes)| {
        for (number, done) in tiles.iter().enumerate() {
            let (top, left) = corner(size, number);
            for (place, numbers) in done.places.iter().zip(done.numbers.chunks_exact(count)) {
                let place = usize::from(*place);
                planes[0][(top + place / TILE) * size.width + left + place % TILE] = numbers[k];
            }
        }
    });
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
                let done = |tile: usize| Done {
                    places: pixels(size, mask, tile).map(|(place, _)| place).collect(),
                    numbers: pixels(size, mask, tile).flat_map(|(_, pixel)| of(pixel)).collect(),
                };
                let mut planes = vec![vec![0.0; size.pixels()]; 3];
                put(size, &(0..tiles(size)).map(done).collect::<Vec<_>>(), planes.iter_mut().collect());
                for (y, x) in (0..height).flat_map(|y| (0..width).map(move |x| (y, x))) {
                    let found = [0, 1, 2].map(|k| planes[k][y * width + x]);
                    let measured = mask.is_none_or(|mask| mask[y * width + x]);
                    assert_eq!(found, if measured { of((y, x)) } else { [0.0; 3] }, "{size:?} {y} {x}");
                }
            }
        }
    }
}
