//! Flags that choose a filter and its settings.

use std::fmt::Display;
use std::str::FromStr;

use clap::{Args, ValueEnum};
use lacuna_filters::Method;
use lacuna_filters::baseline::{cubic, linear, nearest, push_pull};
use lacuna_filters::sensing::Solver;
use lacuna_filters::variational::{ss, tv};

use super::Usage;
use super::dictionary::DictionaryArgs;
use super::sensing::{SensingArgs, SolverName};
use crate::reconstruct::Domain;

/// The filter and its settings.
#[derive(Args, Clone, Debug)]
#[command(next_help_heading = "Filter")]
pub struct FilterArgs {
    /// The filter that reconstructs colour
    #[arg(long, value_name = "NAME", default_value = "ss")]
    pub filter: Name,

    #[command(flatten)]
    #[allow(
        missing_docs,
        reason = "rustdoc on a flattened group would become the help of the whole subcommand"
    )]
    pub settings: SettingArgs,

    /// tv: how the image is found, to the same gap
    #[arg(long, value_name = "SOLVER", help = defaults::tv_solver())]
    pub tv_solver: Option<SolverName>,

    /// Settings of the compressed-sensing filters
    #[command(flatten)]
    pub sensing: SensingArgs,

    /// Settings of the filters with a dictionary
    #[command(flatten)]
    pub dictionary: DictionaryArgs,
}

/// The settings of the filters.
#[derive(Args, Clone, Debug)]
#[command(next_help_heading = "Filter")]
pub struct SettingArgs {
    /// ss: weight of smoothness against the samples, 0 or more
    #[arg(long, value_name = "LAMBDA", value_parser = zero_or_more, allow_hyphen_values = true, help = defaults::ss_lambda())]
    pub ss_lambda: Option<f64>,

    /// ss: the spline whose derivatives are measured
    #[arg(long, value_name = "KERNEL", help = defaults::ss_kernel())]
    pub ss_kernel: Option<Kernel>,

    /// ss: the order of the derivatives that are kept small
    #[arg(long, value_name = "ORDER", help = defaults::ss_order())]
    pub ss_order: Option<Order>,

    /// ss: share of first-order energy, 0 or more
    #[arg(long, value_name = "TENSION", value_parser = zero_or_more, allow_hyphen_values = true, help = defaults::ss_tension())]
    pub ss_tension: Option<f64>,

    /// tv: how the length of a gradient is measured
    #[arg(long, value_name = "NORM", help = defaults::tv_norm())]
    pub tv_norm: Option<Norm>,

    /// tv: distance from the samples that is allowed, 0 or more
    #[arg(long, value_name = "EPSILON", value_parser = zero_or_more, allow_hyphen_values = true, help = defaults::tv_epsilon())]
    pub tv_epsilon: Option<f64>,

    /// tv: relative duality gap at which the solver stops, above 0
    #[arg(long, value_name = "GAP", value_parser = above_zero, allow_hyphen_values = true, help = defaults::tv_gap())]
    pub tv_gap: Option<f64>,

    /// tv: iterations at most, 1 or more
    #[arg(long, value_name = "N", value_parser = one_or_more, allow_hyphen_values = true, help = defaults::tv_iterations())]
    pub tv_iterations: Option<u32>,

    /// Where colours are reconstructed: as they are, through a reversible logarithm (for highlights), or as their range
    /// asks for
    #[arg(long, value_name = "DOMAIN", default_value = "auto")]
    pub domain: DomainName,

    /// on or off: hold overshoot beside highlights and edges back to what the samples around allow
    #[arg(long, value_name = "SWITCH", default_value = "on", hide_possible_values = true)]
    pub limit: Switch,
}

/// Help texts that name the filters' own defaults.
pub(super) mod defaults {
    use lacuna_filters::variational::{ss, tv};

    pub fn with(text: &str, default: impl std::fmt::Display) -> String {
        format!("{text} [default: {default}]")
    }

    pub fn ss_lambda() -> String {
        let text = "ss: weight of smoothness against the samples, 0 or more; 0 interpolates, larger is smoother and \
                    changes measured pixels";
        with(text, ss::Settings::default().lambda)
    }

