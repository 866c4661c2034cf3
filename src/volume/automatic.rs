//! A transfer function for a volume about which nothing is known.
//!
//! The background is told from the rest by the threshold that separates the histogram best (N. Otsu, "A threshold
//! selection method from gray-level histograms", IEEE Transactions on Systems, Man, and Cybernetics 9(1), 1979); above it
//! opacity grows with the value.

use super::Grid;

const BINS: usize = 256;

/// Points of a curve over data values.
type Points<const N: usize> = Vec<(f64, [f64; N])>;

/// Points in data values: colours from blue over sand to white, and opacities.
pub fn transfer(grid: &Grid, domain: (f64, f64)) -> (Points<3>, Points<1>) {
    let (low, high) = domain;
    let threshold = threshold(&histogram(grid, domain));
    let data = |share: f64| low + share * (high - low);
    let above = |share: f64| data(threshold + share * (1.0 - threshold));
    let colour = vec![
        (low, [0.15, 0.25, 0.6]),
        (above(0.0), [0.3, 0.45, 0.75]),
        (above(0.3), [0.85, 0.6, 0.45]),
        (above(0.7), [0.95, 0.85, 0.7]),
        (high, [1.0, 1.0, 1.0]),
    ];
    let opacity = vec![
        (low, [0.0]),
        (data(0.9 * threshold), [0.0]),
        (above(0.1), [0.03]),
        (above(0.5), [0.1]),
        (high, [0.6]),
    ];
    (colour, opacity)
}

fn histogram(grid: &Grid, (low, high): (f64, f64)) -> [f64; BINS] {
    let mut counts = [0.0; BINS];
    let per_value = if high > low { BINS as f64 / (high - low) } else { 0.0 };
    for value in grid.values() {
        let bin = ((f64::from(value) - low) * per_value).clamp(0.0, (BINS - 1) as f64);
        counts[bin as usize] += 1.0;
    }
    counts
}

/// The share of the domain below which the background lies.
fn threshold(counts: &[f64; BINS]) -> f64 {
    let all: f64 = counts.iter().sum();
    let moment: f64 = counts.iter().enumerate().map(|(k, count)| k as f64 * count).sum();
    let (mut below, mut below_moment, mut best) = (0.0, 0.0, (0.0, 0.5));
    for (k, count) in counts.iter().enumerate() {
        below += count;
        below_moment += k as f64 * count;
        let above = all - below;
        if below > 0.0 && above > 0.0 {
            let between = below_moment / below - (moment - below_moment) / above;
            let separation = below * above * between * between;
            if separation > best.0 {
                best = (separation, (k + 1) as f64 / BINS as f64);
            }
        }
    }
    best.1
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn two_heaps_are_told_apart() {
        let mut counts = [0.0; BINS];
        for k in 0..BINS {
            let heap = |centre: f64| (-((k as f64 - centre) / 10.0).powi(2)).exp();
            counts[k] = 5.0 * heap(40.0) + heap(180.0);
        }
        let found = threshold(&counts) * BINS as f64;
        assert!((70.0..150.0).contains(&found), "{found}");
        assert_eq!(threshold(&[0.0; BINS]), 0.5);
    }
}
