//! What of a window is worked on: cells of the finest grid where something is left to correct, and their share of every grid.
//!
//! All else is held at zero, on every grid, as measured pixels are (the coarsest is solved as a whole, and cut to what counts). The smoother takes what counts in patches: rectangles of the size
//! of its strips, cut where that leaves out more than is computed twice.

use std::ops::Range;

use crate::kernel::simd::MOST;
use crate::kernel::spans::Spans;
use crate::kernel::window::{PAD, Window};

/// Rows and columns of a cell on the finest grid.
pub const CELL: (usize, usize) = (16, 32);
/// Most rows and columns of a patch, whose rings of rows (300 kB in f32) are to be in L2.
const SIDES: (usize, usize) = (200, 400);
/// What a patch and what each of its rows cost beside their pixels, in pixels.
const OWN: (usize, usize) = (2000, 96);

/// A rectangle that the smoother takes at a time, in pixels of its grid's window.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Patch {
    /// Its rows.
    pub rows: Range<usize>,
    /// Its columns.
    pub columns: Range<usize>,
    /// It and what counts around it as far as its results depend on it. The columns begin at a multiple of [`MOST`].
    pub around: Window,
}

/// What counts on one grid.
#[derive(Clone, Debug)]
pub struct Share {
    /// The pixels.
    pub spans: Spans,
    /// Patches that hold them.
    pub patches: Vec<Patch>,
}

/// What counts on all grids.
#[derive(Clone, Debug, Default)]
pub struct Active {
    /// The cells of the finest grid, row by row.
    pub cells: Vec<bool>,
    /// From the finest grid to the coarsest.
    pub grids: Vec<Share>,
}

impl Active {
    /// Everything, on grids with these windows and pixels that a smoothing reaches.
    pub fn all(grids: &[(Window, usize)]) -> Self {
        let finest = grids.first().map_or_else(Window::default, |grid| grid.0);
        let count = finest.height.div_ceil(CELL.0) * finest.width.div_ceil(CELL.1);
        let share = |&(window, reach): &(Window, usize)| Share::new(window, reach, Spans::all(window));
        Self { cells: vec![true; count], grids: grids.iter().map(share).collect() }
    }

    /// These cells of the finest grid; of a coarser one what lies in them whole.
    pub fn new(grids: &[(Window, usize)], cells: Vec<bool>) -> Self {
        let mut spans = None;
        let share = |&(window, reach): &(Window, usize)| {
            let own = spans.as_ref().map_or_else(|| Spans::of_cells(window, CELL, &cells), Spans::halved);
            spans = Some(own.clone());
            Share::new(window, reach, own)
        };
        let grids = grids.iter().map(share).collect();
        Self { cells, grids }
    }
}

impl Share {
    fn new(window: Window, reach: usize, spans: Spans) -> Self {
        let cutter = Cutter { window, reach, spans: &spans };
        let mut patches = Vec::new();
        for rows in parts(window.height, SIDES.0, 1) {
            for columns in parts(window.width, SIDES.1, MOST) {
                let mut open = spans.boxes(rows.clone(), columns);
                while let Some((rows, columns)) = open.pop() {
                    let Some(patch) = cutter.patch(rows, columns) else { continue };
                    match cutter.halves(&patch) {
                        Some(halves) => open.extend(halves),
                        None => patches.push(patch),
                    }
                }
            }
        }
        Self { spans, patches }
    }

    /// Per patch the part of every row of a window's buffer that is its own.
    pub fn split<'a, T>(&self, window: Window, values: &'a mut [T]) -> Vec<Vec<&'a mut [T]>> {
        let stride = window.stride();
        let mut split: Vec<Vec<&mut [T]>> =
            self.patches.iter().map(|patch| Vec::with_capacity(patch.rows.len())).collect();
        let mut order: Vec<usize> = (0..self.patches.len()).collect();
        order
            .sort_by_key(|&k| std::cmp::Reverse((self.patches[k].rows.start, self.patches[k].columns.start)));
        let mut open: Vec<usize> = Vec::new();
        for (i, mut row) in values[PAD * stride..].chunks_mut(stride).take(window.height).enumerate() {
            open.retain(|&k| self.patches[k].rows.end > i);
            while let Some(k) = order.pop_if(|k| self.patches[*k].rows.start == i) {
                open.push(k);
            }
            open.sort_by_key(|&k| self.patches[k].columns.start);
            let mut at = 0;
            for &k in &open {
                let columns = &self.patches[k].columns;
                let own = row.split_off_mut(..PAD + columns.end - at).unwrap_or_default();
                split[k].push(&mut own[PAD + columns.start - at..]);
                at = PAD + columns.end;
            }
        }
        split
    }
}

/// Finds patches.
struct Cutter<'a> {
    window: Window,
    reach: usize,
    spans: &'a Spans,
}

