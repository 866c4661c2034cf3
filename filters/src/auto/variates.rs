//! Control variates: guides are filled from the pixels that the colour is filled from, and along with the same frames. What that misses of them is known
//! everywhere, and goes along with what the fill misses of the colour.
//!
//! ```text
//! x(p) = y(p) + sum over k of b_k(p) (g_k - F g_k)(p)        F: splines, pulled towards samples of other frames;  g: guides
//! ```
//!
//! with the slopes `b` by held-out samples ([`Slopes`]). It takes away errors that guides share: of motion, of edges, and noise of the very same
//! rays. Where it gains less than `WORTH` at held-out samples that have not taught it, or no more than chance would, nothing is done.
//!
//! Source: J. Hammersley, D. Handscomb, "Monte Carlo Methods", 1964 (control variates).

use std::sync::Arc;

use lacuna_core::hash;
use lacuna_core::parallel::prelude::*;

use super::Blend;
use super::along::{HALVES, PULLS};
use crate::estimate::{HELD_OUT, HeldOut};
use crate::temporal::{self, Carried, Pulling};
use crate::variational::guided::Guides;
use crate::variational::ss;
use crate::weights::Slopes;
use crate::{Error, Filter, Mask, Planes, Problem, Run};

/// Planes of guides at most; each is filled like a colour.
const MOST: usize = 16;
/// The part of the squared error that it must take away.
const WORTH: f64 = 0.01;
/// And how many standard errors that must be: less is chance.
const CLEAR: f64 = 2.0;
/// Pixels that one task takes.
const PIECE: usize = 1 << 14;

/// Guides that are known in all frames.
pub struct Variates<'a> {
    own: &'a Blend,
    guides: Planes,
    carried: Vec<Carried>,
    judged: Vec<Carried>,
}

/// What was learned of them.
pub struct Correction {
    slopes: Slopes,
    guides: Planes,
    carried: Vec<Carried>,
    /// The predictions at held-out samples, each corrected by what others have taught.
    pub held: HeldOut,
}

impl<'a> Variates<'a> {
    /// Nothing where a frame lacks the guides, or all stand still. `judged` are the samples of other frames that held-out ones may judge.
    pub fn new(
        own: &'a Blend,
        guides: Option<&Guides>,
        (carried, judged): (&[Carried], &[Carried]),
    ) -> Option<Self> {
        let guides = guides?;
        let count = guides.planes().len();
        let known = [carried, judged].iter().all(|all| Carried::are_guided(all, count));
        if !known || count > MOST {
            return None;
        }
        let guides = Planes::new(guides.size(), guides.planes().to_vec()).ok()?;
        let of = |carried: &[Carried]| {
            carried.iter().filter(|one| !one.is_empty()).map(Carried::of_guides).collect()
        };
        Some(Self { own, guides, carried: of(carried), judged: of(judged) })
    }

    /// What they tell of a blend, by what it predicts at held-out samples, in the order of rows; nothing if that is not worth it.
    pub fn learn(
        self,
        samples: &Planes,
        blend: &HeldOut,
        run: &Run<'_>,
    ) -> Result<Option<Correction>, Error> {
        let mut found = HeldOut::default();
        for parts in temporal::judging(self.own.folds, self.own.mask.count()) {
            let fold = self.own.folds.fold(&self.own.mask, [parts.clone(), parts]);
            let mut fill =
                |guides: &Planes, kept: &Arc<Mask>| filled((guides, kept), &self.judged, true, run);
            found.extend(HeldOut::new(&self.guides, &fold, None, &mut fill)?);
        }
        let found = found.sorted(|pixel| blend.at.binary_search(&pixel).is_ok());
        if run.interrupted().is_some() || found.at != blend.at || found.at.is_empty() {
            return Ok(None);
        }
        let (known, wanted) = (found.errors(&self.guides), blend.errors(samples));
        let learn = |which: &dyn Fn(u32) -> bool| {
            let few: Vec<usize> = (0..blend.at.len()).filter(|&i| which(blend.at[i])).collect();
            let at: Vec<u32> = few.iter().map(|&i| blend.at[i]).collect();
            let of = |all: &[Vec<f32>]| -> Vec<Vec<f32>> {
                all.iter().map(|values| few.iter().map(|&i| values[i]).collect()).collect()
            };
            Slopes::new(&self.own.mask, &at, &of(&known), &of(&wanted))
        };
        let is_odd = |pixel: u32| hash(self.own.folds.seed ^ HALVES, u64::from(pixel)) % 2 == 1;
        let halves = [learn(&|pixel| !is_odd(pixel)), learn(&|pixel| is_odd(pixel))];
        let mut held = blend.clone();
        for (channel, predicted) in held.predicted.iter_mut().enumerate() {
            for (i, (value, &pixel)) in predicted.iter_mut().zip(&blend.at).enumerate() {
                let of_others = &halves[usize::from(!is_odd(pixel))];
                *value += of_others.told(channel, pixel as usize, known.iter().map(|known| known[i]));
            }
        }
        if !is_worth(&blend.squared_errors(samples), &held.squared_errors(samples)) {
            return Ok(None);
        }
        let slopes = learn(&|_| true);
        Ok(Some(Correction { slopes, guides: self.guides, carried: self.carried, held }))
    }
}

