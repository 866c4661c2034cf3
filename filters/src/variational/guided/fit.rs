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
/// Tiles that one task takes, so that threads end together.
pub(super) const AT_ONCE: usize = 8;
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
        let channels = values.as_slice();
        let counts = mask.as_slice().par_chunks(BAND * size.width.max(1));
        let counts = counts.map(|flags| flags.iter().filter(|flag| **flag).count());
        let count = mask.count();
        let mut samples = Samples {
            at: vec![[0.0; 2]; count],
            guides: vec![0.0; count * field.count()],
            values: vec![0.0; count * channels.len()],
            labels: vec![0; field.labels.map_or(0, |_| count)],
            weights: Vec::new(),
        };
        let mut starts = vec![0; size.height * (size.width + 1)];
        let mut rest = Band::new(&mut samples, &mut starts);
        let bands: Vec<Band<'_>> = (0..size.height)
            .step_by(BAND)
            .zip(counts)
            .map(|(row, count)| {
                let rows = row..size.height.min(row + BAND);
                rest.split_off(rows, (count, field.count(), channels.len()), size.width + 1)
            })
            .collect();
        bands.into_par_iter().for_each(|band| band.fill(mask, channels, field));
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

/// Some rows of a store.
struct Band<'a> {
    rows: Range<usize>,
    /// Samples of the rows before.
    before: usize,
    at: &'a mut [[f32; 2]],
    guides: &'a mut [f32],
    values: &'a mut [f32],
    labels: &'a mut [u32],
    starts: &'a mut [u32],
}

impl<'a> Band<'a> {
    /// All of it.
    fn new(samples: &'a mut Samples, starts: &'a mut [u32]) -> Self {
        let Samples { at, guides, values, labels, .. } = samples;
        Self { rows: 0..0, before: 0, at, guides, values, labels, starts }
    }

    /// The next rows with so many samples, guides and channels.
    fn split_off(
        &mut self,
        rows: Range<usize>,
        (count, guides, channels): (usize, usize, usize),
        per_row: usize,
    ) -> Self {
        let before = self.before;
        self.before += count;
        let labels = if self.labels.is_empty() { 0 } else { count };
        Self {
            before,
            at: self.at.split_off_mut(..count).unwrap_or_default(),
            guides: self.guides.split_off_mut(..count * guides).unwrap_or_default(),
            values: self.values.split_off_mut(..count * channels).unwrap_or_default(),
            labels: self.labels.split_off_mut(..labels).unwrap_or_default(),
            starts: self.starts.split_off_mut(..rows.len() * per_row).unwrap_or_default(),
            rows,
        }
    }

    /// Takes what stands in these rows.
    fn fill(self, mask: &Mask, channels: &[Plane], field: Field<'_>) {
        let (width, guides) = (mask.size().width, field.count());
        let mut own = 0;
        for (row, starts) in self.rows.zip(self.starts.chunks_exact_mut(width + 1)) {
            for ((column, &measured), start) in mask.row(row).iter().enumerate().zip(&mut *starts) {
                *start = (self.before + own) as u32;
                if !measured {
                    continue;
                }
                let index = row * width + column;
                self.at[own] = [row as f32, column as f32];
                let to = self.guides[own * guides..][..guides].iter_mut();
                to.zip(field.all()).for_each(|(to, plane)| *to = plane.pixels()[index]);
                let to = self.values[own * channels.len()..][..channels.len()].iter_mut();
                to.zip(channels).for_each(|(to, plane)| *to = plane.pixels()[index]);
                if let Some(labels) = field.labels {
                    self.labels[own] = labels[index];
                }
                own += 1;
            }
            starts[width] = (self.before + own) as u32;
        }
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
    pub(super) fn cell(
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
pub(super) fn side(wanted: &Mask) -> usize {
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
    let tile = (2 * far).clamp(TILE.0, TILE.1).next_multiple_of(side);
    let tiles = tiles(values, tile).into_par_iter().with_max_len(AT_ONCE);
    tiles.for_each_init(
        || Worker::new(store, task),
        |work, Tile { rows, columns, mut out }| {
            out.iter_mut().flatten().for_each(|row| row.fill(f32::NAN));
            work.open(&rows, &columns);
            for (own_rows, own_columns) in parts(rows.clone(), side)
                .flat_map(|rows| parts(columns.clone(), side).map(move |columns| (rows.clone(), columns)))
            {
                work.cell(wanted, (own_rows, own_columns), |[row, column], found, lane| {
                    for (channel, found) in out.iter_mut().zip(found) {
                        channel[row - rows.start][column - columns.start] = found.0[lane];
                    }
                });
            }
        },
    );
}

/// A tile of an image: by channel its part of each row.
pub(super) struct Tile<'a> {
    pub rows: Range<usize>,
    pub columns: Range<usize>,
    pub out: Vec<Vec<&'a mut [f32]>>,
}

/// The planes cut into tiles with this side.
pub(super) fn tiles(values: &mut Planes, side: usize) -> Vec<Tile<'_>> {
    let (Size { height, width }, channels) = (values.size(), values.len());
    let across = width.div_ceil(side);
    let mut tiles: Vec<Tile<'_>> = parts(0..height, side)
        .flat_map(|rows| parts(0..width, side).map(move |columns| (rows.clone(), columns)))
        .map(|(rows, columns)| Tile { rows, columns, out: (0..channels).map(|_| Vec::new()).collect() })
        .collect();
    for (channel, plane) in values.as_mut_slice().iter_mut().enumerate() {
        for (row, pixels) in plane.pixels_mut().chunks_mut(width.max(1)).enumerate() {
            let row = &mut tiles[row / side * across..][..across];
            row.iter_mut().zip(pixels.chunks_mut(side)).for_each(|(tile, part)| tile.out[channel].push(part));
        }
    }
    tiles
}
