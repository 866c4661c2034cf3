//! Regressions over an image at the nodes of a grid: see [`crate::kernel::regress::nodes`].
//!
//! For weights that depend on place alone. The nodes of a tile are fitted together, those on its border once for either tile, as
//! coefficients are relative to origins of the tile.

use std::ops::Range;

use lacuna_core::parallel::prelude::*;

use super::fit::{AT_ONCE, Store, Task, Tile, Worker, tiles};
use crate::kernel::dispatch;
use crate::kernel::regress::LANES;
use crate::kernel::regress::nodes::{Between, Fit, Node, record};
use crate::kernel::simd::vectors;
use crate::{Mask, Planes};

/// Pixels between nodes, over the smallest radius.
const STEP: f32 = 0.8;
/// Side of a tile, about: the products of the samples that its nodes see are to stay in the cache.
const TILE: usize = 48;

/// Predicts the pixels that are marked in `wanted`; where nothing is near, and elsewhere, `values` become NaN. Weights of guides and labels are
/// left out of account.
pub fn predict_between(store: &Store, task: Task<'_>, wanted: &Mask, values: &mut Planes) {
    let step = ((STEP * task.reach.least()) as usize).max(1);
    let tile = TILE.next_multiple_of(step);
    let tiles = tiles(values, tile).into_par_iter().with_max_len(AT_ONCE);
    tiles.for_each_init(
        || Nodes {
            worker: Worker::new(store, task),
            fitted: Vec::new(),
            records: Vec::new(),
            line: Vec::new(),
        },
        |work, Tile { rows, columns, mut out }| {
            out.iter_mut().flatten().for_each(|row| row.fill(f32::NAN));
            work.fit(&rows, &columns, step);
            for row in rows.clone() {
                let channels = out.iter_mut().map(|channel| &mut *channel[row - rows.start]);
                let wanted = &wanted.row(row)[columns.clone()];
                work.predict((&rows, &columns), row, step, wanted, &mut channels.collect::<Vec<_>>());
            }
        },
    );
}

/// The nodes of one tile after the other.
struct Nodes<'a> {
    worker: Worker<'a>,
    fitted: Vec<Node>,
    /// By row of nodes and node its record.
    records: Vec<f32>,
    line: Vec<f32>,
}

impl Nodes<'_> {
    /// Fits the nodes in and around some rows and columns.
    fn fit(&mut self, rows: &Range<usize>, columns: &Range<usize>, step: usize) {
        let worker = &mut self.worker;
        worker.open(&(rows.start..rows.end + step), &(columns.start..columns.end + step));
        let record = record(&worker.table);
        let [down, along] = [rows, columns].map(|span| count(span, step));
        self.records.clear();
        self.records.resize(down * along * record, 0.0);
        let places = (0..down * along)
            .map(|node| (rows.start + node / along * step, columns.start + node % along * step))
            .collect::<Vec<_>>();
        for (places, records) in places.chunks(LANES).zip(self.records.chunks_mut(LANES * record)) {
            worker.runs.clear();
            self.fitted.clear();
            for &(row, column) in places {
                let radius = worker.task.reach.at(row, column);
                let first = worker.runs.len();
                worker.look((row, row), (column, column), radius);
                self.fitted.push(Node {
                    at: [row as f32, column as f32],
                    inverse: 1.0 / (radius * radius),
                    runs: first..worker.runs.len(),
                });
            }
            let fit = Fit {
                table: &worker.table,
                runs: &worker.runs,
                nodes: &self.fitted,
                scratch: &mut worker.scratch,
                records,
            };
            vectors(worker.task.isa, fit);
        }
    }

    /// Predicts the wanted pixels of a row of the tile.
    fn predict(
        &mut self,
        (rows, columns): (&Range<usize>, &Range<usize>),
        row: usize,
        step: usize,
        wanted: &[bool],
        out: &mut [&mut [f32]],
    ) {
        let worker = &self.worker;
        let width = worker.store.size.width;
        let guides: Vec<&[f32]> = { worker.task.field.all() }
            .map(|plane| &plane.pixels()[row * width..][columns.clone()])
            .collect();
        let line = count(columns, step) * record(&worker.table);
        let above = (row - rows.start) / step;
        let records = [above, above + 1].map(|at| &self.records[at * line..][..line]);
        let part = ((row - rows.start) % step) as f32 / step as f32;
        let line = &mut self.line;
        let table = &worker.table;
        dispatch(worker.task.isa, Between { table, records, part, step, guides: &guides, wanted, line, out });
    }
}

/// Nodes that a span of pixels lies between.
fn count(span: &Range<usize>, step: usize) -> usize {
    span.len().div_ceil(step) + 1
}
