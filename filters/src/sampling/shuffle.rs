//! Shuffle: a progressive low-discrepancy order of the pixels, anchored to absolute coordinates.
//!
//! Pixel (x, y) of the plane has the rank `frac(x / g + y / g^2 + seed (sqrt(5) - 1) / 2)` in [0, 1), where g is the
//! plastic number, g^3 = g + 1, g = 1.3247...; the mask of density d is where the rank is less than d. Thus the
//! masks are nested, and a pixel's fate depends on (x, y, seed) alone: parts, tiles and overscan of one image agree.
//! The pixels of equal rank lie on parallel lines, those below a density on a quasi-lattice that is evenly spread.
//!
//! This is linear pixel shuffling taken to its limit. Anderson labels the pixels of a G x G square by
//! `(x a + y b) mod G` with consecutive terms a, b, G of a Fibonacci-like sequence and visits them in the order of
//! the labels; with ratios of consecutive terms gone to their limits, a / G and b / G become powers of one
//! irrational number, and the square the whole plane. His sequence, `G(n+1) = G(n) + G(n-2)`, leads to
//! x / s + y / s^2 with s^3 = s^2 + 1, s = 1.4656; the sister sequence `P(n+1) = P(n-1) + P(n-2)` to the one here. Neither
//! is the better at every density: the mean squared distance to the next measured pixel, in units of the mean area, is
//! 0.193, 0.193, 0.178, 0.210 here and 0.184, 0.182, 0.207, 0.221 there at 5, 10, 20, 30 % (random: 0.29 to 0.31).
//!
//! Evaluated in wrapping 64-bit fixed point, the unit being 2^-64: exact for all coordinates, with steps that differ from
//! the irrational ones by at most 2^-65, thus by less than 2^-32 over all of i32 in each direction.
//! Cost: of one pixel two multiplications, of a row one addition a pixel; no memory. Range of the density: 0 to 1.
//! Fails: it is regular; a texture whose period fits the lattice is sampled in step with it. Another seed moves the
//! lattice and does not change its shape.
//!
//! Sources: P. G. Anderson, "Linear pixel shuffling for image processing, an introduction", Journal of Electronic
//! Imaging 2(2), 1993; M. Roberts, "The Unreasonable Effectiveness of Quasirandom Sequences", 2018 (plastic number).

use super::{Band, Field, checked};
use crate::{Error, Mask, Size};

/// 1 / g in units of 2^-64, rounded.
const STEP_X: u64 = 0xc13f_a9a9_02a6_328f;
/// 1 / g^2 in units of 2^-64, rounded.
const STEP_Y: u64 = 0x91e1_0da5_c79e_7b1d;
/// (sqrt(5) - 1) / 2 in units of 2^-64: seeds that follow each other lie far apart.
const STEP_SEED: u64 = 0x9e37_79b9_7f4a_7c15;
/// Ranks are told apart to 53 bits, so that they are exact as f64.
const BITS: u32 = 53;

/// The place of a pixel in the order, in [0, 1): it is measured at every density above this.
///
/// `x` counts columns, `y` rows, both absolute (data window coordinates, negative ones included).
pub fn rank(x: i32, y: i32, seed: u64) -> f64 {
    fixed(x, y, seed) as f64 / (1_u64 << BITS) as f64
}

/// The mask of a window: the pixels whose [`rank`] is less than `density`.
///
/// The window has `size` and its first pixel is column `x`, row `y` in absolute coordinates; past the end of i32 they
/// wrap. A density of 1 measures all pixels, 0 none.
///
/// # Errors
/// [`Error::Setting`] if the density is outside 0 to 1 or not a number.
pub fn mask(x: i32, y: i32, size: Size, density: f64, seed: u64) -> Result<Mask, Error> {
    let band = Band::below(checked(density)?);
    Ok(Field { x, y, size }.mask_of_rows(|row, flags| fill(x, y.wrapping_add(row as i32), seed, band, flags)))
}

