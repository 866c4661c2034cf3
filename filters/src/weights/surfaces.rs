//! Weights of each surface by itself: a mirror says nothing of the wall behind it, however near.
//!
//! As [`super::Weights`], but that a sample counts on its own surface only, as labels tell them; what all of the image says counts for as much as `COMMON`
//! samples of a surface.

use std::cmp::Reverse;
use std::collections::BTreeMap;

use lacuna_core::parallel::prelude::*;

use super::{Neighbourhood, Products, best, blur};
use crate::{Mask, Planes, Size};

/// Pixels that one task takes.
const PIECE: usize = 1 << 16;
/// Surfaces that have weights of their own, the largest ones; all others share.
const MOST: usize = 15;
/// Samples of all of the image that count for each surface as well, so that a small one does not learn from a few.
const COMMON: f64 = 64.0;

/// Which surface each pixel shows, by number.
#[derive(Clone, Debug)]
pub struct Surfaces {
    size: Size,
    of: Vec<u8>,
    count: usize,
}

impl Surfaces {
    /// From labels; one surface without.
    pub fn new(size: Size, labels: Option<&[u32]>) -> Self {
        let Some(labels) = labels else { return Self { size, of: vec![0; size.pixels()], count: 1 } };
        let pieces = labels.par_chunks(PIECE).map(|labels| {
            let mut counts = BTreeMap::<u32, usize>::new();
            for run in labels.chunk_by(|a, b| a == b) {
                *counts.entry(run[0]).or_default() += run.len();
            }
            counts
        });
        let mut counts = BTreeMap::<u32, usize>::new();
        for (label, count) in pieces.into_iter().flatten() {
            *counts.entry(label).or_default() += count;
        }
        let mut largest: Vec<(u32, usize)> = counts.into_iter().collect();
        largest.sort_by_key(|&(label, count)| (Reverse(count), label));
        let number: BTreeMap<u32, u8> = largest.iter().take(MOST).map(|of| of.0).zip(0..).collect();
        let mut of = vec![MOST as u8; labels.len()];
        of.par_chunks_mut(PIECE).zip(labels.par_chunks(PIECE)).for_each(|(of, labels)| {
            let mut at = 0;
            for run in labels.chunk_by(|a, b| a == b) {
                if let Some(number) = number.get(&run[0]) {
                    of[at..][..run.len()].fill(*number);
                }
                at += run.len();
            }
        });
        Self { size, of, count: largest.len().min(MOST + 1) }
    }
}

/// Weights of each surface by itself.
#[derive(Clone, Debug)]
pub struct BySurface<'a> {
    surfaces: &'a Surfaces,
    of: Vec<Cells>,
}

/// The cells that a surface lies in, a rectangle of them, and what stands there by candidate.
#[derive(Clone, Debug)]
struct Cells {
    /// The first row and column of cells.
    first: [usize; 2],
    size: Size,
    of: Vec<Vec<f32>>,
    /// Where each row and each column of the image lies among those of cells.
    places: [Vec<Place>; 2],
}

/// Between the centres of which two rows, or columns, of cells a pixel lies, and how far beyond the first.
#[derive(Clone, Copy, Debug)]
struct Place {
    both: [u32; 2],
    beyond: f32,
}

impl Place {
    /// Of a pixel's row or column among `count` of cells with this side, from the `first` on.
    fn new(at: usize, side: usize, first: usize, count: usize) -> Self {
        let place = (at as f32 + 0.5) / side as f32 - 0.5 - first as f32;
        let place = place.clamp(0.0, count.saturating_sub(1) as f32);
        let low = (place as usize).min(count.saturating_sub(2));
        let high = (low + 1).min(count.saturating_sub(1));
        Self { both: [low as u32, high as u32], beyond: place - low as f32 }
    }
}

impl Cells {
    /// Those around all pixels of each surface.
    fn all(surfaces: &Surfaces, side: usize) -> Vec<Self> {
        let mut spans = vec![[usize::MAX, 0, usize::MAX, 0]; surfaces.count];
        let width = surfaces.size.width.max(1);
        let wider = |span: &mut [usize; 4], [top, bottom, left, right]: [usize; 4]| {
            *span = [span[0].min(top), span[1].max(bottom), span[2].min(left), span[3].max(right)];
        };
        let lines = surfaces.of.par_chunks(width).enumerate().map(|(row, line)| {
            let mut own = spans.clone();
            let mut column = 0;
            for run in line.chunk_by(|a, b| a == b) {
                let last = (column + run.len() - 1) / side;
                wider(&mut own[usize::from(run[0])], [row / side, row / side, column / side, last]);
                column += run.len();
            }
            own
        });
        for line in lines {
            spans.iter_mut().zip(line).for_each(|(span, own)| wider(span, own));
        }
        let cells = |[top, bottom, left, right]: [usize; 4]| {
            let size =
                if top > bottom { Size::new(0, 0) } else { Size::new(bottom - top + 1, right - left + 1) };
            let places = |length: usize, first: usize, count: usize| {
                (0..length).filter(|_| count > 0).map(|at| Place::new(at, side, first, count)).collect()
            };
            let Size { height, width } = surfaces.size;
            let places = [places(height, top, size.height), places(width, left, size.width)];
            Self { first: [top, left], size, of: Vec::new(), places }
        };
        spans.into_iter().map(cells).collect()
    }

