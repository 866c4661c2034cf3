//! Errors larger than any that held-out samples show.
//!
//! Where few pixels carry the error, as at the crest of a highlight, most of them are missed by the few samples that are held out. The largest
//! errors then follow a power law, `P(E > x) ~ x^-a`, with `a` below 1 or little above it, and their mean over all missing pixels is not the mean
//! over the samples. `a` is found by B. M. Hill, "A Simple General Approach to Inference about the Tail of a Distribution", The Annals of
//! Statistics 3, 1975, from as many of the largest as the root of their number.

/// Largest errors of which one may be that of a pixel with little weight.
const LARGEST: usize = 5;
/// The law's largest error is at most this many times the one seen.
const TRUST: f64 = 2.0;
/// Powers as close to 1 are taken for 1.
const CLOSE: f64 = 1e-3;

/// The logarithm of what unseen errors multiply the mean squared error by: those between the largest of the samples and the largest of as
/// many pixels as are missing, which none can exceed that is as large as the samples' `range`. `parts` are what samples say of the sum of the
/// squared errors of the missing pixels, `squared` their own.
pub fn unseen((parts, squared): (&[f64], &[f64]), missing: usize, range: f64) -> f64 {
    let mut largest: Vec<(f64, f64)> = parts.iter().copied().zip(squared.iter().copied()).collect();
    largest.sort_by(|a, b| b.0.total_cmp(&a.0));
    let count = largest.len().isqrt();
    let Some(&(least, _)) = largest.get(count).filter(|(least, _)| *least > 0.0) else { return 0.0 };
    let logarithms: f64 = largest[..count].iter().map(|(part, _)| (part / least).ln()).sum();
    if logarithms <= 0.0 {
        return 0.0;
    }
    let power = count as f64 / logarithms;
    let seen = largest.iter().take(LARGEST).fold(0.0, |most: f64, (_, squared)| most.max(*squared));
    let of_pixels = (missing as f64 / parts.len() as f64).powf(power.recip());
    let reach = of_pixels.min(range * range / seen).max(1.0);
    let top = (least * (count as f64).powf(power.recip())).min(TRUST * largest[0].0);
    // The integral of P(E > x) from the largest seen to its reach.
    let more = if (power - 1.0).abs() < CLOSE {
        top * reach.ln()
    } else {
        top / (1.0 - power) * (reach.powf(1.0 - power) - 1.0)
    };
    (more / parts.iter().sum::<f64>()).ln_1p()
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Values of a power law, evenly spread over its probabilities.
    fn pareto(count: usize, power: f64) -> Vec<f64> {
        (0..count).map(|k| ((k as f64 + 0.5) / count as f64).powf(-power.recip())).collect()
    }

    /// Of a law that is known: the mean over more of its values against that over few.
    #[test]
    fn a_power_law_is_carried_on() {
        let (few, many) = (4000, 120_000);
        for power in [0.6, 0.8, 1.0, 1.5, 3.0] {
            let parts = pareto(few, power);
            let squared = vec![1e-30; few];
            let mean = |values: &[f64]| values.iter().sum::<f64>() / values.len() as f64;
            let right = (mean(&pareto(many, power)) / mean(&parts)).ln();
            let found = unseen((&parts, &squared), many, 1.0);
            assert!((found - right).abs() < 0.25 * right + 0.02, "{power}: {found} for {right}");
        }
    }

    #[test]
    fn nothing_is_beyond_the_range() {
        let parts = pareto(4000, 0.6);
        let squared: Vec<f64> = parts.iter().map(|part| part / parts[0]).collect();
        assert_eq!(unseen((&parts, &squared), 120_000, 1.0), 0.0);
        assert_eq!(unseen((&[1.0; 100], &[0.1; 100]), 1000, 1.0), 0.0);
        assert_eq!(unseen((&[], &[]), 1000, 1.0), 0.0);
    }
}
