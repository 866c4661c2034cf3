//! How the data window of a part is cut into chunks, and how many chunks its levels have.

use lacuna_core::Size;

use super::{Compression, Layout};

/// The chunks of the full-resolution level: a grid of equal rectangles, the last row and column cut off.
#[derive(Clone, Copy, Debug)]
pub(super) struct Grid {
    size: Size,
    /// Rows and columns of a whole chunk; none is larger than the data window.
    pub(super) chunk: Size,
}

/// The pixels of one chunk, relative to the data window.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct Area {
    pub(super) top: usize,
    pub(super) left: usize,
    pub(super) size: Size,
}

impl Grid {
    /// `size` has at least one pixel, tiles have at least one.
    pub(super) fn new(size: Size, layout: Layout, compression: Compression) -> Self {
        let chunk = match layout {
            Layout::ScanLines => Size::new(compression.rows_per_chunk().min(size.height), size.width),
            Layout::Tiles { width, height } => {
                Size::new((height as usize).min(size.height), (width as usize).min(size.width))
            }
        };
        Self { size, chunk: Size::new(chunk.height.max(1), chunk.width.max(1)) }
    }

    /// Number of chunk rows.
    pub(super) fn rows(&self) -> usize {
        self.size.height.div_ceil(self.chunk.height)
    }

    /// Number of chunk columns; 1 for scan lines.
    pub(super) fn columns(&self) -> usize {
        self.size.width.div_ceil(self.chunk.width)
    }

    /// Number of chunks; saturates for windows that no file can fill.
    pub(super) fn count(&self) -> u64 {
        (self.rows() as u64).saturating_mul(self.columns() as u64)
    }

    /// The pixels of the chunk in that row and column of the grid.
    pub(super) fn area(&self, row: usize, column: usize) -> Area {
        let top = row * self.chunk.height;
        let left = column * self.chunk.width;
        let height = self.chunk.height.min(self.size.height.saturating_sub(top));
        let width = self.chunk.width.min(self.size.width.saturating_sub(left));
        Area { top, left, size: Size::new(height, width) }
    }
}

/// Which smaller versions of the image a tiled part holds.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Levels {
    One,
    Mip { round_up: bool },
    Rip { round_up: bool },
}

/// Number of chunks of all levels together; saturates.
pub(super) fn chunks_of_all_levels(
    size: Size,
    layout: Layout,
    compression: Compression,
    levels: Levels,
) -> u64 {
    let (round_up, rip) = match levels {
        Levels::One => return Grid::new(size, layout, compression).count(),
        Levels::Mip { round_up } => (round_up, false),
        Levels::Rip { round_up } => (round_up, true),
    };
    let extent = |full: usize, level: u32| {
        let step = 1_u64 << level;
        let full = full as u64;
        (if round_up { full.div_ceil(step) } else { full / step }).max(1) as usize
    };
    let count = |full: usize| (0..63).find(|&level| extent(full, level) == 1).unwrap_or(0) + 1;
    let chunks = |y: u32, x: u32| {
        Grid::new(Size::new(extent(size.height, y), extent(size.width, x)), layout, compression).count()
    };
    let sum = |total: u64, part: u64| total.saturating_add(part);
    if rip {
        let columns = count(size.width);
        (0..count(size.height))
            .flat_map(|y| (0..columns).map(move |x| (y, x)))
            .map(|(y, x)| chunks(y, x))
            .fold(0, sum)
    } else {
        (0..count(size.height.max(size.width))).map(|level| chunks(level, level)).fold(0, sum)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const TILES: Layout = Layout::Tiles { width: 4, height: 2 };

    #[test]
    fn chunks_cover_the_window_once() {
        for (height, width) in [(1, 1), (1, 9), (9, 1), (8, 8), (37, 21)] {
            for (layout, compression) in [(TILES, Compression::Zip), (Layout::ScanLines, Compression::Zip)] {
                let grid = Grid::new(Size::new(height, width), layout, compression);
                let mut covered = vec![0; height * width];
                for row in 0..grid.rows() {
                    for column in 0..grid.columns() {
                        let area = grid.area(row, column);
                        for y in area.top..area.top + area.size.height {
                            for x in area.left..area.left + area.size.width {
                                covered[y * width + x] += 1;
                            }
                        }
                    }
                }
                assert!(covered.iter().all(|&count| count == 1));
            }
        }
    }

    #[test]
    fn levels_are_counted_as_the_format_says() {
        let count = |levels| chunks_of_all_levels(Size::new(7, 5), TILES, Compression::None, levels);
        assert_eq!(count(Levels::One), 4 * 2);
        // 7x5, 3x2, 1x1 rounded down; 7x5, 4x3, 2x2, 1x1 rounded up (height x width).
        assert_eq!(count(Levels::Mip { round_up: false }), 8 + 2 + 1);
        assert_eq!(count(Levels::Mip { round_up: true }), 8 + 2 + 1 + 1);
        // Heights 7, 3, 1 in 4, 2, 1 tiles; widths 5, 2, 1 in 2, 1, 1.
        assert_eq!(count(Levels::Rip { round_up: false }), (4 + 2 + 1) * (2 + 1 + 1));
    }
}
