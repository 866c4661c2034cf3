//! Sparse maps of one axis applied to whole images: along columns row by row, along rows in strips that are turned.
//!
//! Roofline: per output pixel two flops a tap against four bytes read and written. Along rows neighbouring pixels use
//! different taps, so 16 rows are turned on their side and become the lanes of a vector. Each pixel is computed by
//! itself, in the order of its taps, so that threads change no bit.

use lacuna_core::parallel::prelude::*;

use super::{Body, Isa, Real, dispatch};
use crate::{Plane, Size};

/// Rows that are turned at a time: lanes.
const LANES: usize = 16;
/// Pixels whose sums stay in registers.
const BLOCK: usize = 64;

/// A map in the numbers that images have.
#[derive(Clone, Debug)]
pub struct Rows {
    inputs: usize,
    /// Per output: its first input, and where its weights stand.
    places: Vec<(usize, std::ops::Range<usize>)>,
    weights: Vec<f32>,
}

impl Rows {
    /// Collects rows over `inputs` values: the first input and the weights from there on.
    pub fn new<'a>(inputs: usize, rows: impl Iterator<Item = (usize, &'a [f64])>) -> Self {
        let mut weights = Vec::new();
        let places = rows.map(|(start, row)| {
            let begin = weights.len();
            weights.extend(row.iter().map(|weight| *weight as f32));
            (start, begin..weights.len())
        });
        let places = places.collect();
        Self { inputs, places, weights }
    }

    /// Number of outputs.
    pub fn outputs(&self) -> usize {
        self.places.len()
    }

    /// The first input of an output and the weights from there on.
    #[inline]
    pub fn row(&self, output: usize) -> (usize, &[f32]) {
        let (start, range) = &self.places[output];
        (*start, &self.weights[range.clone()])
    }

    /// Maps every column of an image whose height is the number of inputs.
    pub fn along_columns(&self, image: &Plane) -> Plane {
        let width = image.size().width;
        let mut out = Plane::filled(Size::new(self.outputs(), width), 0.0);
        if width == 0 {
            return out;
        }
        out.pixels_mut().par_chunks_mut(width).enumerate().for_each(|(y, out)| {
            let (start, taps) = self.row(y);
            let rows = &image.pixels()[start * width..(start + taps.len()) * width];
            dispatch(Isa::best(), Combine { out, rows, taps });
        });
        out
    }

    /// Maps every row of an image by each of `chain` in turn; the first has as many inputs as the image is wide.
    pub fn along_rows(chain: &[&Self], image: &Plane) -> Plane {
        let Size { height, width } = image.size();
        let wide = chain.last().map_or(width, |last| last.outputs());
        let mut out = Plane::filled(Size::new(height, wide), 0.0);
        if wide == 0 || width == 0 {
            return out;
        }
        let strips = out.pixels_mut().par_chunks_mut(LANES * wide);
        strips.zip(image.pixels().par_chunks(LANES * width)).for_each_init(
            || (Vec::new(), Vec::new()),
            |(from, to): &mut (Vec<f32>, Vec<f32>), (out, rows)| {
                turn(rows, width, from);
                for map in chain {
                    to.clear();
                    to.resize(map.outputs() * LANES, 0.0);
                    dispatch(Isa::best(), Strip { map, from, to });
                    std::mem::swap(from, to);
                }
                turn_back(from, wide, out);
            },
        );
        out
    }
}

/// Lanes of columns from rows; lanes without a row are zero.
fn turn(rows: &[f32], width: usize, lanes: &mut Vec<f32>) {
    lanes.clear();
    lanes.resize(width * LANES, 0.0);
    for (lane, row) in rows.chunks(width).enumerate() {
        for (column, &value) in lanes.chunks_exact_mut(LANES).zip(row) {
            column[lane] = value;
        }
    }
}

fn turn_back(lanes: &[f32], width: usize, rows: &mut [f32]) {
    for (lane, row) in rows.chunks_mut(width).enumerate() {
        for (value, column) in row.iter_mut().zip(lanes.chunks_exact(LANES)) {
            *value = column[lane];
        }
    }
}

#[inline(always)]
fn add<const FUSED: bool>(sum: f32, tap: f32, value: f32) -> f32 {
    if FUSED { tap.fused(value, sum) } else { sum + tap * value }
}

/// `out[x] = sum_k taps[k] rows[k][x]`, the rows one after the other and as wide as `out`.
pub struct Combine<'a> {
    pub out: &'a mut [f32],
    pub rows: &'a [f32],
    pub taps: &'a [f32],
}

