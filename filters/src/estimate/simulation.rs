//! The fill simulated on an image that is known everywhere: what held-out samples say too much there, they say too much of the frame.
//!
//! The filled frame is decimated: one pixel of every `s x s`, `s` the spacing of its samples (in whole pixels, at least 2). What was filled is
//! smooth up to about that spacing, so the smaller image has details as fine beside it as those that the frame may have. It is filled by the same
//! method, from the pixels that the middle of the same mask names, and once more without a part of them. So both errors are known, at missing
//! pixels and at held-out samples, and their quotient ([`Simulation::factor`]) is taken for that of the frame: no law is asked how error
//! follows distance.
//!
//! Only for masks whose samples lie evenly: there a held-out sample stands in an emptier place than any missing pixel. At random samples both
//! stand alike, and the quotient is little beside the chance of a smaller image.
//!
//! Noise is not in the filled frame. It makes errors alike everywhere, in empty places and at missing pixels: so where half of the samples are held out,
//! errors of detail grow by the factor `g` that the smaller image shows, and those of noise do not. With `g'` the growth on the frame, a share
//! `d = (g' - 1) / (g - 1)` of the squared error is detail, and `1 - d` of it stays at missing pixels. As `g'` is off by a tenth by chance, the
//! largest that it may be is taken: nothing is called noise without need.
//!
//! Source: B. Efron, "Bootstrap methods: another look at the jackknife", The Annals of Statistics 7, 1979.

use std::sync::Arc;

use super::held_out::{Folds, HeldOut, ReconstructPart, pick};
use super::voronoi::Voronoi;
use crate::excerpt::Excerpt;
use crate::variational::guided;
use crate::{Error, Mask, Planes, Size};

/// Pixels of the frame, along each side, of which one is taken: so many at least.
const LEAST_STEP: usize = 2;
/// Fewer samples of the smaller image tell nothing; guides count for none of its fills, or for all.
const FEWEST: usize = guided::FEWEST;
/// Held-out samples that are enough: chance among them is little beside what a smaller image may do otherwise.
const ENOUGH: usize = 1500;
/// Errors that grow by less than this where half of the samples are held out do not tell noise from detail.
const LEAST_GROWTH: f64 = 1.2;
/// By how much the growth of errors is off by chance, over itself.
const GROWTH_OFF: f64 = 0.1;
/// Larger images are cut to this many pixels a side.
const SIDE: usize = 384;

/// One pixel of every `s x s` of a frame, if its samples lie evenly and are many enough.
fn decimated(frame: &Mask) -> Option<Excerpt> {
    let from = frame.size();
    let step = (frame.density().sqrt().recip().round() as usize).max(LEAST_STEP);
    let side = |length: usize| (length / step).min(SIDE);
    let size = Size::new(side(from.height), side(from.width));
    let (top, left) = ((from.height - size.height) / 2, (from.width - size.width) / 2);
    let mask = Mask::from_fn(size, |row, column| frame.is_measured(top + row, left + column));
    let fits = mask.count() >= FEWEST && !mask.is_full() && !Voronoi::new(&mask).is_uneven();
    let of = |at: usize, length: usize, from: usize| (from - step * length) / 2 + step * at + step / 2;
    let source = |row, column| (of(row, size.height, from.height), of(column, size.width, from.width));
    fits.then(|| Excerpt::new(mask, from, source))
}

/// An image that is known, and what a method makes of some of its pixels.
#[derive(Clone, Debug, PartialEq)]
pub struct Simulation {
    truth: Planes,
    held: HeldOut,
    missing: HeldOut,
    /// Predicted without half of the samples.
    deep: HeldOut,
}

