//! What a sweep over tiles must look at after the one before.
//!
//! A tile leaves its own residual within the tolerance. Only where its neighbours have changed what lies around their
//! common border, later than it was solved, may anything be left: in bands along the borders of the tiles that were
//! solved. A tile that did not come near enough is in doubt as a whole, and so is what lies around other changes.

use crate::Size;
use crate::kernel::stencil::Window;

/// How the image is cut into tiles.
#[derive(Clone, Debug)]
pub struct Grid {
    /// First and number of the rows of each row of tiles.
    pub rows: Vec<(usize, usize)>,
    /// The same of columns.
    pub columns: Vec<(usize, usize)>,
    /// Whether the tiles are moved by half a tile.
    pub shifted: bool,
}

impl Grid {
    /// Tiles of about the same size, of at most so many rows and columns.
    pub fn new(size: Size, most: (usize, usize), shifted: bool) -> Self {
        Self { rows: cuts(size.height, most.0, shifted), columns: cuts(size.width, most.1, shifted), shifted }
    }
}

/// Cuts `n` rows or columns into parts of about the same length, at most `side`: first and number of each. Shifted by
/// half a part, the first and the last are half as long.
fn cuts(n: usize, side: usize, shifted: bool) -> Vec<(usize, usize)> {
    let count = n.div_ceil(side);
    let mut edges = vec![0];
    if shifted {
        edges.extend((0..count).map(|k| (2 * k + 1) * n / (2 * count)));
    } else {
        edges.extend((1..count).map(|k| k * n / count));
    }
    edges.push(n);
    edges.windows(2).map(|pair| (pair[0], pair[1] - pair[0])).collect()
}

/// What a sweep did with a tile.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Mark {
    /// It was left as it is.
    Quiet,
    /// It was solved.
    Solved,
    /// It may have more error than it should.
    Open,
}

impl Mark {
    /// After so many steps, `enough` of them or not.
    pub const fn new(steps: usize, enough: bool) -> Self {
        match (steps, enough) {
            (_, false) => Self::Open,
            (0, true) => Self::Quiet,
            (_, true) => Self::Solved,
        }
    }
}

/// A sweep as the next one needs to know it.
#[derive(Clone, Debug)]
pub struct Seen {
    /// Its tiles.
    pub grid: Grid,
    /// Their marks, row by row. A row that was interrupted is short.
    pub marks: Vec<Vec<Mark>>,
}

impl Seen {
    /// Whether a tile that was solved lies within `width` pixels of a window.
    pub fn touches(&self, window: &Window, width: usize) -> bool {
        self.near(*window, width).next().is_some()
    }

    /// The tiles within `width` pixels of a window that were not left as they are.
    fn near(&self, window: Window, width: usize) -> impl Iterator<Item = (Window, Mark)> {
        let rows = self.grid.rows.iter().zip(&self.marks);
        let rows = rows.filter(move |(row, _)| within(**row, (window.y, window.height), width));
        rows.flat_map(move |(&(y, height), marks)| {
            let tiles = self.grid.columns.iter().zip(marks);
            tiles
                .filter(move |(column, mark)| {
                    **mark != Mark::Quiet && within(**column, (window.x, window.width), width)
                })
                .map(move |(&(x, width), &mark)| (Window { y, x, height, width }, mark))
        })
    }
}

/// Whether two ranges, first and length of each, share anything once one is extended by `width` to either side.
const fn within(a: (usize, usize), b: (usize, usize), width: usize) -> bool {
    a.0 < b.0 + b.1 + width && b.0 < a.0 + a.1 + width
}

/// Where something may be left in a tile.
#[derive(Debug, PartialEq, Eq)]
pub enum Doubt {
    /// In all of it.
    Everywhere,
    /// In these parts of it.
    Along(Vec<Window>),
}

