//! Whole numbers in as few bits as their frequencies allow, by the range coder of the crate `constriction`.
//!
//! A number `v` is sent as its class, the number of its binary digits, which is coded by how often each class occurs (a table of
//! the stream), and the digits below the leading one, which are taken as even.

use constriction::stream::model::{DefaultContiguousCategoricalEntropyModel as Table, DefaultUniformModel};
use constriction::stream::queue::{DefaultRangeDecoder, DefaultRangeEncoder};
use constriction::stream::{Decode, Encode};

use super::Error;

/// Classes: those of 0 and of numbers of 1 to 20 digits.
const CLASSES: usize = 21;
/// The tables' probabilities are multiples of 2^-24; this many are handed out by frequency.
const TOTAL: u64 = 1 << 24;

/// Which table a number is coded with.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Kind {
    /// Atoms of a block.
    Count,
    /// From one atom of a block to the next.
    Gap,
    /// A factor's size.
    Size,
    /// A factor's sign: 0 or 1.
    Sign,
}

/// Tables of all kinds.
type Frequencies = [[u32; CLASSES]; 4];

fn class(value: u32) -> usize {
    (u32::BITS - value.leading_zeros()) as usize
}

/// Codes numbers below 2^20: the tables, then the words.
pub fn encode(numbers: &[(Kind, u32)]) -> Result<Vec<u8>, Error> {
    let mut frequencies: Frequencies = [[0; CLASSES]; 4];
    for &(kind, value) in numbers {
        let slot = frequencies[kind as usize].get_mut(class(value));
        *slot.ok_or_else(|| Error::TooLarge(format!("the number {value}")))? += 1;
    }
    let tables = tables(&frequencies)?;
    let mut coder = DefaultRangeEncoder::new();
    let full = |_| Error::TooLarge("the code".into());
    for &(kind, value) in numbers {
        let class = class(value);
        coder.encode_symbol(class, &tables[kind as usize]).map_err(full)?;
        if class > 1 {
            let digits = value - (1 << (class - 1));
            coder.encode_symbol(digits as usize, DefaultUniformModel::new(1 << (class - 1))).map_err(full)?;
        }
    }
    let mut out = Vec::new();
    for frequency in frequencies.iter().flatten() {
        out.extend(frequency.to_le_bytes());
    }
    let words = coder.into_compressed().map_err(|_| Error::TooLarge("the code".into()))?;
    out.extend(words.iter().flat_map(|word| word.to_le_bytes()));
    Ok(out)
}

/// Reads numbers that were coded by [`encode`].
pub struct Reader {
    tables: Vec<Table>,
    coder: DefaultRangeDecoder,
    /// Numbers of each kind that are still to come.
    left: [u64; 4],
}

impl Reader {
    /// Of the bytes that [`encode`] made.
    pub fn new(bytes: &[u8]) -> Result<Self, Error> {
        let damaged = || Error::Damaged("the code's tables are not whole".into());
        let (head, words) = bytes.split_at_checked(4 * 4 * CLASSES).ok_or_else(damaged)?;
        if !words.len().is_multiple_of(4) {
            return Err(Error::Damaged("the code ends inside a word".into()));
        }
        let word = |bytes: &[u8]| bytes.iter().rev().fold(0, |word, byte| word << 8 | u32::from(*byte));
        let mut frequencies: Frequencies = [[0; CLASSES]; 4];
        for (slot, bytes) in frequencies.iter_mut().flatten().zip(head.chunks_exact(4)) {
            *slot = word(bytes);
        }
        let left = frequencies.map(|table| table.iter().map(|count| u64::from(*count)).sum());
        let words: Vec<u32> = words.chunks_exact(4).map(word).collect();
        let Ok(coder) = DefaultRangeDecoder::from_compressed(words);
        Ok(Self { tables: tables(&frequencies)?, coder, left })
    }

    /// How many numbers of a kind are still to come.
    pub const fn left(&self, kind: Kind) -> u64 {
        self.left[kind as usize]
    }

    /// The next number.
    pub fn next(&mut self, kind: Kind) -> Result<u32, Error> {
        let damaged = || Error::Damaged("the code contradicts its tables".into());
        let left = &mut self.left[kind as usize];
        *left = left.checked_sub(1).ok_or_else(damaged)?;
        let class = self.coder.decode_symbol(&self.tables[kind as usize]).map_err(|_| damaged())?;
        match class {
            0 | 1 => Ok(class as u32),
            class if class < CLASSES => {
                let digits = self.coder.decode_symbol(DefaultUniformModel::new(1 << (class - 1)));
                Ok((digits.map_err(|_| damaged())? as u32) + (1 << (class - 1)))
            }
            _ => Err(damaged()),
        }
    }

    /// Whether every number was read, and the words end where they should.
    pub fn is_at_end(&self) -> bool {
        self.left == [0; 4] && self.coder.maybe_exhausted()
    }
}

/// Probabilities of classes, by whole numbers alone, so that every machine has the same.
fn tables(frequencies: &Frequencies) -> Result<Vec<Table>, Error> {
    let table = |counts: &[u32; CLASSES]| {
        let all: u64 = counts.iter().map(|count| u64::from(*count)).sum::<u64>().max(1);
        // Every class can be coded; what rounding leaves over goes to the most frequent one.
        let spare = TOTAL - CLASSES as u64;
        let mut shares =
            counts.map(|count| 1 + (u128::from(count) * u128::from(spare) / u128::from(all)) as u64);
        let rest = TOTAL - shares.iter().sum::<u64>();
        if let Some(top) = shares.iter_mut().max() {
            *top += rest;
        }
        let shares = shares.map(|share| share as u32);
        Table::from_nonzero_fixed_point_probabilities(shares, false)
    };
    let made: Result<Vec<_>, ()> = frequencies.iter().map(table).collect();
    made.map_err(|()| Error::Damaged("the code's tables are none".into()))
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    const KINDS: [Kind; 4] = [Kind::Count, Kind::Gap, Kind::Size, Kind::Sign];

    proptest! {
        #[test]
        fn numbers_come_back(numbers in prop::collection::vec((0..4_usize, 0..20_u32, any::<u32>()), 0..400)) {
            let numbers: Vec<(Kind, u32)> =
                numbers.iter().map(|(kind, digits, bits)| (KINDS[*kind], bits % (1 << digits))).collect();
            let bytes = encode(&numbers).unwrap();
            let mut reader = Reader::new(&bytes).unwrap();
            for (kind, value) in &numbers {
                prop_assert_eq!(reader.next(*kind).unwrap(), *value);
            }
            prop_assert!(reader.is_at_end());
            prop_assert!(reader.next(Kind::Gap).is_err());
        }

        #[test]
        fn any_bytes_end_quietly(bytes in prop::collection::vec(any::<u8>(), 0..800)) {
            if let Ok(mut reader) = Reader::new(&bytes) {
                for _ in 0..100 {
                    if reader.next(Kind::Gap).is_err() {
                        break;
                    }
                }
            }
        }
    }

    #[test]
    fn frequent_classes_take_few_bits() {
        let numbers: Vec<(Kind, u32)> = (0..10_000).map(|i| (Kind::Gap, u32::from(i % 100 == 0))).collect();
        // 10000 h(1/100) = 808 bits, and the tables.
        assert!(encode(&numbers).unwrap().len() < 4 * 4 * CLASSES + 808 / 8 + 16);
        assert!(encode(&[(Kind::Size, 1 << 20)]).is_err());
    }
}
