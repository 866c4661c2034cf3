//! A larger image from a low-resolution one, by any factor from 1 to 16, different along each axis.
//!
//! A low-resolution pixel says something about the high-resolution image: its mean over an area, say ([`Sampling`]). With
//! `R` for that (separable, `R = R_v (x) R_h`, see [`Axis`]), `y` for the given image and `x` for the result, all methods
//! but the plain ones look for an `x` with `R x = y`: reduced again by the same model, it is the input. Of points, and of means at broken
//! factors, the spline has what `y` says, and `R x` is near it (see [`Axis`]).
//!
//! - [`Method::Ss`]: the cubic spline on the low-resolution grid that does so. Its coefficients are `(R U)^-1 y`, `U`
//!   the values (or means) of the spline at high-resolution pixels: the spline is defined everywhere, so that every factor is
//!   evaluation and not resampling twice. Separable finite filters, no iterations. Means are then smoothed along edges
//!   (`edges`), which keeps them, where no guides say more of edges. Pixels around highlights see these no brighter than
//!   themselves, and dark means beside them take the spline of logarithms ([`Highlights`]).
//! - [`Method::Tv`]: the image of least total variation that does so ([`tv`]). With a mask, only measured pixels bind it.
//! - Complete planes of the larger size may steer the spline ([`guided`]).
//! - [`Method::Plain`]: a resampling filter, which has no model of a pixel ([`plain`]).
//!
//! A spline overshoots at edges. Bounds (no negative light, alpha within 0 and 1, and the limiter's) are part of the solution
//! ([`settle`]): the result is the nearest image to the spline that keeps them *and* has `R x = y`.
//!
//! Boundary: see [`Axis`]; ramps are exact up to the border. Cost of `Ss`: about 35 taps a low-resolution and 8 a
//! high-resolution pixel, twice that and 130 flops for a box; four f32 planes of the result's size. Fails: what is finer than the low-resolution pixels is not there and is not
//! invented; hard edges stay as soft as their pixels, and a wide Gaussian multiplies their noise (by 90 along each axis for
//! a radius of 1.5).

mod axis;
mod bounds;
mod dual;
mod edges;
pub mod guided;
mod highlights;
pub mod plain;
mod relax;
mod sampling;
pub mod settle;
#[cfg(test)]
mod tests;
pub mod tv;

use std::borrow::Cow;

pub use axis::Axis;
pub use highlights::Highlights;
use lacuna_core::parallel::prelude::*;
pub use sampling::Sampling;

use crate::domain::Map;
use crate::kernel::rows::Rows;
use crate::kernel::{Isa, diffusion, vector};
use crate::limiter::Moved;
use crate::{Error, Mask, Outcome, Plane, Run, Size, Stop};

/// How an image is enlarged.
#[derive(Clone, Copy, Debug, PartialEq)]
#[non_exhaustive]
pub enum Method {
    /// Smoothness splines.
    Ss,
    /// Total variation.
    Tv(crate::variational::tv::Settings),
    /// A resampling filter.
    Plain(plain::Kernel),
}

/// Where the pixels of both images lie, and what those of the small one mean.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Geometry {
    /// Along columns.
    pub vertical: Axis,
    /// Along rows.
    pub horizontal: Axis,
    /// The model of a low-resolution pixel.
    pub sampling: Sampling,
}

impl Geometry {
    /// An image enlarged by a factor along both axes; the new size is rounded.
    pub fn scaled(low: Size, factor: f64, sampling: Sampling) -> Self {
        let axis = |pixels: usize| Axis::whole(pixels, (pixels as f64 * factor).round() as usize);
        Self { vertical: axis(low.height), horizontal: axis(low.width), sampling }
    }

    /// Whether factors and model are in range.
    ///
    /// # Errors
    /// [`Error::Setting`] and [`Error::TooLarge`].
    pub fn check(&self) -> Result<(), Error> {
        self.sampling.check()?;
        self.vertical.check(self.sampling)?;
        self.horizontal.check(self.sampling)?;
        let size = self.high();
        let pixels = (size.height as u64).saturating_mul(size.width as u64);
        if pixels > u64::from(u32::MAX) { Err(Error::TooLarge { size }) } else { Ok(()) }
    }

