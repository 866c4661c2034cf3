//! A layer of a convolutional network: 3 x 3 convolutions of many planes into many.
//!
//! ```text
//! to_o(y, x) = bias_o + sum over i, dy, dx of weight_oi(dy, dx) from_i(y + dy - 1, x + dx - 1)
//! ```
//!
//! Planes continue beyond their border with their outermost values. Each sum is made in the same order by all instruction sets, which differ only where one
//! fuses a multiplication with an addition.
//!
//! Roofline: all that a row of results needs is in the first cache; multiplications decide. Six planes of results by two vectors stay in
//! registers: two loads of values and six of weights serve twelve products.
#![allow(clippy::inline_always, reason = "a body must be compiled with the instruction set of its caller")]

use std::ops::Range;

use super::Isa;
use super::simd::{MOST, Vector, Vectored, vectors};

/// Planes of results that are summed together by two vectors, by one, and of what is left; outputs are multiples of the first two, or the last.
const PAIRED: usize = 6;
const SINGLE: usize = 12;
const FEW: usize = 4;
/// Numbers after the end of a row that may be written.
const SLACK: usize = 2 * MOST;

/// Planes of one size.
#[derive(Debug, Default)]
pub struct Maps {
    rows: usize,
    columns: usize,
    stride: usize,
    values: Vec<f32>,
}

impl Maps {
    /// Takes on a size and a number of planes. What they hold means nothing then.
    pub fn resize(&mut self, (rows, columns): (usize, usize), count: usize) {
        (self.rows, self.columns) = (rows, columns);
        self.stride = columns + 2 + SLACK;
        self.values.resize(rows * self.stride * count, 0.0);
    }

    /// A row of a plane.
    pub fn row(&self, plane: usize, row: usize) -> &[f32] {
        &self.values[self.start(plane, row)..][..self.columns]
    }

    /// The same to write.
    pub fn row_mut(&mut self, plane: usize, row: usize) -> &mut [f32] {
        let (start, length) = (self.start(plane, row), self.columns);
        &mut self.values[start..][..length]
    }

    fn start(&self, plane: usize, row: usize) -> usize {
        (plane * self.rows + row) * self.stride + 1
    }

    /// Continues every row by one value to either side.
    fn continue_outwards(&mut self) {
        let width = self.columns;
        for row in self.values.chunks_exact_mut(self.stride) {
            (row[0], row[width + 1]) = (row[1], row[width]);
        }
    }
}

/// The weights of a layer.
#[derive(Debug)]
pub struct Layer {
    inputs: usize,
    outputs: usize,
    /// By input, row and column of the window, and output.
    weights: Vec<f32>,
    bias: Vec<f32>,
}

impl Layer {
    /// From weights by output, input, row and column, and one bias an output; there are 4 outputs or a multiple of 12.
    pub fn new(weights: &[f32], bias: &[f32]) -> Self {
        let outputs = bias.len();
        debug_assert!(outputs == FEW || outputs.is_multiple_of(SINGLE), "{outputs}");
        let inputs = weights.len() / (9 * outputs);
        let at = |k: usize| weights[k % outputs * inputs * 9 + k / outputs];
        Self { inputs, outputs, weights: (0..weights.len()).map(at).collect(), bias: bias.to_vec() }
    }

    /// The number of planes that it makes.
    pub fn outputs(&self) -> usize {
        self.outputs
    }
}

/// What becomes of sums.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Activation {
    /// They stay.
    Linear,
    /// They are zero where negative.
    Relu,
    /// The layer's input is added, as many planes as its output; then as before.
    ResidualRelu,
}

/// What a layer makes of maps.
#[derive(Debug)]
pub struct Convolve<'a> {
    /// The weights.
    pub layer: &'a Layer,
    /// As many planes as the layer has inputs.
    pub from: &'a mut Maps,
    /// As many planes as it has outputs, of the same size.
    pub to: &'a mut Maps,
    /// The columns that are asked for in each row, from left to right; what others then hold means nothing.
    pub runs: &'a [Vec<Range<usize>>],
    /// What becomes of the sums.
    pub activation: Activation,
}

/// Does it.
pub fn convolve(isa: Isa, body: Convolve<'_>) {
    body.from.continue_outwards();
    vectors(isa, body);
}

impl Vectored<f32> for Convolve<'_> {
    type Output = ();

    #[inline(always)]
    fn run<V: Vector<Number = f32>>(mut self) {
        let outputs = self.layer.outputs;
        for (row, runs) in self.runs.iter().enumerate() {
            for run in runs {
                let mut x = run.start;
                while x < run.end {
                    let single = run.end - x <= V::LANES;
                    let each = if outputs < PAIRED {
                        FEW
                    } else if single {
                        SINGLE
                    } else {
                        PAIRED
                    };
                    for output in (0..outputs).step_by(each) {
                        match (each, single) {
                            (FEW, true) => self.sums::<V, FEW, 1>((row, x), output),
                            (FEW, false) => self.sums::<V, FEW, 2>((row, x), output),
                            (_, true) => self.sums::<V, SINGLE, 1>((row, x), output),
                            (_, false) => self.sums::<V, PAIRED, 2>((row, x), output),
                        }
                    }
                    x += if single { 1 } else { 2 } * V::LANES;
                }
            }
        }
    }
}

impl Convolve<'_> {
    /// `N` planes of results at the columns of `M` vectors of a row.
    #[inline(always)]
    fn sums<V: Vector<Number = f32>, const N: usize, const M: usize>(
        &mut self,
        (row, x): (usize, usize),
        output: usize,
    ) {
        let Self { layer, from, to, activation, .. } = self;
        let mut sums = [[V::splat(0.0); M]; N];
        for (sums, bias) in sums.iter_mut().zip(&layer.bias[output..]) {
            *sums = [V::splat(*bias); M];
        }
        for input in 0..layer.inputs {
            for dy in 0..3 {
                let near = (row + dy).saturating_sub(1).min(from.rows - 1);
                let near = &from.values[from.start(input, near) + x - 1..][..M * V::LANES + 2];
                for dx in 0..3 {
                    let mut values = [V::splat(0.0); M];
                    for (m, values) in values.iter_mut().enumerate() {
                        *values = V::load(&near[dx + m * V::LANES..]);
                    }
                    let weights = &layer.weights[(input * 9 + dy * 3 + dx) * layer.outputs + output..][..N];
                    for (sums, weight) in sums.iter_mut().zip(weights) {
                        let weight = V::splat(*weight);
                        for (sum, values) in sums.iter_mut().zip(values) {
                            *sum = values.fused(weight, *sum);
                        }
                    }
                }
            }
        }
        for (k, sums) in sums.into_iter().enumerate() {
            let start = to.start(output + k, row) + x;
            for (m, mut sum) in sums.into_iter().enumerate() {
                let place = start + m * V::LANES;
                if *activation == Activation::ResidualRelu {
                    sum = sum.plus(V::load(&from.values[place..]));
                }
                if *activation != Activation::Linear {
                    sum = sum.larger(V::splat(0.0));
                }
                sum.store(&mut to.values[place..]);
            }
        }
    }
}

#[cfg(test)]
mod tests;
