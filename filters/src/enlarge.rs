//! The call that enlarges: planes of a group of channels in, larger ones out; what is missing is filled on the way.
//!
//! Missing pixels are filled on the given grid first ([`crate::fill()`]). Values at points go through the value domain, means do not: a
//! logarithm has others. Values whose squares would leave f32 are enlarged in another unit ([`Map::Scaled`]). With total variation what was
//! missing does not bind the result: filling and enlarging are one problem.

use std::borrow::Cow;
use std::sync::Arc;

use lacuna_core::parallel::prelude::*;

use crate::domain::{Domain, Map};
use crate::fill::{self, Filled, Values, fill_usable};
use crate::limiter::Moved;
use crate::upscale::{Enlarged, Geometry, Highlights, Hint, Method, Plan, Question, Sampling, guided};
use crate::variational::guided::Guides;
use crate::{Error, Mask, Outcome, Plane, Planes, Plans, Run};

/// What is asked for beside the samples.
#[derive(Clone, Debug)]
#[non_exhaustive]
pub struct Options<'a> {
    /// Where the pixels of both images lie, and what those of the small one mean.
    pub geometry: Geometry,
    /// How the image is enlarged.
    pub method: Method,
    /// Which pixels were measured; without it all that are finite.
    pub mask: Option<Arc<Mask>>,
    /// Complete planes of the larger size that steer splines in light.
    pub guides: Option<&'a Guides>,
    /// How missing pixels are filled; domain, limiter, bounds and what the values are hold for both steps.
    pub fill: fill::Options<'a>,
}

impl Options<'_> {
    /// Splines onto that grid.
    pub fn new(geometry: Geometry) -> Self {
        Self { geometry, method: Method::Ss, mask: None, guides: None, fill: fill::Options::default() }
    }
}

/// A group that was enlarged.
#[derive(Clone, Debug)]
#[non_exhaustive]
pub struct Upscaled {
    /// The larger planes, in their order.
    pub planes: Planes,
    /// How the solver ended, filling included: the worst of the planes.
    pub outcome: Outcome,
    /// The domain that they were enlarged in.
    pub map: Map,
    /// Per plane, the values that the limiter or a bound moved.
    pub limited: Vec<Moved>,
    /// Values that overflowed and took that of the pixel they lie in.
    pub mended: usize,
    /// The guides that steered it; none where none were there, or none predicted.
    pub guides: Vec<String>,
    /// The part of the squared error that they take away, as small pixels show.
    pub guides_gain: Option<f64>,
    /// What was done to missing pixels; nothing if that was done before.
    pub filled: Option<Filled>,
}

/// Enlarges a group of channels as `lacuna upscale` does, and fills it if pixels are missing.
///
/// ```
/// use lacuna_filters::enlarge::{Options, upscale};
/// use lacuna_filters::upscale::{Geometry, Sampling};
/// use lacuna_filters::{Planes, Size};
/// use ndarray::Array2;
///
/// let small = Array2::from_shape_fn((24, 32), |(_, x)| x as f32);
/// let geometry = Geometry::scaled(Size::new(24, 32), 2.0, Sampling::Box);
/// let large = Array2::try_from(upscale(&Planes::from(small), &Options::new(geometry))?.planes)?;
/// assert_eq!(large.dim(), (48, 64));
/// # Ok::<(), lacuna_filters::Error>(())
/// ```
///
/// # Errors
/// Those of [`fill()`](crate::fill()), and [`Error::Setting`] for factors and models out of range.
pub fn upscale(samples: &Planes, options: &Options<'_>) -> Result<Upscaled, Error> {
    upscale_with(samples, options, &Plans::new(), &Run::default())
}

/// The same with plans that were made before, for groups and frames of the same mask and size, and a way to stop.
///
/// # Errors
/// As [`upscale`].
pub fn upscale_with(
    samples: &Planes,
    options: &Options<'_>,
    plans: &Plans,
    run: &Run<'_>,
) -> Result<Upscaled, Error> {
    let mask = options.mask.clone();
    let mask = mask.unwrap_or_else(|| Arc::new(Mask::full(samples.size())));
    let reduced = options.guides.map(|guides| smaller_guides(guides, options, plans)).transpose()?;
    let filling = fill::Options { guides: reduced.as_ref(), ..options.fill.clone() };
    let filled = fill_usable(samples, &mask, &filling, plans, run)?;
    let masks: Vec<_> = (0..samples.len()).map(|plane| filled.mask(plane).cloned()).collect();
    let mut large = complete(&filled.planes, &masks, options, plans, run)?;
    large.outcome = large.outcome.worst(filled.outcome);
    large.filled = Some(filled);
    Ok(large)
}