    /// The size of the given image.
    pub fn low(&self) -> Size {
        Size::new(self.vertical.inputs, self.horizontal.inputs)
    }

    /// The size of the result.
    pub fn high(&self) -> Size {
        Size::new(self.vertical.outputs, self.horizontal.outputs)
    }

    /// For each pixel of the result, in order, the given pixel that its centre lies in (for a grid, the nearest sample).
    pub fn sources(&self) -> Vec<u32> {
        let columns: Vec<usize> =
            (0..self.high().width).map(|x| self.horizontal.source(self.sampling, x)).collect();
        let width = self.low().width;
        let mut sources = vec![0; self.high().pixels()];
        sources.par_chunks_mut(columns.len().max(1)).enumerate().for_each(|(y, sources)| {
            let row = self.vertical.source(self.sampling, y) * width;
            sources.iter_mut().zip(&columns).for_each(|(source, column)| *source = (row + column) as u32);
        });
        sources
    }
}

/// What is asked for beside the method, channel by channel.
#[derive(Clone, Copy, Debug)]
pub struct Question<'a> {
    /// Which of the given pixels were measured; the others hold a guess. Without it all were.
    pub mask: Option<&'a Mask>,
    /// The least and the greatest value allowed, mapped as the samples are; may be infinite.
    pub range: (f32, f32),
    /// Whether overshoot is limited by the pixels around.
    pub limit: bool,
    /// What the samples were mapped by; the limiter goes by what they were.
    pub map: Map,
}

/// What the channels of a group say together of each of them; for the spline only.
#[derive(Clone, Copy, Debug, Default)]
pub enum Hint<'a> {
    /// Nothing.
    #[default]
    None,
    /// What guides add to this channel ([`guided::steer`]).
    Guides(&'a Plane),
    /// Which of the small pixels are highlights.
    Highlights(&'a Highlights),
}

impl<'a> Hint<'a> {
    /// The highlights.
    const fn highlights(self) -> Option<&'a Highlights> {
        if let Self::Highlights(highlights) = self { Some(highlights) } else { None }
    }

    /// What guides add.
    const fn guides(self) -> Option<&'a Plane> {
        if let Self::Guides(change) = self { Some(change) } else { None }
    }
}

/// An enlarged channel.
#[derive(Clone, Debug, PartialEq)]
pub struct Enlarged {
    /// The pixels, finite.
    pub plane: Plane,
    /// Pixels that bounds moved.
    pub limited: Moved,
    /// How the solver ended, and how far bounds keep it from its input.
    pub outcome: Outcome,
}

/// Maps of both axes, vertical and horizontal.
type Pair = [Rows; 2];

/// R, its adjoint, and `M = (R R')^-1`.
#[derive(Clone, Debug)]
struct Model {
    reduce: Pair,
    adjoint: Pair,
    gram_inverse: Pair,
}

/// What depends on geometry and method alone; serves every channel.
#[derive(Clone, Debug)]
pub struct Plan {
    geometry: Geometry,
    method: Method,
    prefilter: Pair,
    spline: Pair,
    model: Model,
    /// The pixels of each cell along both axes, if cells do not share any.
    cells: Option<[Vec<std::ops::Range<usize>>; 2]>,
}

impl Plan {
    /// Prepares the filters.
    ///
    /// # Errors
    /// [`Error::Setting`] and [`Error::TooLarge`].
    pub fn new(geometry: Geometry, method: Method) -> Result<Self, Error> {
        geometry.check()?;
        let axes = [geometry.vertical, geometry.horizontal];
        let sampling = geometry.sampling;
        let [vertical, horizontal] = axes.map(|axis| axis.cells(sampling));
        Ok(Self {
            geometry,
            method,
            prefilter: axes.map(|axis| axis.prefilter(sampling).rows()),
            spline: axes.map(|axis| axis.spline(sampling).rows()),
            model: Model {
                reduce: axes.map(|axis| axis.reduce(sampling).rows()),
                adjoint: axes.map(|axis| axis.reduce(sampling).transpose().rows()),
                gram_inverse: axes.map(|axis| axis.gram_inverse(sampling).rows()),
            },
            cells: vertical.zip(horizontal).map(|(vertical, horizontal)| [vertical, horizontal]),
        })
    }

