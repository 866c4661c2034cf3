//! How uncertain the pattern of samples leaves each pixel, from the mask alone.
//!
//! Of the distances `d_1 .. d_4` to the nearest samples:
//!
//! - [`Kind::Spline`]: `v = a d_1^b1 d_2^b2 d_3^b3 d_4^b4`, the variance of [`super::kriging`] as the mask itself shows it: the five numbers
//!   are fitted in logarithms to some hundreds of pixels, where 16 neighbours were solved for. Off by 3 % (low discrepancy) to 14 % (random masks of 5 %).
//! - [`Kind::Distance`]: `v` is the mean of `d_1^2`, `d_2^2`, `d_3^2`: for methods that do not gain from samples on all sides as splines do.
//! - [`Kind::Density`]: `v` is the mean of `d_1^2` to `d_4^2`: for methods that gain from many samples, but not from a near one.

use lacuna_core::parallel::prelude::*;

use super::held_out::pixels_where;
use super::kriging::{self, NEIGHBOURS};
use super::near::{Near, Places};
use crate::descriptor::Kind;
use crate::solver::cholesky::Cholesky;
use crate::{Mask, Size};
use lacuna_core::hash;

/// Distances of which the mean is taken; none where the mask itself shows the variance.
const fn distances(kind: Kind) -> Option<usize> {
    match kind {
        Kind::Spline => None,
        Kind::Distance => Some(FEW),
        Kind::Density => Some(MOST),
    }
}

/// Distances that count where few do.
const FEW: usize = 3;
/// Distances that count at most.
const MOST: usize = 4;
/// Those that count where the mask shows the variance.
const DISTANCES: usize = 4;
/// Coefficients.
const TERMS: usize = DISTANCES + 1;
/// Pixels that are solved for, of measured and missing ones each.
const FITTED: usize = 500;

/// The variance as a function of the nearest samples.
#[derive(Clone, Debug)]
pub struct Variance {
    size: Size,
    /// Logarithm of the factor and the powers of squared distances; nothing where the mean of distances is taken.
    fitted: Option<[f64; TERMS]>,
    /// Distances that count.
    count: usize,
}

impl Variance {
    /// Fits the variance to a mask. One whose samples do not determine it (fewer than four, all on lines) gets that of distances.
    pub fn new(kind: Kind, mask: &Mask, places: &Places, seed: u64) -> Self {
        let count = distances(kind);
        let fitted = if count.is_none() { fit(mask, places, seed) } else { None };
        let of_distances = count.unwrap_or(FEW);
        Self { size: mask.size(), fitted, count: if fitted.is_some() { DISTANCES } else { of_distances } }
    }

    /// The variance of a pixel, from the samples other than itself.
    pub fn at(&self, places: &Places, pixel: usize) -> f32 {
        let mut found = [Near::default(); MOST];
        let place = (pixel / self.size.width, pixel % self.size.width);
        let count = places.nearest(place, &mut found[..self.count]);
        self.of(&found[..count])
    }

    /// The variance of pixels, rows in parallel.
    pub fn all(&self, places: &Places, pixels: &[u32]) -> Vec<f32> {
        pixels.par_iter().with_min_len(1 << 10).map(|&pixel| self.at(places, pixel as usize))
    }

    fn of(&self, found: &[Near]) -> f32 {
        let far = (self.size.height.pow(2) + self.size.width.pow(2)) as f32;
        let squared = |k: usize| found.get(k).map_or(far, |near| near.squared as f32);
        match &self.fitted {
            Some(fitted) => {
                let sum: f32 = (0..DISTANCES).map(|k| fitted[k + 1] as f32 * squared(k).ln()).sum();
                (fitted[0] as f32 + sum).exp()
            }
            None => (0..self.count).map(squared).sum::<f32>() / self.count as f32,
        }
    }
}

