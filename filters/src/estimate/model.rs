//! From held-out samples to the error of the missing pixels: a power of the variance, a factor that depends on the place, an interval.

use std::sync::Arc;

use lacuna_core::parallel::prelude::*;
use serde::Serialize;

use super::evidence::Evidence;
use super::held_out::{PixelError, pixels_where};
use super::lattice::is_lattice;
use super::near::{Near, Places};
use super::repetition::Repetition;
use super::variance::Variance;
use super::voronoi::Voronoi;
use crate::kernel::extremes;
use crate::{Mask, Planes, Size};
use lacuna_core::hash;

/// Side of a cell in spacings of held-out samples.
const CELL: f64 = 4.0;
/// Missing pixels that are looked at, about.
pub(super) const LOOKED_AT: usize = 40_000;
/// Bounds of the exponent.
const EXPONENTS: (f64, f64) = (0.0, 1.75);
/// What is added to the exponent where errors are as large as the samples' own differences: there the law levels off, so that two
/// depths show too little of it. Not where samples were put where errors are, in rounds: there estimates are rather too good without it.
const LEVELLED: f64 = 0.15;
/// Standard deviation of the exponent.
const EXPONENT_OFF: f64 = 0.4;
/// The part of the exponent that the errors of other frames go by: they, too, are larger where this frame has no samples near. Chosen on turntables of engine,
/// aneurism and head (`docs/measurements/sequences.md`).
const OTHERS: f64 = 0.4;
/// Standard deviation of the exponent over what it is less by where samples of other frames are taken.
const PART_OFF: f64 = 0.4;
/// Standard deviation of the logarithm of the squared error over that of what errors beyond those seen multiply it by.
const TAIL: f64 = 0.75;
/// Standard deviation of the logarithm of the squared error, of what carries it from held-out samples to missing pixels: of the simulation, and of the
/// power law beside its exponent's.
const CARRIED_OFF: f64 = 0.22;
/// Standard deviation of the rest, of the logarithm of the squared error.
const REST: f64 = 0.1;
/// What chance is multiplied by: errors are dealt less evenly than cells show.
const CHANCE: f64 = 1.5;
/// Standard deviations to either side: 90 % of a normal distribution.
const SIDE: f64 = 1.645;
/// Fewer held-out samples tell nothing.
const FEWEST: usize = 30;
/// Cells that carry the error, fewer of which tell nothing.
const CARRIERS: f64 = 4.0;
/// Errors that may be expected where none was seen: `-ln 0.05`.
const NONE_SEEN: f64 = 3.0;
/// Half an interval, of the logarithm of the squared error, beyond which only its upper end is told: 6 dB.
const WIDEST: f64 = 1.4;
/// The rest, there.
const CHOSEN_REST: f64 = 0.5;
/// And of lattices. Chosen on 162 fills of seventeen small photographs, drawings and renders, of which 81 % of the intervals held without it. On 128 fills of
/// eight renders that had no part in it 127 did.
const LATTICE_REST: f64 = 0.35;
/// Neighbours whose spread is compared with the error.
const SPREAD: usize = 8;

/// The root mean square error of the missing pixels, over the channels of a group.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct Rmse {
    /// The estimate.
    pub rmse: f64,
    /// Lower end of an interval that holds the truth nine times of ten.
    pub low: f64,
    /// Its upper end.
    pub high: f64,
}

impl Rmse {
    /// As PSNR in decibels: the estimate, and the interval from the lower to the upper end.
    pub fn psnr(&self, peak: f64) -> [f64; 3] {
        [self.rmse, self.high, self.low].map(|rmse| 20.0 * (peak / rmse).log10())
    }
}

/// Why an error cannot be told.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
#[serde(rename_all = "kebab-case")]
pub enum Why {
    /// There are too few samples to hold any out.
    FewSamples,
    /// A few samples carry all of the error.
    FewCarryAll,
    /// The missing pixels lie too far from the samples for what these show.
    TooFar,
    /// Errors are seen only where values are clipped.
    Clipped,
}

impl std::fmt::Display for Why {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.write_str(match self {
            Self::FewSamples => "there are too few samples",
            Self::FewCarryAll => "a few samples carry all of the error",
            Self::Clipped => "held-out samples err only where values are clipped, below 0 or above the peak",
            Self::TooFar => "held-out samples say too little about places like those of the missing pixels",
        })
    }
}

/// What is said of the error of a fill.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
#[serde(rename_all = "kebab-case")]
pub enum Verdict {
    /// About how large it is.
    Estimate(Rmse),
    /// A root mean square error that it stays below nine times of ten; how much, samples do not show.
    AtMost(f64),
    /// It cannot be told.
    CannotTell(Why),
}

