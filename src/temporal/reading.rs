//! Which convention the vectors of a frame and its neighbours are read by. All are held against the same samples, those of all neighbours that have moved,
//! and the one by which the frame agrees with them most is taken for all.

use lacuna_filters::temporal::Judge;
use lacuna_filters::{Planes, Size};

use super::Neighbour;
use super::reference::{Reference, measured};
use super::vectors::{self, Layer, Reading};

/// Samples of a neighbour that are asked at most.
const ASKED: usize = 1 << 14;
/// The part of the disagreement by which a less usual reading must be better.
const TIE: f64 = 1e-3;

/// What the samples of one side of the frame say: the disagreement by each reading of each layer, and by no motion; sums over samples.
#[derive(Clone)]
struct Side {
    layers: Vec<Vec<f64>>,
    still: f64,
}

impl Side {
    fn new(layers: usize) -> Self {
        Self { layers: vec![vec![0.0; Reading::all().len()]; layers], still: 0.0 }
    }

    fn add(&mut self, neighbour: &Neighbour, part: usize, layers: &[Layer], reference: &Reference<'_>) {
        let Some((samples, mask)) = measured(neighbour, part, &reference.names) else { return };
        let (width, display) = (samples.size().width, neighbour.frame.parts[part].display_window.size());
        let corner = reference.corner(neighbour, part).map(|at| at as f32);
        let raw: Vec<_> = layers.iter().map(|layer| vectors::raw(neighbour.source(), part, layer)).collect();
        // What does not move lies in one place by every reading.
        let moved = |at: usize| {
            let led = |raw: &Vec<[f32; 2]>| raw[at].iter().all(|v| v.is_finite()) && raw[at] != [0.0; 2];
            mask.as_slice()[at] && finite(&samples, at) && raw.iter().flatten().any(led)
        };
        let moved: Vec<usize> = (0..mask.size().pixels()).filter(|&at| moved(at)).collect();
        let judge = Judge::new(&reference.filled, reference.mask);
        let readings = Reading::all();
        for &at in moved.iter().step_by(moved.len().div_ceil(ASKED).max(1)) {
            let [row, column] = [(at / width) as f32 + corner[0], (at % width) as f32 + corner[1]];
            let Some(still) = judge.of(&samples, at, [row, column]) else { continue };
            let by = |raw: &Option<Vec<[f32; 2]>>, reading: &Reading| {
                let [down, across] = shift(*reading, display, -neighbour.offset, raw.as_ref()?[at]);
                judge.of(&samples, at, [row + down, column + across])
            };
            let all: Vec<Vec<_>> =
                raw.iter().map(|raw| readings.iter().map(|one| by(raw, one)).collect()).collect();
            // To lead out of the image is no better than the worst that another reading makes of it.
            let worst = all.iter().flatten().flatten().copied().fold(still, f64::max);
            for (sums, errors) in self.layers.iter_mut().zip(all) {
                sums.iter_mut().zip(errors).for_each(|(sum, error)| *sum += error.unwrap_or(worst));
            }
            self.still += still;
        }
    }
}

fn finite(samples: &Planes, at: usize) -> bool {
    samples.as_slice().iter().all(|plane| plane.pixels()[at].is_finite())
}

/// How far a vector leads in so many frames, in pixels.
fn shift(reading: Reading, size: Size, frames: i64, vector: [f32; 2]) -> [f32; 2] {
    let scale = reading.scale(size);
    std::array::from_fn(|axis| frames as f32 * scale[axis] * vector[axis])
}

/// The layer of vectors of the neighbours before and of those after the frame, and how it is read, if that is better than no motion.
pub fn choose(
    neighbours: &[&Neighbour],
    part: usize,
    reference: &Reference<'_>,
) -> [Option<(Layer, Reading)>; 2] {
    let mut layers: Vec<Layer> = Vec::new();
    for neighbour in neighbours {
        let new: Vec<_> =
            vectors::layers(neighbour, part).into_iter().filter(|layer| !layers.contains(layer)).collect();
        layers.extend(new);
    }
    let mut sides = [Side::new(layers.len()), Side::new(layers.len())];
    for neighbour in neighbours {
        sides[usize::from(neighbour.offset > 0)].add(neighbour, part, &layers, reference);
    }
    let readings = Reading::all();
    let still: f64 = sides.iter().map(|side| side.still).sum();
    let read = |layer: usize| {
        let sums: Vec<f64> =
            (0..readings.len()).map(|k| sides.iter().map(|side| side.layers[layer][k]).sum()).collect();
        let least = sums.iter().copied().fold(f64::INFINITY, f64::min);
        // Where nothing moves, all readings are one.
        let good = |sum: f64| sum <= least * (1.0 + TIE) && (sum < still || still == 0.0);
        sums.iter().position(|&sum| good(sum))
    };
    let read: Vec<(usize, usize)> =
        (0..layers.len()).filter_map(|layer| Some((layer, read(layer)?))).collect();
    // Of layers to the frame before and to the next one, each side has its better one.
    std::array::from_fn(|side| {
        let error = |&&(layer, k): &&(usize, usize)| sides[side].layers[layer][k];
        let best = read.iter().min_by(|a, b| error(a).total_cmp(&error(b)))?;
        Some((layers[best.0].clone(), readings[best.1]))
    })
}