    /// What a candidate counts for at a pixel: linearly between the centres of cells.
    fn at(&self, candidate: usize, row: usize, column: usize) -> f32 {
        let of = &self.of[candidate];
        let (y, x) = (self.places[0][row], self.places[1][column]);
        let line = |row: u32| {
            let row = &of[row as usize * self.size.width..][..self.size.width];
            let [a, b] = x.both.map(|column| row[column as usize]);
            a + x.beyond * (b - a)
        };
        let [a, b] = y.both.map(line);
        a + y.beyond * (b - a)
    }
}

/// The samples of a row of cells, by their numbers and pixels, and its cells by surface with the first column.
#[derive(Default)]
struct Line<'a> {
    samples: Vec<(usize, usize)>,
    cells: Vec<(usize, usize, &'a mut [Products])>,
}

impl<'a> BySurface<'a> {
    /// From the products of the errors of `count` candidates at samples, which `products(scratch, number, pixel, sums)` adds for one of
    /// them. Also the squared error of the blend over that of the first candidate.
    pub fn new(
        surfaces: &'a Surfaces,
        (at, near): (&[u32], Neighbourhood),
        count: usize,
        products: impl Fn(&mut Vec<f64>, usize, usize, &mut [f64]) + Sync,
    ) -> (Self, f64) {
        let spacing = (surfaces.size.pixels() as f64 / at.len().max(1) as f64).sqrt();
        let side = ((0.5 * near.spread * spacing).round() as usize).max(1);
        let mut of = Cells::all(surfaces, side);
        let mut sums: Vec<Vec<Products>> =
            of.iter().map(|cells| vec![vec![0.0; count * count]; cells.size.pixels()]).collect();
        let width = surfaces.size.width;
        // A row of cells is one task.
        let mut lines: Vec<Line<'_>> =
            (0..surfaces.size.height.div_ceil(side)).map(|_| Line::default()).collect();
        for (i, &pixel) in at.iter().enumerate() {
            lines[pixel as usize / width / side].samples.push((i, pixel as usize));
        }
        for (surface, (cells, sums)) in of.iter().zip(&mut sums).enumerate() {
            let rows = sums.chunks_mut(cells.size.width.max(1));
            for (line, sums) in lines.iter_mut().skip(cells.first[0]).zip(rows) {
                line.cells.push((surface, cells.first[1], sums));
            }
        }
        lines.into_par_iter().for_each_init(Vec::new, |scratch, mut line| {
            for (i, pixel) in line.samples {
                let own = usize::from(surfaces.of[pixel]);
                if let Some((_, left, sums)) = line.cells.iter_mut().find(|(surface, ..)| *surface == own) {
                    products(scratch, i, pixel, &mut sums[pixel % width / side - *left]);
                }
            }
        });
        let add = |mut sum: Products, one: &Products| {
            sum.iter_mut().zip(one).for_each(|(sum, one)| *sum += one);
            sum
        };
        let total = |cells: &Vec<Products>| cells.iter().fold(vec![0.0; count * count], add);
        let wholes: Vec<Products> = sums.iter().map(total).collect();
        let common = wholes.iter().fold(vec![0.0; count * count], add);
        let share = COMMON / at.len().max(1) as f64;
        let (mut error, mut first) = (0.0, 0.0);
        for ((cells, sums), mut whole) in of.iter_mut().zip(sums).zip(wholes) {
            whole.iter_mut().zip(&common).for_each(|(whole, common)| *whole += share * common);
            let found = cells.solve(&sums, (&whole, near.frame), count);
            error += found.0;
            first += found.1;
        }
        (Self { surfaces, of }, if first > 0.0 { error / first } else { 1.0 })
    }

    /// What a candidate counts for at a pixel.
    pub fn at(&self, candidate: usize, row: usize, column: usize) -> f32 {
        let surface = self.surfaces.of[row * self.surfaces.size.width + column];
        self.of[usize::from(surface)].at(candidate, row, column)
    }

