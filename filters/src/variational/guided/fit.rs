//! Regressions over an image: the samples in rows, the tiles whose pixels share a table of samples, and the blocks of
//! pixels that are predicted at once.

use std::ops::Range;

use lacuna_core::parallel::prelude::*;

use super::reach::Reach;
use crate::kernel::Isa;
use crate::kernel::regress::{Centres, LANES, Lanes, Regress, Samples, Scales, Scratch, Table};
use crate::kernel::simd::vectors;
use crate::{Mask, Plane, Planes, Size};

/// Pixels that a block holds on average: fewer than [`LANES`], so that few of them need a second one.
const FILLED: f64 = 14.0;
/// Rows whose samples one task takes.
const BAND: usize = 32;
/// Least and largest side of a tile, about.
const TILE: (usize, usize) = (48, 128);

/// The guides of an image, scaled.
#[derive(Clone, Copy, Debug)]
pub struct Field<'a> {
    /// The planes.
    pub planes: &'a [Plane],
    /// Further ones, after these.
    pub more: &'a [Plane],
    /// A label a pixel, if there are any.
    pub labels: Option<&'a [u32]>,
}

impl<'a> Field<'a> {
    /// All planes, in order.
    pub fn all(self) -> impl Iterator<Item = &'a Plane> {
        self.planes.iter().chain(self.more)
    }

    /// How many there are.
    pub fn count(self) -> usize {
        self.planes.len() + self.more.len()
    }
}

/// The samples of an image, ready to be looked up by place.
#[derive(Clone, Debug)]
pub struct Store {
    pub(super) size: Size,
    samples: Samples,
    channels: usize,
    /// By row and column, and the one after the last: samples before it.
    starts: Vec<u32>,
}

impl Store {
    /// Takes the measured pixels of `values`.
    pub fn new(mask: &Mask, values: &Planes, field: Field<'_>) -> Self {
        let size = mask.size();
        let per_row = size.width + 1;
        let channels = values.as_slice();
        let rows: Vec<usize> = (0..size.height).collect();
        let parts = rows.par_chunks(BAND).map(|rows| {
            let (mut samples, mut starts) = (Samples::default(), Vec::with_capacity(rows.len() * per_row));
            for &row in rows {
                for (column, &measured) in mask.row(row).iter().enumerate() {
                    starts.push(samples.at.len() as u32);
                    if measured {
                        let index = row * size.width + column;
                        samples.at.push([row as f32, column as f32]);
                        samples.guides.extend(field.all().map(|plane| plane.pixels()[index]));
                        samples.values.extend(channels.iter().map(|plane| plane.pixels()[index]));
                        samples.labels.extend(field.labels.map(|labels| labels[index]));
                    }
                }
                starts.push(samples.at.len() as u32);
            }
            (samples, starts)
        });
        let (mut samples, mut starts) = (Samples::default(), Vec::with_capacity(size.height * per_row));
        let count = mask.count();
        samples.at.reserve(count);
        samples.guides.reserve(count * field.count());
        samples.values.reserve(count * channels.len());
        for (part, own) in parts {
            let before = samples.at.len() as u32;
            starts.extend(own.into_iter().map(|start| before + start));
            samples.at.extend(part.at);
            samples.guides.extend(part.guides);
            samples.values.extend(part.values);
            samples.labels.extend(part.labels);
        }
        Self { size, samples, channels: channels.len(), starts }
    }

    /// The same where each sample weighs what the pixel of a plane says.
    pub fn weighted(mut self, weights: Option<&Plane>) -> Self {
        let own = weights
            .into_iter()
            .flat_map(|weights| self.samples.at.iter().map(|at| weights.at(at[0] as usize, at[1] as usize)));
        self.samples.weights = own.collect();
        self
    }

    /// The same with further samples beside those of `mask`, anywhere in the image.
    pub fn beside(mask: &Mask, values: &Planes, field: Field<'_>, more: &Samples) -> Self {
        let Self { size, samples: own, channels, mut starts } = Self::new(mask, values, field);
        let pixel = |at: &[f32; 2]| [at[0].max(0.0) as usize, at[1].max(0.0) as usize];
        let both = [&own, more];
        let all = (0..2).flat_map(|which| (0..both[which].at.len()).map(move |at| (which, at)));
        let mut order: Vec<_> = all.map(|(which, at)| (pixel(&both[which].at[at]), which, at)).collect();
        order.sort_unstable();
        let mut samples = Samples::default();
        let guides = field.count();
        for &(_, which, at) in &order {
            let from = both[which];
            samples.at.push(from.at[at]);
            samples.guides.extend_from_slice(&from.guides[at * guides..][..guides]);
            samples.values.extend_from_slice(&from.values[at * channels..][..channels]);
            samples.labels.extend(from.labels.get(at));
        }
        let mut order = order.into_iter().map(|(pixel, ..)| pixel).peekable();
        let mut count = 0;
        for (row, starts) in starts.chunks_exact_mut(size.width + 1).enumerate() {
            for (column, start) in starts.iter_mut().enumerate() {
                while order.next_if(|pixel| *pixel < [row, column]).is_some() {
                    count += 1;
                }
                *start = count;
            }
        }
        Self { size, samples, channels, starts }
    }

