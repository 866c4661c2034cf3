//! A layer of a convolutional network: 3 x 3 convolutions of many planes into many.
//!
//! ```text
//! to_o(y, x) = bias_o + sum over i, dy, dx of weight_oi(dy, dx) from_i(y + dy - 1, x + dx - 1)
//! ```
//!
//! Planes continue beyond their border with their outermost values. Each sum is made in the same order by all instruction sets, which differ only where one
//! fuses a multiplication with an addition.
//!
//! Four rows of results are made together, by Winograd's minimal filtering along columns: of the six rows `d` that they need
//!
//! ```text
//! y = A' ((G g) * (B' d))      18 products a column in place of 36, the same for any number of planes
//! ```
//!
//! with `g` a column of weights and `*` element by element. It loses about one decimal digit: each result is a difference of sums up to ten times as large.
//!
//! Source: A. Lavin, S. Gray, "Fast algorithms for convolutional neural networks", CVPR 2016.
//!
//! Roofline: all that four rows of results need is in the nearest caches; multiplications decide. Twelve planes of results stay in registers, by two vectors
//! where there are 32 of these: two loads of values and twelve of weights serve 24 products.
#![allow(clippy::inline_always, reason = "a body must be compiled with the instruction set of its caller")]

use std::ops::Range;

use super::Isa;
use super::aligned::Aligned;
use super::simd::{MOST, Vector, Vectored, vectors};

/// Planes of results that are summed together; outputs are multiples of the first, or the second.
const MANY: usize = 12;
const FEW: usize = 4;
/// Rows of results that are made together.
const TALL: usize = 4;
/// Rows that these need, and sums that they are made of.
const LIFTED: usize = TALL + 2;
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

    /// All that they hold, which means nothing any more, is this.
    #[cfg(test)]
    pub fn spoil(&mut self, value: f32) {
        self.values.fill(value);
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
    /// `G g` by planes that are summed together, sum, input, column of the window, and plane.
    weights: Vec<f32>,
    bias: Vec<f32>,
}

impl Layer {
    /// From weights by output, input, row and column, and one bias an output; there are 4 outputs or a multiple of 12.
    pub fn new(weights: &[f32], bias: &[f32]) -> Self {
        let outputs = bias.len();
        debug_assert!(outputs == FEW || outputs.is_multiple_of(MANY), "{outputs}");
        let inputs = weights.len() / (9 * outputs);
        let together = outputs.min(MANY);
        let mut lifted = vec![0.0; LIFTED * inputs * 3 * outputs];
        for (output, input) in (0..outputs).flat_map(|output| (0..inputs).map(move |input| (output, input))) {
            for dx in 0..3 {
                let column = |dy: usize| f64::from(weights[((output * inputs + input) * 3 + dy) * 3 + dx]);
                for (sum, weight) in lifted_weights([0, 1, 2].map(column)).into_iter().enumerate() {
                    let at = ((output / together * LIFTED + sum) * inputs + input) * 3 + dx;
                    lifted[at * together + output % together] = weight as f32;
                }
            }
        }
        Self { inputs, outputs, weights: lifted, bias: bias.to_vec() }
    }

    /// The number of planes that it makes.
    pub fn outputs(&self) -> usize {
        self.outputs
    }
}

