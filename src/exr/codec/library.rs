//! PIZ, PXR24, B44 and DWA through the `exr` crate, guarded: it panics on some damaged chunks, and takes the sizes
//! in a DWA chunk at their word.

use std::cell::Cell;
use std::panic::{AssertUnwindSafe, catch_unwind, set_hook, take_hook};
use std::sync::Once;

use exr::compression::Compression as Method;
use exr::math::{RoundingMode, Vec2};
use exr::meta::BlockDescription;
use exr::meta::attribute::{
    ChannelDescription, IntegerBounds, LevelMode, SampleType as Type, Text, TileDescription,
};
use exr::meta::header::Header;
use lacuna_core::Size;

use crate::bytes::Bytes;
use crate::{ChannelHeader, Compression, SampleType};

#[cfg(target_endian = "big")]
compile_error!("chunks pass to the exr crate in native byte order, which must be the file's: little-endian");

/// A compression of the `exr` crate and the channels that it compresses.
pub(super) struct Library {
    method: Method,
    header: Header,
    /// Bytes of one pixel, and those in 8x8 blocks if all are.
    bytes_per_pixel: u64,
    channels: u64,
}

impl Library {
    pub(super) fn new(compression: Compression, channels: &[ChannelHeader]) -> Self {
        let method = match compression {
            Compression::None => Method::Uncompressed,
            Compression::Rle => Method::RLE,
            Compression::Zips => Method::ZIP1,
            Compression::Zip => Method::ZIP16,
            Compression::Piz => Method::PIZ,
            Compression::Pxr24 => Method::PXR24,
            Compression::B44 => Method::B44,
            Compression::B44a => Method::B44A,
            Compression::Dwaa => Method::DWAA(None),
            Compression::Dwab => Method::DWAB(None),
        };
        let descriptions = channels.iter().map(|channel| ChannelDescription {
            name: Text::from_slice_unchecked(&channel.name),
            sample_type: match channel.kind {
                SampleType::Half => Type::F16,
                SampleType::Float => Type::F32,
                SampleType::Uint => Type::U32,
            },
            quantize_linearly: channel.perceptually_linear,
            sampling: Vec2(1, 1),
        });
        let mut header = Header::new(Text::from_slice_unchecked(b""), (1, 1), descriptions.collect());
        // Sections of any size are taken; the crate looks at nothing else in the header.
        header.blocks = BlockDescription::Tiles(TileDescription {
            tile_size: Vec2(i32::MAX as usize, i32::MAX as usize),
            level_mode: LevelMode::Singular,
            rounding_mode: RoundingMode::Down,
        });
        let bytes_per_pixel = channels.iter().map(|channel| channel.kind.bytes() as u64).sum();
        Self { method, header, bytes_per_pixel, channels: channels.len() as u64 }
    }

    pub(super) fn decode(&self, size: Size, packed: &[u8], length: usize) -> Result<Vec<u8>, String> {
        if matches!(self.method, Method::DWAA(_) | Method::DWAB(_)) && !packed.is_empty() {
            self.check_dwa(size, packed).ok_or("its DWA sizes are broken")?;
        }
        let section = IntegerBounds::new((0, 0), (size.width, size.height));
        let decode =
            || self.method.decompress_image_section_from_le(&self.header, packed.to_vec(), section, false);
        match quietly(decode) {
            Some(Ok(raw)) if raw.len() == length => Ok(raw),
            Some(Err(error)) => Err(format!("it cannot be decoded ({error})")),
            _ => Err("it cannot be decoded".into()),
        }
    }

    pub(super) fn encode(&self, size: Size, raw: Vec<u8>) -> Result<Vec<u8>, String> {
        let section = IntegerBounds::new((0, 0), (size.width, size.height));
        match quietly(|| self.method.compress_image_section_to_le(&self.header, raw, section)) {
            Some(Ok(packed)) => Ok(packed),
            Some(Err(error)) => Err(error.to_string()),
            None => Err("the compressor failed".into()),
        }
    }

    /// Whether the sizes at the start of a DWA chunk are possible for its pixels.
    fn check_dwa(&self, size: Size, packed: &[u8]) -> Option<()> {
        let mut bytes = Bytes::new(packed, "a DWA chunk");
        let mut sizes = [0_u64; 11];
        for size in &mut sizes {
            *size = bytes.u64().ok()?;
        }
        let [_, unknown, _, _, _, _, rle_packed, rle_raw, coefficients, averages, _] = sizes;
        let raw = self.bytes_per_pixel.checked_mul(size.pixels() as u64)?;
        let blocks = padded_pixels(size).checked_mul(self.channels)?;
        // A run-length code grows what it cannot shrink by 1 in 127.
        let possible = unknown <= raw
            && rle_raw <= raw
            && rle_packed <= raw.saturating_mul(2)
            && coefficients <= blocks
            && averages <= blocks / 64;
        possible.then_some(())
    }
}

/// Number of pixels after padding to blocks of 8x8.
pub(super) fn padded_pixels(size: Size) -> u64 {
    (size.height.next_multiple_of(8) as u64).saturating_mul(size.width.next_multiple_of(8) as u64)
}

thread_local! {
    static QUIET: Cell<bool> = const { Cell::new(false) };
}

/// Runs code that may panic; nothing is printed if it does, and the answer is `None`.
fn quietly<T>(work: impl FnOnce() -> T) -> Option<T> {
    static HOOK: Once = Once::new();
    HOOK.call_once(|| {
        let previous = take_hook();
        set_hook(Box::new(move |info| {
            if !QUIET.try_with(Cell::get).unwrap_or(false) {
                previous(info);
            }
        }));
    });
    QUIET.set(true);
    let result = catch_unwind(AssertUnwindSafe(work)).ok();
    QUIET.set(false);
    result
}
