//! The regression of small pixels on reduced guides, and what it makes of guides at the larger size.
//!
//! Around each small pixel `i`, with weights `w_q = exp(-2 |q - i|^2)` of the 3 x 3 pixels that exist, normalised,
//!
//! ```text
//! min  sum_q w_q (y_q - b - a . g_q)^2 + RIDGE |a|^2           over a and b
//! a = (cov(g, g) + RIDGE)^-1 cov(g, y),   b = mean(y) - a . mean(g)
//! ```
//!
//! There are more slopes than pixels count: the ridge decides between them, and takes the shortest. Guides are scaled to a standard
//! deviation of one half and have no mean, so that a ridge of 1e-5 is nothing beside an edge and much beside rounding, whatever their offset.
//!
//! Cost: for `k` guides and `c` channels `k (k + 1) / 2 + k c + k + c` means over three rows and three columns and a Cholesky factor
//! a small pixel; `c (k + 1)` interpolations a large one. All rows of a band at once in loops over columns.

#![allow(clippy::inline_always, reason = "a body must be compiled with the instruction set of its caller")]

use std::borrow::Cow;
use std::ops::Range;

use lacuna_core::parallel::prelude::*;

use super::between;
use crate::kernel::{Body, Isa, dispatch};
use crate::upscale::Geometry;
use crate::{Plane, Planes};

/// Weight of the slopes' squares.
const RIDGE: f32 = 1e-5;
/// Weight of a pixel's neighbour along an axis: exp(-2).
const NEIGHBOUR: f32 = 0.135_335_28;
/// Rows of small pixels that one task takes.
const BAND: usize = 16;

/// A guide at the larger size.
#[derive(Clone, Copy)]
pub enum Term<'a> {
    /// As it is.
    Plane(&'a Plane),
    /// The product of two about its mean, made row by row.
    Product {
        /// Planes, and what is to be added to each.
        factors: [(&'a Plane, f32); 2],
        /// The mean.
        mean: f32,
    },
}

impl<'a> Term<'a> {
    /// The product of two planes, to each of which something is to be added.
    pub fn product(one: (&'a Plane, f32), other: (&'a Plane, f32)) -> Self {
        let factors = [one, other];
        let raw = Self::Product { factors, mean: 0.0 };
        let size = one.0.size();
        let sum = |row| raw.row(row, &mut Vec::new()).iter().map(|value| f64::from(*value)).sum::<f64>();
        // In the order of the rows, whatever the threads.
        let sum: f64 = (0..size.height).into_par_iter().map(sum).into_iter().sum();
        Self::Product { factors, mean: (sum / size.pixels().max(1) as f64) as f32 }
    }

    /// All of its pixels.
    pub fn plane(self) -> Cow<'a, Plane> {
        match self {
            Self::Plane(plane) => Cow::Borrowed(plane),
            Self::Product { factors: [(one, _), _], .. } => {
                let mut plane = Plane::filled(one.size(), 0.0);
                let rows = plane.pixels_mut().par_chunks_mut(one.size().width).enumerate();
                rows.for_each(|(row, out)| out.copy_from_slice(self.row(row, &mut Vec::new())));
                Cow::Owned(plane)
            }
        }
    }

    /// One row, in `product` where it has to be made.
    fn row<'b>(self, row: usize, product: &'b mut Vec<f32>) -> &'b [f32]
    where
        'a: 'b,
    {
        match self {
            Self::Plane(plane) => plane.row(row),
            Self::Product { factors: [(one, a), (other, b)], mean } => {
                product.clear();
                let pairs = one.row(row).iter().zip(other.row(row));
                product.extend(pairs.map(|(one, other)| (one + a) * (other + b) - mean));
                product
            }
        }
    }
}

/// Guides of both sizes.
#[derive(Clone, Copy)]
pub struct Fit<'a> {
    /// Reduced.
    pub guides: &'a [Plane],
    /// At the larger size.
    pub fine: &'a [Term<'a>],
    /// Where the pixels lie.
    pub geometry: &'a Geometry,
}

