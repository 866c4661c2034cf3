//! The frames beside one, filled along with all others, and seen from it.
//!
//! Of the same samples, a frame and the one beside it make images whose errors have little in common: each has its own samples exactly, and those of all
//! others between its pixels. So the samples of all frames are carried on into the frame before and the one after, which are filled there along with
//! them ([`pull`]); the mean of both is taken where the pixels of this frame lie in them.
//!
//! Where they lie is known at the other frame's samples, whose places in this one are; a pixel that has none takes the shift of the nearest one, and
//! a Gaussian of [`SMOOTH`] pixels goes over the shifts. By exact depths instead nothing was gained.
//!
//! Cost: two fills and two pulls. Fails: where brightness changes, unless it does so evenly from the frame before to the one after.

use std::sync::Arc;

use lacuna_core::parallel::prelude::*;

use super::carried::{is_inside, pixel};
use super::{Carried, Pull, Pulling, Taps, pull};
use crate::baseline::nearest::NearestMap;
use crate::kernel::blur::blur;
use crate::{Error, Mask, Planes, Run, Size};

/// Standard deviation of the Gaussian over the shifts, in pixels.
const SMOOTH: f64 = 1.0;
/// Samples without which a frame shows nothing by itself.
const FEWEST: usize = 64;
/// Pixels that one task takes.
const PIECE: usize = 1 << 14;

/// A frame beside this one, on its own.
pub(crate) struct Beside {
    /// Its place among those that are carried here.
    at: usize,
    /// Its samples that are carried here.
    mask: Mask,
    /// What it makes of them.
    image: Planes,
}

/// The nearest frame before and the nearest one after; `fill` makes images of their samples, whose first pixel has this row and column here.
pub(crate) fn beside(
    carried: &[Carried],
    mut fill: impl FnMut(&Planes, &Arc<Mask>, [i64; 2]) -> Result<Planes, Error>,
) -> Result<Vec<Beside>, Error> {
    let nearest = |later: bool| {
        let side = |(_, one): &(usize, &Carried)| one.len() >= FEWEST && (one.offset > 0) == later;
        carried.iter().enumerate().filter(side).min_by_key(|(_, one)| one.distance()).map(|(at, _)| at)
    };
    let one = |at: usize| {
        let (samples, mask) = carried[at].at_home();
        let mask = Arc::new(mask);
        let image = if mask.is_full() { samples } else { fill(&samples, &mask, carried[at].corner())? };
        Ok(Beside { at, mask: Arc::unwrap_or_clone(mask), image })
    };
    [false, true].into_iter().filter_map(nearest).map(one).collect()
}

/// What these frames become along with all others and with this one: their mean at each of its missing pixels; `alone` where neither shows it.
pub(crate) fn seen(
    (samples, mask, alone): (&Planes, &Mask, &Planes),
    (beside, carried): (&[Beside], &[Carried]),
    (by, roughly): (Pull, bool),
    run: &Run<'_>,
) -> Result<Planes, Error> {
    let filled = |own: &Beside| View::new((samples, mask), (own, carried), (by, roughly), run);
    let views = beside.iter().filter(|own| !carried[own.at].is_empty()).map(filled);
    let views = views.collect::<Result<Vec<_>, _>>()?;
    let mut out = alone.clone();
    for (channel, (out, samples)) in out.as_mut_slice().iter_mut().zip(samples.as_slice()).enumerate() {
        out.pixels_mut().par_chunks_mut(PIECE).enumerate().for_each(|(piece, out)| {
            for (k, out) in out.iter_mut().enumerate() {
                let shown = views.iter().filter_map(|view| view.of(channel, piece * PIECE + k));
                let (sum, count) = shown.fold((0.0, 0.0), |(sum, count), value| (sum + value, count + 1.0));
                if count > 0.0 {
                    *out = sum / count;
                }
            }
        });
        mask.restore(samples, out);
    }
    Ok(out)
}

/// Another frame, filled along with all that are known.
struct View {
    image: Planes,
    shifts: Shifts,
}

impl View {
    fn new(
        (samples, mask): (&Planes, &Mask),
        (own, carried): (&Beside, &[Carried]),
        (by, roughly): (Pull, bool),
        run: &Run<'_>,
    ) -> Result<Self, Error> {
        let (size, offset) = (own.mask.size(), carried[own.at].offset);
        let shifts = Shifts::new(mask.size(), &carried[own.at])?;
        let this = Carried::new(size, (samples, mask), -offset, |at| shifts.of_pixel(at))?;
        let others = carried.iter().enumerate().filter(|(at, _)| *at != own.at);
        let others = others.map(|(_, one)| one.carried_on(size, offset, |place| shifts.of(place)));
        let all: Vec<Carried> = [this].into_iter().chain(others).collect();
        let pulling = Pulling { carried: &all, fills: &[], pull: by, weights: None, roughly, first: None };
        let (image, _) = pull(&own.mask, &pulling, &own.image, run);
        Ok(Self { image, shifts })
    }