/// Least squares in logarithms over some pixels, measured and missing ones in equal shares.
fn fit(mask: &Mask, places: &Places, seed: u64) -> Option<[f64; TERMS]> {
    let (size, count) = (mask.size(), mask.count());
    let every = |of: usize| (of / FITTED).max(1) as u64;
    let (measured, missing) = (every(count), every(size.pixels() - count));
    let pixels = pixels_where(mask, |is_measured, pixel| {
        hash(seed, pixel as u64).is_multiple_of(if is_measured { measured } else { missing })
    });
    let row = |&pixel: &u32| {
        let pixel = pixel as usize;
        let mut found = [Near::default(); NEIGHBOURS];
        let place = (pixel / size.width, pixel % size.width);
        let count = places.nearest(place, &mut found);
        let variance = kriging::variance(place, &found[..count])?;
        let ln = |k: usize| f64::from(found[k].squared).ln();
        Some(([1.0, ln(0), ln(1), ln(2), ln(3)], variance.ln()))
    };
    let rows = pixels.par_iter().with_min_len(32).map(row);
    let rows: Vec<([f64; TERMS], f64)> = rows.into_iter().flatten().collect();
    if rows.len() < 4 * TERMS {
        return None;
    }
    // What a mask does not tell apart (a grid has few patterns) is left small.
    let ridge = 1e-6 * rows.len() as f64;
    let entry = |i: usize, j: usize| {
        rows.iter().map(|(x, _)| x[i] * x[j]).sum::<f64>() + if i == j { ridge } else { 0.0 }
    };
    let mut solution: [f64; TERMS] = std::array::from_fn(|i| rows.iter().map(|(x, y)| x[i] * y).sum());
    Cholesky::new(TERMS, 1e-12, entry).solve(&mut solution);
    Some(solution)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn it_is_that_of_kriging_within_some_percent() {
        for density in [3, 5, 20] {
            let size = Size::new(90, 110);
            let mask = Mask::from_fn(size, |row, column| {
                hash(3, (row * 512 + column) as u64).is_multiple_of(density)
            });
            let places = Places::new(&mask, |_| true);
            let variance = Variance::new(Kind::Spline, &mask, &places, 7);
            let (mut sum, mut squares, mut count) = (0.0, 0.0, 0.0);
            for pixel in (0..size.pixels()).step_by(13) {
                let mut found = [Near::default(); NEIGHBOURS];
                let place = (pixel / size.width, pixel % size.width);
                let inside = (10..80).contains(&place.0) && (10..100).contains(&place.1);
                let near = places.nearest(place, &mut found);
                let Some(exact) = kriging::variance(place, &found[..near]).filter(|_| inside) else {
                    continue;
                };
                let off = f64::from(variance.at(&places, pixel)).ln() - exact.ln();
                sum += off;
                squares += off * off;
                count += 1.0;
            }
            let (mean, root) = (f64::abs(sum / count), f64::sqrt(squares / count));
            assert!(mean < 0.05 && root < 0.2, "{density}: {mean} {root}");
        }
    }

    #[test]
    fn means_of_distances_are_those_of_the_nearest() {
        let mask = Mask::from_fn(Size::new(1, 30), |_, column| [0, 3, 5, 12, 20, 21].contains(&column));
        let places = Places::new(&mask, |_| true);
        let of = |kind| Variance::new(kind, &mask, &places, 0).at(&places, 4);
        assert_eq!(of(Kind::Distance), (1.0 + 1.0 + 16.0) / 3.0);
        assert_eq!(of(Kind::Density), (1.0 + 1.0 + 16.0 + 64.0) / 4.0);
    }

    #[test]
    fn few_samples_have_distances() {
        let mask = Mask::from_fn(Size::new(5, 5), |row, column| row == 0 && column < 2);
        let places = Places::new(&mask, |_| true);
        let variance = Variance::new(Kind::Spline, &mask, &places, 0);
        assert_eq!(variance.at(&places, 5), (1.0 + 2.0 + 50.0) / 3.0);
    }
}
