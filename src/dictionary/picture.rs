//! The atoms of a dictionary as a picture: for each channel a panel, side by side; in each the first atoms, row by row.
//!
//! Grey values are an atom's numbers in its channel from their least (black) to their largest (white), as in figure 4.2 of the
//! thesis.

use lacuna_filters::dictionary::Dictionary;

use crate::raster::{self, BitDepth, ColorType, Compression};

/// Atoms in a row of a panel, and rows at most.
const COLUMNS: usize = 20;
const ROWS: usize = 10;
/// Pixels between atoms, and between panels.
const GAP: usize = 1;
const BETWEEN: usize = 8;

/// The picture as a grey PNG.
///
/// # Errors
/// What the encoder says.
pub fn png(dictionary: &Dictionary) -> Result<Vec<u8>, String> {
    let (block, channels) = (dictionary.block(), dictionary.channels());
    let shown = dictionary.len().min(COLUMNS * ROWS);
    let (columns, rows) = (shown.min(COLUMNS), shown.div_ceil(COLUMNS));
    let panel = columns * (block + GAP) - GAP;
    let width = channels * (panel + BETWEEN) - BETWEEN;
    let height = rows * (block + GAP) - GAP;
    let mut pixels = vec![255_u8; width * height];
    for at in 0..shown {
        let (top, left) = (at / COLUMNS * (block + GAP), at % COLUMNS * (block + GAP));
        for (channel, values) in dictionary.atom(at).chunks_exact(block * block).enumerate() {
            let low = values.iter().copied().fold(f32::INFINITY, f32::min);
            let high = values.iter().copied().fold(f32::NEG_INFINITY, f32::max);
            let scale = if high > low { 255.0 / (high - low) } else { 0.0 };
            for (row, values) in values.chunks_exact(block).enumerate() {
                let start = (top + row) * width + channel * (panel + BETWEEN) + left;
                for (pixel, value) in pixels[start..start + block].iter_mut().zip(values) {
                    *pixel = ((value - low) * scale).round() as u8;
                }
            }
        }
    }
    let kind = (ColorType::Grayscale, BitDepth::Eight);
    raster::png((width, height), kind, Compression::High, &pixels).map_err(|error| error.to_string())
}
