//! A dictionary's file: a zip archive of NumPy arrays, which `numpy.load` opens, whatever its name ends in.
//!
//! | array | type and shape | what |
//! |---|---|---|
//! | `atoms` | `f4 (n, K)` | the atoms, one a column: all of the first channel, row by row, then of the next |
//! | `block`, `channels` | `u4 ()` | pixels of a block's side; 1 for grey, 3 for R, G and B |
//! | `sparsity`, `stride`, `frames`, `signals`, `iterations` | `u4 ()` | of the training; `signals` are the blocks that it used |
//! | `seed`, `blocks_max` | `u8 ()` | which blocks, and how many at most |
//! | `approximate` | `u4 ()` | 1 where atoms were updated by one step |
//! | `errors` | `f8 (done,)` | the root mean squared error after each iteration |
//! | `usage` | `u8 (K,)` | how many blocks use each atom |
//! | `data_hash` | `u1 (32,)` | SHA-256 of the blocks |
//! | `code_lengths`, `code_atoms`, `code_factors` | `u4 (N,)`, `u4`, `f4` | the blocks' codes, without which a training cannot go on |

use std::collections::BTreeMap;
use std::io::{Cursor, Read, Write};
use std::path::Path;

use lacuna_exr::{Amount, open_regular, write_whole};
use lacuna_filters::dictionary::Dictionary;
use lacuna_filters::dictionary::pursuit::Code;
use ndarray::{Array2, ArrayView2};
use sha2::{Digest, Sha256};
use zip::write::SimpleFileOptions;
use zip::{CompressionMethod, ZipArchive, ZipWriter};

use super::{Error, npy};

/// The most bytes of an array.
const MOST_BYTES: u64 = 1 << 30;
/// The most bytes of all arrays together.
const MOST_IN_ALL: u64 = 3 << 29;
/// The most blocks and entries of codes that are kept: the arrays of more could not be read again.
const MOST_CODES: usize = 1 << 26;
/// An array is there as bytes, as numbers and in its place.
const COPIES: u64 = 3;
/// The most arrays.
const MOST_ARRAYS: usize = 64;

/// How a dictionary came about.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Trained {
    /// Atoms of a block's code at most.
    pub sparsity: u32,
    /// Pixels from block to block.
    pub stride: u32,
    /// Frames that were read.
    pub frames: u32,
    /// Blocks that were used.
    pub signals: u32,
    /// Iterations that were asked for.
    pub iterations: u32,
    /// Which blocks.
    pub seed: u64,
    /// Blocks at most; 0 takes all.
    pub blocks_max: u64,
    /// Whether atoms were updated by one step.
    pub approximate: bool,
    /// The root mean squared error after each iteration.
    pub errors: Vec<f64>,
    /// How many blocks use each atom.
    pub usage: Vec<u64>,
    /// SHA-256 of the blocks.
    pub data_hash: Vec<u8>,
    /// The blocks' codes, which the next iteration goes by; files of earlier versions have none once they are finished.
    pub codes: Option<Vec<Code>>,
}

/// A dictionary and how it came about.
#[derive(Clone, Debug, PartialEq)]
pub struct Stored {
    /// The atoms.
    pub dictionary: Dictionary,
    /// The training.
    pub trained: Trained,
}

impl Stored {
    /// What tells the dictionary from others: the first 16 digits of the SHA-256 of its shape and atoms.
    pub fn name(&self) -> String {
        name(&self.dictionary)
    }

    /// Whether all iterations that were asked for were done.
    pub fn is_finished(&self) -> bool {
        self.trained.errors.len() >= self.trained.iterations as usize
    }

    /// Reads a file, within `most` bytes of memory.
    ///
    /// # Errors
    /// For what is no dictionary, is damaged, or is larger than any or than that; before memory is taken.
    pub fn read(path: &Path, most: u64) -> Result<Self, Error> {
        let file = open_regular(path).map_err(Error::io("open"))?;
        let mut archive = ZipArchive::new(file).map_err(|_| Error::Other("a dictionary (.npz)"))?;
        if archive.len() > MOST_ARRAYS {
            return Err(Error::TooLarge("the list of arrays".into()));
        }
        let damaged = |error: zip::result::ZipError| Error::Damaged(error.to_string());
        let mut all = 0_u64;
        for at in 0..archive.len() {
            all = all.saturating_add(archive.by_index(at).map_err(damaged)?.size());
        }
        if all > MOST_IN_ALL {
            return Err(Error::TooLarge("all arrays together".into()));
        }
        if COPIES * all > most {
            return Err(Error::Memory(Amount::at_most(COPIES * all)));
        }
        let mut arrays = BTreeMap::new();
        for at in 0..archive.len() {
            let entry = archive.by_index(at).map_err(damaged)?;
            let name = entry.name().map_err(damaged)?;
            let Some(name) = name.strip_suffix(".npy").map(str::to_owned) else {
                return Err(Error::Other("a dictionary (.npz)"));
            };
            let size = entry.size();
            if size > MOST_BYTES + 4096 {
                return Err(Error::TooLarge(format!("the array {name}")));
            }
            // What is unpacked may be more than the archive says, never more than is read.
            let mut bytes = Vec::new();
            let read = entry.take(size + 1).read_to_end(&mut bytes);
            read.map_err(|error| Error::Damaged(format!("the array {name}: {error}")))?;
            if bytes.len() as u64 != size {
                return Err(Error::Damaged(format!(
                    "the array {name} has not the size that the archive says"
                )));
            }
            arrays.insert(name, bytes);
        }
        Self::of(&Arrays(arrays))
    }

