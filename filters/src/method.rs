//! The methods a user picks from. A new filter is one file and one line here.

use crate::Filter;
use crate::baseline::{cubic, linear, nearest, push_pull};
use crate::dictionary::fill;
use crate::sensing::{cs_gradient, cs_wavelet};
use crate::variational::{ss, tv};

/// A reconstruction method with its settings.
#[derive(Clone, Debug, PartialEq)]
#[non_exhaustive]
pub enum Method {
    /// Smoothness splines.
    Ss(ss::Settings),
    /// Total variation.
    Tv(tv::Settings),
    /// Push-pull pyramid.
    PushPull(push_pull::Settings),
    /// The nearest measured pixel.
    Nearest(nearest::Settings),
    /// Planes on triangles of measured pixels.
    Linear(linear::Settings),
    /// Cubic pieces on triangles of measured pixels.
    Cubic(cubic::Settings),
    /// Compressed sensing in the wavelet domain.
    CsWavelet(cs_wavelet::Settings),
    /// Compressed sensing of the gradient in the Fourier domain.
    CsGradient(cs_gradient::Settings),
    /// Few atoms of a learned dictionary.
    Dictionary(fill::Learned),
    /// Few cosines.
    Dct(fill::Cosines),
}

impl Method {
    /// Every name that `--filter` takes.
    pub const NAMES: &[&str] = &[
        "ss",
        "tv",
        "pushpull",
        "nearest",
        "linear",
        "cubic",
        "cs-wavelet",
        "cs-gradient",
        "dictionary",
        "dct",
    ];

    /// The name that `--filter` takes.
    pub const fn name(&self) -> &'static str {
        match self {
            Self::Ss(_) => "ss",
            Self::Tv(_) => "tv",
            Self::PushPull(_) => "pushpull",
            Self::Nearest(_) => "nearest",
            Self::Linear(_) => "linear",
            Self::Cubic(_) => "cubic",
            Self::CsWavelet(_) => "cs-wavelet",
            Self::CsGradient(_) => "cs-gradient",
            Self::Dictionary(_) => "dictionary",
            Self::Dct(_) => "dct",
        }
    }

    /// The settings on one line, `name=value` separated by spaces; equal lines mean equal results.
    pub fn settings(&self) -> String {
        match self {
            Self::Ss(settings) => settings.to_string(),
            Self::Tv(settings) => settings.to_string(),
            Self::PushPull(_) | Self::Nearest(_) | Self::Linear(_) | Self::Cubic(_) => String::new(),
            Self::CsWavelet(settings) => settings.to_string(),
            Self::CsGradient(settings) => settings.to_string(),
            Self::Dictionary(settings) => settings.to_string(),
            Self::Dct(settings) => settings.to_string(),
        }
    }

    /// The filter itself.
    pub fn filter(&self) -> &dyn Filter {
        match self {
            Self::Ss(settings) => settings,
            Self::Tv(settings) => settings,
            Self::PushPull(settings) => settings,
            Self::Nearest(settings) => settings,
            Self::Linear(settings) => settings,
            Self::Cubic(settings) => settings,
            Self::CsWavelet(settings) => settings,
            Self::CsGradient(settings) => settings,
            Self::Dictionary(settings) => settings,
            Self::Dct(settings) => settings,
        }
    }

    /// Whether measured pixels leave with the bits they came with.
    pub fn keeps_measured(&self) -> bool {
        match self {
            Self::Ss(settings) => settings.lambda == 0.0,
            Self::Tv(settings) => settings.epsilon == 0.0,
            Self::PushPull(_) | Self::Nearest(_) | Self::Linear(_) | Self::Cubic(_) => true,
            Self::CsWavelet(settings) => settings.epsilon == 0.0,
            Self::CsGradient(settings) => !settings.restore,
            Self::Dictionary(settings) => !settings.how.restore,
            Self::Dct(settings) => !settings.how.restore,
        }
    }

    /// Whether frames without a missing pixel are not left as they are.
    pub fn restores(&self) -> bool {
        matches!(self, Self::Dictionary(_) | Self::Dct(_)) && !self.keeps_measured()
    }
}

#[cfg(test)]
mod tests {
    use std::sync::Arc;

    use super::*;
    use crate::{Error, Mask, Plane, Planes, Problem, Run, Size};

    fn all() -> [Method; 10] {
        [
            Method::Ss(ss::Settings::default()),
            Method::Tv(tv::Settings::default()),
            Method::PushPull(push_pull::Settings),
            Method::Nearest(nearest::Settings),
            Method::Linear(linear::Settings),
            Method::Cubic(cubic::Settings),
            Method::CsWavelet(cs_wavelet::Settings::default()),
            Method::CsGradient(cs_gradient::Settings::default()),
            Method::Dictionary(fill::Learned {
                dictionary: Arc::new(crate::dictionary::dct::dictionary(4, 16).unwrap()),
                name: "cosines".into(),
                how: fill::Use::default(),
            }),
            Method::Dct(fill::Cosines::default()),
        ]
    }

    fn smoothing() -> ss::Settings {
        let smooth = |mut settings: ss::Settings| {
            settings.lambda = 0.5;
            settings
        };
        smooth(ss::Settings::default())
    }

    #[test]
    fn names_are_those_of_the_command_line() {
        assert_eq!(all().map(|method| method.name()).as_slice(), Method::NAMES);
    }

    #[test]
    fn by_default_every_method_interpolates() {
        assert!(all().iter().all(Method::keeps_measured));
        assert!(!Method::Ss(smoothing()).keeps_measured());
        let mut smoothing = Method::Tv(tv::Settings::default());
        if let Method::Tv(settings) = &mut smoothing {
            settings.epsilon = 0.5;
        }
        assert!(!smoothing.keeps_measured());
    }

    #[test]
    fn settings_tell_methods_with_settings_apart() {
        let [ss, _, push_pull, nearest, ..] = all();
        assert_ne!(ss.settings(), Method::Ss(smoothing()).settings());
        assert!(!ss.settings().contains('\n'));
        assert_eq!((push_pull.settings().as_str(), nearest.settings().as_str()), ("", ""));
    }

    #[test]
    fn the_filter_is_that_of_the_method() {
        let size = Size::new(1, 4);
        let problem =
            |measured: &[usize]| Problem::fill(Arc::new(Mask::from_fn(size, |_, x| measured.contains(&x))));
        let samples = Plane::new(size, vec![0.0, f32::NAN, f32::NAN, 8.0]).unwrap();
        let samples = Planes::new(size, vec![samples]).unwrap();
        for (method, expected) in [(&all()[2], [0.0, 2.0, 6.0, 8.0]), (&all()[3], [0.0, 0.0, 8.0, 8.0])] {
            let empty = method.filter().plan(&problem(&[]), &Run::default());
            assert_eq!(empty.err(), Some(Error::EmptyMask));
            let plan = method.filter().plan(&problem(&[0, 3]), &Run::default()).unwrap();
            let mut out = Planes::zeros(size, 1);
            plan.reconstruct(&samples, &mut out, &Run::default()).unwrap();
            assert_eq!(out.as_slice()[0].pixels(), expected, "{}", method.name());
        }
    }
}
