//! Pictures for people and grey images for masks: pixels of a few bits as PNG, written and read.

use std::io::{BufRead, Seek};

use lacuna_core::Size;
pub use png::{BitDepth, ColorType, Compression};
use png::{Decoder, Transformations};

/// A picture as PNG: rows from the top, each padded to whole bytes.
///
/// # Errors
/// A size that PNG does not have, or another number of bytes.
pub fn png(
    (width, height): (usize, usize),
    (colour, depth): (ColorType, BitDepth),
    compression: Compression,
    bytes: &[u8],
) -> Result<Vec<u8>, png::EncodingError> {
    let mut out = Vec::new();
    let size = |length: usize| u32::try_from(length).unwrap_or(0);
    let mut encoder = png::Encoder::new(&mut out, size(width), size(height));
    encoder.set_color(colour);
    encoder.set_depth(depth);
    encoder.set_compression(compression);
    if matches!(compression, Compression::Fast) {
        encoder.set_filter(png::Filter::Adaptive);
    }
    let mut writer = encoder.write_header()?;
    writer.write_image_data(bytes)?;
    writer.finish()?;
    Ok(out)
}

/// A grey image: values from 0 to `white`, row by row.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Grey {
    /// Height and width.
    pub size: Size,
    /// From 0 to `white`.
    pub values: Vec<u16>,
    /// 255, or 65535 for an image of 16 bits.
    pub white: u16,
}

/// Reads a PNG image by its brightness (ITU-R BT.709); opacity does not count. No memory is taken beyond `most` bytes.
///
/// # Errors
/// What the decoder says, and an image that is too large.
pub fn read_grey(input: impl BufRead + Seek, most: u64) -> Result<Grey, String> {
    let limits = png::Limits { bytes: usize::try_from(most).unwrap_or(usize::MAX) };
    let mut decoder = Decoder::new_with_limits(input, limits);
    decoder.set_transformations(Transformations::EXPAND);
    let mut reader = decoder.read_info().map_err(|error| error.to_string())?;
    let size = Size::new(reader.info().height as usize, reader.info().width as usize);
    // The decoder takes for granted that entries are whole, and at most 256.
    let palette = reader.info().palette.as_deref().unwrap_or_default();
    if palette.len() % 3 != 0 || palette.len() > 768 {
        return Err(format!("a palette of {} bytes: not 1 to 256 entries of three", palette.len()));
    }
    let (colour, depth) = reader.output_color_type();
    let (channels, bytes) = (colour.samples(), if depth == BitDepth::Sixteen { 2 } else { 1 });
    // The decoded bytes, the values, and the flags that are made of them.
    let need = size.pixels() as u64 * (channels * bytes + 3) as u64;
    if need > most {
        let (need, most) = (lacuna_exr::Amount::at_most(need), lacuna_exr::Amount::at_least(most));
        return Err(format!(
            "{size} pixels need {need} of memory, more than the bound of {most}; allow more with --memory"
        ));
    }
    let mut raw = vec![0; size.pixels() * channels * bytes];
    reader.next_frame(&mut raw).map_err(|error| error.to_string())?;
    let sample = |at: &[u8]| if bytes == 2 { u16::from_be_bytes([at[0], at[1]]) } else { u16::from(at[0]) };
    let grey = |pixel: &[u8]| {
        let at = |k: usize| u32::from(sample(&pixel[k * bytes..]));
        if channels < 3 {
            at(0) as u16
        } else {
            ((2126 * at(0) + 7152 * at(1) + 722 * at(2)) / 10_000) as u16
        }
    };
    let values = raw.chunks_exact(channels * bytes).map(grey).collect();
    Ok(Grey { size, values, white: if bytes == 2 { u16::MAX } else { 255 } })
}

#[cfg(test)]
mod tests {
    use std::io::Cursor;

    use super::*;

    #[test]
    fn an_image_beyond_the_limit_is_refused_by_its_size() {
        let kind = (ColorType::Grayscale, BitDepth::Eight);
        let small = png((4, 2), kind, Compression::Fast, &[0, 1, 2, 3, 4, 5, 6, 255]).unwrap();
        let grey = read_grey(Cursor::new(&small), 1 << 10).unwrap();
        assert_eq!((grey.values, grey.white), (vec![0, 1, 2, 3, 4, 5, 6, 255], 255));
        let large = png((1000, 1000), kind, Compression::High, &vec![0; 1_000_000]).unwrap();
        let error = read_grey(Cursor::new(&large), 1 << 20).unwrap_err();
        assert!(error.contains("1000x1000") && error.contains("--memory"), "{error}");
    }

    #[test]
    fn a_palette_of_broken_entries_is_refused() {
        let broken = include_bytes!("../tests/fuzz/corpus/masks/palette-broken.png");
        let error = read_grey(Cursor::new(broken), 1 << 20).unwrap_err();
        assert!(error.contains("palette of 20 bytes"), "{error}");
    }
}
