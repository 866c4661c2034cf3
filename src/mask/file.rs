//! Mask files that have been read: EXR frames, which know where their pixels are, and grey PNG images, which do not.

use std::io::{BufReader, Read};
use std::path::Path;

use lacuna_exr::{Frame, Limits, Window};
use lacuna_filters::{Mask, Size};

use super::provider::{Provider, Views};
use super::{Error, flags};
use crate::channels::list_channels;
use crate::raster::{self, Grey};

/// The first bytes of an EXR file.
const EXR: [u8; 4] = [0x76, 0x2f, 0x31, 0x01];

/// The first bytes of a PNG image.
const PNG: [u8; 8] = [0x89, b'P', b'N', b'G', b'\r', b'\n', 0x1a, b'\n'];

/// A mask image that has been read; one serves every frame that it is the mask of.
#[derive(Clone, Debug, PartialEq)]
pub struct MaskFile {
    path: String,
    content: Content,
}

/// What was read.
#[derive(Clone, Debug, PartialEq)]
pub(super) enum Content {
    /// Channels, which know where their pixels are.
    Exr(Frame),
    /// Values from 0 to `white`, row by row.
    Grey { size: Size, values: Vec<u16>, white: u16 },
}

impl MaskFile {
    /// Reads a mask file: EXR or PNG, by its first bytes.
    ///
    /// # Errors
    /// A file that is neither, or that cannot be read.
    pub fn read(path: &Path, limits: Limits) -> Result<Self, Error> {
        let name = path.display().to_string();
        let fail = |why: String| Error::File { path: name.clone(), why };
        let mut start = Vec::new();
        let file = lacuna_exr::open_regular(path);
        file.and_then(|file| file.take(8).read_to_end(&mut start)).map_err(|error| fail(match &*name {
            // A mask takes the number of its frame, not whatever is there.
            glob if glob.contains(['*', '?']) => format!(
                "{error}; a mask takes a pattern such as mask.####.exr, which goes frame by frame, but no glob"
            ),
            _ => error.to_string(),
        }))?;
        if start.starts_with(&EXR) {
            let frame = lacuna_exr::read(path, &limits).map_err(|error| fail(error.to_string()))?;
            return Ok(Self::from_frame(name, frame));
        }
        if start == PNG {
            return Self::read_png(path, limits);
        }
        let ending = path.extension().map(|ending| ending.to_string_lossy().to_ascii_lowercase());
        Err(fail(match ending.as_deref() {
            Some("exr") => "not an EXR file".into(),
            Some("png") => "not a PNG image".into(),
            _ => "neither an EXR file nor a PNG image".into(),
        }))
    }

    /// Reads a PNG image. Colours count by their brightness; a pixel is measured from half of the full brightness
    /// on, or if it is 1 in an image in which nothing is brighter (0 and 1 written without scaling).
    pub fn read_png(path: &Path, limits: Limits) -> Result<Self, Error> {
        let name = path.display().to_string();
        let fail = |why: String| Error::File { path: name.clone(), why };
        let file = lacuna_exr::open_regular(path).map_err(|error| fail(error.to_string()))?;
        let Grey { size, values, white } =
            raster::read_grey(BufReader::new(file), limits.bytes).map_err(fail)?;
        Ok(Self::from_grey(name, size, values, white))
    }

    /// A grey image of `size` with values from 0 to `white`, row by row.
    pub fn from_grey(path: String, size: Size, values: Vec<u16>, white: u16) -> Self {
        Self { path, content: Content::Grey { size, values, white } }
    }

    /// An EXR frame that was read from `path`.
    pub fn from_frame(path: String, frame: Frame) -> Self {
        Self { path, content: Content::Exr(frame) }
    }

    /// Where it was read.
    pub fn path(&self) -> &str {
        &self.path
    }

    /// What was read, of which nothing is a channel that a PNG image has not.
    pub(super) fn content(&self, channel: Option<&str>) -> Result<&Content, Error> {
        match (&self.content, channel) {
            (Content::Grey { .. }, Some(wanted)) => Err(Error::File {
                path: self.path.clone(),
                why: format!("a PNG has no channel '{wanted}': leave the channel out"),
            }),
            (content, _) => Ok(content),
        }
    }

    /// The masks in it that may serve `frame`.
    pub(super) fn providers(&self, frame: &Frame, channel: Option<&str>) -> Result<Vec<Provider>, Error> {
        match self.content(channel)? {
            Content::Exr(mask) => self.of_exr(mask, channel),
            Content::Grey { size, values, white } => self.anchor(frame, *size, &measured(values, *white)),
        }
    }

