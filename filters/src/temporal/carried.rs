//! Samples of another frame at their places in this one.

use std::sync::Arc;

use lacuna_core::parallel::prelude::*;

use crate::domain::Map;
use crate::variational::guided;
use crate::{Error, Mask, Plane, Planes, Size};

/// Pixels that one task takes.
const PIECE: usize = 1 << 14;
/// The distance from a pixel's centre that is none.
const WHOLE: f32 = 1e-3;

/// Samples of another frame at their places in this one.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Carried {
    /// Row and column, whole numbers at pixel centres.
    pub(crate) places: Arc<Vec<[f32; 2]>>,
    /// By plane, the values.
    pub(crate) values: Vec<Arc<Vec<f32>>>,
    /// The same of guides; none where they are not known.
    guides: Vec<Arc<Vec<f32>>>,
    /// The pixel of its own frame that each was measured at.
    pub(crate) home: Arc<Vec<u32>>,
    /// How many frames later than this one it was measured; negative if earlier, never 0.
    pub(crate) offset: i32,
    /// That of this frame.
    size: Size,
    /// Where its own frame lies.
    own: Lies,
    /// The same at the places where held-out samples may judge them, if those are others.
    pub(crate) judged: Option<Box<Self>>,
}

/// Where the image of another frame lies in this one's if nothing moves.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
struct Lies {
    size: Size,
    /// Row and column of its first pixel.
    corner: [i64; 2],
}

impl Lies {
    /// Its pixel that lies at one of an image of that size.
    fn home(self, size: Size, at: usize) -> Option<usize> {
        let [row, column] = [at / size.width, at % size.width];
        let index = |at: usize, axis: usize, length: usize| {
            usize::try_from(at as i64 - self.corner[axis]).ok().filter(|at| *at < length)
        };
        Some(index(row, 0, self.size.height)? * self.size.width + index(column, 1, self.size.width)?)
    }
}

impl Carried {
    /// The measured samples of a frame that is `offset` frames later (negative: earlier; 0 counts as 1), `place` telling where each of its pixels, by its index row by row, lies in an image of that size: row
    /// and column, whole numbers at pixel centres. Those whose place is not known (NaN) or outside, and those that are not finite, are left out.
    ///
    /// # Errors
    /// [`Error::SizeMismatch`] where samples and mask differ in size. Other frames may be larger or smaller than this one ([`Self::at_corner`]).
    pub fn new(
        size: Size,
        (samples, mask): (&Planes, &Mask),
        offset: i32,
        place: impl Fn(usize) -> [f32; 2] + Sync,
    ) -> Result<Self, Error> {
        if mask.size() != samples.size() {
            return Err(Error::size(samples.size(), "the mask of another frame", mask.size()));
        }
        let offset = if offset == 0 { 1 } else { offset };
        let part = |(part, flags): (usize, &[bool])| -> Vec<(u32, [f32; 2])> {
            let one = |at: usize| {
                // What is all but a pixel's centre is it.
                let [y, x] = place(at).map(|at| if (at - round(at)).abs() < WHOLE { round(at) } else { at });
                let finite = || samples.as_slice().iter().all(|plane| plane.pixels()[at].is_finite());
                (is_inside(size, [y, x]) && finite()).then_some((at as u32, [y, x]))
            };
            let measured = (0..flags.len()).filter(|at| flags[*at]);
            measured.filter_map(|at| one(part * PIECE + at)).collect()
        };
        let all = mask.as_slice().par_chunks(PIECE).enumerate().map(part).concat();
        let home: Vec<u32> = all.iter().map(|(at, _)| *at).collect();
        let of = |plane: &Plane| Arc::new(home.iter().map(|at| plane.pixels()[*at as usize]).collect());
        let values = samples.as_slice().iter().map(of).collect();
        let places = all.iter().map(|(_, place)| *place).collect();
        let (places, home) = (Arc::new(places), Arc::new(home));
        let own = Lies { size: samples.size(), corner: [0; 2] };
        Ok(Self { places, values, guides: Vec::new(), home, offset, size, own, judged: None })
    }

