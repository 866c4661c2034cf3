//! The blend: weights at measured pixels, then fills of what they make of the samples, then weights at missing ones.

use std::sync::Arc;

use lacuna_core::parallel::prelude::*;

use super::candidates::{Candidate, Fold, Second, Task};
use super::part::Part;
use super::split::Split;
use super::{FOLLOWS, NEIGHBOURHOOD, NOISY};
use crate::variational::guided::Tuned;
use crate::weights::{BySurface, Surfaces, add_products};
use crate::{Error, Mask, Outcome, Planes};

/// Pixels that one task takes.
const PART: usize = 1 << 16;

/// What weighs the candidates, and what they make of all samples.
pub struct Blend<'a> {
    /// At measured pixels, of the first candidates.
    measured: BySurface<'a>,
    /// At missing ones, of all.
    missing: BySurface<'a>,
    images: Vec<Planes>,
    /// What guides count for where smoothed samples are filled.
    tuned: Option<Tuned>,
    /// How the solvers ended.
    pub outcome: Outcome,
}

impl<'a> Blend<'a> {
    /// Chooses; nothing if the samples show no noise.
    pub fn new(
        task: &Task<'_>,
        all: &[Candidate],
        (mask, counts): (&Arc<Mask>, &[f64]),
        split: &Split,
        surfaces: &'a Surfaces,
    ) -> Result<Option<Self>, Error> {
        let samples = &split.samples;
        let part = Part::new(task, mask, samples);
        let (small, kept, own) = part.task(task, mask, samples);
        let tuned = small.tune(kept, (own, small.counts()));
        let (task, small) =
            (&Task { tuned: tuned.as_ref(), ..*task }, Task { tuned: tuned.as_ref(), ..small });
        let folds = small.folds(all, (kept, &|pixel| part.is_inner(pixel)), own)?;
        let (measured, images, outcome) = if let Some(noise) = &split.noise {
            let (values, noises, outcome) = task.both(all, mask, (samples, noise))?;
            (by_noise(surfaces, (mask, counts), samples, noise, (&values, &noises)), values, outcome)
        } else {
            let held = Held::new(&part, kept, all.len(), &folds);
            let (weights, error) = held_out(surfaces, &held, (samples, counts));
            if error > 1.0 - NOISY || follows(&held, &folds, (samples, counts), &small, (kept, own))? {
                return Ok(None);
            }
            let (values, outcome) = task.each(all, mask, samples)?;
            (weights, values, outcome)
        };
        let (seconds, filling) = (seconds(all, mask), Candidate::filling(all));
        let mut held = Held::new(&part, kept, filling, &folds);
        held.predicted.resize(filling + seconds.len(), Vec::new());
        let mut tuned = None;
        for fold in &folds {
            let images: Vec<Planes> = fold.images.iter().map(|image| image.planes(kept)).collect();
            let smooth = smoothed(&measured, &images, own, (kept, &part));
            tuned = tuned.or_else(|| small.tune(&fold.kept, (&smooth, None)));
            let small = Task { tuned: tuned.as_ref(), ..small };
            held.add(seconds, fold, &small, &smooth, kept)?;
        }
        let missing = held_out(surfaces, &held, (samples, counts)).0;
        Ok(Some(Self { measured, missing, images, tuned, outcome }))
    }

    /// Fills all pixels of `out`; the mean weights at missing ones.
    pub fn fill(
        &self,
        task: &Task<'_>,
        all: &[Candidate],
        (mask, samples): (&Arc<Mask>, &Planes),
        out: &mut Planes,
    ) -> Result<Vec<(&'static str, f64)>, Error> {
        out.as_mut_slice().iter_mut().for_each(|plane| plane.pixels_mut().fill(0.0));
        let width = mask.size().width;
        let place = |pixel| (pixel / width, pixel % width);
        let mut shares = Vec::new();
        for (k, (candidate, image)) in all.iter().zip(&self.images).enumerate() {
            shares.push((candidate.name, self.measured.add((k, image), (mask, true), place, out)));
        }
        mend(out, samples);
        if mask.is_full() {
            return Ok(shares);
        }
        let smooth = out.clone();
        shares.truncate(Candidate::filling(all));
        for ((k, image), share) in self.images.iter().enumerate().zip(&mut shares) {
            share.1 = self.missing.add((k, image), (mask, false), place, out);
        }
        let task = Task { tuned: self.tuned.as_ref(), ..*task };
        let mut start = None;
        for second in seconds(all, mask) {
            let k = shares.len();
            let share = if self.missing.counts(k) {
                let image = second.fill(&task, (mask, &smooth), None, &mut start)?;
                self.missing.add((k, &image), (mask, false), place, out)
            } else {
                0.0
            };
            shares.push((second.name(), share));
        }
        Ok(shares)
    }
}

/// Whether what the guided regression leaves of the samples goes on between them, as detail does and noise does not: guides gain without noise, too.
fn follows(
    held: &Held,
    folds: &[Fold],
    (samples, counts): (&Planes, &[f64]),
    task: &Task<'_>,
    (mask, own): (&Mask, &Planes),
) -> Result<bool, Error> {
    let Some(alone) = held.predicted.last().filter(|_| task.tuned.is_some()) else { return Ok(false) };
    let mut with = Held { at: Vec::new(), predicted: vec![Vec::new()] };
    for fold in folds {
        with.add(&[Second::Guided], fold, task, own, mask)?;
    }
    let error = |predicted: &[Vec<f32>]| -> f64 {
        let each = held.at.iter().zip(predicted).map(|(&pixel, predicted)| {
            let truth = samples.as_slice().iter().map(|plane| plane.pixels()[pixel as usize]);
            let squares = predicted.iter().zip(truth).map(|(a, b)| f64::from(a - b).powi(2));
            counts[pixel as usize].powi(2) * squares.sum::<f64>()
        });
        each.sum()
    };
    Ok(error(alone) > (1.0 - FOLLOWS) * error(&with.predicted[0]))
}

