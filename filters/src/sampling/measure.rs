//! How a mask lies: density, discrepancy, distances, holes.
//!
//! Star discrepancy: the largest difference, over all boxes with one corner at the image's first corner, between the share
//! of the measured pixels (as points at their centres) in the box and its share of the area. Boxes with edges at pixel
//! centres, closed and open, and at the far borders are all that matter, so the value is exact: O(N) time, one row of
//! memory.
//!
//! Nearest-neighbour distance: from each measured pixel to the nearest other one. Largest hole: the radius of the
//! largest circle about a pixel's centre that has no measured centre inside, the image's border not being one.
//!
//! Sources: H. Niederreiter, "Random Number Generation and Quasi-Monte Carlo Methods", SIAM 1992 (star discrepancy);
//! A. Lagae, P. Dutre, "A Comparison of Methods for Generating Poisson Disk Distributions", Computer Graphics Forum
//! 27(1), 2008 (distances).

use serde::Serialize;

use crate::baseline::nearest::NearestMap;
use crate::{Error, Mask};

/// The figures of a mask. Lengths are in pixels.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Measures {
    /// Height of the mask.
    pub height: usize,
    /// Width of the mask.
    pub width: usize,
    /// Number of measured pixels.
    pub measured: usize,
    /// Measured pixels over all pixels.
    pub density: f64,
    /// 0 to 1, smaller is more even.
    pub star_discrepancy: f64,
    /// Distances to the nearest other measured pixel; nothing with fewer than two.
    pub nearest: Option<Nearest>,
    /// Radius of the largest empty circle; nothing without measured pixels.
    pub largest_hole: Option<f64>,
}

/// Distances from each measured pixel to the nearest other one.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct Nearest {
    /// The least.
    pub minimum: f64,
    /// The mean.
    pub mean: f64,
    /// The standard deviation (of the population).
    pub standard_deviation: f64,
}

/// Measures a mask.
///
/// # Errors
/// [`Error::TooLarge`] with 2^32 pixels or more.
pub fn measure(mask: &Mask) -> Result<Measures, Error> {
    let size = mask.size();
    Ok(Measures {
        height: size.height,
        width: size.width,
        measured: mask.count(),
        density: mask.density(),
        star_discrepancy: star_discrepancy(mask),
        nearest: nearest(mask),
        largest_hole: largest_hole(mask)?,
    })
}

/// The star discrepancy; 1 without measured pixels.
pub fn star_discrepancy(mask: &Mask) -> f64 {
    let size = mask.size();
    if mask.is_empty() {
        return 1.0;
    }
    let (height, width, count) = (size.height as f64, size.width as f64, mask.count() as f64);
    // Samples above the row, by column: those of columns 0..x are `above[x]`.
    let mut above = vec![0_usize; size.width + 1];
    let mut worst = 0.0_f64;
    for y in 0..size.height {
        let mut row = 0;
        let mut before = 0;
        let last_row = y + 1 == size.height;
        for (x, &flag) in mask.row(y).iter().enumerate() {
            row += usize::from(flag);
            let area = (y as f64 + 0.5) * (x as f64 + 0.5) / (height * width);
            let closed = (above[x + 1] + row) as f64 / count;
            worst = worst.max(closed - area).max(area - above[x] as f64 / count);
            // Open boxes that end at a far border.
            if x + 1 == size.width {
                worst = worst.max((y as f64 + 0.5) / height - above[size.width] as f64 / count);
            }
            if last_row {
                worst = worst.max((x as f64 + 0.5) / width - (above[x] + before) as f64 / count);
            }
            before = row;
        }
        let mut sum = 0;
        for (above, flag) in above[1..].iter_mut().zip(mask.row(y)) {
            sum += usize::from(*flag);
            *above += sum;
        }
    }
    worst
}

/// The distances; nothing with fewer than two measured pixels.
pub fn nearest(mask: &Mask) -> Option<Nearest> {
    if mask.count() < 2 {
        return None;
    }
    let size = mask.size();
    let (mut sum, mut squares, mut minimum) = (0.0, 0.0, f64::INFINITY);
    for y in 0..size.height {
        for x in (0..size.width).filter(|&x| mask.is_measured(y, x)) {
            let squared = nearest_of(mask, y, x) as f64;
            minimum = minimum.min(squared.sqrt());
            sum += squared.sqrt();
            squares += squared;
        }
    }
    let mean = sum / mask.count() as f64;
    let variance = (squares / mask.count() as f64 - mean * mean).max(0.0);
    Some(Nearest { minimum, mean, standard_deviation: variance.sqrt() })
}

/// The squared distance to the nearest other measured pixel, found ring by ring.
fn nearest_of(mask: &Mask, y: usize, x: usize) -> usize {
    let size = mask.size();
    let mut best = usize::MAX;
    for ring in 1..size.height.max(size.width) {
        if ring * ring >= best {
            break;
        }
        let (top, bottom) = (y.checked_sub(ring), Some(y + ring).filter(|&row| row < size.height));
        let columns = x.saturating_sub(ring)..(x + ring + 1).min(size.width);
        for row in [top, bottom].into_iter().flatten() {
            for column in columns.clone().filter(|&column| mask.is_measured(row, column)) {
                best = best.min(ring * ring + column.abs_diff(x).pow(2));
            }
        }
        let (left, right) = (x.checked_sub(ring), Some(x + ring).filter(|&column| column < size.width));
        let rows = y.saturating_sub(ring)..(y + ring + 1).min(size.height);
        for column in [left, right].into_iter().flatten() {
            for row in rows.clone().filter(|&row| mask.is_measured(row, column)) {
                best = best.min(ring * ring + row.abs_diff(y).pow(2));
            }
        }
    }
    best
}

