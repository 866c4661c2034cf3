//! Planes that need no method, because a complete plane, their twin, holds their values: missing pixels take its own.
//!
//! Nobody writes down that a complete plane is of the same samples as a sparse one, and by a name alone it may be of other ones (fewer samples a
//! pixel, longer steps). So it is told from the values: all measured ones must be equal, and [`ENOUGH`] of them others than the most frequent one.
//!
//! Error: equal samples show none, and how many of the other pixels differ they do not tell: those may be of places that no sample
//! has met. So no figure is told.

use std::sync::Arc;

use super::{Options, Set, Values};
use crate::complete::is_complete;
use crate::domain::Domain;
use crate::limiter::Moved;
use crate::{Bounds, Mask, Outcome, Planes};

/// Measured values other than the most frequent one, without which equality says nothing.
const ENOUGH: usize = 16;

/// Whether a complete plane holds the values of a sparse one, told from its pixels: whether each is measured, its value, and the complete one. They
/// are equal where measured, which suffices to tell, and elsewhere such as a fill may leave: within the bounds, and infinite only if a
/// measured one is. NaN stands for what the sparse one's type cannot hold.
pub fn agrees(pixels: impl Iterator<Item = (bool, f32, f32)> + Clone, bounds: Bounds) -> bool {
    let measured = pixels.clone().filter(|(flag, ..)| *flag);
    let (mut least, mut most) = (f32::INFINITY, f32::NEG_INFINITY);
    let equal = measured.clone().all(|(_, sample, twin)| {
        (least, most) = (least.min(sample), most.max(sample));
        sample == twin
    });
    let (low, high) = bounds.around((least, most));
    let may = |twin: f32| (low..=high).contains(&twin) && (twin.is_finite() || twin == least || twin == most);
    let mut missing = pixels.filter(|(flag, ..)| !*flag);
    if !equal || !missing.all(|(.., twin)| may(twin)) {
        return false;
    }
    // The majority, if there is one, is what is left of a vote (R. Boyer, J. Moore).
    let vote = |(leader, votes), value| match votes {
        0 => (value, 1),
        votes if value == leader => (leader, votes + 1),
        votes => (leader, votes - 1),
    };
    let measured = measured.map(|(_, sample, _)| sample);
    let (leader, _) = measured.clone().fold((0.0_f32, 0_usize), vote);
    measured.filter(|&value| value != leader).take(ENOUGH).count() == ENOUGH
}

/// Which planes take their missing values from their twins; of directions all or none, as their length is that of all.
pub fn copied(samples: &Planes, masks: &[Arc<Mask>], options: &Options<'_>) -> Vec<bool> {
    let keeps = options.keeps_measured();
    let holds = |at: usize| {
        let (mask, samples) = (&masks[at], samples.as_slice()[at].pixels());
        let twin = options.twins.get(at).and_then(Option::as_ref);
        let Some(twin) = twin.filter(|_| keeps && !mask.is_full()) else { return false };
        let pixels = mask.as_slice().iter().zip(samples).zip(twin.pixels());
        let pixels = pixels.map(|((&flag, &sample), &twin)| (flag, sample, twin));
        options.known || (agrees(pixels, options.bounds_of(at)) && is_complete(&[&**twin][..], mask))
    };
    let mut found: Vec<bool> = (0..samples.len()).map(holds).collect();
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
        estimate: None,
        unclipped: None,
        exponent: None,
        errors: None,
        weightless: 0,
        smoothed: false,
        settled: Vec::new(),
        copied: true,
    };
    (out, limited, set)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::fill::Estimate;
    use crate::{Plane, Size, fill};

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
    fn a_twin_that_agrees_is_copied_without_a_figure() {
        let filled = fill(&sparse(&alpha()), mask(), &options(alpha())).unwrap();
        assert!(filled.sets[0].copied);
        assert!(filled.planes.as_slice()[0] == alpha());
        assert_eq!(filled.sets[0].estimate, None);
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
        // Unless that was compared before, with more than is here.
        let known = Options { known: true, ..options(alpha()) };
        assert!(fill(&sparse(&Plane::filled(SIZE, 1.0)), mask(), &known).unwrap().sets[0].copied);
    }

    #[test]
    fn a_twin_beyond_what_may_be_filled_is_none() {
        let missing = mask().as_slice().iter().position(|&flag| !flag).unwrap();
        let copied = |value: f32, values: Values, bounds: Vec<Bounds>| {
            let mut twin = alpha();
            twin.pixels_mut()[missing] = value;
            let options = Options { values, bounds, ..options(twin) };
            fill(&sparse(&alpha()), mask(), &options).unwrap().sets[0].copied
        };
        for (value, [alpha, light, other]) in [
            (0.75, [true; 3]),
            (1.5, [false, true, true]),
            (-0.25, [false, false, true]),
            (f32::INFINITY, [false; 3]),
            (f32::NAN, [false; 3]),
        ] {
            assert_eq!(copied(value, Values::Other, vec![Bounds::Unit]), alpha, "{value}");
            assert_eq!(copied(value, Values::Light, Vec::new()), light, "{value}");
            assert_eq!(copied(value, Values::Other, Vec::new()), other, "{value}");
        }
    }

    #[test]
    fn infinities_are_where_some_were_measured() {
        let pixels = |measured: f32, missing: f32| {
            let all = (0..40).map(|at| (true, at as f32, at as f32));
            agrees(all.chain([(true, measured, measured), (false, 0.0, missing)]), Bounds::Free)
        };
        assert!(pixels(f32::INFINITY, f32::INFINITY) && pixels(f32::INFINITY, 3.0));
        assert!(!pixels(3.0, f32::INFINITY) && !pixels(f32::INFINITY, f32::NEG_INFINITY));
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
            let (mask, plane) = (mask(), rare(count));
            let pixels =
                mask.as_slice().iter().zip(plane.pixels()).map(|(&flag, &value)| (flag, value, value));
            assert_eq!(agrees(pixels, Bounds::Free), agree, "{count}");
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
