//! EXR frames: the model that everything else works on, reading and writing.
//!
//! lacuna owns the container (header attributes as raw bytes in file order, offset tables, chunks), so that nothing
//! is lost on the way; the codecs inside the chunks are libraries'.

mod attributes;
mod bytes;
mod codec;
mod compression;
mod error;
mod grid;
mod header;
mod locate;
mod other;
mod read;
#[cfg(test)]
mod samples_for_tests;
mod serialize;
mod source;
mod stale;
mod temporary;
mod window;
mod write;

pub use attributes::{Attribute, Attributes, CAMERA};
pub use error::{Amount, Error, is_refusal};
use half::f16;
use half::slice::HalfFloatSliceExt;
pub use header::{ChannelHeader, PartHeader};
use lacuna_core::Size;
pub use other::write_other;
pub use read::{Limits, memory_needed, read, read_header, read_whole_header};
pub use serialize::REQUIRED;
pub use source::{open_regular, read_most, read_small};
pub use temporary::{Over, behind, check_destination, check_whole, remove_temporaries, write_whole};
pub use window::Window;
pub use write::{WriteOptions, has_header_of, write};

/// One EXR file in memory: its parts in file order.
#[derive(Clone, Debug, PartialEq)]
pub struct Frame {
    /// The parts, in file order; at least one.
    pub parts: Vec<Part>,
}

/// One part: windows, attributes and channels of full resolution.
#[derive(Clone, Debug, PartialEq)]
pub struct Part {
    /// Every attribute of the header, raw and in file order, the required ones included. The typed fields below
    /// are authoritative: on writing they replace the raw value of their attribute.
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
    pub channels: Vec<Channel>,
    /// Whether the file held mip or rip levels, which are not kept.
    pub had_levels: bool,
}

/// How the chunks of a part are compressed, in the order of the file format's numbers 0 to 9.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
#[allow(missing_docs, reason = "the names are those of the file format")]
pub enum Compression {
    None,
    Rle,
    Zips,
    Zip,
    Piz,
    Pxr24,
    B44,
    B44a,
    Dwaa,
    Dwab,
}

/// How the pixels of a part are cut into chunks.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Layout {
    /// Blocks of whole rows; their height follows from the compression.
    ScanLines,
    /// Tiles of one resolution level.
    Tiles {
        /// Columns per tile.
        width: u32,
        /// Rows per tile.
        height: u32,
    },
}

/// One channel of a part.
#[derive(Clone, Debug, PartialEq)]
pub struct Channel {
    /// The full name, `layer.component`, as bytes (UTF-8 by custom, not by promise).
    pub name: Vec<u8>,
    /// The `pLinear` flag of the channel list.
    pub perceptually_linear: bool,
    /// The pixels of the data window, row by row.
    pub samples: Samples,
}

/// The pixels of a channel in the file's own type, so that nothing is converted that need not be.
#[derive(Clone, Debug, PartialEq)]
pub enum Samples {
    /// 16-bit floats.
    Half(Vec<f16>),
    /// 32-bit floats.
    Float(Vec<f32>),
    /// 32-bit unsigned integers.
    Uint(Vec<u32>),
}

/// The type of a channel's samples.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum SampleType {
    /// 16-bit floats.
    Half,
    /// 32-bit floats.
    Float,
    /// 32-bit unsigned integers.
    Uint,
}

impl SampleType {
    /// Bytes of one sample.
    pub fn bytes(self) -> usize {
        match self {
            Self::Half => 2,
            Self::Float | Self::Uint => 4,
        }
    }
}

impl Samples {
    /// The type of the samples.
    pub fn kind(&self) -> SampleType {
        match self {
            Self::Half(_) => SampleType::Half,
            Self::Float(_) => SampleType::Float,
            Self::Uint(_) => SampleType::Uint,
        }
    }

    /// Number of samples.
    pub fn len(&self) -> usize {
        match self {
            Self::Half(samples) => samples.len(),
            Self::Float(samples) => samples.len(),
            Self::Uint(samples) => samples.len(),
        }
    }

    /// Whether there is no sample.
    pub fn is_empty(&self) -> bool {
        self.len() == 0
    }

    /// The values of a float channel as 32-bit floats, exactly; nothing for whole numbers.
    pub fn to_floats(&self) -> Option<Vec<f32>> {
        match self {
            Self::Half(values) => {
                let mut floats = vec![0.0; values.len()];
                values.convert_to_f32_slice(&mut floats);
                Some(floats)
            }
            Self::Float(values) => Some(values.clone()),
            Self::Uint(_) => None,
        }
    }

    /// The values of any channel as 32-bit floats, whole numbers above 2^24 rounded.
    pub fn as_f32(&self) -> Vec<f32> {
        match self {
            Self::Uint(values) => values.iter().map(|&value| value as f32).collect(),
            floats => floats.to_floats().unwrap_or_default(),
        }
    }

    /// Whether the bits are the same, those of NaNs included (`==` calls two NaNs different and two zeros equal).
    pub fn same_bits(&self, other: &Self) -> bool {
        match (self, other) {
            (Self::Half(a), Self::Half(b)) => a.iter().map(|x| x.to_bits()).eq(b.iter().map(|x| x.to_bits())),
            (Self::Float(a), Self::Float(b)) => {
                a.iter().map(|x| x.to_bits()).eq(b.iter().map(|x| x.to_bits()))
            }
            (Self::Uint(a), Self::Uint(b)) => a == b,
            _ => false,
        }
    }
}

impl Part {
    /// A part in scan lines whose display window is its data window; channels go by their names.
    pub fn new(window: Window, mut channels: Vec<Channel>) -> Self {
        channels.sort_by(|a, b| a.name.cmp(&b.name));
        Self {
            attributes: Attributes::default(),
            data_window: window,
            display_window: window,
            compression: Compression::Zip,
            layout: Layout::ScanLines,
            channels,
            had_levels: false,
        }
    }

    /// Height and width of the data window.
    pub fn size(&self) -> Size {
        self.data_window.size()
    }

    /// The part's `name`, if it has one.
    pub fn name(&self) -> Option<String> {
        self.attributes.text("name")
    }

    /// The part's `view` (of a stereo pair, say), if it has one.
    pub fn view(&self) -> Option<String> {
        self.attributes.text("view")
    }
}

impl Channel {
    /// The name for people; bytes that are not UTF-8 become the replacement character.
    pub fn display_name(&self) -> std::borrow::Cow<'_, str> {
        String::from_utf8_lossy(&self.name)
    }
}
