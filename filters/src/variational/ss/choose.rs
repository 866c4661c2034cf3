//! How much to smooth, without a reference.
//!
//! With `F` the map from samples `y` to the splines of a weight `lambda` there, `N` samples in all and `n` noise like theirs, `lambda` is the least of
//!
//! ```text
//! noise known:   sum (F y - y)^2 + 2 n F n             Stein's estimate of the squared error, less the variance of the noise
//! else:          N sum w (F y - y)^2 / (N - tr F)^2    generalised cross-validation;  tr F is about z' F z, z = +-1 at random
//! ```
//!
//! summed over channels and, in large images, over windows that lie evenly; at powers of 4, from the middle to the better side, and the least of the
//! parabola through the best and its neighbours in the logarithm. Where the least weight is the best nothing is smoothed.
//!
//! Sources: P. Craven, G. Wahba, "Smoothing noisy data with spline functions", Numerische Mathematik 31, 1979; M. Hutchinson, "A stochastic
//! estimator of the trace of the influence matrix for Laplacian smoothing splines", Communications in Statistics 18, 1989; C. Stein,
//! "Estimation of the Mean of a Multivariate Normal Distribution", Annals of Statistics 9, 1981.

use std::collections::BTreeMap;
use std::sync::Arc;

use lacuna_core::parallel::prelude::*;

use super::Settings;
use crate::choose::Given;
use crate::{Error, Filter, Mask, Plane, Planes, Problem, Run, Size};
use lacuna_core::hash;

/// The weights that are tried: powers of 4.
const POWERS: std::ops::RangeInclusive<i32> = -4..=4;
/// The first of them, with the next.
const BEGIN: i32 = -1;
/// Pixels of the side of a window.
const SIDE: usize = 80;
/// Windows along each side, at most.
const WINDOWS: usize = 3;
/// How exact splines are, over the range of the samples.
const ROUGH: f64 = 1e-3;
/// Fewer samples choose nothing.
const FEWEST: f64 = 16.0;

/// What was found.
#[derive(Clone, Copy, Debug)]
pub struct Smoothness {
    /// The weight of the energy.
    pub lambda: f64,
    /// The variance of a sample of weight 1, mean over channels.
    pub variance: f64,
    /// What showed it.
    pub by: &'static str,
}

/// Sums over the samples of all windows and channels.
#[derive(Clone, Copy, Debug, Default)]
struct Sums {
    /// Samples, all channels together.
    count: f64,
    /// Weighted squares of what the splines leave of the samples.
    rest: f64,
    /// Stein's estimate, or the trace of `F` over all channels.
    second: f64,
}

impl Sums {
    fn plus(self, other: &Self) -> Self {
        let Self { count, rest, second } = other;
        Self { count: self.count + count, rest: self.rest + rest, second: self.second + second }
    }
}

/// The best weight for the samples, the other settings being these.
///
/// # Errors
/// Those of the splines.
pub fn smoothness(settings: &Settings, given: &Given<'_>, run: &Run<'_>) -> Result<Smoothness, Error> {
    let by = if given.noise.is_some() { "known noise" } else { "generalised cross-validation" };
    let windows = windows(given);
    let none = Smoothness { lambda: 0.0, variance: 0.0, by };
    // By power the score and the variance: from the middle towards the better side, until either neighbour of the best is worse.
    let mut found: BTreeMap<i32, (f64, f64)> = BTreeMap::new();
    let score = |found: &BTreeMap<i32, (f64, f64)>, power: i32| found.get(&power).map(|tried| tried.0);
    let mut best = BEGIN;
    loop {
        let open = |power: &i32| POWERS.contains(power) && !found.contains_key(power);
        let powers: Vec<i32> = match found.len() {
            0 => vec![BEGIN, BEGIN + 1],
            _ => [best + 1, best - 1].into_iter().filter(open).take(1).collect(),
        };
        if powers.is_empty() {
            break;
        }
        let Some(scores) = scores(settings, (given, &windows), &powers, run)? else { return Ok(none) };
        found.extend(powers.into_iter().zip(scores));
        best = found.iter().min_by(|a, b| a.1.0.total_cmp(&b.1.0)).map_or(BEGIN, |(power, _)| *power);
    }
    if best == *POWERS.start() {
        return Ok(none);
    }
    let here = score(&found, best).unwrap_or_default();
    let [before, after] = [best - 1, best + 1].map(|power| score(&found, power).unwrap_or(here));
    let bend = before - 2.0 * here + after;
    let beyond = if bend > 0.0 { (0.5 * (before - after) / bend).clamp(-0.5, 0.5) } else { 0.0 };
    let variance = found.get(&best).map_or(0.0, |tried| tried.1);
    Ok(Smoothness { lambda: 4.0_f64.powf(f64::from(best) + beyond), variance, by })
}

