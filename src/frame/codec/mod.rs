//! One chunk's bytes to pixels and back: per row, per channel, little-endian.
//!
//! NONE, RLE, ZIP and ZIPS are done here around libdeflate; the `exr` crate does the rest.

mod library;
mod predictor;
mod rle;

use libdeflater::{CompressionLvl, Compressor, Decompressor};

use super::{ChannelHeader, Compression};
use lacuna_filters::Size;
use library::Library;

/// What decoding and encoding the chunks of one part needs to know.
pub(super) struct Codec {
    compression: Compression,
    bytes_per_pixel: usize,
    library: Option<Library>,
}

/// Scratch memory of one thread that decodes.
pub(super) struct Decoder {
    inflater: Decompressor,
    planar: Vec<u8>,
    raw: Vec<u8>,
}

/// Scratch memory of one thread that encodes.
pub(super) struct Encoder {
    deflater: Compressor,
    planar: Vec<u8>,
    predicted: Vec<u8>,
}

impl Codec {
    pub(super) fn new(compression: Compression, channels: &[ChannelHeader]) -> Self {
        use Compression as C;
        let library = match compression {
            C::None | C::Rle | C::Zips | C::Zip => None,
            C::Piz | C::Pxr24 | C::B44 | C::B44a | C::Dwaa | C::Dwab => {
                Some(Library::new(compression, channels))
            }
        };
        let bytes_per_pixel = channels.iter().map(|channel| channel.kind.bytes()).sum();
        Self { compression, bytes_per_pixel, library }
    }

    /// Bytes of the pixels of a chunk of that size.
    pub(super) fn raw_length(&self, chunk: Size) -> usize {
        chunk.pixels() * self.bytes_per_pixel
    }
}

/// An upper bound of the bytes that one thread takes to decode a chunk of `raw` bytes and `size` pixels.
pub(super) fn scratch_bytes(compression: Compression, raw: u64, size: Size) -> u64 {
    use Compression as C;
    // The bytes in the file, hardly more than the pixels', count in each case.
    match compression {
        C::None => raw,
        C::Rle | C::Zips | C::Zip => raw.saturating_mul(3),
        C::Piz | C::Pxr24 | C::B44 | C::B44a => raw.saturating_mul(4).saturating_add(8 << 20),
        C::Dwaa | C::Dwab => {
            // Coefficients and planes are padded to blocks of 8x8 pixels, which thin chunks feel.
            let padding = library::padded_pixels(size).div_ceil((size.pixels() as u64).max(1));
            raw.saturating_mul(3 + 3 * padding).saturating_add(8 << 20)
        }
    }
}

impl Default for Decoder {
    fn default() -> Self {
        Self { inflater: Decompressor::new(), planar: Vec::new(), raw: Vec::new() }
    }
}

impl Decoder {
    /// The pixels of a chunk.
    ///
    /// # Errors
    /// What is wrong with the chunk, for the end of a sentence.
    pub(super) fn decode<'a>(
        &'a mut self,
        codec: &Codec,
        size: Size,
        packed: &'a [u8],
    ) -> Result<&'a [u8], String> {
        let length = codec.raw_length(size);
        // A chunk that compression would not make smaller is stored as it is.
        if packed.len() == length {
            return Ok(packed);
        }
        if let Some(library) = &codec.library {
            self.raw = library.decode(size, packed, length)?;
            return Ok(&self.raw);
        }
        self.planar.resize(length, 0);
        match codec.compression {
            Compression::Zip | Compression::Zips => {
                let found = self.inflater.zlib_decompress(packed, &mut self.planar);
                if found.ok() != Some(length) {
                    return Err("its zlib data is broken".into());
                }
            }
            Compression::Rle => rle::decode(packed, &mut self.planar)?,
            _ => return Err(format!("it has {} bytes instead of {length}", packed.len())),
        }
        self.raw.resize(length, 0);
        predictor::undo(&self.planar, &mut self.raw);
        Ok(&self.raw)
    }
}

impl Encoder {
    /// `level` is deflate's, 0 to 12 (slower and smaller); others are taken as the nearest.
    pub(super) fn new(level: u8) -> Self {
        let level = CompressionLvl::new(i32::from(level.min(12))).unwrap_or_default();
        Self { deflater: Compressor::new(level), planar: Vec::new(), predicted: Vec::new() }
    }

    /// The bytes of a chunk in the file, from its pixels.
    pub(super) fn encode(&mut self, codec: &Codec, size: Size, raw: Vec<u8>) -> Result<Vec<u8>, String> {
        if let Some(library) = &codec.library {
            return library.encode(size, raw);
        }
        if codec.compression == Compression::None {
            return Ok(raw);
        }
        self.planar.resize(raw.len(), 0);
        self.predicted.resize(raw.len(), 0);
        predictor::apply(&raw, &mut self.planar, &mut self.predicted);
        let packed = if codec.compression == Compression::Rle {
            rle::encode(&self.predicted)
        } else {
            let mut packed = vec![0; self.deflater.zlib_compress_bound(raw.len())];
            let length = self.deflater.zlib_compress(&self.predicted, &mut packed);
            packed.truncate(length.map_err(|_| "zlib found no room".to_owned())?);
            packed
        };
        Ok(if packed.len() < raw.len() { packed } else { raw })
    }
}

#[cfg(test)]
mod tests;
