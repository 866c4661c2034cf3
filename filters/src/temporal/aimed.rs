//! Which missing pixel each sample of other frames pulls, towards which value and how firmly.

use std::ops::Range;

use lacuna_core::parallel::prelude::*;

use super::usual::wide;
use super::{AROUND, Carried, Changes, HALF, PIECE, Pulling, SPREAD, carried, drift, mean_square, missed};
use crate::kernel::blur::blur;
use crate::{Mask, Plane, Planes, Size};

/// Rows of the image whose sums one task takes.
const ROWS: usize = 32;
/// Disagreement below which frames are all as good, over the least at which a sample counts half.
const EXACT: f64 = 0.01;
/// What stands for the pixel of a sample that pulls none.
const NONE: u32 = u32::MAX;

/// Where the samples of another frame are, and what they pull.
pub struct Aim {
    /// The pixel that each is in.
    pixels: Vec<u32>,
    /// The missing pixel that each pulls, or `NONE`.
    targets: Vec<u32>,
    /// The samples that pull something, in the order of the bands of `ROWS` that these pixels are in.
    order: Vec<u32>,
    /// Those of each band.
    bands: Vec<Range<usize>>,
}

impl Aim {
    /// Of samples in an image of which these pixels are measured.
    pub fn new(mask: &Mask, carried: &Carried) -> Self {
        let size = mask.size();
        let one = |place: &[f32; 2]| {
            let target = missing_near(mask, *place).map_or(NONE, |at| at as u32);
            (carried::pixel(size, *place) as u32, target)
        };
        let both = carried.places.par_iter().with_min_len(PIECE).map(one);
        let (pixels, targets): (Vec<u32>, Vec<u32>) = both.into_iter().unzip();
        let band = |target: u32| target as usize / (ROWS * size.width);
        let mut bands = vec![0..0; size.height.div_ceil(ROWS)];
        targets.iter().filter(|target| **target != NONE).for_each(|target| bands[band(*target)].end += 1);
        let mut begun = 0;
        for own in &mut bands {
            let count = own.end;
            *own = begun..begun;
            begun += count;
        }
        let mut order = vec![0; begun];
        for (sample, target) in targets.iter().enumerate().filter(|(_, target)| **target != NONE) {
            let own = &mut bands[band(*target)];
            order[own.end] = sample as u32;
            own.end += 1;
        }
        Self { pixels, targets, order, bands }
    }
}

/// Values on the grid, less those of the image that was there first, and how firmly they pull.
pub struct Data {
    /// The values.
    pub values: Planes,
    /// How firmly each pixel is pulled where samples of the best frame weigh 1.
    firm: Plane,
    /// Largest last correction of each plane.
    pub tolerances: Vec<f64>,
}

impl Data {
    /// By an image and the one that was there first.
    pub fn new(
        mask: &Mask,
        (carried, aims): (&[Carried], &[Aim]),
        changes: Changes,
        (begun, image): (&Planes, &Planes),
        tolerance: f64,
    ) -> Self {
        let size = mask.size();
        let ranges: Vec<f64> = begun.as_slice().iter().map(|plane| wide(mask, plane)).collect();
        let widest = ranges.iter().copied().fold(0.0, f64::max);
        let least = (HALF * widest).max(f64::MIN_POSITIVE);
        // Whatever is off by more says no more of what is around.
        let most = if widest > 0.0 { widest as f32 } else { f32::MAX };
        let count = image.len().max(1);
        let mut missed: Vec<Vec<f32>> = carried.iter().map(|carried| missed(carried, image)).collect();
        if changes != Changes::Kept {
            drift::take_away(size, carried, &mut missed, (count, most));
        }
        // Finite, as a share is taken of it.
        let error = |missed: &[f32]| mean_square(missed).min(f64::from(f32::MAX)) as f32;
        let errors: Vec<Vec<f32>> =
            missed.iter().map(|missed| missed.par_chunks(count).with_min_len(PIECE).map(error)).collect();
        let around = Around::new(size, aims, (&errors, most));
        let firm = firmness((carried, aims), (&errors, &around), least);
        let mut values = Planes::zeros(size, image.len());
        let mut pulls = Plane::filled(size, 0.0);
        let rows = ROWS * size.width;
        let mut planes: Vec<_> =
            values.as_mut_slice().iter_mut().map(|plane| plane.pixels_mut().chunks_mut(rows)).collect();
        let bands = pulls.pixels_mut().chunks_mut(rows);
        let mut bands: Vec<(&mut [f32], Vec<&mut [f32]>)> =
            bands.map(|band| (band, planes.iter_mut().filter_map(Iterator::next).collect())).collect();
        bands.par_iter_mut().with_max_len(1).enumerate().for_each(|(band, (pulls, values))| {
            let first = band * rows;
            let mut weights = vec![0.0; pulls.len()];
            let mut sums = vec![vec![0.0; pulls.len()]; count];
            for (frame, aim) in aims.iter().enumerate() {
                for &i in &aim.order[aim.bands[band].clone()] {
                    let i = i as usize;
                    let at = aim.targets[i] as usize;
                    let pull = f64::from(firm[frame][i]);
                    weights[at - first] += pull;
                    let planes = image.as_slice().iter().zip(begun.as_slice());
                    let planes = planes.zip(&missed[frame][i * count..]);
                    for (sum, ((plane, begun), missed)) in sums.iter_mut().zip(planes) {
                        let shift = f64::from(plane.pixels()[at]) - f64::from(begun.pixels()[at]);
                        sum[at - first] += pull * (f64::from(*missed) + shift);
                    }
                }
            }
            pulls.iter_mut().zip(&weights).for_each(|(pull, weight)| *pull = *weight as f32);
            for (values, sums) in values.iter_mut().zip(&sums) {
                let all = values.iter_mut().zip(sums.iter().zip(&weights));
                all.filter(|(_, (_, weight))| **weight > 0.0)
                    .for_each(|(value, (sum, weight))| *value = (sum / weight) as f32);
            }
        });
        Self { values, firm: pulls, tolerances: ranges.into_iter().map(|range| tolerance * range).collect() }
    }

