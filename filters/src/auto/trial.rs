//! Which candidates are worth computing for all of a large image: they are tried on tiles that are spread over it.

use super::Candidate;
use crate::domain::Map;
use crate::estimate::{Excerpt, Folds, HeldOut, Voronoi};
use crate::weights::Truth;
use crate::{Error, Mask, Planes, Run};

/// Held-out samples at which candidates are compared, unless the tiles have fewer. With half as many, chance took the wrong one at 5 % of a frame.
const ENOUGH: usize = 1000;

/// The names of the candidates that are worth computing, and of those that these start from: they are computed anyway, and more samples decide better.
/// One that is clearly better than a blend has no other beside it.
pub fn worth_trying(
    candidates: &[Candidate<'_>],
    (samples, map): (&Planes, Map),
    (mask, folds): (&Mask, Folds),
    run: &Run<'_>,
) -> Result<Vec<&'static str>, Error> {
    let all = || candidates.iter().map(|candidate| candidate.name).collect();
    let Some(tiles) = Excerpt::small_tiles(mask) else { return Ok(all()) };
    let judged = |pixel: u32| tiles.is_inner(pixel);
    let planes = tiles.planes(samples);
    let tiles = &tiles.mask;
    let mut held = vec![HeldOut::default(); candidates.len()];
    for parts in folds.near(tiles.count()) {
        let mut start = None;
        for (candidate, held) in candidates.iter().zip(&mut held).rev() {
            let fold = (folds, parts.clone());
            held.extend(candidate.held_out((&planes, tiles), fold, &mut start, run)?.sorted(judged));
        }
        if held.first().is_none_or(|held| held.at.len() >= ENOUGH) {
            break;
        }
    }
    if held.first().is_none_or(|held| held.at.len() < super::FEWEST) {
        return Ok(all());
    }
    let less = super::less(&held[0], tiles, folds, super::LESS);
    let voronoi = Voronoi::new(tiles);
    let truth = Truth { mask: tiles, voronoi: Some(&voronoi), samples: &planes, map, less };
    let (weights, _) = super::blend_or_best(&truth, &held);
    if let Some(alone) = weights.alone() {
        return Ok(vec![candidates[alone].name]);
    }
    let mut names = Vec::new();
    let mut start = None;
    for (k, candidate) in candidates.iter().enumerate() {
        if weights.counts(k) || start == Some(candidate.name) {
            names.push(candidate.name);
            start = candidate.filter.start().or(start);
        }
    }
    Ok(names)
}
