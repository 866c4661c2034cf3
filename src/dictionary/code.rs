//! A frame in few numbers: the atoms of its blocks and their factors, quantised and entropy-coded.
//!
//! The colour of a frame, R, G and B in the first part that has it, is cut into blocks side by side; each is approximated by at most
//! so many atoms ([`lacuna_filters::dictionary::whole`]). Factors are rounded to multiples of one step. The file is
//!
//! ```text
//! "LACUNACO", version, CRC-32 of all that follows, dictionary's hash (8 bytes), windows (8 x i32), layer (length, bytes), kinds of R, G, B,
//! domain's scale (f64; 0: linear), step (f32), then per block: count, and per atom gap to the one before, size, sign (stream)
//! ```
//!
//! all little-endian; files of version 1 have no checksum and are read as they are. Other channels and attributes are not kept.

use lacuna_exr::{Amount, Channel, Frame, Part, SampleType, Samples, Window};
use lacuna_filters::dictionary::pursuit::{Code, Selection};
use lacuna_filters::dictionary::{Dictionary, whole};
use lacuna_filters::domain::Map;
use lacuna_filters::{Mask, Planes};

use super::stream::{self, Kind, Reader};
use super::{Error, file, training};
use crate::channels::Name;
use crate::reconstruct::{Kind as FloatKind, convert};

const MAGIC: &[u8] = b"LACUNACO";
/// The version that is written; 1, without a checksum, is read as well.
const VERSION: u8 = 2;
/// The most pixels of a decoded frame: three planes of floats and their sums stay below 1.5 GiB.
const MOST_PIXELS: u64 = 1 << 25;
/// The most atoms of all blocks together: 512 MiB of codes.
const MOST_ENTRIES: u64 = 1 << 26;
/// Bytes that a pixel takes: three planes, their sums, the frame.
const DECODED: u64 = 48;
/// Bytes that an atom of a block takes.
const CODED: u64 = 16;
/// Where corners of windows lie in files that can be read: its library takes no further ones.
const FAR: std::ops::Range<i32> = -(i32::MAX / 2) + 1..i32::MAX / 2;
/// The longest layer.
const MOST_NAME: usize = 255;

/// What the colour's channels are called in a decoded frame.
pub const COMPONENTS: [&str; 3] = ["R", "G", "B"];

/// How a frame is encoded.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Fineness {
    /// Atoms of a block at most.
    pub sparsity: usize,
    /// The root mean squared error of a block at which no more are taken, in the frame's unit (or its mapped one); 0 takes all.
    pub error: f64,
    /// Bits of the largest factor, its sign included: 2 to 16.
    pub bits: u32,
}

/// An encoded frame, and what came of it.
#[derive(Clone, Debug, PartialEq)]
pub struct Encoded {
    /// The file.
    pub bytes: Vec<u8>,
    /// The frame that it decodes to.
    pub frame: Frame,
    /// The colour of the original, in the same order of channels.
    pub colour: Vec<Vec<f32>>,
    /// Atoms of all blocks.
    pub atoms: usize,
    /// Blocks.
    pub blocks: usize,
    /// Channels that were left out.
    pub left_out: Vec<String>,
    /// Channels that decode to R, G and B and have other names.
    pub renamed: Vec<String>,
    /// What the log should say of values that are not finite.
    pub non_finite: Option<String>,
}

/// What stands before the code.
struct Head {
    name: [u8; 8],
    data: Window,
    display: Window,
    layer: String,
    half: [bool; 3],
    scale: f64,
    step: f32,
}

