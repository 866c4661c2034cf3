//! The headers of a file: version and flags, then per part the raw attributes and a checked view of the required ones.

use std::borrow::Cow;
use std::collections::HashSet;

use lacuna_core::Size;

use super::bytes::Bytes;
use super::grid::{Levels, chunks_of_all_levels};
use super::{Attribute, Attributes, Compression, Error, Layout, SampleType, Window};

pub(super) const MAGIC: u32 = 20_000_630;
pub(super) const FLAG_TILED: u32 = 0x200;
pub(super) const FLAG_LONG_NAMES: u32 = 0x400;
const FLAG_DEEP: u32 = 0x800;
pub(super) const FLAG_PARTS: u32 = 0x1000;
/// Largest header that is read, and the most attributes and channels in it: far above what any file has.
pub(super) const LARGEST_HEADER: u64 = 64 << 20;
const MOST_ENTRIES: usize = 1 << 18;

/// The types of attributes whose values have one size, and that size in bytes.
const SIZES: [(&str, usize); 24] = [
    ("box2f", 16),
    ("box2i", 16),
    ("chromaticities", 32),
    ("compression", 1),
    ("deepImageState", 1),
    ("double", 8),
    ("envmap", 1),
    ("float", 4),
    ("int", 4),
    ("keycode", 28),
    ("lineOrder", 1),
    ("m33d", 72),
    ("m33f", 36),
    ("m44d", 128),
    ("m44f", 64),
    ("rational", 8),
    ("tiledesc", 9),
    ("timecode", 8),
    ("v2d", 16),
    ("v2f", 8),
    ("v2i", 8),
    ("v3d", 24),
    ("v3f", 12),
    ("v3i", 12),
];

/// What the header of one part says.
#[derive(Clone, Debug, PartialEq)]
pub struct PartHeader {
    /// Every attribute, raw and in file order.
    pub attributes: Attributes,
    /// The pixels that exist, in absolute coordinates.
    pub data_window: Window,
    /// The pixels that are shown, in absolute coordinates.
    pub display_window: Window,
    /// How the chunks are compressed.
    pub compression: Compression,
    /// Scan lines or tiles.
    pub layout: Layout,
    /// The channels, in file order (sorted by name).
    pub channels: Vec<ChannelHeader>,
    /// Whether the file holds mip or rip levels.
    pub has_levels: bool,
    /// Number of chunks of all levels, which is the length of the part's offset table.
    pub(super) chunk_count: u64,
}

/// A channel's entry in the header.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct ChannelHeader {
    /// The full name, `layer.component`, as bytes.
    pub name: Vec<u8>,
    /// The type of its samples.
    pub kind: SampleType,
    /// The `pLinear` flag.
    pub perceptually_linear: bool,
}

impl PartHeader {
    /// Height and width of the data window.
    pub fn size(&self) -> Size {
        self.data_window.size()
    }

    /// The part's `name`, if it has one.
    pub fn name(&self) -> Option<String> {
        self.attributes.text("name")
    }

    /// The part's `view`, if it has one.
    pub fn view(&self) -> Option<String> {
        self.attributes.text("view")
    }

    /// Bytes of one pixel with all its channels.
    pub(super) fn bytes_per_pixel(&self) -> u64 {
        self.channels.iter().map(|channel| channel.kind.bytes() as u64).sum()
    }
}

impl ChannelHeader {
    /// The name for people; bytes that are not UTF-8 become the replacement character.
    pub fn display_name(&self) -> Cow<'_, str> {
        String::from_utf8_lossy(&self.name)
    }
}

/// What stands before the offset tables.
#[derive(Debug)]
pub(super) struct Headers {
    pub(super) parts: Vec<PartHeader>,
    /// Whether chunks begin with a part number.
    pub(super) multi_part: bool,
    /// Number of bytes, so the position of the first offset table.
    pub(super) length: u64,
}

/// Parses the beginning of a file.
///
/// # Errors
/// [`Error::Truncated`] if `bytes` ends before the headers do: with more bytes it may succeed.
pub(super) fn parse(bytes: &[u8]) -> Result<Headers, Error> {
    let mut bytes = Bytes::new(bytes, "the header");
    if bytes.u32().ok() != Some(MAGIC) {
        return Err(Error::NotExr);
    }
    let version = bytes.u32()?;
    let flags = version & !0xff;
    if version & 0xff != 2 || flags & !(FLAG_TILED | FLAG_LONG_NAMES | FLAG_DEEP | FLAG_PARTS) != 0 {
        return Err(Error::damaged(format!("version and flags {version:#x} are unknown")));
    }
    let multi_part = flags & FLAG_PARTS != 0;
    let mut parts = Vec::new();
    let mut entries = 0;
    loop {
        let attributes = parse_attributes(&mut bytes, &mut entries)?;
        if multi_part && attributes.iter().next().is_none() {
            break;
        }
        parts.push(view(attributes, flags).map_err(|error| in_part(error, parts.len(), multi_part))?);
        entries += parts.last().map_or(0, |part| part.channels.len());
        if entries > MOST_ENTRIES {
            return Err(Error::damaged("the header has more attributes or channels than any real file"));
        }
        if !multi_part {
            break;
        }
    }
    check_parts(&parts, multi_part)?;
    Ok(Headers { parts, multi_part, length: bytes.position() as u64 })
}

