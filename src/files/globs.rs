//! Globs: the files whose names match `*`, `?`, `[...]` and, between separators, `**`, whatever bytes the names hold. Folders that
//! the path begins with and that exist under the very name are those folders.

use std::path::{Component, Path, PathBuf};

use glob::{Pattern, PatternError};

use crate::files::names::to_text;

/// What makes a text a glob.
pub const SIGNS: [char; 3] = ['*', '?', '['];

/// The files that match, in no order. Folders that cannot be listed have none.
pub fn files(glob: &Path) -> Result<Vec<PathBuf>, PatternError> {
    let folders = glob.ancestors().skip(1);
    let known = folders.filter(|folder| folder.is_dir()).map(Path::to_path_buf).next().unwrap_or_default();
    let rest = glob.strip_prefix(&known).unwrap_or(glob);
    let mut found = vec![known];
    for component in rest.components() {
        let text = to_text(component.as_os_str());
        found = if !matches!(component, Component::Normal(_)) || !text.contains(SIGNS) {
            let joined = found.iter().map(|folder| folder.join(component));
            joined.filter(|path| path.symlink_metadata().is_ok()).collect()
        } else if text == "**" {
            found.into_iter().flat_map(with_folders_below).collect()
        } else {
            let pattern = Pattern::new(&text)?;
            let matching =
                |path: &PathBuf| path.file_name().is_some_and(|name| pattern.matches(&to_text(name)));
            found.iter().flat_map(|folder| entries(folder)).filter(matching).collect()
        };
    }
    found.retain(|path| !path.is_dir());
    Ok(found)
}

fn entries(folder: &Path) -> Vec<PathBuf> {
    let listed = if folder.as_os_str().is_empty() { Path::new(".") } else { folder };
    let names = std::fs::read_dir(listed).into_iter().flatten().flatten().map(|entry| entry.file_name());
    names.map(|name| folder.join(name)).collect()
}

/// A folder and all below it; links, which may lead in circles, are not followed.
fn with_folders_below(folder: PathBuf) -> Vec<PathBuf> {
    let mut found = vec![folder];
    let mut next = 0;
    while let Some(folder) = found.get(next) {
        let is_folder = |path: &PathBuf| path.symlink_metadata().is_ok_and(|found| found.is_dir());
        let below: Vec<_> = entries(folder).into_iter().filter(is_folder).collect();
        found.extend(below);
        next += 1;
    }
    found
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
        assert!(files(Path::new("a**/x")).is_err() && files(Path::new("[a/x")).is_err());
    }
}