/// Encodes the colour of a frame.
///
/// # Errors
/// [`Error::Frame`] for a frame without colour or of more than 2^25 pixels.
pub fn encode(frame: &Frame, dictionary: &Dictionary, how: Fineness) -> Result<Encoded, Error> {
    let (index, channels) = training::colour(frame)?;
    let part = &frame.parts[index];
    let size = part.size();
    if size.pixels() as u64 > MOST_PIXELS {
        return Err(Error::Frame(format!("{size} pixels are too many to encode (the limit is 2^25)")));
    }
    if !matches!(dictionary.channels(), 1 | 3) {
        return Err(Error::Frame("the dictionary is over other channels than R, G and B".into()));
    }
    let (planes, map) = training::planes(part, &channels)?;
    let block = dictionary.block();
    let values = dictionary.channels() * block.min(size.height) * block.min(size.width);
    let selection = Selection { error: how.error.powi(2) * values as f64, ..Selection::atoms(how.sparsity) };
    let codes = whole::codes(dictionary, &planes, &selection);
    let codes = codes.map_err(|error| Error::Frame(error.to_string()))?;
    let top = codes.iter().flatten().fold(0.0_f32, |top, entry| top.max(entry.1.abs()));
    if !top.is_finite() {
        return Err(Error::Frame("its values are too large to encode; scale them down".into()));
    }
    let levels = ((1_u32 << (how.bits - 1)) - 1) as f32;
    let step = if top > 0.0 { top / levels } else { 1.0 };
    let name = |at: usize| part.channels[at].display_name().into_owned();
    let head = Head {
        name: hash(dictionary),
        data: part.data_window,
        display: part.display_window,
        layer: Name::new(&name(channels[0])).layer.to_owned(),
        half: channels.map(|at| part.channels[at].samples.kind() == SampleType::Half),
        scale: if let Map::Log { scale } = map { scale } else { 0.0 },
        step,
    };
    let numbers = numbers(&codes, step);
    if numbers.len() as u64 > 3 * MOST_ENTRIES {
        return Err(Error::Frame(
            "the blocks have too many atoms together; give a smaller --dict-sparsity".into(),
        ));
    }
    let bytes = sealed(&[head.bytes()?, stream::encode(&numbers)?].concat());
    let all = frame.parts.iter().enumerate();
    let left_out = all.flat_map(|(at, part)| {
        let kept = move |channel: usize| at == index && channels.contains(&channel);
        let names = part.channels.iter().enumerate().filter(move |(channel, _)| !kept(*channel));
        names.map(|(_, channel)| channel.display_name().into_owned())
    });
    let is_renamed = |(name, kept): &(String, &str)| Name::new(name).component != *kept;
    let renamed = channels.map(name).into_iter().zip(COMPONENTS).filter(is_renamed);
    Ok(Encoded {
        left_out: left_out.collect(),
        renamed: renamed.map(|(name, _)| name).collect(),
        non_finite: training::non_finite(part, &channels),
        frame: decode(&bytes, dictionary, u64::MAX)?,
        bytes,
        colour: channels.iter().filter_map(|at| part.channels[*at].samples.to_floats()).collect(),
        atoms: numbers.iter().filter(|(kind, _)| *kind == Kind::Sign).count(),
        blocks: codes.len(),
    })
}

/// The numbers of codes, block by block.
fn numbers(codes: &[Code], step: f32) -> Vec<(Kind, u32)> {
    let mut numbers = Vec::new();
    for code in codes {
        let rounded = code.iter().map(|&(atom, factor)| (atom, (factor / step).round() as i32));
        let mut entries: Vec<(u32, i32)> = rounded.filter(|entry| entry.1 != 0).collect();
        entries.sort_unstable();
        numbers.push((Kind::Count, entries.len() as u32));
        let mut next = 0;
        for (atom, factor) in entries {
            numbers.push((Kind::Gap, atom - next));
            next = atom + 1;
            numbers.push((Kind::Size, factor.unsigned_abs() - 1));
            numbers.push((Kind::Sign, u32::from(factor < 0)));
        }
    }
    numbers
}