/// Guides of the larger size as pixels of the small one see them, for filling what is missing there.
///
/// # Errors
/// [`Error::Setting`], [`Error::TooLarge`] and [`Error::SizeMismatch`].
pub fn smaller_guides(guides: &Guides, options: &Options<'_>, plans: &Plans) -> Result<Guides, Error> {
    plans.enlarge(options.geometry, options.method)?.smaller(guides)
}

/// Enlarges planes that are complete: finite everywhere. `masks` says of each plane which pixels were measured, where not all were.
///
/// # Errors
/// [`Error::Setting`], [`Error::TooLarge`], [`Error::SizeMismatch`] and [`Error::NotFinite`].
pub fn complete(
    samples: &Planes,
    masks: &[Option<Arc<Mask>>],
    options: &Options<'_>,
    plans: &Plans,
    run: &Run<'_>,
) -> Result<Upscaled, Error> {
    let (geometry, values) = (options.geometry, options.fill.values);
    let plan = plans.enlarge(geometry, options.method)?;
    let full = Mask::full(samples.size());
    // Filters without a model of a pixel take logarithms where they are asked for.
    let asked = matches!(options.method, Method::Plain(_)) && options.fill.domain == Domain::Log;
    let pointwise = values == Values::Light && (geometry.sampling.is_pointwise() || asked);
    let domain = if pointwise { options.fill.domain } else { Domain::Linear };
    let told = domain.map(&full, samples.as_slice());
    let map = told.in_range(&full, samples.as_slice());
    let steered = options.guides.filter(|_| values == Values::Light || values == Values::Other);
    let steered = steered.filter(|_| options.method == Method::Ss);
    let mut mapped = Cow::Borrowed(samples);
    if !map.is_linear() {
        mapped.to_mut().as_mut_slice().iter_mut().for_each(|plane| map.forward_plane(&full, plane));
    }
    let steer = steered.map(|guides| guided::steer(&plan, &mapped, guides, run)).transpose()?.flatten();
    let local = matches!(geometry.sampling, Sampling::Box | Sampling::Point | Sampling::Grid);
    let alone = local && options.method == Method::Ss && values == Values::Light && steer.is_none();
    let highlights = alone.then(|| Highlights::of(samples, map)).flatten();
    let one = |(at, (samples, mapped)): (usize, (&Plane, &Plane))| {
        let hint = match (&steer, &highlights) {
            (Some(steer), _) => Hint::Guides(&steer.changes[at]),
            (None, Some(highlights)) => Hint::Highlights(highlights),
            (None, None) => Hint::None,
        };
        let (low, high) = options.fill.bounds_of(at).range(samples.pixels().iter().copied());
        let mask = masks.get(at).and_then(Option::as_deref).filter(|mask| !mask.is_full());
        let question = Question {
            mask,
            range: (map.forward(low), map.forward(high)),
            limit: options.fill.limit && values != Values::Directions,
            map,
        };
        one(&plan, (samples, mapped, hint), &question, run)
    };
    let large = samples.as_slice().par_iter().zip(mapped.as_slice()).enumerate().map(one);
    collect(large, (geometry, told), steer.as_ref())
}

/// The enlarged planes as one group.
fn collect(
    large: Vec<Result<(Enlarged, usize), Error>>,
    (geometry, map): (Geometry, Map),
    steer: Option<&guided::Steer>,
) -> Result<Upscaled, Error> {
    let mut result = Upscaled {
        planes: Planes::zeros(geometry.high(), 0),
        outcome: Outcome::direct(),
        map,
        limited: Vec::new(),
        mended: 0,
        guides: steer.map(|steer| steer.guides.clone()).unwrap_or_default(),
        guides_gain: steer.map(|steer| steer.gain),
        filled: None,
    };
    let mut planes = Vec::with_capacity(large.len());
    for large in large {
        let (enlarged, mended) = large?;
        let first = planes.is_empty();
        result.outcome = if first { enlarged.outcome } else { result.outcome.worst(enlarged.outcome) };
        result.limited.push(enlarged.limited);
        result.mended += mended;
        planes.push(enlarged.plane);
    }
    result.planes = Planes::of(geometry.high(), planes);
    Ok(result)
}

/// Enlarges one plane, mapped to the value domain; how many values overflowed, too.
fn one(
    plan: &Plan,
    (samples, mapped, hint): (&Plane, &Plane, Hint<'_>),
    question: &Question<'_>,
    run: &Run<'_>,
) -> Result<(Enlarged, usize), Error> {
    let mut enlarged = plan.enlarge_with(mapped, hint, question, run)?;
    question.map.inverse_plane(&mut enlarged.plane);
    plan.restore(samples, &mut enlarged.plane);
    let sources = || Ok(plan.geometry().sources());
    let mended = fill::mend(samples, &mut enlarged.plane, sources, Vec::as_slice)?;
    Ok((enlarged, mended))
}

#[cfg(test)]
mod tests;
