//! The correction of an image, tile by tile: detail, network, and what both make of the pixels.

use std::ops::Range;
use std::sync::LazyLock;

use crate::kernel::convolution::{Activation, Convolve, Layer, Maps, Room, convolve};
use crate::kernel::detail::{Detail, MOST, Measure, Span};
use crate::kernel::{Isa, dispatch};
use crate::tiling::{Core, Tiling};
use crate::{Mask, Plane, Planes, Run, Size};

/// The learned weights: for each layer those by output, input, row and column, then the biases; 32-bit floats, least byte first.
static WEIGHTS: &[u8] = include_bytes!("weights.f32");
/// Inputs and outputs of each layer.
const LAYERS: [(usize, usize); 4] = [(INPUTS, 24), (24, 24), (24, 24), (24, BLOCK * BLOCK)];
/// Planes of a block: detail, detail of measured pixels, which are measured and range, of each pixel; and the strength of the finest detail.
const INPUTS: usize = 4 * BLOCK * BLOCK + 1;
/// Pixels of the side of a block.
const BLOCK: usize = 2;
/// Pixels of the side of a tile.
const SIDE: usize = 128;
/// Pixels around it: four layers reach four blocks, detail 11 pixels, and blocks begin at even places.
const HALO: usize = 20;
/// Blocks of a row that are computed together or not at all.
const STEP: usize = 4;
/// The least amplitude of a correction, in units.
pub const LEAST: f32 = 3e-4;

/// The network.
static NETWORK: LazyLock<[Layer; 4]> = LazyLock::new(|| {
    let (words, _) = WEIGHTS.as_chunks::<4>();
    let mut rest: Vec<f32> = words.iter().map(|word| f32::from_le_bytes(*word)).collect();
    let layers = LAYERS.map(|(inputs, outputs)| {
        let weights: Vec<f32> = rest.drain(..inputs * outputs * 9).collect();
        let bias: Vec<f32> = rest.drain(..outputs).collect();
        Layer::new(&weights, &bias)
    });
    assert!(rest.is_empty(), "weights.f32 holds more than the layers");
    layers
});

/// Corrects the missing pixels of an image; the values of each channel vary by about as much as its unit, a power of two.
pub fn refine(mask: &Mask, units: &[f32], out: &mut Planes, run: &Run<'_>) {
    let tiling = Tiling { side: SIDE, halo: HALO, shift: 0 };
    let isa = Isa::best();
    let _: Vec<()> = tiling.map(mask, out, run, |tile: &mut Tile, core, before| {
        let mut values = Vec::with_capacity(core.inner.pixels() * before.len());
        let mut changes = false;
        tile.flags(core, mask);
        for (plane, &unit) in before.as_slice().iter().zip(units) {
            tile.read(core, plane, unit.recip());
            changes |= tile.correct(isa);
            tile.append(unit, &mut values);
        }
        changes.then_some((values, ()))
    });
}

/// A tile's window, with rows and columns continued to even numbers of them, and room for what is computed of it.
#[derive(Default)]
struct Tile {
    height: usize,
    width: usize,
    /// The tile within the window.
    rows: Range<usize>,
    columns: Range<usize>,
    values: Vec<f32>,
    /// 1 where a pixel was measured, else 0.
    measured: Vec<f32>,
    detail: Detail,
    maps: [Maps; 2],
    room: Room,
    /// Columns of blocks by row, for the last layer and those before it.
    runs: [Vec<Vec<Range<usize>>>; LAYERS.len()],
}

impl Tile {
    /// Takes on a window, and which of its pixels were measured.
    fn flags(&mut self, core: &Core, mask: &Mask) {
        let even = |length: usize| length.next_multiple_of(BLOCK);
        (self.height, self.width) = (even(core.outer.height), even(core.outer.width));
        self.rows = core.margin.0..core.margin.0 + core.inner.height;
        self.columns = core.margin.1..core.margin.1 + core.inner.width;
        self.values.resize(self.height * self.width, 0.0);
        self.measured.resize(self.height * self.width, 0.0);
        for (y, row) in self.measured.chunks_exact_mut(self.width).enumerate().take(core.outer.height) {
            let flags = &mask.row(core.origin.0 + y)[core.origin.1..];
            row.iter_mut().zip(flags).for_each(|(to, flag)| *to = f32::from(u8::from(*flag)));
        }
        continue_outwards(&mut self.measured, self.width, core);
    }