impl Correction {
    /// Corrects the missing pixels of a blend, whose mask this is.
    pub fn correct(&self, mask: &Arc<Mask>, out: &mut Planes, run: &Run<'_>) -> Result<(), Error> {
        let filled = filled((&self.guides, mask), &self.carried, false, run)?;
        if run.interrupted().is_some() {
            return Ok(());
        }
        let known: Vec<_> = self.guides.as_slice().iter().zip(filled.as_slice()).collect();
        for (channel, out) in out.as_mut_slice().iter_mut().enumerate() {
            out.pixels_mut().par_chunks_mut(PIECE).enumerate().for_each(|(piece, out)| {
                for (pixel, out) in (piece * PIECE..).zip(out) {
                    if !mask.as_slice()[pixel] {
                        let errors = known
                            .iter()
                            .map(|(guide, filled)| guide.pixels()[pixel] - filled.pixels()[pixel]);
                        *out += self.slopes.told(channel, pixel, errors);
                    }
                }
            });
        }
        Ok(())
    }
}

/// Whether the second squared errors are less than the first ones, by more than chance.
fn is_worth(before: &[f64], after: &[f64]) -> bool {
    let count = before.len() as f64;
    let gains = || before.iter().zip(after).map(|(before, after)| before - after);
    let mean = gains().sum::<f64>() / count;
    let variance = gains().map(|gain| (gain - mean).powi(2)).sum::<f64>() / count;
    mean >= WORTH * before.iter().sum::<f64>() / count && mean >= CLEAR * (variance / count).sqrt()
}

/// Guides from their values at the pixels of a mask and those of other frames.
fn filled(
    (guides, mask): (&Planes, &Arc<Mask>),
    carried: &[Carried],
    roughly: bool,
    run: &Run<'_>,
) -> Result<Planes, Error> {
    let plan = ss::Settings::default().plan(&Problem::fill(Arc::clone(mask)), run)?;
    let mut plain = Planes::zeros(guides.size(), guides.len());
    if roughly {
        plan.reconstruct_roughly(guides, HELD_OUT, &mut plain, run)?;
    } else {
        plan.reconstruct(guides, &mut plain, run)?;
    }
    let pulling = Pulling { carried, fills: &[], pull: PULLS[1], weights: None, roughly, first: None };
    Ok(temporal::pull(mask, &pulling, &plain, run).0)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::sampling::{Field, Pattern, Temporal, mask as generate};
    use crate::{Options, Plane, Size, fill};

    const SIZE: Size = Size::new(100, 120);

    fn random(seed: u64, at: usize) -> f32 {
        (hash(seed, at as u64) as f64 / u64::MAX as f64 - 0.5) as f32
    }

    /// What each pixel of a frame shows, each by a ray of its own through it: of a scene that moves by so much a frame, a value of it.
    fn seen(frame: usize, value: &dyn Fn(f32, f32) -> f32) -> Plane {
        Plane::from_fn(SIZE, |y, x| {
            let at = 2 * (y * SIZE.width + x);
            let ray = [0, 1].map(|axis| random(frame as u64, at + axis));
            value(y as f32 + ray[0] - 0.7 * frame as f32, x as f32 + ray[1] + 1.3 * frame as f32)
        })
    }

    fn guide(y: f32, x: f32) -> f32 {
        (0.3 * y).sin() + (0.2 * x + 0.1 * y).cos()
    }

    /// A light that no guide knows, on what the guide shows.
    fn light(y: f32, x: f32) -> f32 {
        (0.5 + 0.1 * (0.05 * y).cos() * (0.06 * x).sin()) * (0.5 + 0.2 * guide(y, x))
    }

    /// The squared error of the middle one of five frames, whose others have these guides, if any.
    fn error(others: Option<&dyn Fn(usize) -> Plane>) -> f64 {
        let colour = |frame: usize| Planes::new(SIZE, vec![seen(frame, &light)]).unwrap();
        let field = Field { x: 0, y: 0, size: SIZE };
        let mask = |frame: usize| {
            generate(Pattern::Shuffle, field, 0.2, 3, Temporal::Complementary, frame as i64).unwrap()
        };
        let mut guides = Guides::new(SIZE);
        guides.add("guide", vec![seen(2, &guide)]).unwrap();
        let one = |frame: usize| {
            let away = frame as f32 - 2.0;
            let place =
                |at: usize| [(at / SIZE.width) as f32 - 0.7 * away, (at % SIZE.width) as f32 + 1.3 * away];
            let carried = Carried::new(SIZE, (&colour(frame), &mask(frame)), away as i32, place).unwrap();
            match others {
                Some(of) => carried.guided(&guides.alike(|_| Some(vec![of(frame)])).unwrap()).unwrap(),
                None => carried,
            }
        };
        let carried: Vec<_> = [0, 1, 3, 4].map(one).into();
        let options = Options { carried: &carried, guides: Some(&guides), ..Options::default() };
        let filled = fill(&colour(2), Arc::new(mask(2)), &options).unwrap().planes;
        let truth = colour(2);
        let pairs = filled.as_slice()[0].pixels().iter().zip(truth.as_slice()[0].pixels());
        pairs.map(|(a, b)| f64::from(a - b).powi(2)).sum()
    }

    #[test]
    fn what_guides_show_of_the_rays_of_all_frames_is_taken_and_wrong_guides_cost_nothing() {
        let (with, without) = (error(Some(&|frame| seen(frame, &guide))), error(None));
        assert!(with < 0.7 * without, "{with} {without}");
        let wrong = |frame: usize| Plane::from_fn(SIZE, |y, x| 2.0 * random(77 + frame as u64, y * 500 + x));
        let wrong = error(Some(&wrong));
        assert!(wrong < 1.023 * without, "{wrong} {without}");
    }
}