/// Decodes a frame, within `most` bytes of memory.
///
/// # Errors
/// For another dictionary than the frame's, and for bytes that are no frame or too large a one; before memory is taken.
pub fn decode(bytes: &[u8], dictionary: &Dictionary, most: u64) -> Result<Frame, Error> {
    let (head, rest) = Head::read(opened(bytes)?)?;
    if head.name != hash(dictionary) {
        let given = file::name(dictionary);
        let wanted = file::hex(&head.name);
        return Err(Error::OtherDictionary { wanted, given });
    }
    let size = head.data.size();
    let pixels = (size.height as u64).checked_mul(size.width as u64);
    if pixels.is_none_or(|pixels| pixels == 0 || pixels > MOST_PIXELS) {
        return Err(Error::TooLarge(format!("a frame of {size} pixels")));
    }
    let mut reader = Reader::new(rest)?;
    let count = whole::count(dictionary, size, 3);
    if reader.left(Kind::Count) != count as u64 {
        return Err(Error::Damaged(format!("there are not {count} blocks")));
    }
    if reader.left(Kind::Gap) > MOST_ENTRIES {
        return Err(Error::TooLarge("the list of atoms".into()));
    }
    let needed = size.pixels() as u64 * DECODED + reader.left(Kind::Gap) * CODED + bytes.len() as u64;
    if needed > most {
        return Err(Error::Memory(Amount::at_most(needed)));
    }
    let mut codes = Vec::with_capacity(count);
    for _ in 0..count {
        codes.push(block(&mut reader, dictionary, head.step)?);
    }
    if !reader.is_at_end() {
        return Err(Error::Damaged("there is more than the frame".into()));
    }
    let planes = whole::planes(dictionary, size, 3, &codes);
    let planes = planes.map_err(|error| Error::Damaged(error.to_string()))?;
    Ok(head.frame(planes))
}

fn block(reader: &mut Reader, dictionary: &Dictionary, step: f32) -> Result<Code, Error> {
    let damaged = || Error::Damaged("a block has atoms that the dictionary has not".into());
    let count = reader.next(Kind::Count)?;
    if count as usize > dictionary.len() {
        return Err(damaged());
    }
    let mut code = Code::with_capacity(count as usize);
    let mut next = 0;
    for _ in 0..count {
        let atom = reader.next(Kind::Gap)? + next;
        if atom as usize >= dictionary.len() {
            return Err(damaged());
        }
        next = atom + 1;
        let size = (reader.next(Kind::Size)? + 1) as f32 * step;
        code.push((atom, if reader.next(Kind::Sign)? == 0 { size } else { -size }));
    }
    Ok(code)
}

fn checksum(body: &[u8]) -> u32 {
    let mut sum = flate2::Crc::new();
    sum.update(body);
    sum.sum()
}

/// The file of a header and its code.
fn sealed(body: &[u8]) -> Vec<u8> {
    [MAGIC, &[VERSION], &checksum(body).to_le_bytes(), body].concat()
}

/// The header and the code of a file, as they were written.
fn opened(bytes: &[u8]) -> Result<&[u8], Error> {
    let rest = bytes.strip_prefix(MAGIC).ok_or(Error::Other("an encoded frame"))?;
    match rest.split_first().ok_or_else(truncated)? {
        (1, body) => Ok(body),
        (&VERSION, mut body) => {
            let sum = u32::from_le_bytes(take(&mut body)?);
            let wrong = || Error::Damaged("its checksum is that of other bytes".into());
            (sum == checksum(body)).then_some(body).ok_or_else(wrong)
        }
        _ => Err(Error::Other("an encoded frame of a version that is known here")),
    }
}

/// What tells a dictionary from others, in the file.
fn hash(dictionary: &Dictionary) -> [u8; 8] {
    let name = u64::from_str_radix(&file::name(dictionary), 16).unwrap_or(0);
    name.to_be_bytes()
}

impl Head {
    fn bytes(&self) -> Result<Vec<u8>, Error> {
        let mut out = self.name.to_vec();
        for window in [self.data, self.display] {
            for corner in [window.x_min, window.y_min, window.x_max, window.y_max] {
                out.extend(corner.to_le_bytes());
            }
        }
        if self.layer.len() > MOST_NAME {
            return Err(Error::Frame("the layer's name is longer than 255 bytes".into()));
        }
        out.push(self.layer.len() as u8);
        out.extend(self.layer.as_bytes());
        out.extend(self.half.map(u8::from));
        out.extend(self.scale.to_le_bytes());
        out.extend(self.step.to_le_bytes());
        Ok(out)
    }

