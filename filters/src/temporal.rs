//! Filling a frame with samples of other frames, each carried to its place in this one along the motion.
//!
//! Given an image `m` that is filled already and is `y` at the measured pixels, and samples `v_i` of other frames at sub-pixel places `p_i`,
//! the image `x` minimises
//!
//! ```text
//! (x - m)' H (x - m)  +  w sum over i of  t_i (x(p_i) - v_i)^2        over all x that equal y at the measured pixels
//! t_i = b / (m_i d_i (1 + (e_i / s_i)^2))
//! ```
//!
//! with `H` the energy of smoothness splines ([`crate::variational::ss`]), `x(p)` the cubic interpolation of the image, and `e_i` how far the image of the round
//! before disagrees with the sample (root mean square over the planes). The scale `s_i` is twice what samples around disagree by, and no less than a share of
//! the range: what is hidden here, or moved or lit otherwise than all around, counts little. `d_i` is how many frames away the sample was measured, `m_i` the
//! root mean square by which the samples of its frame disagree, `b` the least of all frames. What changes linearly from frame to frame around a place is taken
//! away from the disagreement first (`drift`).
//!
//! Where brightness changes by more, samples are first brought to that of this frame (`level`), which is a second way to pull.
//!
//! Algorithm: deferred correction. In each of `ROUNDS` rounds every sample becomes a value at a missing pixel `q` near its place,
//! `v_i + x(q) - x(p_i)` by the image of the round before (first `m`); values of one pixel are combined by their weights, and the spline that is pulled
//! towards them is solved on the grid (`variational/ss/pulled.rs`).
//!
//! Boundary: that of the splines; the interpolation repeats the outermost pixels. The same bits for any number of threads.
//!
//! The same is done in the frame before and in the one after, which are then seen from this one (`view`).
//!
//! Which `w` is best, and whether other frames help at all, differs between places: [`crate::auto`] asks held-out samples.
//!
//! Cost: `ROUNDS` solves on the whole image. Fails: thin parts whose motion is not known to a fraction of their width.
//!
//! Source: R. Keys, "Cubic Convolution Interpolation for Digital Image Processing", IEEE Trans. ASSP 29, 1981; V. Pereyra, "On improving an
//! approximate solution of a functional equation by deferred corrections", Numerische Mathematik 8, 1966; P. Holland, R. Welsch,
//! "Robust regression using iteratively reweighted least-squares", Communications in Statistics 6, 1977.

mod aimed;
pub mod camera;
mod carried;
mod drift;
pub mod flow;
mod level;
mod taps;
#[cfg(test)]
mod tests;
mod thinned;
mod usual;
mod view;

pub use carried::Carried;
pub(crate) use level::Both;
pub(crate) use taps::Taps;
pub(crate) use thinned::thinned;
pub(crate) use usual::{Usual, usual_of, within};
pub(crate) use view::{Beside, beside, seen};

use std::cell::OnceCell;
use std::ops::Range;
use std::sync::Arc;

use lacuna_core::parallel::prelude::*;

use crate::estimate::{Folds, PARTS};
use crate::variational::ss::Pulled;
use crate::{Mask, Outcome, Plane, Planes, Run, Stop};
use aimed::{Aim, Data};
use usual::wide;

/// The part of the disagreement that levelling over a wide Gaussian takes away where brightness changes: 0.80 to 0.88 on turntables of engine, head and
/// tooth whose light moves, three frames away, up to 0.40 on those of eight scenes whose light does not.
const BRIGHTNESS: f64 = 0.6;
/// Rounds of correction. One is enough where samples are held out: the second one gains up to 0.25 dB, which all ways gain alike.
const ROUNDS: usize = 2;
/// The same where samples are levelled, each time to the image of the round before.
const LEVELLED_ROUNDS: usize = 3;
/// The least disagreement at which a sample counts half, over the range of the measured ones.
const HALF: f64 = 0.03;
/// The same, over what samples around disagree by.
const AROUND: f64 = 2.0;
/// Width of the Gaussian of what is around, in pixels.
const SPREAD: f64 = 3.0;
/// Largest last correction of the last round, over the range of the measured samples.
const ERROR: f64 = 2e-6;
/// The same of rounds before it, and where samples are held out.
const ROUGH: f64 = 1e-4;
/// Samples that one task takes.
const PIECE: usize = 1 << 12;

/// Parts of the samples, a tenth each, by which other frames are judged at most.
const JUDGES: usize = 3;
/// So many held-out samples judge as well as more do.
const JUDGING: usize = 4000;

/// The parts of so many samples by which [`crate::auto`] judges other frames.
pub(crate) fn judging(folds: Folds, samples: usize) -> impl Iterator<Item = Range<u64>> {
    let each = samples.div_ceil(PARTS as usize).max(1);
    folds.near(samples).take(JUDGING.div_ceil(each).clamp(1, JUDGES))
}

