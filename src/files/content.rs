//! What an output is made from, whatever its names and times say: each source by sums of its bytes, so that a copy of a source is the
//! same and another file of its name is another.

use std::collections::HashMap;
use std::io::{ErrorKind, Read, Seek, SeekFrom};
use std::path::{Path, PathBuf};
use std::sync::{Mutex, PoisonError};
use std::time::SystemTime;

use lacuna_exr::open_regular;
use sha2::{Digest, Sha256};

use crate::files::identity::Identity;

/// Bytes at the beginning of a file that its outline has; the header and the table of chunks of most frames are among them.
const HEAD: u64 = 64 << 10;
/// Places behind them, evenly to the end, and the bytes of each: chunks of other sizes move all that follow.
const PLACES: u64 = 16;
const PLACE: u64 = 4 << 10;
/// Bytes that are read at a time.
const PIECE: usize = 1 << 18;

/// What the system says of a file: another one of its name, or one that was written to, differs.
#[derive(Clone, Debug, PartialEq, Eq, Hash)]
pub struct State {
    identity: Identity,
    length: u64,
    modified: Option<SystemTime>,
}

impl State {
    /// That of a file that exists.
    pub fn of(path: &Path) -> Option<Self> {
        let metadata = path.metadata().ok()?;
        Some(Self {
            identity: Identity::of(path)?,
            length: metadata.len(),
            modified: metadata.modified().ok(),
        })
    }
}

/// Whether a file was not written, and did not get its name, after that moment: nothing may have changed since. Switched links do
/// not show.
fn is_older(path: &Path, moment: SystemTime) -> bool {
    let Ok(metadata) = path.metadata() else { return false };
    // Copies may have the time of another file, but not this one.
    #[cfg(unix)]
    let named = {
        use std::os::unix::fs::MetadataExt;
        use std::time::{Duration, UNIX_EPOCH};
        let seconds = u64::try_from(metadata.ctime()).unwrap_or(0);
        let parts = u32::try_from(metadata.ctime_nsec()).unwrap_or(0);
        UNIX_EPOCH.checked_add(Duration::new(seconds, parts)).is_some_and(|changed| changed < moment)
    };
    #[cfg(not(unix))]
    let named = true;
    named && metadata.modified().is_ok_and(|changed| changed < moment)
}

/// Sums of whole files, which a run reads once for this.
#[derive(Debug, Default)]
pub struct Sums(Mutex<HashMap<State, u64>>);

impl Sums {
    /// That of a file in this state.
    fn of(&self, path: &Path, state: &State) -> std::io::Result<u64> {
        if let Some(known) = self.0.lock().unwrap_or_else(PoisonError::into_inner).get(state) {
            return Ok(*known);
        }
        let mut sum = Sha256::new();
        add(&mut sum, open_regular(path)?)?;
        let value = value(sum);
        self.0.lock().unwrap_or_else(PoisonError::into_inner).insert(state.clone(), value);
        Ok(value)
    }
}

/// A sum of a file's length, its beginning and some of its places: what is cheap to read however large it is.
fn outline(path: &Path) -> std::io::Result<u64> {
    let mut file = open_regular(path)?;
    let length = file.metadata()?.len();
    let mut sum = Sha256::new();
    sum.update(length.to_le_bytes());
    add(&mut sum, Read::by_ref(&mut file).take(HEAD))?;
    let Some(rest) = length.checked_sub(HEAD + PLACE) else {
        add(&mut sum, file)?;
        return Ok(value(sum));
    };
    for place in 0..PLACES {
        // In this order nothing overflows.
        let at = HEAD + rest / (PLACES - 1) * place + rest % (PLACES - 1) * place / (PLACES - 1);
        file.seek(SeekFrom::Start(at))?;
        add(&mut sum, Read::by_ref(&mut file).take(PLACE))?;
    }
    Ok(value(sum))
}

/// Adds all that is left to read.
fn add(sum: &mut Sha256, mut from: impl Read) -> std::io::Result<()> {
    let mut piece = vec![0; PIECE];
    loop {
        match from.read(&mut piece) {
            Ok(0) => return Ok(()),
            Ok(count) => sum.update(&piece[..count]),
            Err(error) if error.kind() == ErrorKind::Interrupted => {}
            Err(error) => return Err(error),
        }
    }
}

