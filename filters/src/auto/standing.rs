//! What held-out pixels would know of other frames if they were missing ones.
//!
//! Where nothing is carried anywhere and masks complement one another, a missing pixel has a sample of one other frame in its own place, a measured one of none.
//! What other frames are off by then cancels at held-out pixels, between frames before and after, but not at missing ones. So a held-out pixel that
//! measured `y` is given the sample of one of them that it might have,
//!
//! ```text
//! v = y + s (n - y),      s^2 = (M - t O) / D
//! ```
//!
//! with `n` the other frame's own fill there. Around it, `D` is the mean of `(n - y)^2` at measured pixels, `M` the mean square by which samples of the other
//! frame in missing pixels miss this frame's fill, `O` that of held-out samples, and `t` how much less a fill errs at missing pixels: `M - t O` is what
//! the frames differ by, 0 where nothing changes.

use crate::estimate::HeldOut;
use crate::kernel::blur::blur;
use crate::temporal::Carried;
use crate::{Mask, Plane, Planes, Size};
use lacuna_core::hash;

/// Width of the Gaussian of what is around, in spacings of held-out samples.
const SPREAD: f64 = 4.0;
/// What the means over the image count for beside it.
const FRAME: f64 = 0.25;
/// Draws the pixels that get a sample.
const SEED: u64 = 0x57a9;

/// What is known of a frame and of another one that stands on the same pixels.
pub struct Standing<'a> {
    /// The frame's samples.
    pub samples: &'a Planes,
    /// Where they are.
    pub mask: &'a Mask,
    /// The frame's own fill.
    pub filled: &'a Planes,
    /// What it is without the samples that are held out, there.
    pub held: &'a HeldOut,
    /// How much less a fill errs at missing pixels than at held-out ones.
    pub less: f64,
}

impl Standing<'_> {
    /// Adds samples of each other frame at held-out pixels, as many as missing pixels have; `fills` are what the others make of their own.
    pub fn complete(&self, carried: &mut [Carried], fills: &[Planes]) {
        let own = self.around(self.held.at.iter().copied().zip(self.squares()));
        let mut taken = vec![false; self.held.at.len()];
        let mut known = vec![false; self.mask.size().pixels()];
        for (frame, (carried, fill)) in carried.iter_mut().zip(fills).enumerate() {
            let lack = self.lack(carried, &mut known);
            let share = self.share(carried, fill, &own);
            for (i, &at) in self.held.at.iter().enumerate() {
                let drawn = hash(SEED + frame as u64, u64::from(at)) as f64 / u64::MAX as f64;
                if taken[i] || drawn >= lack {
                    continue;
                }
                taken[i] = true;
                let at = at as usize;
                let value = |channel: usize| {
                    let y = self.samples.as_slice()[channel].pixels()[at];
                    y + share[at] * (fill.as_slice()[channel].pixels()[at] - y)
                };
                let values: Vec<f32> = (0..fill.len()).map(value).collect();
                carried.push(at, &values);
            }
        }
    }

    /// The part of missing pixels that has a sample of the other frame, less that of measured ones; of those that no frame before it has shown, as
    /// drawn without regard to these, pixels that some frame shows would stay empty. Then it has shown its own.
    fn lack(&self, carried: &Carried, known: &mut [bool]) -> f64 {
        let before = known.to_vec();
        carried.pixels(self.mask.size()).for_each(|at| known[at] = true);
        let mut counts = [[0_usize; 2]; 2];
        let pixels = self.mask.as_slice().iter().zip(&*known).enumerate();
        for (_, (&own, &other)) in pixels.filter(|(at, _)| !before[*at] && carried.covers(*at)) {
            counts[usize::from(own)][usize::from(other)] += 1;
        }
        let [missing, measured] = counts.map(|[no, yes]| yes as f64 / (no + yes).max(1) as f64);
        (missing - measured).max(0.0)
    }

    /// Of each pixel, what part of the difference of fills is one of the frames.
    fn share(&self, carried: &Carried, fill: &Planes, own: &[f32]) -> Vec<f32> {
        let pixels = || self.mask.as_slice().iter().enumerate();
        let squared = |at: usize, values: &dyn Fn(usize) -> f32| -> f64 {
            let one =
                |(channel, plane): (usize, &Plane)| f64::from(plane.pixels()[at] - values(channel)).powi(2);
            self.filled.as_slice().iter().enumerate().map(one).sum()
        };
        let missed =
            carried.pixels(self.mask.size()).enumerate().filter(|(_, at)| !self.mask.as_slice()[*at]);
        let missed = missed.map(|(i, at)| (at as u32, squared(at, &|channel| carried.value(channel, i))));
        let differs = pixels().filter(|(at, flag)| **flag && carried.covers(*at));
        let differs =
            differs.map(|(at, _)| (at as u32, squared(at, &|channel| fill.as_slice()[channel].pixels()[at])));
        let (missed, differs) = (self.around(missed), self.around(differs));
        let share = |((m, o), d): ((&f32, &f32), &f32)| {
            let changed = f64::from(*m) - self.less * f64::from(*o);
            if changed > 0.0 { (changed / f64::from(*d)).min(1.0).sqrt() as f32 } else { 0.0 }
        };
        missed.iter().zip(own).zip(&differs).map(share).collect()
    }

    /// The squared errors at held-out pixels, the sum over the planes.
    fn squares(&self) -> impl Iterator<Item = f64> {
        let planes = self.samples.len() as f64;
        self.held.squared_errors(self.samples).into_iter().map(move |square| planes * square)
    }

    /// The mean of values at pixels around each one, with that of all of them in its share.
    fn around(&self, values: impl Iterator<Item = (u32, f64)>) -> Vec<f32> {
        let size: Size = self.mask.size();
        let sigma = SPREAD * (size.pixels() as f64 / self.held.at.len().max(1) as f64).sqrt();
        let (mut sums, mut counts) = (vec![0.0_f32; size.pixels()], vec![0.0_f32; size.pixels()]);
        for (at, value) in values {
            sums[at as usize] += value as f32;
            counts[at as usize] += 1.0;
        }
        let all = |values: &[f32]| values.iter().map(|value| f64::from(*value)).sum::<f64>();
        let mean = all(&sums) / all(&counts).max(1.0);
        let (sums, counts) = (blur(size, &sums, sigma), blur(size, &counts, sigma));
        let of = |(sum, count): (&f32, &f32)| {
            let here = if *count > 0.0 { f64::from(*sum) / f64::from(*count) } else { mean };
            (here + FRAME * mean) as f32
        };
        sums.iter().zip(&counts).map(of).collect()
    }
}

