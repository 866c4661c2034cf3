//! A part's header as bytes: its raw attributes in their order, the typed fields in place of those that they rule.

use std::collections::HashSet;

use super::grid::Grid;
use super::header::{FLAG_LONG_NAMES, FLAG_PARTS, FLAG_TILED, MAGIC};
use super::{Attribute, Attributes, Channel, Compression, Error, Frame, Layout, Part, SampleType, Window};

/// Names longer than this need a flag in the file.
const SHORT_NAME: usize = 31;
const LONGEST_NAME: usize = 255;

/// The bytes before the offset tables.
///
/// # Errors
/// [`Error::Unwritable`] for a frame that an EXR file cannot hold.
pub(super) fn headers(frame: &Frame) -> Result<Vec<u8>, Error> {
    let multi_part = frame.parts.len() > 1;
    let mut names = HashSet::new();
    let mut body = Vec::new();
    let mut flags = if multi_part { FLAG_PARTS } else { 0 };
    for part in &frame.parts {
        check(part)?;
        if multi_part {
            let name = part.attributes.get("name").filter(|name| name.kind == b"string");
            let name = name.map(|name| &*name.value).filter(|name| !name.is_empty());
            if !names.insert(name.ok_or_else(|| unwritable("a part of several has no name"))?) {
                return Err(unwritable("several parts need names of their own"));
            }
        }
        if !multi_part && matches!(part.layout, Layout::Tiles { .. }) {
            flags |= FLAG_TILED;
        }
        if part.channels.iter().any(|channel| channel.name.len() > SHORT_NAME) {
            flags |= FLAG_LONG_NAMES;
        }
        for attribute in attributes(part, multi_part)?.iter() {
            if attribute.name.len().max(attribute.kind.len()) > SHORT_NAME {
                flags |= FLAG_LONG_NAMES;
            }
            push_attribute(&mut body, attribute)?;
        }
        body.push(0);
    }
    if multi_part {
        body.push(0);
    }
    let mut bytes = [MAGIC.to_le_bytes(), (2 | flags).to_le_bytes()].concat();
    bytes.append(&mut body);
    Ok(bytes)
}

/// The order in which a part's channels stand in the file: sorted by name.
pub(super) fn channel_order(part: &Part) -> Vec<&Channel> {
    let mut channels: Vec<_> = part.channels.iter().collect();
    channels.sort_by(|a, b| a.name.cmp(&b.name));
    channels
}

fn unwritable(message: &str) -> Error {
    Error::Unwritable(message.into())
}

fn check(part: &Part) -> Result<(), Error> {
    let window = part.data_window;
    if window.x_max < window.x_min || window.y_max < window.y_min {
        return Err(unwritable("the data window is empty"));
    }
    if !part.compression.is_lossless() {
        return Err(Error::Unwritable(format!(
            "{} would change pixels; choose zip",
            part.compression.name()
        )));
    }
    if matches!(part.layout, Layout::Tiles { width, height } if width == 0 || height == 0) {
        return Err(unwritable("tiles of size 0"));
    }
    let channels = channel_order(part);
    if channels.is_empty() {
        return Err(unwritable("a part has no channels"));
    }
    for (index, channel) in channels.iter().enumerate() {
        check_name(&channel.name)?;
        if channels.get(index + 1).is_some_and(|next| next.name == channel.name) {
            return Err(Error::Unwritable(format!("two channels are called {}", channel.display_name())));
        }
        let (expected, found) = (part.size().pixels(), channel.samples.len());
        if expected != found {
            let name = channel.display_name();
            return Err(Error::Unwritable(format!(
                "channel {name} has {found} pixels instead of {expected}"
            )));
        }
    }
    let grid = Grid::new(part.size(), part.layout, part.compression);
    let bytes: usize = channels.iter().map(|channel| channel.samples.kind().bytes()).sum();
    if grid.count() > i32::MAX as u64 || grid.chunk.pixels().saturating_mul(bytes) > i32::MAX as usize {
        return Err(unwritable(
            "more chunks or larger ones than the format has numbers for; use smaller tiles",
        ));
    }
    Ok(())
}