    /// With what guides of this frame ([`crate::variational::guided::Guides::alike`]) are in the other one, plane by plane. All pixels of the other
    /// frame, of which those that were measured count.
    ///
    /// # Errors
    /// [`Error::SizeMismatch`] where these are no planes of the other frame.
    pub fn guided(mut self, planes: &[Plane]) -> Result<Self, Error> {
        if let Some(plane) = planes.iter().find(|plane| plane.size() != self.own.size) {
            return Err(Error::size(self.own.size, "guides of another frame", plane.size()));
        }
        let of = |plane: &Plane| Arc::new(self.home.iter().map(|at| plane.pixels()[*at as usize]).collect());
        self.guides = planes.iter().map(of).collect();
        self.judged = self.judged.map(|judged| judged.guided(planes).map(Box::new)).transpose()?;
        Ok(self)
    }

    /// Whether so many planes of guides, one at least, are known wherever there are samples, and something moves: what stands still lacks other frames' samples where
    /// samples are held out, and what takes their place has no guides.
    pub(crate) fn are_guided(all: &[Self], planes: usize) -> bool {
        let known = all.iter().all(|one| one.is_empty() || one.guides.len() == planes);
        planes > 0 && known && !all.iter().all(Self::is_still)
    }

    /// The guides in place of the values.
    pub(crate) fn of_guides(&self) -> Self {
        Self { values: self.guides.clone(), guides: Vec::new(), ..self.not_judged() }
    }

    /// The same of a frame whose first pixel has this row and column in this one: both show parts of one image, and where the other one
    /// shows nothing it can know nothing.
    #[must_use]
    pub fn at_corner(mut self, corner: [i64; 2]) -> Self {
        self.own.corner = corner;
        self
    }

    /// With the same samples at other places, where samples that are held out may judge them: those by motion that was estimated without
    /// these ([`super::unjudged`]), as any other has been bent towards them.
    #[must_use]
    pub fn judged_by(self, other: Self) -> Self {
        Self { judged: Some(Box::new(other)), ..self }
    }

    /// What held-out samples may judge.
    pub(crate) fn to_judge(&self) -> &Self {
        self.judged.as_deref().unwrap_or(self)
    }

    /// These samples, and those that judge them, if they are others.
    pub(crate) fn all(&self) -> impl Iterator<Item = &Self> {
        std::iter::successors(Some(self), |carried| carried.judged.as_deref())
    }

    /// The size of this frame.
    pub(crate) const fn size(&self) -> Size {
        self.size
    }

    /// Whether the other frame shows the pixel of this one, if nothing moves.
    pub(crate) fn covers(&self, at: usize) -> bool {
        self.own.home(self.size, at).is_some()
    }

    /// Row and column of the first pixel of the other frame.
    pub(super) const fn corner(&self) -> [i64; 2] {
        self.own.corner
    }

    /// The size of the other frame.
    pub(super) const fn home_size(&self) -> Size {
        self.own.size
    }

    /// The number of planes that each has a value in.
    pub(crate) const fn planes(&self) -> usize {
        self.values.len()
    }

    /// The number of samples.
    pub fn len(&self) -> usize {
        self.places.len()
    }

    /// Whether there is none.
    pub fn is_empty(&self) -> bool {
        self.places.is_empty()
    }

    /// How many frames away it was measured, at least 1.
    pub(crate) fn distance(&self) -> u32 {
        self.offset.unsigned_abs().max(1)
    }

    /// Whether all of them lie at pixel centres.
    pub(crate) fn is_still(&self) -> bool {
        self.places.iter().flatten().all(|at| at.fract() == 0.0)
    }

    /// The pixels of an image of that size in which the samples are, in their order.
    pub(crate) fn pixels(&self, size: Size) -> impl Iterator<Item = usize> {
        self.places.iter().map(move |place| pixel(size, *place))
    }

    /// The value of a sample in a plane.
    pub(crate) fn value(&self, plane: usize, sample: usize) -> f32 {
        self.values[plane][sample]
    }

    /// Adds a sample of a frame in which nothing has moved, if it shows the pixel; what guides are there is not known.
    pub(crate) fn push(&mut self, at: usize, values: &[f32]) {
        let Some(home) = self.own.home(self.size, at) else { return };
        self.guides.clear();
        let width = self.size.width;
        Arc::make_mut(&mut self.places).push([(at / width) as f32, (at % width) as f32]);
        Arc::make_mut(&mut self.home).push(home as u32);
        self.values.iter_mut().zip(values).for_each(|(own, value)| Arc::make_mut(own).push(*value));
    }

    /// Adds them to others, with their guides or without.
    pub(crate) fn put_beside(&self, all: &mut guided::Beside, guided: bool) {
        all.at.extend_from_slice(&self.places);
        all.away.extend(self.places.iter().map(|_| self.distance() as f32));
        for i in 0..self.len() {
            all.values.extend(self.values.iter().map(|values| values[i]));
            all.guides.extend(self.guides.iter().filter(|_| guided).map(|values| values[i]));
        }
    }