    fn read(bytes: &[u8]) -> Result<(Self, &[u8]), Error> {
        let mut rest = bytes;
        let name = take::<8>(&mut rest)?;
        let mut corners = [0; 8];
        for corner in &mut corners {
            *corner = i32::from_le_bytes(take(&mut rest)?);
        }
        let window = |at: usize| Window {
            x_min: corners[at],
            y_min: corners[at + 1],
            x_max: corners[at + 2],
            y_max: corners[at + 3],
        };
        let [length] = take::<1>(&mut rest)?;
        let layer = rest.split_at_checked(length.into()).ok_or_else(truncated)?;
        rest = layer.1;
        let layer =
            str::from_utf8(layer.0).map_err(|_| Error::Damaged("the layer's name is no text".into()))?;
        let half = take::<3>(&mut rest)?.map(|flag| flag != 0);
        let scale = f64::from_le_bytes(take(&mut rest)?);
        let step = f32::from_le_bytes(take(&mut rest)?);
        let usable = scale.is_finite() && scale >= 0.0 && step.is_finite() && step > 0.0;
        let is_empty = |at: usize| corners[at] > corners[at + 2] || corners[at + 1] > corners[at + 3];
        if is_empty(0) || is_empty(4) || !corners.iter().all(|corner| FAR.contains(corner)) {
            return Err(Error::Damaged("its windows are none that a frame has".into()));
        }
        if !usable || layer.contains(char::is_control) {
            return Err(Error::Damaged("the numbers of the header are none".into()));
        }
        let layer = layer.to_owned();
        Ok((Self { name, data: window(0), display: window(4), layer, half, scale, step }, rest))
    }

    /// The frame of decoded planes.
    fn frame(&self, mut planes: Planes) -> Frame {
        let map = if self.scale > 0.0 { Map::Log { scale: self.scale } } else { Map::Linear };
        planes.as_mut_slice().iter_mut().for_each(|plane| map.inverse_plane(plane));
        let mask = Mask::from_fn(planes.size(), |_, _| true);
        let channel = |((plane, name), half): ((lacuna_filters::Plane, &str), bool)| {
            let values =
                plane.into_pixels().into_iter().map(|x| if x.is_finite() { x } else { 0.0 }).collect();
            let kind = if half { FloatKind::Half } else { FloatKind::Float };
            let (samples, _) = convert(Samples::Float(values), Some(kind), Some(&mask));
            let name = if self.layer.is_empty() { name.to_owned() } else { format!("{}.{name}", self.layer) };
            Channel { name: name.into_bytes(), perceptually_linear: false, samples }
        };
        let channels = planes.into_vec().into_iter().zip(COMPONENTS).zip(self.half).map(channel);
        let mut part = Part::new(self.data, channels.collect());
        part.display_window = self.display;
        Frame { parts: vec![part] }
    }
}

fn truncated() -> Error {
    Error::Damaged("truncated: the file ends inside its header".into())
}

fn take<const N: usize>(rest: &mut &[u8]) -> Result<[u8; N], Error> {
    let (taken, after) = rest.split_first_chunk::<N>().ok_or_else(truncated)?;
    *rest = after;
    Ok(*taken)
}

#[cfg(test)]
mod tests {
    use lacuna_filters::dictionary::dct;

    use super::*;

    fn frame(half: bool) -> Frame {
        let window = Window { x_min: -3, y_min: 2, x_max: 33, y_max: 30 };
        let size = window.size();
        let channel = |(at, name): (usize, &str)| {
            let value = |i: usize| ((i % size.width) as f32 / 9.0 + at as f32).sin() + 1.5;
            let values: Vec<f32> = (0..size.pixels()).map(value).collect();
            let samples = Samples::Float(values);
            let samples = if half { convert(samples, Some(FloatKind::Half), None).0 } else { samples };
            Channel { name: name.into(), perceptually_linear: false, samples }
        };
        let channels = ["a.A", "a.B", "a.G", "a.R"].into_iter().enumerate().map(channel).collect();
        Frame { parts: vec![Part::new(window, channels)] }
    }

    const FINE: Fineness = Fineness { sparsity: 16, error: 0.0, bits: 14 };

