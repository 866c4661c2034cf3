//! Noisy samples: the image is filled and smoothed, measured pixels as well, as far as the noise asks for it.
//!
//! Given samples `y` at the measured pixels of an `H x W` image, the image is
//!
//! ```text
//! x(p) = sum over k of w_k(p) F_k(y)(p),      w_k >= 0,  sum of w_k = 1
//! ```
//!
//! where `F_k` are linear: interpolating splines, and smoothing ones of several `lambda`, or with guides first-order regressions on guides
//! and place over the nearest 36 and 324 samples, and that of [`crate::variational::guided`], whose weights of guides the samples choose. In each
//! neighbourhood the weights `w` make the expected squared error least (`weights`), whose products are, for two candidates:
//!
//! ```text
//! where noise n like that of the samples is known:    (F_k y - y)(F_l y - y) + n F_k n + n F_l n - n^2
//! else, at held-out samples:                          (F_k y - y)(F_l y - y)
//! ```
//!
//! Measured pixels are weighed by the first, missing ones, which candidates that pass through the samples leave wrong as well, by the second. For missing
//! pixels there are more, through the smoothed samples: edge-enhancing splines, the same corrected by a network, total variation, and with guides guided
//! filling, whose weights of guides these choose again. Each surface, as labels tell it, has weights of its own (`weights/surfaces`). Where light is bright, errors count
//! relative to it (`relative`).
//!
//! The first is Stein's estimate: half the difference of two half buffers is noise of the same variance as that of their mean, and does not
//! correlate with it. Channels share their weights. Nothing is chosen by hand: an image without noise is left alone where nothing is
//! known ([`Set::smoothed`](crate::fill::Set::smoothed) says so).
//!
//! Fireflies: what of a sample lies beyond `LIMIT` times the level that nine tenths of the samples that are not black stay below takes no part. Where both halves
//! show it (or no halves are known) it is a light: its pixel takes no part at all, and is put back as it is (`lights`). Where one half shows it, it is a
//! firefly and is left out. Noise above that limit at few samples, as of halves that were not clamped as their mean was, counts as unknown.
//!
//! Boundary: that of the candidates. No settings. The same bits for any number of threads.
//!
//! Cost: up to nine fills, twice as many planes in most where noise is known, and as many without the samples of a fold, of large images in tiles
//! that are spread over them; where there are lights, two more by [`crate::auto`]. Memory: so many images.
//!
//! Fails: where noise correlates between pixels, as after a denoiser; details as small as the noise, which are smoothed away.
//!
//! Sources: C. Stein, "Estimation of the Mean of a Multivariate Normal Distribution", Annals of Statistics 9, 1981; S. Ramani, T. Blu,
//! M. Unser, "Monte-Carlo SURE", IEEE Transactions on Image Processing 17, 2008 (the term of the noise by a realisation of it); B. Bitterli
//! et al., "Nonlinearly Weighted First-order Regression for Denoising Monte Carlo Renderings", Computer Graphics Forum 35(4), 2016
//! (regressions on features, widths chosen by half buffers).

mod blend;
mod candidates;
mod lights;
mod like;
mod part;
mod relative;
mod split;
#[cfg(test)]
mod tests;

use std::sync::Arc;

use lacuna_core::parallel::prelude::*;

use crate::decided::Decided;
use crate::estimate::Folds;
use crate::kernel::blur::blur;
use crate::variational::guided::Guides;
use crate::weights::{Neighbourhood, Surfaces};
use crate::{Error, Mask, Outcome, Plane, Planes, Run};
use blend::Blend;
use candidates::{Candidate, Task};
pub use like::Untold;
use relative::importance;
pub(crate) use split::Split;

/// What is known of the noise of the samples.
#[derive(Clone, Debug, Default, PartialEq)]
pub enum Noise {
    /// They have none: measured pixels keep their bits.
    #[default]
    None,
    /// Nothing; held-out samples show it.
    Unknown,
    /// By plane, noise like that of its samples, NaN where it is not known: [`Noise::of_halves`], or
    /// [`Noise::of_variance`].
    Like(Vec<Plane>),
}

/// What smoothing must take away of the squared error of held-out samples, where nothing else is known of noise: edges alone gain less.
const NOISY: f64 = 0.25;
/// The same with guides: what of the squared error the guided regression alone must take away from that with splines through what it leaves. Pure noise
/// gives a third. Of eleven noisy frames eight gave 0.145 to 0.29, the least noisy three 0.02 to 0.07 (they are left alone); two without noise 0.08 and less.
const FOLLOWS: f64 = 0.12;
/// Fewer measured pixels choose nothing.
const FEWEST: usize = 64;
/// Wider than where samples are held out: Stein's estimate scatters with the noise itself.
const NEIGHBOURHOOD: Neighbourhood = Neighbourhood { spread: 10.0, frame: 0.1 };
/// Levels of light that count as it is, over that which nine tenths of the samples that are not black stay below.
const LIMIT: f32 = 4.0;

/// Pixels that one task takes.
const PIECE: usize = 1 << 14;
/// Width of the neighbourhood whose variance a sample has, in spacings of the samples.
const AROUND: f64 = 3.0;
/// The least variance, over the mean.
const QUIET: f64 = 1e-3;
/// As how many samples of the mean variance, over those that are around, the mean counts everywhere: it decides where no noise is known.
const PRIOR: f64 = 1e-3;

