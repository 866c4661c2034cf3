//! Files by what they are, whatever their names: nothing that a run reads is written.

use std::collections::HashMap;
use std::io::ErrorKind;
use std::path::{Path, PathBuf};

use crate::files::error::PlanError;
use crate::files::names::folder_of;

/// The files that a run reads, each with what it is to the run.
pub struct Sources<'a> {
    known: HashMap<Key, (&'a Path, &'static str)>,
    places: Places,
}

/// A file that is there, or the place of one that is not, as a renderer may write it later.
#[derive(PartialEq, Eq, Hash)]
enum Key {
    File(Identity),
    Place(PathBuf),
}

impl<'a> Sources<'a> {
    /// These files, whether they exist or not; one with several names goes by the first.
    pub fn new(files: impl IntoIterator<Item = (&'a Path, &'static str)>) -> Self {
        let mut sources = Self { known: HashMap::new(), places: Places::default() };
        for (path, what) in files {
            let key = sources.key(path);
            sources.known.entry(key).or_insert((path, what));
        }
        sources
    }

    fn key(&mut self, path: &Path) -> Key {
        Identity::of(path).map_or_else(|| Key::Place(self.places.of(path)), Key::File)
    }

    /// Refuses to write one of them.
    pub fn check(&mut self, written: &Path) -> Result<(), PlanError> {
        let key = self.key(written);
        let Some((source, what)) = self.known.get(&key) else { return Ok(()) };
        let same = if *source == written { String::new() } else { format!(" ({})", source.display()) };
        Err(PlanError::Usage(format!(
            "{}: the output is the same file as the {what}{same}; nothing is overwritten in place, name another output",
            written.display()
        )))
    }
}

/// Folders with their links resolved, each looked up once.
#[derive(Default)]
pub struct Places(HashMap<PathBuf, PathBuf>);

impl Places {
    /// Where a file lies or will lie, links resolved: its folder's, and its own, which writing follows.
    pub fn of(&mut self, file: &Path) -> PathBuf {
        let target = file.is_symlink().then(|| lacuna_exr::behind(file));
        let file = target.as_deref().unwrap_or(file);
        let resolve = |folder: &PathBuf| {
            folder.canonicalize().or_else(|_| std::path::absolute(folder)).unwrap_or_else(|_| folder.clone())
        };
        let folder = self.0.entry(folder_of(file)).or_insert_with_key(resolve);
        file.file_name().map_or_else(|| folder.clone(), |name| folder.join(name))
    }
}

/// What is told of a link whose target is not there: it may lie on a disk that is only away, so nothing is known of it.
pub fn leads_nowhere(path: &Path) -> Option<String> {
    let absent = path.metadata().is_err_and(|error| error.kind() == ErrorKind::NotFound);
    let target = (absent && path.is_symlink()).then(|| lacuna_exr::behind(path))?;
    Some(format!("it is a link to {}, which does not exist", target.display()))
}

/// What tells an existing file from every other, whatever its names.
#[derive(Clone, Debug, PartialEq, Eq, Hash)]
pub struct Identity {
    #[cfg(unix)]
    device_and_inode: (u64, u64),
    #[cfg(not(unix))]
    path: PathBuf,
}

impl Identity {
    /// That of a file that exists.
    #[cfg(unix)]
    pub fn of(path: &Path) -> Option<Self> {
        use std::os::unix::fs::MetadataExt;
        let metadata = path.metadata().ok()?;
        Some(Self { device_and_inode: (metadata.dev(), metadata.ino()) })
    }

    /// That of a file that exists.
    #[cfg(not(unix))]
    pub fn of(path: &Path) -> Option<Self> {
        path.canonicalize().ok().map(|path| Self { path })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[cfg(unix)]
    #[test]
    fn links_have_the_place_that_is_written() {
        let folder = tempfile::tempdir().unwrap();
        let path = |name: &str| folder.path().join(name);
        std::fs::write(path("a"), "").unwrap();
        for (target, link) in [("a", "to-a"), ("to-a", "far"), ("new", "to-new")] {
            std::os::unix::fs::symlink(target, path(link)).unwrap();
        }
        let mut places = Places::default();
        for (one, other) in [("to-a", "a"), ("far", "a"), ("to-new", "new")] {
            assert_eq!(places.of(&path(one)), places.of(&path(other)), "{one}");
        }
        assert_ne!(places.of(&path("a")), places.of(&path("new")));
    }

    #[test]
    fn a_file_is_known_by_all_its_names() {
        let folder = tempfile::tempdir().unwrap();
        let path = |name: &str| folder.path().join(name);
        std::fs::write(path("a"), "").unwrap();
        std::fs::write(path("b"), "").unwrap();
        std::fs::hard_link(path("a"), path("hard")).unwrap();
        let (a, b, absent) = (path("a"), path("b"), path("absent"));
        let mut sources = Sources::new([(&*a, "frame"), (&*absent, "mask")]);
        for name in ["a", "./a", "hard"] {
            let PlanError::Usage(text) = sources.check(&path(name)).unwrap_err() else { panic!("{name}") };
            assert!(text.contains("the same file as the frame"), "{text}");
        }
        assert!(sources.check(&b).is_ok() && sources.check(&path("other")).is_ok());
        // It may come to be there.
        assert!(sources.check(&path("./absent")).unwrap_err().to_string().contains("the mask"));
    }
}
