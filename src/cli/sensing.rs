//! Flags of the compressed-sensing filters.

use clap::{Args, ValueEnum};
use lacuna_filters::sensing::Solver;
use lacuna_filters::sensing::cs_gradient::{self, Anchor};
use lacuna_filters::sensing::cs_wavelet;
use lacuna_filters::sensing::wavelet::{Boundary, Wavelet};

use super::filter::{Name, above_zero, one_or_more, set, zero_or_more};

/// Settings of `cs-wavelet` and `cs-gradient`.
#[derive(Args, Clone, Debug, Default)]
pub struct SensingArgs {
    /// cs-wavelet: standard deviation of the blur, 0 or more
    #[arg(long, value_name = "SIGMA", value_parser = zero_or_more, allow_hyphen_values = true, help = help::csw_blur())]
    pub csw_blur: Option<f64>,

    /// cs-wavelet: regularisation of the blur's inverse, 0 or more
    #[arg(long, value_name = "KAPPA", value_parser = zero_or_more, allow_hyphen_values = true, help = help::csw_wiener())]
    pub csw_wiener: Option<f64>,

    /// cs-wavelet: the wavelet
    #[arg(long, value_name = "WAVELET", help = help::csw_wavelet())]
    pub csw_wavelet: Option<Wavelet>,

    /// cs-wavelet: levels of the transform
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u8).range(..=16), help = help::csw_levels())]
    pub csw_levels: Option<u8>,

    /// cs-wavelet: what lies beyond the edges
    #[arg(long, value_name = "BOUNDARY", help = help::csw_boundary())]
    pub csw_boundary: Option<BoundaryName>,

    /// cs-wavelet: distance from the samples that is allowed, 0 or more
    #[arg(long, value_name = "EPSILON", value_parser = zero_or_more, allow_hyphen_values = true, help = help::csw_epsilon())]
    pub csw_epsilon: Option<f64>,

    /// cs-wavelet: tolerance of the solver, above 0
    #[arg(long, value_name = "TOLERANCE", value_parser = above_zero, allow_hyphen_values = true, help = help::csw_tolerance())]
    pub csw_tolerance: Option<f64>,

    /// cs-wavelet: iterations at most, 1 or more
    #[arg(long, value_name = "N", value_parser = one_or_more, allow_hyphen_values = true, help = help::csw_iterations())]
    pub csw_iterations: Option<u32>,

    /// cs-wavelet: the solver
    #[arg(long, value_name = "SOLVER", help = help::csw_solver())]
    pub csw_solver: Option<SolverName>,

    /// cs-gradient: where the integration starts
    #[arg(long, value_name = "ANCHOR", help = help::csg_anchor())]
    pub csg_anchor: Option<AnchorName>,

    /// cs-gradient: measured pixels leave as recovered, too, instead of as they came
    #[arg(long)]
    pub csg_restore: bool,

    /// cs-gradient: distance from the gradient's samples that is allowed, 0 or more
    #[arg(long, value_name = "EPSILON", value_parser = zero_or_more, allow_hyphen_values = true, help = help::csg_epsilon())]
    pub csg_epsilon: Option<f64>,

    /// cs-gradient: tolerance of the solver, above 0
    #[arg(long, value_name = "TOLERANCE", value_parser = above_zero, allow_hyphen_values = true, help = help::csg_tolerance())]
    pub csg_tolerance: Option<f64>,

    /// cs-gradient: iterations at most, 1 or more
    #[arg(long, value_name = "N", value_parser = one_or_more, allow_hyphen_values = true, help = help::csg_iterations())]
    pub csg_iterations: Option<u32>,

    /// cs-gradient: the solver
    #[arg(long, value_name = "SOLVER", help = help::csg_solver())]
    pub csg_solver: Option<SolverName>,
}

/// A solver of l1 problems.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
pub enum SolverName {
    /// Nesterov's method on the smoothed norm
    Nesta,
    /// Primal-dual steps on the norm itself
    PrimalDual,
}

/// What lies beyond the edges.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
pub enum BoundaryName {
    /// The opposite edge
    Periodic,
    /// The mirror image
    Symmetric,
}

/// Where an integration starts.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
pub enum AnchorName {
    /// At the image border
    Border,
    /// At every measured pixel
    Measured,
}

/// Help texts that name the filters' own defaults.
mod help {
    use super::super::filter::defaults::with;
    use super::{cs_gradient, cs_wavelet};

    fn wavelet() -> cs_wavelet::Settings {
        cs_wavelet::Settings::default()
    }

    fn gradient() -> cs_gradient::Settings {
        cs_gradient::Settings::default()
    }

    pub fn csw_blur() -> String {
        let text = "cs-wavelet: standard deviation of the blur in DFT samples of the frame, 0 or more; smaller blurs more, 0 \
                    not at all";
        with(text, wavelet().blur)
    }

    pub fn csw_wiener() -> String {
        let text = "cs-wavelet: regularisation of the blur's inverse (Wiener), 0 or more; 0 takes it literally, larger is \
                    nearer to no blur";
        with(text, wavelet().wiener)
    }

    pub fn csw_wavelet() -> String {
        let text = "cs-wavelet: the wavelet: haar, db2 to db10, sym2 to sym10, coif1 to coif5 or cdf97";
        with(text, wavelet().wavelet)
    }

