//! Every leave-one-out residual of an interpolating spline, from one application of its energy.
//!
//! With `x` the filled image, `E` the energy, measured pixels `m` and missing ones `u`,
//!
//! ```text
//! y_i - x_without_i(i) = (E x)_i / S_ii,      S = E_mm - E_mu E_uu^-1 E_um
//! ```
//!
//! as `S` is the energy of samples alone and `(E x)_m = S y`. `1 / S_ii` is the variance of the sample given the others, which
//! [`super::variance`] knows up to a factor; the factor follows from some thousand samples that are also predicted by kriging.
//! The same samples are predicted with half of the others held out. They are drawn more often where the residual is large, and
//! count for less there.

use lacuna_core::parallel::prelude::*;

use super::evidence::{Evidence, Folds, HeldOut, PARTS};
use super::kriging::{NEIGHBOURS, krige};
use super::near::{Near, Places};
use super::variance::{Kind, Variance};
use crate::kernel::Isa;
use crate::kernel::stencil::{Separable, apply};
use crate::kernel::window::Window;
use crate::operator::energy::Form;
use crate::sampling::hash;
use crate::variational::ss;
use crate::{Mask, Plane, Planes};

/// Samples that are predicted at two depths, about.
const PAIRS: f64 = 8000.0;

/// Whether the identity holds for these settings; else folds are held out.
pub fn suits(settings: &ss::Settings) -> bool {
    settings.lambda == 0.0 && settings.order == ss::Order::Second
}

/// Leaves every sample out of a spline's fill.
///
/// `filled` is that fill of `samples`, of settings that [`suits`] accepts, and before anything limits it.
pub fn leave_one_out(
    settings: &ss::Settings,
    (samples, mask): (&Planes, &Mask),
    filled: &Planes,
    folds: Folds,
) -> Evidence {
    let places = Places::new(mask, |_| true);
    let at = folds.held_out(mask, &(0..PARTS));
    let variance = Variance::new(Kind::Spline, mask, &places, folds.seed).all(&places, &at);
    let energy: Separable<f32> = Form::new(settings.kernel, settings.order.number(), settings.tension)
        .energy(mask.size(), (1.0, 1.0))
        .cast();
    // Up to a factor the residuals.
    let mut residuals: Vec<Vec<f32>> =
        filled.as_slice().iter().map(|plane| forces(&energy, plane, &at)).collect();
    for values in &mut residuals {
        values.iter_mut().zip(&variance).for_each(|(value, v)| *value *= v);
    }
    let (drawn, weights) = draw(&residuals, &at, folds);
    let pixels: Vec<u32> = drawn.iter().map(|&k| at[k]).collect();
    let near = predict(samples, (mask, &places), &pixels, folds);
    let half = Places::new(mask, |pixel| folds.part(pixel) < PARTS / 2);
    let deep = predict(samples, (mask, &half), &pixels, folds);
    let alpha = factor(samples, &residuals, (&drawn, &weights), &near);
    let predicted = residuals.iter().zip(samples.as_slice()).map(|(residuals, plane)| {
        let one = |(&residual, &pixel): (&f32, &u32)| {
            plane.pixels()[pixel as usize] - (alpha * f64::from(residual)) as f32
        };
        residuals.iter().zip(&at).map(one).collect()
    });
    let near_all = HeldOut { predicted: predicted.collect(), at, variance };
    let known: Vec<usize> =
        (0..pixels.len()).filter(|&k| near.variance[k].is_finite() && deep.variance[k].is_finite()).collect();
    let only = |held: &HeldOut| HeldOut {
        at: known.iter().map(|&k| held.at[k]).collect(),
        predicted: held.predicted.iter().map(|values| known.iter().map(|&k| values[k]).collect()).collect(),
        variance: known.iter().map(|&k| held.variance[k]).collect(),
    };
    let weights = known.iter().map(|&k| weights[k]).collect();
    Evidence { kind: Kind::Spline, near: near_all, pairs: (weights, only(&near), only(&deep)) }
}