impl Fit<'_> {
    /// What the guides predict of each channel at the larger size.
    pub fn predict(self, values: &Planes) -> Planes {
        let (low, high) = (self.geometry.low(), self.geometry.high());
        let places = |axis: &crate::upscale::Axis| -> Vec<(usize, f32)> {
            let one = |at| between(axis, self.geometry.sampling, at);
            (0..axis.outputs).map(one).map(|(first, share)| (first, share as f32)).collect()
        };
        let (down, across) = (places(&self.geometry.vertical), places(&self.geometry.horizontal));
        let mut out = Planes::zeros(high, values.len());
        let bands: Vec<Range<usize>> = (0..low.height)
            .step_by(BAND)
            .map(|from| {
                let start = down.partition_point(|(row, _)| *row < from);
                start..down.partition_point(|(row, _)| *row < from + BAND)
            })
            .collect();
        let mut parts: Vec<Vec<&mut [f32]>> = bands.iter().map(|_| Vec::new()).collect();
        for plane in out.as_mut_slice() {
            let mut rest = plane.pixels_mut();
            for (part, rows) in parts.iter_mut().zip(&bands) {
                let (rows, after) = rest.split_at_mut(rows.len() * high.width);
                part.push(rows);
                rest = after;
            }
        }
        bands.into_par_iter().zip(parts).for_each(|(rows, mut part)| {
            if rows.is_empty() {
                return;
            }
            let first = down[rows.start].0;
            let last = (down[rows.end - 1].0 + 1).min(low.height - 1);
            let slopes = self.slopes(values, first..last + 1);
            for (at, row) in rows.enumerate() {
                let (above, share) = down[row];
                for (channel, part) in part.iter_mut().enumerate() {
                    let out = &mut part[at * high.width..][..high.width];
                    let line = |term: usize| {
                        let one = |row: usize| {
                            let row = (row - first).min(last - first);
                            slopes.line(row, channel, term)
                        };
                        (one(above), one(above + 1))
                    };
                    evaluate(line, share, &across, (self.fine, row), out);
                }
            }
        });
        out
    }

    /// The slopes of every channel, the constant last, for some rows of small pixels.
    fn slopes(self, values: &Planes, rows: Range<usize>) -> Slopes {
        let low = self.geometry.low();
        let (k, c, width) = (self.guides.len(), values.len(), low.width);
        let mut moments = Moments::new(k, c, width);
        let mut slopes =
            Slopes { width, terms: k + 1, channels: c, lines: vec![0.0; rows.len() * c * (k + 1) * width] };
        // The means along rows of the last three rows.
        let mut ring: [Vec<f32>; 3] = std::array::from_fn(|_| vec![0.0; moments.count() * width]);
        let mut held = [usize::MAX; 3];
        for (at, row) in rows.enumerate() {
            let near = row.saturating_sub(1)..(row + 2).min(low.height);
            for other in near.clone() {
                if held[other % 3] == other {
                    continue;
                }
                let guides: Vec<&[f32]> = self.guides.iter().map(|plane| plane.row(other)).collect();
                let channels: Vec<&[f32]> = values.as_slice().iter().map(|plane| plane.row(other)).collect();
                dispatch(
                    Isa::best(),
                    Along { guides: &guides, channels: &channels, out: &mut ring[other % 3], width },
                );
                held[other % 3] = other;
            }
            let weights: Vec<(usize, f32)> =
                near.map(|other| (other % 3, if other == row { 1.0 } else { NEIGHBOUR })).collect();
            let size = c * (k + 1) * width;
            let out = &mut slopes.lines[at * size..][..size];
            dispatch(Isa::best(), Solve { ring: &ring, weights: &weights, moments: &mut moments, out });
        }
        slopes
    }
}

/// Regressions of some rows of small pixels.
struct Slopes {
    width: usize,
    terms: usize,
    channels: usize,
    lines: Vec<f32>,
}

impl Slopes {
    fn line(&self, row: usize, channel: usize, term: usize) -> &[f32] {
        &self.lines[((row * self.channels + channel) * self.terms + term) * self.width..][..self.width]
    }
}