    /// Adds a candidate's image, weighted, to `out`, at pixels that `mask` has or has not. Both may be a part of the image: `place` says the row and
    /// the column that a pixel has in all of it. Returns the mean weight there.
    pub fn add(
        &self,
        (candidate, image): (usize, &Planes),
        (mask, measured): (&Mask, bool),
        place: impl Fn(usize) -> (usize, usize) + Sync,
        out: &mut Planes,
    ) -> f64 {
        let Size { height, width } = mask.size();
        let mut rows: Vec<Vec<&mut [f32]>> = (0..height).map(|_| Vec::new()).collect();
        for plane in out.as_mut_slice() {
            let lines = plane.pixels_mut().chunks_mut(width.max(1));
            rows.iter_mut().zip(lines).for_each(|(row, line)| row.push(line));
        }
        let sums = rows.par_iter_mut().enumerate().map(|(row, out)| {
            let (mut sum, mut count) = (0.0, 0_usize);
            for (column, _) in mask.row(row).iter().enumerate().filter(|(_, flag)| **flag == measured) {
                let (at_row, at_column) = place(row * width + column);
                let weight = self.at(candidate, at_row, at_column);
                if weight > 0.0 {
                    for (out, image) in out.iter_mut().zip(image.as_slice()) {
                        out[column] += weight * image.row(row)[column];
                    }
                }
                (sum, count) = (sum + f64::from(weight), count + 1);
            }
            (sum, count)
        });
        let (sum, count) = sums.into_iter().fold((0.0, 0), |(a, m), (b, n)| (a + b, m + n));
        sum / count.max(1) as f64
    }

    /// Whether a candidate counts anywhere.
    pub fn counts(&self, candidate: usize) -> bool {
        self.of.iter().any(|cells| cells.of[candidate].iter().any(|weight| *weight > 0.0))
    }
}

impl Cells {
    /// Sets the weights of all cells; the squared errors of the blend and of the first candidate.
    fn solve(&mut self, sums: &[Products], whole: (&[f64], f64), count: usize) -> (f64, f64) {
        let all: Vec<usize> = (0..count).collect();
        let around = blur(self.size, sums);
        let alike = best(&vec![0.0; count * count], whole, count, &all).0;
        let cells: Vec<(Vec<f64>, f64, f64)> = around.par_iter().with_min_len(64).map(|cell| {
            if cell.iter().all(|product| *product == 0.0) {
                return (alike.clone(), 0.0, 0.0);
            }
            let (weights, error) = best(cell, whole, count, &all);
            (weights, error, best(cell, whole, count, &[0]).1)
        });
        self.of = (0..count).map(|k| cells.iter().map(|cell| cell.0[k] as f32).collect()).collect();
        cells.iter().fold((0.0, 0.0), |(error, first), cell| (error + cell.1, first + cell.2))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const NEAR: Neighbourhood = Neighbourhood { spread: 4.0, frame: 0.1 };

    /// Two surfaces side by side, each with a candidate that is right there and wrong on the other.
    #[test]
    fn a_border_between_surfaces_is_one_between_weights() {
        let size = Size::new(40, 60);
        let labels: Vec<u32> = (0..2400).map(|pixel| if pixel % 60 < 31 { 7 } else { 3 }).collect();
        let surfaces = Surfaces::new(size, Some(&labels));
        let at: Vec<u32> = (0..2400).filter(|pixel| pixel % 3 == 0).collect();
        let products = |_: &mut Vec<f64>, _: usize, pixel: usize, sums: &mut [f64]| {
            sums[if pixel % 60 < 31 { 3 } else { 0 }] += 1.0;
            sums[if pixel % 60 < 31 { 0 } else { 3 }] += 1e-3;
        };
        let (weights, _) = BySurface::new(&surfaces, (&at, NEAR), 2, products);
        for row in 0..40 {
            for column in 0..60 {
                let (here, other) = (usize::from(column >= 31), usize::from(column < 31));
                assert!(weights.at(here, row, column) > 0.9, "{row} {column}");
                assert!((weights.at(here, row, column) + weights.at(other, row, column) - 1.0).abs() < 1e-5);
            }
        }
        // The same without labels is a ramp.
        let one = Surfaces::new(size, None);
        let (weights, _) = BySurface::new(&one, (&at, NEAR), 2, products);
        assert!((weights.at(0, 20, 30) - 0.5).abs() < 0.2, "{}", weights.at(0, 20, 30));
    }

    /// More surfaces than are told apart, some of one pixel, and none at all of others.
    #[test]
    fn many_surfaces_share_what_is_left() {
        let size = Size::new(30, 30);
        let labels: Vec<u32> =
            (0..900).map(|pixel| if pixel < 60 { pixel } else { 60 + pixel / 60 }).collect();
        let surfaces = Surfaces::new(size, Some(&labels));
        assert_eq!(surfaces.count, MOST + 1);
        let at: Vec<u32> = (0..900).step_by(4).collect();
        let (weights, error) = BySurface::new(&surfaces, (&at, NEAR), 3, |_, _, _, sums| {
            sums.iter_mut().step_by(4).for_each(|sum| *sum += 1.0);
        });
        assert!((error - 1.0 / 3.0).abs() < 0.01, "{error}");
        for pixel in 0..900 {
            for k in 0..3 {
                assert!((weights.at(k, pixel / 30, pixel % 30) - 1.0 / 3.0).abs() < 1e-3);
            }
        }
    }
}
