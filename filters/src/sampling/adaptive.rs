//! Pixels chosen in rounds: what was measured says where to measure next.
//!
//! Of `N` pixels at most `round(D N)` are measured, in `R` rounds. The first takes the mask of density `first` in the order of
//! [`shuffle`]; each further one takes an equal part of the rest where the estimated error of the fill so far is largest
//! (`refine`), but one pixel in 64 by the order of the shuffle, whatever the estimate says. With one round, or `first = D`, it is the
//! shuffle's mask, without the last pixels of its order where it has more than these.
//!
//! New pixels test the fill that chose them. With `e` the estimated and `t` the true error of that fill at them, the mean of `t^2` is taken for `exp(a + b ln e^2)`, which is fitted to octaves of `e`
//! as if `t^2` had a gamma distribution, those of earlier rounds counting half as much each. It turns the next round's estimate into one that has been right before: chosen pixels tell of large
//! errors, the others of small ones. The estimate of a round is the root mean square over all pixels and channels, 0 at measured ones, over the range of the measured values. Where the values of
//! every channel are alike, nothing is told: what is small may have been missed.
//!
//! Frames of a sequence take their pixels in other orders, so that frames in a row choose other pixels of the same places (`refine`).
//!
//! Values enter as `refine` has them: linear to 1, logarithmic beyond, in a power of two where the first round's are tiny. The mask depends on the values that `measure` returns, on the
//! settings and on the field, not on the number of threads.
//!
//! Rounds, the share of the first and the powers of `refine` were chosen on five volume renders and two path-traced frames at 5, 10 and 20 %;
//! how tests of earlier rounds count on seven of the fifteen renders of docs/measurements/masks.md.
//!
//! Cost: a rough fill and an application of its energy a round, of as few principal components of the channels' errors as hold 98 % of
//! them in a first image (`components.rs`). Fails: on noisy samples, and on what the first round passes over: what lies
//! between its samples and does not show at them is only found by chance.
//!
//! Source: P. `McCullagh`, J. A. Nelder, "Generalized Linear Models", 1989, chapter 8 (gamma errors).

use std::mem;
use std::sync::Arc;

use lacuna_core::parallel::prelude::*;

use super::components::Components;
use super::refine::{self, Estimate, Preference, compress};
use super::{Band, Field, leave_out, shuffle};
use crate::variational::ss;
use crate::{Error, Mask, Plane, Planes, Run, Size};

/// Rounds, if nothing else is asked for.
pub const ROUNDS: usize = 8;
/// All pixels over those that the first round takes, if nothing else is asked for.
const FIRST: f64 = 5.0;
/// One new pixel in so many is taken by the shuffle's order.
const EXPLORE: usize = 64;
/// By how much a share of the shuffle's order may be off.
const SLACK: f64 = 1e-3;
/// What tests of the round before count for, beside those of a round.
const KEPT: f64 = 0.5;
/// New pixels of an octave that say as much as any more.
const ENOUGH: f64 = 256.0;
/// The range of the widest channel, over that of all, up to which a colour counts as flat: a hair of noise tells nothing.
const FLAT: f32 = 1e-4;
const NO_ENDS: (f32, f32) = (f32::INFINITY, f32::NEG_INFINITY);
/// Exponents of a float.
const OCTAVES: usize = 1 << 8;
/// Powers that a fit may have, and how often their interval is halved to find it.
const POWERS: (f64, f64) = (0.2, 1.2);
const HALVINGS: usize = 40;

/// How many pixels, and in which rounds.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Settings {
    /// Measured pixels over all pixels, at most; 0 to 1.
    pub density: f64,
    /// Rounds, 1 or more, up to the pixels that are measured; [`ROUNDS`] if `None`, or fewer where fewer pixels are measured.
    pub rounds: Option<usize>,
    /// Density of the first round, up to `density`; [`first_of`] that if `None`.
    pub first: Option<f64>,
    /// The estimated error, over the measured range, from which on no round follows; nothing measures all.
    pub target: Option<f64>,
    /// Of the shuffle.
    pub seed: u64,
    /// The number of the frame, if it is one of a sequence.
    pub frame: Option<i64>,
}

/// The density of the first round where only that of all is given: a fifth of it.
pub fn first_of(density: f64) -> f64 {
    density / FIRST
}

