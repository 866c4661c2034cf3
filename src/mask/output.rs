//! Masks, ranks and error estimates as files, in the form that the extension names.
//!
//! `.exr`: one channel, `mask` of halves (1 measured, 0 missing), `rank` or `error` of floats; data window as asked.
//! `.png`: one bit a pixel, white is measured; ranks and errors as 16-bit grey (errors with their largest as white).
//! `.txt`: one `x y` a line in absolute pixels, in the order in which they should be computed. `.json`: rectangles to crop.

use std::io::{self, Write};
use std::path::Path;

use half::f16;
use lacuna_core::parallel::prelude::*;
use lacuna_exr::{
    Attributes, Channel, Compression, Frame, Layout, Over, Part, Samples, Window, WriteOptions,
};
use lacuna_filters::Mask;

use super::generate::Rank;
use super::{ATTRIBUTE, MakeError, crop};

/// What the extension of an output asks for.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Format {
    /// `OpenEXR`.
    Exr,
    /// Portable network graphics.
    Png,
    /// Coordinates.
    Text,
    /// Rectangles.
    Json,
}

impl Format {
    /// The format of a path.
    ///
    /// # Errors
    /// An extension that is none of the four.
    pub fn of(path: &Path) -> Result<Self, MakeError> {
        let extension = path.extension().unwrap_or_default().to_string_lossy().to_ascii_lowercase();
        match extension.as_str() {
            "exr" => Ok(Self::Exr),
            "png" => Ok(Self::Png),
            "txt" => Ok(Self::Text),
            "json" => Ok(Self::Json),
            _ => Err(MakeError::Other(format!(
                "'{}' does not end in .exr, .png, .txt or .json",
                path.display()
            ))),
        }
    }
}

/// That a path has a format of images, as [`write_floats`] needs for this.
///
/// # Errors
/// Any other extension.
pub fn check_image(path: &Path, name: &str) -> Result<(), MakeError> {
    match Format::of(path)? {
        Format::Exr | Format::Png => Ok(()),
        Format::Text | Format::Json => {
            Err(MakeError::Other(format!("'{}': {name} is an image: write .exr or .png", path.display())))
        }
    }
}

/// How a mask is written.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Writing {
    /// Leave files that exist.
    pub no_clobber: bool,
    /// Pixels that starting a crop costs, for `.json`.
    pub overhead: usize,
    /// Attributes of an EXR file: name and text.
    pub attributes: Vec<(&'static str, String)>,
}

