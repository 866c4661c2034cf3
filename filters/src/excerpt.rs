//! A smaller image made of pixels of a frame, on which a method shows much of what it does on the frame, for less.

use std::sync::Arc;

use lacuna_core::parallel::prelude::*;

use crate::{Mask, Plane, Planes, Size};

/// Pixels of a tile's side, and of its border that its neighbours may reach.
#[derive(Clone, Copy, Debug)]
struct Tile {
    side: usize,
    border: usize,
}

impl Tile {
    /// By this factor.
    fn larger(self, factor: f64) -> Self {
        let border = (self.border as f64 * factor).ceil().min(f64::from(u16::MAX)) as usize;
        Self { side: self.side / self.border * border, border }
    }
}

/// Tiles of an estimate.
const WIDE: Tile = Tile { side: 128, border: 16 };
/// Tiles on which methods are compared: what crosses a narrow border disturbs all of them alike.
const NARROW: Tile = Tile { side: 96, border: 8 };
/// Windows in which pixels are chosen again.
const WINDOW: Tile = Tile { side: 256, border: 16 };
/// How many are drawn.
const WINDOWS: usize = 16;
/// Border of a tile, in spacings of its samples, beyond which its neighbours do not matter, though half of the samples are held out.
const FAR: f64 = 6.0;
/// Tiles are enlarged so often at most: where samples lie evenly, once or twice does.
const TRIES: usize = 4;
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
    sources: Vec<u32>,
    tile: Tile,
}

impl Excerpt {
    /// The pixels of a frame that `source` names, by row and column.
    pub(super) fn new(
        mask: Mask,
        frame: Size,
        source: impl Fn(usize, usize) -> (usize, usize) + Sync,
    ) -> Self {
        let size = mask.size();
        let index = |row, column| {
            let (row, column) = source(row, column);
            (row * frame.width + column) as u32
        };
        let sources = (0..size.height)
            .into_par_iter()
            .map(|row| (0..size.width).map(|column| index(row, column)).collect::<Vec<u32>>());
        Self { mask: Arc::new(mask), sources: sources.concat(), tile: WIDE }
    }

    /// Tiles that are spread over a large frame; nothing if it is hardly larger than these.
    pub fn tiles(frame: &Mask) -> Option<Self> {
        Self::of_tiles(frame, WIDE)
    }

    /// The same, as large as it takes for their neighbours not to matter.
    pub fn apart(frame: &Mask) -> Option<Self> {
        let mut tiles = Self::tiles(frame)?;
        for _ in 0..TRIES {
            let border = tiles.border();
            if border >= FAR {
                return Some(tiles);
            }
            tiles = Self::of_tiles(frame, tiles.tile.larger(FAR / border))?;
        }
        None
    }

    /// Smaller tiles, on which methods are compared.
    pub fn small_tiles(frame: &Mask) -> Option<Self> {
        Self::of_tiles(frame, NARROW)
    }

    /// Windows of a large frame, each for itself, with what the mean over a window's missing pixels counts for in one over those of the frame; none
    /// of a frame that is hardly larger. They are drawn with probabilities that go by how many samples each has (systematic sampling; M. Hansen,
    /// W. Hurwitz, "On the theory of sampling from finite populations", Annals of Mathematical Statistics 14, 1943).
    pub fn windows(frame: &Mask) -> Vec<(Self, f64)> {
        let (from, side) = (frame.size(), WINDOW.side);
        let (down, across) = (from.height / side, from.width / side);
        if down * across < 2 * WINDOWS || frame.is_empty() {
            return Vec::new();
        }
        let place = |k: usize, count: usize, length: usize| k * (length - side) / (count - 1).max(1);
        let corner = |k: usize| (place(k / across, down, from.height), place(k % across, across, from.width));
        let samples = |k: usize| {
            let (top, left) = corner(k);
            let rows = (top..top + side).map(|row| &frame.row(row)[left..left + side]);
            rows.flatten().filter(|flag| **flag).count()
        };
        let mut all: Vec<(usize, usize)> =
            (0..down * across).into_par_iter().map(|k| (samples(k), k)).into_iter().collect();
        all.sort_unstable();
        let total: usize = all.iter().map(|(count, _)| count).sum();
        let missing = (all.len() * side * side - total).max(1) as f64;
        let drawn = |below: usize| (below * WINDOWS).div_ceil(total.max(1));
        let mut before = 0;
        let mut found = Vec::new();
        for (count, k) in all {
            let hits = drawn(before + count) - drawn(before);
            before += count;
            if hits == 0 {
                continue;
            }
            let (top, left) = corner(k);
            let source = move |row, column| (top + row, left + column);
            let mask = Mask::from_fn(Size::new(side, side), |row, column| {
                frame.is_measured(top + row, left + column)
            });
            let counts = (hits * total) as f64 / (WINDOWS * count) as f64;
            let share = counts * (side * side - count) as f64 / missing;
            found.push((Self { tile: WINDOW, ..Self::new(mask, from, source) }, share));
        }
        found
    }

