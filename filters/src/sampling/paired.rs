//! Masks in which pixels come with their right and their lower neighbour, so that differences between neighbours are known.
//!
//! A pattern's mask at 20 % or less may hold no two neighbours at all. In a paired mask each pixel of the pattern brings the one
//! to the right and the one below it (where there are such): a pixel's rank becomes the smallest of its own, its left and
//! its upper neighbour's, and the mask holds the smallest ranks. It stays progressive, and its density counts all pixels.

use super::checked;
use crate::{Error, Mask, Size};

/// The paired mask of the pixels with the smallest ranks; as dense as asked, or a few pixels less where a pixel's neighbours
/// would be too many.
///
/// # Errors
/// A density outside 0 to 1.
pub fn mask(size: Size, density: f64, rank: impl Fn(usize, usize) -> f64) -> Result<Mask, Error> {
    let density = checked(density)?;
    let mut own = vec![0.0; size.pixels()];
    for y in 0..size.height {
        for x in 0..size.width {
            own[y * size.width + x] = rank(y, x);
        }
    }
    let at = |y: usize, x: usize| own[y * size.width + x];
    let lowest = |y: usize, x: usize| {
        let left = if x > 0 { at(y, x - 1) } else { f64::INFINITY };
        let upper = if y > 0 { at(y - 1, x) } else { f64::INFINITY };
        at(y, x).min(left).min(upper)
    };
    let ranks: Vec<f64> = (0..size.pixels()).map(|i| lowest(i / size.width, i % size.width)).collect();
    let count = (density * ranks.len() as f64).round() as usize;
    let limit = if count < ranks.len() {
        let mut sorted = ranks.clone();
        *sorted.select_nth_unstable_by(count, f64::total_cmp).1
    } else {
        f64::INFINITY
    };
    Ok(Mask::from_fn(size, |y, x| ranks[y * size.width + x] < limit))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::sampling::{Field, Order, Pattern};

    #[test]
    fn masks_are_as_dense_as_asked_made_of_pairs_and_progressive() {
        let field = Field { x: 3, y: -2, size: Size::new(60, 81) };
        for pattern in [Pattern::Random, Pattern::Shuffle] {
            let order = Order::new(pattern, field, 7, 0).unwrap();
            let paired = |density| mask(field.size, density, |y, x| order.rank(y, x)).unwrap();
            let mut last = paired(0.0);
            for density in [0.0, 0.02, 0.1, 0.2, 0.5, 0.9, 1.0] {
                let mask = paired(density);
                let short = density * 4860.0 - mask.count() as f64;
                assert!((-0.5..=3.0).contains(&short), "{pattern:?} {density}: {short}");
                let is = |y: usize, x: usize| y < 60 && x < 81 && mask.is_measured(y, x);
                for (y, x) in (0..4860).map(|i| (i / 81, i % 81)).filter(|&(y, x)| is(y, x)) {
                    let near = is(y, x + 1) || is(y + 1, x) || x > 0 && is(y, x - 1) || y > 0 && is(y - 1, x);
                    // Only the last pixel of all has no neighbour to come with.
                    assert!(near || (y, x) == (59, 80), "{pattern:?} {density} {y} {x}");
                }
                let contained = last.as_slice().iter().zip(mask.as_slice()).all(|(a, b)| !a || *b);
                assert!(contained, "{pattern:?} {density}");
                last = mask;
            }
            assert!(last.is_full());
        }
        assert!(mask(field.size, 1.5, |_, _| 0.0).is_err());
    }
}