/// Held-out errors as a law.
#[derive(Clone, Debug)]
pub struct Model {
    mask: Arc<Mask>,
    variance: Variance,
    /// Errors below this are rounding.
    floor: f32,
    /// The range of the samples, of the channel with the largest.
    range: f64,
    /// The exponent of the variance.
    exponent: f64,
    /// Its standard deviation.
    exponent_off: f64,
    held: Vec<PixelError>,
    missing: Vec<PixelError>,
    /// Where samples were put where errors are: missing pixels that a held-out sample is the nearest of, with its place in `held`.
    owned: Option<Vec<(u32, f32)>>,
    /// Share of the exponent that holds between these and their sample.
    share: f64,
    /// All missing pixels.
    all_missing: usize,
    /// Variance of the logarithm of the held-out errors, as tiles show them.
    by_tiles: f64,
    /// From the squared error at held-out samples to that of missing pixels as a simulation shows it: its logarithm, and its variance.
    simulated: Option<(f64, f64)>,
    /// Whether samples are a lattice.
    is_lattice: bool,
    /// The squared error of missing pixels when they were chosen and filled once more: the least that it is.
    repeated: Option<f64>,
}

impl Model {
    /// Learns the law from held-out samples. `truth` holds the samples of `mask`.
    pub fn new(evidence: &Evidence, truth: &Planes, mask: &Arc<Mask>, seed: u64) -> Self {
        let places = Places::new(mask, |_| true);
        let near = &evidence.near;
        let errors = near.squared_errors(truth);
        let voronoi = Voronoi::new(mask);
        let held = near.at.iter().zip(&near.variance).zip(&errors).filter(|(_, squared)| squared.is_finite());
        let held = held.map(|((&pixel, v), &squared)| {
            let weight = voronoi.weight(pixel);
            PixelError { pixel, squared, ln_variance: v.ln(), weight }
        });
        let held: Vec<PixelError> = held.filter(|error| error.weight > 0.0).collect();
        let all_missing = mask.size().pixels() - mask.count();
        let every = (all_missing / LOOKED_AT).max(1) as u64;
        let pixels = pixels_where(mask, |measured, pixel| {
            !measured && hash(seed ^ 0x51, pixel as u64).is_multiple_of(every)
        });
        let variance = Variance::new(evidence.kind, mask, &places, seed);
        let missing: Vec<PixelError> = pixels
            .iter()
            .zip(variance.all(&places, &pixels))
            .map(|(&pixel, v)| PixelError { pixel, squared: 0.0, ln_variance: v.ln(), weight: 1.0 })
            .collect();
        let chosen = voronoi.is_uneven() && voronoi.are_where_errors_are(&near.at, &errors);
        let owned = chosen.then(|| {
            let owned = voronoi.owned(mask, &held, (LOOKED_AT, seed));
            let pixels: Vec<u32> = owned.iter().map(|owned| owned.1).collect();
            owned.iter().zip(variance.all(&places, &pixels)).map(|(owned, v)| (owned.0, v.ln())).collect()
        });
        let (whole, whole_off) = exponent(evidence, truth, &places, if chosen { 0.0 } else { LEVELLED });
        let exponent = of_part(whole, evidence.own, &held, &missing);
        let exponent_off = whole_off.hypot(PART_OFF * (whole - exponent));
        let floor = rounding(truth, mask);
        let range = range(truth, mask);
        let simulated =
            evidence.simulation.as_ref().and_then(|simulation| simulation.factor(evidence.growth(truth)));
        let share = voronoi.share(exponent, EXPONENTS.1);
        let repeated = evidence.repetition.as_ref().map(Repetition::squared);
        let (mask, is_lattice) = (Arc::clone(mask), is_lattice(mask));
        Self {
            mask,
            variance,
            floor,
            range,
            exponent,
            exponent_off,
            held,
            missing,
            owned,
            share,
            all_missing,
            by_tiles: evidence.by_tiles,
            simulated,
            is_lattice,
            repeated,
        }
    }

    /// The exponent of the variance: about 2 where shading is smooth, 0.6 where edges decide, 0 where noise does.
    pub const fn exponent(&self) -> f64 {
        self.exponent
    }

    pub(super) fn size(&self) -> Size {
        self.mask.size()
    }

    /// Whether samples were put where errors are.
    pub(crate) const fn is_chosen(&self) -> bool {
        self.owned.is_some()
    }

    pub(super) const fn range(&self) -> f64 {
        self.range
    }