    /// Per column of a row, and the one after the last: samples before it.
    fn line(&self, row: usize) -> &[u32] {
        &self.starts[row * (self.size.width + 1)..][..=self.size.width]
    }
}

/// How samples are used.
#[derive(Clone, Copy, Debug)]
pub struct Task<'a> {
    /// The guides of all pixels.
    pub field: Field<'a>,
    /// What they count for.
    pub scales: &'a Scales,
    /// How far pixels look.
    pub reach: &'a Reach,
    /// Whether a pixel's own sample is left out.
    pub leave_out: bool,
    /// The instruction set.
    pub isa: Isa,
}

/// Predicts the pixels of one tile after the other.
pub(super) struct Worker<'a> {
    pub store: &'a Store,
    pub task: Task<'a>,
    pub table: Table,
    /// Rows and columns that the table's samples come from.
    seen: (Range<usize>, Range<usize>),
    /// Per row of these: its first sample in the store, and in the table.
    firsts: Vec<[u32; 2]>,
    centres: Centres,
    pub runs: Vec<(usize, usize)>,
    pub scratch: Scratch,
    out: Vec<Lanes>,
}

impl<'a> Worker<'a> {
    pub fn new(store: &'a Store, task: Task<'a>) -> Self {
        let guides = vec![Lanes::ZERO; task.scales.bandwidths.len()];
        let (at, inverse) = ([Lanes::ZERO; 2], Lanes::ZERO);
        Self {
            store,
            task,
            table: Table::new(task.scales, store.channels),
            seen: (0..0, 0..0),
            firsts: Vec::new(),
            centres: Centres { at, inverse, guides, labels: [0; LANES] },
            runs: Vec::new(),
            scratch: Scratch::default(),
            out: vec![Lanes::ZERO; store.channels],
        }
    }

    /// Takes the samples that the pixels of a tile may see.
    pub fn open(&mut self, rows: &Range<usize>, columns: &Range<usize>) {
        let far = self.task.reach.most(rows, columns) as usize;
        let around =
            |span: &Range<usize>, end: usize| span.start.saturating_sub(far)..(span.end + far).min(end);
        let Size { height, width } = self.store.size;
        let (rows, columns) = (around(rows, height), around(columns, width));
        self.runs.clear();
        self.firsts.clear();
        let mut count = 0;
        for row in rows.clone() {
            let line = self.store.line(row);
            let (start, end) = (line[columns.start], line[columns.end]);
            self.runs.push((start as usize, end as usize));
            self.firsts.push([start, count]);
            count += end - start;
        }
        self.table.fill(self.task.isa, &self.store.samples, &self.runs);
        self.seen = (rows, columns);
    }

    /// Adds the samples within the farthest reach of a block's pixels, whose first and last rows and columns are given, to the runs.
    pub fn look(&mut self, (top, bottom): (usize, usize), (left, right): (usize, usize), far: f32) {
        let (rows, columns) = &self.seen;
        let whole = far as usize;
        for row in top.saturating_sub(whole).max(rows.start)..(bottom + whole + 1).min(rows.end) {
            let away = (top.saturating_sub(row) + row.saturating_sub(bottom)) as f32;
            let half = (far * far - away * away).max(0.0).sqrt() as usize;
            let (from, to) = (
                left.saturating_sub(half).clamp(columns.start, columns.end),
                (right + half + 1).min(columns.end),
            );
            let line = self.store.line(row);
            if line[from] < line[to] {
                let [first, count] = self.firsts[row - rows.start];
                self.runs.push(((line[from] - first + count) as usize, (line[to] - first + count) as usize));
            }
        }
    }

    /// Predicts the listed pixels of the tile, at most [`LANES`] of them near each other.
    fn block(&mut self, at: &[[usize; 2]]) -> Lanes {
        let span = |axis: usize| {
            let all = at.iter().map(|at| at[axis]);
            all.fold((usize::MAX, 0), |(low, high), at| (low.min(at), high.max(at)))
        };
        let (rows, columns) = (span(0), span(1));
        // One radius for all: it changes slowly.
        let radius =
            self.task.reach.at(usize::midpoint(rows.0, rows.1), usize::midpoint(columns.0, columns.1));
        let centres = &mut self.centres;
        centres.inverse.0 = [1.0 / (radius * radius); LANES];
        // Idle lanes repeat the last pixel.
        let place = |lane: usize| at[lane.min(at.len() - 1)];
        let index: [usize; LANES] = std::array::from_fn(|lane| {
            let [row, column] = place(lane);
            centres.at[0].0[lane] = row as f32;
            centres.at[1].0[lane] = column as f32;
            row * self.store.size.width + column
        });
        for (guide, plane) in centres.guides.iter_mut().zip(self.task.field.all()) {
            let pixels = plane.pixels();
            guide.0 = index.map(|index| pixels[index]);
        }
        if let Some(labels) = self.task.field.labels {
            centres.labels = index.map(|index| labels[index]);
        }
        self.runs.clear();
        self.look(rows, columns, radius);
        let regress = Regress {
            table: &self.table,
            runs: &self.runs,
            centres: &self.centres,
            leave_out: self.task.leave_out,
            scratch: &mut self.scratch,
            out: &mut self.out,
        };
        vectors(self.task.isa, regress)
    }

