//! The values of a group as they are compared: clipped or not, on which scale, without what is not finite.

use std::borrow::Cow;

use lacuna_core::parallel::prelude::*;
use lacuna_exr::{Part, Samples};
use lacuna_filters::Plane;
use lacuna_filters::metric::colour::{Chromaticities, srgb_encode};
use lacuna_filters::metric::error::Options;

use super::groups::Kind;
use super::model::Settings;

/// How the values of a group are taken.
pub struct Values {
    /// Peak and clipping.
    pub options: Options,
    display: bool,
}

impl Values {
    /// How the values of that kind are taken.
    pub fn new(kind: Kind, settings: &Settings, reference: &[Plane]) -> Self {
        match kind {
            Kind::Colour if settings.display => {
                Self { options: Options { peak: 1.0, clip: true }, display: true }
            }
            Kind::Colour => {
                Self { options: Options { peak: settings.peak, clip: settings.clip }, display: false }
            }
            Kind::Alpha => Self { options: Options { peak: 1.0, clip: settings.clip }, display: false },
            Kind::Data | Kind::Codes => {
                let largest = |plane: &Plane| {
                    plane
                        .pixels()
                        .iter()
                        .filter(|value| value.is_finite())
                        .fold(0.0_f32, |m, v| m.max(v.abs()))
                };
                let peak = reference.iter().map(largest).fold(0.0, f32::max);
                let peak = if peak > 0.0 { peak } else { 1.0 };
                Self { options: Options { peak, clip: false }, display: false }
            }
        }
    }

    /// The planes after the display's curve, if there is one.
    pub fn shown(&self, planes: &[Plane]) -> Option<Vec<Plane>> {
        let curve = |plane: &Plane| {
            let mut shown = plane.clone();
            shown.pixels_mut().par_iter_mut().for_each(|value| {
                if value.is_finite() {
                    *value = srgb_encode(value.clamp(0.0, 1.0));
                }
            });
            shown
        };
        self.display.then(|| planes.iter().map(curve).collect())
    }
}

/// Planes without values that are not finite, clipped where values are; borrowed where nothing is to be changed.
pub struct Clean<'a>(Vec<[Cow<'a, Plane>; 2]>);

impl<'a> Clean<'a> {
    /// As the measures take them.
    pub fn new(reference: &'a [Plane], test: &'a [Plane], values: &Values) -> Self {
        let clip = values.options.clip.then_some(values.options.peak);
        Self::with(reference, test, clip)
    }

    /// As they are in the file.
    pub fn of_linear(reference: &'a [Plane], test: &'a [Plane]) -> Self {
        Self::with(reference, test, None)
    }

    fn with(reference: &'a [Plane], test: &'a [Plane], clip: Option<f32>) -> Self {
        let clean = |(a, b): (&'a Plane, &'a Plane)| {
            let fits = |value: &f32| match clip {
                Some(peak) => (0.0..=peak).contains(value),
                None => value.is_finite(),
            };
            let pass = |value: f32| clip.map_or(value, |peak| value.clamp(0.0, peak));
            let own = |plane: &'a Plane, reference: Option<&Plane>| {
                let plane_fits = plane.pixels().par_iter().all(fits);
                let finite = reference.is_none_or(|plane| plane.pixels().par_iter().all(|v| v.is_finite()));
                if plane_fits && finite {
                    return Cow::Borrowed(plane);
                }
                let mut out = plane.clone();
                out.pixels_mut().par_iter_mut().enumerate().for_each(|(at, value)| {
                    let usable = value.is_finite() && reference.is_none_or(|r| r.pixels()[at].is_finite());
                    *value = if usable { pass(*value) } else { 0.0 };
                });
                Cow::Owned(out)
            };
            [own(a, None), own(b, Some(a))]
        };
        Self(reference.iter().zip(test).map(clean).collect())
    }

    /// Reference and test image, channel by channel.
    pub fn pairs(&self) -> impl Iterator<Item = (&Plane, &Plane)> {
        self.0.iter().map(|[a, b]| (&**a, &**b))
    }

    /// Red, green and blue of one side; one plane for all three if there is only luminance.
    pub fn rgb(&self, side: usize) -> Option<[&Plane; 3]> {
        match self.0.as_slice() {
            [r, g, b] => Some([&r[side], &g[side], &b[side]]),
            [y] => Some([&y[side], &y[side], &y[side]]),
            _ => None,
        }
    }
}

/// One value.
pub fn value(samples: &Samples, at: usize) -> f64 {
    match samples {
        Samples::Half(values) => values[at].to_f64(),
        Samples::Float(values) => f64::from(values[at]),
        Samples::Uint(values) => f64::from(values[at]),
    }
}

/// Per pixel, whether two channels differ in their bits; where the types differ, in their values.
pub fn differing<'a>(a: &'a Samples, b: &'a Samples) -> Box<dyn Iterator<Item = bool> + 'a> {
    match (a, b) {
        (Samples::Half(a), Samples::Half(b)) => {
            Box::new(a.iter().zip(b).map(|(a, b)| a.to_bits() != b.to_bits()))
        }
        (Samples::Float(a), Samples::Float(b)) => {
            Box::new(a.iter().zip(b).map(|(a, b)| a.to_bits() != b.to_bits()))
        }
        (Samples::Uint(a), Samples::Uint(b)) => Box::new(a.iter().zip(b).map(|(a, b)| a != b)),
        _ => Box::new((0..a.len()).map(move |at| {
            let (a, b) = (value(a, at), value(b, at));
            a != b && !(a.is_nan() && b.is_nan())
        })),
    }
}

/// The part's chromaticities; those of BT.709 where it has none or they cannot be.
pub fn chromaticities(part: &Part) -> Chromaticities {
    let Some(attribute) = part.attributes.get("chromaticities") else { return Chromaticities::default() };
    let values: Vec<f64> = attribute
        .value
        .chunks_exact(4)
        .map(|bytes| f64::from(f32::from_le_bytes([bytes[0], bytes[1], bytes[2], bytes[3]])))
        .collect();
    let [rx, ry, gx, gy, bx, by, wx, wy] = values[..] else { return Chromaticities::default() };
    let found = Chromaticities { red: [rx, ry], green: [gx, gy], blue: [bx, by], white: [wx, wy] };
    if found.to_xyz().is_some() { found } else { Chromaticities::default() }
}