impl Cutter<'_> {
    /// What counts in some rows and columns.
    fn patch(&self, rows: Range<usize>, columns: Range<usize>) -> Option<Patch> {
        let Self { window: Window { height, width, .. }, reach, spans } = *self;
        let rows = spans.rows(rows, columns.clone());
        let columns = spans.columns(rows.clone(), columns)?;
        let near = columns.start.saturating_sub(reach)..width.min(columns.end + reach);
        let tall = rows.start.saturating_sub(reach)..height.min(rows.end + reach);
        let tall = spans.rows(tall, near.clone());
        let near = spans.columns(tall.clone(), near)?;
        let (y, x) = (tall.start, near.start / MOST * MOST);
        let around = Window { y, x, height: tall.len(), width: near.end - x };
        Some(Patch { rows, columns, around })
    }

    /// Two parts of a patch, if together they are less work.
    fn halves(&self, patch: &Patch) -> Option<[(Range<usize>, Range<usize>); 2]> {
        let Patch { rows, columns, .. } = patch;
        let cost = |patch: &Patch| OWN.0 + patch.around.height * (OWN.1 + patch.around.width);
        let upright = (rows.start + 1..rows.end).filter(|&row| self.spans.changes(row));
        let upright =
            upright.map(|cut| [(rows.start..cut, columns.clone()), (cut..rows.end, columns.clone())]);
        let across = (columns.start + 1..columns.end).filter(|column| column.is_multiple_of(2 * MOST));
        let across = across.map(|cut| [(rows.clone(), columns.start..cut), (rows.clone(), cut..columns.end)]);
        let work = |halves: &[(Range<usize>, Range<usize>); 2]| -> usize {
            let patches = halves.iter().filter_map(|half| self.patch(half.0.clone(), half.1.clone()));
            patches.map(|patch| cost(&patch)).sum()
        };
        let least = upright.chain(across).map(|halves| (work(&halves), halves)).min_by_key(|half| half.0)?;
        (least.0 < cost(patch)).then_some(least.1)
    }
}

/// Cuts a length into parts of about the same size, at most `most`, that begin at multiples of `unit`.
pub fn parts(length: usize, most: usize, unit: usize) -> impl Iterator<Item = Range<usize>> {
    let side = length.div_ceil(length.div_ceil(most).max(1)).next_multiple_of(unit).max(1);
    (0..length).step_by(side).map(move |first| first..length.min(first + side))
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Whatever counts: every pixel that does is in one patch, with all that counts within reach around it.
    #[test]
    fn patches_hold_what_counts_and_what_it_depends_on() {
        let reach = 15;
        for (height, width) in [(5, 9), (130, 290), (470, 900)] {
            let window = Window { y: 0, x: 0, height, width };
            let count = height.div_ceil(CELL.0) * width.div_ceil(CELL.1);
            for every in [1, 2, 3, 7, 50] {
                let cells: Vec<bool> = (0..count).map(|k| (k * 7919 + 13) % 101 % every == 0).collect();
                let active = Active::new(&[(window, reach)], cells);
                let Share { spans, patches } = &active.grids[0];
                let mut held = vec![0_usize; window.len()];
                for patch in patches {
                    assert!(patch.rows.len() <= SIDES.0 && patch.columns.len() <= SIDES.1);
                    assert_eq!(patch.around.x % MOST, 0);
                    for i in patch.rows.clone() {
                        patch.columns.clone().for_each(|j| held[window.at(i, j)] += 1);
                    }
                    let near =
                        |at: usize, range: &Range<usize>| at + reach >= range.start && at < range.end + reach;
                    for i in (0..height).filter(|&i| near(i, &patch.rows)) {
                        for j in
                            spans.row(i).iter().flat_map(Clone::clone).filter(|&j| near(j, &patch.columns))
                        {
                            let Window { y, x, height, width } = patch.around;
                            assert!(
                                (y..y + height).contains(&i) && (x..x + width).contains(&j),
                                "{patch:?} {i} {j}"
                            );
                        }
                    }
                }
                for i in 0..height {
                    for j in 0..width {
                        let counts = spans.row(i).iter().any(|span| span.contains(&j));
                        let held = held[window.at(i, j)];
                        assert!(held <= 1 && (held == 1 || !counts), "{i} {j}: {held}");
                    }
                }
                // The rows that patches are given.
                let mut places: Vec<usize> = (0..window.len()).collect();
                for (patch, rows) in patches.iter().zip(active.grids[0].split(window, &mut places)) {
                    assert_eq!(rows.len(), patch.rows.len());
                    for (i, row) in patch.rows.clone().zip(rows) {
                        assert_eq!(
                            (row[0], row.len()),
                            (window.at(i, patch.columns.start), patch.columns.len())
                        );
                    }
                }
            }
        }
    }
}