/// In which order the pixels of a mask are listed.
pub enum Listing<'a> {
    /// By rank.
    Rank(Rank<'a>),
    /// As given, by index row by row.
    Given(&'a [usize]),
}

/// Writes a mask.
///
/// # Errors
/// An unknown extension, and what the system refuses.
pub fn write_mask(
    path: &Path,
    mask: &Mask,
    window: Window,
    listing: &Listing<'_>,
    how: &Writing,
) -> Result<(), MakeError> {
    match Format::of(path)? {
        Format::Exr => {
            let halves = mask.as_slice().par_iter().map(|&flag| if flag { f16::ONE } else { f16::ZERO });
            write_exr(path, "mask", Samples::Half(halves), window, how)
        }
        Format::Png => {
            let size = mask.size();
            write_png(path, window, png::BitDepth::One, how, |row, line| {
                for column in (0..size.width).filter(|&column| mask.is_measured(row, column)) {
                    line[column / 8] |= 128 >> (column % 8);
                }
            })
        }
        Format::Text => {
            Ok(lacuna_exr::write_other(path, how.no_clobber, |out| list(out, mask, window, listing))?)
        }
        Format::Json => {
            let crops = crop::crops(mask, window, how.overhead);
            Ok(lacuna_exr::write_other(path, how.no_clobber, |out| {
                serde_json::to_writer_pretty(&mut *out, &crops)?;
                out.write_all(b"\n")
            })?)
        }
    }
}

/// Writes an image of floats as a channel of that name.
///
/// # Errors
/// An extension that holds no images, and what the system refuses.
pub fn write_floats(
    path: &Path,
    name: &str,
    values: Vec<f32>,
    white: f32,
    window: Window,
    how: &Writing,
) -> Result<(), MakeError> {
    match Format::of(path)? {
        Format::Exr => write_exr(path, name, Samples::Float(values), window, how),
        Format::Png => {
            let width = window.size().width;
            let scale = if white > 0.0 { 65535.0 / f64::from(white) } else { 0.0 };
            write_png(path, window, png::BitDepth::Sixteen, how, |row, line| {
                for (bytes, value) in line.chunks_exact_mut(2).zip(&values[row * width..][..width]) {
                    bytes.copy_from_slice(&((f64::from(*value) * scale).round() as u16).to_be_bytes());
                }
            })
        }
        Format::Text | Format::Json => check_image(path, name),
    }
}

fn write_exr(
    path: &Path,
    name: &str,
    samples: Samples,
    window: Window,
    how: &Writing,
) -> Result<(), MakeError> {
    let mut attributes = Attributes::default();
    if name == "mask" {
        attributes.set_text(ATTRIBUTE, name);
    }
    for (name, text) in &how.attributes {
        attributes.set_text(name, text);
    }
    let channel = Channel { name: name.into(), perceptually_linear: false, samples };
    let part = Part {
        attributes,
        data_window: window,
        display_window: window,
        compression: Compression::Zip,
        layout: Layout::ScanLines,
        channels: vec![channel],
        had_levels: false,
    };
    let options = WriteOptions { compression_level: Some(1), over: Over::unless(how.no_clobber) };
    Ok(lacuna_exr::write(&Frame { parts: vec![part] }, path, &options)?)
}

/// Writes a grey PNG row by row; `fill` sets the bits of a row that is zero.
fn write_png(
    path: &Path,
    window: Window,
    depth: png::BitDepth,
    how: &Writing,
    fill: impl Fn(usize, &mut [u8]),
) -> Result<(), MakeError> {
    let size = window.size();
    let (Ok(width), Ok(height)) = (u32::try_from(size.width), u32::try_from(size.height)) else {
        return Err(MakeError::Other(format!("'{}': too large for a PNG image", path.display())));
    };
    let bytes = (size.width * depth as usize).div_ceil(8);
    Ok(lacuna_exr::write_other(path, how.no_clobber, |out| {
        let mut encoder = png::Encoder::new(out, width, height);
        encoder.set_color(png::ColorType::Grayscale);
        encoder.set_depth(depth);
        encoder.set_compression(png::Compression::Fast);
        let mut writer = encoder.write_header()?;
        let mut stream = writer.stream_writer()?;
        let mut line = vec![0; bytes];
        for row in 0..size.height {
            line.fill(0);
            fill(row, &mut line);
            stream.write_all(&line)?;
        }
        stream.finish()?;
        Ok(writer.finish()?)
    })?)
}

/// Pixels that are sorted at a time.
const SORTED: usize = 1 << 22;

/// Writes the coordinates, band of ranks by band of ranks, so that memory stays bounded.
fn list(out: &mut dyn Write, mask: &Mask, window: Window, listing: &Listing<'_>) -> io::Result<()> {
    let size = mask.size();
    let mut line = |row: usize, column: usize| {
        writeln!(out, "{} {}", i64::from(window.x_min) + column as i64, i64::from(window.y_min) + row as i64)
    };
    let rank = match listing {
        Listing::Given(pixels) => {
            return pixels.iter().try_for_each(|pixel| line(pixel / size.width, pixel % size.width));
        }
        Listing::Rank(rank) => rank,
    };
    let pixels = || {
        let all = (0..size.height).flat_map(|row| (0..size.width).map(move |column| (row, column)));
        all.filter(|&(row, column)| mask.is_measured(row, column))
    };
    // The ranks of a mask fill its density about evenly.
    let bands = (mask.count() / SORTED + 1) as f64;
    let reach = mask.density().max(f64::MIN_POSITIVE);
    let mut from = 0.0;
    for band in 1..=bands as usize + 1 {
        let to = if band > bands as usize { f64::INFINITY } else { reach * band as f64 / bands };
        let mut found: Vec<(f64, u32, u32)> = pixels()
            .map(|(row, column)| (rank(row, column), row as u32, column as u32))
            .filter(|(rank, ..)| (from..to).contains(rank))
            .collect();
        found.sort_by(|a, b| a.0.total_cmp(&b.0).then(a.1.cmp(&b.1)).then(a.2.cmp(&b.2)));
        for (_, row, column) in found {
            line(row as usize, column as usize)?;
        }
        from = to;
    }
    Ok(())
}

#[cfg(test)]
#[path = "output/tests.rs"]
mod tests;
