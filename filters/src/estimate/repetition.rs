//! Rounds of choosing pixels repeated on the frame's own fill: what the rounds passed over, no held-out sample of theirs shows, but a repetition
//! passes over something, too.
//!
//! Where samples were put where errors are, as many pixels are chosen once more, in rounds that start from another mask, with the filled frame for a
//! renderer, and filled by the same method: of a large frame in sixteen windows, in each as many as the frame has there. As rounds look at colours only, what colours choose
//! is taken for the other groups of their mask as well ([`Repeated`]). What is then missed is known. The filled frame lacks what the frame's own rounds never met, so this is
//! rather too little than too much; it is the least that is told of the frame ([`super::Model`]).
//!
//! Source: B. Efron, "Bootstrap methods: another look at the jackknife", The Annals of Statistics 7, 1979.

use std::sync::{Arc, Mutex, PoisonError};

use lacuna_core::parallel::prelude::*;

use super::held_out::{Folds, HeldOut, ReconstructPart, pick, pixels_where};
use super::model::LOOKED_AT;
use super::voronoi::Voronoi;
use crate::excerpt::Excerpt;
use crate::sampling::{Field, adaptive};
use crate::{Error, Mask, Planes, Run};
use lacuna_core::hash;

/// Rounds of a repetition. What eight pass over is within 1.3 dB of it, for twice the time; two pass over 1.3 to 11 dB more.
const ROUNDS: usize = 4;
/// Makes another mask than the frame's own.
const OTHER: u64 = 0x9e4d;

/// What rounds chose for the colours of a frame when they were repeated, for its other groups with the same mask.
#[derive(Debug, Default)]
pub struct Repeated(Mutex<Vec<(Arc<Mask>, Masks)>>);

/// Of the frame, or of each of its windows.
type Masks = Vec<Arc<Mask>>;

/// A group's view of it.
#[derive(Clone, Copy, Debug)]
pub struct Rounds<'a> {
    /// Where it is kept.
    pub repeated: &'a Repeated,
    /// Whether these are colours, which rounds look at.
    pub are_colours: bool,
}

impl Rounds<'_> {
    /// What was chosen by colours of this mask, for others.
    fn known(self, mask: &Mask) -> Option<Masks> {
        let all = self.repeated.0.lock().unwrap_or_else(PoisonError::into_inner);
        let found = all.iter().find(|(other, _)| !self.are_colours && **other == *mask);
        found.map(|(_, masks)| masks.clone())
    }

    fn keep(self, mask: &Mask, masks: &Masks) {
        let mut all = self.repeated.0.lock().unwrap_or_else(PoisonError::into_inner);
        if self.are_colours && !all.iter().any(|(other, _)| **other == *mask) {
            all.push((Arc::new(mask.clone()), masks.clone()));
        }
    }
}

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
    /// Whether all of the frame is chosen again, if errors say that its pixels were chosen.
    pub fn is_whole(mask: &Mask) -> bool {
        Excerpt::windows(mask).is_empty() && Voronoi::new(mask).is_uneven()
    }

    /// Chooses and fills once more; nothing where errors at samples, `near`, do not say that the frame's own were chosen.
    ///
    /// # Errors
    /// Those of the method.
    pub fn new(
        (samples, mask): (&Planes, &Mask),
        filled: &Planes,
        (folds, near): (Folds, &HeldOut),
        rounds: Rounds<'_>,
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
        let images: Vec<(Arc<Planes>, &Mask)> = if windows.is_empty() {
            vec![(Arc::new(filled.clone()), mask)]
        } else {
            windows.iter().map(|(window, _)| (Arc::new(window.planes(filled)), &*window.mask)).collect()
        };
        let again = if let Some(known) = rounds.known(mask) {
            known
        } else {
            let one = |(image, mask): &(Arc<Planes>, &Mask)| choose(image, mask, seed, run);
            images.par_iter().with_max_len(1).map(one).into_iter().collect::<Result<_, Error>>()?
        };
        let missing: usize = again.iter().map(|again| again.size().pixels() - again.count()).sum();
        if run.interrupted().is_some() || missing == 0 {
            return Ok(None);
        }
        rounds.keep(mask, &again);
        let every = (missing / LOOKED_AT).max(1) as u64;
        let mut parts = Vec::new();
        let chosen = images.iter().zip(&again).enumerate().filter(|(_, (_, again))| !again.is_full());
        for (k, ((image, _), again)) in chosen {
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
fn choose(image: &Arc<Planes>, mask: &Mask, seed: u64, run: &Run<'_>) -> Result<Arc<Mask>, Error> {
    let size = mask.size();
    let density = mask.count() as f64 / size.pixels() as f64;
    let settings = adaptive::Settings {
        density,
        rounds: Some(ROUNDS.min(mask.count().max(1))),
        first: None,
        target: None,
        seed,
        frame: None,
    };
    let measure = |_: &Mask| Ok::<_, Error>(Arc::clone(image));
    let chosen = adaptive::in_rounds(&settings, (Field { x: 0, y: 0, size }, None), false, run, measure)?;
    Ok(Arc::new(chosen.mask))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::descriptor::Kind;
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
            Rounds { repeated: &Repeated::default(), are_colours: true },
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
            let chosen = adaptive::choose(&settings, (field, None), &Run::default(), measure).unwrap();
            let (told, is) = told(&truth, chosen.mask);
            all_told += told.unwrap();
            all += is;
        }
        // Within 4 dB; what of one frame so small is passed over is chance.
        let off = 10.0 * (all_told / all).log10();
        assert!(off.abs() < 4.0, "{off} dB");
    }

    #[test]
    fn other_groups_of_a_mask_take_over_what_its_colours_chose() {
        let repeated = Repeated::default();
        let [colours, others] = [true, false].map(|are_colours| Rounds { repeated: &repeated, are_colours });
        let [own, another, chosen] =
            [3, 4, 5].map(|every| Mask::from_fn(SIZE, |row, column| (row + column) % every == 0));
        let chosen = vec![Arc::new(chosen)];
        others.keep(&own, &chosen);
        assert_eq!(others.known(&own), None);
        colours.keep(&own, &chosen);
        assert_eq!((colours.known(&own), others.known(&another)), (None, None));
        assert_eq!(others.known(&own), Some(chosen));
    }

    #[test]
    fn masks_that_nobody_chose_are_not_repeated() {
        let truth = lines();
        let even = crate::sampling::shuffle::mask(0, 0, SIZE, 0.1, 0).unwrap();
        assert_eq!(told(&truth, even).0, None);
    }
}
