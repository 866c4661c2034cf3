//! Values of settings that the samples choose: what the choice is given, and what comes of it.

use std::sync::Arc;

use crate::{Mask, Plane, Planes};

/// The word for such a value.
pub const AUTO: &str = "auto";

/// What a value is chosen by.
#[derive(Clone, Copy, Debug)]
pub struct Given<'a> {
    /// The measured pixels.
    pub mask: &'a Arc<Mask>,
    /// Their values, all finite.
    pub samples: &'a Planes,
    /// Noise like theirs, NaN where it is not known; nothing if it is known nowhere.
    pub noise: Option<&'a Planes>,
    /// How much each counts.
    pub weights: Option<&'a Arc<Plane>>,
}

/// A value that was chosen.
#[derive(Clone, Debug, PartialEq)]
pub struct Chosen {
    /// The name of the setting.
    pub name: &'static str,
    /// Its value, as the settings line has it.
    pub value: String,
    /// What chose it.
    pub by: &'static str,
}

impl std::fmt::Display for Chosen {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        write!(f, "{}={} by {}", self.name, self.value, self.by)
    }
}
