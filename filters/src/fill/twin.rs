//! Planes that need no method, because a complete plane, their twin, holds their values: missing pixels take its own.
//!
//! Nobody writes down that a complete plane is of the same samples as a sparse one, and by a name alone it may be of other ones (fewer samples a
//! pixel, longer steps). So it is told from the values: all measured ones must be equal, and [`ENOUGH`] of them others than the most frequent one.
//!
//! Error: of `n` samples that all agree, nine times of ten fewer than `ln(10) / n` of all pixels differ (the rule of three), and each by no
//! more than the range of the samples. Samples that lie unevenly count as fewer (L. Kish, 1965), by the pixels that each is the nearest of. That bound is
//! all that is told ([`Verdict::AtMost`]).

use std::sync::Arc;

use super::{Estimate, Options, Set, Values};
use crate::domain::Domain;
use crate::estimate::{Verdict, Voronoi};
use crate::limiter::Moved;
use crate::{Mask, Outcome, Plane, Planes};

/// Measured values other than the most frequent one, without which equality says nothing.
const ENOUGH: usize = 16;

/// Whether a complete plane holds the values of a sparse one: equal at all measured pixels, which suffice to tell, and nowhere NaN where
/// one is missing.
pub fn agrees(mask: &Mask, samples: &[f32], twin: &[f32]) -> bool {
    let pixels = || mask.as_slice().iter().zip(samples.iter().zip(twin));
    if pixels().any(|(&flag, (sample, twin))| if flag { sample != twin } else { twin.is_nan() }) {
        return false;
    }
    let measured = || pixels().filter(|(flag, _)| **flag).map(|(_, (&sample, _))| sample);
    // The majority, if there is one, is what is left of a vote (R. Boyer, J. Moore).
    let vote = |(leader, votes), value| match votes {
        0 => (value, 1),
        votes if value == leader => (leader, votes + 1),
        votes => (leader, votes - 1),
    };
    let (leader, _) = measured().fold((0.0_f32, 0_usize), vote);
    measured().filter(|&value| value != leader).take(ENOUGH).count() == ENOUGH
}

/// Which planes take their missing values from their twins; of directions all or none, as their length is that of all.
pub fn copied(samples: &Planes, masks: &[Arc<Mask>], options: &Options<'_>) -> Vec<bool> {
    let keeps = options.keeps_measured();
    let agree = |((plane, mask), twin): ((&Plane, &Arc<Mask>), Option<&Arc<Plane>>)| {
        let Some(twin) = twin.filter(|_| keeps && !mask.is_full()) else { return false };
        twin.pixels().iter().all(|value| value.is_finite()) && agrees(mask, plane.pixels(), twin.pixels())
    };
    let twins = (0..samples.len()).map(|at| options.twins.get(at)?.as_ref());
    let mut found: Vec<bool> = samples.as_slice().iter().zip(masks).zip(twins).map(agree).collect();
    if options.values == Values::Directions && found.contains(&false) {
        found.fill(false);
    }
    found
}

/// Copies the missing pixels of a set of planes from their twins; `places` are those of the planes in their group.
pub fn copy(
    samples: &Planes,
    (mask, places): (&Arc<Mask>, Vec<usize>),
    options: &Options<'_>,
) -> (Planes, Vec<Moved>, Set) {
    let mut out = samples.clone();
    for (plane, &place) in out.as_mut_slice().iter_mut().zip(&places) {
        let Some(twin) = options.twins.get(place).and_then(Option::as_ref) else { continue };
        let pixels = plane.pixels_mut().iter_mut().zip(twin.pixels()).zip(mask.as_slice());
        pixels.filter(|(_, flag)| !**flag).for_each(|((value, &twin), _)| *value = twin);
    }
    let (estimate, unclipped) = verdicts(samples, mask, options).unzip();
    let limited = vec![Moved::default(); places.len()];
    let set = Set {
        planes: places,
        mask: Arc::clone(mask),
        method: options.method.clone(),
        map: Domain::Linear.map(mask, samples.as_slice()),
        outcome: Outcome::direct(),
        mended: 0,
        guides: Vec::new(),
        gain: None,
        shares: Vec::new(),
        along: None,
        estimate,
        unclipped: unclipped.flatten(),
        exponent: None,
        errors: None,
        weightless: 0,
        smoothed: false,
        settled: Vec::new(),
        copied: true,
    };
    (out, limited, set)
}

