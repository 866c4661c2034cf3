//! Which candidates are worth computing for all of a large image: they are tried on tiles that are spread over it.
//!
//! The tiles are put side by side as an image of their own. Errors count where a tile's neighbours do not reach.

use std::sync::Arc;

use super::Candidate;
use crate::estimate::{Folds, HeldOut};
use crate::weights::Weights;
use crate::{Error, Mask, Plane, Planes, Run, Size};

/// Side of a tile.
const TILE: usize = 128;
/// Pixels of a tile's border that its neighbours may reach.
const BORDER: usize = 16;
/// Tiles along each side of the image.
const ACROSS: usize = 4;
/// Smaller images need no trial: so many times what the tiles hold.
const LARGE: usize = 3;

/// The names of the candidates that are worth computing.
pub fn worth_trying(
    candidates: &[Candidate<'_>],
    (samples, mask): (&Planes, &Mask),
    folds: Folds,
    run: &Run<'_>,
) -> Result<Vec<&'static str>, Error> {
    let all = || candidates.iter().map(|candidate| candidate.name).collect();
    let size = mask.size();
    let side = TILE * ACROSS;
    if size.height < side || size.width < side || size.pixels() < LARGE * side * side {
        return Ok(all());
    }
    let place = |at: usize, length: usize| {
        let tile = at / TILE;
        tile * (length - TILE) / (ACROSS - 1) + at % TILE
    };
    let small = Size::new(side, side);
    let source = |row: usize, column: usize| (place(row, size.height), place(column, size.width));
    let tiles = Mask::from_fn(small, |row, column| {
        let (row, column) = source(row, column);
        mask.is_measured(row, column)
    });
    let inner = |at: usize| (BORDER..TILE - BORDER).contains(&(at % TILE));
    let judged = |pixel: u32| inner(pixel as usize / side) && inner(pixel as usize % side);
    let planes = samples.as_slice().iter().map(|plane| {
        Plane::from_fn(small, |row, column| {
            let (row, column) = source(row, column);
            plane.at(row, column)
        })
    });
    let planes = Planes::of(small, planes.collect());
    let mut held = vec![HeldOut::default(); candidates.len()];
    for parts in folds.near(tiles.count()) {
        for (candidate, held) in candidates.iter().zip(&mut held) {
            held.extend(candidate.held_out((&planes, &tiles), (folds, parts.clone()), run)?.sorted(judged));
        }
        if held.first().is_none_or(|held| held.at.len() >= super::DECIDE) {
            break;
        }
    }
    if held.first().is_none_or(|held| held.at.len() < super::FEWEST) {
        return Ok(all());
    }
    let weights = Weights::new(&Arc::new(tiles), &planes, &held);
    Ok(candidates.iter().enumerate().filter(|(k, _)| weights.counts(*k)).map(|(_, c)| c.name).collect())
}