    /// Where the pixels lie.
    pub const fn geometry(&self) -> &Geometry {
        &self.geometry
    }

    /// Whether means are integrals of the continuous spline, which sums over pixels are only near: at broken factors.
    fn is_continuous(&self) -> bool {
        let Geometry { vertical, horizontal, sampling } = self.geometry;
        let is_whole = vertical.is_whole() && horizontal.is_whole();
        self.cells.is_none() && (sampling == Sampling::Box || !(is_whole || sampling.is_pointwise()))
    }

    /// Enlarges one channel of finite values.
    ///
    /// # Errors
    /// [`Error::SizeMismatch`] and [`Error::NotFinite`].
    pub fn enlarge(
        &self,
        samples: &Plane,
        question: &Question<'_>,
        run: &Run<'_>,
    ) -> Result<Enlarged, Error> {
        self.enlarge_with(samples, Hint::None, question, run)
    }

    /// The same with what the channels of its group say.
    ///
    /// # Errors
    /// [`Error::SizeMismatch`], of the hint too, and [`Error::NotFinite`].
    pub fn enlarge_with(
        &self,
        samples: &Plane,
        hint: Hint<'_>,
        question: &Question<'_>,
        run: &Run<'_>,
    ) -> Result<Enlarged, Error> {
        let low = self.geometry.low();
        let (high, guides) = (self.geometry.high(), hint.guides());
        let sizes = [
            (low, "samples", Some(samples.size())),
            (low, "a mask", question.mask.map(Mask::size)),
            (low, "highlights", hint.highlights().map(Highlights::size)),
            (high, "what guides add", guides.map(Plane::size)),
        ];
        for (expected, name, size) in sizes {
            if let Some(other) = size.filter(|size| *size != expected) {
                return Err(Error::size(expected, name, other));
            }
        }
        if let Some(bad) = samples.pixels().iter().position(|value| !value.is_finite()) {
            return Err(Error::NotFinite { row: bad / low.width, column: bad % low.width });
        }
        match self.method {
            Method::Plain(kernel) => plain::enlarge(&self.geometry, kernel, samples, question),
            Method::Ss => Ok(self.smooth(samples, hint, question, run)),
            Method::Tv(settings) => {
                let start = self.smooth(samples, Hint::None, question, run);
                tv::enlarge(self, settings, (samples, question), start, run)
            }
        }
    }

    /// Gives the pixels of the result that are given pixels the bits of those, where there are such: in a grid. For callers
    /// that map values before and after.
    pub fn restore(&self, samples: &Plane, plane: &mut Plane) {
        let geometry = &self.geometry;
        if geometry.sampling != Sampling::Grid || matches!(self.method, Method::Plain(_)) {
            return;
        }
        let (down, right) = (geometry.vertical.scale as usize, geometry.horizontal.scale as usize);
        for y in 0..samples.size().height {
            for (place, value) in plane.row_mut(y * down).iter_mut().step_by(right).zip(samples.row(y)) {
                *place = *value;
            }
        }
    }

    /// The spline, and what the hint makes of it, within its bounds.
    fn smooth(&self, samples: &Plane, hint: Hint<'_>, question: &Question<'_>, run: &Run<'_>) -> Enlarged {
        let mut plane = self.spline(samples);
        match self.shape(samples, hint, question, &mut plane, run) {
            Ok(target) => settle::settle(self, (samples, target.as_ref()), plane, question, run),
            Err(stop) => settle::cut_short(self, samples, plane, question, stop),
        }
    }