    /// What it shows of a pixel of this frame, if anything.
    fn of(&self, channel: usize, pixel: usize) -> Option<f32> {
        let (size, [y, x]) = (self.image.size(), self.shifts.of_pixel(pixel));
        is_inside(size, [y, x]).then(|| Taps::new(size, y, x).of(&self.image.as_slice()[channel]))
    }
}

/// How far from each pixel of this frame what it shows lies in another one.
struct Shifts {
    size: Size,
    rows: Vec<f32>,
    columns: Vec<f32>,
}

impl Shifts {
    fn new(size: Size, other: &Carried) -> Result<Self, Error> {
        let [mut rows, mut columns, mut counts] = [(); 3].map(|()| vec![0.0_f32; size.pixels()]);
        for ((at, [y, x]), home) in other.pixels(size).zip(&*other.places).zip(&*other.home) {
            let (home, width) = (*home as usize, other.home_size().width);
            rows[at] += (home / width) as f32 - y;
            columns[at] += (home % width) as f32 - x;
            counts[at] += 1.0;
        }
        let known = Mask::of(size, counts.iter().map(|count| *count > 0.0).collect());
        let nearest = NearestMap::new(&known)?;
        // Less at the border, beyond which nothing lies.
        let around = blur(size, &vec![1.0; size.pixels()], SMOOTH);
        let smooth = |sums: &[f32]| {
            let shift = |&at: &u32| sums[at as usize] / counts[at as usize];
            let mut all = blur(size, &nearest.as_slice().par_iter().with_min_len(PIECE).map(shift), SMOOTH);
            all.iter_mut().zip(&around).for_each(|(shift, around)| *shift /= around);
            all
        };
        Ok(Self { size, rows: smooth(&rows), columns: smooth(&columns) })
    }

    /// Where a pixel lies in the other frame.
    fn of_pixel(&self, pixel: usize) -> [f32; 2] {
        self.of([(pixel / self.size.width) as f32, (pixel % self.size.width) as f32])
    }