/// The radius of the largest empty circle; nothing without measured pixels.
fn largest_hole(mask: &Mask) -> Result<Option<f64>, Error> {
    if mask.is_empty() {
        return Ok(None);
    }
    let map = NearestMap::new(mask)?;
    let width = mask.size().width;
    let squared = |(pixel, source): (usize, &u32)| {
        let source = *source as usize;
        (pixel / width).abs_diff(source / width).pow(2) + (pixel % width).abs_diff(source % width).pow(2)
    };
    let largest = map.as_slice().iter().enumerate().map(squared).max().unwrap_or(0);
    Ok(Some((largest as f64).sqrt()))
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;
    use crate::Size;
    use crate::sampling::{Field, Pattern, Temporal};

    proptest! {
        #[test]
        fn agrees_with_the_definitions(
            height in 1_usize..9, width in 1_usize..9, flags in proptest::collection::vec(any::<bool>(), 64),
        ) {
            let mask = Mask::from_fn(Size::new(height, width), |y, x| flags[y * 8 + x]);
            let points: Vec<(f64, f64)> = (0..height * width)
                .filter(|&p| mask.as_slice()[p])
                .map(|p| ((p / width) as f64 + 0.5, (p % width) as f64 + 0.5))
                .collect();
            prop_assume!(!points.is_empty());
            let edges = |count: usize| (0..count).map(|i| i as f64 + 0.5).chain([count as f64]).collect::<Vec<_>>();
            let mut star = 0.0_f64;
            for &b in &edges(height) {
                for &a in &edges(width) {
                    let area = a * b / (height * width) as f64;
                    let share = |inside: &dyn Fn(f64, f64) -> bool| {
                        points.iter().filter(|(y, x)| inside(*y, *x)).count() as f64 / points.len() as f64
                    };
                    star = star.max(share(&|y, x| y <= b && x <= a) - area).max(area - share(&|y, x| y < b && x < a));
                }
            }
            prop_assert!((star_discrepancy(&mask) - star).abs() < 1e-12, "{} {star}", star_discrepancy(&mask));
            let distance = |a: &(f64, f64), b: &(f64, f64)| (a.0 - b.0).hypot(a.1 - b.1);
            if points.len() > 1 {
                let nearest: Vec<f64> = points.iter().map(|a| {
                    points.iter().filter(|b| *b != a).map(|b| distance(a, b)).fold(f64::INFINITY, f64::min)
                }).collect();
                let mean = nearest.iter().sum::<f64>() / nearest.len() as f64;
                let deviation = nearest.iter().map(|d| (d - mean).powi(2)).sum::<f64>() / nearest.len() as f64;
                let found = super::nearest(&mask).unwrap();
                prop_assert!((found.minimum - nearest.iter().copied().fold(f64::INFINITY, f64::min)).abs() < 1e-12);
                prop_assert!((found.mean - mean).abs() < 1e-12);
                prop_assert!((found.standard_deviation - deviation.sqrt()).abs() < 1e-6);
            }
            let hole = (0..height * width).map(|p| {
                let centre = ((p / width) as f64 + 0.5, (p % width) as f64 + 0.5);
                points.iter().map(|point| distance(point, &centre)).fold(f64::INFINITY, f64::min)
            }).fold(0.0, f64::max);
            prop_assert!((largest_hole(&mask).unwrap().unwrap() - hole).abs() < 1e-12);
        }
    }

    #[test]
    fn masks_without_samples_have_figures() {
        let empty = measure(&Mask::from_fn(Size::new(3, 4), |_, _| false)).unwrap();
        assert_eq!((empty.star_discrepancy, empty.nearest, empty.largest_hole), (1.0, None, None));
    }

    /// Samples in one column alone: the open box up to it is empty.
    #[test]
    fn no_edge_of_a_long_mask_is_passed_over() {
        let width = 8554;
        for at in [5002, 8000, 8552] {
            let mask = Mask::from_fn(Size::new(2, width), |_, x| x == at);
            let empty = (at as f64 + 0.5) / width as f64;
            assert!((star_discrepancy(&mask) - empty).abs() < 1e-12, "{at}");
        }
    }

    #[test]
    fn low_discrepancy_is_lower() {
        let field = Field { x: 0, y: 0, size: Size::new(200, 200) };
        let of = |pattern| {
            star_discrepancy(&crate::sampling::mask(pattern, field, 0.2, 1, Temporal::Fixed, 0).unwrap())
        };
        assert!(of(Pattern::Shuffle) < 0.6 * of(Pattern::Random));
        assert!(of(Pattern::BlueNoise) < 0.6 * of(Pattern::Random));
    }
}
