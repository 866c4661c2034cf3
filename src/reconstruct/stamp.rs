//! The attributes that say how a part was filled, and those that are no longer true of it.

use lacuna_filters::Method;

use super::job::{Job, parse_settings};
use crate::channels::Override;
use crate::frame::Attributes;
use crate::mask::Source;

/// The version that made the part.
pub const VERSION: &str = "lacuna/version";
/// The filter's name.
pub const FILTER: &str = "lacuna/filter";
/// Everything else that changes the result.
pub const SETTINGS: &str = "lacuna/settings";
/// Measured pixels over all pixels, before non-finite values were counted out.
pub const DENSITY: &str = "lacuna/density";
/// Where the mask was found.
pub const MASK: &str = crate::mask::ATTRIBUTE;

/// All attributes that filling adds.
pub const ADDED: &[&str] = &[VERSION, FILTER, SETTINGS, DENSITY, MASK];

/// Attributes derived from pixels, which would lie once the pixels differ.
pub const DERIVED: &[&str] = &["preview", "oiio:SHA-1", "oiio:AverageColor", "oiio:ConstantColor"];

/// What a filled part says about its making.
#[derive(Clone, Debug, PartialEq)]
pub struct Stamp {
    /// The version of lacuna.
    pub version: String,
    /// The filter's name.
    pub filter: String,
    /// The line of [`Job::settings`].
    pub settings: String,
    /// Where the mask was found.
    pub mask: String,
}

impl Stamp {
    /// The stamp of what a job makes with this version; `mask` is where the mask was found.
    pub fn new(job: &Job, mask: &str) -> Self {
        Self {
            version: env!("CARGO_PKG_VERSION").into(),
            filter: Method::name(&job.method).into(),
            settings: job.settings(),
            mask: mask.into(),
        }
    }

    /// The same with another origin of the mask.
    #[must_use]
    pub fn with_mask(&self, mask: String) -> Self {
        Self { mask, ..self.clone() }
    }

    /// The stamp of a part, if it has a whole one.
    pub fn read(attributes: &Attributes) -> Option<Self> {
        let text = |name| attributes.text(name);
        Some(Self {
            version: text(VERSION)?,
            filter: text(FILTER)?,
            settings: text(SETTINGS)?,
            mask: text(MASK)?,
        })
    }

    /// Writes the stamp, and the density of the part.
    pub fn write(&self, attributes: &mut Attributes, density: f64) {
        attributes.set_text(VERSION, &self.version);
        attributes.set_text(FILTER, &self.filter);
        attributes.set_text(SETTINGS, &self.settings);
        attributes.set(DENSITY, "float", (density as f32).to_le_bytes().to_vec());
        attributes.set_text(MASK, &self.mask);
    }

    /// Whether a file with this stamp is what `job` would make again, as far as the settings tell.
    pub fn is_of(&self, job: &Job) -> bool {
        let new = Self::new(job, &self.mask);
        *self == new
    }

    /// The value of one setting.
    pub fn setting(&self, name: &str) -> Option<String> {
        parse_settings(&self.settings).into_iter().rev().find(|pair| pair.0 == name).map(|pair| pair.1)
    }

    /// The mask source to find the same mask again: what was asked for, with a file's path as it was resolved.
    pub fn source(&self) -> Option<Source> {
        let asked: Source = self.setting("mask")?.parse().ok()?;
        match asked {
            Source::File { .. } => self.mask.parse().ok(),
            other => Some(other),
        }
    }

    /// The channel rules that were asked for.
    pub fn overrides(&self) -> Vec<Override> {
        let text = self.setting("channels").unwrap_or_default();
        text.lines().filter_map(|line| line.parse().ok()).collect()
    }
}
