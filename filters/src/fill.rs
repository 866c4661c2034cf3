//! The call that fills: measured planes of a group of channels, their mask and what is asked for in; complete planes, and what was
//! decided on the way, out.
//!
//! ```text
//! finite samples ──> sets of one mask ──> domain ──> method, guides ──> back ──> overflow mended ──> limiter ──> bounds
//!                                    └──> twins that agree: copied
//! ```
//!
//! - A measured value that is NaN or infinite counts as missing; planes that miss other pixels are solved as sets of their own. A
//!   mask without a missing pixel leaves its planes alone, such values included, unless the method restores.
//! - A plane whose measured values are all those of a complete one takes its missing values from that ([`Options::twins`]).
//! - Light with a long range is solved as logarithms ([`crate::domain`]).
//! - Values that overflow in the method take the nearest measured one.
//! - Overshoot is held back to what the samples around allow ([`crate::limiter`]); with guides, or to what those predict.
//! - What is true of all measured values stays true ([`Bounds`]).
//! - A measured, finite pixel keeps its bits, unless the method smooths.
//!
//! The same bits for every number of threads.

mod finish;
mod solve;
mod task;
pub(crate) use finish::mend;
#[cfg(test)]
mod finite_tests;
#[cfg(test)]
mod tests;
mod twin;
pub use twin::agrees;

use std::sync::Arc;

use lacuna_core::parallel::prelude::*;

use crate::choose::Chosen;
use crate::domain::{Domain, Map};
use crate::estimate::{Repeated, Verdict};
use crate::limiter::Moved;
use crate::noise::Noise;
use crate::temporal::Carried;
use crate::variational::guided::Guides;
use crate::{Bounds, Error, Mask, Method, Outcome, Plane, Planes, Plans, Run};

/// Pixels that one task takes in loops over a plane.
const PIECE: usize = 1 << 14;

/// What the values of a group are.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Values {
    /// Light: colours, of any range.
    #[default]
    Light,
    /// Something else that may be interpolated: alpha, mattes, positions. Never through a logarithm.
    Other,
    /// Components of directions, which are not limited either.
    Directions,
}

/// What is to be said of the error of missing pixels.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Estimate {
    /// Nothing, and no time spent on it.
    #[default]
    No,
    /// How large it is in all ([`Set::estimate`]): two fills more, of a part of the samples.
    Figure,
    /// How large it is at each pixel ([`Set::errors`]), too.
    Pixels,
}

/// What is asked for beside samples and mask. By default, light is filled by what held-out samples choose.
#[derive(Clone, Debug)]
#[non_exhaustive]
pub struct Options<'a> {
    /// The method with its settings. Sets of planes that it cannot take are filled by the default one.
    pub method: Method,
    /// What the values are.
    pub values: Values,
    /// Where light is reconstructed.
    pub domain: Domain,
    /// Whether overshoot is limited.
    pub limit: bool,
    /// The bounds of each plane; if empty, those of light are positive and all others free.
    pub bounds: Vec<Bounds>,
    /// How much each measured pixel counts where the method smooths: the number of its samples, say. Only ratios matter; what is not
    /// finite or above 0 counts for nothing.
    pub weights: Option<Arc<Plane>>,
    /// Of each plane, derivatives along rows (x) and along columns (y) per pixel, NaN where there are none; empty for none at all.
    pub gradients: Vec<Option<[Plane; 2]>>,
    /// Complete planes ([`crate::complete`]) that may steer the values, where measured pixels are kept; methods that take none ([`crate::descriptor::Takes`])
    /// ignore them, and [`Set::guides`] is then empty.
    pub guides: Option<&'a Guides>,
    /// Of each plane, a complete one that may hold its values, in its type (an alpha rendered everywhere, say); empty for none at all. Where it
    /// is complete ([`crate::complete`]) and equals all measured ones ([`agrees`]), missing ones are copied from it; else it counts for nothing. Not where measured pixels are smoothed.
    pub twins: Vec<Option<Arc<Plane>>>,
    /// Whether guides are known to be complete and twins to hold the values, so that neither are looked at, as for pieces of an image that was
    /// looked at as a whole.
    pub known: bool,
    /// Samples of other frames at their places in this one, for methods that choose by held-out samples.
    pub carried: &'a [Carried],
    /// What is to be said of the error.
    pub estimate: Estimate,
    /// What groups of the same frame share where pixels were chosen in rounds: colours first, then the others, which take their
    /// repetition of the rounds over.
    pub repeated: Option<&'a Repeated>,
    /// The value of light that counts as white: what is said of errors is said of light clipped to 0 and it.
    pub peak: f32,
    /// What is known of the noise of the samples, which then are smoothed, as far as it asks for ([`crate::noise`]); the method is for
    /// those that show none. A method that is to choose how much to smooth does so by this noise, and smooths by itself.
    pub noise: Noise,
}