/// The first 64 bits of a sum: no two versions of a file have the same by chance.
fn value(sum: Sha256) -> u64 {
    sum.finalize().iter().take(8).fold(0, |value, byte| value << 8 | u64::from(*byte))
}

/// Stands for what cannot be read.
const UNREAD: &str = "-";

/// What a source is, as the line has it.
fn word(what: &str) -> String {
    what.replace(' ', "-")
}

/// The files that an output is made from, each with what it is to it, in the state that they had before any was read.
#[derive(Clone, Debug)]
pub struct Seen(Vec<(PathBuf, &'static str, Option<State>)>);

impl Seen {
    /// These, as they are now.
    pub fn new<'a>(sources: impl IntoIterator<Item = (&'a Path, &'static str)>) -> Self {
        Self(sources.into_iter().map(|(path, what)| (path.into(), what, State::of(path))).collect())
    }

    /// With further ones.
    #[must_use]
    pub fn and(mut self, others: Self) -> Self {
        self.0.extend(others.0);
        self
    }

    /// The first that is another one now, or was written to.
    pub fn changed(&self) -> Option<(&Path, &'static str)> {
        let changed = self.0.iter().find(|(path, _, state)| State::of(path) != *state);
        changed.map(|(path, what, _)| (&**path, *what))
    }

    /// What they are, on one line: `input=OUTLINE:WHOLE mask=OUTLINE:WHOLE`, two sums in hexadecimal digits for each, or `-` for what
    /// cannot be read (a frame beside it, which then is left out).
    pub fn line(&self, sums: &Sums) -> String {
        let one = |path: &Path, state: &Option<State>| {
            let (outline, whole) = (outline(path).ok()?, sums.of(path, state.as_ref()?).ok()?);
            Some(format!("{outline:016x}:{whole:016x}"))
        };
        let words = self.0.iter().map(|(path, what, state)| {
            let both = one(path, state);
            format!("{}={}", word(what), both.as_deref().unwrap_or(UNREAD))
        });
        words.collect::<Vec<_>>().join(" ")
    }

    /// Why these are not the files of such a line, in an output that was made at that moment; nothing if they are. Files that are older
    /// than the output are known by their outlines, others are read.
    pub fn differs(&self, line: &str, made: SystemTime, sums: &Sums) -> Option<String> {
        let recorded: Vec<_> = line.split(' ').filter_map(|word| word.split_once('=')).collect();
        if !recorded.iter().map(|(what, _)| *what).eq(self.0.iter().map(|(_, what, _)| word(what))) {
            return Some("it was made from other files".into());
        }
        let same = |path: &Path, state: &State, (first, whole): (&str, &str)| {
            let same = |own: u64, text: &str| u64::from_str_radix(text, 16).is_ok_and(|sum| sum == own);
            let same_outline = same(outline(path).ok()?, first);
            Some(same_outline && (is_older(path, made) || same(sums.of(path, state).ok()?, whole)))
        };
        let other = self.0.iter().zip(&recorded).find(|((path, _, state), (_, recorded))| {
            let read = state.as_ref().zip(recorded.split_once(':'));
            match read {
                Some((state, both)) => same(path, state, both) != Some(true),
                None => *recorded != UNREAD || outline(path).is_ok(),
            }
        });
        other.map(|((path, what, _), _)| not_as_before(path, what, "another one"))
    }

    /// The first that is not older than an output which does not say what it was made from.
    pub fn newer(&self, made: SystemTime) -> Option<String> {
        let is_newer = |state: &State| state.modified.is_none_or(|changed| changed >= made);
        let newer = self.0.iter().find(|(_, _, state)| state.as_ref().is_none_or(is_newer));
        newer.map(|(path, what, _)| not_as_before(path, what, "newer"))
    }
}

/// What is told of a source that is not what the output was made from.
fn not_as_before(path: &Path, what: &str, how: &str) -> String {
    let gone = path.metadata().is_err_and(|error| error.kind() == ErrorKind::NotFound);
    format!("the {what} {} is {}", path.display(), if gone { "missing" } else { how })
}

#[cfg(test)]
mod tests;