impl Simulation {
    /// Fills the decimated frame by a method, without and with samples held out; nothing where its samples are not for it.
    ///
    /// # Errors
    /// Those of the method.
    pub fn new(
        frame: &Mask,
        filled: &Planes,
        folds: Folds,
        reconstruct: &mut ReconstructPart<'_>,
    ) -> Result<Option<Self>, Error> {
        let Some(excerpt) = decimated(frame) else { return Ok(None) };
        let mask = &excerpt.mask;
        let truth = excerpt.planes(filled);
        let mut reconstruct = |samples: &Planes, kept: &Arc<Mask>| reconstruct(Some(&excerpt), samples, kept);
        let again = reconstruct(&truth, mask)?;
        let at: Vec<u32> =
            (0..).zip(mask.as_slice()).filter(|(_, flag)| !**flag).map(|(pixel, _)| pixel).collect();
        let missing = HeldOut { predicted: pick(&again, &at), at, variance: Vec::new() };
        let mut held = HeldOut::default();
        for parts in Folds::of_enough(mask.count(), ENOUGH) {
            let fold = folds.fold(mask, [parts.clone(), parts]);
            held.extend(HeldOut::new(&truth, &fold, None, &mut reconstruct)?);
        }
        let deep = folds.fold(mask, Folds::deep(mask.count()));
        let deep = HeldOut::new(&truth, &deep, None, &mut reconstruct)?;
        Ok(Some(Self { truth, held, missing, deep }))
    }

    /// Takes all values to another domain: `f(channel, value)`.
    pub fn map(&mut self, f: &impl Fn(usize, f32) -> f32) {
        self.held.map(f);
        self.missing.map(f);
        self.deep.map(f);
        for (channel, plane) in self.truth.as_mut_slice().iter_mut().enumerate() {
            plane.pixels_mut().iter_mut().for_each(|value| *value = f(channel, *value));
        }
    }

    /// The logarithm of the squared error of missing pixels over that of held-out samples, and its variance by chance; nothing where
    /// there is no error. `growth` is the squared error at samples that are held out with half of the others over that with few of them, on the frame.
    pub fn factor(&self, growth: Option<f64>) -> Option<(f64, f64)> {
        let mean = |held: &HeldOut| {
            let (mut sum, mut squares) = (0.0, 0.0);
            let errors = held.squared_errors(&self.truth);
            for &error in &errors {
                sum += error;
                squares += error * error;
            }
            (sum / errors.len().max(1) as f64, squares / (sum * sum))
        };
        let ((held, by_chance), (missing, less)) = (mean(&self.held), mean(&self.missing));
        let (plain, by_chance) = (missing / held, by_chance + less);
        let found = match (growth, self.growth()) {
            (Some(growth), Some(own)) => {
                let carried = |growth: f64| {
                    let detail = ((growth - 1.0) / (own - 1.0)).clamp(0.0, 1.0);
                    (detail * plain + 1.0 - detail).ln()
                };
                let (least, most) = (carried(growth), carried(growth * (1.0 + GROWTH_OFF)));
                (most, by_chance + (most - least).powi(2))
            }
            _ => (plain.ln(), by_chance),
        };
        (found.0.is_finite() && found.1.is_finite()).then_some(found)
    }

