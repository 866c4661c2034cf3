//! Outputs that exist: whether they stay, and whether they are newer than what they are made from.

use std::path::Path;
use std::time::SystemTime;

use lacuna_exr::{Over, PartHeader, read_whole_header};

/// What happens to outputs that exist.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Existing {
    /// They are replaced, but not where they are read-only.
    Replace,
    /// They are replaced.
    Force,
    /// They stay.
    Keep,
    /// They stay if they are what this run would make.
    Update,
}

impl Existing {
    /// What writing one does with what is there.
    pub fn over(self) -> Over {
        match self {
            Self::Replace | Self::Update => Over::Replace,
            Self::Force => Over::Force,
            Self::Keep => Over::Keep,
        }
    }
}

/// Whether the output is newer than these files and whole, and its headers are what this run would write.
pub fn is_made_from<'a>(
    output: &Path,
    sources: impl IntoIterator<Item = &'a Path>,
    is_of: impl FnOnce(&[PartHeader]) -> bool,
) -> bool {
    let Some(made) = modified(output) else { return false };
    let newer = |source: &Path| modified(source).is_some_and(|changed| made > changed);
    sources.into_iter().all(newer) && read_whole_header(output).is_ok_and(|parts| is_of(&parts))
}

fn modified(path: &Path) -> Option<SystemTime> {
    path.metadata().ok()?.modified().ok()
}