fn in_part(error: Error, part: usize, multi_part: bool) -> Error {
    match error {
        Error::Damaged(message) if multi_part => Error::Damaged(format!("part {part}: {message}")),
        other => other,
    }
}

fn check_parts(parts: &[PartHeader], multi_part: bool) -> Result<(), Error> {
    if parts.is_empty() {
        return Err(Error::damaged("the file has no parts"));
    }
    let mut names = HashSet::new();
    for (index, part) in parts.iter().enumerate().filter(|_| multi_part) {
        match part.attributes.get("name") {
            Some(name) if name.kind == b"string" && !name.value.is_empty() => {
                if !names.insert(name.value.as_slice()) {
                    let name = String::from_utf8_lossy(&name.value);
                    return Err(Error::damaged(format!("two parts are called {name:?}")));
                }
            }
            _ => return Err(Error::damaged(format!("part {index} has no name"))),
        }
    }
    Ok(())
}

fn parse_attributes(bytes: &mut Bytes<'_>, entries: &mut usize) -> Result<Attributes, Error> {
    let mut list = Vec::new();
    let mut names = HashSet::new();
    loop {
        let name = bytes.name()?;
        if name.is_empty() {
            return Ok(Attributes::from_unique(list));
        }
        let kind = bytes.name()?;
        let length = usize::try_from(bytes.i32()?);
        let length = length.map_err(|_| bad(name, "has a negative size"))?;
        if length as u64 > LARGEST_HEADER {
            return Err(bad(name, "is larger than any real attribute"));
        }
        // Other readers refuse what is longer as well.
        let wanted = SIZES.iter().find(|(known, _)| known.as_bytes() == kind).map(|(_, size)| *size);
        if let Some(size) = wanted.filter(|size| *size != length) {
            return Err(bad(name, &format!("has size {length} instead of {size}")));
        }
        let value = bytes.take(length)?;
        if !names.insert(name) {
            return Err(bad(name, "occurs twice"));
        }
        *entries += 1;
        if *entries > MOST_ENTRIES {
            return Err(Error::damaged("the header has more attributes than any real file"));
        }
        list.push(Attribute { name: name.to_vec(), kind: kind.to_vec(), value: value.to_vec() });
    }
}

fn bad(name: &[u8], problem: &str) -> Error {
    Error::Damaged(format!("the attribute {:?} {problem}", String::from_utf8_lossy(name)))
}

/// The checked view of a part's attributes.
fn view(attributes: Attributes, flags: u32) -> Result<PartHeader, Error> {
    let tiled = is_tiled(&attributes, flags)?;
    let number = whole("compression", required(&attributes, "compression", "compression")?.u8())?;
    let compression = Compression::from_number(number)?;
    let data_window = window(&attributes, "dataWindow")?;
    let display_window = window(&attributes, "displayWindow")?;
    let channels = channels(required(&attributes, "channels", "chlist")?)?;
    let (layout, levels) = if tiled { tiles(&attributes)? } else { (Layout::ScanLines, Levels::One) };
    let size = data_window.size();
    let chunk_count = chunks_of_all_levels(size, layout, compression, levels);
    if flags & FLAG_PARTS != 0 {
        let told = whole("chunkCount", required(&attributes, "chunkCount", "int")?.i32())?;
        if i64::from(told) != i64::try_from(chunk_count).unwrap_or(i64::MAX) {
            return Err(bad(b"chunkCount", &format!("is {told}, the windows make {chunk_count} chunks")));
        }
    }
    Ok(PartHeader {
        has_levels: levels != Levels::One,
        attributes,
        data_window,
        display_window,
        compression,
        layout,
        channels,
        chunk_count,
    })
}

