//! What an output is made from, whatever its names and times say: each source by a sum of its bytes, so that a copy of a source is the
//! same and another file of its name is another.

use std::collections::HashMap;
use std::io::{ErrorKind, Read};
use std::path::{Path, PathBuf};
use std::sync::{Mutex, PoisonError};
use std::time::SystemTime;

use lacuna_exr::open_regular;
use sha2::{Digest, Sha256};

use crate::files::identity::Identity;

/// Bytes that are read at a time.
const PIECE: usize = 1 << 18;

/// What the system says of a file: another one of its name, or one that was written to, differs. Some systems give a file that stays as
/// it is another number after a while.
#[derive(Clone, Debug, PartialEq, Eq, Hash)]
pub struct State {
    identity: Identity,
    length: u64,
    modified: Option<SystemTime>,
    /// When content, name or rights changed last: a number is used again, and a copy may have any time.
    changed: (i64, i64),
}

impl State {
    /// That of a file that exists.
    pub fn of(path: &Path) -> Option<Self> {
        let metadata = path.metadata().ok()?;
        Some(Self {
            identity: Identity::of(path)?,
            length: metadata.len(),
            modified: metadata.modified().ok(),
            #[cfg(unix)]
            changed: {
                use std::os::unix::fs::MetadataExt;
                (metadata.ctime(), metadata.ctime_nsec())
            },
            #[cfg(not(unix))]
            changed: (0, 0),
        })
    }
}

/// Sums of whole files, which a run reads once for this.
#[derive(Debug, Default)]
pub struct Sums(Mutex<HashMap<State, u64>>);

impl Sums {
    /// That of a file which was in this state.
    fn of(&self, path: &Path, state: &State) -> std::io::Result<u64> {
        if let Some(known) = self.known(state) {
            return Ok(known);
        }
        let mut sum = Sha256::new();
        add(&mut sum, open_regular(path)?)?;
        let value = value(sum);
        // Of one that changes meanwhile it is not known what was read.
        if State::of(path).as_ref() == Some(state) {
            self.0.lock().unwrap_or_else(PoisonError::into_inner).insert(state.clone(), value);
        }
        Ok(value)
    }

    fn known(&self, state: &State) -> Option<u64> {
        self.0.lock().unwrap_or_else(PoisonError::into_inner).get(state).copied()
    }
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

    /// The first that is another one now, or was written to. One that only has another number or other rights is read again.
    pub fn changed(&self, sums: &Sums) -> Option<(&Path, &'static str)> {
        let is_same = |path: &Path, before: &State, now: &State| {
            let alike = (before.length, before.modified) == (now.length, now.modified);
            let sum = sums.known(before).filter(|_| alike);
            sum.is_some_and(|sum| sums.of(path, now).is_ok_and(|own| own == sum))
        };
        let changed = self.0.iter().find(|(path, _, before)| {
            let now = State::of(path);
            let both = before.as_ref().zip(now.as_ref());
            now != *before && !both.is_some_and(|(before, now)| is_same(path, before, now))
        });
        changed.map(|(path, what, _)| (&**path, *what))
    }

    /// What they are, on one line: `input=SUM mask=SUM`, in hexadecimal digits, or `-` for what cannot be read (a frame beside it, which
    /// then is left out).
    pub fn line(&self, sums: &Sums) -> String {
        let one = |path: &Path, state: &Option<State>| sums.of(path, state.as_ref()?).ok();
        let words = self.0.iter().map(|(path, what, state)| {
            let sum = one(path, state).map(|sum| format!("{sum:016x}"));
            format!("{}={}", word(what), sum.as_deref().unwrap_or(UNREAD))
        });
        words.collect::<Vec<_>>().join(" ")
    }

    /// Why these are not the files of such a line; nothing if they are. Whatever their times are to the output's, they are read to their
    /// end: a link that was switched or a folder that was renamed leaves the times of its files.
    pub fn differs(&self, line: &str, sums: &Sums) -> Option<String> {
        let recorded: Vec<_> = line.split(' ').filter_map(|word| word.split_once('=')).collect();
        if !recorded.iter().map(|(what, _)| *what).eq(self.0.iter().map(|(_, what, _)| word(what))) {
            return Some("it was made from other files".into());
        }
        let other = self.0.iter().zip(&recorded).find(|((path, _, state), (_, recorded))| {
            let sum = state.as_ref().and_then(|state| sums.of(path, state).ok());
            sum.map_or(*recorded != UNREAD, |sum| u64::from_str_radix(recorded, 16) != Ok(sum))
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