    pub(super) const fn floor(&self) -> f32 {
        self.floor
    }

    pub(super) fn held(&self) -> &[PixelError] {
        &self.held
    }

    /// The variance of every missing pixel, 0 at measured ones.
    pub(super) fn missing_variance(&self) -> Vec<f32> {
        let places = Places::new(&self.mask, |_| true);
        let one = |(pixel, flag): (usize, &bool)| if *flag { 0.0 } else { self.variance.at(&places, pixel) };
        self.mask.as_slice().par_iter().with_min_len(1 << 12).enumerate().map(one)
    }

    /// The error of the missing pixels.
    pub fn verdict(&self) -> Verdict {
        if self.all_missing == 0 {
            return Verdict::Estimate(Rmse { rmse: 0.0, low: 0.0, high: 0.0 });
        }
        if self.held.len() < FEWEST {
            return Verdict::CannotTell(Why::FewSamples);
        }
        let parts = self.parts(self.exponent);
        let carriers = self.carriers(&parts);
        let (mean, carried) = self.carried(&parts);
        if mean <= 0.0 {
            // As many as were held out may err by nothing although `NONE_SEEN` of them may be expected to err, by the range at most.
            let share = NONE_SEEN / self.held.len() as f64;
            let bound = self.range * share.sqrt();
            return if bound > 0.0 {
                Verdict::AtMost(bound)
            } else {
                Verdict::Estimate(Rmse { rmse: 0.0, low: 0.0, high: 0.0 })
            };
        }
        let by_chance = CHANCE * (1.0 + self.held.len() as f64 / self.all_missing as f64) / carriers;
        let rest = match (&self.owned, self.is_lattice) {
            (Some(_), _) => CHOSEN_REST,
            (None, true) => LATTICE_REST,
            (None, false) => REST,
        };
        let squared: Vec<f64> = self.held.iter().map(|error| error.squared).collect();
        let unseen = TAIL * tail::unseen((&parts, &squared), self.all_missing, self.range);
        let off = (by_chance + unseen.powi(2) + carried + self.by_tiles + rest * rest).sqrt();
        let side = SIDE * off;
        if carriers < CARRIERS {
            return Verdict::CannotTell(Why::FewCarryAll);
        }
        let rmse = mean.sqrt();
        let factor = (0.5 * side).exp();
        // A value of the samples' range put anywhere is not that wrong.
        let high = rmse * factor;
        if high > self.range || high.is_nan() {
            return Verdict::CannotTell(Why::TooFar);
        }
        if side > WIDEST && self.owned.is_some() {
            // Where samples went, errors are small; what none of them has met, they do not bound.
            return Verdict::CannotTell(Why::TooFar);
        }
        if side > WIDEST {
            return Verdict::AtMost(high);
        }
        Verdict::Estimate(Rmse { rmse, low: rmse / factor, high })
    }

    /// What the mean squared error of missing pixels is over that of the power law alone.
    pub(super) fn over_law(&self) -> f64 {
        let parts = self.parts(self.exponent);
        let ratio = self.carried(&parts).0 / self.mean(&parts);
        if ratio.is_finite() { ratio } else { 1.0 }
    }

    /// The mean squared error of missing pixels, and the variance of its logarithm as far as it was carried from held-out samples to them: by
    /// the power law and, where there is one, by the simulation, each as far as it is to be trusted.
    fn carried(&self, parts: &[f64]) -> (f64, f64) {
        let law = self.mean(parts);
        let [steep, flat] = [0.5, -0.5].map(|more| self.mean(&self.parts(self.exponent + more)));
        let off = ((steep / flat).ln() * self.exponent_off).powi(2);
        let held = self.held.iter().map(|error| error.squared).sum::<f64>() / self.held.len() as f64;
        let Some((factor, by_chance)) = self.simulated.filter(|_| law > 0.0 && self.owned.is_none()) else {
            let least = self.repeated.filter(|_| law > 0.0 && self.owned.is_some());
            return (least.map_or(law, |least| law.max(least)), off);
        };
        let (own, off) = (CARRIED_OFF.powi(2) + CHANCE * by_chance, CARRIED_OFF.powi(2) + off);
        let (a, b) = (own / (own + off), off / (own + off));
        let apart = held.ln() + factor - law.ln();
        ((law.ln() + b * apart).exp(), a * off + b * own + a * b * apart * apart)
    }

    /// The mean squared error of missing pixels, from what held-out samples say.
    fn mean(&self, parts: &[f64]) -> f64 {
        let count = self.owned.as_ref().map_or(self.missing.len(), Vec::len);
        parts.iter().sum::<f64>() / count.max(1) as f64
    }

