//! Reading a frame: headers, checks, then the chunks in parallel into the planes of their channels.

use std::path::Path;
use std::sync::{Mutex, PoisonError};

use half::f16;
use half::vec::HalfBitsVecExt;
use lacuna_core::parallel::prelude::*;

use super::codec::{Codec, Decoder, scratch_bytes};
use super::grid::{Area, Grid};
use super::header::{Headers, LARGEST_HEADER, PartHeader, parse};
use super::locate::{Location, locate, place};
use super::source::Source;
use super::{Channel, ChannelHeader, Error, Frame, Part, SampleType, Samples};

/// Rows of chunks are decoded by as many at a time as have so many channels together.
const MOST_SLICES: usize = 1 << 12;

/// What reading a frame may take.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Limits {
    /// Bytes of memory for the frame's pixels and the scratch that decoding them takes.
    pub bytes: u64,
}

impl Default for Limits {
    /// 1.5 GiB: with a process of its own around it, a frame stays below 2 GiB.
    fn default() -> Self {
        Self { bytes: 3 << 29 }
    }
}

/// Reads the frame in that file, every pixel with the bits it has there. Of mip and rip levels only the full
/// resolution is read.
///
/// # Errors
/// For what is not an EXR file, is damaged, is of an unsupported kind or needs more memory than `limits` allow; the
/// last is known before the memory is taken. No input makes it panic.
pub fn read(path: &Path, limits: &Limits) -> Result<Frame, Error> {
    let source = Source::open(path)?;
    let headers = read_headers(&source)?;
    let need = Need::of(&headers.parts);
    if need.least() > limits.bytes {
        return Err(Error::TooLarge { needed: need.least(), limit: limits.bytes });
    }
    let chunks = locate(&source, &headers)?;
    let threads = need.threads_within(limits.bytes);
    let parts = headers.parts.into_iter().zip(chunks).enumerate();
    let parts = parts
        .map(|(index, (header, chunks))| Reader { source: &source, index, header, chunks, threads }.part())
        .collect::<Result<_, _>>()?;
    Ok(Frame { parts })
}

/// Reads the headers of all parts, not the pixels.
///
/// # Errors
/// As [`read`], as far as the headers tell.
pub fn read_header(path: &Path) -> Result<Vec<PartHeader>, Error> {
    Ok(read_headers(&Source::open(path)?)?.parts)
}

/// Reads the headers of a file and checks that all its chunks are there, without decoding a pixel.
///
/// # Errors
/// As [`read`], as far as the headers, the offset tables, the chunks' own headers and the length of the file tell.
pub fn read_whole_header(path: &Path) -> Result<Vec<PartHeader>, Error> {
    let source = Source::open(path)?;
    let headers = read_headers(&source)?;
    locate(&source, &headers)?;
    Ok(headers.parts)
}

/// Bytes of memory that [`read`] takes at least for a frame with these parts, which is what [`Limits`] are compared
/// with: pixels, tables, and the scratch of one thread.
pub fn memory_needed(parts: &[PartHeader]) -> u64 {
    Need::of(parts).least()
}

/// Parses ever longer beginnings of the file until one holds the headers.
fn read_headers(source: &Source) -> Result<Headers, Error> {
    let mut length = 1_u64 << 15;
    loop {
        let mut bytes = vec![0; length.min(source.length) as usize];
        source.read(0, &mut bytes)?;
        match parse(&bytes) {
            Err(Error::Truncated { .. }) if length < source.length && length < LARGEST_HEADER => {
                length = LARGEST_HEADER.min(length * 8);
            }
            Err(Error::Truncated { .. }) if length < source.length => {
                return Err(Error::damaged("the header is larger than that of any real file"));
            }
            result => return result,
        }
    }
}

/// Memory that a frame takes.
struct Need {
    /// For planes and tables.
    frame: u64,
    /// For one thread that decodes.
    thread: u64,
}