    fn of(arrays: &Arrays) -> Result<Self, Error> {
        let (shape, atoms) = arrays.read::<f32>("atoms", 2)?;
        let columns = ArrayView2::from_shape((shape[0], shape[1]), &atoms);
        let columns = columns.map_err(|error| Error::Damaged(error.to_string()))?;
        let (block, channels) = (arrays.one::<u32>("block")?, arrays.one::<u32>("channels")?);
        let atoms = columns.t().as_standard_layout().into_owned();
        let dictionary = Dictionary::new(block as usize, channels as usize, atoms);
        let dictionary = dictionary.map_err(|error| Error::Damaged(error.to_string()))?;
        let trained = Trained {
            sparsity: arrays.one("sparsity")?,
            stride: arrays.one("stride")?,
            frames: arrays.one("frames")?,
            signals: arrays.one("signals")?,
            iterations: arrays.one("iterations")?,
            seed: arrays.one("seed")?,
            blocks_max: arrays.one("blocks_max")?,
            approximate: arrays.one::<u32>("approximate")? != 0,
            errors: arrays.read("errors", 1)?.1,
            usage: arrays.read("usage", 1)?.1,
            data_hash: arrays.read("data_hash", 1)?.1,
            codes: arrays.codes(dictionary.len())?,
        };
        if trained.usage.len() != dictionary.len() {
            return Err(Error::Damaged("usage is not that of the atoms".into()));
        }
        Ok(Self { dictionary, trained })
    }

    /// Writes a file, complete or not at all.
    ///
    /// # Errors
    /// For what the system refuses.
    pub fn write(&self, path: &Path) -> Result<(), Error> {
        let bytes = self.bytes().map_err(|error| Error::Damaged(error.to_string()))?;
        write_whole(path, &bytes).map_err(|error| Error::Frame(error.to_string()))
    }

    /// The file's bytes; equal dictionaries have equal ones.
    fn bytes(&self) -> Result<Vec<u8>, zip::result::ZipError> {
        let Trained { sparsity, stride, frames, signals, iterations, seed, blocks_max, .. } = self.trained;
        let mut archive = ZipWriter::new(Cursor::new(Vec::new()));
        // No compression: numbers of atoms do not shrink. The default time is a fixed one.
        let options =
            SimpleFileOptions::default().compression_method(CompressionMethod::Stored).large_file(false);
        let mut put = |name: &str, bytes: Vec<u8>| {
            archive.start_file(format!("{name}.npy"), options)?;
            archive.write_all(&bytes).map_err(zip::result::ZipError::Io)
        };
        let columns: Array2<f32> = self.dictionary.atoms().t().as_standard_layout().into_owned();
        let (n, k) = columns.dim();
        put("atoms", npy::write(&[n, k], columns.as_slice().unwrap_or_default()))?;
        for (name, value) in [
            ("block", self.dictionary.block() as u32),
            ("channels", self.dictionary.channels() as u32),
            ("sparsity", sparsity),
            ("stride", stride),
            ("frames", frames),
            ("signals", signals),
            ("iterations", iterations),
            ("approximate", u32::from(self.trained.approximate)),
        ] {
            put(name, npy::write(&[], &[value]))?;
        }
        put("seed", npy::write(&[], &[seed]))?;
        put("blocks_max", npy::write(&[], &[blocks_max]))?;
        put("errors", npy::write(&[self.trained.errors.len()], &self.trained.errors))?;
        put("usage", npy::write(&[self.trained.usage.len()], &self.trained.usage))?;
        put("data_hash", npy::write(&[self.trained.data_hash.len()], &self.trained.data_hash))?;
        let kept = |codes: &&Vec<Code>| codes.len() + codes.iter().map(Vec::len).sum::<usize>() <= MOST_CODES;
        if let Some(codes) = self.trained.codes.as_ref().filter(kept) {
            let lengths: Vec<u32> = codes.iter().map(|code| code.len() as u32).collect();
            let (atoms, factors): (Vec<u32>, Vec<f32>) = codes.iter().flatten().copied().unzip();
            put("code_lengths", npy::write(&[lengths.len()], &lengths))?;
            put("code_atoms", npy::write(&[atoms.len()], &atoms))?;
            put("code_factors", npy::write(&[factors.len()], &factors))?;
        }
        Ok(archive.finish()?.into_inner())
    }
}

