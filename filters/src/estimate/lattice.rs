//! Whether samples are a lattice: grids, rows, chequers.

use crate::Mask;

/// The longest period that is looked for, in pixels: a density of 1/256.
const LONGEST: usize = 16;
/// Share of the samples that must have another one a period away. At most 0.98 of the shuffle's do, at 90 % of the pixels.
const ALL: f64 = 0.995;

/// Whether samples repeat along rows and along columns, each with some period of up to 16 pixels.
///
/// Held-out samples of a lattice all have the same surroundings, of which missing pixels have others: what errors are there, samples show less than
/// elsewhere.
pub fn is_lattice(mask: &Mask) -> bool {
    let size = mask.size();
    let flags = mask.as_slice();
    let columns = |row: usize| &flags[row * size.width..][..size.width];
    let along = |period: usize| {
        let pairs =
            (0..size.height).map(|row| (&columns(row)[..size.width - period], &columns(row)[period..]));
        is_kept(pairs)
    };
    let across =
        |period: usize| is_kept((period..size.height).map(|row| (columns(row - period), columns(row))));
    (1..=LONGEST).any(|period| 2 * period < size.width && along(period))
        && (1..=LONGEST).any(|period| 2 * period < size.height && across(period))
}

/// Whether what is measured on the left is so on the right.
fn is_kept<'a>(pairs: impl Iterator<Item = (&'a [bool], &'a [bool])>) -> bool {
    let (mut all, mut kept) = (0_usize, 0_usize);
    for (left, right) in pairs {
        for (left, right) in left.iter().zip(right).filter(|(left, _)| **left) {
            (all, kept) = (all + usize::from(*left), kept + usize::from(*right));
        }
    }
    all > 0 && kept as f64 >= ALL * all as f64
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::Size;
    use crate::sampling::{Field, Pattern, Temporal, mask};

    #[test]
    fn grids_rows_and_chequers_are_lattices_and_even_patterns_are_none() {
        let size = Size::new(190, 230);
        let of = |flag: &dyn Fn(usize, usize) -> bool| is_lattice(&Mask::from_fn(size, flag));
        assert!(of(&|y, x| y % 3 == 1 && x % 4 == 0));
        assert!(of(&|y, _| y % 2 == 0));
        assert!(of(&|y, x| (y + x) % 2 == 0));
        // A few pixels more.
        assert!(of(&|y, x| y % 3 == 1 && x % 3 == 0 || y == 7 && x < 9));
        assert!(!of(&|_, _| false));
        assert!(!of(&|y, x| y % 40 == 0 && x % 3 == 0));
        let field = Field { x: 0, y: 0, size };
        for pattern in [Pattern::Random, Pattern::Shuffle, Pattern::BlueNoise, Pattern::Poisson] {
            for density in [0.05, 0.25, 0.5, 0.9] {
                let mask = mask(pattern, field, density, 1, Temporal::Fixed, 0).unwrap();
                assert!(!is_lattice(&mask), "{pattern:?} {density}");
            }
        }
        assert!(is_lattice(&mask(Pattern::Grid, field, 0.1, 1, Temporal::Fixed, 0).unwrap()));
    }
}
