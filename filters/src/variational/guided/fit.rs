//! Regressions over an image: the samples in rows, the blocks of pixels, and what each block sees.

use rayon::prelude::*;

use super::reach::Reach;
use crate::kernel::regress::{Centres, LANES, Lanes, Regress, Samples, Scales, Scratch};
use crate::kernel::{Isa, dispatch};
use crate::{Mask, Plane, Planes, Size};

/// Columns after which the samples of a row are counted anew.
const STRIDE: usize = 4;

/// The guides of an image, scaled.
#[derive(Clone, Copy, Debug)]
pub struct Field<'a> {
    /// The planes.
    pub planes: &'a [Plane],
    /// A label a pixel, if there are any.
    pub labels: Option<&'a [u32]>,
}

/// The samples of an image, ready to be looked up by place.
#[derive(Clone, Debug)]
pub struct Store {
    size: Size,
    samples: Samples,
    channels: usize,
    /// Samples before each run of [`STRIDE`] columns.
    starts: Vec<u32>,
}

impl Store {
    /// Takes the measured pixels of `values`.
    pub fn new(mask: &Mask, values: &Planes, field: Field<'_>) -> Self {
        let size = mask.size();
        let per_row = size.width.div_ceil(STRIDE) + 1;
        let mut samples = Samples::default();
        let (guides, channels) = (field.planes, values.as_slice());
        samples.at.reserve(mask.count());
        samples.guides.reserve(mask.count() * guides.len());
        samples.values.reserve(mask.count() * channels.len());
        let mut starts = Vec::with_capacity(size.height * per_row);
        for row in 0..size.height {
            for (column, &measured) in mask.row(row).iter().enumerate() {
                if column % STRIDE == 0 {
                    starts.push(samples.at.len() as u32);
                }
                if measured {
                    let index = row * size.width + column;
                    samples.at.push([row as f32, column as f32]);
                    samples.guides.extend(guides.iter().map(|plane| plane.pixels()[index]));
                    samples.values.extend(channels.iter().map(|plane| plane.pixels()[index]));
                    samples.labels.extend(field.labels.map(|labels| labels[index]));
                }
            }
            starts.push(samples.at.len() as u32);
        }
        Self { size, samples, channels: channels.len(), starts }
    }

    /// The runs of samples in a rectangle of rows and columns, its last ones included; columns are rounded outwards.
    fn runs(&self, rows: (usize, usize), columns: (usize, usize), runs: &mut Vec<(usize, usize)>) {
        let per_row = self.size.width.div_ceil(STRIDE) + 1;
        runs.clear();
        for row in rows.0..=rows.1 {
            let line = &self.starts[row * per_row..][..per_row];
            let (start, end) = (line[columns.0 / STRIDE], line[columns.1 / STRIDE + 1]);
            if start < end {
                runs.push((start as usize, end as usize));
            }
        }
    }

