//! Where the chunks of the full-resolution level stand in a file, checked before any pixel is read.

use super::bytes::Bytes;
use super::grid::Grid;
use super::header::{Headers, PartHeader};
use super::source::Source;
use super::{Error, Layout};

/// The bytes of one chunk, without its own header.
#[derive(Clone, Copy, Debug)]
pub(super) struct Location {
    pub(super) position: u64,
    pub(super) length: u32,
}

/// Largest number of bytes in a chunk's own header: part, tile and level indices, size.
const CHUNK_HEADER: usize = 4 + 16 + 4;

/// The chunks of every part, row by row of its grid.
///
/// # Errors
/// If a chunk is missing, not where the table says, another than the table says, or too small for its pixels.
pub(super) fn locate(source: &Source, headers: &Headers) -> Result<Vec<Vec<Location>>, Error> {
    let mut table = headers.length;
    let mut tables = Vec::new();
    for part in &headers.parts {
        tables.push(table);
        table =
            part.chunk_count.checked_mul(8).and_then(|bytes| table.checked_add(bytes)).unwrap_or(u64::MAX);
    }
    // Every chunk has an entry in a table: a window that the file cannot fill ends here.
    if table > source.length {
        return Err(Error::Truncated { place: "the table of chunks".into() });
    }
    let end_of_tables = table;
    let parts = headers.parts.iter().zip(tables).enumerate();
    parts
        .map(|(index, (part, table))| {
            Locator { source, multi_part: headers.multi_part, end_of_tables, index, part }.part(table)
        })
        .collect()
}

struct Locator<'a> {
    source: &'a Source,
    multi_part: bool,
    end_of_tables: u64,
    index: usize,
    part: &'a PartHeader,
}

impl Locator<'_> {
    fn part(&self, table: u64) -> Result<Vec<Location>, Error> {
        let grid = Grid::new(self.part.data_window.size(), self.part.layout, self.part.compression);
        // Levels follow the full resolution, which is the first.
        let mut entries = vec![0; grid.count() as usize * 8];
        self.source.read(table, &mut entries)?;
        let mut entries = Bytes::new(&entries, "the table of chunks");
        let mut locations = Vec::with_capacity(grid.count() as usize);
        for row in 0..grid.rows() {
            for column in 0..grid.columns() {
                let location = self.chunk(entries.u64()?, &grid, row, column)?;
                let raw = grid.area(row, column).size.pixels() as u64 * self.part.bytes_per_pixel();
                self.check_length(location.length, raw, || self.place(&grid, row, column))?;
                locations.push(location);
            }
        }
        Ok(locations)
    }

    /// Follows an entry of the table to the chunk and compares what that says of itself.
    fn chunk(&self, entry: u64, grid: &Grid, row: usize, column: usize) -> Result<Location, Error> {
        let place = || self.place(grid, row, column);
        if entry == 0 {
            return Err(Error::Unfinished { place: place() });
        }
        let tiled = matches!(self.part.layout, Layout::Tiles { .. });
        let length = 4 * (usize::from(self.multi_part) + if tiled { 4 } else { 1 } + 1);
        let truncated = || Error::Truncated { place: place() };
        let start = entry.checked_add(length as u64).filter(|&start| start <= self.source.length);
        let start = start.ok_or_else(truncated)?;
        let wrong = || Error::damaged(format!("the table of chunks leads to other bytes than {}", place()));
        if entry < self.end_of_tables {
            return Err(wrong());
        }
        let mut header = [0; CHUNK_HEADER];
        let header = header.get_mut(..length).ok_or_else(wrong)?;
        self.source.read(entry, header)?;
        let mut bytes = Bytes::new(header, "the header of a chunk");
        let part_fits = !self.multi_part || i64::from(bytes.i32()?) == self.index as i64;
        let place_fits = if tiled {
            let found = [bytes.i32()?, bytes.i32()?, bytes.i32()?, bytes.i32()?].map(i64::from);
            found == [column as i64, row as i64, 0, 0]
        } else {
            i64::from(bytes.i32()?) == self.first_row(grid, row)
        };
        if !part_fits || !place_fits {
            return Err(wrong());
        }
        let length = u32::try_from(bytes.i32()?).map_err(|_| wrong())?;
        match start.checked_add(u64::from(length)) {
            Some(end) if end <= self.source.length => Ok(Location { position: start, length }),
            _ => Err(truncated()),
        }
    }

    /// Refuses chunks that cannot hold their pixels, or hold more than compression would have left in them.
    fn check_length(&self, length: u32, raw: u64, place: impl Fn() -> String) -> Result<(), Error> {
        let ratio = self.part.compression.largest_ratio();
        let most = ratio.map_or(u64::MAX, |ratio| u64::from(length).saturating_mul(ratio));
        if most < raw || u64::from(length) > raw.saturating_add(raw / 8).saturating_add(1 << 16) {
            return Err(Error::damaged(format!("{} cannot have {raw} bytes in {length}", place())));
        }
        Ok(())
    }

    fn first_row(&self, grid: &Grid, row: usize) -> i64 {
        i64::from(self.part.data_window.y_min) + (row * grid.chunk.height) as i64
    }

    fn place(&self, grid: &Grid, row: usize, column: usize) -> String {
        place(self.index, self.part, grid, row, column)
    }
}

/// A chunk's place for people: part, if there are several or it has a name, and first row or tile.
pub(super) fn place(index: usize, part: &PartHeader, grid: &Grid, row: usize, column: usize) -> String {
    let y = i64::from(part.data_window.y_min) + (row * grid.chunk.height) as i64;
    let name = part.attributes.text("name").map_or(String::new(), |name| format!(" ({name})"));
    match part.layout {
        Layout::ScanLines => format!("the chunk at row {y} of part {index}{name}"),
        Layout::Tiles { .. } => format!("tile {column},{row} of part {index}{name}"),
    }
}
