//! What a sweep over tiles must look at after the one before.
//!
//! A tile leaves the residual of its window within the tolerance. Only just beyond the window may it have made any: in a strip
//! around it as wide as the energy reaches, unless the tile there was solved later. A tile that did not come near enough is in
//! doubt as a whole, and so is what lies around other changes.

use crate::Size;
use crate::kernel::window::Window;

/// First and number of some rows or columns.
type Span = (usize, usize);

/// How the image is cut into tiles.
#[derive(Clone, Debug)]
pub struct Grid {
    /// The rows of each row of tiles.
    pub rows: Vec<Span>,
    /// The same of columns.
    pub columns: Vec<Span>,
    /// Whether the tiles are moved by half a tile.
    pub shifted: bool,
}

impl Grid {
    /// Tiles of about the same size, of at most so many rows and columns.
    pub fn new(size: Size, most: (usize, usize), shifted: bool) -> Self {
        Self { rows: cuts(size.height, most.0, shifted), columns: cuts(size.width, most.1, shifted), shifted }
    }
}

/// Cuts `n` rows or columns into parts of about the same length, at most `side`. Shifted by
/// half a part, the first and the last are half as long.
fn cuts(n: usize, side: usize, shifted: bool) -> Vec<Span> {
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

/// Distances from a tile, from and to, at which pixels feel its solution but were not solved with it.
#[derive(Clone, Copy, Debug)]
pub struct Felt {
    /// Where they begin.
    pub from: usize,
    /// Where they end.
    pub to: usize,
}

impl Seen {
    /// Whether the solution of a tile is felt in a window.
    pub fn touches(&self, window: &Window, felt: Felt) -> bool {
        self.near(*window, felt.to).next().is_some()
    }

    /// The tiles within `width` pixels of a window that were not left as they are: row, column and mark.
    fn near(&self, window: Window, width: usize) -> impl Iterator<Item = (usize, usize, Mark)> {
        let rows = self.grid.rows.iter().zip(&self.marks).enumerate();
        let rows = rows.filter(move |(_, (row, _))| within(**row, (window.y, window.height), width));
        rows.flat_map(move |(i, (_, marks))| {
            let tiles = self.grid.columns.iter().zip(marks).enumerate();
            tiles
                .filter(move |(_, (column, mark))| {
                    **mark != Mark::Quiet && within(**column, (window.x, window.width), width)
                })
                .map(move |(j, (_, &mark))| (i, j, mark))
        })
    }

    /// The rows of the strips above and below a tile that feel it and were not solved later, and the columns of those left and
    /// right of it. Even rows of tiles are solved first, each from left to right.
    fn strips(&self, i: usize, j: usize, felt: Felt) -> ([Span; 2], [Span; 2]) {
        let Grid { rows, columns, .. } = &self.grid;
        let solved = |i: usize, mut tiles: std::ops::Range<usize>| {
            let wide = |j: usize| columns.get(j).is_some_and(|column| column.1 >= felt.to);
            let own = |j: usize| self.marks[i].get(j) == Some(&Mark::Solved) && wide(j);
            rows[i].1 >= felt.to && tiles.all(own)
        };
        let around = j.saturating_sub(1)..columns.len().min(j + 2);
        let settled = |other: Option<usize>| {
            let Some(other) = other.filter(|&other| other < rows.len()) else { return true };
            other % 2 == 1 && solved(other, around.clone())
        };
        let Felt { from, to } = felt;
        let before = |(start, _): Span, settled: bool| {
            let first = start.saturating_sub(to);
            (first, if settled { 0 } else { start.saturating_sub(from) - first })
        };
        let after = |(start, length): Span, settled: bool| {
            (start + length + from, if settled { 0 } else { to - from })
        };
        let right = j + 1 == columns.len() || solved(i, j + 1..j + 2);
        (
            [before(rows[i], settled(i.checked_sub(1))), after(rows[i], settled(Some(i + 1)))],
            [before(columns[j], j == 0), after(columns[j], right)],
        )
    }
}

/// Whether two spans share anything once one is extended by `width` to either side.
const fn within(a: Span, b: Span, width: usize) -> bool {
    a.0 < b.0 + b.1 + width && b.0 < a.0 + a.1 + width
}

/// What two spans share, if they do.
fn common(a: Span, b: Span) -> Option<Span> {
    let (first, end) = (a.0.max(b.0), (a.0 + a.1).min(b.0 + b.1));
    (first < end).then(|| (first, end - first))
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
    /// What the sweep `before` leaves to doubt in a tile, when `changed` was changed besides.
    pub fn new(tile: Window, before: Option<&Seen>, changed: &[Window], felt: Felt) -> Self {
        let Some(before) = before else { return Self::Everywhere };
        let (down, across) = ((tile.y, tile.height), (tile.x, tile.width));
        let touches = |window: &Window| {
            let (rows, columns) = ((window.y, window.height), (window.x, window.width));
            within(rows, down, felt.to) && within(columns, across, felt.to)
        };
        if changed.iter().any(touches) {
            return Self::Everywhere;
        }
        let (mut rows, mut columns) = (Vec::new(), Vec::new());
        for (i, j, mark) in before.near(tile, felt.to) {
            if mark == Mark::Open {
                return Self::Everywhere;
            }
            let (lines, sides) = before.strips(i, j, felt);
            rows.extend(lines.into_iter().filter_map(|strip| common(strip, down)));
            columns.extend(sides.into_iter().filter_map(|strip| common(strip, across)));
        }
        for strips in [&mut rows, &mut columns] {
            strips.sort_unstable();
            strips.dedup();
        }
        let rows = rows.into_iter().map(|(y, height)| Window { y, height, ..tile });
        let columns = columns.into_iter().map(|(x, width)| Window { x, width, ..tile });
        Self::Along(rows.chain(columns).collect())
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

    const FELT: Felt = Felt { from: 5, to: 10 };

    /// What a sweep by half a tile looks at, pixel by pixel.
    fn looks(before: &Seen) -> Vec<bool> {
        let mut looked = vec![false; SIZE.pixels()];
        let grid = Grid::new(SIZE, (100, 100), !before.grid.shifted);
        for &(y, height) in &grid.rows {
            for &(x, width) in &grid.columns {
                let tile = Window { y, x, height, width };
                let Doubt::Along(parts) = Doubt::new(tile, Some(before), &[], FELT) else { panic!() };
                for part in parts {
                    assert!(part.y >= y && part.y + part.height <= y + height);
                    assert!(part.x >= x && part.x + part.width <= x + width);
                    for i in part.y..part.y + part.height {
                        looked[i * SIZE.width..][part.x..part.x + part.width].fill(true);
                    }
                }
            }
        }
        looked
    }

    /// Where a sweep leaves a residual: solving a tile settles its window and stirs what lies around it.
    fn left(sweep: &Seen) -> Vec<bool> {
        let mut stirred = vec![false; SIZE.pixels()];
        let Grid { rows, columns, .. } = &sweep.grid;
        for i in (0..rows.len()).step_by(2).chain((1..rows.len()).step_by(2)) {
            for j in (0..columns.len()).filter(|&j| sweep.marks[i][j] == Mark::Solved) {
                for (beyond, state) in [(FELT.to, true), (FELT.from, false)] {
                    let span = |(start, length): Span, n: usize| {
                        start.saturating_sub(beyond)..n.min(start + length + beyond)
                    };
                    for y in span(rows[i], SIZE.height) {
                        stirred[y * SIZE.width..][span(columns[j], SIZE.width)].fill(state);
                    }
                }
            }
        }
        stirred
    }

    #[test]
    fn looks_cover_what_a_sweep_leaves() {
        let all = seen(|_, _| Mark::Solved);
        let some = |k: usize| {
            seen(move |i, j| if (i * 7 + j * 5 + k * 3) % 4 < 2 { Mark::Solved } else { Mark::Quiet })
        };
        let one = seen(|i, j| if (i, j) == (1, 1) { Mark::Solved } else { Mark::Quiet });
        for sweep in [all.clone(), one, some(0), some(1), some(2), some(3)] {
            let (looked, left) = (looks(&sweep), left(&sweep));
            for (k, (looked, left)) in looked.iter().zip(&left).enumerate() {
                assert!(*looked || !left, "{} {}", k / SIZE.width, k % SIZE.width);
            }
        }
        // One strip at each border between tiles, and no more.
        let looked = looks(&all).into_iter().filter(|looked| *looked).count();
        let width = FELT.to - FELT.from;
        assert!(looked <= 2 * width * SIZE.width + 3 * width * SIZE.height, "{looked}");
    }

    #[test]
    fn open_tiles_and_other_changes_are_in_doubt_as_a_whole() {
        let tile = Window { y: 50, x: 50, height: 100, width: 100 };
        let open = seen(|i, j| if (i, j) == (1, 1) { Mark::Open } else { Mark::Quiet });
        assert_eq!(Doubt::new(tile, Some(&open), &[], FELT), Doubt::Everywhere);
        assert_eq!(Doubt::new(tile, None, &[], FELT), Doubt::Everywhere);
        let quiet = seen(|_, _| Mark::Quiet);
        assert_eq!(Doubt::new(tile, Some(&quiet), &[], FELT), Doubt::Along(Vec::new()));
        let hole = |x| Window { y: 60, x, height: 10, width: 10 };
        assert_eq!(Doubt::new(tile, Some(&quiet), &[hole(159)], FELT), Doubt::Everywhere);
        assert_eq!(Doubt::new(tile, Some(&quiet), &[hole(160)], FELT), Doubt::Along(Vec::new()));
        // Tile (1, 1) begins at column 100.
        let near = |x| Window { y: 150, x, height: 10, width: 10 };
        assert!(open.touches(&near(81), FELT) && !open.touches(&near(80), FELT));
        assert!(!quiet.touches(&near(120), FELT));
    }
}
