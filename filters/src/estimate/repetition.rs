//! Rounds of choosing pixels repeated on the frame's own fill: what the rounds passed over, no held-out sample of theirs shows, but a repetition
//! passes over something, too.
//!
//! Where samples were put where errors are, as many pixels are chosen once more, in rounds that start from another mask, with the filled frame for a
//! renderer, and filled by the same method: of a large frame in sixteen windows, in each as many as the frame has there. What is then missed is known. The filled frame lacks what the frame's own rounds never met, so this is
//! rather too little than too much; it is the least that is told of the frame ([`super::Model`]).
//!
//! Source: B. Efron, "Bootstrap methods: another look at the jackknife", The Annals of Statistics 7, 1979.

use std::sync::Arc;

use lacuna_core::parallel::prelude::*;

use super::excerpt::Excerpt;
use super::held_out::{Folds, HeldOut, ReconstructPart, pick, pixels_where};
use super::model::LOOKED_AT;
use super::voronoi::Voronoi;
use crate::sampling::{Field, adaptive, hash};
use crate::{Error, Mask, Planes, Run};

/// Makes another mask than the frame's own.
const OTHER: u64 = 0x9e4d;

/// What a repetition misses.
#[derive(Clone, Debug, PartialEq)]
pub struct Repetition {
    parts: Vec<Part>,
}

/// Some pixels of the frame, or of a window of it, that were not chosen: what they are, and what was filled there.
#[derive(Clone, Debug, PartialEq)]
struct Part {
    /// What they count for.
    share: f64,
    truth: HeldOut,
    filled: HeldOut,
}

impl Repetition {
    /// Chooses and fills once more; nothing where errors at samples, `near`, do not say that the frame's own were chosen.
    ///
    /// # Errors
    /// Those of the method.
    pub fn new(
        (samples, mask): (&Planes, &Mask),
        filled: &Planes,
        (folds, near): (Folds, &HeldOut),
        reconstruct: &mut ReconstructPart<'_>,
        run: &Run<'_>,
    ) -> Result<Option<Self>, Error> {
        let voronoi = Voronoi::new(mask);
        if !voronoi.is_uneven() || !voronoi.are_where_errors_are(&near.at, &near.squared_errors(samples)) {
            return Ok(None);
        }
        let windows = Excerpt::windows(mask);
        let seed = folds.seed ^ OTHER;
        // The pixels of all, or of each window.
        let again = if windows.is_empty() {
            vec![choose(filled.clone(), mask, seed, run)?]
        } else {
            let one = |(window, _): &(Excerpt, f64)| choose(window.planes(filled), &window.mask, seed, run);
            windows.par_iter().with_max_len(1).map(one).into_iter().collect::<Result<_, Error>>()?
        };
        let missing: usize = again.iter().map(|(_, again)| again.size().pixels() - again.count()).sum();
        if run.interrupted().is_some() || missing == 0 {
            return Ok(None);
        }
        let every = (missing / LOOKED_AT).max(1) as u64;
        let mut parts = Vec::new();
        for (k, (image, again)) in again.iter().enumerate().filter(|(_, (_, again))| !again.is_full()) {
            let (window, share) =
                windows.get(k).map_or((None, 1.0), |(window, share)| (Some(window), *share));
            let at = pixels_where(again, |measured, pixel| {
                !measured
                    && window.is_none_or(|window| window.is_inner(pixel as u32))
                    && hash(seed, pixel as u64).is_multiple_of(every)
            });
            let filled = reconstruct(window, image, again)?;
            let of = |planes: &Planes| HeldOut {
                at: at.clone(),
                predicted: pick(planes, &at),
                variance: Vec::new(),
            };
            parts.push(Part { share, truth: of(image), filled: of(&filled) });
        }
        Ok(Some(Self { parts }))
    }

    /// The mean squared error over pixels and channels.
    pub fn squared(&self) -> f64 {
        self.parts.iter().map(|part| part.share * part.squared()).sum()
    }

    pub(super) fn map(&mut self, f: &impl Fn(usize, f32) -> f32) {
        for part in &mut self.parts {
            part.truth.map(f);
            part.filled.map(f);
        }
    }
}