    /// Where a place in this frame lies in the other one.
    fn of(&self, [y, x]: [f32; 2]) -> [f32; 2] {
        let at = pixel(self.size, [y, x]);
        [y + self.rows[at], x + self.columns[at]]
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::temporal::Changes;
    use crate::{Filter, Plane, Problem};

    const SIZE: Size = Size::new(60, 70);
    const BY: Pull = Pull { weight: 60.0, changes: Changes::Linear };

    /// Waves, moved by so many pixels.
    fn scene([dy, dx]: [f32; 2]) -> Planes {
        let value = |y: usize, x: usize| {
            let (y, x) = (y as f32 - dy, x as f32 - dx);
            0.5 + 0.2 * (0.9 * y).sin() * (0.8 * x).cos() + 0.1 * (0.3 * x - 0.4 * y).sin()
        };
        Planes::new(SIZE, vec![Plane::from_fn(SIZE, value)]).unwrap()
    }

    /// The frame `offset` frames later, whose pattern has moved by `shift`.
    fn frame(offset: i32, shift: [f32; 2], measured: impl Fn(usize) -> bool) -> Carried {
        let mask = Mask::from_fn(SIZE, |y, x| measured(y * SIZE.width + x));
        let place = |at: usize| [(at / SIZE.width) as f32 - shift[0], (at % SIZE.width) as f32 - shift[1]];
        Carried::new(SIZE, (&scene(shift), &mask), offset, place).unwrap()
    }

    fn spline(samples: &Planes, mask: &Arc<Mask>, _: [i64; 2]) -> Result<Planes, Error> {
        let (mut out, run) = (Planes::zeros(samples.size(), samples.len()), Run::default());
        let plan =
            crate::variational::ss::Settings::default().plan(&Problem::fill(Arc::clone(mask)), &run)?;
        plan.reconstruct(samples, &mut out, &run)?;
        Ok(out)
    }

    #[test]
    fn a_motion_that_is_the_same_everywhere_is_that_of_every_pixel() {
        let shift = [1.3, -2.6];
        let shifts = Shifts::new(SIZE, &frame(2, shift, |at| at.is_multiple_of(7))).unwrap();
        for place in [[0.0, 0.0], [59.0, 69.0], [0.0, 69.0], [31.25, 40.5]] {
            let [y, x] = shifts.of(place);
            // Sums of 81 weights around 1, of differences of places up to 70.
            let tolerance = 100.0 * 70.0 * f32::EPSILON;
            assert!(
                (y - place[0] - shift[0]).abs() < tolerance && (x - place[1] - shift[1]).abs() < tolerance
            );
        }
    }

    #[test]
    fn complete_frames_that_moved_by_whole_pixels_show_the_frame_and_nothing_beyond_them() {
        let (truth, mask) = (scene([0.0; 2]), Mask::from_fn(SIZE, |y, x| (y + 2 * x) % 5 == 0));
        let carried = [frame(-1, [0.0, 5.0], |_| true)];
        let own = beside(&carried, spline).unwrap();
        let alone = Planes::zeros(SIZE, 1);
        let image = seen((&truth, &mask, &alone), (&own, &carried), (BY, false), &Run::default()).unwrap();
        for at in 0..SIZE.pixels() {
            let (value, truth) = (image.as_slice()[0].pixels()[at], truth.as_slice()[0].pixels()[at]);
            let shown = at % SIZE.width + 5 < SIZE.width;
            let expected = if shown || mask.as_slice()[at] { truth } else { 0.0 };
            assert!((value - expected).abs() < 1e-5, "{at}: {value}, {expected}");
        }
    }

    /// The image of the other frame is a part of it, which begins elsewhere.
    #[test]
    fn what_a_part_of_a_frame_shows_is_where_it_lies() {
        let (truth, mask) = (scene([0.0; 2]), Mask::from_fn(SIZE, |y, x| (y + 2 * x) % 5 == 0));
        let (corner, small) = ([7_usize, 20_usize], Size::new(40, 30));
        let shows = scene([0.0, 5.0]);
        let cut = |y: usize, x: usize| shows.as_slice()[0].at(y + corner[0], x + corner[1]);
        let samples = Planes::new(small, vec![Plane::from_fn(small, cut)]).unwrap();
        let place =
            |at: usize| [(at / small.width + corner[0]) as f32, (at % small.width + corner[1]) as f32 - 5.0];
        let every = Mask::from_fn(small, |_, _| true);
        let carried = Carried::new(SIZE, (&samples, &every), -1, place).unwrap();
        let carried = [carried.at_corner(corner.map(|at| at as i64))];
        let covered = |y: usize, x: usize| (7..47).contains(&y) && (20..50).contains(&x);
        assert!((0..SIZE.pixels()).all(|at| carried[0].covers(at) == covered(at / 70, at % 70)));
        let own = beside(&carried, spline).unwrap();
        assert_eq!(own[0].image.size(), small);
        let alone = Planes::zeros(SIZE, 1);
        let image = seen((&truth, &mask, &alone), (&own, &carried), (BY, false), &Run::default()).unwrap();
        for at in 0..SIZE.pixels() {
            let (value, truth) = (image.as_slice()[0].pixels()[at], truth.as_slice()[0].pixels()[at]);
            let shown = covered(at / SIZE.width, at % SIZE.width + 5);
            let expected = if shown || mask.as_slice()[at] { truth } else { 0.0 };
            assert!((value - expected).abs() < 1e-5, "{at}: {value}, {expected}");
        }
    }

    #[test]
    fn frames_beside_show_more_than_a_frame_knows_alone() {
        let mask = Arc::new(Mask::from_fn(SIZE, |y, x| (y * SIZE.width + x).is_multiple_of(5)));
        let truth = scene([0.0; 2]);
        let shift = |k: i32| [0.7 * k as f32, -0.4 * k as f32];
        let carried =
            [-2, -1, 1, 2].map(|k: i32| frame(k, shift(k), |at| at % 5 == k.rem_euclid(5) as usize));
        let own = beside(&carried, spline).unwrap();
        assert_eq!(own.iter().map(|own| own.at).collect::<Vec<_>>(), [1, 2]);
        let alone = spline(&truth, &mask, [0; 2]).unwrap();
        let image = seen((&truth, &mask, &alone), (&own, &carried), (BY, false), &Run::default()).unwrap();
        let error = |image: &Planes| -> f32 {
            let pairs = image.as_slice()[0].pixels().iter().zip(truth.as_slice()[0].pixels());
            pairs.map(|(a, b)| (a - b).powi(2)).sum()
        };
        assert!(error(&image) < 0.25 * error(&alone), "{} of {}", error(&image), error(&alone));
        let measured = (0..SIZE.pixels()).filter(|at| mask.as_slice()[*at]);
        for at in measured {
            assert_eq!(
                image.as_slice()[0].pixels()[at].to_bits(),
                truth.as_slice()[0].pixels()[at].to_bits()
            );
        }
    }
}
