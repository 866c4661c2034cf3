//! Volume files: one file a format, all of them leading to a `Header` and the place of the voxels.
//!
//! No memory is taken on the word of a header: plain data must be as long as the header says, compressed data must be
//! able to hold that much, and grows only as it is really read.

mod element;
mod inflate;
mod metaimage;
mod nifti;
mod nrrd;
mod raw;
mod vti;

use std::fs::File;
use std::io::{Read, Seek, SeekFrom};
use std::path::{Component, Path, PathBuf};

pub use element::Element;
pub use raw::RawLayout;

use super::vector::Affine;
use super::{Error, Grid, Limits, Values};

/// The formats, for messages.
const FORMATS: &str = "NRRD (.nrrd, .nhdr), MetaImage (.mhd, .mha), NIfTI (.nii, .nii.gz), VTK image data (.vti), or raw \
                       voxels with --raw WxHxD:type";
/// Headers are read up to this length.
const LONGEST_HEADER: u64 = 1 << 20;
/// Texts are read up to this length.
const LONGEST_TEXT: u64 = 16 << 20;

/// What a file says about its voxels.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct Header {
    /// Voxels along x (fastest), y, z.
    pub size: [usize; 3],
    /// The type of a voxel.
    pub element: Element,
    /// Whether the most significant byte goes first.
    pub big_endian: bool,
    /// Index to world coordinates.
    pub placement: Affine,
    /// Slope and intercept from stored to true values.
    pub rescale: Option<(f64, f64)>,
}

impl Header {
    /// All that the voxels' type can hold, as true values; 0 to 1 for floats.
    fn type_range(&self) -> (f64, f64) {
        let (low, high) = self.element.range();
        match (self.rescale, self.element) {
            (None, _) | (_, Element::F32 | Element::F64) => (low, high),
            (Some((slope, intercept)), _) => {
                let ends = [low, high].map(|end| slope * end + intercept);
                (ends[0].min(ends[1]), ends[0].max(ends[1]))
            }
        }
    }
}

/// How the voxels are stored.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Coding {
    /// As they are.
    Plain,
    /// Deflate with gzip's frame.
    Gzip,
    /// Deflate with zlib's frame.
    Zlib,
    /// Numbers as text.
    Text,
}

/// Where the voxels are.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct Place {
    /// The file.
    pub file: PathBuf,
    /// Its first byte of data; nothing counts from the end (plain data that fill the rest of a file).
    pub offset: Option<u64>,
    /// How they are stored.
    pub coding: Coding,
}

/// Reads a volume; the format is told by its first bytes, else by the name. `raw` describes a file without a header.
///
/// # Errors
/// [`Error::Io`] and [`Error::File`], naming the file and what is wrong with it.
pub fn read(path: &Path, raw: Option<&RawLayout>, limits: &Limits) -> Result<Grid, Error> {
    if let Some(layout) = raw {
        layout.check_length(path)?;
        return load(path, &layout.header(), &RawLayout::place(path), limits);
    }
    let mut start = [0; 4];
    let mut file = open(path)?;
    let got = file.read(&mut start).map_err(io(path, "read"))?;
    let name = path.file_name().map(|name| name.to_string_lossy().to_ascii_lowercase()).unwrap_or_default();
    let ends = |ending: &str| name.ends_with(ending);
    if got == 4 && &start == b"NRRD" {
        nrrd::read(path, limits)
    } else if ends(".mhd") || ends(".mha") {
        metaimage::read(path, limits)
    } else if ends(".nii") || ends(".nii.gz") {
        nifti::read(path, limits)
    } else if ends(".vti") {
        vti::read(path, limits)
    } else {
        Err(damaged(path, format!("not a volume that is read here: {FORMATS}")))
    }
}

/// The file of a volume, and that of its voxels if its header names another one.
pub fn files(path: &Path, raw: Option<&RawLayout>) -> Vec<PathBuf> {
    let mut start = [0; 4];
    let named = |ending: &str| path.extension().is_some_and(|found| found.eq_ignore_ascii_case(ending));
    let voxels = match open(path).and_then(|mut file| file.read(&mut start).map_err(io(path, "read"))) {
        Ok(_) if raw.is_some() => None,
        Ok(4) if &start == b"NRRD" => nrrd::voxels(path),
        Ok(_) if named("mhd") || named("mha") => metaimage::voxels(path),
        _ => None,
    };
    std::iter::once(path.to_path_buf()).chain(voxels).collect()
}

