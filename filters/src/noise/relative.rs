//! What the error at a sample counts for: the same everywhere up to the level that nine tenths of the samples stay below, relative to the light
//! around beyond it, as in the relative squared error of F. Rousselle et al., "Adaptive Sampling and Reconstruction using Greedy Error
//! Minimization", ACM Transactions on Graphics 30(6), 2011. A highlight, most of which a display clips, would choose for all around it else.

use lacuna_core::parallel::prelude::*;

use crate::kernel::blur::blur;
use crate::{Mask, Plane, Planes};

/// Pixels that one task takes.
const PIECE: usize = 1 << 14;
/// Width of what is around, in spacings of the samples.
const AROUND: f64 = 0.6;

/// By pixel the factor of an error there, 0 to 1, times the root of what its sample counts.
pub fn importance((mask, weights): (&Mask, Option<&Plane>), samples: &Planes, level: f32) -> Vec<f64> {
    let mut factors = of_light(mask, samples, level);
    let roots = weights.into_iter().flat_map(Plane::pixels).map(|weight| f64::from(*weight).sqrt());
    factors.iter_mut().zip(roots).for_each(|(factor, root)| *factor *= root);
    factors
}

fn of_light(mask: &Mask, samples: &Planes, level: f32) -> Vec<f64> {
    let size = mask.size();
    if !level.is_finite() || level <= 0.0 {
        return vec![1.0; size.pixels()];
    }
    let spacing = (size.pixels() as f64 / mask.count().max(1) as f64).sqrt();
    let brightest =
        |pixel| samples.as_slice().iter().fold(0.0_f32, |most, plane| most.max(plane.pixels()[pixel]));
    let flags = mask.as_slice();
    let (mut light, mut counted) = (vec![0.0; size.pixels()], vec![0.0; size.pixels()]);
    let pieces = light.par_chunks_mut(PIECE).zip(counted.par_chunks_mut(PIECE)).zip(flags.par_chunks(PIECE));
    pieces.enumerate().for_each(|(piece, ((light, counted), flags))| {
        for (at, _) in flags.iter().enumerate().filter(|(_, flag)| **flag) {
            (light[at], counted[at]) = (brightest(piece * PIECE + at), 1.0);
        }
    });
    let (sums, counts) = (blur(size, &light, AROUND * spacing), blur(size, &counted, AROUND * spacing));
    let factor = |(sum, count): (&f32, &f32)| {
        let around = sum / count.max(f32::MIN_POSITIVE);
        if around > level { f64::from(level / around) } else { 1.0 }
    };
    let pieces = sums.par_chunks(PIECE).zip(counts.par_chunks(PIECE));
    let pieces = pieces.map(|(sums, counts)| sums.iter().zip(counts).map(factor).collect::<Vec<f64>>());
    pieces.concat()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::Size;

    /// A bright half counts as little as it is bright, in the middle; a level that nothing passes, or none, changes nothing.
    #[test]
    fn bright_light_counts_by_its_level() {
        let size = Size::new(20, 40);
        let mask = Mask::from_fn(size, |row, column| (row + 2 * column).is_multiple_of(3));
        let light = Plane::from_fn(size, |_, column| if column < 20 { 0.5 } else { 8.0 });
        let samples = Planes::of(size, vec![light.clone(), Plane::filled(size, 0.0)]);
        let found = importance((&mask, None), &samples, 2.0);
        let at = |column: usize| found[10 * 40 + column];
        assert_eq!(at(5), 1.0);
        let nine = importance((&mask, Some(&Plane::filled(size, 9.0))), &samples, 2.0);
        assert!(found.iter().zip(&nine).all(|(one, nine)| *nine == 3.0 * one));
        assert!((at(35) - 0.25).abs() < 1e-3, "{}", at(35));
        assert!(found.iter().all(|counts| (0.25 - 1e-3..=1.0).contains(counts)));
        for level in [9.0, 0.0, f32::INFINITY] {
            assert!(
                importance((&mask, None), &samples, level).iter().all(|counts| *counts == 1.0),
                "{level}"
            );
        }
    }
}