    /// By how much held-out errors grow where half of the samples are held out; nothing if hardly.
    fn growth(&self) -> Option<f64> {
        let sum = |own: &HeldOut, wanted: &[u32]| -> f64 {
            let both = own.sorted(|pixel| wanted.binary_search(&pixel).is_ok());
            both.squared_errors(&self.truth).into_iter().sum()
        };
        let held = self.held.sorted(|_| true);
        let growth = sum(&self.deep, &held.at) / sum(&held, &self.deep.at);
        (growth > LEAST_GROWTH).then_some(growth)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::Plane;
    use crate::sampling::{Field, Pattern, Temporal, mask as generate};

    fn mask(pattern: Pattern, size: Size, density: f64) -> Mask {
        generate(pattern, Field { x: 0, y: 0, size }, density, 5, Temporal::Fixed, 0).unwrap()
    }

    #[test]
    fn only_even_masks_have_a_stage() {
        let size = Size::new(101, 140);
        let excerpt = decimated(&mask(Pattern::Shuffle, size, 0.2)).unwrap();
        assert_eq!(excerpt.mask.size(), Size::new(50, 70));
        assert!((excerpt.mask.density() - 0.2).abs() < 0.01);
        // Each pixel of it is another one of the frame, two apart.
        let of = |pixel| (excerpt.source(pixel) / 140, excerpt.source(pixel) % 140);
        assert_eq!((of(0), of(1), of(70)), ((1, 1), (1, 3), (3, 1)));
        assert_eq!(of(50 * 70 - 1), (99, 139));
        assert!(decimated(&mask(Pattern::Random, size, 0.2)).is_none());
        assert!(decimated(&mask(Pattern::Shuffle, Size::new(30, 30), 0.2)).is_none());
        assert!(decimated(&mask(Pattern::Shuffle, size, 1.0)).is_none());
        let sparse = decimated(&mask(Pattern::Shuffle, Size::new(300, 300), 0.06)).unwrap();
        assert_eq!((sparse.mask.size(), sparse.source(0)), (Size::new(75, 75), 2 * 300 + 2));
        // What is larger is cut from the middle.
        let excerpt = decimated(&mask(Pattern::Shuffle, Size::new(60, 1200), 0.2)).unwrap();
        assert_eq!(excerpt.mask.size(), Size::new(30, 384));
        assert_eq!(excerpt.source(0), 1200 + (1200 - 768) / 2 + 1);
        assert_eq!(excerpt.source(383), 1200 + 1200 - (1200 - 768) / 2 - 1);
    }

    /// A method that errs more where samples are held out.
    #[test]
    fn the_factor_is_that_of_errors_which_are_known() {
        let size = Size::new(120, 120);
        let frame = mask(Pattern::Shuffle, size, 0.25);
        let excerpt = decimated(&frame).unwrap();
        let all = excerpt.mask.count();
        let filled = Planes::of(size, vec![Plane::from_fn(size, |y, x| (y + x) as f32)]);
        // Off by 2 everywhere with all samples, by 6 with some held out.
        let mut method = |_: Option<&Excerpt>, samples: &Planes, kept: &Arc<Mask>| {
            let off = if kept.count() == all { 2.0 } else { 6.0 };
            let plane = &samples.as_slice()[0];
            let value = |y, x| plane.at(y, x) + if kept.is_measured(y, x) { 0.0 } else { off };
            Planes::new(plane.size(), vec![Plane::from_fn(plane.size(), value)])
        };
        let mut found = Simulation::new(&frame, &filled, Folds::default(), &mut method).unwrap().unwrap();
        assert_eq!(found.truth.as_slice()[0].at(3, 5), 7.0 + 11.0);
        let (factor, by_chance) = found.factor(None).unwrap();
        assert!((factor - (4.0_f64 / 36.0).ln()).abs() < 1e-6, "{factor}");
        // Errors that are all alike leave to chance only how many there are.
        let parts = (all as f64).recip() + ((excerpt.mask.size().pixels() - all) as f64).recip();
        assert!((by_chance - parts).abs() < 1e-6, "{by_chance}");
        found.map(&|_, value| 0.5 * value);
        assert!((found.factor(None).unwrap().0 - factor).abs() < 1e-6);
        found.map(&|_, _| 1.0);
        assert!(found.factor(None).is_none());
    }

    /// A method whose squared error is twice as large without half of the samples, and half as large with all.
    #[test]
    fn errors_that_do_not_grow_stay_at_missing_pixels() {
        let size = Size::new(160, 160);
        let frame = mask(Pattern::Shuffle, size, 0.25);
        let all = decimated(&frame).unwrap().mask.count();
        let filled = Planes::of(size, vec![Plane::from_fn(size, |y, x| (y + x) as f32)]);
        let mut method = |_: Option<&Excerpt>, samples: &Planes, kept: &Arc<Mask>| {
            let off = match kept.count() {
                count if count == all => 1.0,
                count if 3 * count > 2 * all => f32::sqrt(2.0),
                _ => 2.0,
            };
            let plane = &samples.as_slice()[0];
            let value = |y, x| plane.at(y, x) + if kept.is_measured(y, x) { 0.0 } else { off };
            Planes::new(plane.size(), vec![Plane::from_fn(plane.size(), value)])
        };
        let found = Simulation::new(&frame, &filled, Folds::default(), &mut method).unwrap().unwrap();
        assert!((found.growth().unwrap() - 2.0).abs() < 1e-5);
        let factor = |growth: f64| found.factor(Some(growth / (1.0 + GROWTH_OFF))).unwrap();
        // All detail, half of it, none.
        for (growth, right) in [(2.5, 0.5_f64), (2.0, 0.5), (1.5, 0.75), (1.0, 1.0)] {
            assert!((factor(growth).0 - right.ln()).abs() < 1e-5, "{growth}");
        }
        assert!(factor(1.5).1 > factor(2.5).1);
    }
}