/// A round that was measured.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Round {
    /// Pixels that it added.
    pub pixels: usize,
    /// The estimated error of the fill after it, over the measured range, good to a factor of about two (fill tells it better); nothing where no measured value is finite, nor
    /// where those of every channel are alike; 0 once every pixel is measured.
    pub error: Option<f64>,
}

/// What was measured.
#[derive(Clone, Debug, PartialEq)]
pub struct Chosen {
    /// The pixels.
    pub mask: Mask,
    /// The rounds that it took.
    pub rounds: Vec<Round>,
    /// The rounds that it was to take.
    pub planned: usize,
}

impl Settings {
    /// The density of the first round.
    pub fn first(&self) -> f64 {
        if self.rounds == Some(1) {
            self.density
        } else {
            self.first.unwrap_or_else(|| first_of(self.density))
        }
    }

    /// Whether these make sense for so many pixels; how many are measured in the end.
    ///
    /// # Errors
    /// [`Error::Setting`].
    pub fn check(&self, pixels: usize) -> Result<usize, Error> {
        super::checked(self.density)?;
        let first = self.first();
        let is_none = first == 0.0 && self.density > 0.0;
        if is_none || !(0.0..=self.density).contains(&first) {
            return Err(Error::setting(
                "first",
                &first,
                "above 0, and at most the density, which counts all rounds",
            ));
        }
        if let Some(target) = self.target.filter(|target| target.is_nan() || *target < 0.0) {
            return Err(Error::setting("target error", &target, "0 or more"));
        }
        let total = (self.density * pixels as f64).round() as usize;
        if let Some(rounds) = self.rounds.filter(|rounds| !(1..=total.max(1)).contains(rounds)) {
            let range = format!("1 to {}, the pixels that are measured", total.max(1));
            return Err(Error::Setting { name: "rounds", value: rounds.to_string(), range: range.into() });
        }
        Ok(total)
    }
}

/// Measures pixels in rounds.
///
/// `measure` is given the new pixels of a round and returns planes that hold their values; what these hold elsewhere is not read. They are
/// let go before the next round, so that a renderer may write all rounds into the same.
/// A pixel with a value that is not finite counts as measured and says nothing. If the run is interrupted, no round follows.
/// Where not all of the field can be measured, `within` says which pixels can: the others are never chosen, and no density counts them.
///
/// # Errors
/// Settings out of range, a mask of another size, and those of `measure`.
pub fn choose<E: From<Error>>(
    settings: &Settings,
    (field, within): (Field, Option<&Mask>),
    run: &Run<'_>,
    measure: impl FnMut(&Mask) -> Result<Arc<Planes>, E>,
) -> Result<Chosen, E> {
    in_rounds(settings, (field, within), true, run, measure)
}

/// The same; the error of the last round only if it `tells`.
pub(crate) fn in_rounds<E: From<Error>>(
    settings: &Settings,
    (field, within): (Field, Option<&Mask>),
    tells: bool,
    run: &Run<'_>,
    mut measure: impl FnMut(&Mask) -> Result<Arc<Planes>, E>,
) -> Result<Chosen, E> {
    let mut known = Known::new(field.size, within)?;
    let total = settings.check(known.pixels)?;
    let preference = Preference::new(settings.seed, settings.frame);
    let planned = settings.rounds.unwrap_or(ROUNDS.min(total)).max(1);
    let first = if planned == 1 { settings.density } else { settings.first() };
    let spread = shuffle::mask(field.x, field.y, field.size, first, preference.seed())?;
    let mut new = Mask::from_fn(field.size, |row, column| {
        spread.is_measured(row, column) && within.is_none_or(|within| within.is_measured(row, column))
    });
    if new.count() > total {
        new = of_pixels(field.size, in_order(&known, total, field, preference.seed()));
    }
    let mut rounds: Vec<Round> = Vec::new();
    // The estimate that chose the new pixels, and the squared distances with them.
    let mut before: Option<(Estimate, Vec<u32>)> = None;
    let mut calibration = Calibration::default();
    loop {
        let at: Vec<usize> = (0..field.size.pixels()).filter(|&pixel| new.as_slice()[pixel]).collect();
        let values = measure(&new)?;
        known.add(&at, &values)?;
        drop(values);
        if let (Some((before, _)), Some(samples)) = (&before, &known.samples) {
            calibration.add(before, samples, at.iter().copied().filter(|&pixel| known.usable[pixel]));
        }
        let left = planned.saturating_sub(rounds.len() + 1);
        let over = left == 0 || known.count >= total || run.interrupted().is_some();
        let is_full = known.count == known.pixels;
        let estimate = if over && (is_full || !tells) { None } else { known.estimate(before.take(), run)? };
        let values = known.pixels * known.channels;
        let error = estimate.as_ref().zip(known.range());
        let error = error.map(|(found, range)| calibration.fit().rmse(found, values, range));
        let error = if is_full { Some(0.0) } else { error };
        rounds.push(Round { pixels: new.count(), error });
        let reached = error.zip(settings.target).is_some_and(|(error, target)| error <= target);
        if over || reached {
            return Ok(Chosen { mask: Mask::new(field.size, known.mask)?, rounds, planned });
        }
        let count = (total - known.count).div_ceil(left);
        let (taken, squared) = next(estimate.as_ref(), &known, count, field, preference);
        new = of_pixels(field.size, taken);
        before = estimate.zip(squared);
    }
}