    #[test]
    fn a_frame_comes_back_but_for_the_rounding_of_its_factors() {
        let dictionary = dct::dictionary(4, 36).unwrap();
        for half in [false, true] {
            let frame = frame(half);
            let encoded = encode(&frame, &dictionary, FINE).unwrap();
            assert_eq!(encoded.left_out, ["a.A"]);
            let back = decode(&encoded.bytes, &dictionary, u64::MAX).unwrap();
            assert_eq!(back, encoded.frame);
            let part = &back.parts[0];
            assert_eq!(part.data_window, frame.parts[0].data_window);
            let names: Vec<_> = part.channels.iter().map(Channel::display_name).collect();
            assert_eq!(names, ["a.B", "a.G", "a.R"]);
            for channel in &part.channels {
                let original =
                    frame.parts[0].channels.iter().find(|other| other.name == channel.name).unwrap();
                assert_eq!(original.samples.kind(), channel.samples.kind());
                let (a, b) = (channel.samples.to_floats().unwrap(), original.samples.to_floats().unwrap());
                assert!(a.iter().zip(&b).all(|(a, b)| (a - b).abs() < 0.01));
            }
            let coarse = encode(&frame, &dictionary, Fineness { bits: 4, ..FINE }).unwrap();
            assert!(coarse.bytes.len() < encoded.bytes.len());
        }
    }

    #[test]
    fn other_dictionaries_and_damaged_files_are_refused() {
        let dictionary = dct::dictionary(4, 36).unwrap();
        let bytes = encode(&frame(false), &dictionary, FINE).unwrap().bytes;
        let other = decode(&bytes, &dct::dictionary(4, 25).unwrap(), u64::MAX);
        assert!(matches!(other, Err(Error::OtherDictionary { .. })));
        for length in (0..bytes.len()).step_by(13) {
            assert!(decode(&bytes[..length], &dictionary, u64::MAX).is_err(), "{length}");
        }
        for bit in 0..8 * bytes.len() {
            let mut flipped = bytes.clone();
            flipped[bit / 8] ^= 1 << (bit % 8);
            assert!(decode(&flipped, &dictionary, u64::MAX).is_err(), "bit {bit}");
        }
        let body = opened(&bytes).unwrap();
        for at in 0..body.len() {
            let mut flipped = body.to_vec();
            flipped[at] ^= 0x40;
            // What has its checksum may decode to another frame; it may not panic or take memory that is not there.
            drop(decode(&sealed(&flipped), &dictionary, u64::MAX));
        }
        let mut huge = body.to_vec();
        huge[16..24].copy_from_slice(&[0xff, 0xff, 0xff, 0x2f, 0xff, 0xff, 0xff, 0x2f]);
        assert!(matches!(decode(&sealed(&huge), &dictionary, u64::MAX), Err(Error::TooLarge(_))));
    }

    #[test]
    fn files_without_a_checksum_are_read() {
        let dictionary = dct::dictionary(4, 36).unwrap();
        let encoded = encode(&frame(true), &dictionary, FINE).unwrap();
        let old = [MAGIC, &[1], opened(&encoded.bytes).unwrap()].concat();
        assert_eq!(decode(&old, &dictionary, u64::MAX).unwrap(), encoded.frame);
        assert!(matches!(decode(&[MAGIC, &[3]].concat(), &dictionary, u64::MAX), Err(Error::Other(_))));
    }

    #[test]
    fn windows_that_no_reader_opens_are_refused() {
        let dictionary = dct::dictionary(4, 36).unwrap();
        let bytes = encode(&frame(false), &dictionary, FINE).unwrap().bytes;
        let body = opened(&bytes).unwrap();
        // Data and display windows stand after the dictionary's hash.
        for (corner, value) in [(4, 34), (5, 31), (4, i32::MIN), (6, i32::MAX), (0, i32::MIN)] {
            let mut other = body.to_vec();
            other[8 + 4 * corner..][..4].copy_from_slice(&i32::to_le_bytes(value));
            let error = decode(&sealed(&other), &dictionary, u64::MAX).unwrap_err().to_string();
            assert!(error.contains("windows"), "{corner} {value}: {error}");
        }
    }
}