    /// The mask as it stands, of several the first.
    pub(super) fn mask(&self, channel: Option<&str>) -> Result<Mask, Error> {
        let fail = |why: String| Error::File { path: self.path.clone(), why };
        match self.content(channel)? {
            Content::Exr(mask) => {
                let first = self.of_exr(mask, channel)?.into_iter().next();
                first.map(|provider| provider.mask).ok_or_else(|| fail("it has no channel".into()))
            }
            Content::Grey { size, values, white } => {
                Mask::new(*size, measured(values, *white)).map_err(|error| fail(error.to_string()))
            }
        }
    }

    /// The channel asked for, else `mask`, else the only one; in every part that has it.
    fn of_exr(&self, mask: &Frame, channel: Option<&str>) -> Result<Vec<Provider>, Error> {
        let only = mask.parts.iter().all(|part| part.channels.len() == 1);
        let wanted = channel.unwrap_or("mask");
        let names = || mask.parts.iter().flat_map(|part| &part.channels).map(|c| c.display_name());
        let exact = names().any(|name| name == "mask");
        let fits = |name: &str| match channel {
            Some(wanted) => name == wanted,
            None => name == "mask" || (!exact && name.eq_ignore_ascii_case("mask")),
        };
        for part in &mask.parts {
            let rivals: Vec<_> =
                part.channels.iter().map(|c| c.display_name()).filter(|name| fits(name)).collect();
            if rivals.len() > 1 {
                let why = format!(
                    "several channels could be the mask ({}): name one with --mask file:PATH:CHANNEL",
                    rivals.join(", ")
                );
                return Err(Error::File { path: self.path.clone(), why });
            }
        }
        let any = mask.parts.iter().any(|part| part.channels.iter().any(|c| fits(&c.display_name())));
        if !any && (channel.is_some() || !only) {
            return Err(Error::FileChannel {
                path: self.path.clone(),
                wanted: wanted.into(),
                channels: list_channels(mask),
            });
        }
        let mut found = Vec::new();
        for part in &mask.parts {
            for channel in &part.channels {
                let name = channel.display_name();
                if any && !fits(&name) {
                    continue;
                }
                let flags = flags(&channel.samples, |value| value >= 0.5);
                let mask = Mask::new(part.size(), flags)
                    .map_err(|error| Error::File { path: self.path.clone(), why: error.to_string() })?;
                let views = match Views::of_mask(part, &name) {
                    Views::Of(None) => Views::All,
                    views => views,
                };
                found.push(Provider { part: None, views, layer: None, window: part.data_window, mask });
            }
        }
        Ok(found)
    }

    /// A grey image lies where a data window, else a display window, has its size.
    fn anchor(&self, frame: &Frame, size: Size, measured: &[bool]) -> Result<Vec<Provider>, Error> {
        let mut windows: Vec<Window> = Vec::new();
        let data = frame.parts.iter().map(|part| part.data_window);
        let all = data.chain(frame.parts.iter().map(|part| part.display_window));
        for window in all.filter(|window| window.size() == size) {
            if !windows.contains(&window) {
                windows.push(window);
            }
        }
        let fail = |why: String| Error::File { path: self.path.clone(), why };
        let mut found = Vec::new();
        for window in windows {
            let mask = Mask::new(size, measured.to_vec()).map_err(|error| fail(error.to_string()))?;
            found.push(Provider { part: None, views: Views::All, layer: None, window, mask });
        }
        // A part whose own window has that size goes before the others' windows.
        for part in (0..frame.parts.len()).rev() {
            let own = frame.parts[part].data_window;
            if let Some(provider) = found.iter().find(|provider| provider.window == own).cloned() {
                found.push(Provider { part: Some(part), ..provider });
            }
        }
        if found.is_empty() {
            let mut sizes: Vec<String> = Vec::new();
            for part in &frame.parts {
                for size in [part.size(), part.display_window.size()].map(|size| size.to_string()) {
                    if !sizes.contains(&size) {
                        sizes.push(size);
                    }
                }
            }
            return Err(Error::Size {
                path: self.path.clone(),
                found: size.to_string(),
                expected: sizes.join(", "),
            });
        }
        Ok(found)
    }
}

/// Bright pixels, and ones where nothing is brighter.
fn measured(values: &[u16], white: u16) -> Vec<bool> {
    let unscaled = values.iter().max() == Some(&1);
    values.iter().map(|&value| unscaled && value == 1 || value > white / 2).collect()
}
