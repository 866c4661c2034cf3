//! How much memory a frame needs, estimated from its header, so that frames are admitted before they are read.

use std::path::Path;

use crate::frame::{PartHeader, SampleType, read_header};

/// Bytes a pixel of a reconstructed channel takes while it is solved, besides the samples read and written: values
/// and results as 32-bit floats and the solvers' planes. Measured as peak memory over pixels; see the test of the
/// bound in `tests/cli_memory.rs`.
const SOLVING: u64 = 48;
/// Bytes a pixel of a part takes once: mask and plan.
const PLANNING: u64 = 16;

/// Bytes that filling this frame needs; 0 if its header cannot be read (reading it will say why).
pub fn to_fill(path: &Path) -> u64 {
    read_header(path).map_or(0, |parts| estimate(&parts, SOLVING))
}

/// Bytes that copying this frame with other pixels needs.
pub fn to_copy(path: &Path) -> u64 {
    read_header(path).map_or(0, |parts| estimate(&parts, 0))
}

fn estimate(parts: &[PartHeader], solving: u64) -> u64 {
    let part = |part: &PartHeader| {
        let size = part.data_window.size();
        let pixels = (size.height as u64).saturating_mul(size.width as u64);
        let channel = |kind: SampleType| match kind {
            // Read, and changed or packed for writing.
            SampleType::Uint => 2 * kind.bytes() as u64,
            SampleType::Half | SampleType::Float => 2 * kind.bytes() as u64 + solving,
        };
        let channels: u64 = part.channels.iter().map(|header| channel(header.kind)).sum();
        pixels.saturating_mul(channels + PLANNING)
    };
    parts.iter().map(part).fold(0, u64::saturating_add)
}