#[cfg(test)]
#[allow(clippy::float_cmp, reason = "what does not change is given back to the bit")]
mod tests {
    use super::*;

    const SIZE: Size = Size::new(60, 60);

    fn planes(value: impl Fn(usize, usize) -> f32) -> Planes {
        Planes::new(SIZE, vec![Plane::from_fn(SIZE, value)]).unwrap()
    }

    /// What held-out pixels get of a frame that shows `other`, with what they measured.
    fn given(other: &Planes) -> Vec<(f32, f32)> {
        let truth = planes(|y, x| 0.5 + 0.3 * (0.9 * y as f32 + 0.7 * x as f32).sin());
        let mask = Mask::from_fn(SIZE, |y, x| (y + 2 * x) % 5 == 0);
        let beside = Mask::from_fn(SIZE, |y, x| (y + 2 * x) % 5 != 0);
        let at: Vec<u32> = (0..3600).filter(|&at| mask.as_slice()[at as usize] && at % 3 == 0).collect();
        let rough = |at: &u32| {
            truth.as_slice()[0].pixels()[*at as usize] + if at.is_multiple_of(2) { 0.1 } else { -0.1 }
        };
        let predicted = vec![at.iter().map(rough).collect()];
        let held = HeldOut { at, predicted, variance: Vec::new() };
        let place = |at: usize| [(at / 60) as f32, (at % 60) as f32];
        let mut carried = [Carried::new(SIZE, (other, &beside), 1, place).unwrap()];
        let before = carried[0].len();
        let standing = Standing { samples: &truth, mask: &mask, filled: &truth, held: &held, less: 0.5 };
        standing.complete(&mut carried, std::slice::from_ref(other));
        let pixels: Vec<usize> = carried[0].pixels(SIZE).collect();
        let all = (before..carried[0].len()).map(|i| (carried[0].value(0, i), pixels[i]));
        all.map(|(value, at)| (value, truth.as_slice()[0].pixels()[at])).collect()
    }

    #[test]
    fn a_frame_that_shows_the_same_gives_what_was_measured() {
        let same = given(&planes(|y, x| 0.5 + 0.3 * (0.9 * y as f32 + 0.7 * x as f32).sin()));
        assert!(same.len() > 200 && same.iter().all(|(given, measured)| given == measured));
    }

    /// Each shows half of the missing pixels, and both show all.
    #[test]
    fn what_some_frame_shows_of_missing_pixels_is_given_to_held_out_ones() {
        let truth = planes(|y, x| 0.5 + 0.01 * (y + x) as f32);
        let mask = Mask::from_fn(SIZE, |y, x| (y + 2 * x) % 5 == 0);
        let at: Vec<u32> = (0..3600).filter(|&at| mask.as_slice()[at as usize] && at % 3 == 0).collect();
        let predicted = vec![vec![0.0; at.len()]];
        let held = HeldOut { at, predicted, variance: Vec::new() };
        let place = |at: usize| [(at / 60) as f32, (at % 60) as f32];
        let mut carried = [1, 3].map(|first| {
            let beside = Mask::from_fn(SIZE, |y, x| (first..first + 2).contains(&((y + 2 * x) % 5)));
            Carried::new(SIZE, (&truth, &beside), 1, place).unwrap()
        });
        let count = |carried: &[Carried]| carried.iter().map(Carried::len).sum::<usize>();
        let before = count(&carried);
        let standing = Standing { samples: &truth, mask: &mask, filled: &truth, held: &held, less: 0.5 };
        standing.complete(&mut carried, &[truth.clone(), truth.clone()]);
        assert_eq!(count(&carried) - before, held.at.len());
    }

    #[test]
    fn a_frame_that_shows_something_else_gives_that() {
        let other = given(&planes(|y, x| 1.5 + 0.3 * (0.9 * y as f32 + 0.7 * x as f32).sin()));
        assert!(other.iter().all(|(given, measured)| (given - measured - 1.0).abs() < 0.01));
    }
}
