//! Sums over long vectors: inner products, multiples added, and the entry that stands out most.

use super::vector::AddScaled;
use super::{Body, Isa, dispatch, fma};

/// Partial sums that are kept apart, so that the compiler may use vectors.
const LANES: usize = 32;

/// The inner product of two vectors of one length.
pub fn dot(a: &[f32], b: &[f32]) -> f32 {
    dispatch(Isa::best(), Dot { a, b })
}

/// `y += factor x`, for vectors of one length.
pub fn add_multiple(factor: f32, x: &[f32], y: &mut [f32]) {
    dispatch(Isa::best(), AddScaled { x, a: factor, y });
}

/// The first place where `|values| weights` is largest, and that product; nothing where no product is above 0.
pub fn strongest(values: &[f32], weights: &[f32]) -> Option<(usize, f32)> {
    dispatch(Isa::best(), Strongest { values, weights })
}

struct Dot<'a> {
    a: &'a [f32],
    b: &'a [f32],
}

impl Body for Dot<'_> {
    type Output = f32;

    #[inline(always)]
    fn run<const FUSED: bool>(self) -> f32 {
        let (a, a_rest) = self.a.as_chunks::<LANES>();
        let (b, b_rest) = self.b.as_chunks::<LANES>();
        let mut sums = [0.0_f32; LANES];
        for (a, b) in a.iter().zip(b) {
            for lane in 0..LANES {
                sums[lane] = fma::<f32, FUSED>(a[lane], b[lane], sums[lane]);
            }
        }
        let rest: f32 = a_rest.iter().zip(b_rest).map(|(a, b)| a * b).sum();
        sums.iter().sum::<f32>() + rest
    }
}

struct Strongest<'a> {
    values: &'a [f32],
    weights: &'a [f32],
}

impl Body for Strongest<'_> {
    type Output = Option<(usize, f32)>;

    #[inline(always)]
    fn run<const FUSED: bool>(self) -> Self::Output {
        let (values, _) = self.values.as_chunks::<LANES>();
        let (weights, _) = self.weights.as_chunks::<LANES>();
        let mut tops = [0.0_f32; LANES];
        for (values, weights) in values.iter().zip(weights) {
            for lane in 0..LANES {
                tops[lane] = tops[lane].max(values[lane].abs() * weights[lane]);
            }
        }
        let done = values.len() * LANES;
        let product = |(value, weight): (&f32, &f32)| value.abs() * weight;
        let rest = self.values[done..].iter().zip(&self.weights[done..]).map(product);
        let top = tops.into_iter().chain(rest).fold(0.0_f32, f32::max);
        let at = (top > 0.0)
            .then(|| self.values.iter().zip(self.weights).position(|pair| product(pair) == top))
            .flatten()?;
        Some((at, top))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn values(count: usize, step: u32) -> Vec<f32> {
        (0..count as u32).map(|i| ((i * step + 7) % 97) as f32 / 31.0 - 1.5).collect()
    }

    #[test]
    fn every_instruction_set_says_what_plain_loops_say() {
        for count in [0, 1, 31, 32, 33, 100, 768] {
            let (a, b) = (values(count, 13), values(count, 29));
            let exact: f64 = a.iter().zip(&b).map(|(a, b)| f64::from(*a) * f64::from(*b)).sum();
            let size: f64 = a.iter().zip(&b).map(|(a, b)| f64::from(a * b).abs()).sum();
            let weights: Vec<f32> = b.iter().map(|b| b.abs()).collect();
            let best = (0..count).fold(None, |best: Option<(usize, f32)>, at| {
                let product = a[at].abs() * weights[at];
                if product > best.map_or(0.0, |best| best.1) { Some((at, product)) } else { best }
            });
            for isa in [Isa::Portable, Isa::Avx2, Isa::Avx512] {
                let sum = dispatch(isa, Dot { a: &a, b: &b });
                let bound = f64::from(f32::EPSILON) * (count as f64 + 2.0) * size;
                assert!((f64::from(sum) - exact).abs() <= bound, "{count} {isa:?}");
                assert_eq!(dispatch(isa, Strongest { values: &a, weights: &weights }), best);
                let mut y = b.clone();
                dispatch(isa, AddScaled { x: &a, a: 0.3, y: &mut y });
                for ((y, a), b) in y.iter().zip(&a).zip(&b) {
                    assert!((y - (b + 0.3 * a)).abs() <= 4.0 * f32::EPSILON, "{count} {isa:?}");
                }
            }
        }
    }
}