/// Whether flags and the attribute `type` say tiles; refuses deep parts.
fn is_tiled(attributes: &Attributes, flags: u32) -> Result<bool, Error> {
    let kind = attributes.get("type").map(|attribute| attribute.value.as_slice());
    if flags & FLAG_DEEP != 0 || matches!(kind, Some(b"deepscanline" | b"deeptile")) {
        return Err(Error::Unsupported {
            what: "deep data is".into(),
            remedy: "flatten it first: oiiotool IN --flatten -o OUT".into(),
        });
    }
    let tiled = match kind {
        Some(b"scanlineimage") => false,
        Some(b"tiledimage") => true,
        Some(_) => return Err(bad(b"type", "names no kind of part")),
        None if flags & FLAG_PARTS != 0 => return Err(bad(b"type", "is missing")),
        None => flags & FLAG_TILED != 0,
    };
    if flags & FLAG_PARTS == 0 && tiled != (flags & FLAG_TILED != 0) {
        return Err(bad(b"type", "contradicts the flags of the file"));
    }
    Ok(tiled)
}

fn required<'a>(attributes: &'a Attributes, name: &str, kind: &str) -> Result<Bytes<'a>, Error> {
    let attribute = attributes.get(name).ok_or_else(|| bad(name.as_bytes(), "is missing"))?;
    if attribute.kind != kind.as_bytes() {
        let found = String::from_utf8_lossy(&attribute.kind);
        return Err(bad(name.as_bytes(), &format!("is of type {found:?} instead of {kind}")));
    }
    Ok(Bytes::new(&attribute.value, "an attribute of the header"))
}

/// A value that is too short is damage, not a reason to read on.
fn whole<T>(name: &str, value: Result<T, Error>) -> Result<T, Error> {
    value.map_err(|_| bad(name.as_bytes(), "is too short"))
}

fn window(attributes: &Attributes, name: &str) -> Result<Window, Error> {
    let mut bytes = required(attributes, name, "box2i")?;
    let mut next = || whole(name, bytes.i32());
    let window = Window { x_min: next()?, y_min: next()?, x_max: next()?, y_max: next()? };
    if window.x_max < window.x_min || window.y_max < window.y_min {
        return Err(bad(name.as_bytes(), "is empty"));
    }
    Ok(window)
}

fn tiles(attributes: &Attributes) -> Result<(Layout, Levels), Error> {
    let mut bytes = required(attributes, "tiles", "tiledesc")?;
    let width = whole("tiles", bytes.u32())?;
    let height = whole("tiles", bytes.u32())?;
    let mode = whole("tiles", bytes.u8())?;
    if width == 0 || height == 0 {
        return Err(bad(b"tiles", "has tiles of size 0"));
    }
    let round_up = match mode >> 4 {
        0 => false,
        1 => true,
        _ => return Err(bad(b"tiles", "has an unknown rounding mode")),
    };
    let levels = match mode & 0xf {
        0 => Levels::One,
        1 => Levels::Mip { round_up },
        2 => Levels::Rip { round_up },
        _ => return Err(bad(b"tiles", "has an unknown level mode")),
    };
    Ok((Layout::Tiles { width, height }, levels))
}

fn channels(mut bytes: Bytes<'_>) -> Result<Vec<ChannelHeader>, Error> {
    let mut channels: Vec<ChannelHeader> = Vec::new();
    loop {
        let name = whole("channels", bytes.name())?;
        if name.is_empty() {
            break;
        }
        let shown = String::from_utf8_lossy(name);
        let kind = match whole("channels", bytes.i32())? {
            0 => SampleType::Uint,
            1 => SampleType::Half,
            2 => SampleType::Float,
            other => return Err(Error::damaged(format!("channel {shown:?} is of unknown type {other}"))),
        };
        let flags = whole("channels", bytes.u32())?;
        let sampling = (whole("channels", bytes.i32())?, whole("channels", bytes.i32())?);
        if sampling.0 < 1 || sampling.1 < 1 {
            return Err(Error::damaged(format!("channel {shown:?} has a sampling rate below 1")));
        }
        if sampling != (1, 1) {
            return Err(Error::Unsupported {
                what: format!(
                    "subsampled channels ({shown} has one sample for {}x{} pixels) are",
                    sampling.0, sampling.1
                ),
                remedy: "save it with full-resolution RGB channels in the application that made it \
                         (oiiotool cannot read it)"
                    .into(),
            });
        }
        if channels.last().is_some_and(|last| last.name.as_slice() >= name) {
            return Err(Error::damaged(format!("channel {shown:?} occurs twice or out of order")));
        }
        if channels.len() >= MOST_ENTRIES {
            return Err(Error::damaged("the header has more channels than any real file"));
        }
        channels.push(ChannelHeader { name: name.to_vec(), kind, perceptually_linear: flags & 0xff != 0 });
    }
    if channels.is_empty() || !bytes.is_empty() {
        return Err(bad(b"channels", "is empty or has bytes after its end"));
    }
    Ok(channels)
}