/// `G g`.
fn lifted_weights([a, b, c]: [f64; 3]) -> [f64; LIFTED] {
    let (even, far) = (a + c, a + 4.0 * c);
    [a / 4.0, -(even + b) / 6.0, -(even - b) / 6.0, (far + 2.0 * b) / 24.0, (far - 2.0 * b) / 24.0, c]
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

/// Room for what is computed on the way.
#[derive(Debug, Default)]
pub struct Room {
    /// `B' d` by sum, input and column.
    lifted: Aligned<f32>,
    /// `(G g) * (B' d)` by plane, vector and sum.
    sums: Aligned<f32>,
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
    /// The columns that are asked for in each row, from left to right. What others then hold means nothing, except next to them and in rows that those
    /// of another four need: there it is zero, or as if it had been asked for.
    pub runs: &'a [Vec<Range<usize>>],
    /// Room.
    pub room: &'a mut Room,
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
        let length = LIFTED * MANY * 2 * V::LANES;
        if self.room.sums.len() < length {
            self.room.sums = Aligned::zeros(length);
        }
        let outputs = self.layer.outputs;
        for (four, rows) in self.runs.chunks(TALL).enumerate() {
            let united = united(rows);
            for run in &united {
                let lifted = self.lift::<V>(TALL * four, run);
                // Of 16 registers as many are taken by one vector as of 32 by two.
                let most = if V::LANES == MOST { 2 } else { 1 };
                let mut x = run.start;
                while x < run.end {
                    let count = (run.end - x).div_ceil(V::LANES).min(most);
                    let place = (TALL * four, x);
                    match (outputs < MANY, count) {
                        (true, 1) => self.sums::<V, FEW, 1>(lifted, place),
                        (true, _) => self.sums::<V, FEW, 2>(lifted, place),
                        (false, 1) => self.sums::<V, MANY, 1>(lifted, place),
                        (false, _) => self.sums::<V, MANY, 2>(lifted, place),
                    }
                    x += count * V::LANES;
                }
            }
            self.clear(TALL * four..TALL * four + rows.len(), &united);
        }
    }
}

/// What [`Convolve::lift`] made.
#[derive(Clone, Copy)]
struct Lifted {
    /// The first column.
    start: usize,
    /// Numbers from an input to the next.
    stride: usize,
}

impl Convolve<'_> {
    /// Makes `B' d` of all inputs for four rows of results from `row` on, and the columns of a run and beside it.
    #[inline(always)]
    fn lift<V: Vector<Number = f32>>(&mut self, row: usize, run: &Range<usize>) -> Lifted {
        let Self { layer, from, room, .. } = self;
        let steps = (run.len() + 2).div_ceil(V::LANES);
        // The last sums read beyond their run. An odd number of lines of the cache spreads inputs over all of it.
        let stride = (((steps * V::LANES + SLACK) / MOST) | 1) * MOST;
        if room.lifted.len() < LIFTED * layer.inputs * stride {
            room.lifted = Aligned::zeros(LIFTED * layer.inputs * stride);
        }
        let (two, four) = (V::splat(2.0), V::splat(4.0));
        let (minus_four, minus_five) = (V::splat(-4.0), V::splat(-5.0));
        for input in 0..layer.inputs {
            let near: [usize; LIFTED] = std::array::from_fn(|k| {
                from.start(input, (row + k).saturating_sub(1).min(from.rows - 1)) + run.start - 1
            });
            for step in 0..steps {
                let row = |k: usize| V::load(&from.values[near[k] + step * V::LANES..]);
                let (a, b, c, d, e, f) = (row(0), row(1), row(2), row(3), row(4), row(5));
                let (even, odd) = (c.fused(minus_four, e), b.fused(minus_four, d));
                let (near, far) = (e.minus(c), d.minus(b).times(two));
                let mut put = |k: usize, sum: V| {
                    sum.store(&mut room.lifted[(k * layer.inputs + input) * stride + step * V::LANES..]);
                };
                put(0, a.fused(four, c.fused(minus_five, e)));
                put(1, even.plus(odd));
                put(2, even.minus(odd));
                put(3, near.plus(far));
                put(4, near.minus(far));
                put(5, b.fused(four, d.fused(minus_five, f)));
            }
        }
        Lifted { start: run.start, stride }
    }

    /// The results at the columns of `M` vectors of four rows, `N` planes at a time.
    #[inline(always)]
    fn sums<V: Vector<Number = f32>, const N: usize, const M: usize>(
        &mut self,
        lifted: Lifted,
        (row, x): (usize, usize),
    ) {
        let inputs = self.layer.inputs;
        for planes in 0..self.layer.outputs / N {
            for k in 0..LIFTED {
                let weights = &self.layer.weights[(planes * LIFTED + k) * inputs * 3 * N..];
                let near = &self.room.lifted[k * inputs * lifted.stride + x - lifted.start..];
                let to = &mut self.room.sums[k * V::LANES..];
                products::<V, N, M>((weights, inputs), (near, lifted.stride), to);
            }
            for k in 0..N {
                for m in 0..M {
                    self.write::<V>(k * M + m, (planes * N + k, row, x + m * V::LANES));
                }
            }
        }
    }

    /// Makes the results of a plane at the columns of a vector from their sums, which lie at a place.
    #[inline(always)]
    fn write<V: Vector<Number = f32>>(&mut self, place: usize, (output, row, x): (usize, usize, usize)) {
        let Self { layer, from, to, room, activation, .. } = self;
        let sums = &room.sums[place * LIFTED * V::LANES..][..LIFTED * V::LANES];
        let sum = |k: usize| V::load(&sums[k * V::LANES..]);
        let bias = V::splat(layer.bias[output]);
        let (near, apart) = (sum(1).plus(sum(2)), sum(1).minus(sum(2)));
        let (far, wide) = (sum(3).plus(sum(4)), sum(3).minus(sum(4)));
        let four = [
            sum(0).plus(near).plus(far),
            wide.fused(V::splat(2.0), apart),
            far.fused(V::splat(4.0), near),
            wide.fused(V::splat(8.0), apart).plus(sum(5)),
        ];
        for (k, sum) in four.into_iter().enumerate().take(to.rows - row) {
            let mut value = sum.plus(bias);
            let place = to.start(output, row + k) + x;
            if *activation == Activation::ResidualRelu {
                value = value.plus(V::load(&from.values[place..]));
            }
            if *activation != Activation::Linear {
                value = value.larger(V::splat(0.0));
            }
            value.store(&mut to.values[place..]);
        }
    }

    /// Makes zero what these rows hold beside the runs, as far as the next layer reads it: all of the rows that those of another four need; of the other
    /// rows what is next to a run. What a result does not depend on cancels in its sums only up to rounding.
    fn clear(&mut self, rows: Range<usize>, runs: &[Range<usize>]) {
        let columns = self.to.columns;
        let ends = runs.iter().map(|run| run.end);
        let gaps = std::iter::once(0).chain(ends).zip(runs.iter().map(|run| run.start).chain([columns]));
        for (start, end) in gaps.filter(|(start, end)| start < end) {
            for plane in 0..self.layer.outputs {
                for row in rows.clone() {
                    let gap = &mut self.to.row_mut(plane, row)[start..end];
                    if row == rows.start || row + 1 == rows.end {
                        gap.fill(0.0);
                    } else {
                        (gap[0], gap[end - start - 1]) = (0.0, 0.0);
                    }
                }
            }
        }
    }
}