    fn of_tiles(frame: &Mask, tile: Tile) -> Option<Self> {
        let (from, least) = (frame.size(), tile.side.max(WIDE.side) * ACROSS);
        if from.height < least || from.width < least || from.pixels() < LARGE * least * least {
            return None;
        }
        let place =
            |at: usize, length: usize| at / tile.side * (length - tile.side) / (ACROSS - 1) + at % tile.side;
        let source = |row, column| (place(row, from.height), place(column, from.width));
        let side = tile.side * ACROSS;
        let mask = Mask::from_fn(Size::new(side, side), |row, column| {
            let (row, column) = source(row, column);
            frame.is_measured(row, column)
        });
        Some(Self { tile, ..Self::new(mask, from, source) })
    }

    /// Whether the neighbours of a pixel's tile do not reach it.
    pub fn is_inner(&self, pixel: u32) -> bool {
        let Tile { side, border } = self.tile;
        let inner = |at: usize| (border..side - border).contains(&(at % side));
        let width = self.mask.size().width;
        inner(pixel as usize / width) && inner(pixel as usize % width)
    }

    /// The border of tiles in spacings of samples, those of the tile that has fewest.
    pub fn border(&self) -> f64 {
        let Tile { side, border } = self.tile;
        let mut counts = [0_u32; ACROSS * ACROSS];
        let width = self.mask.size().width;
        for (pixel, _) in self.mask.as_slice().iter().enumerate().filter(|(_, flag)| **flag) {
            counts[pixel / width / side * ACROSS + pixel % width / side] += 1;
        }
        let fewest = counts.into_iter().min().unwrap_or(0);
        (f64::from(fewest) / (side * side) as f64).sqrt() * border as f64
    }

    /// The pixel of the frame that a pixel is.
    pub fn source(&self, pixel: usize) -> usize {
        self.sources[pixel] as usize
    }

    /// A plane of the frame, as of these pixels.
    pub fn plane(&self, plane: &Plane) -> Plane {
        let values = self.sources.par_iter().with_min_len(1 << 14).map(|&at| plane.pixels()[at as usize]);
        Plane::of(self.mask.size(), values)
    }

    /// Planes of the frame.
    pub fn planes(&self, planes: &Planes) -> Planes {
        let one = |plane: &Plane| self.plane(plane);
        Planes::of(self.mask.size(), planes.as_slice().iter().map(one).collect())
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use lacuna_core::hash;

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
        // A fifth everywhere; nothing in one tile.
        assert!((excerpt.border() - 16.0 * f64::sqrt(0.2)).abs() < 0.1);
        let hole = Mask::from_fn(size, |row, column| row > 200 || column > 200);
        assert!(Excerpt::tiles(&hole).unwrap().border() < 1e-9);
        assert!(Excerpt::apart(&hole).is_none());
        // Fewer samples take larger tiles, as long as they are a part of the frame.
        let sparse = |size: Size| Mask::from_fn(size, |row, column| (row + 3 * column) % 10 == 0);
        let apart = Excerpt::apart(&sparse(Size::new(1200, 1200))).unwrap();
        assert!(apart.border() >= FAR && apart.sources.len() == 608 * 608, "{}", apart.sources.len());
        assert!(apart.sources.is_sorted_by(|a, b| a < b));
        assert!(Excerpt::apart(&sparse(size)).is_none());
        let few = Excerpt::small_tiles(&frame).unwrap();
        assert_eq!(few.sources.len(), 384 * 384);
        assert!(few.is_inner(8 * 384 + 87) && !few.is_inner(8 * 384 + 88));
        assert!(few.sources.is_sorted_by(|a, b| a < b));
        assert!(Excerpt::small_tiles(&Mask::from_fn(Size::new(800, 800), |_, _| true)).is_none());
        assert!(Excerpt::tiles(&Mask::from_fn(Size::new(500, 4000), |_, _| true)).is_none());
        assert!(Excerpt::tiles(&Mask::from_fn(Size::new(800, 800), |_, _| true)).is_none());
    }

    /// What goes by how many samples a window has is known exactly from any draw; what does not, on average.
    #[test]
    fn windows_stand_for_the_frame() {
        let size = Size::new(1300, 2100);
        let dense = |row: usize, column: usize| (column * 8 / 2100 + row * 5 / 1300) as u64;
        let frame = Mask::from_fn(size, |row, column| {
            hash(3, (row * 2100 + column) as u64) % 100 < 1 + dense(row, column)
        });
        let windows = Excerpt::windows(&frame);
        assert!((9..=16).contains(&windows.len()), "{}", windows.len());
        // A value of every missing pixel: the density of samples around it.
        let mean = |mask: &Mask| mask.count() as f64 / (mask.size().pixels() - mask.count()) as f64;
        let told: f64 = windows.iter().map(|(window, share)| share * mean(&window.mask)).sum();
        assert!((told / mean(&frame) - 1.0).abs() < 0.02, "{told} for {}", mean(&frame));
        for (window, _) in &windows {
            let at = window.source(0);
            assert_eq!(window.source(256 * 256 - 1) - at, 255 * 2100 + 255);
            assert_eq!(window.mask.as_slice()[300], frame.as_slice()[at + 2100 + 44]);
        }
        assert!(Excerpt::windows(&Mask::from_fn(Size::new(1080, 1920), |_, _| true)).is_empty());
    }
}