    pub fn ss_kernel() -> String {
        let default = match ss::Settings::default().kernel {
            ss::Kernel::Bspline => "bspline",
            ss::Kernel::Piecewise => "piecewise",
        };
        with("ss: the spline through the samples, whose derivatives are kept small", default)
    }

    pub fn ss_order() -> String {
        let text = "ss: the order of those derivatives; 3 is smoother, 2 is calmer at edges and in holes";
        with(text, ss::Settings::default().order.number())
    }

    pub fn ss_tension() -> String {
        let text = "ss: share of first derivatives in the energy, 0 or more; larger pulls large holes flat";
        with(text, ss::Settings::default().tension)
    }

    pub fn tv_norm() -> String {
        let text =
            "tv: how the length of a gradient is measured; anisotropic prefers edges along rows and columns";
        with(text, tv::Settings::default().norm)
    }

    pub fn tv_epsilon() -> String {
        let text = "tv: distance from the samples that is allowed, a Euclidean norm over a channel's measured pixels, 0 \
                    or more; 0 is exact, larger is smoother and changes measured pixels";
        with(text, tv::Settings::default().epsilon)
    }

    pub fn tv_gap() -> String {
        let text = "tv: relative duality gap at which the solver stops, above 0; smaller is closer to the minimum and \
                    slower";
        with(text, tv::Settings::default().gap)
    }

    pub fn tv_solver() -> String {
        let text = "tv: how the image is found, to the same gap; nesta is what the thesis used";
        with(text, tv::Settings::default().solver.name())
    }

    pub fn tv_iterations() -> String {
        with("tv: iterations at most, 1 or more", tv::Settings::default().max_iterations)
    }
}

/// A filter.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
pub enum Name {
    /// Smoothness splines: the best on smooth renders
    Ss,
    /// Total variation: flat regions between sharp edges
    Tv,
    /// Push-pull pyramid: fast and plain
    #[value(name = "pushpull")]
    PushPull,
    /// The nearest measured pixel
    Nearest,
    /// Planes on triangles of measured pixels
    Linear,
    /// Cubic pieces on triangles of measured pixels, without creases
    Cubic,
    /// Compressed sensing: sparse wavelet coefficients; a baseline
    CsWavelet,
    /// Compressed sensing: gradients with a sparse spectrum; a baseline
    CsGradient,
    /// Few atoms of a learned dictionary a block (--dictionary FILE, see lacuna train)
    Dictionary,
    /// Few cosines a block; a baseline
    Dct,
}

/// The spline of `ss`.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
pub enum Kernel {
    /// The cardinal cubic B-spline
    Bspline,
    /// The thesis's kernel, taken piece by piece
    Piecewise,
}

/// The order of `ss`.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
pub enum Order {
    /// Second derivatives
    #[value(name = "2")]
    Second,
    /// Third derivatives
    #[value(name = "3")]
    Third,
}

/// The norm of `tv`.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
pub enum Norm {
    /// Euclidean length
    Isotropic,
    /// Sum of absolute differences
    Anisotropic,
}

/// Where colours are reconstructed.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
pub enum DomainName {
    /// Linear, or logarithmic where the measured range asks for it
    Auto,
    /// As they are
    Linear,
    /// Through a reversible logarithm, defined for zero and negative values
    Log,
}

/// On or off.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
pub enum Switch {
    /// Yes
    On,
    /// No
    Off,
}

impl FilterArgs {
    /// The filter with its settings. A setting of another filter is an error.
    pub fn method(&self) -> Result<Method, Usage> {
        self.settings.check(self.filter)?;
        SettingArgs::check_owner(&[("--tv-solver", self.tv_solver.is_some(), Name::Tv)], self.filter)?;
        SettingArgs::check_owner(&self.sensing.given(), self.filter)?;
        self.dictionary.check(self.filter)?;
        Ok(match self.filter {
            Name::Ss => Method::Ss(self.settings.ss()),
            Name::Tv => {
                let mut settings = self.settings.tv();
                set(&mut settings.solver, self.tv_solver.map(Solver::from));
                Method::Tv(settings)
            }
            Name::PushPull => Method::PushPull(push_pull::Settings),
            Name::Nearest => Method::Nearest(nearest::Settings),
            Name::Linear => Method::Linear(linear::Settings),
            Name::Cubic => Method::Cubic(cubic::Settings),
            Name::CsWavelet => Method::CsWavelet(self.sensing.wavelet()),
            Name::CsGradient => Method::CsGradient(self.sensing.gradient()),
            Name::Dictionary => Method::Dictionary(self.dictionary.learned()?),
            Name::Dct => Method::Dct(self.dictionary.cosines()?),
        })
    }
}

