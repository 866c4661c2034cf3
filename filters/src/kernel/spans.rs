//! Which pixels of a window count: spans of columns, row by row.
//!
//! Whoever works on a window where little is left to do goes by these spans, and treats the pixels between them as held at zero.

use std::ops::Range;

use super::Real;
use super::window::{PAD, Window};

/// Rows that one task clears.
const CHUNK: usize = 32;

/// Spans of columns for every row of a window.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Spans {
    width: usize,
    /// Rows that have the same spans, and which of these are theirs.
    bands: Vec<(Range<usize>, Range<usize>)>,
    /// Per row its band.
    rows: Vec<usize>,
    /// In order within a band, not empty, and apart from each other.
    ranges: Vec<Range<usize>>,
}

impl Spans {
    /// All of a window.
    pub fn all(window: Window) -> Self {
        let mut all = Self::none(window.width);
        all.push(0, 0..window.width);
        all.end(0, window.height);
        all
    }

    fn none(width: usize) -> Self {
        Self { width, bands: Vec::new(), rows: Vec::new(), ranges: Vec::new() }
    }

    /// Those cells of a window that count: row by row, each `cell` pixels high and wide, less at the ends.
    pub fn of_cells(window: Window, cell: (usize, usize), counts: &[bool]) -> Self {
        let mut result = Self::none(window.width);
        for (k, counts) in counts.chunks(window.width.div_ceil(cell.1)).enumerate() {
            let first = result.ranges.len();
            for (column, _) in counts.iter().enumerate().filter(|(_, counts)| **counts) {
                result.push(first, column * cell.1..window.width.min((column + 1) * cell.1));
            }
            result.end(first, cell.0.min(window.height - k * cell.0));
        }
        result
    }

    /// The cells of a grid of half the resolution all of whose pixels count.
    pub fn halved(&self) -> Self {
        let width = self.width.div_ceil(2);
        let mut result = Self::none(width);
        let mut i = 0;
        while i < self.rows.len() {
            let (upper, lower) = (self.rows[i], self.rows[(i + 1).min(self.rows.len() - 1)]);
            let first = result.ranges.len();
            for a in self.band(upper) {
                for b in self.band(lower) {
                    let (start, end) = (a.start.max(b.start), a.end.min(b.end));
                    let end = if end == self.width { width } else { end / 2 };
                    result.push(first, start.div_ceil(2)..end);
                }
            }
            // Pairs of rows of one band have the same spans; the last row may be without another.
            let left = self.bands[upper].0.end - i;
            let pairs = if left == 1 || i + left == self.rows.len() { left.div_ceil(2) } else { left / 2 };
            result.end(first, pairs);
            i += 2 * pairs;
        }
        result
    }

    /// Adds a span to the latest rows, whose spans begin with number `first`.
    fn push(&mut self, first: usize, span: Range<usize>) {
        if span.is_empty() {
            return;
        }
        match self.ranges[first..].last_mut() {
            Some(last) if last.end >= span.start => last.end = span.end,
            _ => self.ranges.push(span),
        }
    }

    /// Ends so many rows, whose spans begin with number `first`.
    fn end(&mut self, first: usize, height: usize) {
        let top = self.rows.len();
        self.rows.extend(std::iter::repeat_n(self.bands.len(), height));
        self.bands.push((top..top + height, first..self.ranges.len()));
    }

    fn band(&self, band: usize) -> &[Range<usize>] {
        &self.ranges[self.bands[band].1.clone()]
    }

    /// The spans of a row.
    #[inline(always)]
    pub fn row(&self, i: usize) -> &[Range<usize>] {
        self.band(self.rows[i])
    }

    /// Whether a row (not the first) may have other spans than the one above.
    pub fn changes(&self, i: usize) -> bool {
        self.rows[i] != self.rows[i - 1]
    }