/// Reads the voxels that a header describes.
fn load(path: &Path, header: &Header, place: &Place, limits: &Limits) -> Result<Grid, Error> {
    let count = checked_count(path, header)?;
    let bytes = count
        .checked_mul(header.element.bytes())
        .ok_or_else(|| damaged(path, format!("the size {:?} is beyond all memory", header.size)))?;
    check_file(place, bytes)?;
    let words = if place.coding == Coding::Text { size_of::<&str>() } else { 0 };
    check_memory(path, header, words, limits)?;
    let values = match place.coding {
        Coding::Plain => header.element.decode(plain(place, bytes)?, header.big_endian),
        Coding::Text => {
            header.element.parse(&rest(place, limits)?, count).map_err(|why| damaged(&place.file, why))?
        }
        Coding::Gzip | Coding::Zlib => {
            let packed = rest(place, limits)?;
            let plain =
                inflate::inflate(&packed, place.coding, bytes).map_err(|why| damaged(&place.file, why))?;
            header.element.decode(plain, header.big_endian)
        }
    };
    build(path, header, &values)
}

/// That the voxels fit into memory: as they are stored, as they are kept with and without a border, as spline coefficients;
/// `more` bytes a voxel besides.
fn check_memory(path: &Path, header: &Header, more: usize, limits: &Limits) -> Result<(), Error> {
    let (stored, kept) = (header.element.bytes(), header.element.kept());
    let kept = if header.rescale.is_some() { kept + size_of::<f32>() } else { kept };
    let each = (stored + kept).max(2 * kept).max(kept + size_of::<f32>()) + more;
    limits.voxels(header.size, each as u64).map_err(|error| match error {
        Error::Volume(why) => damaged(path, why),
        other => other,
    })
}

/// The grid from decoded values.
fn build(path: &Path, header: &Header, values: &Values) -> Result<Grid, Error> {
    let rescaled = header.rescale.map(|(slope, intercept)| values.rescaled(slope, intercept));
    let grid = Grid::new(header.size, rescaled.as_ref().unwrap_or(values), header.placement);
    let grid = grid.map_err(|error| match error {
        Error::Volume(why) => damaged(path, why),
        other => other,
    })?;
    Ok(grid.with_type_range(header.type_range()))
}

/// Number of voxels, at least one.
fn checked_count(path: &Path, header: &Header) -> Result<usize, Error> {
    let count = header.size.iter().try_fold(1_usize, |product, &n| product.checked_mul(n));
    count
        .filter(|&count| count > 0)
        .ok_or_else(|| damaged(path, format!("the size {:?} is not that of a volume", header.size)))
}

/// That the file can hold so many bytes of voxels. Text is held against their number when it is read.
fn check_file(place: &Place, bytes: usize) -> Result<(), Error> {
    let length = open(&place.file)?.metadata().map_err(io(&place.file, "read"))?.len();
    match place.coding {
        Coding::Plain => start(place, bytes, length).map(drop),
        Coding::Text => Ok(()),
        Coding::Gzip | Coding::Zlib => {
            inflate::check_length(length, bytes).map_err(|why| damaged(&place.file, why))
        }
    }
}

/// Where so many bytes of plain data begin in a file of that length.
fn start(place: &Place, bytes: usize, length: u64) -> Result<u64, Error> {
    let offset = match place.offset {
        Some(offset) => offset,
        None => length.checked_sub(bytes as u64).ok_or_else(|| short(place, bytes, length))?,
    };
    if offset.checked_add(bytes as u64).is_none_or(|end| end > length) {
        return Err(short(place, bytes, length.saturating_sub(offset)));
    }
    Ok(offset)
}