/// One row of one channel: slopes times guides, between the four pixels around.
fn evaluate<'a>(
    line: impl Fn(usize) -> (&'a [f32], &'a [f32]),
    down: f32,
    across: &[(usize, f32)],
    (guides, row): (&[Term<'_>], usize),
    out: &mut [f32],
) {
    let terms = guides.len();
    let width = line(0).0.len();
    let mut middle = vec![0.0_f32; width + 1];
    let between = |term: usize, middle: &mut Vec<f32>| {
        let (above, below) = line(term);
        for ((middle, above), below) in middle.iter_mut().zip(above).zip(below) {
            *middle = above + down * (below - above);
        }
        middle[width] = middle[width - 1];
    };
    between(terms, &mut middle);
    for (out, &(first, share)) in out.iter_mut().zip(across) {
        *out = middle[first] + share * (middle[first + 1] - middle[first]);
    }
    let mut product = Vec::new();
    for (term, guide) in guides.iter().enumerate() {
        between(term, &mut middle);
        let guide = guide.row(row, &mut product);
        for ((out, &(first, share)), guide) in out.iter_mut().zip(across).zip(guide) {
            *out += guide * (middle[first] + share * (middle[first + 1] - middle[first]));
        }
    }
}

/// Means of a row of small pixels, in lines as wide as the image: products of guides, guides with channels, guides, channels.
struct Moments {
    guides: usize,
    channels: usize,
    width: usize,
    /// The means over three rows as well.
    lines: Vec<f32>,
}

impl Moments {
    fn new(guides: usize, channels: usize, width: usize) -> Self {
        let mut new = Self { guides, channels, width, lines: Vec::new() };
        new.lines = vec![0.0; new.count() * width];
        new
    }

    /// Lines.
    const fn count(&self) -> usize {
        count(self.guides, self.channels)
    }
}

const fn count(k: usize, c: usize) -> usize {
    k * (k + 1) / 2 + k * c + k + c
}

/// Weighted sums along one row.
struct Along<'a> {
    guides: &'a [&'a [f32]],
    channels: &'a [&'a [f32]],
    out: &'a mut [f32],
    width: usize,
}

impl Body for Along<'_> {
    type Output = ();

    #[inline(always)]
    fn run<const FUSED: bool>(self) {
        let Self { guides, channels, out, width } = self;
        let mut lines = out.chunks_exact_mut(width);
        let mut product = vec![0.0_f32; width];
        let mut next = |a: &[f32], b: Option<&[f32]>| {
            match b {
                Some(b) => product.iter_mut().zip(a).zip(b).for_each(|((p, a), b)| *p = a * b),
                None => product.copy_from_slice(a),
            }
            let Some(line) = lines.next() else { return };
            line.copy_from_slice(&product);
            for (line, left) in line[1..].iter_mut().zip(&product) {
                *line += NEIGHBOUR * left;
            }
            for (line, right) in line.iter_mut().zip(&product[1..]) {
                *line += NEIGHBOUR * right;
            }
        };
        for (i, a) in guides.iter().enumerate() {
            for b in &guides[..=i] {
                next(a, Some(*b));
            }
        }
        for a in guides {
            for b in channels {
                next(a, Some(*b));
            }
        }
        for a in guides.iter().chain(channels) {
            next(a, None);
        }
    }
}

/// Means over rows, centred, and the systems solved, all columns of a row at once.
struct Solve<'a> {
    ring: &'a [Vec<f32>; 3],
    weights: &'a [(usize, f32)],
    moments: &'a mut Moments,
    out: &'a mut [f32],
}