/// What is given beside the samples.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Known<'a> {
    /// Complete planes.
    pub guides: Option<&'a Guides>,
    /// Noise like that of the samples.
    pub noise: Option<&'a Planes>,
    /// How much each sample counts.
    pub weights: Option<&'a Arc<Plane>>,
    /// Whether samples may be lights, or fireflies.
    pub light: bool,
}

/// Fills and smooths all of `out`; nothing if the samples show no noise.
pub(crate) fn reconstruct(
    mask: &Arc<Mask>,
    samples: &Planes,
    known: Known<'_>,
    out: &mut Planes,
    run: &Run<'_>,
) -> Result<Option<(Outcome, Decided)>, Error> {
    crate::check::group(mask, samples, out)?;
    if mask.count() < FEWEST || samples.is_empty() {
        return Ok(None);
    }
    let split = Split::new(mask, samples, known.noise, known.light);
    // Lights take no part.
    let (whole, mask) = (mask, &lights::without(mask, split.lights.as_ref()));
    if mask.count() < FEWEST {
        return Ok(None);
    }
    let all = Candidate::all(known.guides.is_some_and(|guides| !guides.is_empty()));
    let precision = match (&split.noise, known.weights) {
        (Some(noise), None) => precision(mask, noise).map(Arc::new),
        (_, weights) => weights.cloned(),
    };
    let counted = known.weights.is_some();
    let task = Task { guides: known.guides, weights: precision.as_ref(), counted, tuned: None, run };
    let counts = importance((mask, known.weights.map(Arc::as_ref)), &split.samples, split.level);
    let surfaces = Surfaces::new(mask.size(), known.guides.and_then(Guides::labels));
    let Some(blend) = Blend::new(&task, &all, (mask, &counts), &split, &surfaces)? else { return Ok(None) };
    if run.interrupted().is_some() {
        return Ok(None);
    }
    let mut decided =
        Decided { shares: blend.fill(&task, &all, (mask, &split.samples), out)?, ..Decided::default() };
    let mut outcome = blend.outcome;
    if let Some(guides) = known.guides.filter(|_| all.iter().any(Candidate::is_guided)) {
        decided.guided.guides = guides.all_names().cloned().collect();
    }
    if let Some(samples) = split.with_lights() {
        outcome = outcome.worst(lights::put_back((whole, mask), &samples, out, run)?);
    }
    Ok(Some((outcome, decided)))
}

/// The mean variance of the noise over that around each pixel; nothing where there is no noise. Where it is not known, it is that around, else the mean.
fn precision(mask: &Mask, noise: &Planes) -> Option<Plane> {
    let size = mask.size();
    let measured = mask.count().max(1) as f64;
    let variance = |pixel: usize| {
        let squares = noise.as_slice().iter().map(|plane| f64::from(plane.pixels()[pixel]).powi(2));
        Some(squares.sum::<f64>()).filter(|sum| sum.is_finite())
    };
    let known = mask.as_slice().par_chunks(PIECE).enumerate().map(|(piece, flags)| {
        let measured = flags.iter().enumerate().filter(|(_, flag)| **flag);
        let known = measured.filter_map(|(at, _)| variance(piece * PIECE + at));
        known.fold((0.0, 0_usize), |(sum, count), variance| (sum + variance, count + 1))
    });
    let (sum, count) = known.iter().fold((0.0, 0), |all, own| (all.0 + own.0, all.1 + own.1));
    let mean = sum / count.max(1) as f64;
    if mean <= 0.0 {
        return None;
    }
    // Over the mean, so that no unit is too large or small for f32.
    let (mut relative, mut counted) = (vec![0.0; size.pixels()], vec![0.0; size.pixels()]);
    let pieces = relative.par_chunks_mut(PIECE).zip(counted.par_chunks_mut(PIECE));
    pieces.zip(mask.as_slice().par_chunks(PIECE)).enumerate().for_each(
        |(piece, ((relative, counted), flags))| {
            for (at, _) in flags.iter().enumerate().filter(|(_, flag)| **flag) {
                if let Some(variance) = variance(piece * PIECE + at) {
                    (relative[at], counted[at]) = ((variance / mean) as f32, 1.0);
                }
            }
        },
    );
    let density = measured / size.pixels() as f64;
    let around = AROUND * density.recip().sqrt();
    let (sums, counts) = (blur(size, &relative, around), blur(size, &counted, around));
    let prior = PRIOR * density;
    let weight = |(sum, count): (&f32, &f32)| {
        let here = (f64::from(*sum) + prior) / (f64::from(*count) + prior);
        here.max(QUIET).recip() as f32
    };
    let pieces = sums.par_chunks(PIECE).zip(counts.par_chunks(PIECE));
    let weights = pieces.map(|(sums, counts)| sums.iter().zip(counts).map(weight).collect::<Vec<f32>>());
    Some(Plane::of(size, weights.concat()))
}

/// Folds by which samples are held out.
const FOLDS: Folds = Folds { seed: 0 };