fn check_name(name: &[u8]) -> Result<(), Error> {
    if name.is_empty() || name.len() > LONGEST_NAME || name.contains(&0) {
        let shown = String::from_utf8_lossy(name);
        return Err(Error::Unwritable(format!("{shown:?} is no name: 1 to 255 bytes without a zero")));
    }
    Ok(())
}

fn push_attribute(bytes: &mut Vec<u8>, attribute: &Attribute) -> Result<(), Error> {
    check_name(&attribute.name)?;
    check_name(&attribute.kind)?;
    let length = i32::try_from(attribute.value.len());
    let length = length.map_err(|_| unwritable("an attribute is larger than 2 GiB"))?;
    for name in [&attribute.name, &attribute.kind] {
        bytes.extend(name);
        bytes.push(0);
    }
    bytes.extend(length.to_le_bytes());
    bytes.extend(&attribute.value);
    Ok(())
}

/// Required attributes that are no typed fields, and their types; one of another type is replaced.
pub const REQUIRED: [(&str, &str); 4] = [
    ("lineOrder", "lineOrder"),
    ("pixelAspectRatio", "float"),
    ("screenWindowCenter", "v2f"),
    ("screenWindowWidth", "float"),
];

/// The part's attributes with the typed fields put in, and the required ones that it lacks added.
fn attributes(part: &Part, multi_part: bool) -> Result<Attributes, Error> {
    let mut all = part.attributes.clone();
    all.set("channels", "chlist", channel_list(part));
    all.set("compression", "compression", vec![Compression::number(part.compression)]);
    all.set("dataWindow", "box2i", box_bytes(part.data_window));
    all.set("displayWindow", "box2i", box_bytes(part.display_window));
    let mut default = |name: &str, kind: &str, value: Vec<u8>| {
        if all.get(name).is_none_or(|attribute| attribute.kind != kind.as_bytes()) {
            all.set(name, kind, value);
        }
    };
    let one = 1_f32.to_le_bytes();
    for ((name, kind), value) in REQUIRED.into_iter().zip([&[0][..], &one, &[0; 8], &one]) {
        default(name, kind, value.into());
    }
    let kind = match part.layout {
        Layout::ScanLines => "scanlineimage",
        Layout::Tiles { width, height } => {
            // One level; the rounding of levels stays as it was.
            let rounding =
                all.get("tiles").and_then(|tiles| tiles.value.get(8)).map_or(0, |mode| mode & 0xf0);
            let value = [&width.to_le_bytes()[..], &height.to_le_bytes(), &[rounding]].concat();
            all.set("tiles", "tiledesc", value);
            "tiledimage"
        }
    };
    if multi_part || all.get("type").is_some() {
        all.set_text("type", kind);
    }
    if multi_part || all.get("chunkCount").is_some() {
        let count = Grid::new(part.size(), part.layout, part.compression).count();
        let count = i32::try_from(count).map_err(|_| unwritable("too many chunks"))?;
        all.set("chunkCount", "int", count.to_le_bytes().into());
    }
    Ok(all)
}

fn box_bytes(window: Window) -> Vec<u8> {
    [window.x_min, window.y_min, window.x_max, window.y_max].map(i32::to_le_bytes).concat()
}

fn channel_list(part: &Part) -> Vec<u8> {
    let mut bytes = Vec::new();
    for channel in channel_order(part) {
        let kind = match channel.samples.kind() {
            SampleType::Uint => 0_i32,
            SampleType::Half => 1,
            SampleType::Float => 2,
        };
        bytes.extend(&channel.name);
        bytes.push(0);
        bytes.extend(kind.to_le_bytes());
        bytes.extend([u8::from(channel.perceptually_linear), 0, 0, 0]);
        // Sampling rates.
        bytes.extend([1_i32, 1].map(i32::to_le_bytes).concat());
    }
    bytes.push(0);
    bytes
}