/// All of these parts.
pub(crate) fn judges(folds: Folds, samples: usize) -> Range<u64> {
    0..judging(folds, samples).last().map_or(0, |parts| parts.end)
}

/// The mask without the samples by which [`crate::auto`] judges other frames. Motion that is estimated from this frame must not know them: it
/// would bend the other frames towards these very samples.
pub fn unjudged(mask: &Mask) -> Mask {
    let folds = Folds::default();
    folds.without(mask, &judges(folds, mask.count()))
}

/// How samples of other frames pull.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Pull {
    /// What those of the nearest frames weigh.
    pub weight: f64,
    /// What is done about changes with time.
    pub changes: Changes,
}

/// What is done about what changes with time besides the motion.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Changes {
    /// Nothing: samples are taken as they are.
    Kept,
    /// What is linear in time around a place is taken away (`drift`).
    Linear,
    /// Samples are brought to the brightness of this frame first (`level`); what is left of it and linear goes too.
    Levelled,
}

/// Samples of other frames and how they pull in one frame.
#[derive(Clone, Copy)]
pub(crate) struct Pulling<'a> {
    /// The samples of each other frame.
    pub carried: &'a [Carried],
    /// What each other frame makes of its own, where these are known.
    pub fills: &'a [Planes],
    /// How they pull.
    pub pull: Pull,
    /// What the weight is at each pixel instead.
    pub weights: Option<&'a Plane>,
    /// Whether what comes out is only compared with samples that were held out.
    pub roughly: bool,
    /// What another pull of the same image and samples found in its first round.
    pub first: Option<&'a First>,
}

/// What samples pull in the first round, which differs between pulls by their weight alone.
#[derive(Default)]
pub(crate) struct First {
    aims: OnceCell<Vec<Aim>>,
    data: OnceCell<Data>,
}

/// What `begun`, which is filled already, becomes where its missing pixels are pulled towards samples of other frames.
pub(crate) fn pull(mask: &Mask, pulling: &Pulling<'_>, begun: &Planes, run: &Run<'_>) -> (Planes, Outcome) {
    let Pulling { carried, fills, pull, .. } = *pulling;
    let mut image = begun.clone();
    let mut worst = Outcome::direct();
    let level = |image: &Planes| -> Vec<Carried> {
        let one = |(at, carried): (usize, &Carried)| {
            let both = fills.get(at).map(|fill| Both { fill, samples: begun, mask });
            level::levelled(carried, (image, mask), both)
        };
        carried.iter().enumerate().map(one).collect()
    };
    let is_shared = pull.changes == Changes::Linear && pulling.weights.is_none();
    let shared = pulling.first.filter(|_| is_shared);
    let (own, mut last) = (OnceCell::new(), None::<Data>);
    let aims = shared.map_or(&own, |first| &first.aims);
    let aims = aims.get_or_init(|| carried.iter().map(|carried| Aim::new(mask, carried)).collect());
    let is_levelled = pull.changes == Changes::Levelled;
    let rounds = match (is_levelled, pulling.roughly) {
        (true, _) => LEVELLED_ROUNDS,
        (false, true) => 1,
        (false, false) => ROUNDS,
    };
    for round in 1..=rounds {
        let levelled = if is_levelled { level(&image) } else { Vec::new() };
        let carried = if is_levelled { &levelled } else { carried };
        let tolerance = if round < rounds || pulling.roughly { ROUGH } else { ERROR };
        let make = || Data::new(mask, (carried, aims), pull.changes, (begun, &image), tolerance);
        // Not beside that of the round before, for its memory.
        drop(last.take());
        let data = match shared {
            Some(first) if round == 1 => first.data.get_or_init(make),
            _ => &*last.insert(make()),
        };
        let stop = run.interrupted();
        if stop.is_some() || data.is_empty() {
            worst.stop = worst.stop.max(stop.unwrap_or(Stop::Converged));
            break;
        }
        // What the energy holds is the difference to the image that it began with.
        subtract(&mut image, begun);
        let solver = Pulled::new(mask, &data.pulls(pulling));
        worst = worst.worst(solver.solve(&data.values, &data.tolerances, &mut image, run));
        add(&mut image, begun);
    }
    for (image, begun) in image.as_mut_slice().iter_mut().zip(begun.as_slice()) {
        mask.restore(begun, image);
    }
    (image, worst)
}

/// Whether brightness changes between an image, of which these pixels are measured, and samples of the other frames that are farthest away, on one side at least.
pub(crate) fn brightness_changes(carried: &[Carried], (image, mask): (&Planes, &Mask)) -> bool {
    let farthest = |later: bool| {
        let side = carried.iter().filter(|one| !one.is_empty() && (one.offset > 0) == later);
        side.max_by_key(|one| one.distance())
    };
    [false, true].into_iter().filter_map(farthest).any(|one| level::gain(one, (image, mask)) >= BRIGHTNESS)
}

