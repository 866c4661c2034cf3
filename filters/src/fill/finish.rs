//! What becomes of values that a method left beyond what they may be: mended, limited, bounded.

use lacuna_core::parallel::prelude::*;

use super::PIECE;
use crate::limiter::{self, Moved};
use crate::variational::guided::Guides;
use crate::{Bounds, Error, Mask, Plane};

/// A method that smooths may take measured pixels out of the bounds as well; returns how many were moved back, and how far.
pub fn bound_measured(bounds: Bounds, mask: &Mask, samples: &Plane, out: &mut Plane) -> Moved {
    let measured = samples.pixels().iter().zip(mask.as_slice()).filter(|(_, flag)| **flag);
    let (low, high) = bounds.range(measured.map(|(value, _)| *value));
    let mut moved = Moved::default();
    for (value, _) in out.pixels_mut().iter_mut().zip(mask.as_slice()).filter(|(_, flag)| **flag) {
        let free = *value;
        *value = free.clamp(low, high);
        moved += Moved::between(free, *value);
    }
    moved
}

/// Holds what guides improved within reach of all measured pixels, and what they do not know within that of those around.
pub fn limit_guided(guides: &Guides, mask: &Mask, samples: &Plane, out: &mut Plane) -> Result<Moved, Error> {
    let mut moved = Moved::default();
    if guides.unknown() > 0 {
        let mut near = out.clone();
        limiter::local(mask, samples, &mut near)?;
        for pixel in guides.unknown_pixels().filter(|pixel| !mask.as_slice()[*pixel]) {
            let (free, held) = (&mut out.pixels_mut()[pixel], near.pixels()[pixel]);
            moved += Moved::between(*free, held);
            *free = held;
        }
    }
    moved += limiter::whole(mask, samples, out)?;
    Ok(moved)
}

/// Values near the end of a float's range can overflow inside a method; such pixels take the nearest one of `samples`, whose
/// place `of` tells for every pixel of `out`. Returns how many did.
pub fn mend<N>(
    samples: &Plane,
    out: &mut Plane,
    nearest: impl FnOnce() -> Result<N, Error>,
    of: impl Fn(&N) -> &[u32],
) -> Result<usize, Error> {
    let count = |piece: &[f32]| piece.iter().filter(|value| !value.is_finite()).count();
    let bad: usize = out.pixels().par_chunks(PIECE).map(count).into_iter().sum();
    if bad > 0 {
        let nearest = nearest()?;
        for (value, &source) in out.pixels_mut().iter_mut().zip(of(&nearest)) {
            if !value.is_finite() {
                *value = samples.pixels()[source as usize];
            }
        }
    }
    Ok(bad)
}
