//! The type of a voxel in a file, and its way to the type that is kept.

use std::str::FromStr;

use lacuna_core::parallel::prelude::*;

use crate::Values;

/// The type of a voxel in a file.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[allow(missing_docs, reason = "the names are the types")]
pub enum Element {
    I8,
    U8,
    I16,
    U16,
    I32,
    U32,
    F32,
    F64,
}

impl FromStr for Element {
    type Err = String;

    /// The short names: `u8`, `i16`, `f32`, ...
    fn from_str(text: &str) -> Result<Self, String> {
        Ok(match text {
            "i8" => Self::I8,
            "u8" => Self::U8,
            "i16" => Self::I16,
            "u16" => Self::U16,
            "i32" => Self::I32,
            "u32" => Self::U32,
            "f32" => Self::F32,
            "f64" => Self::F64,
            _ => {
                return Err(format!("'{text}' is not a type; choose u8, i8, u16, i16, u32, i32, f32 or f64"));
            }
        })
    }
}

impl Element {
    /// Bytes of one voxel.
    pub const fn bytes(self) -> usize {
        match self {
            Self::I8 | Self::U8 => 1,
            Self::I16 | Self::U16 => 2,
            Self::I32 | Self::U32 | Self::F32 => 4,
            Self::F64 => 8,
        }
    }

    /// All that a voxel can hold; 0 to 1 for floats.
    pub(super) const fn range(self) -> (f64, f64) {
        match self {
            Self::I8 => (i8::MIN as f64, i8::MAX as f64),
            Self::U8 => (0.0, u8::MAX as f64),
            Self::I16 => (i16::MIN as f64, i16::MAX as f64),
            Self::U16 => (0.0, u16::MAX as f64),
            Self::I32 => (i32::MIN as f64, i32::MAX as f64),
            Self::U32 => (0.0, u32::MAX as f64),
            Self::F32 | Self::F64 => (0.0, 1.0),
        }
    }

    /// Bytes of one voxel in the type that is kept.
    pub(super) const fn kept(self) -> usize {
        match self {
            Self::U8 => 1,
            Self::I8 | Self::I16 | Self::U16 => 2,
            Self::I32 | Self::U32 | Self::F32 | Self::F64 => 4,
        }
    }

    /// The values in bytes; a rest that makes no value is left out.
    pub(super) fn decode(self, bytes: Vec<u8>, big_endian: bool) -> Values {
        let given = bytes;
        let bytes = given.as_slice();
        match self {
            Self::U8 => Values::U8(given),
            Self::I8 => Values::I16(bytes.iter().map(|&byte| i16::from(byte as i8)).collect()),
            Self::U16 => Values::U16(each(bytes, big_endian, u16::from_le_bytes)),
            Self::I16 => Values::I16(each(bytes, big_endian, i16::from_le_bytes)),
            Self::I32 => Values::F32(each(bytes, big_endian, |b| i32::from_le_bytes(b) as f32)),
            Self::U32 => Values::F32(each(bytes, big_endian, |b| u32::from_le_bytes(b) as f32)),
            Self::F32 => Values::F32(each(bytes, big_endian, f32::from_le_bytes)),
            Self::F64 => Values::F32(each(bytes, big_endian, |b| f64::from_le_bytes(b) as f32)),
        }
    }

    /// Values from text: `count` numbers between white space.
    pub(super) fn parse(self, text: &[u8], count: usize) -> Result<Values, String> {
        // Every number takes a digit and a separator.
        if text.len() < count.saturating_mul(2).saturating_sub(1) {
            return Err(format!("truncated: {} bytes of text cannot hold {count} voxels", text.len()));
        }
        let text = std::str::from_utf8(text).map_err(|_| "the voxels are not text")?;
        let words: Vec<&str> = text.split_ascii_whitespace().collect();
        if words.len() != count {
            return Err(format!("{} voxels where the header promises {count}", words.len()));
        }
        match self {
            Self::U8 => all(&words).map(Values::U8),
            Self::I8 => each_word(&words, |word: i8| word.into()).map(Values::I16),
            Self::U16 => all(&words).map(Values::U16),
            Self::I16 => all(&words).map(Values::I16),
            Self::I32 => each_word(&words, |word: i32| word as f32).map(Values::F32),
            Self::U32 => each_word(&words, |word: u32| word as f32).map(Values::F32),
            Self::F32 | Self::F64 => all(&words).map(Values::F32),
        }
    }
}

fn all<T: FromStr>(words: &[&str]) -> Result<Vec<T>, String> {
    each_word(words, |word| word)
}

fn each_word<T: FromStr, U>(words: &[&str], to: impl Fn(T) -> U) -> Result<Vec<U>, String> {
    let one =
        |word: &&str| word.parse().map(&to).map_err(|_| format!("'{word}' is not a voxel of that type"));
    words.iter().map(one).collect()
}

fn each<const N: usize, T: Send>(bytes: &[u8], big_endian: bool, to: impl Fn([u8; N]) -> T + Sync) -> Vec<T> {
    bytes.as_chunks::<N>().0.par_iter().map(|&word| {
        let mut word = word;
        if big_endian {
            word.reverse();
        }
        to(word)
    })
}
