//! How much memory a frame needs, estimated from its header, so that frames are admitted before they are read.
//!
//! A pixel takes the samples read and written in every channel, `PLANNING` bytes for mask and plan, and in every
//! channel of floats `SOLVING` bytes for values, result and the solvers' planes; whether a channel is reconstructed is not
//! known before it is read. Both were measured as peak memory over pixels; `tests/cli_memory.rs` holds the process to it.

use std::path::Path;

use super::plan::Item;
use crate::frame::{PartHeader, SampleType, read_header};

const SOLVING: u64 = 24;
const PLANNING: u64 = 32;

/// Bytes that filling a frame needs; 0 if its header cannot be read (reading it will say why).
pub fn to_fill(item: &Item) -> u64 {
    let mask = item.mask.as_deref().map_or(0, |mask| of(mask, 0));
    of(&item.input, SOLVING).saturating_add(mask)
}

/// Bytes that reading, copying and writing a frame needs; 0 if its header cannot be read.
pub fn to_copy(path: &Path) -> u64 {
    of(path, 0)
}

fn of(path: &Path, solving: u64) -> u64 {
    let part = |part: &PartHeader| {
        let size = part.data_window.size();
        let pixels = (size.height as u64).saturating_mul(size.width as u64);
        let channel = |kind: SampleType| {
            let copies = 2 * kind.bytes() as u64;
            copies + if kind == SampleType::Uint { 0 } else { solving }
        };
        let channels: u64 = part.channels.iter().map(|header| channel(header.kind)).sum();
        pixels.saturating_mul(channels + PLANNING)
    };
    read_header(path).map_or(0, |parts| parts.iter().map(part).fold(0, u64::saturating_add))
}
