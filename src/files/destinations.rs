//! Where the outputs go: one file, a pattern, or a folder that keeps the inputs' names.

use std::path::{Path, PathBuf};

use crate::files::error::PlanError;
use crate::files::inputs::Input;
use crate::files::names::to_text;
use crate::files::patterns::{Pattern, existing_folders};

/// A place for outputs.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Destination {
    /// One file.
    File(PathBuf),
    /// A file a frame number.
    Pattern(Pattern),
    /// A folder; each file keeps the name of its input.
    Folder(PathBuf),
}

impl Destination {
    /// Reads a destination: a folder if it exists as one or ends in a separator.
    pub fn parse(path: &Path) -> Result<Self, PlanError> {
        if path.is_dir() {
            return Ok(Self::Folder(path.into()));
        }
        let (text, shown) = (to_text(path.as_os_str()), path.display());
        if text.ends_with(std::path::is_separator) {
            return Ok(Self::Folder(path.into()));
        }
        if text[existing_folders(&text)..].contains(['*', '?']) {
            return Err(PlanError::Usage(format!(
                "{shown}: an output cannot be a glob; use a pattern or a folder"
            )));
        }
        let pattern = Pattern::of(path).map_err(|error| PlanError::Usage(format!("{shown}: {error}")))?;
        Ok(pattern.map_or_else(|| Self::File(path.into()), Self::Pattern))
    }

    /// Whether this place holds more than one file.
    pub const fn holds_many(&self) -> bool {
        !matches!(self, Self::File(_))
    }

    /// Whether the names of outputs are made from frame numbers.
    pub const fn is_numbered(&self) -> bool {
        matches!(self, Self::Pattern(_))
    }

    /// The output of an input.
    pub fn of(&self, input: &Input) -> Result<PathBuf, PlanError> {
        match self {
            Self::File(path) => Ok(path.clone()),
            Self::Pattern(pattern) => input.number.map(|number| pattern.spelt_as(number, &input.path)).ok_or_else(|| {
                PlanError::Usage(format!(
                    "{}: no frame number in the name for the output pattern; name a folder or a file as the output",
                    input.path.display()
                ))
            }),
            Self::Folder(folder) => match input.path.file_name() {
                Some(name) => Ok(folder.join(name)),
                None => Err(PlanError::Usage(format!("{}: not a file name", input.path.display()))),
            },
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn output(destination: &str, input: &str, number: Option<i64>) -> Result<PathBuf, PlanError> {
        Destination::parse(Path::new(destination))?.of(&Input { path: input.into(), number })
    }

    #[test]
    fn files_patterns_and_folders() {
        assert_eq!(output("out.exr", "a/in.0007.exr", Some(7)), Ok("out.exr".into()));
        assert_eq!(output("o.%03d.exr", "a/in.0007.exr", Some(-7)), Ok("o.-07.exr".into()));
        assert_eq!(output("o.####.exr", "a/in.-0001.exr", Some(-1)), Ok("o.-0001.exr".into()));
        assert_eq!(output("o.####.exr", "a/in.-001.exr", Some(-1)), Ok("o.-001.exr".into()));
        assert_eq!(output("o.###.exr", "a/in.-0012.exr", Some(-12)), Ok("o.-012.exr".into()));
        assert_eq!(output("new/", "a/in 7.exr", Some(7)), Ok("new/in 7.exr".into()));
        assert_eq!(output(".", "a/in 7.exr", None), Ok("./in 7.exr".into()));
        assert_eq!(output("100%.exr", "in.exr", None), Ok("100%.exr".into()));
    }

    #[cfg(unix)]
    #[test]
    fn names_need_not_be_utf8() {
        use std::ffi::OsStr;
        use std::os::unix::ffi::OsStrExt;
        let path = |name: &[u8]| PathBuf::from(OsStr::from_bytes(name));
        let input = Input { path: path(b"in/b\xff.exr"), number: Some(3) };
        let output = |name: &[u8]| Destination::parse(&path(name)).unwrap().of(&input).unwrap();
        assert_eq!(output(b"o\xfe.####.exr"), path(b"o\xfe.0003.exr"));
        assert_eq!(output(b"o\xfe/"), path(b"o\xfe/b\xff.exr"));
        assert_eq!(output(b"o\xfe.exr"), path(b"o\xfe.exr"));
    }

    #[test]
    fn what_cannot_be_is_a_usage_error() {
        for (destination, input) in [("o.####.exr", "in.exr"), ("o*.exr", "in.exr"), ("o.%4d.exr", "in.exr")]
        {
            assert!(matches!(output(destination, input, None), Err(PlanError::Usage(_))), "{destination}");
        }
    }
}