fn subtract(image: &mut Planes, other: &Planes) {
    for (image, other) in image.as_mut_slice().iter_mut().zip(other.as_slice()) {
        image.pixels_mut().iter_mut().zip(other.pixels()).for_each(|(value, other)| *value -= other);
    }
}

fn add(image: &mut Planes, other: &Planes) {
    for (image, other) in image.as_mut_slice().iter_mut().zip(other.as_slice()) {
        image.pixels_mut().iter_mut().zip(other.pixels()).for_each(|(value, other)| *value += other);
    }
}

/// How far an image disagrees with samples of another frame: of each `e / (e + s)`, with `s` a share of the image's range.
pub struct Judge<'a> {
    image: &'a Planes,
    half: f64,
}

impl<'a> Judge<'a> {
    /// A judge by this image, of which these pixels are measured.
    pub fn new(image: &'a Planes, mask: &Mask) -> Self {
        let widest = image.as_slice().iter().map(|plane| wide(mask, plane)).fold(0.0, f64::max);
        Self { image, half: (HALF * widest).max(f64::MIN_POSITIVE) }
    }

    /// The mean over samples.
    pub fn mean(&self, carried: &Carried) -> f64 {
        let sum: f64 = off(carried, self.image).map(|off| self.part(off)).sum();
        sum / carried.len().max(1) as f64
    }

    /// Of pixel `at` of another frame, if it lies at this place: row and column; nothing outside the image.
    pub fn of(&self, samples: &Planes, at: usize, [y, x]: [f32; 2]) -> Option<f64> {
        let size = self.image.size();
        let values = samples.as_slice().iter().map(|plane| plane.pixels()[at]);
        carried::is_inside(size, [y, x]).then(|| self.part(squared(self.image, values, [y, x])))
    }

    fn part(&self, off: f64) -> f64 {
        off.sqrt() / (off.sqrt() + self.half)
    }
}

/// The part of the variance of another frame's samples that an image explains where they are carried to: 1 if it has their very values, 0 or
/// less if it says nothing of them. What is beyond the samples' usual values counts as if it was at their ends, so that no few of them decide.
pub fn explained(carried: &Carried, image: &Planes) -> f64 {
    let usual = usual::of_samples(carried);
    let left = usual::missed(carried, image, &usual);
    let spread = |(values, usual): (&Arc<Vec<f32>>, &Usual)| {
        let finite = || values.iter().filter(|v| v.is_finite()).map(|value| f64::from(usual.clamp(*value)));
        let mean = finite().sum::<f64>() / carried.len().max(1) as f64;
        finite().map(|value| (value - mean).powi(2)).sum::<f64>()
    };
    let all: f64 = carried.values.iter().zip(&usual).map(spread).sum();
    if all > 0.0 { 1.0 - left / all } else { 1.0 }
}

/// By how much an image misses each sample, plane by plane.
fn missed(carried: &Carried, image: &Planes) -> Vec<f32> {
    let planes = image.as_slice();
    let mut all = vec![0.0_f32; carried.len() * planes.len()];
    let pieces = all.par_chunks_mut(PIECE * planes.len().max(1)).enumerate();
    pieces.for_each(|(piece, all)| {
        for (k, missed) in all.chunks_mut(planes.len().max(1)).enumerate() {
            let i = piece * PIECE + k;
            let [y, x] = carried.places[i];
            let taps = Taps::new(image.size(), y, x);
            for ((missed, plane), values) in missed.iter_mut().zip(planes).zip(&carried.values) {
                *missed = values[i] - taps.of(plane);
            }
        }
    });
    all
}

/// The squared disagreement of each sample, the mean over the planes.
pub(crate) fn off(carried: &Carried, image: &Planes) -> impl Iterator<Item = f64> {
    let missed = missed(carried, image);
    let planes = image.len().max(1);
    (0..missed.len() / planes).map(move |i| mean_square(&missed[i * planes..][..planes]))
}

/// The mean over the planes of what a sample is missed by, squared.
fn mean_square(missed: &[f32]) -> f64 {
    missed.iter().map(|by| f64::from(*by).powi(2)).sum::<f64>() / missed.len() as f64
}

/// The squared disagreement of the values of one sample.
fn squared(image: &Planes, values: impl Iterator<Item = f32>, [y, x]: [f32; 2]) -> f64 {
    let taps = Taps::new(image.size(), y, x);
    let planes = image.as_slice().iter().zip(values);
    let squares: f64 = planes.map(|(plane, value)| f64::from(value - taps.of(plane)).powi(2)).sum();
    squares / image.len().max(1) as f64
}