/// The pixels of the next round, and the squared distances with them where there is an estimate.
fn next(
    estimate: Option<&Estimate>,
    known: &Known<'_>,
    count: usize,
    field: Field,
    preference: Preference,
) -> (Vec<usize>, Option<Vec<u32>>) {
    let Some(estimate) = estimate else { return (in_order(known, count, field, preference.seed()), None) };
    let mut taken = in_order(known, count / EXPLORE, field, preference.seed());
    let (more, squared) =
        estimate.next_beside(&taken, count - taken.len(), field, preference, |pixel| known.is_open(pixel));
    taken.extend(more);
    (taken, Some(squared))
}

/// The mask that measures these.
fn of_pixels(size: Size, pixels: Vec<usize>) -> Mask {
    let mut flags = vec![false; size.pixels()];
    for pixel in pixels {
        flags[pixel] = true;
    }
    Mask::of(size, flags)
}

/// The first `count` missing pixels in the order of the shuffle.
fn in_order(known: &Known<'_>, count: usize, field: Field, seed: u64) -> Vec<usize> {
    let Field { size, .. } = field;
    let rank = |pixel: usize| {
        let (x, y) = field.at(pixel / size.width, pixel % size.width);
        shuffle::rank(x, y, seed)
    };
    // Ranks are spread evenly, so these nearly always suffice.
    let enough = (known.count + count) as f64 / known.pixels as f64 + SLACK;
    for most in [enough.min(1.0), 1.0] {
        let ranked = |row: usize| -> Vec<(f64, usize)> {
            let (x, y) = field.at(row, 0);
            let mut early = vec![false; size.width];
            shuffle::fill(x, y, seed, Band::below(most), &mut early);
            let pixels = (row * size.width..(row + 1) * size.width).zip(early);
            let missing = pixels.filter(|&(pixel, early)| early && known.is_open(pixel));
            missing.map(|(pixel, _)| (rank(pixel), pixel)).collect()
        };
        let mut ranked = (0..size.height).into_par_iter().map(ranked).concat();
        if ranked.len() < count && most < 1.0 {
            continue;
        }
        if count < ranked.len() {
            ranked.select_nth_unstable_by(count, |a, b| a.0.total_cmp(&b.0).then(a.1.cmp(&b.1)));
            ranked.truncate(count);
        }
        return ranked.into_iter().map(|(_, pixel)| pixel).collect();
    }
    Vec::new()
}

/// What was measured so far.
struct Known<'a> {
    size: Size,
    /// The pixels that can be measured, if not all can, and how many they are.
    within: Option<&'a Mask>,
    pixels: usize,
    mask: Vec<bool>,
    /// How many.
    count: usize,
    /// Those whose values are finite, or have been taken for what was filled.
    usable: Vec<bool>,
    /// The others, and whether some of them are of earlier rounds than the last one.
    blank: Vec<usize>,
    is_older: bool,
    /// Their values, as they count: the channels, or fewer components of these where the first of them show that they suffice.
    samples: Option<Planes>,
    components: Option<Components>,
    channels: usize,
    /// What values are multiplied by.
    unit: f32,
    /// Least and largest of the usable values of each channel.
    ends: Vec<(f32, f32)>,
}

