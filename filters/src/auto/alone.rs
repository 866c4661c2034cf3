//! One candidate alone on a large image: what it errs by is held out on tiles, and carried to all of the image by what splines err by.
//!
//! ```text
//! e(i) = r l(i),      r^2 = sum over held-out samples of tiles, where l is about as large, of e^2 / sum over the same of l^2
//! ```
//!
//! with `e` the candidate's error at a sample that was held out, and `l` that of splines, which one application of their energy tells at every sample
//! (`sampling/leave_out.rs`). Tiles show a tenth of the image; where errors are, `l` shows. There are ten ratios, of equally many samples: where `l` is
//! small, in smooth shading, candidates differ less than at edges. How errors grow and fall with the distance of samples is learned from splines,
//! too. The variance of the logarithm of squared errors follows from how much tiles differ; where they differ too much, nothing comes of it.
//!
//! Source: W. G. Cochran, "Sampling Techniques", 1977, chapter 6 (ratio estimates).

use std::collections::BTreeMap;
use std::iter::successors;
use std::sync::Arc;

use super::{Blend, Candidate, candidates, once};
use crate::decided::Decided;
use crate::descriptor::Kind;
use crate::estimate::{Evidence, HeldOut, Rounds};
use crate::sampling::leave_out;
use crate::variational::ss;
use crate::{Error, Outcome, Planes, Problem, Run};

/// The variance beyond which tiles do not show what all of the image errs by: for colours of eight renders at 20 % it is 0.003 to 0.015, for opacities
/// up to 0.06.
const UNSURE: f64 = 0.06;
/// Ratios by how large errors of splines are.
const CLASSES: usize = 10;
/// Pixels of the side of a cell that differs from others as tiles do.
const CELL: usize = 128;

impl Blend {
    /// Fills by the only candidate, of which `held` was predicted at samples of tiles; nothing if these do not do.
    pub(super) fn alone(
        &self,
        (only, [held, plainly]): (&Candidate<'_>, [HeldOut; 2]),
        samples: &Planes,
        rounds: Rounds<'_>,
        out: &mut Planes,
        run: &Run<'_>,
    ) -> Result<Option<(Outcome, Decided)>, Error> {
        let mut plain = Planes::zeros(samples.size(), samples.len());
        let mut outcome = self.plain.reconstruct(samples, &mut plain, run)?;
        let fold = self.first_fold();
        let errors = leave_out::of_spline_at(&ss::Settings::default(), &self.mask, &plain, &fold.at);
        let near = HeldOut { predicted: errors, ..fold.clone() };
        let Some((near, variance)) = carried((&held, near), samples) else { return Ok(None) };
        if variance > UNSURE || run.interrupted().is_some() {
            return Ok(None);
        }
        // Whatever it starts from, from splines on.
        let all = candidates().map(Candidate::of);
        let named = |name: &'static str| all.iter().find(|candidate| candidate.name == name);
        let chain: Vec<&Candidate<'_>> =
            successors(Some(only), |next| next.filter.start().and_then(named)).collect();
        for next in chain.into_iter().rev() {
            if next.name == ss::DESCRIPTOR.name {
                std::mem::swap(out, &mut plain);
                continue;
            }
            let plan = next.filter.plan(&Problem::fill(Arc::clone(&self.mask)), run)?;
            let ended = match next.filter.start() {
                Some(_) => plan.reconstruct_from_start(samples, None, out, run)?,
                None => plan.reconstruct(samples, out, run)?,
            };
            outcome = outcome.worst(ended);
        }
        drop(plain);
        for (samples, out) in samples.as_slice().iter().zip(out.as_mut_slice()) {
            self.mask.restore(samples, out);
        }
        let splines = Candidate::of((&ss::DESCRIPTOR, Box::new(ss::Settings::default())));
        let evidence = self.evidence(&splines, (plainly, near), (samples, Some(&*out)), rounds, run)?;
        let evidence = Some(Evidence { by_tiles: variance, ..evidence });
        Ok(Some((outcome, Decided { evidence, ..Decided::alone(only.name) })))
    }
}

impl Blend {
    /// The samples of the frame that are held out first, and how uncertain the others leave them.
    fn first_fold(&self) -> &HeldOut {
        once(&self.first_fold, || {
            let fold = self.folds.fold(&self.mask, [0..1, 0..1]);
            HeldOut { variance: fold.variances(Kind::Spline), at: fold.at, predicted: Vec::new() }
        })
    }
}

/// What the candidate would predict at the samples of `near`, whose `predicted` are errors of splines; and the variance of the logarithm of its squared
/// errors.
fn carried((held, mut near): (&HeldOut, HeldOut), samples: &Planes) -> Option<(HeldOut, f64)> {
    let sums = |k: usize| near.predicted.iter().map(|errors| f64::from(errors[k]).powi(2)).sum::<f64>();
    let splines: Vec<f64> = (0..near.at.len()).map(|k| sums(k) / samples.len() as f64).collect();
    let of_splines = |pixel: &u32| near.at.binary_search(pixel).ok().map(|k| splines[k]);
    let on_tiles: Vec<f64> = held.at.iter().map(of_splines).collect::<Option<_>>()?;
    let own = held.squared_errors(samples);
    let ratios = Ratios::new(&own, &on_tiles);

    let width = samples.size().width;
    let mut cells: BTreeMap<(usize, usize), f64> = BTreeMap::new();
    for ((&pixel, own), splines) in held.at.iter().zip(&own).zip(&on_tiles) {
        let cell = (pixel as usize / width / CELL, pixel as usize % width / CELL);
        *cells.entry(cell).or_default() += own - ratios.of(*splines) * splines;
    }
    let apart: f64 = cells.values().map(|apart| apart * apart).sum();
    let variance = apart / own.iter().sum::<f64>().powi(2);
    for (plane, errors) in samples.as_slice().iter().zip(&mut near.predicted) {
        for ((error, squared), &pixel) in errors.iter_mut().zip(&splines).zip(&near.at) {
            *error = plane.pixels()[pixel as usize] - ratios.of(*squared).sqrt() as f32 * *error;
        }
    }
    variance.is_finite().then_some((near, variance))
}

/// `r^2` by how large `l^2` is.
struct Ratios {
    /// The largest `l^2` of all classes but the last.
    ends: Vec<f64>,
    of: Vec<f64>,
}

impl Ratios {
    /// From `e^2` and `l^2` at the same samples.
    fn new(own: &[f64], splines: &[f64]) -> Self {
        let mut pairs: Vec<(f64, f64)> = splines.iter().copied().zip(own.iter().copied()).collect();
        pairs.sort_unstable_by(|a, b| a.0.total_cmp(&b.0).then(a.1.total_cmp(&b.1)));
        let classes: Vec<_> = pairs.chunks(pairs.len().div_ceil(CLASSES).max(1)).collect();
        let ratio = |class: &&[(f64, f64)]| {
            let [l, e] = class.iter().fold([0.0; 2], |[l, e], pair| [l + pair.0, e + pair.1]);
            if l > 0.0 { e / l } else { 1.0 }
        };
        let ends = classes.iter().take(classes.len().saturating_sub(1)).map(|class| class[class.len() - 1].0);
        Self { ends: ends.collect(), of: classes.iter().map(ratio).collect() }
    }

