//! The methods a user picks from. A new filter is one file and one line here.

use crate::Filter;
use crate::baseline::{nearest, push_pull};
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
}

impl Method {
    /// The name that `--filter` takes.
    pub const fn name(&self) -> &'static str {
        match self {
            Self::Ss(_) => "ss",
            Self::Tv(_) => "tv",
            Self::PushPull(_) => "pushpull",
            Self::Nearest(_) => "nearest",
        }
    }

    /// The settings on one line, `name=value` separated by spaces; equal lines mean equal results.
    pub fn settings(&self) -> String {
        match self {
            Self::Ss(settings) => settings.to_string(),
            Self::Tv(settings) => settings.to_string(),
            Self::PushPull(_) | Self::Nearest(_) => String::new(),
        }
    }

    /// The filter itself.
    pub fn filter(&self) -> &dyn Filter {
        match self {
            Self::Ss(settings) => settings,
            Self::Tv(settings) => settings,
            Self::PushPull(settings) => settings,
            Self::Nearest(settings) => settings,
        }
    }

    /// Whether measured pixels leave with the bits they came with.
    pub fn keeps_measured(&self) -> bool {
        match self {
            Self::Ss(settings) => settings.lambda == 0.0,
            Self::Tv(settings) => settings.epsilon == 0.0,
            Self::PushPull(_) | Self::Nearest(_) => true,
        }
    }
}