impl<'a> Known<'a> {
    fn new(size: Size, within: Option<&'a Mask>) -> Result<Self, Error> {
        if let Some(other) = within.map(Mask::size).filter(|other| *other != size) {
            return Err(Error::SizeMismatch { expected: size, found: other.to_string() });
        }
        let (mask, usable) = (vec![false; size.pixels()], vec![false; size.pixels()]);
        Ok(Self {
            size,
            within,
            pixels: within.map_or(size.pixels(), Mask::count),
            mask,
            count: 0,
            usable,
            blank: vec![],
            is_older: false,
            samples: None,
            components: None,
            channels: 0,
            unit: 1.0,
            ends: vec![],
        })
    }

    /// Whether a pixel can be measured and was not.
    fn is_open(&self, pixel: usize) -> bool {
        !self.mask[pixel] && self.within.is_none_or(|within| within.as_slice()[pixel])
    }

    /// Takes up the values of new pixels.
    fn add(&mut self, new: &[usize], values: &Planes) -> Result<(), Error> {
        let size = self.size;
        if values.size() != size {
            return Err(Error::SizeMismatch { expected: size, found: values.size().to_string() });
        }
        self.channels = values.len();
        if self.samples.is_none() {
            let range = |plane: &Plane| {
                let own = new.iter().map(|&pixel| compress(plane.pixels()[pixel])).filter(|v| v.is_finite());
                let (low, high) = own.fold(NO_ENDS, |(low, high), v| (low.min(v), high.max(v)));
                f64::from(high) - f64::from(low)
            };
            self.unit = refine::unit(values.as_slice().iter().map(range).fold(0.0, f64::max));
        }
        let count = self.components.as_ref().map_or(values.len(), Components::len);
        let samples = self.samples.get_or_insert_with(|| Planes::zeros(size, count));
        self.count += new.len();
        self.is_older = !self.blank.is_empty();
        for &pixel in new {
            self.mask[pixel] = true;
            let own = values.as_slice().iter().map(|plane| plane.pixels()[pixel]);
            if !own.clone().all(f32::is_finite) {
                self.blank.push(pixel);
                continue;
            }
            self.usable[pixel] = true;
            let unit = self.unit;
            let own = own.map(|value| unit * compress(value));
            self.ends.resize(self.channels, NO_ENDS);
            let ends = self.ends.iter_mut().zip(own.clone());
            ends.for_each(|(ends, value)| *ends = (ends.0.min(value), ends.1.max(value)));
            for (k, (plane, value)) in samples.as_mut_slice().iter_mut().zip(own.clone()).enumerate() {
                let components = self.components.as_ref();
                plane.pixels_mut()[pixel] = components.map_or(value, |found| found.of(k, own.clone()));
            }
        }
        Ok(())
    }

    /// Takes pixels whose values are not finite for what was filled there: left open, they would draw the next rounds. Whether all of them are of
    /// the last round.
    fn complete(&mut self, filled: &Planes) -> bool {
        let Some(samples) = &mut self.samples else { return true };
        for (own, filled) in samples.as_mut_slice().iter_mut().zip(filled.as_slice()) {
            self.blank.iter().for_each(|&pixel| own.pixels_mut()[pixel] = filled.pixels()[pixel]);
        }
        for pixel in mem::take(&mut self.blank) {
            self.usable[pixel] = true;
        }
        !self.is_older
    }

    /// With the estimate before this one, and squared distances to all that was measured since.
    fn estimate(
        &mut self,
        before: Option<(Estimate, Vec<u32>)>,
        run: &Run<'_>,
    ) -> Result<Option<Estimate>, Error> {
        let before = before.map(|(before, squared)| {
            let filled = before.into_filled();
            let are_new = self.complete(&filled);
            (filled, Some(squared).filter(|_| are_new))
        });
        let Some(samples) = self.samples.as_mut().filter(|samples| !samples.is_empty()) else {
            return Ok(None);
        };
        if !self.usable.contains(&true) {
            return Ok(None);
        }
        let mask = Arc::new(Mask::new(samples.size(), self.usable.clone())?);
        let before = if let Some(before) = before {
            before
        } else {
            let mut start = refine::start(samples, &mask, run)?;
            if self.components.is_none() {
                let products = leave_out::of_spline(&ss::Settings::default(), &mask, &start).products;
                self.components = Components::new(&products, samples.len());
                if let Some(components) = &self.components {
                    (*samples, start) = (components.apply(samples), components.apply(&start));
                }
            }
            (start, None)
        };
        let found = Estimate::of_spline(samples, &mask, Some(before), run)?;
        Ok(Some(self.within.into_iter().fold(found, Estimate::within)))
    }

