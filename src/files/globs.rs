//! Globs: the files whose names match `*`, `?`, `[...]` and, between separators, `**`, whatever bytes the names hold. As in a shell,
//! none of these stands for the full stop that a hidden name begins with. Folders that the path begins with and that exist under the
//! very name are those folders.

use std::fs::FileType;
use std::io::{self, ErrorKind};
use std::path::{Component, Path, PathBuf};

use glob::{MatchOptions, Pattern, PatternError};

use crate::files::names::to_text;

/// What makes a text a glob.
pub const SIGNS: [char; 3] = ['*', '?', '['];

/// Why the files that match are not known.
#[derive(Debug, thiserror::Error)]
pub enum Error {
    /// The text is no glob.
    #[error("not a glob: {0}")]
    Pattern(#[from] PatternError),
    /// A folder keeps to itself what it holds.
    #[error("cannot list {}: {source}", folder.display())]
    List {
        /// The folder.
        folder: PathBuf,
        /// What the system said.
        source: io::Error,
    },
}

/// The files that match, in no order. What is no folder has none; one that cannot be listed is an error, so that no frame is left
/// out unsaid.
pub fn files(glob: &Path) -> Result<Vec<PathBuf>, Error> {
    let folders = glob.ancestors().skip(1);
    let known = folders.filter(|folder| folder.is_dir()).map(Path::to_path_buf).next().unwrap_or_default();
    let rest = glob.strip_prefix(&known).unwrap_or(glob);
    let mut found = vec![known];
    for component in rest.components() {
        let text = to_text(component.as_os_str());
        found = if !matches!(component, Component::Normal(_)) || !text.contains(SIGNS) {
            let paths = found.iter().map(|folder| folder.join(component));
            let paths = paths.map(|path| Ok(kind(&path)?.map(|_| path)));
            paths.filter_map(Result::transpose).collect::<Result<_, Error>>()?
        } else if text == "**" {
            joined(found.into_iter().map(with_folders_below))?
        } else {
            let pattern = Pattern::new(&text)?;
            let options = MatchOptions { require_literal_leading_dot: true, ..MatchOptions::new() };
            // A sign that matches nothing must not let a full stop pass either.
            let spelt = text.starts_with('.');
            let matching = |path: &PathBuf| {
                let matches = |name| pattern.matches_with(&to_text(name), options);
                (spelt || !is_hidden(path)) && path.file_name().is_some_and(matches)
            };
            joined(found.iter().map(|folder| entries(folder)))?.into_iter().filter(matching).collect()
        };
    }
    found.retain(|path| !path.is_dir());
    Ok(found)
}

fn joined(lists: impl Iterator<Item = Result<Vec<PathBuf>, Error>>) -> Result<Vec<PathBuf>, Error> {
    Ok(lists.collect::<Result<Vec<_>, _>>()?.concat())
}

/// What a path is, itself and not what a link leads to; `None` if nothing is there.
fn kind(path: &Path) -> Result<Option<FileType>, Error> {
    absent_or(path.symlink_metadata().map(|found| found.file_type()), path)
}

/// Nothing where the system says that there is nothing.
fn absent_or<T>(result: io::Result<T>, path: &Path) -> Result<Option<T>, Error> {
    match result {
        Ok(found) => Ok(Some(found)),
        Err(error) if matches!(error.kind(), ErrorKind::NotFound | ErrorKind::NotADirectory) => Ok(None),
        Err(source) => Err(Error::List { folder: path.into(), source }),
    }
}

fn entries(folder: &Path) -> Result<Vec<PathBuf>, Error> {
    let listed = if folder.as_os_str().is_empty() { Path::new(".") } else { folder };
    let names = || std::fs::read_dir(listed)?.map(|entry| Ok(folder.join(entry?.file_name()))).collect();
    Ok(absent_or(names(), listed)?.unwrap_or_default())
}

fn is_hidden(path: &Path) -> bool {
    path.file_name().is_some_and(|name| name.as_encoded_bytes().starts_with(b"."))
}

/// A folder and all below it but hidden ones; links, which may lead in circles, are not followed.
fn with_folders_below(folder: PathBuf) -> Result<Vec<PathBuf>, Error> {
    let mut found = vec![folder];
    let mut next = 0;
    while let Some(folder) = found.get(next) {
        for path in entries(folder)? {
            if !is_hidden(&path) && kind(&path)?.is_some_and(|kind| kind.is_dir()) {
                found.push(path);
            }
        }
        next += 1;
    }
    Ok(found)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn names(folder: &Path, glob: &str) -> Vec<String> {
        let found = files(&folder.join(glob)).unwrap();
        let name = |path: PathBuf| path.strip_prefix(folder).unwrap().to_str().unwrap().to_owned();
        let mut names: Vec<_> = found.into_iter().map(name).collect();
        names.sort();
        names
    }

    #[test]
    fn signs_match_names_folder_by_folder() {
        let folder = tempfile::tempdir().unwrap();
        for name in ["a", "a/b", "a/c.exr", "d[1]", "d1"] {
            std::fs::create_dir_all(folder.path().join(name)).unwrap();
        }
        for name in
            ["x.exr", "a/1.exr", "a/2.exr", "a/2.png", "a/b/3.exr", "a/é.exr", "d[1]/4.exr", "d1/5.exr"]
        {
            std::fs::write(folder.path().join(name), "").unwrap();
        }
        let names = |glob: &str| names(folder.path(), glob);
        // A folder is no file, whatever its name.
        assert_eq!(names("a/*.exr"), ["a/1.exr", "a/2.exr", "a/é.exr"]);
        assert_eq!(names("?/[!1].exr"), ["a/2.exr", "a/é.exr"]);
        assert_eq!(names("*/b/?.exr"), ["a/b/3.exr"]);
        assert_eq!(names("**/[23].*"), ["a/2.exr", "a/2.png", "a/b/3.exr"]);
        assert_eq!(names("**/x.exr"), ["x.exr"]);
        assert_eq!(names("d[1]/*.exr"), ["d[1]/4.exr"]);
        assert_eq!(names("d[12]/*.exr"), ["d1/5.exr"]);
        assert!(names("no/*.exr").is_empty() && names("x.exr/*").is_empty() && names("**").is_empty());
        // As in a shell, only a full stop matches that of a hidden name.
        std::fs::create_dir(folder.path().join(".old")).unwrap();
        for name in [".old/x.exr", ".old/.y.exr", "d1/._5.exr", "d1/.exr"] {
            std::fs::write(folder.path().join(name), "").unwrap();
        }
        assert_eq!(names("d1/*.exr"), ["d1/5.exr"]);
        assert_eq!(names("d1/[._]*"), [""; 0]);
        assert_eq!(names("d1/?_5.exr"), [""; 0]);
        assert_eq!(names("d1/*._5.exr"), [""; 0]);
        assert_eq!(names("d1/.*"), ["d1/._5.exr", "d1/.exr"]);
        assert_eq!(names("**/x.exr"), ["x.exr"]);
        assert_eq!(names("*/x.exr"), [""; 0]);
        assert_eq!(names(".old/*"), [".old/x.exr"]);
        assert_eq!(names(".*/.*"), [".old/.y.exr"]);
        assert!(files(Path::new("a**/x")).is_err() && files(Path::new("[a/x")).is_err());
    }
}
