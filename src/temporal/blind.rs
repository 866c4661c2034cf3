//! What a frame shows without the samples that judge its neighbours: what motion may be estimated from.
//!
//! Motion that is estimated from a fill bends the neighbours towards the samples that the fill knows; at these everything then agrees, and
//! nowhere else. So those that judge are held out of it.

use std::sync::Arc;

use lacuna_filters::Planes;
use lacuna_filters::temporal::unjudged;

use super::Neighbour;
use super::reference::{Reference, measured, placed};

/// By how much more the samples of farther frames may miss this one's fill than those of nearer ones if nothing moves.
const FARTHER: f64 = 1.1;

/// A frame that does not know the samples that judge.
pub struct Blind {
    /// All pixels, filled from the others.
    pub filled: Planes,
    /// All pixels, filled from all samples.
    pub whole: Planes,
    /// The samples that judge.
    pub judges: Vec<usize>,
    /// Whether nothing moves.
    pub still: bool,
}

impl Blind {
    /// Nothing if it cannot be filled.
    pub fn new(reference: &Reference<'_>, neighbours: &[&Neighbour], part: usize) -> Option<Self> {
        let kept = Arc::new(unjudged(reference.mask));
        let filled = (reference.sharp)(reference.samples, &kept)?;
        let whole = (reference.sharp)(reference.samples, reference.mask)?;
        let judges = pixels(reference.mask.as_slice(), kept.as_slice());
        let own = Misses::of(reference.samples, &filled, &judges);
        let others = neighbours.iter().filter_map(|neighbour| {
            let (samples, mask) = measured(neighbour, part, &reference.names)?;
            // Of those that this frame shows, what it did not measure.
            let (there, here) = (neighbour.frame.parts[part].data_window, reference.window);
            let known = here.place(reference.mask.as_slice(), there, true);
            let whole = placed(&whole, here, there);
            let misses = Misses::of(&samples, &whole, &pixels(mask.as_slice(), &known));
            Some((neighbour.offset.unsigned_abs(), misses))
        });
        let still = still(own, &others.collect::<Vec<_>>());
        Some(Self { filled, whole, judges, still })
    }
}

/// Whether other frames, each with how far away it is, miss the fill of this one as they would if they showed the same: by what the fill errs
/// by, less than at its own held-out samples, which stand in emptier places; and from near and from far alike.
fn still(own: Misses, others: &[(u64, Misses)]) -> bool {
    let nearest = others.iter().map(|(distance, _)| *distance).min();
    let of = |near: bool| {
        let side = others.iter().filter(|(distance, _)| (Some(*distance) == nearest) == near);
        side.fold(Misses::default(), |sum, (_, misses)| sum.and(*misses))
    };
    let (near, far) = (of(true), of(false));
    near.count > 0
        && near.and(far).mean() <= own.mean()
        && (far.count == 0 || far.mean() <= FARTHER * near.mean())
}

/// Pixels of one mask that another does not have.
fn pixels(mask: &[bool], without: &[bool]) -> Vec<usize> {
    let flags = mask.iter().zip(without).enumerate();
    flags.filter(|(_, (own, other))| **own && !**other).map(|(pixel, _)| pixel).collect()
}

/// The sum of squares by which an image misses samples, as they are shown, and their number.
#[derive(Clone, Copy, Debug, Default)]
struct Misses {
    sum: f64,
    count: usize,
}

impl Misses {
    fn of(samples: &Planes, image: &Planes, pixels: &[usize]) -> Self {
        let mut all = Self::default();
        for (samples, image) in samples.as_slice().iter().zip(image.as_slice()) {
            for &pixel in pixels {
                let [a, b] = [samples, image].map(|plane| plane.pixels()[pixel]);
                if a.is_finite() {
                    all.sum += f64::from(a.clamp(0.0, 1.0) - b.clamp(0.0, 1.0)).powi(2);
                    all.count += 1;
                }
            }
        }
        all
    }

    fn and(self, other: Self) -> Self {
        Self { sum: self.sum + other.sum, count: self.count + other.count }
    }

    fn mean(self) -> f64 {
        if self.count > 0 { self.sum / self.count as f64 } else { 0.0 }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_moves_misses_more_from_farther_away() {
        let misses = |mean: f64| Misses { sum: 100.0 * mean, count: 100 };
        let own = misses(2.0);
        assert!(still(own, &[(1, misses(1.0)), (1, misses(1.1)), (2, misses(1.05))]));
        assert!(still(own, &[(3, misses(1.0))]));
        // More than the fill errs by, or growing.
        assert!(!still(own, &[(1, misses(2.4)), (2, misses(2.4))]));
        assert!(!still(own, &[(1, misses(1.0)), (2, misses(1.3))]));
        // Nothing to tell it by, and a frame that is exact.
        assert!(!still(own, &[]) && still(misses(0.0), &[(1, misses(0.0)), (2, misses(0.0))]));
    }
}
