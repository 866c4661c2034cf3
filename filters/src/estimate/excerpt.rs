//! A smaller image made of pixels of a frame, on which a method shows much of what it does on the frame, for less.

use std::sync::Arc;

use lacuna_core::parallel::prelude::*;

use crate::{Mask, Plane, Planes, Size};

/// Side of a tile.
const TILE: usize = 128;
/// Pixels of a tile's border that its neighbours may reach.
const BORDER: usize = 16;
/// Tiles along each side of the excerpt.
const ACROSS: usize = 4;
/// Frames that have fewer pixels are no larger than tiles need: so many times what these hold.
const LARGE: usize = 3;

/// Pixels of a frame, put side by side as an image of their own.
#[derive(Clone, Debug)]
pub struct Excerpt {
    /// Which of its pixels were measured.
    pub mask: Arc<Mask>,
    /// The pixel of the frame that each is.
    pub(super) sources: Vec<u32>,
}

impl Excerpt {
    /// The pixels that `source` names, by row and column.
    pub(super) fn new(frame: &Mask, size: Size, source: impl Fn(usize, usize) -> (usize, usize)) -> Self {
        let width = frame.size().width;
        let sources: Vec<u32> = (0..size.pixels())
            .map(|pixel| source(pixel / size.width, pixel % size.width))
            .map(|(row, column)| (row * width + column) as u32)
            .collect();
        let flags = sources.iter().map(|&source| frame.as_slice()[source as usize]).collect();
        Self { mask: Arc::new(Mask::of(size, flags)), sources }
    }

    /// Tiles that are spread over a large frame; nothing if it is hardly larger than these.
    pub fn tiles(frame: &Mask) -> Option<Self> {
        let from = frame.size();
        let side = TILE * ACROSS;
        if from.height < side || from.width < side || from.pixels() < LARGE * side * side {
            return None;
        }
        let place = |at: usize, length: usize| at / TILE * (length - TILE) / (ACROSS - 1) + at % TILE;
        let source = |row, column| (place(row, from.height), place(column, from.width));
        Some(Self::new(frame, Size::new(side, side), source))
    }

    /// Whether the neighbours of a pixel's tile do not reach it.
    pub fn is_inner(&self, pixel: u32) -> bool {
        let inner = |at: usize| (BORDER..TILE - BORDER).contains(&(at % TILE));
        let width = self.mask.size().width;
        inner(pixel as usize / width) && inner(pixel as usize % width)
    }

    /// The border of tiles in spacings of samples.
    pub fn border(&self) -> f64 {
        self.mask.density().sqrt() * BORDER as f64
    }

    /// The pixel of the frame that a pixel is.
    pub fn source(&self, pixel: usize) -> usize {
        self.sources[pixel] as usize
    }

    /// Planes of the frame, as of these pixels.
    pub fn planes(&self, planes: &Planes) -> Planes {
        let one = |plane: &Plane| {
            let values = self.sources.par_iter().with_min_len(1 << 14).map(|&at| plane.pixels()[at as usize]);
            Plane::of(self.mask.size(), values)
        };
        Planes::of(self.mask.size(), planes.as_slice().iter().map(one).collect())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn tiles_are_pixels_of_the_frame_in_its_order() {
        let size = Size::new(900, 1200);
        let frame = Mask::from_fn(size, |row, column| (row + 3 * column) % 5 == 0);
        let excerpt = Excerpt::tiles(&frame).unwrap();
        let sources: Vec<usize> = (0..512 * 512).map(|pixel| excerpt.source(pixel)).collect();
        assert!(sources.is_sorted_by(|a, b| a < b));
        assert_eq!((sources[0], sources[512 * 512 - 1]), (0, 900 * 1200 - 1));
        let plane = Plane::from_fn(size, |row, column| (row * 1200 + column) as f32);
        let own = excerpt.planes(&Planes::of(size, vec![plane]));
        for (pixel, &source) in sources.iter().enumerate().step_by(97) {
            assert_eq!(excerpt.mask.as_slice()[pixel], frame.as_slice()[source]);
            assert!((own.as_slice()[0].pixels()[pixel] - source as f32).abs() < 0.5);
        }
        // Inside, neighbours are those of the frame.
        for pixel in (0..512 * 512).filter(|&pixel| excerpt.is_inner(pixel as u32)) {
            assert_eq!(sources[pixel + 16], sources[pixel] + 16);
            assert_eq!(sources[pixel - 16 * 512], sources[pixel] - 16 * 1200);
        }
        assert!(Excerpt::tiles(&Mask::from_fn(Size::new(500, 4000), |_, _| true)).is_none());
        assert!(Excerpt::tiles(&Mask::from_fn(Size::new(800, 800), |_, _| true)).is_none());
    }
}