    /// Predicts the marked pixels of some rows and columns of the tile; `found` gets each with its channels, unless nothing is
    /// near.
    fn cell(
        &mut self,
        wanted: &Mask,
        (rows, columns): (Range<usize>, Range<usize>),
        mut found: impl FnMut([usize; 2], &[Lanes], usize),
    ) {
        let mut at = [[0; 2]; LANES];
        let mut count = 0;
        let last = (rows.end - 1, columns.end - 1);
        for row in rows {
            for column in columns.clone() {
                if wanted.is_measured(row, column) {
                    at[count] = [row, column];
                    count += 1;
                }
                if count == LANES || (count > 0 && (row, column) == last) {
                    let weights = self.block(&at[..count]);
                    for (lane, at) in
                        at[..count].iter().enumerate().filter(|(lane, _)| weights.0[*lane] > 0.0)
                    {
                        if self.out.iter().all(|out| out.0[lane].is_finite()) {
                            found(*at, &self.out, lane);
                        }
                    }
                    count = 0;
                }
            }
        }
    }
}

/// Pixels of a cell's side, so that the marked ones of a cell about fill a block.
fn side(wanted: &Mask) -> usize {
    let density = wanted.density();
    if density >= 1.0 {
        return 4;
    }
    ((FILLED / density.max(1e-4)).sqrt() as usize).clamp(4, 32)
}

/// The parts of `length` pixels of a range.
pub(super) fn parts(range: Range<usize>, length: usize) -> impl Iterator<Item = Range<usize>> + Clone {
    let end = range.end;
    range.step_by(length).map(move |start| start..(start + length).min(end))
}

/// Predicts the pixels that are marked in `wanted`; where nothing is near, and elsewhere, `values` become NaN.
pub fn predict(store: &Store, task: Task<'_>, wanted: &Mask, values: &mut Planes) {
    let Size { height, width } = store.size;
    let side = side(wanted);
    let far = task.reach.most(&(0..height), &(0..width)) as usize;
    let most = (2 * far).clamp(TILE.0, TILE.1);
    // Bands of about the same height, so that threads end together.
    let tile = height.div_ceil(height.div_ceil(most).max(1)).max(1).next_multiple_of(side);
    let bands = bands(values, tile).into_par_iter().zip(parts(0..height, tile).collect::<Vec<_>>());
    bands.for_each_init(
        || Worker::new(store, task),
        |work, (mut band, rows)| {
            for pixels in &mut band {
                pixels.fill(f32::NAN);
            }
            for columns in parts(0..width, tile) {
                work.open(&rows, &columns);
                for (rows, columns) in parts(rows.clone(), side)
                    .flat_map(|rows| parts(columns.clone(), side).map(move |columns| (rows.clone(), columns)))
                {
                    work.cell(wanted, (rows, columns), |[row, column], out, lane| {
                        for (pixels, out) in band.iter_mut().zip(out) {
                            pixels[(row % tile) * width + column] = out.0[lane];
                        }
                    });
                }
            }
        },
    );
}

/// The planes cut into bands of so many rows: by band, its part of each plane.
pub(super) fn bands(values: &mut Planes, rows: usize) -> Vec<Vec<&mut [f32]>> {
    let Size { height, width } = values.size();
    let mut bands: Vec<Vec<&mut [f32]>> = (0..height.div_ceil(rows)).map(|_| Vec::new()).collect();
    for plane in values.as_mut_slice() {
        bands
            .iter_mut()
            .zip(plane.pixels_mut().chunks_mut(rows * width))
            .for_each(|(band, rows)| band.push(rows));
    }
    bands
}

/// Predictions at some pixels.
#[derive(Debug, Default)]
pub struct Found {
    /// Where they stand in a plane.
    pub at: Vec<usize>,
    /// Their channels, all of a pixel together.
    pub values: Vec<f32>,
}

/// Predicts pixels that are marked in `wanted`: those of one cell in `keep_every`, scattered over the image.
pub fn probe(store: &Store, task: Task<'_>, wanted: &Mask, keep_every: usize) -> Found {
    let Size { height, width } = store.size;
    let side = side(wanted);
    let cells = parts(0..height, side)
        .flat_map(|rows| parts(0..width, side).map(move |columns| (rows.clone(), columns)));
    let cells: Vec<_> = cells.skip(keep_every / 2).step_by(keep_every).collect();
    let found = cells.into_par_iter().map_init(
        || Worker::new(store, task),
        |work, (rows, columns)| {
            let mut found = Found::default();
            work.open(&rows, &columns);
            work.cell(wanted, (rows, columns), |[row, column], out, lane| {
                found.at.push(row * width + column);
                found.values.extend(out.iter().map(|out| out.0[lane]));
            });
            found
        },
    );
    let mut all = Found::default();
    for found in found {
        all.at.extend(found.at);
        all.values.extend(found.values);
    }
    all
}
