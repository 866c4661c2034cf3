//! What a user may set.

use super::Kernel;
use crate::choose::Given;
use crate::descriptor::Kind;
use crate::descriptor::{Configured, Descriptor, Field, Memory, Range, Setting, Takes, words};
use crate::{Error, Run, check};

/// Order of the derivatives whose energy is least.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Order {
    /// Second derivatives: equation 3.16.
    #[default]
    Second,
    /// Third derivatives: better on smooth renders, worse at edges.
    Third,
}

impl Order {
    /// 2 or 3.
    pub const fn number(self) -> usize {
        match self {
            Self::Second => 2,
            Self::Third => 3,
        }
    }

    /// From this lambda on the result is off its limit, polynomials, by more through rounding than through what lambda lacks.
    pub(super) const fn smoothest(self) -> f64 {
        match self {
            Self::Second => 1e10,
            Self::Third => 1e8,
        }
    }
}

/// Settings of the smoothness splines.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Settings {
    /// Weight of the energy against the squared distance from the samples: 0 (default) passes through them and keeps
    /// their bits, larger is smoother. At least 0, finite. In units of the weights' inverse. Beyond 1e10 (order 3: 1e8), over the tension where
    /// that is above 1, and below 1e-13 it counts as that.
    pub lambda: f64,
    /// The function between the samples.
    pub kernel: Kernel,
    /// The order of its derivatives in the energy.
    pub order: Order,
    /// Share of first derivatives in the energy, at least 0 and finite; larger pulls large holes flat. Beyond 1e10 it counts as that.
    /// Default 0.03: between near samples it costs 0.02 dB, in a hole of 256 x 256 pixels it gains 0.7 dB over 0.004 and
    /// the fill no longer swings into colours that are not there.
    pub tension: f64,
}

impl Default for Settings {
    fn default() -> Self {
        Self { lambda: 0.0, kernel: Kernel::default(), order: Order::default(), tension: 0.03 }
    }
}

impl Settings {
    /// Whether every setting is in its range.
    ///
    /// # Errors
    /// [`Error::Setting`].
    pub fn check(&self) -> Result<(), Error> {
        check::not_negative("lambda", self.lambda)?;
        check::not_negative("tension", self.tension)
    }
}

words!(Kernel {
    Bspline: "bspline", "The cardinal cubic B-spline";
    Piecewise: "piecewise", "The thesis's kernel, taken piece by piece";
});

words!(Order {
    Second: "2", "Second derivatives";
    Third: "3", "Third derivatives";
});

/// What is to be known of the splines.
pub static DESCRIPTOR: Descriptor = Descriptor {
    name: "ss",
    help: "Smoothness splines: smooth everywhere, and fast",
    settings: &[
        Setting {
            name: "lambda",
            flag: "ss-lambda",
            value: "LAMBDA",
            range: Range::NotNegative,
            help: "weight of smoothness against the samples, 0 or more; 0 interpolates, larger is smoother and changes \
                   measured pixels, up to 1e10 (order 3: 1e8); auto: as much as their noise asks for",
            smooths: true,
            auto: true,
            ..Setting::PLAIN
        },
        Setting {
            name: "kernel",
            flag: "ss-kernel",
            value: "KERNEL",
            range: Range::OneOf(Kernel::CHOICES),
            help: "the spline through the samples, whose derivatives are kept small",
            ..Setting::PLAIN
        },
        Setting {
            name: "order",
            flag: "ss-order",
            value: "ORDER",
            range: Range::OneOf(Order::CHOICES),
            help: "the order of those derivatives; 3 is smoother, 2 is calmer at edges and in holes",
            ..Setting::PLAIN
        },
        Setting {
            name: "tension",
            flag: "ss-tension",
            value: "TENSION",
            range: Range::NotNegative,
            help: "share of first derivatives in the energy, 0 or more; larger pulls large holes flat, up to 1e10",
            ..Setting::PLAIN
        },
    ],
    // Uneven: the levels of multigrid on all of the image.
    even: Memory { image: 26, channel: 3 },
    uneven: Memory { image: 160, channel: 6 },
    takes: Takes { guides: true, weights: true, ..Takes::NOTHING },
    restores: false,
    held_out: Some(Kind::Spline),
    new: || Box::new(Settings::default()),
};

impl Configured for Settings {
    fn descriptor(&self) -> &'static Descriptor {
        &DESCRIPTOR
    }

    fn memory(&self, holes: f64) -> Memory {
        // Tiles only interpolate, and beside holes only at second order.
        let whole = self.lambda > 0.0 || (self.order == Order::Third && holes > 0.0);
        let Memory { image, channel } = DESCRIPTOR.memory(if whole { 1.0 } else { holes });
        // Multigrid is in f64 at third order.
        let wide = if self.order == Order::Third && whole { 2 } else { 1 };
        Memory { image: wide * image, channel }
    }

    fn field(&mut self, name: &str) -> Option<&mut dyn Field> {
        Some(match name {
            "lambda" => &mut self.lambda,
            "kernel" => &mut self.kernel,
            "order" => &mut self.order,
            "tension" => &mut self.tension,
            _ => return None,
        })
    }

    fn choose(
        &self,
        _name: &str,
        given: &Given<'_>,
        run: &Run<'_>,
    ) -> Result<Option<(f64, &'static str)>, Error> {
        let found = super::choose::smoothness(self, given, run)?;
        Ok(Some((found.lambda, found.by)))
    }

    fn boxed(&self) -> Box<dyn Configured> {
        Box::new(*self)
    }
}