/// Exactly so many bytes of plain data.
fn plain(place: &Place, bytes: usize) -> Result<Vec<u8>, Error> {
    let mut file = open(&place.file)?;
    let length = file.metadata().map_err(io(&place.file, "read"))?.len();
    let offset = start(place, bytes, length)?;
    file.seek(SeekFrom::Start(offset)).map_err(io(&place.file, "read"))?;
    let mut data = Vec::new();
    data.try_reserve_exact(bytes).map_err(|error| io(&place.file, "read")(error.into()))?;
    file.take(bytes as u64).read_to_end(&mut data).map_err(io(&place.file, "read"))?;
    if data.len() == bytes { Ok(data) } else { Err(short(place, bytes, data.len() as u64)) }
}

fn short(place: &Place, bytes: usize, found: u64) -> Error {
    damaged(
        &place.file,
        format!("truncated: {found} bytes of voxels where the header promises {bytes}; copy it again"),
    )
}

/// Everything from the offset on.
fn rest(place: &Place, limits: &Limits) -> Result<Vec<u8>, Error> {
    let mut file = open(&place.file)?;
    let length = file.metadata().map_err(io(&place.file, "read"))?.len();
    if length > limits.bytes {
        return Err(damaged(
            &place.file,
            format!("{length} bytes are more memory than is granted (--memory)"),
        ));
    }
    file.seek(SeekFrom::Start(place.offset.unwrap_or(0))).map_err(io(&place.file, "read"))?;
    let mut data = Vec::new();
    file.read_to_end(&mut data).map_err(io(&place.file, "read"))?;
    Ok(data)
}

/// The first bytes of a file, as many as a header may have.
fn head(path: &Path) -> Result<Vec<u8>, Error> {
    let mut bytes = Vec::new();
    open(path)?.take(LONGEST_HEADER).read_to_end(&mut bytes).map_err(io(path, "read"))?;
    Ok(bytes)
}

/// The text of a small regular file, a scene's say.
pub(super) fn text(path: &Path, action: &'static str) -> Result<String, Error> {
    let mut bytes = Vec::new();
    open_to(path, action)?.take(LONGEST_TEXT + 1).read_to_end(&mut bytes).map_err(io(path, action))?;
    if bytes.len() as u64 > LONGEST_TEXT {
        return Err(damaged(path, format!("cannot {action}: it has more than {LONGEST_TEXT} bytes")));
    }
    String::from_utf8(bytes).map_err(|_| damaged(path, format!("cannot {action}: it is not UTF-8")))
}

/// Opens a regular file: a pipe would wait for a writer, a device never end.
fn open(path: &Path) -> Result<File, Error> {
    open_to(path, "open")
}

fn open_to(path: &Path, action: &'static str) -> Result<File, Error> {
    if !path.metadata().map_err(io(path, action))?.is_file() {
        return Err(damaged(path, format!("cannot {action}: it is not a regular file")));
    }
    File::open(path).map_err(io(path, action))
}

fn io(path: &Path, action: &'static str) -> impl Fn(std::io::Error) -> Error {
    let path = path.to_path_buf();
    move |source| Error::Io { path: path.clone(), action, source }
}

fn damaged(path: &Path, why: impl Into<String>) -> Error {
    Error::File { path: path.into(), why: why.into() }
}

/// A file that a header names, relative to the header's folder.
fn beside(header: &Path, name: &str) -> PathBuf {
    header.parent().unwrap_or_else(|| Path::new("")).join(name)
}

/// The same, refused where it leaves that folder and may not.
fn beside_within(header: &Path, name: &str, limits: &Limits) -> Result<PathBuf, Error> {
    let stays =
        Path::new(name).components().all(|part| matches!(part, Component::Normal(_) | Component::CurDir));
    if stays || limits.outside {
        return Ok(beside(header, name));
    }
    Err(damaged(
        header,
        format!("it names '{name}', outside its own folder: move the file there, or give --allow-outside"),
    ))
}

/// Numbers separated by white space (and commas); nothing if one is none.
fn numbers<T: std::str::FromStr>(text: &str) -> Option<Vec<T>> {
    let words = text.split(|c: char| c.is_whitespace() || c == ',').filter(|word| !word.is_empty());
    words.map(|word| word.parse().ok()).collect()
}

/// Three numbers.
fn three<T: std::str::FromStr>(text: &str) -> Option<[T; 3]> {
    numbers(text)?.try_into().ok()
}

#[cfg(test)]
mod tests;
