//! Masks in which pixels come with their right and their lower neighbour, so that differences between neighbours are known.
//!
//! A pattern's mask at 20 % or less may hold no two neighbours at all. A paired mask is the closure of a sparser mask of
//! the same pattern: each of its pixels, the one to the right and the one below (where there are such). The sparser
//! density is the largest whose closure is not denser than what is asked: every pixel that is computed counts.

use crate::{Error, Mask};

/// Halvings of the interval that the sparser density lies in.
const HALVINGS: usize = 20;

/// A mask with the right and the lower neighbour of each of its pixels.
pub fn closure(mask: &Mask) -> Mask {
    let is = |y: usize, x: usize| mask.is_measured(y, x);
    Mask::from_fn(mask.size(), |y, x| is(y, x) || x > 0 && is(y, x - 1) || y > 0 && is(y - 1, x))
}

/// The paired mask of a density, from the masks that `make` makes.
///
/// # Errors
/// Those of `make`.
pub fn mask(density: f64, make: impl Fn(f64) -> Result<Mask, Error>) -> Result<Mask, Error> {
    let full = make(density)?;
    let most = (density * full.size().pixels() as f64).round() as usize;
    let mut best = Mask::from_fn(full.size(), |_, _| false);
    // Pixels of one row and column share neighbours only where they meet.
    let (mut low, mut high) = (density / 3.5, density);
    for step in 0..=HALVINGS {
        let middle = if step == 0 { low } else { f64::midpoint(low, high) };
        let closed = closure(&make(middle)?);
        if closed.count() > most {
            if step == 0 {
                low = 0.0;
            }
            high = middle;
        } else {
            low = middle;
            if closed.count() >= best.count() {
                best = closed;
            }
        }
    }
    Ok(best)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::Size;
    use crate::sampling::{self, Field, Pattern, Temporal};

    #[test]
    fn masks_are_as_dense_as_asked_and_made_of_pairs() {
        let field = Field { x: 3, y: -2, size: Size::new(90, 131) };
        for pattern in [Pattern::Random, Pattern::Shuffle, Pattern::BlueNoise] {
            for density in [0.0, 0.02, 0.1, 0.2, 0.5, 0.9, 1.0] {
                let make = |density| sampling::mask(pattern, field, density, 7, Temporal::Fixed, 0);
                let mask = mask(density, make).unwrap();
                let error = mask.density() - density;
                // One more pixel of the pattern may bring three.
                assert!(error <= 1e-4 && error > -0.004, "{pattern:?} {density}: {}", mask.density());
                let near = |y: usize, x: usize| {
                    let at = |dy: isize, dx: isize| {
                        let (y, x) = (y as isize + dy, x as isize + dx);
                        (0..90).contains(&y)
                            && (0..131).contains(&x)
                            && mask.is_measured(y as usize, x as usize)
                    };
                    at(0, 1) || at(0, -1) || at(1, 0) || at(-1, 0)
                };
                let single = (0..field.size.pixels())
                    .map(|i| (i / 131, i % 131))
                    .filter(|&(y, x)| mask.is_measured(y, x) && !near(y, x));
                // Only the last pixel of all has no neighbour to come with.
                assert!(single.count() <= 1, "{pattern:?} {density}");
            }
        }
    }

    #[test]
    fn nonsense_is_refused() {
        let make = |density| {
            sampling::mask(
                Pattern::Random,
                Field { x: 0, y: 0, size: Size::new(4, 4) },
                density,
                0,
                Temporal::Fixed,
                0,
            )
        };
        assert!(mask(1.5, make).is_err());
    }
}