impl SettingArgs {
    /// A setting of another filter than the one in use is an error.
    pub fn check(&self, filter: Name) -> Result<(), Usage> {
        let settings = [
            ("--ss-lambda", self.ss_lambda.is_some(), Name::Ss),
            ("--ss-kernel", self.ss_kernel.is_some(), Name::Ss),
            ("--ss-order", self.ss_order.is_some(), Name::Ss),
            ("--ss-tension", self.ss_tension.is_some(), Name::Ss),
            ("--tv-norm", self.tv_norm.is_some(), Name::Tv),
            ("--tv-epsilon", self.tv_epsilon.is_some(), Name::Tv),
            ("--tv-gap", self.tv_gap.is_some(), Name::Tv),
            ("--tv-iterations", self.tv_iterations.is_some(), Name::Tv),
        ];
        Self::check_owner(&settings, filter)
    }

    fn check_owner(settings: &[(&str, bool, Name)], filter: Name) -> Result<(), Usage> {
        if let Some((flag, _, owner)) = settings.iter().find(|(_, given, owner)| *given && *owner != filter) {
            let name =
                |name: Name| name.to_possible_value().map_or(String::new(), |value| value.get_name().into());
            return Err(Usage(format!(
                "{flag} is a setting of --filter {}, but the filter is {}",
                name(*owner),
                name(filter)
            )));
        }
        Ok(())
    }

    /// Whether overshoot is limited.
    pub fn limits(&self) -> bool {
        self.limit == Switch::On
    }

    /// The domain.
    pub fn domain(&self) -> Domain {
        match self.domain {
            DomainName::Auto => Domain::Auto,
            DomainName::Linear => Domain::Linear,
            DomainName::Log => Domain::Log,
        }
    }

    /// The settings of the splines.
    pub fn ss(&self) -> ss::Settings {
        let mut settings = ss::Settings::default();
        set(&mut settings.lambda, self.ss_lambda);
        set(&mut settings.tension, self.ss_tension);
        let kernel = self.ss_kernel.map(|kernel| match kernel {
            Kernel::Bspline => ss::Kernel::Bspline,
            Kernel::Piecewise => ss::Kernel::Piecewise,
        });
        set(&mut settings.kernel, kernel);
        let order = self.ss_order.map(|order| match order {
            Order::Second => ss::Order::Second,
            Order::Third => ss::Order::Third,
        });
        set(&mut settings.order, order);
        settings
    }

    /// The settings of total variation.
    pub fn tv(&self) -> tv::Settings {
        let mut settings = tv::Settings::default();
        set(&mut settings.epsilon, self.tv_epsilon);
        set(&mut settings.gap, self.tv_gap);
        set(&mut settings.max_iterations, self.tv_iterations.map(|count| count as usize));
        let norm = self.tv_norm.map(|norm| match norm {
            Norm::Isotropic => tv::Norm::Isotropic,
            Norm::Anisotropic => tv::Norm::Anisotropic,
        });
        set(&mut settings.norm, norm);
        settings
    }
}

pub(super) fn set<T>(setting: &mut T, given: Option<T>) {
    if let Some(value) = given {
        *setting = value;
    }
}

fn number<T: FromStr>(text: &str, range: impl Display, fits: impl Fn(&T) -> bool) -> Result<T, String> {
    text.parse().ok().filter(fits).ok_or_else(|| format!("it must be a number {range}"))
}

pub(super) fn zero_or_more(text: &str) -> Result<f64, String> {
    number(text, "of 0 or more", |value: &f64| *value >= 0.0 && value.is_finite())
}

pub(super) fn one_or_more(text: &str) -> Result<u32, String> {
    number(text, "of 1 or more", |value: &u32| *value >= 1)
}

pub(super) fn above_zero(text: &str) -> Result<f64, String> {
    number(text, "above 0", |value: &f64| *value > 0.0 && value.is_finite())
}

pub(super) fn fraction(text: &str) -> Result<f64, String> {
    number(text, "from 0 to 1", |value: &f64| (0.0..=1.0).contains(value))
}