impl Default for Options<'_> {
    fn default() -> Self {
        Self {
            method: Method::default(),
            values: Values::default(),
            domain: Domain::default(),
            limit: true,
            bounds: Vec::new(),
            weights: None,
            gradients: Vec::new(),
            guides: None,
            twins: Vec::new(),
            known: false,
            carried: &[],
            estimate: Estimate::No,
            repeated: None,
            peak: 1.0,
            noise: Noise::None,
        }
    }
}

impl Options<'_> {
    /// The defaults with another method.
    pub fn of(method: impl Into<Method>) -> Self {
        Self { method: method.into(), ..Self::default() }
    }

    /// Whether measured pixels keep their bits.
    pub fn keeps_measured(&self) -> bool {
        self.noise == Noise::None && self.method.keeps_measured()
    }

    /// Whether complete planes are worth a look.
    fn restores(&self) -> bool {
        self.noise != Noise::None || self.method.restores()
    }

    /// The bounds of a plane.
    pub(crate) fn bounds_of(&self, plane: usize) -> Bounds {
        let light = if self.values == Values::Light { Bounds::Positive } else { Bounds::Free };
        self.bounds.get(plane).copied().unwrap_or(light)
    }
}

/// A group that was filled.
#[derive(Clone, Debug)]
#[non_exhaustive]
pub struct Filled {
    /// The planes, in their order. At pixels that count as measured they are the samples, unless the method smooths.
    pub planes: Planes,
    /// How the solver ended: the worst of the sets.
    pub outcome: Outcome,
    /// What was solved together, and what was decided for it; nothing where nothing was missing.
    pub sets: Vec<Set>,
    /// Per plane, the values that the limiter or a bound moved.
    pub limited: Vec<Moved>,
    /// Per plane, the measured values that count as missing because they are NaN or infinite.
    pub non_finite: Vec<usize>,
}