impl Combine<'_> {
    /// Pixels from `done` on in blocks of `N`, as far as these go; how many are done then.
    #[inline(always)]
    fn blocks<const N: usize, const FUSED: bool>(&mut self, done: usize) -> usize {
        let width = self.out.len();
        let blocks = self.out[done..].as_chunks_mut::<N>().0;
        for (block, out) in blocks.iter_mut().enumerate() {
            let mut sums = [0.0_f32; N];
            for (k, &tap) in self.taps.iter().enumerate() {
                let values = &self.rows[k * width + done + block * N..][..N];
                for (sum, &value) in sums.iter_mut().zip(values) {
                    *sum = add::<FUSED>(*sum, tap, value);
                }
            }
            *out = sums;
        }
        done + blocks.len() * N
    }
}

impl Body for Combine<'_> {
    type Output = ();

    #[inline(always)]
    fn run<const FUSED: bool>(mut self) {
        let mut done = self.blocks::<BLOCK, FUSED>(0);
        done = self.blocks::<{ BLOCK / 2 }, FUSED>(done);
        done = self.blocks::<{ BLOCK / 8 }, FUSED>(done);
        self.blocks::<1, FUSED>(done);
    }
}

/// One map on a turned strip.
struct Strip<'a> {
    map: &'a Rows,
    from: &'a [f32],
    to: &'a mut [f32],
}

impl Body for Strip<'_> {
    type Output = ();

    #[inline(always)]
    fn run<const FUSED: bool>(self) {
        let from = &self.from[..self.map.inputs * LANES];
        for (out, (start, range)) in self.to.as_chunks_mut::<LANES>().0.iter_mut().zip(&self.map.places) {
            let taps = &self.map.weights[range.clone()];
            let columns = from[start * LANES..].as_chunks::<LANES>().0;
            let mut sums = [0.0_f32; LANES];
            for (&tap, column) in taps.iter().zip(columns) {
                for (sum, &value) in sums.iter_mut().zip(column) {
                    *sum = add::<FUSED>(*sum, tap, value);
                }
            }
            *out = sums;
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    type Lines = Vec<(usize, Vec<f64>)>;

    fn example(inputs: usize, outputs: usize) -> Lines {
        let row = |i: usize| {
            let start = (i * inputs / outputs).min(inputs - 1);
            (start, (0..(1 + i % 4).min(inputs - start)).map(|k| ((i * 7 + k * 3) as f64).sin()).collect())
        };
        (0..outputs).map(row).collect()
    }

    fn rows(inputs: usize, lines: &Lines) -> Rows {
        Rows::new(inputs, lines.iter().map(|(start, row)| (*start, row.as_slice())))
    }

    fn apply(lines: &Lines, line: &[f64]) -> Vec<f64> {
        lines.iter().map(|(start, row)| row.iter().zip(&line[*start..]).map(|(w, x)| w * x).sum()).collect()
    }

    #[test]
    fn images_agree_with_the_map_on_lines_at_every_size() {
        for (height, width, outputs) in [(1, 1, 3), (5, 1, 2), (1, 9, 14), (37, 70, 101), (16, 130, 64)] {
            let size = Size::new(height, width);
            let image = Plane::from_fn(size, |y, x| ((y * 31 + x * 17) % 11) as f32 - 5.0);
            let (tall, wide) = (example(height, outputs), example(width, outputs));
            let bound = 64.0 * f64::from(f32::EPSILON);
            let columns = rows(height, &tall).along_columns(&image);
            for x in 0..width {
                let line: Vec<f64> = (0..height).map(|y| f64::from(image.at(y, x))).collect();
                for (y, value) in apply(&tall, &line).into_iter().enumerate() {
                    assert!((f64::from(columns.at(y, x)) - value).abs() < bound);
                }
            }
            let again = example(outputs, 5);
            let turned = Rows::along_rows(&[&rows(width, &wide), &rows(outputs, &again)], &image);
            assert_eq!(turned.size(), Size::new(height, 5));
            for y in 0..height {
                let line: Vec<f64> = image.row(y).iter().map(|v| f64::from(*v)).collect();
                for (x, value) in apply(&again, &apply(&wide, &line)).into_iter().enumerate() {
                    assert!((f64::from(turned.at(y, x)) - value).abs() < bound, "{value}");
                }
            }
        }
    }

    #[test]
    fn every_instruction_set_agrees() {
        let taps = rows(40, &example(40, 33));
        let from: Vec<f32> = (0..40 * LANES).map(|k| ((k * 37) % 23) as f32 / 7.0 - 1.0).collect();
        let mut results = Vec::new();
        for isa in Isa::all() {
            let mut to = vec![f32::NAN; 33 * LANES];
            dispatch(isa, Strip { map: &taps, from: &from, to: &mut to });
            let mut out = vec![f32::NAN; 75];
            dispatch(isa, Combine { out: &mut out, rows: &from[..4 * 75], taps: &[0.3, -0.2, 1.0, 0.5] });
            results.push([to, out].concat());
        }
        for other in &results[1..] {
            let close = |(a, b): (&f32, &f32)| (a - b).abs() < 16.0 * f32::EPSILON;
            assert!(results[0].iter().zip(other).all(close));
        }
    }
}