    pub fn csw_levels() -> String {
        with("cs-wavelet: levels of the transform, 0 to 16", wavelet().levels)
    }

    pub fn csw_boundary() -> String {
        with("cs-wavelet: what lies beyond the edges for the wavelet", wavelet().boundary.name())
    }

    pub fn csw_epsilon() -> String {
        let text = "cs-wavelet: distance from the samples that is allowed, a Euclidean norm over a channel's measured \
                    pixels, 0 or more; 0 is exact, larger is smoother and changes measured pixels";
        with(text, wavelet().epsilon)
    }

    pub fn csw_tolerance() -> String {
        let text = "cs-wavelet: relative change of the objective at which the solver stops, and its smoothing over the \
                    samples' range, above 0; smaller is closer to the minimum and slower";
        with(text, wavelet().tolerance)
    }

    pub fn csw_iterations() -> String {
        with("cs-wavelet: iterations at most, 1 or more", wavelet().max_iterations)
    }

    pub fn csw_solver() -> String {
        with("cs-wavelet: the solver", wavelet().solver.name())
    }

    pub fn csg_anchor() -> String {
        with("cs-gradient: the measured pixels from which gradients are integrated", gradient().anchor.name())
    }

    pub fn csg_epsilon() -> String {
        let text = "cs-gradient: distance from a component's samples that is allowed, a Euclidean norm, 0 or more; larger \
                    is smoother";
        with(text, gradient().epsilon)
    }

    pub fn csg_tolerance() -> String {
        let text = "cs-gradient: relative change of the objective at which the solver stops, and its smoothing over the \
                    largest sample, above 0; smaller is closer to the minimum and slower";
        with(text, gradient().tolerance)
    }

    pub fn csg_iterations() -> String {
        with("cs-gradient: iterations at most for a component, 1 or more", gradient().max_iterations)
    }

    pub fn csg_solver() -> String {
        with("cs-gradient: the solver", gradient().solver.name())
    }
}

impl SensingArgs {
    /// Each flag, whether it was given, and its filter.
    pub fn given(&self) -> [(&'static str, bool, Name); 15] {
        let (wavelet, gradient) = (Name::CsWavelet, Name::CsGradient);
        [
            ("--csw-blur", self.csw_blur.is_some(), wavelet),
            ("--csw-wiener", self.csw_wiener.is_some(), wavelet),
            ("--csw-wavelet", self.csw_wavelet.is_some(), wavelet),
            ("--csw-levels", self.csw_levels.is_some(), wavelet),
            ("--csw-boundary", self.csw_boundary.is_some(), wavelet),
            ("--csw-epsilon", self.csw_epsilon.is_some(), wavelet),
            ("--csw-tolerance", self.csw_tolerance.is_some(), wavelet),
            ("--csw-iterations", self.csw_iterations.is_some(), wavelet),
            ("--csw-solver", self.csw_solver.is_some(), wavelet),
            ("--csg-anchor", self.csg_anchor.is_some(), gradient),
            ("--csg-restore", self.csg_restore, gradient),
            ("--csg-epsilon", self.csg_epsilon.is_some(), gradient),
            ("--csg-tolerance", self.csg_tolerance.is_some(), gradient),
            ("--csg-iterations", self.csg_iterations.is_some(), gradient),
            ("--csg-solver", self.csg_solver.is_some(), gradient),
        ]
    }

    /// The settings of `cs-wavelet`.
    pub fn wavelet(&self) -> cs_wavelet::Settings {
        let mut settings = cs_wavelet::Settings::default();
        set(&mut settings.blur, self.csw_blur);
        set(&mut settings.wiener, self.csw_wiener);
        set(&mut settings.wavelet, self.csw_wavelet);
        set(&mut settings.levels, self.csw_levels.map(usize::from));
        let boundary = self.csw_boundary.map(|boundary| match boundary {
            BoundaryName::Periodic => Boundary::Periodic,
            BoundaryName::Symmetric => Boundary::Symmetric,
        });
        set(&mut settings.boundary, boundary);
        set(&mut settings.epsilon, self.csw_epsilon);
        set(&mut settings.tolerance, self.csw_tolerance);
        set(&mut settings.max_iterations, self.csw_iterations.map(|count| count as usize));
        set(&mut settings.solver, self.csw_solver.map(Solver::from));
        settings
    }

    /// The settings of `cs-gradient`.
    pub fn gradient(&self) -> cs_gradient::Settings {
        let mut settings = cs_gradient::Settings::default();
        let anchor = self.csg_anchor.map(|anchor| match anchor {
            AnchorName::Border => Anchor::Border,
            AnchorName::Measured => Anchor::Measured,
        });
        set(&mut settings.anchor, anchor);
        settings.restore = self.csg_restore;
        set(&mut settings.epsilon, self.csg_epsilon);
        set(&mut settings.tolerance, self.csg_tolerance);
        set(&mut settings.max_iterations, self.csg_iterations.map(|count| count as usize));
        set(&mut settings.solver, self.csg_solver.map(Solver::from));
        settings
    }
}

impl From<SolverName> for Solver {
    fn from(name: SolverName) -> Self {
        match name {
            SolverName::Nesta => Self::Nesta,
            SolverName::PrimalDual => Self::PrimalDual,
        }
    }
}