/// Planes of a group that were solved together, because the same pixels of them count as measured.
#[derive(Clone, Debug)]
#[non_exhaustive]
pub struct Set {
    /// The places of the planes in the group.
    pub planes: Vec<usize>,
    /// The pixels that count as measured.
    pub mask: Arc<Mask>,
    /// The method that filled them.
    pub method: Method,
    /// The domain that they were solved in.
    pub map: Map,
    /// How the solver ended.
    pub outcome: Outcome,
    /// Values that overflowed in the method and took the nearest measured one.
    pub mended: usize,
    /// The guides that steered it; none where none were there, or none predicted.
    pub guides: Vec<String>,
    /// The part of the squared error that they took away, estimated by leaving measured pixels out.
    pub gain: Option<f64>,
    /// Where the method chose: what it chose, and the mean weight of each at missing pixels.
    pub shares: Vec<(&'static str, f64)>,
    /// The part of the squared error that samples of other frames took away, by held-out samples; nothing where they were not used.
    pub along: Option<f64>,
    /// How wrong missing pixels are, over the planes of the set, light clipped to 0 and [`Options::peak`]; nothing where that was not asked for, held-out samples cannot show it, or it was copied.
    pub estimate: Option<Verdict>,
    /// The same without clipping, where measured light is beyond 0 or the peak.
    pub unclipped: Option<Verdict>,
    /// The power of its variance given the samples by which a pixel's squared error grows: about 2 where shading is smooth, 0.6 where
    /// edges decide, 0 where noise does. Known with the estimate.
    pub exponent: Option<f64>,
    /// The estimated root mean square error of each pixel over the planes, 0 at measured ones, if that was asked for.
    pub errors: Option<Plane>,
    /// Measured pixels whose weight is 0.
    pub weightless: usize,
    /// Whether measured pixels were smoothed because of their noise.
    pub smoothed: bool,
    /// Settings that the samples chose.
    pub settled: Vec<Chosen>,
    /// Whether its missing values were copied from twins ([`Options::twins`]), and no method ran.
    pub copied: bool,
}

/// Fills the missing pixels of a group of channels as `lacuna fill` does; with its bits, if planes and guides stand in the order of a
/// file's channels, which is that of their names: blue, green, red.
///
/// ```
/// use lacuna_filters::{Mask, Options, Planes, fill};
/// use ndarray::Array2;
///
/// let image = Array2::from_shape_fn((48, 64), |(y, x)| if (y + x) % 3 == 0 { (y + x) as f32 } else { f32::NAN });
/// let samples = Planes::from(image);
/// let filled = fill(&samples, Mask::finite(&samples), &Options::default())?;
/// let image = Array2::try_from(filled.planes)?;
/// assert!((image[(20, 30)] - 50.0).abs() < 0.01);
/// # Ok::<(), lacuna_filters::Error>(())
/// ```
///
/// # Errors
/// [`Error::EmptyMask`] and [`Error::NothingFinite`] where nothing is known, [`Error::SizeMismatch`] where sizes or numbers of
/// planes differ, [`Error::SparseGuide`], [`Error::NothingWeighs`], and those of the method.
pub fn fill(samples: &Planes, mask: impl Into<Arc<Mask>>, options: &Options<'_>) -> Result<Filled, Error> {
    fill_with(samples, &mask.into(), options, &Plans::new(), &Run::default())
}

/// The same with plans that were made before, for groups and frames of the same mask, and a way to stop.
///
/// # Errors
/// As [`fill`].
pub fn fill_with(
    samples: &Planes,
    mask: &Arc<Mask>,
    options: &Options<'_>,
    plans: &Plans,
    run: &Run<'_>,
) -> Result<Filled, Error> {
    check(samples, mask, options)?;
    if mask.is_full() && !options.restores() {
        let none = vec![0; samples.len()];
        return Ok(Filled::untouched(samples.clone(), none));
    }
    fill_usable(samples, mask, options, plans, run)
}

/// Fills what has no finite value as well where the mask calls everything measured.
pub(crate) fn fill_usable(
    samples: &Planes,
    mask: &Arc<Mask>,
    options: &Options<'_>,
    plans: &Plans,
    run: &Run<'_>,
) -> Result<Filled, Error> {
    check(samples, mask, options)?;
    mask.require_samples()?;
    if let Some(name) = options.guides.filter(|_| !options.known).and_then(|guides| guides.sparse(mask)) {
        return Err(Error::SparseGuide { name: name.into() });
    }
    let masks = samples.as_slice().par_iter().map(|plane| usable(mask, plane));
    let non_finite: Vec<usize> = masks.iter().map(|usable| mask.count() - usable.count()).collect();
    if let Some(plane) = masks.iter().position(|usable| usable.is_empty()) {
        return Err(Error::NothingFinite { plane });
    }
    let copied = twin::copied(samples, &masks, options);
    let sets = sets(masks, &copied);
    let restores = options.restores();
    let solve = |samples: &Planes, (mask, places, copied): (&Arc<Mask>, Vec<usize>, bool)| {
        if copied {
            return Ok(twin::copy(samples, (mask, places), options));
        }
        solve::solve(samples, (mask, places), options, plans, run)
    };
    if let [(mask, _, copied)] = sets.as_slice()
        && (!mask.is_full() || restores)
    {
        let planes = (0..samples.len()).collect();
        let (planes, limited, set) = solve(samples, (mask, planes, *copied))?;
        let outcome = set.outcome;
        return Ok(Filled { planes, outcome, sets: vec![set], limited, non_finite });
    }
    let mut filled = Filled::untouched(samples.clone(), non_finite);
    for (mask, places, copied) in sets.into_iter().filter(|(mask, ..)| !mask.is_full() || restores) {
        let own = places.iter().map(|&at| samples.as_slice()[at].clone()).collect();
        let own = Planes::of(samples.size(), own);
        let (planes, limited, set) = solve(&own, (&mask, places, copied))?;
        for ((&at, plane), limited) in set.planes.iter().zip(planes.into_vec()).zip(limited) {
            filled.planes.as_mut_slice()[at] = plane;
            filled.limited[at] = limited;
        }
        let outcome = set.outcome;
        filled.outcome = if filled.sets.is_empty() { outcome } else { filled.outcome.worst(outcome) };
        filled.sets.push(set);
    }
    Ok(filled)
}

impl Filled {
    fn untouched(planes: Planes, non_finite: Vec<usize>) -> Self {
        let limited = vec![Moved::default(); planes.len()];
        Self { planes, outcome: Outcome::direct(), sets: Vec::new(), limited, non_finite }
    }

