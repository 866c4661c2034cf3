//! Writing a frame: headers, offset tables, then the chunks, compressed in parallel and written in order, so that
//! every run and every number of threads makes the same bytes.

use std::fs::File;
use std::io::{BufWriter, Seek, SeekFrom, Write};
use std::path::Path;

use half::f16;
use rayon::prelude::*;

use super::codec::{Codec, Encoder};
use super::grid::{Area, Grid};
use super::serialize::{channel_order, headers};
use super::temporary::Temporary;
use super::{Channel, ChannelHeader, Error, Frame, Layout, Part, Samples};

/// Pixels of chunks that are compressed at a time, in bytes.
const BATCH: usize = 64 << 20;
/// What the C++ library takes too.
const DEFAULT_LEVEL: u8 = 4;

/// How a frame is written; its compression is in its parts.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct WriteOptions {
    /// Deflate's level for ZIP and ZIPS, 0 to 12: higher is smaller and slower. `None` is 4, as in the C++ library.
    pub compression_level: Option<u8>,
    /// Fail with [`Error::Exists`] if the file exists, also if it came into being meanwhile.
    pub no_clobber: bool,
}

/// Writes the frame; the file appears under its name when it is complete, or not at all. An existing file is
/// replaced. Attributes keep their bytes and order except for those that the typed fields of [`Part`] rule; the
/// required ones that a part lacks are added. Channels are sorted by name, as the format asks.
///
/// # Errors
/// [`Error::Unwritable`] for a frame that an EXR file cannot hold or whose compression is lossy, [`Error::Exists`],
/// and what the system refuses.
pub fn write(frame: &Frame, path: &Path, options: &WriteOptions) -> Result<(), Error> {
    if frame.parts.is_empty() {
        return Err(Error::Unwritable("the frame has no parts".into()));
    }
    let header = headers(frame)?;
    let (temporary, file) = Temporary::create(path, options.no_clobber)?;
    let mut output = Output { file: BufWriter::with_capacity(1 << 20, file), position: 0 };
    output.put(&header)?;
    let writers: Vec<_> =
        frame.parts.iter().enumerate().map(|(i, part)| Writer::new(i, part, frame)).collect();
    let tables: usize = writers.iter().map(|writer| writer.grid.count() as usize * 8).sum();
    output.put(&vec![0; tables])?;
    let mut table = Vec::with_capacity(tables);
    for writer in writers {
        let offsets = writer.chunks(&mut output, options.compression_level.unwrap_or(DEFAULT_LEVEL))?;
        table.extend(offsets.into_iter().flat_map(u64::to_le_bytes));
    }
    output.file.seek(SeekFrom::Start(header.len() as u64)).map_err(Error::io("write"))?;
    output.put(&table)?;
    let file = output.file.into_inner().map_err(|error| Error::io("write")(error.into_error()))?;
    temporary.commit(file)
}

/// A buffered file that knows where it stands.
struct Output {
    file: BufWriter<File>,
    position: u64,
}

impl Output {
    fn put(&mut self, bytes: &[u8]) -> Result<(), Error> {
        self.position += bytes.len() as u64;
        self.file.write_all(bytes).map_err(Error::io("write"))
    }
}

/// What writing the chunks of a part needs.
struct Writer<'a> {
    part: &'a Part,
    /// The part's number if there are several.
    number: Option<i32>,
    channels: Vec<&'a Channel>,
    codec: Codec,
    grid: Grid,
}

impl<'a> Writer<'a> {
    fn new(index: usize, part: &'a Part, frame: &Frame) -> Self {
        let channels = channel_order(part);
        let described: Vec<_> = channels
            .iter()
            .map(|channel| ChannelHeader {
                name: channel.name.clone(),
                kind: channel.samples.kind(),
                perceptually_linear: channel.perceptually_linear,
            })
            .collect();
        Self {
            part,
            number: (frame.parts.len() > 1).then_some(index as i32),
            channels,
            codec: Codec::new(part.compression, &described),
            grid: Grid::new(part.size(), part.layout, part.compression),
        }
    }

    /// Writes all chunks and returns where each begins, in the order of the offset table.
    fn chunks(&self, output: &mut Output, level: u8) -> Result<Vec<u64>, Error> {
        let (rows, columns) = (self.grid.rows(), self.grid.columns());
        // Random order allows any, so the increasing one.
        let line_order = self.part.attributes.get("lineOrder").and_then(|order| order.value.first());
        let decreasing = line_order == Some(&1);
        let row_at = |index: usize| if decreasing { rows - 1 - index } else { index };
        let order: Vec<_> =
            (0..rows).flat_map(|index| (0..columns).map(move |column| (row_at(index), column))).collect();
        let mut offsets = vec![0; rows * columns];
        let length = self.codec.raw_length(self.grid.chunk).max(1);
        for batch in order.chunks((BATCH / length).max(rayon::current_num_threads())) {
            let encode = |encoder: &mut Encoder, &(row, column): &(usize, usize)| {
                let area = self.grid.area(row, column);
                let packed = encoder.encode(&self.codec, area.size, self.gather(area));
                packed.map_err(|problem| Error::Unwritable(format!("row {}: {problem}", area.top)))
            };
            let packed: Vec<_> = batch.par_iter().map_init(|| Encoder::new(level), encode).collect();
            for (&(row, column), packed) in batch.iter().zip(packed) {
                if let Some(offset) = offsets.get_mut(row * columns + column) {
                    *offset = output.position;
                }
                self.put_chunk(output, row, column, &packed?)?;
            }
        }
        Ok(offsets)
    }

    fn put_chunk(&self, output: &mut Output, row: usize, column: usize, packed: &[u8]) -> Result<(), Error> {
        let mut header: Vec<i32> = self.number.into_iter().collect();
        match self.part.layout {
            Layout::ScanLines => {
                let y = i64::from(self.part.data_window.y_min) + (row * self.grid.chunk.height) as i64;
                header.push(y as i32);
            }
            Layout::Tiles { .. } => header.extend([column as i32, row as i32, 0, 0]),
        }
        header.push(packed.len() as i32);
        for number in header {
            output.put(&number.to_le_bytes())?;
        }
        output.put(packed)
    }

    /// The pixels of a chunk: per row, per channel, little-endian.
    fn gather(&self, area: Area) -> Vec<u8> {
        let mut raw = vec![0; self.codec.raw_length(area.size)];
        let mut rest = raw.as_mut_slice();
        let width = self.part.size().width;
        for y in area.top..area.top + area.size.height {
            let range = y * width + area.left..y * width + area.left + area.size.width;
            for channel in &self.channels {
                rest = match &channel.samples {
                    Samples::Half(samples) => pour(samples.get(range.clone()), rest, f16::to_le_bytes),
                    Samples::Float(samples) => pour(samples.get(range.clone()), rest, f32::to_le_bytes),
                    Samples::Uint(samples) => pour(samples.get(range.clone()), rest, u32::to_le_bytes),
                };
            }
        }
        raw
    }
}

/// Writes the samples into the beginning of `bytes` and returns what is after them.
fn pour<'a, T: Copy, const N: usize>(
    samples: Option<&[T]>,
    bytes: &'a mut [u8],
    value: impl Fn(T) -> [u8; N],
) -> &'a mut [u8] {
    let samples = samples.unwrap_or_default();
    let (mine, rest) = bytes.split_at_mut_checked(samples.len() * N).unwrap_or_default();
    for (bytes, sample) in mine.as_chunks_mut::<N>().0.iter_mut().zip(samples) {
        *bytes = value(*sample);
    }
    rest
}

#[cfg(test)]
mod tests;
