//! Reading the frames beside one: each by itself, so that no chunk and no order changes what is found; those that were read last are kept.

use std::path::{Path, PathBuf};
use std::sync::{Arc, Mutex, PoisonError};

use lacuna_exr::{Frame, Limits};

use crate::files::neighbours::NeighbourFile;
use crate::mask::shared::MaskFiles;
use crate::mask::{self, Masks, Source};

/// A frame beside the one that is filled.
#[derive(Clone, Debug)]
pub struct Neighbour {
    /// Its number.
    pub number: i64,
    /// Its number less that of the frame that is filled.
    pub offset: i64,
    /// What it holds.
    pub frame: Arc<Frame>,
    /// What was measured.
    pub masks: Arc<Masks>,
}

/// The frames beside one, and what is to be said of those that cannot be used.
#[derive(Clone, Debug, Default)]
pub struct Neighbours {
    /// In the order of their numbers.
    pub all: Vec<Neighbour>,
    /// The numbers of all files, those that cannot be used as well.
    pub looked_at: Vec<i64>,
    /// One line for each that was left out.
    pub notes: Vec<String>,
}

impl Neighbours {
    /// The frames on one line, as the attribute has them: `3, 4 camera, 6 camera`.
    pub fn line(&self, used: &[(i64, String)]) -> String {
        let one = |number: &i64| match used.iter().find(|used| used.0 == *number) {
            Some((_, how)) => format!("{number} {how}"),
            None => number.to_string(),
        };
        self.looked_at.iter().map(one).collect::<Vec<_>>().join(", ")
    }
}

/// The numbers in such a line.
pub fn numbers(line: &str) -> Vec<i64> {
    line.split(", ").filter_map(|one| one.split(' ').next()?.parse().ok()).collect()
}

type Read = Result<(Arc<Frame>, Arc<Masks>), String>;

/// Frames that were read, the last ones of a run.
#[derive(Debug, Default)]
pub struct NeighbourFiles {
    kept: Mutex<Vec<(PathBuf, Read)>>,
}

impl NeighbourFiles {
    /// The frames beside frame `number`, of which `most` are kept for the next one.
    pub fn read(
        &self,
        (number, files): (i64, &[NeighbourFile]),
        (source, masks): (&Source, &MaskFiles),
        most: usize,
        limits: Limits,
    ) -> Neighbours {
        let looked_at = files.iter().map(|file| file.number).collect();
        let mut found = Neighbours { looked_at, ..Neighbours::default() };
        for file in files {
            match self.get(file, (source, masks), most, limits) {
                Ok((frame, masks)) => found.all.push(Neighbour {
                    number: file.number,
                    offset: file.number - number,
                    frame,
                    masks,
                }),
                Err(why) => {
                    found.notes.push(format!("filled without its neighbour {}: {why}", file.input.display()));
                }
            }
        }
        found
    }

    fn get(
        &self,
        file: &NeighbourFile,
        (source, masks): (&Source, &MaskFiles),
        most: usize,
        limits: Limits,
    ) -> Read {
        if let Some(read) = self.kept(&file.input) {
            return read;
        }
        let read = read(file, (source, masks), limits);
        let mut kept = self.kept.lock().unwrap_or_else(PoisonError::into_inner);
        while kept.len() >= most.max(1) {
            drop(kept.remove(0));
        }
        kept.push((file.input.clone(), read.clone()));
        read
    }

    /// One that was read before, which becomes the newest.
    fn kept(&self, path: &Path) -> Option<Read> {
        let mut kept = self.kept.lock().unwrap_or_else(PoisonError::into_inner);
        let at = kept.iter().position(|(own, _)| own == path)?;
        let entry = kept.remove(at);
        let read = entry.1.clone();
        kept.push(entry);
        Some(read)
    }
}

fn read(file: &NeighbourFile, (source, masks): (&Source, &MaskFiles), limits: Limits) -> Read {
    let frame = lacuna_exr::read(&file.input, &limits).map_err(|error| error.to_string())?;
    let mask = file.mask.as_deref().map(|path| masks.get(path, limits)).transpose();
    let mask = mask.map_err(|error| error.to_string())?;
    let found = mask::find(&frame, source, mask.as_deref()).map_err(|error| error.to_string())?;
    if found.is_empty() {
        return Err("no pixel of it was measured".into());
    }
    if crate::reconstruct::filled_before(&frame, &found).is_some() {
        return Err("it was filled already".into());
    }
    Ok((Arc::new(frame), Arc::new(found)))
}