impl Part {
    fn squared(&self) -> f64 {
        let planes = self.truth.predicted.iter().zip(&self.filled.predicted);
        let errors = planes
            .flat_map(|(truth, filled)| truth.iter().zip(filled))
            .map(|(a, b)| f64::from(a - b).powi(2));
        let (sum, count) =
            errors.filter(|e| e.is_finite()).fold((0.0, 0_usize), |(sum, count), e| (sum + e, count + 1));
        sum / count.max(1) as f64
    }
}

/// As many pixels of an image as a mask has, chosen in rounds with the image for a renderer.
fn choose(image: Planes, mask: &Mask, seed: u64, run: &Run<'_>) -> Result<(Arc<Planes>, Arc<Mask>), Error> {
    let (size, image) = (mask.size(), Arc::new(image));
    let density = mask.count() as f64 / size.pixels() as f64;
    let settings = adaptive::Settings { density, rounds: None, first: None, target: None, seed, frame: None };
    let measure = |_: &Mask| Ok::<_, Error>(Arc::clone(&image));
    let chosen = adaptive::choose(&settings, Field { x: 0, y: 0, size }, run, measure)?;
    Ok((image, Arc::new(chosen.mask)))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::estimate::Kind;
    use crate::variational::ss;
    use crate::{Filter, Plane, Problem, Size};

    const SIZE: Size = Size::new(120, 160);

    /// Thin lines on a ramp, of which the samples of a first round meet most.
    fn lines() -> Planes {
        let value = |row: usize, column: usize| {
            let is_there = hash(3, (row / 24 * 1000 + column / 32) as u64).is_multiple_of(2);
            let is_line = is_there && row % 24 < 2 && column % 32 < 31;
            row as f32 / 120.0 + if is_line { 1.0 } else { 0.0 }
        };
        Planes::new(SIZE, vec![Plane::from_fn(SIZE, value)]).unwrap()
    }

    fn fill(samples: &Planes, mask: &Arc<Mask>) -> Result<Planes, Error> {
        let mut out = Planes::zeros(samples.size(), samples.len());
        let plan = ss::Settings::default().plan(&Problem::fill(Arc::clone(mask)), &Run::default())?;
        plan.reconstruct(samples, &mut out, &Run::default())?;
        Ok(out)
    }

    /// What is told of a mask by a repetition, and what is true: mean squared errors of missing pixels.
    fn told(truth: &Planes, mask: Mask) -> (Option<f64>, f64) {
        let mask = Arc::new(mask);
        let filled = fill(truth, &mask).unwrap();
        let mut again = |_: Option<&Excerpt>, samples: &Planes, kept: &Arc<Mask>| fill(samples, kept);
        let (folds, run) = (Folds { seed: 1 }, Run::default());
        let evidence = super::super::Evidence::of_folds(
            (truth, &mask),
            Some(&filled),
            (folds, Kind::Spline),
            &mut again,
            &run,
        )
        .unwrap();
        let errors = truth.as_slice()[0].pixels().iter().zip(filled.as_slice()[0].pixels());
        let squares: f64 = errors.map(|(a, b)| f64::from(a - b).powi(2)).sum();
        let missing = SIZE.pixels() - mask.count();
        (evidence.repetition.map(|repetition| repetition.squared()), squares / missing as f64)
    }

    #[test]
    fn what_rounds_pass_over_is_told() {
        let truth = Arc::new(lines());
        let (mut all_told, mut all) = (0.0, 0.0);
        for seed in 0..24 {
            let settings = adaptive::Settings {
                density: 0.15,
                rounds: None,
                first: None,
                target: None,
                seed,
                frame: None,
            };
            let field = Field { x: 0, y: 0, size: SIZE };
            let measure = |_: &Mask| Ok::<_, Error>(Arc::clone(&truth));
            let chosen = adaptive::choose(&settings, field, &Run::default(), measure).unwrap();
            let (told, is) = told(&truth, chosen.mask);
            all_told += told.unwrap();
            all += is;
        }
        // Within 4 dB; what of one frame so small is passed over is chance.
        let off = 10.0 * (all_told / all).log10();
        assert!(off.abs() < 4.0, "{off} dB");
    }

    #[test]
    fn masks_that_nobody_chose_are_not_repeated() {
        let truth = lines();
        let even = crate::sampling::shuffle::mask(0, 0, SIZE, 0.1, 0).unwrap();
        assert_eq!(told(&truth, even).0, None);
    }
}