    /// Of all values that were measured; nothing where those of every channel are alike, but for a hair beside that range.
    fn range(&self) -> Option<f64> {
        let (low, high) = self.ends.iter().fold(NO_ENDS, |all, ends| (all.0.min(ends.0), all.1.max(ends.1)));
        let own = self.ends.iter().map(|(low, high)| high - low).fold(0.0, f32::max);
        (own > (FLAT * (high - low)).max(0.0)).then(|| f64::from(high) - f64::from(low))
    }
}

/// What new pixels showed of estimates that did not know them.
struct Calibration {
    /// Per octave of the estimate: pixels, and the sums of both squared errors.
    octaves: Vec<[f64; 3]>,
}

impl Default for Calibration {
    fn default() -> Self {
        Self { octaves: vec![[0.0; 3]; OCTAVES] }
    }
}

impl Calibration {
    /// Adds those of a round.
    fn add(&mut self, before: &Estimate, samples: &Planes, new: impl Iterator<Item = usize>) {
        self.octaves.iter_mut().flatten().for_each(|sum| *sum *= KEPT);
        for pixel in new {
            let guess = before.squared_error(pixel);
            if guess > 0.0 && guess.is_finite() {
                // The exponent of the float.
                let octave = &mut self.octaves[(guess.to_bits() >> (f32::MANTISSA_DIGITS - 1)) as usize];
                let truth = before.misses(samples, pixel);
                for (sum, value) in octave.iter_mut().zip([1.0, f64::from(guess), truth]) {
                    *sum += value;
                }
            }
        }
    }

    /// What makes the means of the true errors likeliest; the estimate itself where none of the pixels errs.
    fn fit(&self) -> Fit {
        let octaves = self.octaves.iter().filter(|[count, ..]| *count > 0.0);
        // The count, the logarithm of the mean estimate, the mean true error.
        let points: Vec<[f64; 3]> = octaves
            .map(|[count, guess, truth]| [count.min(ENOUGH), (guess / count).ln(), truth / count])
            .collect();
        if points.iter().all(|point| point[2] <= 0.0) {
            return Fit { factor: 0.0, power: 1.0 };
        }
        let count: f64 = points.iter().map(|point| point[0]).sum();
        let ratio = |power: f64, [_, guess, truth]: &[f64; 3]| truth / (power * guess).exp();
        let factor = |power: f64| {
            let sum: f64 = points.iter().map(|point| point[0] * ratio(power, point)).sum();
            (sum / count).ln()
        };
        // The derivative of the likelihood by the power falls as that grows.
        let score = |power: f64| {
            let scale = factor(power).exp();
            points.iter().map(|point| point[0] * (ratio(power, point) / scale - 1.0) * point[1]).sum::<f64>()
        };
        let (mut low, mut high) = POWERS;
        for _ in 0..HALVINGS {
            let middle = 0.5 * (low + high);
            if score(middle) > 0.0 {
                low = middle;
            } else {
                high = middle;
            }
        }
        let power = 0.5 * (low + high);
        Fit { factor: factor(power), power }
    }
}

/// The true squared error as a function of the estimated one.
#[derive(Clone, Copy, Debug)]
struct Fit {
    /// `a`.
    factor: f64,
    /// `b`.
    power: f64,
}

impl Fit {
    /// The true squared error where this is estimated, which is above 0.
    fn truth(self, guess: f32) -> f64 {
        (self.factor + self.power * f64::from(guess).ln()).exp()
    }

    /// The root mean square over so many `values`, those of all pixels and channels, of what a fill errs by, over `range`.
    fn rmse(self, estimate: &Estimate, values: usize, range: f64) -> f64 {
        let errors = estimate.squared_errors().into_iter();
        let sum = errors.fold(0.0, |sum, (guess, count)| sum + count as f64 * self.truth(guess));
        let mean = sum / values.max(1) as f64;
        mean.sqrt() / range
    }
}

#[cfg(test)]
#[path = "adaptive/tests.rs"]
mod tests;