    fn of(&self, squared: f64) -> f64 {
        self.of.get(self.ends.partition_point(|end| *end < squared)).copied().unwrap_or(1.0)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{Plane, Size};

    /// Errors that are a multiple of those of splines at some samples are taken for the same multiple at all.
    #[test]
    fn the_ratio_of_some_samples_is_that_of_all() {
        let size = Size::new(300, 400);
        let samples = Planes::of(size, vec![Plane::filled(size, 0.5), Plane::filled(size, -2.0)]);
        let at: Vec<u32> = (0..size.pixels() as u32).step_by(7).collect();
        let errors = |k: f32| at.iter().map(|&pixel| k * (pixel as f32 / 900.0).sin()).collect::<Vec<f32>>();
        let near =
            HeldOut { at: at.clone(), predicted: vec![errors(0.1), errors(-0.3)], variance: Vec::new() };
        let held = |ratio: &dyn Fn(u32) -> f32| {
            let own: Vec<usize> = (0..at.len()).filter(|k| at[*k] % 400 < 120).collect();
            let predicted = |channel: usize, y: f32| {
                own.iter().map(|&k| y - ratio(at[k]) * near.predicted[channel][k]).collect()
            };
            let predicted = vec![predicted(0, 0.5), predicted(1, -2.0)];
            HeldOut { at: own.iter().map(|&k| at[k]).collect(), predicted, variance: Vec::new() }
        };
        let (found, variance) = carried((&held(&|_| 0.4), near.clone()), &samples).unwrap();
        assert!(variance < 1e-6, "{variance}");
        for (channel, y) in [0.5, -2.0].into_iter().enumerate() {
            for (value, error) in found.predicted[channel].iter().zip(&near.predicted[channel]) {
                assert!((value - (y - 0.4 * error)).abs() < 1e-5);
            }
        }
        // Where it differs from cell to cell, that is told.
        let uneven = held(&|pixel| if pixel / 400 < 128 { 0.2 } else { 0.6 });
        assert!(carried((&uneven, near.clone()), &samples).unwrap().1 > 0.05);
        // Where nothing errs there is none.
        assert!(carried((&held(&|_| 0.0), near), &samples).is_none());
    }
}