    /// How many cells carry the error.
    fn carriers(&self, parts: &[f64]) -> f64 {
        let (grid, cell) = self.grid();
        let mut cells = vec![0.0; grid.rows * grid.columns];
        self.held.iter().zip(parts).for_each(|(error, part)| cells[cell(error.pixel)] += part);
        let total: f64 = cells.iter().sum();
        let squares: f64 = cells.iter().map(|part| part * part).sum();
        if squares > 0.0 { total * total / squares } else { 0.0 }
    }

    /// What each held-out sample adds to the sum of squared errors of the missing pixels that are looked at.
    fn parts(&self, exponent: f64) -> Vec<f64> {
        match &self.owned {
            Some(owned) => self.by_sample(owned, exponent),
            None => self.by_place(exponent),
        }
    }

    /// Cells of some spacings of held-out samples, and the one of a pixel.
    fn grid(&self) -> (Grid, impl Fn(u32) -> usize + use<>) {
        let size = self.size();
        let density = self.held.len() as f64 / size.pixels().max(1) as f64;
        let side = ((CELL / density.sqrt()).ceil() as usize).max(4);
        let grid = Grid { rows: size.height.div_ceil(side), columns: size.width.div_ceil(side) };
        let cell = move |pixel: u32| {
            let (row, column) = (pixel as usize / size.width, pixel as usize % size.width);
            row / side * grid.columns + column / side
        };
        (grid, cell)
    }

    /// The same where samples were put where errors are: each speaks for the pixels that it is the nearest of, with `e^2 (v' / v)^p`.
    fn by_sample(&self, owned: &[(u32, f32)], exponent: f64) -> Vec<f64> {
        let mut parts = vec![0.0; self.held.len()];
        for &(owner, ln_variance) in owned {
            let error = &self.held[owner as usize];
            let power = (f64::from(ln_variance - error.ln_variance) * self.share * exponent).exp();
            parts[owner as usize] += error.squared * power;
        }
        parts
    }

    /// And elsewhere: in each cell and those around it the factor is `sum e^2 / sum v^p` over held-out samples.
    fn by_place(&self, exponent: f64) -> Vec<f64> {
        let (grid, cell) = self.grid();
        let power = |error: &PixelError| {
            f64::from(error.weight) * f64::from((error.ln_variance * exponent as f32).exp())
        };
        let sums = |errors: &[PixelError]| {
            let mut sums = vec![0.0_f64; grid.rows * grid.columns];
            for error in errors {
                sums[cell(error.pixel)] += power(error);
            }
            sums
        };
        let (held, missing) = (sums(&self.held), sums(&self.missing));
        let around = grid.around(&held);
        let near = |(missing, held): (&f64, &f64)| if *held > 0.0 { missing / held } else { 0.0 };
        // What a held-out error counts for, spread back to where it was seen.
        let counts = grid.around(&missing.iter().zip(&around).map(near).collect::<Vec<_>>());
        // Where nothing was held out near, all of the frame counts.
        let far = missing.iter().zip(&around).filter(|(_, held)| **held <= 0.0).map(|(missing, _)| missing);
        let elsewhere = far.sum::<f64>() / held.iter().sum::<f64>();
        let part = |error: &PixelError| {
            f64::from(error.weight) * error.squared * (counts[cell(error.pixel)] + elsewhere)
        };
        self.held.iter().map(part).collect()
    }
}

/// What rounding may amount to: some steps of f32 at the largest finite sample.
fn rounding(truth: &Planes, mask: &Mask) -> f32 {
    let largest = |plane: &crate::Plane| {
        let measured =
            plane.pixels().iter().zip(mask.as_slice()).filter(|(value, flag)| **flag && value.is_finite());
        measured.fold(0.0, |largest: f32, (value, _)| largest.max(value.abs()))
    };
    8.0 * f32::EPSILON * truth.as_slice().iter().map(largest).fold(0.0, f32::max)
}

/// The largest range of a channel's finite samples.
fn range(truth: &Planes, mask: &Mask) -> f64 {
    let of = |plane: &crate::Plane| {
        let (low, high) = extremes::range(mask.as_slice(), plane.pixels());
        f64::from(high) - f64::from(low)
    };
    truth.as_slice().iter().map(of).filter(|range| range.is_finite()).fold(0.0, f64::max)
}

/// Cells of an image.
#[derive(Clone, Copy)]
struct Grid {
    rows: usize,
    columns: usize,
}

