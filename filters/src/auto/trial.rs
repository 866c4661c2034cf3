//! Which candidates are worth computing for all of a large image: they are tried on tiles that are spread over it.

use super::Candidate;
use crate::estimate::{Excerpt, Folds, HeldOut};
use crate::weights::{WORTH, Weights};
use crate::{Error, Mask, Planes, Run};

/// So many held-out samples tell candidates apart that differ by a few hundredths of their squared error.
const ENOUGH: usize = 1000;

/// The names of the candidates that are worth computing.
pub fn worth_trying(
    candidates: &[Candidate<'_>],
    (samples, mask): (&Planes, &Mask),
    folds: Folds,
    run: &Run<'_>,
) -> Result<Vec<&'static str>, Error> {
    let all = || candidates.iter().map(|candidate| candidate.name).collect();
    let Some(tiles) = Excerpt::few_tiles(mask) else { return Ok(all()) };
    let judged = |pixel: u32| tiles.is_inner(pixel);
    let planes = tiles.planes(samples);
    let tiles = &tiles.mask;
    let mut held = vec![HeldOut::default(); candidates.len()];
    for parts in folds.near(tiles.count()) {
        let mut splines = None;
        for (candidate, held) in candidates.iter().zip(&mut held) {
            let fold = (folds, parts.clone());
            held.extend(candidate.held_out((&planes, tiles), fold, &mut splines, run)?.sorted(judged));
        }
        if held.first().is_none_or(|held| held.at.len() >= ENOUGH) {
            break;
        }
    }
    if held.first().is_none_or(|held| held.at.len() < super::FEWEST) {
        return Ok(all());
    }
    let weights = Weights::new(tiles, &planes, &held);
    let counting = (0..held.len()).filter(|&k| weights.counts(k)).collect();
    let kept = worth_it(counting, |among| {
        let among: Vec<HeldOut> = among.iter().map(|&k| held[k].clone()).collect();
        let blend = Weights::crossed(&among, &|held| Weights::new(tiles, &planes, held));
        blend.squared_errors(&planes).into_iter().map(f64::from).sum()
    });
    Ok(kept.into_iter().map(|k| candidates[k].name).collect())
}

/// Leaves out, one after the other, candidates whose absence the blend's error at samples that taught no weights does not show: what their own
/// samples say of weights, few around each place, is too good by more than most candidates are worth.
fn worth_it(mut counting: Vec<usize>, error: impl Fn(&[usize]) -> f64) -> Vec<usize> {
    while counting.len() > 1 {
        let rest = |&k: &usize| counting.iter().copied().filter(|&other| other != k).collect::<Vec<_>>();
        let without = counting.iter().map(rest).map(|rest| (error(&rest), rest));
        match without.min_by(|a, b| a.0.total_cmp(&b.0)) {
            Some((least, rest)) if least * (1.0 - WORTH) <= error(&counting) => counting = rest,
            _ => break,
        }
    }
    counting
}