    /// The spans within some columns, per band of some rows that has any, with these rows.
    fn within(
        &self,
        rows: Range<usize>,
        columns: Range<usize>,
    ) -> impl Iterator<Item = (Range<usize>, impl Iterator<Item = Range<usize>>)> {
        let bands = if rows.is_empty() { 0..0 } else { self.rows[rows.start]..self.rows[rows.end - 1] + 1 };
        bands.filter_map(move |band| {
            let own = &self.bands[band].0;
            let (start, end) = (columns.start, columns.end);
            let cut = move |span: &Range<usize>| span.start.max(start)..span.end.min(end);
            let mut spans = self.band(band).iter().map(cut).filter(|span| !span.is_empty()).peekable();
            spans.peek()?;
            Some((own.start.max(rows.start)..own.end.min(rows.end), spans))
        })
    }

    /// The least range of columns, out of some, that holds all that count in these rows; `None` if none does.
    pub fn columns(&self, rows: Range<usize>, columns: Range<usize>) -> Option<Range<usize>> {
        let spans = self.within(rows, columns).flat_map(|(_, spans)| spans);
        spans.reduce(|a, b| a.start.min(b.start)..a.end.max(b.end))
    }

    /// The least range of rows, out of some, that holds all that have pixels in these columns.
    pub fn rows(&self, rows: Range<usize>, columns: Range<usize>) -> Range<usize> {
        let none = rows.start..rows.start;
        self.within(rows, columns).map(|(rows, _)| rows).reduce(|a, b| a.start..b.end).unwrap_or(none)
    }

    /// Rectangles that hold all that counts within some rows and columns, cut apart wherever rows or columns between them are
    /// empty.
    pub fn boxes(&self, rows: Range<usize>, columns: Range<usize>) -> Vec<(Range<usize>, Range<usize>)> {
        let (mut open, mut done) = (vec![(rows, columns)], Vec::new());
        while let Some((rows, columns)) = open.pop() {
            let tall = join(self.within(rows, columns.clone()).map(|(rows, _)| rows));
            let wide: Vec<_> = tall.iter().map(|rows| self.sides(rows.clone(), columns.clone())).collect();
            if let ([rows], [sides]) = (tall.as_slice(), wide.as_slice())
                && let [columns] = sides.as_slice()
            {
                done.push((rows.clone(), columns.clone()));
                continue;
            }
            for (rows, sides) in tall.iter().zip(wide).rev() {
                open.extend(sides.into_iter().rev().map(|columns| (rows.clone(), columns)));
            }
        }
        done
    }

    /// Ranges of columns that have pixels in these rows.
    fn sides(&self, rows: Range<usize>, columns: Range<usize>) -> Vec<Range<usize>> {
        let mut all: Vec<Range<usize>> = self.within(rows, columns).flat_map(|(_, spans)| spans).collect();
        all.sort_by_key(|span| span.start);
        join(all.into_iter())
    }

    /// Sets the pixels of row `i` that do not count to zero. `values` begins with column `first`, which may lie beside the window; what
    /// is beside the window stays as it is.
    #[inline(always)]
    pub fn clear_row<T: Real>(&self, i: usize, first: isize, values: &mut [T]) {
        let length = values.len() as isize;
        let place = |column: usize| (column as isize - first).clamp(0, length) as usize;
        let (mut gap, end) = (place(0), place(self.width));
        for span in self.row(i) {
            let span = place(span.start)..place(span.end);
            values[gap..span.start.max(gap)].fill(T::ZERO);
            gap = span.end;
        }
        values[gap..end.max(gap)].fill(T::ZERO);
    }

    /// Sets the pixels of the window's buffer that do not count to zero.
    pub fn clear<T: Real>(&self, window: Window, values: &mut [T]) {
        window.in_chunks(values, CHUNK, |first, rows| {
            for (k, row) in rows.chunks_mut(window.stride()).enumerate() {
                self.clear_row(first + k, 0, &mut row[PAD..][..window.width]);
            }
        });
    }
}