    /// The pixels of a plane that count as measured; nothing if none was missing.
    pub fn mask(&self, plane: usize) -> Option<&Arc<Mask>> {
        self.sets.iter().find(|set| set.planes.contains(&plane)).map(|set| &set.mask)
    }

    /// The estimated root mean square error of each pixel over all planes that were not copied, 0 at measured ones; nothing if a set of
    /// them has none.
    pub fn errors(&self) -> Option<Plane> {
        let sets: Vec<&Set> = self.sets.iter().filter(|set| !set.copied).collect();
        let all: Vec<&Plane> = sets.iter().map(|set| set.errors.as_ref()).collect::<Option<_>>()?;
        let mut found = all.first().copied()?.clone();
        if all.len() > 1 {
            let planes: usize = sets.iter().map(|set| set.planes.len()).sum();
            for (at, error) in found.pixels_mut().iter_mut().enumerate() {
                // Squares may leave f32.
                let square = |(set, errors): (&&Set, &&Plane)| {
                    set.planes.len() as f64 * f64::from(errors.pixels()[at]).powi(2)
                };
                *error = (sets.iter().zip(&all).map(square).sum::<f64>() / planes as f64).sqrt() as f32;
            }
        }
        Some(found)
    }
}

/// Sizes and numbers agree.
fn check(samples: &Planes, mask: &Mask, options: &Options<'_>) -> Result<(), Error> {
    if !(options.peak > 0.0 && options.peak.is_finite()) {
        return Err(Error::setting("peak", &options.peak, "a finite number above 0"));
    }
    let like: Option<&[Plane]> = if let Noise::Like(planes) = &options.noise { Some(planes) } else { None };
    let gradients = options.gradients.iter().flatten().flatten();
    let sizes = [("samples", samples.size())].into_iter();
    let sizes = sizes.chain(options.weights.iter().map(|plane| ("weights", plane.size())));
    let sizes = sizes.chain(gradients.map(|plane| ("gradients", plane.size())));
    let sizes = sizes.chain(options.twins.iter().flatten().map(|plane| ("twins", plane.size())));
    let sizes = sizes.chain(options.guides.map(|guides| ("guides", guides.size())));
    let sizes = sizes.chain(like.into_iter().flatten().map(|plane| ("noise", plane.size())));
    let carried = || options.carried.iter().flat_map(Carried::all);
    let mut sizes = sizes.chain(carried().map(|carried| ("samples of another frame", carried.size())));
    if let Some((name, other)) = sizes.find(|(_, size)| *size != mask.size()) {
        return Err(Error::size(mask.size(), name, other));
    }
    let some = |count: usize| Some(count).filter(|count| *count != 0);
    let counts = [
        ("bounds", some(options.bounds.len())),
        ("gradients", some(options.gradients.len())),
        ("twins", some(options.twins.len())),
        ("noise planes", like.map(<[Plane]>::len)),
    ];
    let counts = counts.into_iter().filter_map(|(what, count)| Some((what, count?)));
    let mut counts = counts.chain(carried().map(|carried| ("planes of another frame", carried.planes())));
    if let Some((what, count)) = counts.find(|(_, count)| *count != samples.len()) {
        let found = format!("{count} {what} for {} planes", samples.len());
        return Err(Error::SizeMismatch { expected: mask.size(), found });
    }
    Ok(())
}

/// The measured pixels whose value is finite; the same mask if all are.
fn usable(mask: &Arc<Mask>, plane: &Plane) -> Arc<Mask> {
    if crate::check::finite(mask, plane.pixels()).is_ok() {
        return Arc::clone(mask);
    }
    let flags = mask.as_slice().iter().zip(plane.pixels());
    Arc::new(Mask::of(mask.size(), flags.map(|(&flag, value)| flag && value.is_finite()).collect()))
}

/// Planes of equal masks together, those that are copied apart, in the order of their first ones.
fn sets(masks: Vec<Arc<Mask>>, copied: &[bool]) -> Vec<(Arc<Mask>, Vec<usize>, bool)> {
    let mut sets: Vec<(Arc<Mask>, Vec<usize>, bool)> = Vec::new();
    for ((at, mask), &copied) in masks.into_iter().enumerate().zip(copied) {
        let same = |other: &Arc<Mask>| Arc::ptr_eq(other, &mask) || **other == *mask;
        match sets.iter_mut().find(|(other, _, kind)| *kind == copied && same(other)) {
            Some((_, planes, _)) => planes.push(at),
            None => sets.push((mask, vec![at], copied)),
        }
    }
    sets
}