impl Need {
    fn of(parts: &[PartHeader]) -> Self {
        let mut need = Self { frame: 0, thread: 0 };
        for part in parts {
            let size = part.data_window.size();
            let grid = Grid::new(size, part.layout, part.compression);
            let bytes = |size: lacuna_core::Size| {
                (size.height as u64).saturating_mul(size.width as u64).saturating_mul(part.bytes_per_pixel())
            };
            let tables = grid.count().saturating_mul(24);
            need.frame = need.frame.saturating_add(bytes(size)).saturating_add(tables);
            let scratch = scratch_bytes(part.compression, bytes(grid.chunk), grid.chunk);
            let slices = size_of::<Rows<'_>>() * part.channels.len();
            need.thread = need.thread.max(scratch.saturating_add(slices as u64));
        }
        need
    }

    fn least(&self) -> u64 {
        self.frame.saturating_add(self.thread)
    }

    /// How many threads may decode at the same time.
    fn threads_within(&self, limit: u64) -> usize {
        let fit = limit.saturating_sub(self.frame) / self.thread.max(1);
        (fit.max(1) as usize).min(rayon::current_num_threads())
    }
}

/// Rows of one channel that belong to one row of chunks.
enum Rows<'a> {
    Half(&'a mut [u16]),
    Float(&'a mut [f32]),
    Uint(&'a mut [u32]),
}

/// The planes of a part while they are filled; halves as bits, which come zeroed at no cost.
enum Plane {
    Half(Vec<u16>),
    Float(Vec<f32>),
    Uint(Vec<u32>),
}

/// One row of chunks and the samples that they fill, channel by channel.
struct ChunkRow<'a> {
    row: usize,
    chunks: &'a [Location],
    samples: Vec<Rows<'a>>,
}

/// Memory of one thread.
#[derive(Default)]
struct Scratch {
    decoder: Decoder,
    packed: Vec<u8>,
}

struct Reader<'a> {
    source: &'a Source,
    index: usize,
    header: PartHeader,
    chunks: Vec<Location>,
    threads: usize,
}

impl Reader<'_> {
    fn part(self) -> Result<Part, Error> {
        let size = self.header.data_window.size();
        let mut planes: Vec<Plane> =
            self.header.channels.iter().map(|channel| Plane::new(channel.kind, size.pixels())).collect();
        self.fill(&mut planes)?;
        let channel = |(header, plane): (ChannelHeader, Plane)| Channel {
            name: header.name,
            perceptually_linear: header.perceptually_linear,
            samples: plane.into_samples(),
        };
        Ok(Part {
            attributes: self.header.attributes,
            data_window: self.header.data_window,
            display_window: self.header.display_window,
            compression: self.header.compression,
            layout: self.header.layout,
            channels: self.header.channels.into_iter().zip(planes).map(channel).collect(),
            had_levels: self.header.has_levels,
        })
    }

    fn fill(&self, planes: &mut [Plane]) -> Result<(), Error> {
        let grid = Grid::new(self.header.data_window.size(), self.header.layout, self.header.compression);
        let codec = Codec::new(self.header.compression, &self.header.channels);
        let width = self.header.data_window.size().width;
        let channels = planes.len();
        let mut bands: Vec<_> =
            planes.iter_mut().map(|plane| plane.bands(grid.chunk.height * width)).collect();
        let mut chunk_rows = self.chunks.chunks(grid.columns()).enumerate();
        // All threads take part if memory allows; otherwise as many rows of chunks at a time as do fit.
        let plenty = self.threads == rayon::current_num_threads();
        let scratch = Mutex::new(Vec::<Scratch>::new());
        let batch = if plenty { self.threads.max(MOST_SLICES / channels.max(1)) } else { self.threads };
        loop {
            let rows = chunk_rows.by_ref().take(batch);
            let work: Vec<ChunkRow<'_>> = rows
                .map(|(row, chunks)| {
                    let samples = bands.iter_mut().filter_map(Iterator::next).collect();
                    ChunkRow { row, chunks, samples }
                })
                .collect();
            if work.is_empty() {
                return Ok(());
            }
            // One after the other uses the same scratch, whose first touch costs as much as its use.
            let decode = |work| {
                let mut own =
                    scratch.lock().unwrap_or_else(PoisonError::into_inner).pop().unwrap_or_default();
                let result = self.decode(&grid, &codec, &mut own, work);
                scratch.lock().unwrap_or_else(PoisonError::into_inner).push(own);
                result
            };
            // Collected in order, so that the first error is the same for every number of threads.
            work.into_par_iter().map(decode).into_iter().collect::<Result<(), Error>>()?;
        }
    }

    fn decode(
        &self,
        grid: &Grid,
        codec: &Codec,
        scratch: &mut Scratch,
        mut work: ChunkRow<'_>,
    ) -> Result<(), Error> {
        for (column, chunk) in work.chunks.iter().enumerate() {
            scratch.packed.resize(chunk.length as usize, 0);
            self.source.read(chunk.position, &mut scratch.packed)?;
            let area = grid.area(work.row, column);
            let raw = scratch.decoder.decode(codec, area.size, &scratch.packed).map_err(|problem| {
                let place = place(self.index, &self.header, grid, work.row, column);
                Error::damaged(format!("{place} has broken pixels: {problem}"))
            })?;
            scatter(raw, area, self.header.data_window.size().width, &mut work.samples);
        }
        Ok(())
    }
}

