//! What held-out samples show of a method on a frame, at two depths.

use std::sync::Arc;

use super::held_out::{DEEP, Folds, HeldOut, ReconstructPart};
use super::repetition::{Repetition, Rounds};
use super::simulation::Simulation;
use crate::descriptor::Kind;
use crate::{Error, Mask, Planes, Run};

/// What held-out samples show of a method on a frame.
#[derive(Clone, Debug, PartialEq)]
pub struct Evidence {
    /// The variance that goes with the method.
    pub kind: Kind,
    /// Few samples held out at a time.
    pub near: HeldOut,
    /// Pixels that were held out at two depths: with few others, and with half of them. Empty where there are too few samples.
    pub pairs: [HeldOut; 2],
    /// The part of the squared error that goes by the pattern of the samples, the frame's alone: 1 unless samples of other frames are taken, too.
    pub own: f64,
    /// Variance of the logarithm of squared errors, as they were held out on tiles; 0 if on all of the frame.
    pub by_tiles: f64,
    /// What both errors are on an image that is known.
    pub simulation: Option<Simulation>,
    /// What choosing the pixels once more passed over, where they were chosen in rounds.
    pub repetition: Option<Repetition>,
}

impl Evidence {
    /// Holds out a tenth of the samples, several times where the frame has few, and half of them; simulates what was `filled`, if that is
    /// given, by the same method.
    ///
    /// # Errors
    /// Those of the method.
    pub fn of_folds(
        (samples, mask): (&Planes, &Mask),
        filled: Option<&Planes>,
        (folds, kind): (Folds, Kind),
        rounds: Rounds<'_>,
        reconstruct: &mut ReconstructPart<'_>,
        run: &Run<'_>,
    ) -> Result<Self, Error> {
        let mut near = HeldOut::default();
        let mut all = |samples: &Planes, kept: &Arc<Mask>| reconstruct(None, samples, kept);
        for parts in folds.near(mask.count()) {
            let fold = folds.fold(mask, [parts.clone(), parts]);
            near.extend(HeldOut::new(samples, &fold, Some(kind), &mut all)?);
        }
        let deep = HeldOut::deep((samples, mask), folds, kind, filled.is_none(), reconstruct)?;
        let mut own = Self::new(kind, folds, &near, &near, &deep);
        if let Some(filled) = filled {
            own.known((samples, mask), filled, (folds, rounds), reconstruct, run)?;
        }
        Ok(own)
    }

    /// Adds what the same method shows on an image that is known, what was `filled`.
    ///
    /// # Errors
    /// Those of the method.
    pub fn known(
        &mut self,
        (samples, mask): (&Planes, &Mask),
        filled: &Planes,
        (folds, rounds): (Folds, Rounds<'_>),
        reconstruct: &mut ReconstructPart<'_>,
        run: &Run<'_>,
    ) -> Result<(), Error> {
        // What overflowed has no samples.
        if !filled.are_finite() {
            return Ok(());
        }
        self.simulation = Simulation::new(mask, filled, folds, reconstruct)?;
        self.repetition =
            Repetition::new((samples, mask), filled, (folds, &self.near), rounds, reconstruct, run)?;
        Ok(())
    }

    /// Of predictions from the folds [`Folds::near`], and of a method of the same kind at both depths.
    pub fn new(kind: Kind, folds: Folds, near: &HeldOut, shallow: &HeldOut, deep: &HeldOut) -> Self {
        let near = near.sorted(|_| true);
        let mut pairs =
            [shallow, deep].map(|held| held.sorted(|pixel| DEEP.contains(&folds.part(pixel as usize))));
        let both = pairs.clone();
        for (own, other) in pairs.iter_mut().zip(both.iter().rev()) {
            *own = own.sorted(|pixel| other.at.binary_search(&pixel).is_ok());
        }
        Self { kind, near, pairs, own: 1.0, by_tiles: 0.0, simulation: None, repetition: None }
    }

    /// The squared error at samples that are held out with half of the others over that at the same with few of them.
    pub(super) fn growth(&self, truth: &Planes) -> Option<f64> {
        let [near, deep] = self.pairs.each_ref().map(|held| {
            held.squared_errors(truth).into_iter().filter(|error| error.is_finite()).sum::<f64>()
        });
        (near > 0.0).then(|| deep / near)
    }

    /// Takes predictions from the domain in which they were made to that of the result: `f(channel, value)`.
    pub fn map(&mut self, f: impl Fn(usize, f32) -> f32) {
        self.near.map(&f);
        self.pairs.iter_mut().for_each(|held| held.map(&f));
        self.simulation.iter_mut().for_each(|simulation| simulation.map(&f));
        self.repetition.iter_mut().for_each(|repetition| repetition.map(&f));
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::estimate::Repeated;
    use crate::excerpt::Excerpt;
    use crate::{Plane, Size};

    #[test]
    fn no_prediction_sees_its_own_sample() {
        let size = Size::new(30, 40);
        let mask = Mask::from_fn(size, |row, column| (row + 2 * column) % 3 == 0);
        let samples = Planes::new(size, vec![Plane::from_fn(size, |y, x| (y * 40 + x) as f32)]).unwrap();
        // A method that shows what it was given: the sample itself, or -1 at missing pixels.
        let mut fill = |_: Option<&Excerpt>, samples: &Planes, kept: &Arc<Mask>| {
            let plane = &samples.as_slice()[0];
            Planes::new(
                size,
                vec![Plane::from_fn(size, |y, x| if kept.is_measured(y, x) { plane.at(y, x) } else { -1.0 })],
            )
        };
        let evidence = Evidence::of_folds(
            (&samples, &mask),
            None,
            (Folds { seed: 3 }, Kind::Distance),
            Rounds { repeated: &Repeated::default(), are_colours: true },
            &mut fill,
            &Run::default(),
        )
        .unwrap();
        assert_eq!(evidence.near.at.len(), mask.count());
        assert!(evidence.near.at.is_sorted());
        let [near, deep] = &evidence.pairs;
        assert_eq!(near.at, deep.at);
        for held in [&evidence.near, near, deep] {
            assert!(held.predicted[0].iter().all(|&value| value == -1.0));
        }
        let farther = near.variance.iter().zip(&deep.variance).filter(|(a, b)| a <= b).count();
        assert!(farther > near.at.len() * 9 / 10);
    }
}