/// What each power of 4 scores, and the variance that it leaves; nothing if too few samples tell.
fn scores(
    settings: &Settings,
    (given, windows): (&Given<'_>, &[Window]),
    powers: &[i32],
    run: &Run<'_>,
) -> Result<Option<Vec<(f64, f64)>>, Error> {
    // Windows are small: each is one task for each power.
    let all = |&power: &i32| windows.iter().map(move |window| (power, window));
    let tasks: Vec<(i32, &Window)> = powers.iter().flat_map(all).collect();
    let parts = tasks
        .par_iter()
        .map(|&(power, window)| window.sums(&Settings { lambda: 4.0_f64.powi(power), ..*settings }, run));
    let parts = parts.into_iter().collect::<Result<Vec<Sums>, Error>>()?;
    let one = |parts: &[Sums]| {
        let sums = parts.iter().fold(Sums::default(), Sums::plus);
        let free = (sums.count - sums.second).max(f64::MIN_POSITIVE);
        let scored = match given.noise {
            Some(_) => (sums.second, 0.0),
            None => (sums.count * sums.rest / (free * free), sums.rest / free),
        };
        (sums.count >= FEWEST).then_some(scored)
    };
    if windows.is_empty() {
        return Ok(None);
    }
    Ok(parts.chunks(windows.len()).map(one).collect())
}

/// A part of the image with what is known there.
struct Window {
    mask: Arc<Mask>,
    weights: Option<Arc<Plane>>,
    samples: Planes,
    /// Noise by channel, 0 where it is not known, or a plane of -1 and 1.
    probes: Planes,
    /// Noise by channel, where that tells.
    noise: Option<Planes>,
}

/// All of a small image, parts of a large one.
fn windows(given: &Given<'_>) -> Vec<Window> {
    let size = given.mask.size();
    let small = size.pixels() <= (SIDE * WINDOWS).pow(2);
    let cuts = |length: usize| -> Vec<(usize, usize)> {
        let count = (length / SIDE).clamp(1, WINDOWS);
        if small || length <= SIDE {
            return vec![(0, length)];
        }
        (0..count).map(|k| ((2 * k + 1) * length / (2 * count) - SIDE / 2, SIDE)).collect()
    };
    let (rows, columns) = (cuts(size.height), cuts(size.width));
    let places = rows.iter().flat_map(|&row| columns.iter().map(move |&column| (row, column)));
    places.filter_map(|(row, column)| Window::new(given, row, column)).collect()
}

impl Window {
    /// Nothing where no sample counts.
    fn new(given: &Given<'_>, (top, height): (usize, usize), (left, width): (usize, usize)) -> Option<Self> {
        let size = Size::new(height, width);
        let cut = |plane: &Plane| Plane::from_fn(size, |row, column| plane.at(top + row, left + column));
        let all = |planes: &Planes| Planes::of(size, planes.as_slice().iter().map(cut).collect());
        let weights = given.weights.map(|weights| Arc::new(cut(weights)));
        let counts = |row: usize, column: usize| {
            given.mask.is_measured(top + row, left + column)
                && weights.as_ref().is_none_or(|weights| weights.at(row, column) > 0.0)
        };
        let mask = Mask::from_fn(size, counts);
        if mask.is_empty() {
            return None;
        }
        let sign = |row: usize, column: usize| {
            let at = (top + row) * given.mask.size().width + left + column;
            if hash(0, at as u64) & 1 == 0 { 1.0 } else { -1.0 }
        };
        let noise = given.noise.map(all);
        let mut probes = noise.clone().unwrap_or_else(|| Planes::of(size, vec![Plane::from_fn(size, sign)]));
        for plane in probes.as_mut_slice() {
            plane.pixels_mut().iter_mut().filter(|value| !value.is_finite()).for_each(|value| *value = 0.0);
        }
        Some(Self { mask: Arc::new(mask), weights, samples: all(given.samples), probes, noise })
    }

    fn sums(&self, settings: &Settings, run: &Run<'_>) -> Result<Sums, Error> {
        let mut sums = Sums::default();
        let mut problem = Problem::fill(Arc::clone(&self.mask));
        problem.weights.clone_from(&self.weights);
        let plan = settings.plan(&problem, run)?;
        let image = |of: &Planes| {
            let mut out = Planes::zeros(of.size(), of.len());
            plan.reconstruct_roughly(of, ROUGH, &mut out, run)?;
            Ok::<_, Error>(out)
        };
        let (values, answers) = (image(&self.samples)?, image(&self.probes)?);
        let channels = self.samples.len();
        for pixel in (0..self.mask.size().pixels()).filter(|&pixel| self.mask.as_slice()[pixel]) {
            let at = |planes: &Planes, k: usize| f64::from(planes.as_slice()[k].pixels()[pixel]);
            let weight = self.weights.as_ref().map_or(1.0, |weights| f64::from(weights.pixels()[pixel]));
            // Samples whose noise is not known say nothing of the error.
            let tells = |k: &usize| self.noise.as_ref().is_none_or(|noise| at(noise, *k).is_finite());
            for k in (0..channels).filter(tells) {
                let rest = (at(&values, k) - at(&self.samples, k)).powi(2);
                sums.count += 1.0;
                sums.rest += weight * rest;
                sums.second += if self.noise.is_some() {
                    rest + 2.0 * at(&self.probes, k) * at(&answers, k)
                } else {
                    at(&self.probes, 0) * at(&answers, 0)
                };
            }
        }
        Ok(sums)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const SIZE: Size = Size::new(20, 22);

    fn random(seed: u64, at: usize) -> f32 {
        (0..4).map(|k| (hash(seed + k, at as u64) >> 40) as f32 / (1 << 24) as f32 - 0.5).sum()
    }

    fn noisy(size: Size, noise: f32) -> (Plane, Planes) {
        let truth = Plane::from_fn(size, |y, x| (y as f32 / 6.0).sin() * (x as f32 / 7.0).cos());
        let samples = |y: usize, x: usize| truth.at(y, x) + noise * 1.732 * random(5, y * size.width + x);
        let samples = Planes::new(size, vec![Plane::from_fn(size, samples)]).unwrap();
        (truth, samples)
    }

    /// The score at each power, the trace by every unit vector.
    fn exact(mask: &Arc<Mask>, samples: &Planes, power: i32) -> f64 {
        let settings = Settings { lambda: 4.0_f64.powi(power), ..Settings::default() };
        let run = Run::default();
        let plan = settings.plan(&Problem::fill(Arc::clone(mask)), &run).unwrap();
        let image = |of: &Planes| {
            let mut out = Planes::zeros(SIZE, 1);
            plan.reconstruct(of, &mut out, &run).unwrap();
            out.into_vec().remove(0)
        };
        let measured: Vec<usize> = (0..SIZE.pixels()).filter(|&at| mask.as_slice()[at]).collect();
        let (mut rest, mut trace) = (0.0, 0.0);
        let whole = image(samples);
        for &at in &measured {
            rest += f64::from(whole.pixels()[at] - samples.as_slice()[0].pixels()[at]).powi(2);
            let mut unit = Plane::filled(SIZE, 0.0);
            unit.pixels_mut()[at] = 1.0;
            trace += f64::from(image(&Planes::new(SIZE, vec![unit]).unwrap()).pixels()[at]);
        }
        let n = measured.len() as f64;
        n * rest / (n - trace).powi(2)
    }

    #[test]
    fn cross_validation_is_that_of_the_whole_matrix() {
        let mask = Arc::new(Mask::from_fn(SIZE, |y, x| hash(9, (y * 22 + x) as u64).is_multiple_of(2)));
        let (_, samples) = noisy(SIZE, 0.3);
        let scores: Vec<f64> = POWERS.map(|power| exact(&mask, &samples, power)).collect();
        let best = (0..scores.len()).min_by(|&a, &b| scores[a].total_cmp(&scores[b])).unwrap();
        let given = Given { mask: &mask, samples: &samples, noise: None, weights: None };
        let found = smoothness(&Settings::default(), &given, &Run::default()).unwrap();
        let power = found.lambda.log(4.0) - f64::from(*POWERS.start());
        // One draw of signs tells the trace to a few percent, which moves the least by less than a power.
        assert!((power - best as f64).abs() <= 1.0, "{power} {best} {scores:?}");
        // The noise has a variance of 0.09, known from 220 samples.
        assert!((found.variance / 0.09 - 1.0).abs() < 0.4, "{}", found.variance);
    }

    #[test]
    fn it_is_near_the_weight_that_the_truth_asks_for() {
        let size = Size::new(200, 190);
        let mask = Arc::new(Mask::from_fn(size, |y, x| hash(3, (y * 190 + x) as u64).is_multiple_of(4)));
        let (truth, samples) = noisy(size, 0.2);
        let noise = Plane::from_fn(size, |y, x| 0.2 * 1.732 * random(77, y * 190 + x));
        let noise = Planes::new(size, vec![noise]).unwrap();
        let run = Run::default();
        let error = |lambda: f64| {
            let plan = Settings { lambda, ..Settings::default() };
            let plan = plan.plan(&Problem::fill(Arc::clone(&mask)), &run).unwrap();
            let mut out = Planes::zeros(size, 1);
            plan.reconstruct(&samples, &mut out, &run).unwrap();
            let pairs = out.as_slice()[0].pixels().iter().zip(truth.pixels());
            pairs.map(|(a, b)| f64::from(a - b).powi(2)).sum::<f64>()
        };
        let least = POWERS.map(|power| error(4.0_f64.powi(power))).fold(f64::INFINITY, f64::min);
        for noise in [None, Some(&noise)] {
            let given = Given { mask: &mask, samples: &samples, noise, weights: None };
            let found = smoothness(&Settings::default(), &given, &run).unwrap();
            assert!(error(found.lambda) < 1.1 * least, "{found:?} {} {least}", error(found.lambda));
        }
    }

    #[test]
    fn samples_of_unknown_noise_do_not_count() {
        let size = Size::new(120, 110);
        let mask = Arc::new(Mask::from_fn(size, |y, x| hash(3, (y * 110 + x) as u64).is_multiple_of(2)));
        let (_, samples) = noisy(size, 0.2);
        let lambda = |every: u64| {
            let noise = |y: usize, x: usize| {
                let at = y * 110 + x;
                let known = hash(8, at as u64).is_multiple_of(every);
                if known { 0.2 * 1.732 * random(77, at) } else { f32::NAN }
            };
            let noise = Planes::new(size, vec![Plane::from_fn(size, noise)]).unwrap();
            let given = Given { mask: &mask, samples: &samples, noise: Some(&noise), weights: None };
            smoothness(&Settings::default(), &given, &Run::default()).unwrap().lambda
        };
        let (all, half) = (lambda(1), lambda(2));
        assert!((half / all).log(4.0).abs() < 1.0, "{all} {half}");
    }

    #[test]
    fn what_has_no_noise_is_not_smoothed() {
        let mask = Arc::new(Mask::from_fn(SIZE, |y, x| (y + x) % 2 == 0));
        let (_, samples) = noisy(SIZE, 0.0);
        let given = Given { mask: &mask, samples: &samples, noise: None, weights: None };
        assert_eq!(smoothness(&Settings::default(), &given, &Run::default()).unwrap().lambda, 0.0);
    }
}
