//! Mask files that have been read: EXR frames, which know where their pixels are, and grey PNG images, which do not.

use std::path::Path;

use lacuna_filters::{Mask, Size};

use super::provider::{Provider, Views};
use super::{Error, flags};
use crate::channels::{list_channels, view_of};
use crate::frame::{Frame, Window};

/// A mask image that has been read; one serves every frame that it is the mask of.
#[derive(Clone, Debug, PartialEq)]
pub struct MaskFile {
    path: String,
    content: Content,
}

#[derive(Clone, Debug, PartialEq)]
enum Content {
    Exr(Frame),
    Grey { size: Size, measured: Vec<bool> },
}

impl MaskFile {
    /// Reads a PNG image. Colours count by their brightness; a pixel is measured from half of the full brightness
    /// on, or if it is 1 in an image in which nothing is brighter (0 and 1 written without scaling).
    pub fn read_png(path: &Path) -> Result<Self, Error> {
        let name = path.display().to_string();
        let fail = |why: String| Error::File { path: name.clone(), why };
        let mut reader = image::ImageReader::open(path)
            .and_then(image::ImageReader::with_guessed_format)
            .map_err(|error| fail(error.to_string()))?;
        let mut limits = image::Limits::default();
        limits.max_alloc = Some(1 << 29);
        reader.limits(limits);
        let image = reader.decode().map_err(|error| fail(error.to_string()))?;
        let size = Size::new(image.height() as usize, image.width() as usize);
        let eight_bits = image.color().bytes_per_pixel() == image.color().channel_count();
        let (values, white): (Vec<u16>, u16) = if eight_bits {
            (image.into_luma8().into_raw().into_iter().map(u16::from).collect(), 255)
        } else {
            (image.into_luma16().into_raw(), u16::MAX)
        };
        Ok(Self::from_grey(name, size, &values, white))
    }

    /// A grey image of `size` with values from 0 to `white`, row by row.
    pub fn from_grey(path: String, size: Size, values: &[u16], white: u16) -> Self {
        let unscaled = values.iter().max() == Some(&1);
        let measured = values.iter().map(|&value| unscaled && value == 1 || value > white / 2).collect();
        Self { path, content: Content::Grey { size, measured } }
    }

    /// An EXR frame that was read from `path`.
    pub fn from_frame(path: String, frame: Frame) -> Self {
        Self { path, content: Content::Exr(frame) }
    }

    /// Where it was read.
    pub fn path(&self) -> &str {
        &self.path
    }

    /// The masks in it that may serve `frame`.
    pub(super) fn providers(&self, frame: &Frame, channel: Option<&str>) -> Result<Vec<Provider>, Error> {
        match &self.content {
            Content::Exr(mask) => self.of_exr(mask, channel),
            Content::Grey { size, measured } => {
                if let Some(wanted) = channel {
                    return Err(Error::File {
                        path: self.path.clone(),
                        why: format!("a PNG has no channel '{wanted}': leave the channel out"),
                    });
                }
                self.anchor(frame, *size, measured)
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
                let views = view_of(part, &name).map_or(Views::All, |view| Views::Of(Some(view)));
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