    /// Takes on a window's values.
    fn read(&mut self, core: &Core, from: &Plane, factor: f32) {
        core.copy(from, factor, self.width, &mut self.values);
        continue_outwards(&mut self.values, self.width, core);
    }

    /// Corrects the tile's missing pixels; false if none may change.
    fn correct(&mut self, isa: Isa) -> bool {
        if dispatch(isa, Span(&self.values)) <= LEAST {
            return false;
        }
        dispatch(isa, Measure { values: &self.values, width: self.width, detail: &mut self.detail });
        if !self.find_active() {
            return false;
        }
        let blocks = (self.height / BLOCK, self.width / BLOCK);
        self.inputs(blocks);
        let [mut from, mut to] = self.maps.each_mut();
        for (k, layer) in NETWORK.iter().enumerate() {
            let activation = match k {
                0 => Activation::Relu,
                _ if k + 1 == LAYERS.len() => Activation::Linear,
                _ => Activation::ResidualRelu,
            };
            to.resize(blocks, layer.outputs());
            let runs = &self.runs[LAYERS.len() - 1 - k];
            convolve(isa, Convolve { layer, from, to, runs, room: &mut self.room, activation });
            std::mem::swap(&mut from, &mut to);
        }
        self.add();
        true
    }

    /// Finds which blocks may change, in runs, and which of them each layer before the last must know; false if none may.
    fn find_active(&mut self) -> bool {
        let (rows, columns) = (self.height / BLOCK, (self.width / BLOCK).div_ceil(STEP));
        let mut flags = vec![false; rows * columns];
        for y in self.rows.clone() {
            let pixels = y * self.width + self.columns.start..y * self.width + self.columns.end;
            let amplitudes = self.detail.amplitude[pixels.clone()].iter();
            for ((x, amplitude), measured) in self.columns.clone().zip(amplitudes).zip(&self.measured[pixels])
            {
                flags[y / BLOCK * columns + x / (BLOCK * STEP)] |= *amplitude > LEAST && *measured == 0.0;
            }
        }
        if !flags.contains(&true) {
            return false;
        }
        for (k, runs) in self.runs.iter_mut().enumerate() {
            if k == 1 {
                // As far to either side as all layers after the first reach together.
                const { assert!(STEP >= LAYERS.len() - 1) };
                flags = widened(&flags, columns);
            }
            if k > 0 {
                flags = heightened(&flags, columns);
            }
            runs.resize(rows, Vec::new());
            for (flags, runs) in flags.chunks_exact(columns).zip(runs) {
                runs.clear();
                runs.extend(runs_of(flags, self.width / BLOCK));
            }
        }
        true
    }

    /// Lays out what the network sees of blocks.
    fn inputs(&mut self, (rows, columns): (usize, usize)) {
        let maps = &mut self.maps[0];
        maps.resize((rows, columns), INPUTS);
        let Detail { signed, fine, steep, .. } = &self.detail;
        let each = BLOCK * BLOCK;
        for row in 0..rows {
            maps.row_mut(INPUTS - 1, row).fill(0.0);
            for k in 0..each {
                let first = (BLOCK * row + k / BLOCK) * self.width + k % BLOCK;
                let measured = &self.measured;
                every(maps.row_mut(k, row), first, |i, to| *to = signed[i]);
                every(maps.row_mut(each + k, row), first, |i, to| *to = signed[i] * measured[i]);
                every(maps.row_mut(2 * each + k, row), first, |i, to| *to = measured[i] - 0.5);
                every(maps.row_mut(3 * each + k, row), first, |i, to| *to = steep[i] / MOST - 0.5);
                every(maps.row_mut(INPUTS - 1, row), first, |i, to| *to += fine[i] / each as f32);
            }
        }
    }

    /// Adds what the network says to the missing pixels of active blocks.
    fn add(&mut self) {
        let Detail { low, high, amplitude, .. } = &self.detail;
        // The last layer's planes are where the first one's inputs were.
        const { assert!(LAYERS.len().is_multiple_of(2)) };
        let maps = &self.maps[0];
        for (row, runs) in self.runs[0].iter().enumerate() {
            for (k, x) in
                runs.iter().flat_map(|run| (0..BLOCK * BLOCK).flat_map(|k| run.clone().map(move |x| (k, x))))
            {
                let i = (BLOCK * row + k / BLOCK) * self.width + k % BLOCK + BLOCK * x;
                if self.measured[i] == 0.0 {
                    let value = self.values[i] + maps.row(k, row)[x] * amplitude[i];
                    self.values[i] = value.max(low[i]).min(high[i]);
                }
            }
        }
    }

