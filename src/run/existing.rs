//! Outputs that exist: whether they stay, and why they are not what would be made now.

use std::path::Path;
use std::time::SystemTime;

use lacuna_exr::{Over, PartHeader, read_whole_header};

use crate::files::content::{Seen, Sums};
use crate::reconstruct::SOURCES;

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

/// Why an output is made again though nothing else has changed: a time limit ended it.
pub const CUT_SHORT: &str = "it was cut short";

/// Why an output is not what this run would make of these files, if it is not: it is not whole, `differs` finds another reason in its
/// headers, or it says that it was made from others. Of one that does not say what it was made from, all must be older.
pub fn stale<'a>(
    output: &Path,
    sources: impl IntoIterator<Item = (&'a Path, &'static str)>,
    sums: &Sums,
    differs: impl FnOnce(&[PartHeader]) -> Option<String>,
) -> Option<String> {
    let Some(made) = modified(output) else { return Some("its time cannot be read".into()) };
    let parts = match read_whole_header(output) {
        Ok(parts) => parts,
        Err(error) => return Some(format!("it is not whole: {error}")),
    };
    differs(&parts).or_else(|| {
        let seen = Seen::new(sources);
        // Parts that were copied may have the line of another run.
        let mut lines: Vec<String> = parts.iter().filter_map(|part| part.attributes.text(SOURCES)).collect();
        lines.dedup();
        let why: Option<Vec<String>> = lines.iter().map(|line| seen.differs(line, sums)).collect();
        if lines.is_empty() { seen.newer(made) } else { why?.into_iter().next() }
    })
}

fn modified(path: &Path) -> Option<SystemTime> {
    path.metadata().ok()?.modified().ok()
}
