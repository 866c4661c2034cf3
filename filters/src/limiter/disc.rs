//! Minima and maxima of the measured pixels over a disc, for a strip of rows.

use std::ops::Range;

use crate::kernel::Isa;
use crate::kernel::minima::{lower_to, of_three, take};
use crate::{Mask, Plane};

/// Per pixel of a strip of rows the range of the measured pixels around it.
pub(super) struct Ranges {
    low: Vec<f32>,
    high: Vec<f32>,
    width: usize,
}

impl Ranges {
    /// For a range of rows and columns: the range over the pixels at most `radius` away.
    /// Where no pixel of the disc was measured, low is infinite and high minus infinity.
    pub(super) fn new(
        (mask, samples): (&Mask, &Plane),
        rows: Range<usize>,
        columns: Range<usize>,
        radius: usize,
    ) -> Self {
        let size = mask.size();
        let width = columns.len();
        let mut low = vec![f32::INFINITY; width * rows.len()];
        let mut high = low.clone();
        let reach = |range: &Range<usize>, end: usize| {
            range.start.saturating_sub(radius)..end.min(range.end + radius)
        };
        let from = reach(&columns, size.width);
        let mut lines = [Line::new(width, radius), Line::new(width, radius)];
        let (chords, isa) = (chords(radius), Isa::best());
        for y in reach(&rows, size.height) {
            let start = from.start + radius - columns.start;
            let [low_line, high_line] = &mut lines;
            let places = [low_line.clear(start, from.len()), high_line.clear(start, from.len())];
            // Maxima are minima of negatives, negated back at the end.
            take(isa, places, &mask.row(y)[from.clone()], &samples.row(y)[from.clone()], true);
            for (half, away) in chords.iter().enumerate() {
                for (line, plane) in lines.iter_mut().zip([&mut low, &mut high]) {
                    if half > 0 {
                        line.widen();
                    }
                    for target in targets(y, away, &rows) {
                        lower_to(isa, &mut plane[(target - rows.start) * width..][..width], line.minima());
                    }
                }
            }
        }
        for value in &mut high {
            *value = -*value;
        }
        Self { low, high, width }
    }

    /// Takes the smallest values of discs within these where they have one.
    pub(super) fn raise(&mut self, within: &Self) {
        for (low, &near) in self.low.iter_mut().zip(&within.low) {
            *low = if near < f32::INFINITY { near } else { *low };
        }
    }

    /// Smallest and largest values around the pixels of row `y` of the strip.
    pub(super) fn row_mut(&mut self, y: usize) -> (&mut [f32], &mut [f32]) {
        let start = y * self.width;
        (&mut self.low[start..][..self.width], &mut self.high[start..][..self.width])
    }
}

/// For each half-width 0 to `radius` the distances of the rows whose chord of the disc it is.
fn chords(radius: usize) -> Vec<Range<usize>> {
    let reaches = |half: usize, away: usize| half * half + away * away <= radius * radius;
    // The distances at which a chord has this half-width at least.
    let count = |half: usize| (0..=radius).take_while(|&away| reaches(half, away)).count();
    (0..=radius).map(|half| count(half + 1)..count(half)).collect()
}

/// The rows of the strip at these distances from row `y`, each once.
fn targets(y: usize, away: &Range<usize>, rows: &Range<usize>) -> impl Iterator<Item = usize> {
    let (above, below) = (away.clone(), away.clone());
    let rows = rows.clone();
    let above = above.filter_map(move |away| y.checked_sub(away));
    let below = below.filter(|&away| away > 0).map(move |away| y + away);
    above.chain(below).filter(move |row| rows.contains(row))
}

/// One row, and minima over windows around its pixels that grow by one pixel to either side.
struct Line {
    values: Vec<f32>,
    scratch: Vec<f32>,
    radius: usize,
    half: usize,
}

impl Line {
    fn new(width: usize, radius: usize) -> Self {
        let values = vec![f32::INFINITY; width + 2 * radius];
        Self { scratch: values.clone(), values, radius, half: 0 }
    }

    /// Makes room for a row of so many pixels, to stand from `start`; windows of one pixel. All of it is infinite.
    fn clear(&mut self, start: usize, length: usize) -> &mut [f32] {
        self.half = 0;
        self.values.fill(f32::INFINITY);
        &mut self.values[start..][..length]
    }

    /// Grows the windows; those that would reach beyond the ends of the line are dropped.
    fn widen(&mut self) {
        let last = self.values.len() - 1 - self.half;
        let old = &self.values[self.half..=last];
        let new = &mut self.scratch[self.half + 1..last];
        of_three(Isa::best(), old, new);
        std::mem::swap(&mut self.values, &mut self.scratch);
        self.half += 1;
    }

    /// The minima around the pixels in question.
    fn minima(&self) -> &[f32] {
        &self.values[self.radius..self.values.len() - self.radius]
    }
}