/// Copies a chunk's pixels into the rows of its channels; `width` is that of the data window.
fn scatter(raw: &[u8], area: Area, width: usize, rows: &mut [Rows<'_>]) {
    let mut rest = raw;
    for y in 0..area.size.height {
        let range = y * width + area.left..y * width + area.left + area.size.width;
        for channel in rows.iter_mut() {
            rest = match channel {
                Rows::Half(plane) => fill(plane.get_mut(range.clone()), rest, u16::from_le_bytes),
                Rows::Float(plane) => fill(plane.get_mut(range.clone()), rest, f32::from_le_bytes),
                Rows::Uint(plane) => fill(plane.get_mut(range.clone()), rest, u32::from_le_bytes),
            };
        }
    }
}

/// Fills `samples` and returns the bytes after theirs.
fn fill<'a, T, const N: usize>(
    samples: Option<&mut [T]>,
    bytes: &'a [u8],
    value: impl Fn([u8; N]) -> T,
) -> &'a [u8] {
    let samples = samples.unwrap_or_default();
    let (mine, rest) = bytes.split_at_checked(samples.len() * N).unwrap_or((bytes, &[]));
    for (sample, bytes) in samples.iter_mut().zip(mine.as_chunks::<N>().0) {
        *sample = value(*bytes);
    }
    rest
}

impl Plane {
    fn new(kind: SampleType, pixels: usize) -> Self {
        match kind {
            SampleType::Half => Self::Half(vec![0; pixels]),
            SampleType::Float => Self::Float(vec![0.0; pixels]),
            SampleType::Uint => Self::Uint(vec![0; pixels]),
        }
    }

    /// The plane in pieces of that many samples.
    fn bands(&mut self, samples: usize) -> Box<dyn Iterator<Item = Rows<'_>> + '_> {
        match self {
            Self::Half(plane) => Box::new(plane.chunks_mut(samples).map(Rows::Half)),
            Self::Float(plane) => Box::new(plane.chunks_mut(samples).map(Rows::Float)),
            Self::Uint(plane) => Box::new(plane.chunks_mut(samples).map(Rows::Uint)),
        }
    }

    fn into_samples(self) -> Samples {
        match self {
            Self::Half(plane) => Samples::Half(plane.reinterpret_into::<f16>()),
            Self::Float(plane) => Samples::Float(plane),
            Self::Uint(plane) => Samples::Uint(plane),
        }
    }
}

#[cfg(test)]
mod tests;