    /// What edges and the hint make of the spline; the means that it then has, where they are not the samples.
    fn shape(
        &self,
        samples: &Plane,
        hint: Hint<'_>,
        question: &Question<'_>,
        plane: &mut Plane,
        run: &Run<'_>,
    ) -> Result<Option<Plane>, Stop> {
        let go_on = || run.interrupted().map_or(Ok(()), Err);
        let isa = Isa::best();
        let is_box = self.geometry.sampling == Sampling::Box;
        go_on()?;
        let shares = self.is_continuous();
        let spline = (shares && is_box && hint.highlights().is_some()).then(|| self.model.reduce(plane));
        self.expose(samples, hint, plane);
        if !matches!(hint, Hint::Guides(_)) && self.method == Method::Ss && is_box {
            self.along_edges(samples, hint, plane, run)?;
        }
        if let Hint::Guides(change) = hint {
            vector::add_scaled(isa, plane.pixels_mut(), 1.0, change.pixels());
        }
        // Footprints that share pixels: the means are the continuous spline's own; what reduces it again has only its pixels.
        let target = shares.then(|| self.model.reduce(plane));
        let target = match (hint.highlights(), spline) {
            (Some(highlights), Some(spline)) => target.map(|target| highlights.means(&spline, target)),
            _ => target,
        };
        match hint {
            Hint::None | Hint::Guides(_) => {}
            Hint::Highlights(_) if !is_box => {}
            Hint::Highlights(highlights) => {
                let given = (samples, target.as_ref());
                let bounded = settle::settle(self, given, plane.clone(), question, run).plane;
                go_on()?;
                let means = target.as_ref().unwrap_or(samples);
                highlights::soften(self, &highlights.dark, (samples, means), &bounded, plane);
            }
        }
        go_on()?;
        Ok(target)
    }

    /// The spline of `samples`, smoothed along edges, with the means that it had.
    fn along_edges(
        &self,
        samples: &Plane,
        hint: Hint<'_>,
        plane: &mut Plane,
        run: &Run<'_>,
    ) -> Result<(), Stop> {
        let before =
            if self.cells.is_some() { Cow::Borrowed(samples) } else { Cow::Owned(self.model.reduce(plane)) };
        let Geometry { vertical, horizontal, sampling } = self.geometry;
        let lines = [vertical, horizontal].map(|axis| guided::bilinear(&axis, sampling).rows());
        let share = apply(&lines, &edges::unresolved(samples));
        let mut smooth = diffusion::smooth(plane, &share, &|| run.interrupted().is_some());
        drop(share);
        run.interrupted().map_or(Ok(()), Err)?;
        if let Some(highlights) = hint.highlights() {
            highlights.hold(self, plane, &mut smooth);
        }
        *plane = smooth;
        let mut less = bounds::difference(&before, &self.model.reduce(plane));
        // A spline that overflowed is for the caller to mend, where it did.
        less.pixels_mut().iter_mut().filter(|value| !value.is_finite()).for_each(|value| *value = 0.0);
        let mut change = self.spline(&less);
        self.expose(&less, hint, &mut change);
        vector::add_scaled(Isa::best(), plane.pixels_mut(), 1.0, change.pixels());
        Ok(())
    }

    /// Makes of the spline of `samples` what pixels see of it where there are highlights ([`Highlights`]).
    fn expose(&self, samples: &Plane, hint: Hint<'_>, plane: &mut Plane) {
        if let Some(highlights) = hint.highlights() {
            highlights.expose(self, samples, plane);
        }
    }

    /// The spline that is what the samples say, free of bounds.
    fn spline(&self, samples: &Plane) -> Plane {
        let columns = self.prefilter[0].along_columns(samples);
        let wide = Rows::along_rows(&[&self.prefilter[1], &self.spline[1]], &columns);
        self.spline[0].along_columns(&wide)
    }
}

impl Model {
    /// `R x`.
    fn reduce(&self, image: &Plane) -> Plane {
        apply(&self.reduce, image)
    }

    /// `R' y`.
    fn adjoint(&self, image: &Plane) -> Plane {
        apply(&self.adjoint, image)
    }

    /// `(R R')^-1 y`.
    fn gram_inverse(&self, image: &Plane) -> Plane {
        apply(&self.gram_inverse, image)
    }
}

/// Both axes, the smaller intermediate image first.
fn apply([vertical, horizontal]: &Pair, image: &Plane) -> Plane {
    if vertical.outputs() <= image.size().height {
        Rows::along_rows(&[horizontal], &vertical.along_columns(image))
    } else {
        vertical.along_columns(&Rows::along_rows(&[horizontal], image))
    }
}