    /// Whether nothing is pulled.
    pub fn is_empty(&self) -> bool {
        self.firm.pixels().iter().all(|firm| *firm == 0.0)
    }

    /// How firmly each pixel is pulled.
    pub fn pulls(&self, pulling: &Pulling<'_>) -> Plane {
        let mut pulls = self.firm.clone();
        match pulling.weights {
            Some(weights) => {
                let both = pulls.pixels_mut().iter_mut().zip(weights.pixels());
                both.for_each(|(pull, weight)| *pull *= weight);
            }
            None => pulls.pixels_mut().iter_mut().for_each(|pull| *pull *= pulling.pull.weight as f32),
        }
        pulls
    }
}

/// How firmly each sample pulls: less where it disagrees by more than those around it, and less in all of a frame that is farther away or whose
/// samples disagree by more than those of the best one.
fn firmness(
    (carried, aims): (&[Carried], &[Aim]),
    (errors, around): (&[Vec<f32>], &Around),
    least: f64,
) -> Vec<Vec<f32>> {
    let trust = |(aim, errors): (&Aim, &Vec<f32>)| -> Vec<f32> {
        let one = |(at, error): (&u32, &f32)| {
            let scale = AROUND * AROUND * around.at(*at as usize) + least * least;
            (1.0 / (1.0 + f64::from(*error) / scale)) as f32
        };
        aim.pixels.par_iter().zip(errors).with_min_len(PIECE).map(one)
    };
    let mut firm: Vec<Vec<f32>> = aims.iter().zip(errors).map(trust).collect();
    let mean = |(trusts, errors): (&Vec<f32>, &Vec<f32>)| {
        let sum: f64 = trusts.iter().zip(errors).map(|(trust, error)| f64::from(trust * error)).sum();
        sum / trusts.len().max(1) as f64 + (EXACT * least).powi(2)
    };
    let means: Vec<f64> = firm.iter().zip(errors).map(mean).collect();
    let known = means.iter().zip(&firm).filter(|(_, own)| !own.is_empty());
    let best = known.map(|(mean, _)| *mean).fold(f64::INFINITY, f64::min);
    for ((own, mean), carried) in firm.iter_mut().zip(means).zip(carried) {
        let share = ((best / mean).sqrt() / f64::from(carried.distance())) as f32;
        for firm in own {
            *firm *= share;
        }
    }
    firm
}

/// The mean squared disagreement of the samples around each pixel.
struct Around {
    sums: Vec<f32>,
    counts: Vec<f32>,
}

impl Around {
    /// Of the errors of each frame, none of which counts for more than the square of `most`.
    fn new(size: Size, aims: &[Aim], (errors, most): (&[Vec<f32>], f32)) -> Self {
        let most = (most * most).min(f32::MAX);
        let (mut sums, mut counts) = (vec![0.0_f32; size.pixels()], vec![0.0_f32; size.pixels()]);
        for (at, error) in aims.iter().zip(errors).flat_map(|(aim, errors)| aim.pixels.iter().zip(errors)) {
            sums[*at as usize] += error.min(most);
            counts[*at as usize] += 1.0;
        }
        Self { sums: blur(size, &sums, SPREAD), counts: blur(size, &counts, SPREAD) }
    }

    fn at(&self, pixel: usize) -> f64 {
        let count = self.counts[pixel];
        if count > 0.0 { f64::from(self.sums[pixel]) / f64::from(count) } else { 0.0 }
    }
}

/// The missing pixel nearest to a place, of the four around it.
fn missing_near(mask: &Mask, [y, x]: [f32; 2]) -> Option<usize> {
    let Size { height, width } = mask.size();
    let around = |at: f32, length: usize| {
        let (last, low) = ((length - 1) as f32, at.max(0.0) as usize as f32);
        let low = if at < 0.0 { low - 1.0 } else { low };
        [low, low + 1.0].map(|at| at.clamp(0.0, last))
    };
    let columns = around(x, width);
    let mut nearest = None::<(f32, usize)>;
    for row in around(y, height) {
        for column in columns {
            let at = row as usize * width + column as usize;
            let distance = (row - y).powi(2) + (column - x).powi(2);
            // Of a measured pixel's own place, there is nothing to be learned beside it.
            if distance < 1e-6 && mask.as_slice()[at] {
                return None;
            }
            if !mask.as_slice()[at] && nearest.is_none_or(|nearest| distance < nearest.0) {
                nearest = Some((distance, at));
            }
        }
    }
    nearest.map(|nearest| nearest.1)
}