impl Doubt {
    /// What the sweep `before` leaves to doubt in a tile, when `changed` was changed besides. Changes are felt `width` pixels
    /// away.
    pub fn new(tile: Window, before: Option<&Seen>, changed: &[Window], width: usize) -> Self {
        let Some(before) = before else { return Self::Everywhere };
        let (down, across) = ((tile.y, tile.height), (tile.x, tile.width));
        let touches = |window: &Window| {
            within((window.y, window.height), down, width) && within((window.x, window.width), across, width)
        };
        if changed.iter().any(touches) {
            return Self::Everywhere;
        }
        let (mut rows, mut columns) = (Vec::new(), Vec::new());
        for (own, mark) in before.near(tile, width) {
            if mark == Mark::Open {
                return Self::Everywhere;
            }
            let (lines, sides) = ([own.y, own.y + own.height], [own.x, own.x + own.width]);
            rows.extend(lines.into_iter().filter(|&line| within((line, 0), down, width)));
            columns.extend(sides.into_iter().filter(|&line| within((line, 0), across, width)));
        }
        let band = |line: usize, from: usize, length: usize| {
            let start = line.saturating_sub(width).max(from);
            (start, (line + width).min(from + length) - start)
        };
        let mut bands = Vec::new();
        for lines in [&mut rows, &mut columns] {
            lines.sort_unstable();
            lines.dedup();
        }
        for line in rows {
            let (y, height) = band(line, tile.y, tile.height);
            bands.push(Window { y, height, ..tile });
        }
        for line in columns {
            let (x, across) = band(line, tile.x, tile.width);
            bands.push(Window { x, width: across, ..tile });
        }
        Self::Along(bands)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const SIZE: Size = Size::new(300, 400);

    fn seen(mark: impl Fn(usize, usize) -> Mark) -> Seen {
        let grid = Grid::new(SIZE, (100, 100), false);
        let marks = (0..grid.rows.len()).map(|i| (0..grid.columns.len()).map(|j| mark(i, j)).collect());
        Seen { marks: marks.collect(), grid }
    }

    #[test]
    fn tiles_cover_the_image_once() {
        for shifted in [false, true] {
            let grid = Grid::new(Size::new(1, 401), (100, 100), shifted);
            for (parts, n) in [(&grid.rows, 1), (&grid.columns, 401)] {
                let mut next = 0;
                for &(start, length) in parts {
                    assert_eq!(start, next);
                    next += length;
                }
                assert_eq!(next, n);
            }
        }
    }

    #[test]
    fn bands_cover_what_solved_tiles_leave_in_doubt() {
        let width = 9;
        let marks = seen(|i, j| if (i, j) == (1, 1) { Mark::Solved } else { Mark::Quiet });
        let solved = Window { y: 100, x: 100, height: 100, width: 100 };
        let mut doubted = vec![false; SIZE.pixels()];
        let grid = Grid::new(SIZE, (100, 100), true);
        for &(y, height) in &grid.rows {
            for &(x, across) in &grid.columns {
                let tile = Window { y, x, height, width: across };
                let Doubt::Along(bands) = Doubt::new(tile, Some(&marks), &[], width) else { panic!() };
                for band in bands {
                    assert!(band.y >= y && band.y + band.height <= y + height);
                    assert!(band.x >= x && band.x + band.width <= x + across);
                    for i in band.y..band.y + band.height {
                        doubted[i * SIZE.width..][band.x..band.x + band.width].fill(true);
                    }
                }
            }
        }
        for i in 0..SIZE.height {
            for j in 0..SIZE.width {
                let to = |a: usize, from: usize, length: usize| {
                    // Distance of a pixel to the two borders, and whether it is between or beside them by less.
                    let (low, high) = (from.abs_diff(a), (from + length).abs_diff(a));
                    (low.min(high) < width, a + width >= from && a < from + length + width)
                };
                let ((line, along), (column, across)) =
                    (to(i, solved.y, solved.height), to(j, solved.x, solved.width));
                if (line && across) || (column && along) {
                    assert!(doubted[i * SIZE.width + j], "{i} {j}");
                }
            }
        }
    }

    #[test]
    fn open_tiles_and_other_changes_are_in_doubt_as_a_whole() {
        let tile = Window { y: 50, x: 50, height: 100, width: 100 };
        let open = seen(|i, j| if (i, j) == (1, 1) { Mark::Open } else { Mark::Quiet });
        assert_eq!(Doubt::new(tile, Some(&open), &[], 9), Doubt::Everywhere);
        assert_eq!(Doubt::new(tile, None, &[], 9), Doubt::Everywhere);
        let quiet = seen(|_, _| Mark::Quiet);
        assert_eq!(Doubt::new(tile, Some(&quiet), &[], 9), Doubt::Along(Vec::new()));
        let hole = |x| Window { y: 60, x, height: 10, width: 10 };
        assert_eq!(Doubt::new(tile, Some(&quiet), &[hole(158)], 9), Doubt::Everywhere);
        assert_eq!(Doubt::new(tile, Some(&quiet), &[hole(159)], 9), Doubt::Along(Vec::new()));
        // Tile (1, 1) begins at column 100.
        let near = |x| Window { y: 150, x, height: 10, width: 10 };
        assert!(open.touches(&near(82), 9) && !open.touches(&near(81), 9) && !quiet.touches(&near(120), 9));
    }
}