impl Grid {
    /// Sums over a cell and those that touch it.
    fn around(self, cells: &[f64]) -> Vec<f64> {
        let sum = |row: usize, column: usize| -> f64 {
            let columns = column.saturating_sub(1)..(column + 2).min(self.columns);
            let rows = row.saturating_sub(1)..(row + 2).min(self.rows);
            rows.map(|y| cells[y * self.columns..][columns.clone()].iter().sum::<f64>()).sum()
        };
        (0..cells.len()).into_par_iter().with_min_len(256).map(|k| sum(k / self.columns, k % self.columns))
    }
}

/// The exponent of errors of which the part `own` is this frame's, the rest that of other frames. Between held-out samples and missing pixels, the logarithms of
/// whose variances are `l` apart, it makes them `own exp(p l) + (1 - own) exp(OTHERS p l)` times as large.
fn of_part(exponent: f64, own: f64, held: &[PixelError], missing: &[PixelError]) -> f64 {
    let mean = |errors: &[PixelError]| {
        errors.iter().map(|error| f64::from(error.ln_variance)).sum::<f64>() / errors.len() as f64
    };
    let apart = exponent * (mean(missing) - mean(held));
    let part = (own * apart.exp() + (1.0 - own) * (OTHERS * apart).exp()).ln() / apart;
    if own < 1.0 && part.is_finite() { part * exponent } else { exponent }
}

/// The exponent from samples that were held out at two depths, and its standard deviation.
///
/// It makes `sum e^2 (v' / v)^p` over the samples equal to `sum e'^2`: those that carry the error decide. Where errors are as large as the samples'
/// own differences, `levelled` is added.
fn exponent(evidence: &Evidence, truth: &Planes, places: &Places, levelled: f64) -> (f64, f64) {
    let [near, deep] = &evidence.pairs;
    let pairs: Vec<[f64; 3]> = near
        .squared_errors(truth)
        .into_iter()
        .zip(deep.squared_errors(truth))
        .zip(deep.variance.iter().zip(&near.variance))
        .map(|((e, deep), (v, near))| [e, deep, f64::from(v / near).ln()])
        .filter(|pair| pair.iter().all(|value| value.is_finite()))
        .collect();
    let deep_sum: f64 = pairs.iter().map(|pair| pair[1]).sum();
    let near_sum: f64 = pairs.iter().map(|pair| pair[0]).sum();
    if pairs.len() < FEWEST || deep_sum <= 0.0 || near_sum <= 0.0 {
        return (0.5 * (EXPONENTS.0 + EXPONENTS.1), EXPONENTS.1 - EXPONENTS.0);
    }
    let excess = |p: f64| pairs.iter().map(|pair| pair[0] * (p * pair[2]).exp()).sum::<f64>() - deep_sum;
    let (mut low, mut high) = (-1.0, 4.0);
    for _ in 0..40 {
        let middle = 0.5 * (low + high);
        if excess(middle) < 0.0 {
            low = middle;
        } else {
            high = middle;
        }
    }
    let found = 0.5 * (low + high);
    let spread = if levelled > 0.0 { spread(evidence, truth, places) } else { 0.0 };
    let part = if spread > 0.0 { (near_sum / spread).min(1.0) } else { 0.0 };
    let exponent = (found + levelled * part).clamp(EXPONENTS.0, EXPONENTS.1);
    (exponent, EXPONENT_OFF + (found - EXPONENTS.1).max(EXPONENTS.0 - found).max(0.0) * 0.5)
}

/// `sum s^2` over the pairs, `s^2` the variance of a sample's nearest samples' values, the mean over the channels.
fn spread(evidence: &Evidence, truth: &Planes, places: &Places) -> f64 {
    let [near, _] = &evidence.pairs;
    let width = truth.size().width;
    let one = |&pixel: &u32| {
        let mut found = [Near::default(); SPREAD];
        let count = places.nearest((pixel as usize / width, pixel as usize % width), &mut found);
        let of = |plane: &crate::Plane| {
            let value = |near: &Near| f64::from(plane.at(near.row as usize, near.column as usize));
            let n = count.max(1) as f64;
            let mean = found[..count].iter().map(value).sum::<f64>() / n;
            found[..count].iter().map(|near| (value(near) - mean).powi(2)).sum::<f64>() / n
        };
        truth.as_slice().iter().map(of).sum::<f64>() / truth.len().max(1) as f64
    };
    let all: Vec<f64> = near.at.par_iter().with_min_len(512).map(one);
    all.iter().filter(|value| value.is_finite()).sum()
}

mod tail;
#[cfg(test)]
mod tests;