/// What is said of the error, if it was asked for, and of that without clipping where samples are clipped.
fn verdicts(samples: &Planes, mask: &Mask, options: &Options<'_>) -> Option<(Verdict, Option<Verdict>)> {
    if options.estimate == Estimate::No {
        return None;
    }
    let share = (10_f64.ln() / Voronoi::new(mask).independent()).min(1.0);
    let bound = |shown: &dyn Fn(f32) -> f32| {
        let square = |plane: &Plane| {
            let measured = plane.pixels().iter().zip(mask.as_slice()).filter(|(_, flag)| **flag);
            let values = measured.map(|(&value, _)| shown(value));
            let (low, high) =
                values.fold((f32::MAX, f32::MIN), |(low, high), value| (low.min(value), high.max(value)));
            (f64::from(high) - f64::from(low)).powi(2)
        };
        let squares: f64 = samples.as_slice().iter().map(square).sum();
        Verdict::AtMost((share * squares / samples.len().max(1) as f64).sqrt())
    };
    let plain = bound(&|value| value);
    if options.values != Values::Light {
        return Some((plain, None));
    }
    let clipped = bound(&|value| value.clamp(0.0, options.peak));
    Some((clipped, (clipped != plain).then_some(plain)))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{Bounds, Size, fill};

    const SIZE: Size = Size { height: 40, width: 50 };

    fn mask() -> Mask {
        Mask::from_fn(SIZE, |y, x| (y * 7 + x * 3).is_multiple_of(5))
    }

    /// An alpha of a thin line over nothing, with soft rims.
    fn alpha() -> Plane {
        Plane::from_fn(SIZE, |y, x| match x as i64 - 12 - (y as i64) / 2 {
            0 | 1 => 1.0,
            -1 | 2 => 0.25 + (y % 3) as f32 / 4.0,
            _ => 0.0,
        })
    }

    fn options(twin: Plane) -> Options<'static> {
        let mut options = Options { values: Values::Other, bounds: vec![Bounds::Unit], ..Options::default() };
        options.estimate = Estimate::Figure;
        options.twins = vec![Some(Arc::new(twin))];
        options
    }

    fn sparse(plane: &Plane) -> Planes {
        let values = plane.pixels().iter().zip(mask().as_slice().to_vec());
        Planes::from(Plane::of(SIZE, values.map(|(&v, flag)| if flag { v } else { 0.0 }).collect()))
    }

    #[test]
    fn a_twin_that_agrees_is_copied_and_bounds_the_error() {
        let filled = fill(&sparse(&alpha()), mask(), &options(alpha())).unwrap();
        assert!(filled.sets[0].copied);
        assert!(filled.planes.as_slice()[0] == alpha());
        let Some(Verdict::AtMost(most)) = filled.sets[0].estimate else { panic!("no bound") };
        assert!((most - (10_f64.ln() / 400.0).sqrt()).abs() < 2e-3, "{most}");
        let plain = Options { twins: Vec::new(), ..options(alpha()) };
        assert!(!fill(&sparse(&alpha()), mask(), &plain).unwrap().sets[0].copied);
    }

    #[test]
    fn one_other_value_and_nothing_is_copied() {
        let first = mask().as_slice().iter().position(|&flag| flag).unwrap();
        let mut other = alpha();
        other.pixels_mut()[first] += 0.125;
        let filled = fill(&sparse(&alpha()), mask(), &options(other)).unwrap();
        let plain = Options { twins: Vec::new(), ..options(alpha()) };
        assert!(!filled.sets[0].copied);
        assert!(filled.planes == fill(&sparse(&alpha()), mask(), &plain).unwrap().planes);
        // Nor is one that has no value where one is missing.
        let mut holes = alpha();
        holes.pixels_mut()[mask().as_slice().iter().position(|&flag| !flag).unwrap()] = f32::NAN;
        assert!(!fill(&sparse(&alpha()), mask(), &options(holes)).unwrap().sets[0].copied);
    }

    #[test]
    fn equality_of_few_or_of_the_same_values_is_no_evidence() {
        let rare = |count: usize| {
            let measured = (0..SIZE.pixels()).filter(|&at| mask().as_slice()[at]);
            let mut plane = Plane::filled(SIZE, 1.0);
            measured.step_by(9).take(count).for_each(|at| plane.pixels_mut()[at] = 0.5);
            plane
        };
        for (count, agree) in [(0, false), (ENOUGH - 1, false), (ENOUGH, true)] {
            assert_eq!(agrees(&mask(), rare(count).pixels(), rare(count).pixels()), agree, "{count}");
        }
    }

    #[test]
    fn a_direction_is_copied_as_a_whole() {
        let planes = [0, 1].map(|k| Plane::from_fn(SIZE, |y, x| ((y * 3 + x * (k + 2)) % 11) as f32 - 5.0));
        let samples = Planes::of(SIZE, planes.to_vec());
        let mut options = options(planes[0].clone());
        (options.values, options.bounds) = (Values::Directions, Vec::new());
        options.twins.push(None);
        assert!(fill(&samples, mask(), &options).unwrap().sets.iter().all(|set| !set.copied));
        options.values = Values::Other;
        let filled = fill(&samples, mask(), &options).unwrap();
        assert_eq!(filled.sets.iter().map(|set| set.copied).collect::<Vec<_>>(), [true, false]);
    }
}