/// What tells a dictionary from others.
pub fn name(dictionary: &Dictionary) -> String {
    let mut hash = Sha256::new();
    for size in [dictionary.block(), dictionary.channels(), dictionary.len()] {
        hash.update((size as u64).to_le_bytes());
    }
    for value in dictionary.values() {
        hash.update(value.to_le_bytes());
    }
    hex(&hash.finalize()[..8])
}

/// Bytes as hexadecimal digits.
pub fn hex(bytes: &[u8]) -> String {
    bytes
        .iter()
        .flat_map(|byte| [byte >> 4, byte & 15])
        .filter_map(|digit| char::from_digit(digit.into(), 16))
        .collect()
}

/// SHA-256 of blocks.
pub fn hash_of(values: &[f32]) -> Vec<u8> {
    let mut hash = Sha256::new();
    for value in values {
        hash.update(value.to_le_bytes());
    }
    hash.finalize().to_vec()
}

/// The arrays of an archive by their names.
struct Arrays(BTreeMap<String, Vec<u8>>);

impl Arrays {
    fn read<T: npy::Number>(&self, name: &str, axes: usize) -> Result<(Vec<usize>, Vec<T>), Error> {
        let bytes = self.0.get(name).ok_or_else(|| Error::Damaged(format!("there is no array {name}")))?;
        npy::read(bytes, axes).map_err(|error| match error {
            Error::Damaged(text) => Error::Damaged(format!("{name}: {text}")),
            other => other,
        })
    }

    fn one<T: npy::Number>(&self, name: &str) -> Result<T, Error> {
        let (_, values) = self.read(name, 0)?;
        values.first().copied().ok_or_else(|| Error::Damaged(format!("{name} is empty")))
    }

    fn codes(&self, atoms: usize) -> Result<Option<Vec<Code>>, Error> {
        if !self.0.contains_key("code_lengths") {
            return Ok(None);
        }
        let lengths: Vec<u32> = self.read("code_lengths", 1)?.1;
        let places: Vec<u32> = self.read("code_atoms", 1)?.1;
        let factors: Vec<f32> = self.read("code_factors", 1)?.1;
        let all: u64 = lengths.iter().map(|length| u64::from(*length)).sum();
        let fits = all == places.len() as u64 && places.len() == factors.len();
        if !fits
            || places.iter().any(|atom| *atom as usize >= atoms)
            || !factors.iter().all(|x| x.is_finite())
        {
            return Err(Error::Damaged("the codes contradict each other".into()));
        }
        let mut entries = places.into_iter().zip(factors);
        Ok(Some(lengths.iter().map(|length| entries.by_ref().take(*length as usize).collect()).collect()))
    }
}

#[cfg(test)]
pub(super) mod tests {
    use std::fs;

    use lacuna_filters::dictionary::dct;

    use super::*;

    pub fn stored() -> Stored {
        let dictionary = dct::dictionary(4, 25).unwrap();
        let trained = Trained {
            sparsity: 3,
            iterations: 5,
            errors: vec![0.5, 0.25],
            usage: (0..25).collect(),
            data_hash: hash_of(&[1.0, 2.0]),
            codes: Some(vec![vec![(3, 1.5), (24, -2.0)], vec![], vec![(0, 1.0)]]),
            ..Trained::default()
        };
        Stored { dictionary, trained }
    }

    #[test]
    fn a_dictionary_comes_back_whatever_its_name_ends_in() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("show.dict");
        let stored = stored();
        stored.write(&path).unwrap();
        assert_eq!(Stored::read(&path, u64::MAX).unwrap(), stored);
        let error = |most: u64| Stored::read(&path, most).unwrap_err().to_string();
        assert!(error(1 << 8).contains("--memory"));
        assert_eq!(error(1 << 8), error(1 << 12), "what all arrays take together");
        assert!(!stored.is_finished());
        assert_eq!(stored.name().len(), 16);
        assert_ne!(stored.name(), name(&dct::dictionary(4, 16).unwrap()));
    }

    #[test]
    fn damaged_and_foreign_files_are_refused() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("a.npz");
        stored().write(&path).unwrap();
        let bytes = fs::read(&path).unwrap();
        for length in (0..bytes.len()).step_by(97) {
            fs::write(&path, &bytes[..length]).unwrap();
            assert!(Stored::read(&path, u64::MAX).is_err(), "{length}");
        }
        // A flipped byte is found by the archive's checksum, or makes it another archive.
        for at in (0..bytes.len() / 2).step_by(61) {
            let mut flipped = bytes.clone();
            flipped[at] ^= 0x10;
            fs::write(&path, &flipped).unwrap();
            if let Ok(found) = Stored::read(&path, u64::MAX) {
                assert_eq!(found, stored(), "{at}");
            }
        }
        fs::write(&path, b"no archive").unwrap();
        assert!(matches!(Stored::read(&path, u64::MAX), Err(Error::Other(_))));
        assert!(matches!(Stored::read(folder.path(), u64::MAX), Err(Error::Io { .. })));
    }
}