impl Body for Solve<'_> {
    type Output = ();

    #[inline(always)]
    fn run<const FUSED: bool>(self) {
        let Moments { guides: k, channels: c, width, ref mut lines } = *self.moments;
        let rows: f32 = self.weights.iter().map(|(_, weight)| weight).sum();
        // Of the columns that exist.
        let edge =
            |x: usize| 1.0 + NEIGHBOUR * (f32::from(u8::from(x > 0)) + f32::from(u8::from(x + 1 < width)));
        let norm: Vec<f32> = (0..width).map(|x| 1.0 / (rows * edge(x))).collect();
        for (at, line) in lines.chunks_exact_mut(width).enumerate() {
            line.fill(0.0);
            for (row, weight) in self.weights {
                let from = &self.ring[*row][at * width..][..width];
                line.iter_mut().zip(from).for_each(|(line, from)| *line += weight * from);
            }
            line.iter_mut().zip(&norm).for_each(|(line, norm)| *line *= norm);
        }
        let (squares, means) = lines.split_at_mut((k * (k + 1) / 2 + k * c) * width);
        let mean = |at: usize| &means[at * width..][..width];
        let take = |line: &mut [f32], a: &[f32], b: &[f32]| {
            line.iter_mut().zip(a).zip(b).for_each(|((line, a), b)| *line -= a * b);
        };
        let mut at = squares.chunks_exact_mut(width);
        for i in 0..k {
            for j in 0..=i {
                let Some(line) = at.next() else { return };
                take(line, mean(i), mean(j));
                if i == j {
                    // Rounding may leave a variance below zero.
                    for value in line {
                        *value = value.max(0.0) + RIDGE;
                    }
                }
            }
        }
        for i in 0..k {
            for j in 0..c {
                let Some(line) = at.next() else { return };
                take(line, mean(i), mean(k + j));
            }
        }
        let (matrix, right) = squares.split_at_mut(k * (k + 1) / 2 * width);
        factor(matrix, k, width);
        substitute(matrix, right, (k, c), width);
        for channel in 0..c {
            let out = &mut self.out[channel * (k + 1) * width..][..(k + 1) * width];
            let (slopes, constant) = out.split_at_mut(k * width);
            constant.copy_from_slice(mean(k + channel));
            for (i, slope) in slopes.chunks_exact_mut(width).enumerate() {
                slope.copy_from_slice(&right[(i * c + channel) * width..][..width]);
                take(constant, &*slope, mean(i));
            }
        }
    }
}

/// Where entry (i, j) of a lower triangle stands.
const fn place(i: usize, j: usize) -> usize {
    i * (i + 1) / 2 + j
}

/// Cholesky factors of all columns' matrices in place; the diagonal holds its inverse.
#[inline(always)]
fn factor(matrix: &mut [f32], k: usize, width: usize) {
    for j in 0..k {
        for i in j..k {
            let (before, rest) = matrix.split_at_mut(place(i, j) * width);
            let line = &mut rest[..width];
            for m in 0..j {
                let a = &before[place(i, m) * width..][..width];
                let b = &before[place(j, m) * width..][..width];
                line.iter_mut().zip(a).zip(b).for_each(|((line, a), b)| *line -= a * b);
            }
            if i == j {
                // What rounding took is at most the ridge.
                for value in line {
                    *value = 1.0 / value.max(0.1 * RIDGE).sqrt();
                }
            } else {
                let diagonal = &before[place(j, j) * width..][..width];
                line.iter_mut().zip(diagonal).for_each(|(line, diagonal)| *line *= diagonal);
            }
        }
    }
}

/// The solutions for all channels in place.
#[inline(always)]
fn substitute(matrix: &[f32], right: &mut [f32], (k, c): (usize, usize), width: usize) {
    let entry = |i: usize, j: usize| &matrix[place(i, j) * width..][..width];
    for i in 0..k {
        for channel in 0..c {
            let (before, rest) = right.split_at_mut((i * c + channel) * width);
            let line = &mut rest[..width];
            for m in 0..i {
                let known = &before[(m * c + channel) * width..][..width];
                line.iter_mut().zip(entry(i, m)).zip(known).for_each(|((line, a), b)| *line -= a * b);
            }
            line.iter_mut().zip(entry(i, i)).for_each(|(line, inverse)| *line *= inverse);
        }
    }
    for i in (0..k).rev() {
        for channel in 0..c {
            let (before, after) = right.split_at_mut(((i * c + channel) + 1) * width);
            let line = &mut before[(i * c + channel) * width..];
            for m in i + 1..k {
                let known = &after[((m * c + channel) - (i * c + channel) - 1) * width..][..width];
                line.iter_mut().zip(entry(m, i)).zip(known).for_each(|((line, a), b)| *line -= a * b);
            }
            line.iter_mut().zip(entry(i, i)).for_each(|(line, inverse)| *line *= inverse);
        }
    }
}