/// Joins ranges, in order of their starts, that touch or overlap.
fn join(ranges: impl Iterator<Item = Range<usize>>) -> Vec<Range<usize>> {
    let mut joined: Vec<Range<usize>> = Vec::new();
    for range in ranges {
        match joined.last_mut() {
            Some(last) if range.start <= last.end => last.end = last.end.max(range.end),
            _ => joined.push(range),
        }
    }
    joined
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    fn spans(height: usize, width: usize, cell: (usize, usize), counts: &[bool]) -> (Spans, Vec<Vec<bool>>) {
        let window = Window { y: 0, x: 0, height, width };
        let across = width.div_ceil(cell.1);
        let counts: Vec<bool> =
            counts.iter().copied().cycle().take(height.div_ceil(cell.0) * across).collect();
        let own = |i: usize, j: usize| counts[i / cell.0 * across + j / cell.1];
        let pixels = (0..height).map(|i| (0..width).map(|j| own(i, j)).collect()).collect();
        (Spans::of_cells(window, cell, &counts), pixels)
    }

    fn pixels(spans: &Spans, height: usize, width: usize) -> Vec<Vec<bool>> {
        (0..height)
            .map(|i| (0..width).map(|j| spans.row(i).iter().any(|s| s.contains(&j))).collect())
            .collect()
    }

    proptest! {
        #[test]
        fn spans_are_the_cells_that_count(
            (height, width) in (1_usize..40, 1_usize..60),
            cell in (1_usize..9, 1_usize..9),
            counts in prop::collection::vec(any::<bool>(), 1..99),
        ) {
            let (spans, expected) = spans(height, width, cell, &counts);
            prop_assert_eq!(&pixels(&spans, height, width), &expected);
            // Half the resolution.
            let half = pixels(&spans.halved(), height.div_ceil(2), width.div_ceil(2));
            for (i, row) in half.iter().enumerate() {
                for (j, &counts) in row.iter().enumerate() {
                    let below = |i: usize, n: usize| i..(i + 2).min(n);
                    let all = below(2 * i, height).all(|i| below(2 * j, width).all(|j| expected[i][j]));
                    prop_assert_eq!(counts, all, "{} {}", i, j);
                }
            }
            // Clearing leaves what counts and what is beside the window.
            let window = Window { y: 0, x: 0, height, width };
            let mut values = vec![1.0_f32; window.len()];
            spans.clear(window, &mut values);
            for (i, row) in expected.iter().enumerate() {
                for (j, &counts) in row.iter().enumerate() {
                    prop_assert_eq!(values[window.at(i, j)] > 0.0, counts);
                }
                prop_assert_eq!(values[window.at(i, 0) - 1], 1.0);
            }
        }

        #[test]
        fn boxes_hold_all_that_counts_once(
            (height, width) in (1_usize..40, 1_usize..60),
            cell in (1_usize..9, 1_usize..9),
            counts in prop::collection::vec(prop::bool::weighted(0.3), 1..99),
            (top, left) in (0_usize..20, 0_usize..30),
        ) {
            let (spans, expected) = spans(height, width, cell, &counts);
            let (rows, columns) = (top.min(height - 1)..height, left.min(width - 1)..width);
            let mut held = vec![vec![0; width]; height];
            for (rows, columns) in spans.boxes(rows.clone(), columns.clone()) {
                // As small as it can be.
                prop_assert_eq!(spans.rows(rows.clone(), columns.clone()), rows.clone());
                prop_assert_eq!(spans.columns(rows.clone(), columns.clone()), Some(columns.clone()));
                for i in rows {
                    for j in columns.clone() {
                        held[i][j] += 1;
                    }
                }
            }
            for i in rows {
                for j in columns.clone() {
                    prop_assert!(held[i][j] <= 1);
                    prop_assert!(held[i][j] == 1 || !expected[i][j]);
                }
            }
        }
    }
}
