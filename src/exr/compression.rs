//! The compressions of the file format: names, numbers, chunk heights.

use super::{Compression, Error, SampleType};

/// In the order of the format's numbers.
const ALL: [(Compression, &str); 10] = [
    (Compression::None, "none"),
    (Compression::Rle, "rle"),
    (Compression::Zips, "zips"),
    (Compression::Zip, "zip"),
    (Compression::Piz, "piz"),
    (Compression::Pxr24, "pxr24"),
    (Compression::B44, "b44"),
    (Compression::B44a, "b44a"),
    (Compression::Dwaa, "dwaa"),
    (Compression::Dwab, "dwab"),
];

impl Compression {
    /// The compression of that name, in lower case as [`Compression::name`] gives it.
    pub fn from_name(name: &str) -> Option<Self> {
        ALL.iter().find(|(_, known)| *known == name).map(|(compression, _)| *compression)
    }

    /// `none`, `rle`, `zips`, `zip`, `piz`, `pxr24`, `b44`, `b44a`, `dwaa` or `dwab`.
    pub fn name(self) -> &'static str {
        ALL.iter().find(|(compression, _)| *compression == self).map_or("", |(_, name)| name)
    }

    /// Whether every pixel of every channel type comes back with the bits it had.
    pub fn is_lossless(self) -> bool {
        matches!(self, Self::None | Self::Rle | Self::Zips | Self::Zip | Self::Piz)
    }

    /// How far from zero a pixel that was zero may come back in a channel of that type.
    ///
    /// B44 keeps six bits of the ordered halves of a block, so that it errs by at most 2^11 of them around zero. DWA errs in 1/2.2
    /// powers of light by a standard deviation of at most 7 quanta of its level over 10^5, whatever the pixels beside; this is five of
    /// those at level 200, as files do not always tell theirs (the usual one is 45).
    pub fn zero_within(self, kind: SampleType) -> f32 {
        match (self, kind) {
            (Self::B44 | Self::B44a, SampleType::Half) => 1.0 / 8192.0,
            (Self::Dwaa | Self::Dwab, SampleType::Half | SampleType::Float) => 3e-3,
            _ => 0.0,
        }
    }

    /// The number in the file.
    pub(super) fn number(self) -> u8 {
        ALL.iter().position(|(compression, _)| *compression == self).unwrap_or(0) as u8
    }

    /// The compression with that number in the file.
    pub(super) fn from_number(number: u8) -> Result<Self, Error> {
        if let Some((compression, _)) = ALL.get(usize::from(number)) {
            return Ok(*compression);
        }
        let name = match number {
            10 | 11 => "HTJ2K",
            12 => "LJ2K",
            13 => "ZSTD",
            _ => return Err(Error::damaged(format!("compression {number} is unknown"))),
        };
        Err(Error::Unsupported {
            what: format!("{name} compression is"),
            remedy: "convert it first: oiiotool IN --compression zip -o OUT".into(),
        })
    }

    /// Rows in a chunk of a part with scan lines.
    pub(super) fn rows_per_chunk(self) -> usize {
        match self {
            Self::None | Self::Rle | Self::Zips => 1,
            Self::Zip | Self::Pxr24 => 16,
            Self::Piz | Self::B44 | Self::B44a | Self::Dwaa => 32,
            Self::Dwab => 256,
        }
    }

    /// How many bytes of pixels one compressed byte can hold at most; `None` where there is no useful bound.
    pub(super) fn largest_ratio(self) -> Option<u64> {
        match self {
            Self::None => Some(1),
            Self::Rle => Some(64),
            Self::Zips | Self::Zip => Some(1032),
            Self::Pxr24 => Some(1032 * 4 / 3 + 1),
            Self::B44 | Self::B44a => Some(11),
            Self::Piz | Self::Dwaa | Self::Dwab => None,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn names_and_numbers_agree() {
        for (number, (compression, name)) in ALL.into_iter().enumerate() {
            assert_eq!(Compression::from_name(name), Some(compression));
            assert_eq!(compression.name(), name);
            assert_eq!(usize::from(compression.number()), number);
            assert_eq!(Compression::from_number(number as u8).unwrap(), compression);
        }
        assert_eq!(Compression::from_name("ZIP"), None);
    }

    #[test]
    fn later_compressions_are_refused_by_name() {
        for (number, name) in [(10, "HTJ2K"), (11, "HTJ2K"), (12, "LJ2K"), (13, "ZSTD")] {
            let message = Compression::from_number(number).unwrap_err().to_string();
            assert!(message.starts_with(&format!("{name} compression is not supported")), "{message}");
            assert!(message.contains("oiiotool"), "{message}");
        }
        assert!(matches!(Compression::from_number(14), Err(Error::Damaged(_))));
    }
}