/// `E x` at some pixels.
fn forces(energy: &Separable<f32>, plane: &Plane, at: &[u32]) -> Vec<f32> {
    let size = plane.size();
    let window = Window { y: 0, x: 0, height: size.height, width: size.width };
    // The energy does not see constants; rounding does.
    let sum: f64 = at.iter().map(|&pixel| f64::from(plane.pixels()[pixel as usize])).sum();
    let mean = (sum / at.len().max(1) as f64) as f32;
    let (mut x, mut q) = (window.zeros::<f32>(), window.zeros::<f32>());
    for row in 0..size.height {
        let start = window.at(row, 0);
        for (x, value) in x[start..start + size.width].iter_mut().zip(plane.row(row)) {
            *x = value - mean;
        }
    }
    apply(Isa::best(), energy, window, &x, None, &mut q);
    at.iter().map(|&pixel| q[window.at(pixel as usize / size.width, pixel as usize % size.width)]).collect()
}

/// Draws samples, half of the chances alike and half by their squared residual. Returns their places in the list, and one over the
/// chance of each.
fn draw(residuals: &[Vec<f32>], at: &[u32], folds: Folds) -> (Vec<usize>, Vec<f32>) {
    let squared = |k: usize| residuals.iter().map(|values| f64::from(values[k]).powi(2)).sum::<f64>();
    let total: f64 = (0..at.len()).map(squared).sum();
    let chance = |k: usize| {
        let own = if total > 0.0 { squared(k) / total } else { 0.0 };
        (PAIRS * 0.5 * (own + 1.0 / at.len() as f64)).min(1.0)
    };
    let taken = |k: usize| {
        let chance = chance(k);
        let random = hash(folds.seed ^ 0x9e1f, u64::from(at[k])) as f64 / u64::MAX as f64;
        (random < chance).then_some((k, chance.recip() as f32))
    };
    (0..at.len()).filter_map(taken).unzip()
}

/// Predicts pixels from their nearest samples; the variance is infinite where these do not suffice.
fn predict(samples: &Planes, (mask, places): (&Mask, &Places), pixels: &[u32], folds: Folds) -> HeldOut {
    let width = mask.size().width;
    let variance = Variance::new(Kind::Spline, mask, places, folds.seed).all(places, pixels);
    let one = |&pixel: &u32| {
        let place = (pixel as usize / width, pixel as usize % width);
        let mut found = [Near::default(); NEIGHBOURS];
        let count = places.nearest(place, &mut found);
        let kriged = krige(place, &found[..count])?;
        let value = |plane: &Plane| {
            let terms = found[..count].iter().zip(kriged.weights);
            terms
                .map(|(near, w)| w * f64::from(plane.at(near.row as usize, near.column as usize)))
                .sum::<f64>() as f32
        };
        Some(samples.as_slice().iter().map(value).collect::<Vec<f32>>())
    };
    let values: Vec<Option<Vec<f32>>> = pixels.par_iter().with_min_len(64).map(one);
    let known = |(variance, value): (&f32, &Option<Vec<f32>>)| {
        if value.is_some() { *variance } else { f32::INFINITY }
    };
    HeldOut {
        at: pixels.to_vec(),
        predicted: (0..samples.len())
            .map(|channel| {
                values.iter().map(|value| value.as_ref().map_or(0.0, |value| value[channel])).collect()
            })
            .collect(),
        variance: variance.iter().zip(&values).map(known).collect(),
    }
}

/// What residuals are multiplied by, so that they are those of kriging in the mean.
fn factor(
    samples: &Planes,
    residuals: &[Vec<f32>],
    (drawn, weights): (&[usize], &[f32]),
    kriged: &HeldOut,
) -> f64 {
    let (mut cross, mut square) = (0.0, 0.0);
    for ((plane, residuals), predicted) in samples.as_slice().iter().zip(residuals).zip(&kriged.predicted) {
        for (k, (&place, &weight)) in drawn.iter().zip(weights).enumerate() {
            if kriged.variance[k].is_finite() {
                let g = f64::from(residuals[place]);
                let error = f64::from(plane.pixels()[kriged.at[k] as usize]) - f64::from(predicted[k]);
                cross += f64::from(weight) * g * error;
                square += f64::from(weight) * g * g;
            }
        }
    }
    // The covariance of this energy is that of kriging over eight pi.
    if cross > 0.0 && square > 0.0 { cross / square } else { (8.0 * std::f64::consts::PI).recip() }
}

#[cfg(test)]
mod tests;
