//! What is to be known of a method without running it: one record that help texts, checks and plans of memory read.

mod field;

pub use field::{Choice, Field};
pub(crate) use field::{plain, words};

use crate::choose::{AUTO, Given};
use crate::{Error, Filter, Run};

/// A method: its name, its settings, what it needs.
#[derive(Debug)]
pub struct Descriptor {
    /// The name that tells it from the others.
    pub name: &'static str,
    /// What it is, in a line.
    pub help: &'static str,
    /// Its settings, in the order of the settings line.
    pub settings: &'static [Setting],
    /// The memory that filling takes where measured pixels lie everywhere.
    pub even: Memory,
    /// The same where a mask is all [`holes`](crate::estimate::holes).
    pub uneven: Memory,
    /// What it can use beside samples.
    pub takes: Takes,
    /// Whether images without a missing pixel are smoothed, too, where the settings ask for smoothing.
    pub restores: bool,
    /// The variance that errors of held-out samples go with; nothing where a fill takes too long to be made again for an estimate.
    pub held_out: Option<Kind>,
    /// The method as it is by default.
    pub new: fn() -> Box<dyn Configured>,
}

/// Bytes a pixel that filling takes beside samples and result, the estimate's among them: as measured.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Memory {
    /// For the image.
    pub image: u64,
    /// For every channel that is filled with others at the same time.
    pub channel: u64,
}

/// Which variance the errors of held-out samples go with ([`crate::estimate`]).
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Kind {
    /// That of splines of least second derivatives.
    Spline,
    /// The mean squared distance to three samples.
    Distance,
    /// The mean squared distance to four samples.
    Density,
}

/// What a method can use beside samples and their mask.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
#[allow(clippy::struct_excessive_bools, reason = "each is a flag of its own")]
pub struct Takes {
    /// Complete planes that steer the image; only where measured pixels stay.
    pub guides: bool,
    /// Weights of the samples; only where measured pixels do not stay.
    pub weights: bool,
    /// Samples of the image's gradient.
    pub gradients: bool,
    /// A learned dictionary, without which it cannot plan.
    pub dictionary: bool,
}

impl Takes {
    /// Samples and their mask only.
    pub const NOTHING: Self = Self { guides: false, weights: false, gradients: false, dictionary: false };
}

/// One setting of a method.
#[derive(Debug)]
pub struct Setting {
    /// Its name in the settings line.
    pub name: &'static str,
    /// Its name among the settings of all methods; empty if users do not set it.
    pub flag: &'static str,
    /// What stands for its value in help texts.
    pub value: &'static str,
    /// The values it may have.
    pub range: Range,
    /// What it does: unit, range and direction.
    pub help: &'static str,
    /// Whether measured pixels are changed where it is not zero or off.
    pub smooths: bool,
    /// Whether it may be `auto`: chosen by the samples ([`Configured::choose`]).
    pub auto: bool,
    /// Whether the settings line leaves it out at its default, so that lines of older versions still match.
    pub silent: bool,
}

impl Setting {
    /// A setting without a name, to be filled in.
    pub const PLAIN: Self = Self {
        name: "",
        flag: "",
        value: "",
        range: Range::Switch,
        help: "",
        smooths: false,
        auto: false,
        silent: false,
    };

    /// The values that it may have, in words.
    pub fn values(&self) -> String {
        if self.auto { format!("{}, or {AUTO}", self.range) } else { self.range.to_string() }
    }
}