    /// The samples as pixels of an image, those of one pixel one after the other.
    pub(crate) fn on_grid(&self, size: Size) -> (Planes, Mask) {
        self.put_at(size, self.pixels(size))
    }

    /// The samples at these pixels of an image.
    fn put_at(&self, size: Size, pixels: impl Iterator<Item = usize>) -> (Planes, Mask) {
        let mut flags = vec![false; size.pixels()];
        let mut planes = Planes::zeros(size, self.values.len());
        for (i, at) in pixels.enumerate() {
            flags[at] = true;
            for (plane, values) in planes.as_mut_slice().iter_mut().zip(&self.values) {
                plane.pixels_mut()[at] = values[i];
            }
        }
        (planes, Mask::of(size, flags))
    }

    /// The samples as pixels of their own frame.
    pub(super) fn at_home(&self) -> (Planes, Mask) {
        self.put_at(self.own.size, self.home.iter().map(|at| *at as usize))
    }

    /// At their places in another frame of that size, which is `offset` frames later, `place` telling them by those in this one. Those
    /// outside are left out.
    pub(super) fn carried_on(&self, size: Size, offset: i32, place: impl Fn([f32; 2]) -> [f32; 2]) -> Self {
        let places: Vec<[f32; 2]> = self.places.iter().map(|own| place(*own)).collect();
        let inside: Vec<usize> = (0..self.len()).filter(|&i| is_inside(size, places[i])).collect();
        let places = inside.iter().map(|&i| places[i]).collect();
        Self { places: Arc::new(places), offset: self.offset - offset, size, ..self.only(&inside) }
    }

    /// These samples alone, in this order: all of them, or fewer.
    pub(super) fn only(&self, samples: &[usize]) -> Self {
        if samples.len() == self.len() {
            return self.not_judged();
        }
        let take = |values: &Arc<Vec<f32>>| Arc::new(samples.iter().map(|&i| values[i]).collect());
        Self {
            places: Arc::new(samples.iter().map(|&i| self.places[i]).collect()),
            values: self.values.iter().map(take).collect(),
            guides: self.guides.iter().map(take).collect(),
            home: Arc::new(samples.iter().map(|&i| self.home[i]).collect()),
            offset: self.offset,
            size: self.size,
            own: self.own,
            judged: None,
        }
    }

    /// The same for held-out samples and others.
    pub(super) fn not_judged(&self) -> Self {
        Self {
            places: Arc::clone(&self.places),
            values: self.values.clone(),
            guides: self.guides.clone(),
            home: Arc::clone(&self.home),
            offset: self.offset,
            size: self.size,
            own: self.own,
            judged: None,
        }
    }

    /// Of these planes, in this order.
    pub(crate) fn select(&self, planes: &[usize]) -> Self {
        let values = planes.iter().map(|&at| Arc::clone(&self.values[at])).collect();
        let judged = self.judged.as_ref().map(|judged| Box::new(judged.select(planes)));
        Self { values, judged, ..self.not_judged() }
    }

    /// With the values mapped.
    pub(crate) fn mapped(mut self, map: Map) -> Self {
        if map == Map::Linear {
            return self;
        }
        let values = self.values.iter_mut().flat_map(Arc::make_mut);
        values.for_each(|value| *value = map.forward(*value));
        self.judged = self.judged.map(|judged| Box::new(judged.mapped(map)));
        self
    }
}

/// The nearest whole number, of those that pixels of an image can have; quicker than that of any number.
fn round(at: f32) -> f32 {
    (at + 0.5).max(0.0) as u32 as f32
}

/// Whether a place lies in an image of this height or width.
pub(super) fn inside(at: f32, length: usize) -> bool {
    at >= -0.5 && at < length as f32 - 0.5
}

/// Whether a place lies in an image of that size.
pub(super) fn is_inside(size: Size, [y, x]: [f32; 2]) -> bool {
    inside(y, size.height) && inside(x, size.width)
}

/// The pixel of an image of that size that a place is in.
pub(super) fn pixel(size: Size, [y, x]: [f32; 2]) -> usize {
    // Of what is not negative, this is the nearest whole number.
    let at = |at: f32, length: usize| ((at.max(0.0) + 0.5) as usize).min(length - 1);
    at(y, size.height) * size.width + at(x, size.width)
}