/// The ways to fill what is missing.
fn seconds(all: &[Candidate], mask: &Mask) -> &'static [Second] {
    if mask.is_full() { &[] } else { Second::all(all.iter().any(Candidate::is_guided)) }
}

fn values(planes: &Planes, pixel: u32) -> Vec<f32> {
    planes.as_slice().iter().map(|plane| plane.pixels()[pixel as usize]).collect()
}

/// Gives pixels that overflowed what the samples are there, zero where that is no number either.
fn mend(planes: &mut Planes, samples: &Planes) {
    for (plane, samples) in planes.as_mut_slice().iter_mut().zip(samples.as_slice()) {
        let parts = plane.pixels_mut().par_chunks_mut(PART).zip(samples.pixels().par_chunks(PART));
        parts.for_each(|(values, samples)| {
            for (value, sample) in values.iter_mut().zip(samples).filter(|(value, _)| !value.is_finite()) {
                *value = if sample.is_finite() { *sample } else { 0.0 };
            }
        });
    }
}

/// What the weights make of the samples of a part; zero at missing pixels.
fn smoothed(
    weights: &BySurface<'_>,
    images: &[Planes],
    samples: &Planes,
    (mask, part): (&Mask, &Part),
) -> Planes {
    let mut out = Planes::zeros(mask.size(), images.first().map_or(0, Planes::len));
    for candidate in images.iter().enumerate() {
        weights.add(candidate, (mask, true), |pixel| part.place(pixel), &mut out);
    }
    mend(&mut out, samples);
    out
}

/// Predictions at held-out samples: by candidate and sample the channels.
struct Held {
    at: Vec<u32>,
    predicted: Vec<Vec<Vec<f32>>>,
}

impl Held {
    fn new(part: &Part, mask: &Mask, count: usize, folds: &[Fold]) -> Self {
        let at = folds.iter().flat_map(|fold| &fold.at).map(|&pixel| part.pixel(pixel as usize)).collect();
        let mut predicted = vec![Vec::new(); count];
        for fold in folds {
            for (predicted, image) in predicted.iter_mut().zip(&fold.images) {
                let image = image.planes(mask);
                predicted.extend(fold.at.iter().map(|&pixel| values(&image, pixel)));
            }
        }
        Self { at, predicted }
    }

    /// Adds what the ways to fill predict.
    fn add(
        &mut self,
        seconds: &[Second],
        fold: &Fold,
        task: &Task<'_>,
        smooth: &Planes,
        mask: &Mask,
    ) -> Result<(), Error> {
        let last = self.predicted.len() - seconds.len();
        let mut start = None;
        for (second, predicted) in seconds.iter().zip(&mut self.predicted[last..]) {
            let filled = second.fill(task, (&fold.kept, smooth), Some(mask), &mut start)?;
            predicted.extend(fold.at.iter().map(|&pixel| values(&filled, pixel)));
        }
        Ok(())
    }
}

/// Weights by held-out samples, and the squared error of the blend over that of the first candidate.
fn held_out<'a>(
    surfaces: &'a Surfaces,
    held: &Held,
    (samples, counts): (&Planes, &[f64]),
) -> (BySurface<'a>, f64) {
    let count = held.predicted.len();
    BySurface::new(surfaces, (&held.at, NEIGHBOURHOOD), count, |errors, i, pixel, products| {
        errors.resize(count, 0.0);
        for (channel, plane) in samples.as_slice().iter().enumerate() {
            let value = f64::from(plane.pixels()[pixel]);
            for (error, predicted) in errors.iter_mut().zip(&held.predicted) {
                *error = counts[pixel] * (f64::from(predicted[i][channel]) - value);
            }
            add_products(errors, products);
        }
    })
}

/// The weights by Stein's estimate, at all samples whose noise is known.
fn by_noise<'a>(
    surfaces: &'a Surfaces,
    (mask, counts): (&Mask, &[f64]),
    samples: &Planes,
    noise: &Planes,
    (values, noises): (&[Planes], &[Planes]),
) -> BySurface<'a> {
    let known = |pixel: usize| noise.as_slice().iter().all(|plane| plane.pixels()[pixel].is_finite());
    let pieces = mask.as_slice().par_chunks(PART).enumerate().map(|(piece, flags)| {
        let pixels = flags.iter().enumerate().map(|(at, flag)| (piece * PART + at, *flag));
        pixels
            .filter(|&(pixel, flag)| flag && known(pixel))
            .map(|(pixel, _)| pixel as u32)
            .collect::<Vec<u32>>()
    });
    let at = pieces.concat();
    let count = values.len();
    let products = |scratch: &mut Vec<f64>, _: usize, pixel: usize, products: &mut [f64]| {
        scratch.resize(2 * count, 0.0);
        let (errors, answers) = scratch.split_at_mut(count);
        for channel in 0..samples.len() {
            let value =
                |planes: &Planes| counts[pixel] * f64::from(planes.as_slice()[channel].pixels()[pixel]);
            let (y, n) = (value(samples), value(noise));
            errors.iter_mut().zip(values).for_each(|(error, image)| *error = value(image) - y);
            answers.iter_mut().zip(noises).for_each(|(answer, image)| *answer = n * value(image));
            add_products(errors, products);
            for (row, a) in products.chunks_exact_mut(count).zip(&*answers) {
                row.iter_mut().zip(&*answers).for_each(|(product, b)| *product += a + b - n * n);
            }
        }
    };
    BySurface::new(surfaces, (&at, NEIGHBOURHOOD), count, products).0
}
