//! `--layers NAME=PATTERN`: channels that stand in files of their own become layers of the frame.
//!
//! Some renderers write each output to its own file and call its channels R, G and B whatever they hold. `mask::layers` puts them
//! into the frame.

use std::path::PathBuf;
use std::str::FromStr;

/// A layer, and the file or pattern that it comes from.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct LayerSource {
    /// What its channels are called, before a full stop.
    pub name: String,
    /// Path or pattern.
    pub pattern: String,
}

/// Why a text is no layer.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[error("'{0}' is not NAME=PATTERN: write for instance albedo=ALBEDO.####.exr")]
pub struct LayerError(String);

impl FromStr for LayerSource {
    type Err = LayerError;

    fn from_str(text: &str) -> Result<Self, Self::Err> {
        match text.split_once('=') {
            Some((name, pattern)) if !name.is_empty() && !pattern.is_empty() => {
                Ok(Self { name: name.into(), pattern: pattern.into() })
            }
            _ => Err(LayerError(text.into())),
        }
    }
}

impl std::fmt::Display for LayerSource {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        write!(f, "{}={}", self.name, self.pattern)
    }
}

/// The file of a layer of one frame.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct LayerFile {
    /// The layer's name.
    pub name: String,
    /// Read from here.
    pub path: PathBuf,
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn texts_become_layers_and_come_back() {
        for text in ["albedo=ALBEDO.####.exr", "a.b=x=y.exr"] {
            assert_eq!(text.parse::<LayerSource>().unwrap().to_string(), text);
        }
        for text in ["", "albedo", "=x.exr", "albedo="] {
            assert!(text.parse::<LayerSource>().is_err(), "{text}");
        }
    }
}