/// One of the sums that results are made of, of `N` planes at `M` vectors, each [`LIFTED`] vectors after the one before.
#[inline(always)]
fn products<V: Vector<Number = f32>, const N: usize, const M: usize>(
    (weights, inputs): (&[f32], usize),
    (near, stride): (&[f32], usize),
    to: &mut [f32],
) {
    let mut sums = [[V::splat(0.0); M]; N];
    let (weights, _) = weights.as_chunks::<N>();
    for (weights, near) in weights.chunks_exact(3).zip(near.chunks(stride)).take(inputs) {
        let near = &near[..M * V::LANES + 2];
        for (dx, weights) in weights.iter().enumerate() {
            let mut values = [V::splat(0.0); M];
            for (m, values) in values.iter_mut().enumerate() {
                *values = V::load(&near[dx + m * V::LANES..]);
            }
            for (sums, weight) in sums.iter_mut().zip(weights) {
                let weight = V::splat(*weight);
                for (sum, values) in sums.iter_mut().zip(values) {
                    *sum = values.fused(weight, *sum);
                }
            }
        }
    }
    for (k, sums) in sums.iter().enumerate() {
        for (m, sum) in sums.iter().enumerate() {
            sum.store(&mut to[(k * M + m) * LIFTED * V::LANES..]);
        }
    }
}

/// The columns of all rows, from left to right.
fn united(rows: &[Vec<Range<usize>>]) -> Vec<Range<usize>> {
    let mut all: Vec<Range<usize>> = rows.iter().flatten().cloned().collect();
    all.sort_unstable_by_key(|run| run.start);
    let mut united: Vec<Range<usize>> = Vec::new();
    for run in all {
        match united.last_mut().filter(|last| last.end >= run.start) {
            Some(last) => last.end = last.end.max(run.end),
            None => united.push(run),
        }
    }
    united
}

#[cfg(test)]
mod tests;
