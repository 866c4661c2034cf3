//! One chunk's bytes to pixels and back: per row, per channel, little-endian.
//!
//! NONE, RLE, ZIP and ZIPS are done here around libdeflate and, where no level is asked for, a deflate of our own; the
//! `exr` crate does the rest.

mod deflate;
mod library;
mod predictor;
mod rle;

use libdeflater::{CompressionLvl, Compressor, Decompressor};

use super::{ChannelHeader, Compression};
use deflate::Deflater;
use lacuna_core::Size;
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
    zlib: Zlib,
    raw: Vec<u8>,
    planar: Vec<u8>,
    predicted: Vec<u8>,
}

/// What makes a zlib stream.
enum Zlib {
    Own(Deflater),
    /// libdeflate at a level, and room for what it makes.
    Level(Compressor, Vec<u8>),
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
    /// `level` is libdeflate's, 0 to 12 (slower and smaller); others are taken as the nearest. Without one the faster
    /// deflate of our own is taken.
    pub(super) fn new(level: Option<u8>) -> Self {
        let zlib = match level {
            None => Zlib::Own(Deflater::new()),
            Some(level) => {
                let level = CompressionLvl::new(i32::from(level.min(12))).unwrap_or_default();
                Zlib::Level(Compressor::new(level), Vec::new())
            }
        };
        Self { zlib, raw: Vec::new(), planar: Vec::new(), predicted: Vec::new() }
    }

    /// The bytes of a chunk in the file, from its pixels, which `gather` puts into a slice of their length. They are put
    /// into `packed` in place of what it holds.
    pub(super) fn encode(
        &mut self,
        codec: &Codec,
        size: Size,
        gather: impl FnOnce(&mut [u8]),
        packed: &mut Vec<u8>,
    ) -> Result<(), String> {
        packed.clear();
        let length = codec.raw_length(size);
        self.raw.resize(length, 0);
        gather(&mut self.raw);
        if let Some(library) = &codec.library {
            *packed = library.encode(size, std::mem::take(&mut self.raw))?;
            return Ok(());
        }
        if codec.compression == Compression::None {
            packed.extend_from_slice(&self.raw);
            return Ok(());
        }
        self.planar.resize(length, 0);
        self.predicted.resize(length, 0);
        predictor::apply(&self.raw, &mut self.planar, &mut self.predicted);
        let run_lengths;
        let smaller = if codec.compression == Compression::Rle {
            run_lengths = rle::encode(&self.predicted);
            run_lengths.as_slice()
        } else {
            self.zlib.pack(&self.predicted)?
        };
        packed.extend_from_slice(if smaller.len() < length { smaller } else { &self.raw });
        Ok(())
    }
}

impl Zlib {
    fn pack(&mut self, bytes: &[u8]) -> Result<&[u8], String> {
        match self {
            Self::Own(deflater) => Ok(deflater.zlib(bytes)),
            Self::Level(compressor, room) => {
                let most = compressor.zlib_compress_bound(bytes.len());
                room.resize(most.max(room.len()), 0);
                let length = compressor.zlib_compress(bytes, room);
                Ok(&room[..length.map_err(|_| "zlib found no room".to_owned())?])
            }
        }
    }
}

#[cfg(test)]
mod tests;