/// The flags of a row of pixels from column `x` on: whether their ranks lie in the band.
pub(super) fn fill(x: i32, y: i32, seed: u64, band: Band, flags: &mut [bool]) {
    let (start, length) = band.units(1 << BITS);
    if length >= 1 << BITS {
        return flags.fill(true);
    }
    // Ranks as 64-bit numbers, counted from the start of the band: those below its length lie inside.
    let spare = u64::BITS - BITS;
    let (start, length) = (start << spare, length << spare);
    let mut done = 0;
    while done < flags.len() {
        // From one end of i32 to the other the steps do not go on.
        let first = x.wrapping_add(done as i32);
        let left = usize::try_from(i64::from(i32::MAX) - i64::from(first)).unwrap_or(usize::MAX);
        let end = flags.len().min(done.saturating_add(left).saturating_add(1));
        let mut rank = unrounded(first, y, seed).wrapping_sub(start);
        for flag in &mut flags[done..end] {
            *flag = rank < length;
            rank = rank.wrapping_add(STEP_X);
        }
        done = end;
    }
}

/// The rank in units of 2^-53.
fn fixed(x: i32, y: i32, seed: u64) -> u64 {
    unrounded(x, y, seed) >> (u64::BITS - BITS)
}

/// The rank in units of 2^-64.
fn unrounded(x: i32, y: i32, seed: u64) -> u64 {
    // Two's complement: a negative coordinate is a number modulo 2^64 like any other.
    let column = STEP_X.wrapping_mul(i64::from(x) as u64);
    let row = STEP_Y.wrapping_mul(i64::from(y) as u64);
    column.wrapping_add(row).wrapping_add(STEP_SEED.wrapping_mul(seed))
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    /// The positive root of g^3 = g + 1.
    fn plastic() -> f64 {
        (0..60).fold(1.3, |g: f64, _| (g + 1.0).cbrt())
    }

    #[test]
    fn the_steps_are_powers_of_the_plastic_number() {
        let one = 2.0_f64.powi(64);
        assert!((STEP_X as f64 / one - plastic().recip()).abs() < 4.0 * f64::EPSILON);
        assert!((STEP_Y as f64 / one - plastic().powi(-2)).abs() < 4.0 * f64::EPSILON);
        assert!((STEP_SEED as f64 / one - (5.0_f64.sqrt() - 1.0) / 2.0).abs() < 4.0 * f64::EPSILON);
        // To the last of the 64 bits: 1/g + 1/g^2 is g, whose fraction g - 1 is 1/g^4, and the powers of 1/g are
        // related by 1/g^2 + 1/g^3 = 1; with z = 1/g, z^2 (1 + z) = 1 in 128-bit arithmetic, up to the rounding.
        let (x, y) = (u128::from(STEP_X), u128::from(STEP_Y));
        assert!(((x * x) >> 64).abs_diff(y) <= 2);
        assert!((y + ((x * y) >> 64)).abs_diff(1 << 64) <= 3);
    }

    #[test]
    fn agrees_with_the_formula() {
        for (x, y, seed) in [(0, 0, 0), (1, 0, 0), (0, 1, 0), (-1, 0, 1), (37, -1200, 5), (1919, 1079, 1000)]
        {
            let exact = f64::from(x) / plastic() + f64::from(y) / plastic().powi(2);
            let exact = (exact + seed as f64 * (5.0_f64.sqrt() - 1.0) / 2.0).rem_euclid(1.0);
            assert!((rank(x, y, seed) - exact).abs() < 4096.0 * f64::EPSILON, "{x} {y} {seed}");
        }
    }

    proptest! {
        #[test]
        fn masks_follow_the_rank_and_are_nested(
            x in any::<i32>(), y in any::<i32>(), seed in any::<u64>(), a in 0.0..=1.0_f64, b in 0.0..=1.0_f64,
        ) {
            let size = Size::new(7, 9);
            let (sparse, dense) = (a.min(b), a.max(b));
            let (sparse, dense) = (mask(x, y, size, sparse, seed).unwrap(), mask(x, y, size, dense, seed).unwrap());
            for row in 0..7 {
                for column in 0..9 {
                    let rank = rank(x.wrapping_add(column), y.wrapping_add(row), seed);
                    prop_assert!((0.0..1.0).contains(&rank));
                    let (row, column) = (row as usize, column as usize);
                    prop_assert_eq!(sparse.is_measured(row, column), rank < a.min(b));
                    prop_assert!(!sparse.is_measured(row, column) || dense.is_measured(row, column));
                }
            }
        }

        #[test]
        fn windows_agree_where_they_overlap(x in -5000..5000_i32, y in -5000..5000_i32, dx in 0..9_usize, dy in 0..9_usize) {
            let big = mask(x, y, Size::new(20, 20), 0.3, 7).unwrap();
            let small = mask(x + dx as i32, y + dy as i32, Size::new(11, 11), 0.3, 7).unwrap();
            for row in 0..11 {
                prop_assert_eq!(small.row(row), &big.row(row + dy)[dx..dx + 11]);
            }
        }
    }

    #[test]
    fn a_rank_equal_to_the_density_is_not_measured() {
        let rank = rank(3, 5, 2);
        let one = Size::new(1, 1);
        assert!(mask(3, 5, one, rank, 2).unwrap().is_empty());
        assert!(mask(3, 5, one, rank + f64::EPSILON, 2).unwrap().is_full());
    }

    #[test]
    fn the_density_is_met() {
        for (height, width) in [(64, 64), (200, 320), (1, 1000), (1000, 1)] {
            let size = Size::new(height, width);
            for density in [0.01, 0.05, 0.2, 0.5, 0.9] {
                for seed in 0..5 {
                    let found = mask(-100, 37, size, density, seed).unwrap().density();
                    // Far less than the standard deviation of a random mask: the count along a line is off by
                    // a few pixels, whatever its length, and over an area the lines' errors cancel.
                    let bound = 3.0 / (height.max(width) as f64);
                    assert!((found - density).abs() < bound, "{size} {density}: {found}");
                }
            }
        }
        let size = Size::new(3, 5);
        assert!(mask(0, 0, size, 1.0, 3).unwrap().is_full());
        assert!(mask(0, 0, size, 0.0, 3).unwrap().is_empty());
        for bad in [-0.1, 1.1, f64::NAN] {
            assert!(matches!(mask(0, 0, size, bad, 0), Err(Error::Setting { name: "density", .. })));
        }
    }

    /// For each of 200x200 pixels the distance to the nearest measured one: the largest, and the mean of the squares
    /// in units of the area per measured pixel.
    fn gaps(mask: &Mask) -> (f64, f64) {
        let map = crate::baseline::nearest::NearestMap::new(mask).unwrap();
        let width = mask.size().width;
        let squares = map.as_slice().iter().enumerate().map(|(at, &source)| {
            let source = source as usize;
            ((at / width).abs_diff(source / width).pow(2) + (at % width).abs_diff(source % width).pow(2))
                as f64
        });
        let (largest, sum) =
            squares.fold((0.0_f64, 0.0), |(most, sum), square| (most.max(square), sum + square));
        (largest.sqrt(), sum / mask.as_slice().len() as f64 * mask.density())
    }

    #[test]
    fn it_is_spread_more_evenly_than_a_random_mask() {
        let size = Size::new(200, 200);
        let mut state = 1_u64;
        let mut random = || {
            state = state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
            (state >> 40) as f64 / (1_u64 << 24) as f64
        };
        for density in [0.02, 0.05, 0.1, 0.2] {
            let (largest, mean) = gaps(&mask(-50, 1000, size, density, 1).unwrap());
            let (random_largest, random_mean) = gaps(&Mask::from_fn(size, |_, _| random() < density));
            assert!(largest < 0.6 * random_largest, "{density}: {largest} against {random_largest}");
            assert!(mean < 0.75 * random_mean, "{density}: {mean} against {random_mean}");
            // No two measured pixels are close: 1/20 of the area per pixel is a fair distance, squared.
            let closest = closest(&mask(-50, 1000, size, density, 1).unwrap());
            assert!(closest >= 0.5 / density.sqrt(), "{density}: {closest}");
        }
    }

    /// Smallest distance between two measured pixels.
    fn closest(mask: &Mask) -> f64 {
        let Size { height, width } = mask.size();
        let points: Vec<(usize, usize)> = (0..height)
            .flat_map(|y| (0..width).map(move |x| (y, x)))
            .filter(|&(y, x)| mask.is_measured(y, x))
            .collect();
        let mut least = usize::MAX;
        for (i, a) in points.iter().enumerate() {
            for b in points[i + 1..].iter().take_while(|b| b.0 - a.0 < 20) {
                least = least.min((b.0 - a.0).pow(2) + b.1.abs_diff(a.1).pow(2));
            }
        }
        (least as f64).sqrt()
    }
}