    /// Appends the tile's own pixels, times a factor.
    fn append(&self, factor: f32, to: &mut Vec<f32>) {
        let rows = self.values.chunks_exact(self.width).skip(self.rows.start).take(self.rows.len());
        to.extend(rows.flat_map(|row| &row[self.columns.clone()]).map(|value| value * factor));
    }
}

/// Continues a window by its last row and column where it is longer and wider than that.
fn continue_outwards(values: &mut [f32], width: usize, core: &Core) {
    let Size { height: h, width: w } = core.outer;
    values.chunks_exact_mut(width).take(h).for_each(|row| {
        let last = row[w - 1];
        row[w..].fill(last);
    });
    let (known, beyond) = values.split_at_mut(h * width);
    beyond.chunks_exact_mut(width).for_each(|row| row.copy_from_slice(&known[(h - 1) * width..]));
}

/// Does something with the value of each block of a row and the place of its pixel, the first one's given.
fn every(row: &mut [f32], first: usize, f: impl Fn(usize, &mut f32)) {
    row.iter_mut().enumerate().for_each(|(x, to)| f(first + BLOCK * x, to));
}

/// The runs of blocks that the flags of a row stand for, [`STEP`] blocks each.
fn runs_of(flags: &[bool], end: usize) -> impl Iterator<Item = Range<usize>> {
    let mut next = 0;
    flags.chunk_by(|a, b| a == b).filter_map(move |same| {
        let first = next;
        next += same.len();
        same[0].then_some(STEP * first..(STEP * next).min(end))
    })
}

/// Flags that are set, or have one beside them in their row.
fn widened(flags: &[bool], columns: usize) -> Vec<bool> {
    let row = |row: &[bool]| -> Vec<bool> {
        (0..columns).map(|x| row[x.saturating_sub(1)..(x + 2).min(columns)].contains(&true)).collect()
    };
    flags.chunks_exact(columns).flat_map(row).collect()
}

/// Flags that are set, or have one above or below them.
fn heightened(flags: &[bool], columns: usize) -> Vec<bool> {
    let below = |i: usize| flags.get(i + columns) == Some(&true);
    (0..flags.len()).map(|i| flags[i] || (i >= columns && flags[i - columns]) || below(i)).collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use lacuna_core::hash;

    /// Rows of results are made four together, from more than they need: what maps held before must not reach them, not even by rounding.
    #[test]
    fn what_was_there_before_changes_no_bit() {
        let size = Size::new(90, 150);
        let core = Core { origin: (0, 0), outer: size, inner: size, margin: (0, 0) };
        for seed in 0..12 {
            // Spots apart from each other, at any places and of any height, flat between them.
            let drawn = |k: u64, most: f32| most * (hash(seed, k) >> 40) as f32 / (1 << 24) as f32;
            let spot = |k: u64| [drawn(3 * k, 90.0), drawn(3 * k + 1, 150.0), 2.0 + drawn(3 * k + 2, 9.0)];
            let spots: Vec<[f32; 3]> = (0..13).map(spot).collect();
            let value = |y: usize, x: usize| {
                let near = |[v, u, r]: &[f32; 3]| (y as f32 - v).hypot(x as f32 - u) < *r;
                if spots.iter().any(near) { 0.8 + 0.01 * x as f32 } else { 0.2 }
            };
            let mask = Mask::from_fn(size, |y, x| (3 * y + 7 * x) % 11 < 4);
            let image = Plane::from_fn(size, value);
            let mut tile = Tile::default();
            let mut made = |before: Option<f32>| {
                tile.flags(&core, &mask);
                tile.read(&core, &image, 1.0);
                if let Some(value) = before {
                    tile.maps.iter_mut().for_each(|maps| maps.spoil(value));
                }
                assert!(tile.correct(Isa::best()));
                let mut values = Vec::new();
                tile.append(1.0, &mut values);
                values.into_iter().map(f32::to_bits).collect::<Vec<u32>>()
            };
            let first = made(None);
            assert!(first.iter().zip(image.pixels()).any(|(bits, value)| *bits != value.to_bits()));
            for before in [f32::NAN, 1e30, f32::INFINITY, 0.7, -30.0] {
                assert!(made(Some(before)) == first, "{seed}: {before}");
            }
            let gaps = tile.runs[0].iter().filter(|runs| runs.len() > 1).count();
            assert!(gaps > 10, "{gaps}");
        }
    }
}