    /// Predicts the listed pixels of one neighbourhood, at most [`LANES`] of them.
    fn block(&self, at: &[[usize; 2]], work: &mut Worker<'_>) -> Lanes {
        let radius = |&[row, column]: &[usize; 2]| work.task.reach.at(row, column);
        for lane in 0..LANES {
            // Idle lanes repeat the last pixel.
            let [row, column] = at[lane.min(at.len() - 1)];
            let index = row * self.size.width + column;
            let centres = &mut work.centres;
            centres.at[0][lane] = row as f32;
            centres.at[1][lane] = column as f32;
            let radius = radius(&[row, column]);
            centres.inverse[lane] = 1.0 / (radius * radius);
            for (guide, plane) in centres.guides.iter_mut().zip(work.task.field.planes) {
                guide[lane] = plane.pixels()[index];
            }
            centres.labels[lane] = work.task.field.labels.map_or(0, |labels| labels[index]);
        }
        let far = at.iter().map(radius).fold(0.0, f32::max) as usize;
        let span = |axis: usize, end: usize| {
            let all = at.iter().map(|at| at[axis]);
            let (low, high) = (all.clone().min().unwrap_or(0), all.max().unwrap_or(0));
            (low.saturating_sub(far), (high + far).min(end - 1))
        };
        self.runs(span(0, self.size.height), span(1, self.size.width), &mut work.runs);
        let regress = Regress {
            samples: &self.samples,
            channels: self.channels,
            runs: &work.runs,
            centres: &work.centres,
            scales: work.task.scales,
            leave_out: work.task.leave_out,
            scratch: &mut work.scratch,
            out: &mut work.out,
        };
        dispatch(work.task.isa, regress)
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

struct Worker<'a> {
    task: Task<'a>,
    centres: Centres,
    runs: Vec<(usize, usize)>,
    scratch: Scratch,
    out: Vec<Lanes>,
}

impl<'a> Worker<'a> {
    fn new(task: Task<'a>, channels: usize) -> Self {
        let guides = task.scales.bandwidths.len();
        let zero = [0.0; LANES];
        Self {
            task,
            centres: Centres { at: [zero; 2], inverse: zero, guides: vec![zero; guides], labels: [0; LANES] },
            runs: Vec::new(),
            scratch: Scratch::new(guides, channels),
            out: vec![zero; channels],
        }
    }
}

/// Pixels of a side of the blocks in which all pixels are predicted.
const SIDE: usize = 4;

/// Predicts every pixel; where nothing is near, `values` stay as they are.
pub fn everywhere(store: &Store, task: Task<'_>, values: &mut Planes) {
    let Size { height, width } = store.size;
    let bands: Vec<Vec<f32>> = (0..height.div_ceil(SIDE))
        .into_par_iter()
        .map(|band| {
            let rows = (height - band * SIDE).min(SIDE);
            let mut found = vec![f32::NAN; store.channels * rows * width];
            let mut work = Worker::new(task, store.channels);
            for left in (0..width).step_by(SIDE) {
                let columns = (width - left).min(SIDE);
                let mut at = [[0; 2]; LANES];
                let pixels = rows * columns;
                for (index, at) in at[..pixels].iter_mut().enumerate() {
                    *at = [band * SIDE + index / columns, left + index % columns];
                }
                let weights = store.block(&at[..pixels], &mut work);
                for (lane, [row, column]) in at[..pixels].iter().enumerate() {
                    if weights[lane] > 0.0 {
                        for (channel, out) in work.out.iter().enumerate() {
                            found[(channel * rows + row - band * SIDE) * width + column] = out[lane];
                        }
                    }
                }
            }
            found
        })
        .collect();
    values.as_mut_slice().par_iter_mut().enumerate().for_each(|(channel, plane)| {
        for (pixels, found) in plane.pixels_mut().chunks_mut(SIDE * width).zip(&bands) {
            let found = &found[channel * pixels.len()..][..pixels.len()];
            for (pixel, &found) in pixels.iter_mut().zip(found).filter(|(_, found)| found.is_finite()) {
                *pixel = found;
            }
        }
    });
}

/// Predicts the pixels that are marked in `wanted`, in blocks of near ones, keeping one tile in `keep_every`; each entry
/// is a pixel's index and its channels.
pub fn at_marked(store: &Store, task: Task<'_>, wanted: &Mask, keep_every: usize) -> Vec<(usize, Vec<f32>)> {
    let Size { height, width } = store.size;
    let density = wanted.density().max(1e-4);
    let side = ((LANES as f64 / density).sqrt().round() as usize).clamp(SIDE, 32);
    let columns = width.div_ceil(side);
    let tiles = height.div_ceil(side) * columns;
    let found: Vec<Vec<(usize, Vec<f32>)>> = (0..tiles)
        .into_par_iter()
        .filter(|tile| tile % keep_every == keep_every / 2)
        .map(|tile| {
            let (top, left) = (tile / columns * side, tile % columns * side);
            let (bottom, right) = ((top + side).min(height), (left + side).min(width));
            let all = (top..bottom).flat_map(|row| (left..right).map(move |column| [row, column]));
            let at: Vec<_> = all.filter(|&[row, column]| wanted.is_measured(row, column)).collect();
            let mut work = Worker::new(task, store.channels);
            let mut found = Vec::with_capacity(at.len());
            for at in at.chunks(LANES) {
                let weights = store.block(at, &mut work);
                for (lane, [row, column]) in at.iter().enumerate() {
                    let values: Vec<f32> = work.out.iter().map(|out| out[lane]).collect();
                    if weights[lane] > 0.0 && values.iter().all(|value| value.is_finite()) {
                        found.push((row * width + column, values));
                    }
                }
            }
            found
        })
        .collect();
    found.into_iter().flatten().collect()
}
