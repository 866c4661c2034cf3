//! Which candidates are worth computing for all of a large image: they are tried on tiles that are spread over it.

use super::{Blend, Candidate, candidates, once};
use crate::descriptor::Kind;
use crate::domain::Map;
use crate::estimate::{Fold, Folds, HeldOut, Voronoi};
use crate::excerpt::Excerpt;
use crate::variational::ss;
use crate::weights::{Truth, Weights};
use crate::{Error, Mask, Planes, Run, network};

/// Held-out samples at which candidates are compared, unless the tiles have fewer. With half as many, chance took the wrong one at 5 % of a frame.
const ENOUGH: usize = 1000;

/// What must be taken away of the squared error of the first candidate to do without it: on tiles few samples may carry all of it.
const CLEAR: f64 = 0.25;

/// What tiles show.
pub struct Trial {
    /// The names of the candidates that are worth computing, and of those that these start from: they are computed anyway, and more samples decide
    /// better. One that is clearly better than a blend has no other beside it.
    pub names: Vec<&'static str>,
    /// What that one and plain splines predict at samples of the tiles, if these show it as all of the image would and samples lie evenly.
    pub alone: Option<[HeldOut; 2]>,
}

/// Tiles of a large mask, and what depends on them alone.
pub struct Stage {
    tiles: Excerpt,
    /// Whether tiles show of a candidate what all of the image would.
    is_apart: bool,
    voronoi: Voronoi,
    folds: Vec<Fold>,
    /// See [`super::less`].
    less: f64,
}

impl Stage {
    /// That of a mask; nothing if it is too small, or the tiles have too few samples.
    pub fn new(mask: &Mask, folds: Folds) -> Option<Self> {
        let apart = Excerpt::apart(mask);
        let is_apart = apart.is_some();
        let tiles = apart.or_else(|| Excerpt::small_tiles(mask))?;
        let (mut few, mut count) = (Vec::new(), 0);
        for parts in folds.near(tiles.mask.count()) {
            let fold = folds.fold_of_tiles(&tiles, [parts.clone(), parts]);
            count += fold.at.len();
            few.push(fold);
            if count >= ENOUGH {
                break;
            }
        }
        if count < super::FEWEST || few.iter().any(|fold| fold.kept.is_empty()) {
            return None;
        }
        let variances: Vec<f32> = few.iter().flat_map(|fold| fold.variances(Kind::Spline)).collect();
        let less = super::less_by(&variances, &tiles.mask, folds, super::LESS);
        let voronoi = Voronoi::new(&tiles.mask);
        Some(Self { tiles, is_apart, voronoi, folds: few, less })
    }

    /// Tries all candidates; `learn` if more is asked of them than which is best.
    pub fn try_out(
        &self,
        candidates: &[Candidate<'_>],
        (samples, map): (&Planes, Map),
        learn: bool,
        run: &Run<'_>,
    ) -> Result<Trial, Error> {
        let Self { tiles, voronoi, less, .. } = self;
        let planes = tiles.planes(samples);
        let mut held = vec![HeldOut::default(); candidates.len()];
        for fold in &self.folds {
            let mut start = None;
            for (candidate, held) in candidates.iter().zip(&mut held).rev() {
                if run.interrupted().is_some() {
                    return Ok(Trial { names: vec![ss::DESCRIPTOR.name], alone: None });
                }
                held.extend(candidate.held_out(&planes, fold, &mut start, run)?);
            }
        }
        let truth = Truth { mask: &tiles.mask, voronoi: Some(voronoi), samples: &planes, map, less: *less };
        let shows = self.is_apart && !voronoi.is_uneven();
        let better = if shows { 0.0 } else { super::BETTER };
        let (weights, _) = super::blend_or_best(&truth, &held, better);
        let error = |k: usize| Weights::error(&truth, &held[k]);
        let is_clear = |&k: &usize| k == 0 || error(k) <= (1.0 - CLEAR) * error(0);
        if let Some(alone) = weights.alone().filter(is_clear) {
            let splines = candidates.iter().position(|candidate| candidate.name == ss::DESCRIPTOR.name);
            let both = splines.filter(|_| learn && shows).map(|splines| [alone, splines]);
            let both = both.map(|both| both.map(|k| held[k].clone().of_frame(tiles)));
            return Ok(Trial { names: vec![candidates[alone].name], alone: both });
        }
        let mut names = Vec::new();
        let mut start = None;
        for (k, candidate) in candidates.iter().enumerate() {
            let is_first = k == 0 && weights.alone().is_some();
            if weights.counts(k) || is_first || start == Some(candidate.name) {
                names.push(candidate.name);
                start = candidate.filter.start().or(start);
            }
        }
        Ok(Trial { names, alone: None })
    }
}

impl Blend {
    /// The candidates, guided filling among them if there is one; and what the only one predicts on tiles, if these do to `learn` its errors.
    pub(super) fn worth_trying<'a>(
        &self,
        guided: Option<Candidate<'a>>,
        (samples, map): (&Planes, Map),
        learn: bool,
        run: &Run<'_>,
    ) -> Result<(Vec<Candidate<'a>>, Option<[HeldOut; 2]>), Error> {
        let mut all: Vec<Candidate<'_>> = candidates().into_iter().map(Candidate::of).collect();
        let gain = guided.as_ref().and_then(|guided| guided.done.as_ref()?.2.gain);
        if gain.is_none_or(|gain| gain < super::ENOUGH) {
            // Guided filling is not tried on tiles.
            let learn = learn && guided.is_none();
            let stage = once(&self.stage, || Stage::new(&self.mask, self.folds));
            let tried = stage.as_ref().map(|stage| stage.try_out(&all, (samples, map), learn, run));
            let tried = tried.transpose()?;
            if let Some(tried) = &tried {
                all.retain(|candidate| tried.names.contains(&candidate.name));
            }
            all.extend(guided);
            return Ok((all, tried.and_then(|tried| tried.alone)));
        }
        all.retain(|candidate| candidate.name == network::DESCRIPTOR.name);
        // Guides first, which are the result where nothing is held out.
        Ok((guided.into_iter().chain(all).collect(), None))
    }
}