/// The values that a setting may have.
#[derive(Clone, Copy, Debug)]
#[non_exhaustive]
pub enum Range {
    /// A finite number of 0 or more.
    NotNegative,
    /// A finite number above 0.
    Positive,
    /// A whole number between two.
    Count(usize, usize),
    /// A whole number of this or more, or a word.
    CountOr(usize, &'static str),
    /// One of these words.
    OneOf(&'static [Choice]),
    /// A word that the setting knows; this says which there are.
    Word(&'static str),
    /// On or off.
    Switch,
    /// A learned dictionary, which no text has.
    Dictionary,
}

impl std::fmt::Display for Range {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        match self {
            Self::NotNegative => f.write_str("a number of 0 or more"),
            Self::Positive => f.write_str("a number above 0"),
            Self::Count(least, usize::MAX) => write!(f, "a number of {least} or more"),
            Self::Count(least, most) => write!(f, "a number from {least} to {most}"),
            Self::CountOr(least, word) => write!(f, "a number of {least} or more, or {word}"),
            Self::OneOf(choices) => {
                let names: Vec<_> = choices.iter().map(|choice| choice.name).collect();
                f.write_str(&names.join(", "))
            }
            Self::Word(words) => f.write_str(words),
            Self::Switch => f.write_str("true or false"),
            Self::Dictionary => f.write_str("a learned dictionary"),
        }
    }
}

impl Range {
    /// Whether a text is in range, as far as the range alone can tell.
    pub fn holds(&self, text: &str) -> bool {
        let number =
            |fits: fn(f64) -> bool| text.parse().is_ok_and(|value: f64| value.is_finite() && fits(value));
        match self {
            Self::NotNegative => number(|value| value >= 0.0),
            Self::Positive => number(|value| value > 0.0),
            Self::Count(least, most) => {
                text.parse().is_ok_and(|value: usize| (*least..=*most).contains(&value))
            }
            Self::CountOr(least, word) => {
                text == *word || text.parse().is_ok_and(|value: usize| value >= *least)
            }
            Self::OneOf(choices) => choices.iter().any(|choice| choice.name == text),
            Self::Switch => matches!(text, "true" | "false"),
            Self::Word(_) => true,
            Self::Dictionary => false,
        }
    }
}

/// A filter whose settings can be read and set by name.
pub trait Configured: Filter + std::fmt::Debug {
    /// What is to be known of the method.
    fn descriptor(&self) -> &'static Descriptor;

    /// The place of a setting of the descriptor, by its name there; a filter without settings has none.
    fn field(&mut self, _name: &str) -> Option<&mut dyn Field> {
        None
    }

    /// The same filter.
    fn boxed(&self) -> Box<dyn Configured>;

    /// The memory that filling takes where so much of the image is [`holes`](crate::estimate::holes).
    fn memory(&self, holes: f64) -> Memory {
        self.descriptor().memory(holes)
    }

    /// Whether the settings fit together; each alone is in its range.
    ///
    /// # Errors
    /// [`Error::Setting`].
    fn check(&self) -> Result<(), Error> {
        Ok(())
    }

    /// Planes that a group must have; nothing if any number will do. Other groups are for the default method.
    fn planes(&self) -> Option<usize> {
        None
    }

    /// The value of a setting that may be `auto`, chosen by the samples, and what chose it.
    ///
    /// # Errors
    /// Those of the fills that it tries.
    fn choose(
        &self,
        _name: &str,
        _given: &Given<'_>,
        _run: &Run<'_>,
    ) -> Result<Option<(f64, &'static str)>, Error> {
        Ok(None)
    }

    /// The setting as it is, by its name in the descriptor, that weights of the samples cannot go with.
    fn unweighted(&self) -> Option<&'static str> {
        None
    }
}

impl Descriptor {
    /// The memory that filling takes where so much of the image is [`holes`](crate::estimate::holes).
    pub fn memory(&self, holes: f64) -> Memory {
        let between = |even: u64, uneven: u64| {
            (even as f64 + holes.clamp(0.0, 1.0) * (uneven as f64 - even as f64)).ceil() as u64
        };
        Memory {
            image: between(self.even.image, self.uneven.image),
            channel: between(self.even.channel, self.uneven.channel),
        }
    }

    /// The setting of that name.
    pub fn setting(&self, name: &str) -> Option<&'static Setting> {
        self.settings.iter().find(|setting| setting.name == name)
    }
}
