//! `--layers NAME=PATTERN`: channels that stand in files of their own become layers of the frame.
//!
//! Some renderers write each output to its own file and call its channels R, G and B whatever they hold. The first part of such a
//! file with the data window of a part of the frame goes into that part, each channel as `NAME.CHANNEL`.

use std::path::PathBuf;
use std::str::FromStr;

use lacuna_exr::{Frame, Limits};

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

/// Adds the channels of all of these files to a frame.
///
/// # Errors
/// The file, and why it cannot be read or added.
pub fn read_into(frame: &mut Frame, files: &[LayerFile], limits: Limits) -> Result<(), (PathBuf, String)> {
    for LayerFile { name, path } in files {
        let read = lacuna_exr::read(path, &limits).map_err(|error| error.to_string());
        read.and_then(|layer| add(frame, name, layer)).map_err(|why| (path.clone(), why))?;
    }
    Ok(())
}

/// Puts the channels of `file` into the frame as a layer.
///
/// # Errors
/// No part with the data window of one of the frame's; a channel of that name that is there already.
pub fn add(frame: &mut Frame, name: &str, file: Frame) -> Result<(), String> {
    let windows: Vec<_> = frame.parts.iter().map(|part| part.data_window).collect();
    let fits = file.parts.into_iter().find_map(|other| {
        let at = windows.iter().position(|window| *window == other.data_window)?;
        Some((at, other))
    });
    let Some((at, other)) = fits else {
        return Err(format!(
            "layer {name}: no part has the data window of the frame: render it for the same pixels"
        ));
    };
    let part = &mut frame.parts[at];
    for mut channel in other.channels {
        channel.name = [name.as_bytes(), b".", &channel.name].concat();
        if part.channels.iter().any(|own| own.name == channel.name) {
            return Err(format!("layer {name}: the frame has a channel {} already", channel.display_name()));
        }
        part.channels.push(channel);
    }
    part.channels.sort_by(|a, b| a.name.cmp(&b.name));
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::testing::{float, frame, named, part, uint, window};

    #[test]
    fn texts_become_layers_and_come_back() {
        for text in ["albedo=ALBEDO.####.exr", "a.b=x=y.exr"] {
            assert_eq!(text.parse::<LayerSource>().unwrap().to_string(), text);
        }
        for text in ["", "albedo", "=x.exr", "albedo="] {
            assert!(text.parse::<LayerSource>().is_err(), "{text}");
        }
    }

    #[test]
    fn channels_become_a_layer_of_the_part_with_their_window() {
        let small = || part(window(0, 0, 1, 1), vec![float("R", &[1.0])]);
        let wide = || part(window(3, 0, 2, 1), vec![float("Z", &[1.0, 2.0])]);
        let mut whole = frame(vec![named("a", "", small()), named("b", "", wide())]);
        let counts = frame(vec![part(window(3, 0, 2, 1), vec![uint("G", &[5, 6]), uint("A", &[7, 8])])]);
        add(&mut whole, "SAMPLECOUNT", counts.clone()).unwrap();
        let names = |at: usize| {
            whole.parts[at].channels.iter().map(|c| c.display_name()).collect::<Vec<_>>().join(" ")
        };
        assert_eq!((names(0), names(1)), ("R".into(), "SAMPLECOUNT.A SAMPLECOUNT.G Z".into()));
        assert!(add(&mut whole, "SAMPLECOUNT", counts).unwrap_err().contains("already"));
        let other = frame(vec![part(window(0, 0, 2, 2), vec![float("R", &[0.0; 4])])]);
        assert!(add(&mut whole, "N", other).unwrap_err().contains("data window"));
    }
}
