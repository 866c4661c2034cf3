//! From what the user names (files, patterns, globs, lists) to the frames to be done, in the order asked.

use std::collections::{BTreeSet, HashMap, HashSet};
use std::path::{Path, PathBuf};

use crate::files::error::PlanError;
use crate::files::globs;
use crate::files::identity::Places;
use crate::files::names::to_text;
use crate::files::patterns::{Pattern, number_in_name};
use crate::files::ranges::Frames;

/// What the user selected.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Selection {
    /// Files, patterns and globs, in order.
    pub inputs: Vec<PathBuf>,
    /// A file that lists further files, one path a line; `-` is standard input.
    pub files_from: Option<PathBuf>,
    /// The frames to take from patterns and globs; all that exist if `None`.
    pub frames: Option<Frames>,
}

/// One frame that was asked for; its file need not exist.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Input {
    /// The file.
    pub path: PathBuf,
    /// The frame number, from the pattern or from the file's name.
    pub number: Option<i64>,
}

/// The frames asked for, and whether they were asked for as a set (pattern, glob, list or several inputs).
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Inputs {
    /// In the order asked for.
    pub frames: Vec<Input>,
    /// Whether a single output file would be a slip.
    pub is_set: bool,
}

/// Resolves a selection. Looks into folders, opens no frame.
pub fn resolve(selection: &Selection) -> Result<Inputs, PlanError> {
    let mut frames = Vec::new();
    let mut is_set = selection.inputs.len() > 1 || selection.files_from.is_some();
    let mut takes_frames = false;
    for input in &selection.inputs {
        let kind = Kind::of(input)?;
        if !matches!(kind, Kind::File) {
            is_set = true;
            takes_frames = true;
        }
        frames.extend(kind.frames(input, selection.frames.as_ref())?);
    }
    if let Some(list) = &selection.files_from {
        frames.extend(listed(list)?.into_iter().map(plain));
    }
    if selection.frames.is_some() && !takes_frames {
        return Err(PlanError::Usage(
            "--frames needs an INPUT with a place for the frame number, such as shot.####.exr, or a glob"
                .into(),
        ));
    }
    let mut seen = HashSet::new();
    frames.retain(|input: &Input| seen.insert((input.path.clone(), input.number)));
    Ok(Inputs { frames, is_set })
}

/// The numbers of the frames of a pattern or glob, in the order asked for, each once; none of a plain file.
///
/// # Errors
/// If they cannot be found, or a file has no number.
pub fn frame_numbers(selection: &Selection) -> Result<Vec<i64>, PlanError> {
    let inputs = resolve(selection)?;
    if !inputs.is_set {
        return Ok(Vec::new());
    }
    let mut seen = HashSet::new();
    let mut numbers = Vec::new();
    for input in &inputs.frames {
        let number = input.number.ok_or_else(|| {
            PlanError::Usage(format!(
                "{}: no frame number in the name, and chunks are cut by frame numbers; name a pattern or a glob that leaves it out",
                input.path.display()
            ))
        })?;
        // A task takes all files of a number.
        if seen.insert(number) {
            numbers.push(number);
        }
    }
    Ok(numbers)
}

/// Of these places, links resolved, one where a frame of an INPUT lies or is to lie, asked for or not, behind that INPUT.
pub fn frame_among<'a, T>(
    selection: &'a Selection,
    wanted: &'a HashMap<PathBuf, T>,
) -> Option<(&'a Path, &'a PathBuf)> {
    let mut places = Places::default();
    let mut of = |input: &Path| {
        let kind = Kind::of(input).ok().filter(|_| !wanted.is_empty())?;
        // What cannot be listed has no frames but those of its name.
        let found = kind.frames(input, None).unwrap_or_default();
        let found = found.iter().find_map(|frame| wanted.get_key_value(&places.of(&frame.path)));
        let Kind::Pattern(_) = kind else { return Some(found?.0) };
        let known = input.ancestors().skip(1).find(|folder| folder.is_dir()).unwrap_or(Path::new(""));
        let folder = if known.as_os_str().is_empty() { Path::new(".") } else { known };
        let whole = folder.canonicalize().ok()?.join(input.strip_prefix(known).ok()?);
        let pattern = Pattern::of(&whole).ok()??;
        let named = || wanted.keys().find(|place| pattern.number_of(place).is_some());
        found.map(|(place, _)| place).or_else(named)
    };
    selection.inputs.iter().find_map(|input| Some((&**input, of(input)?)))
}

/// How an INPUT is spelt. A file or folder that exists under the very name is that one, whatever signs it contains.
enum Kind {
    File,
    Pattern(Pattern),
    Glob,
}

impl Kind {
    fn of(input: &Path) -> Result<Self, PlanError> {
        if input == Path::new("-") {
            return Err(PlanError::Usage(
                "-: a frame is not read from standard input, as it is read at many places; name its file \
                 (--files-from - reads a list of files)"
                    .into(),
            ));
        }
        if input.is_dir() {
            return Err(PlanError::Usage(format!(
                "{0} is a folder; name its frames, for example '{1}'",
                input.display(),
                input.join("*.exr").display()
            )));
        }
        if input.symlink_metadata().is_ok() {
            return Ok(Self::File);
        }
        let pattern =
            Pattern::of(input).map_err(|error| PlanError::Usage(format!("{}: {error}", input.display())))?;
        Ok(match pattern {
            Some(pattern) => Self::Pattern(pattern),
            None if to_text(input.as_os_str()).contains(globs::SIGNS) => Self::Glob,
            None => Self::File,
        })
    }

    fn frames(&self, input: &Path, asked: Option<&Frames>) -> Result<Vec<Input>, PlanError> {
        let found = match (self, asked) {
            (Self::File, _) => return Ok(vec![plain(input.into())]),
            (Self::Pattern(pattern), Some(asked)) => {
                return asked.numbers().iter().map(|&number| frame(pattern, number)).collect();
            }
            (Self::Pattern(pattern), None) => on_disk(pattern, input)?,
            (Self::Glob, asked) => {
                let found = matches(input)?;
                match asked {
                    Some(asked) => chosen(&found, asked, input),
                    None => found,
                }
            }
        };
        if found.is_empty() {
            return Err(PlanError::Failed(format!("{}: no file matches", input.display())));
        }
        Ok(found)
    }
}

fn plain(path: PathBuf) -> Input {
    Input { number: number_in_name(&path), path }
}

/// The frames of a pattern that exist, by number.
fn on_disk(pattern: &Pattern, input: &Path) -> Result<Vec<Input>, PlanError> {
    let Some(folder) = pattern.folder() else {
        return Err(PlanError::Usage(format!(
            "{}: the frame number is in the name of a folder, as none exists under that very name; --frames is needed",
            input.display()
        )));
    };
    let listed = if folder.as_os_str().is_empty() { Path::new(".") } else { &folder };
    let failed = |error: std::io::Error| {
        PlanError::Failed(format!("{}: cannot list {}: {error}", input.display(), listed.display()))
    };
    let mut found = BTreeSet::new();
    for entry in std::fs::read_dir(listed).map_err(failed)? {
        found.extend(pattern.number_of(&folder.join(entry.map_err(failed)?.file_name())));
    }
    found.into_iter().map(|number| frame(pattern, number)).collect()
}

/// The frame of that number, which may be spelt in one way only.
fn frame(pattern: &Pattern, number: i64) -> Result<Input, PlanError> {
    let (path, file) = (pattern.path(number), pattern.file(number));
    match pattern.alternative(number).filter(|other| *other != path && other.exists()) {
        Some(other) if file == path => Err(PlanError::Usage(format!(
            "{} and {} are both frame {number}; move one of them away",
            path.display(),
            other.display()
        ))),
        _ => Ok(Input { path: file, number: Some(number) }),
    }
}

/// The files that a glob matches, by frame number, then by name.
fn matches(glob: &Path) -> Result<Vec<Input>, PlanError> {
    let paths = globs::files(glob).map_err(|error| {
        let text = format!("{}: {error}", glob.display());
        if matches!(error, globs::Error::Pattern(_)) {
            PlanError::Usage(text)
        } else {
            PlanError::Failed(text)
        }
    })?;
    let mut found: Vec<Input> = paths.into_iter().map(plain).collect();
    found.sort_by(|a, b| (a.number, &a.path).cmp(&(b.number, &b.path)));
    Ok(found)
}

/// Of the files of a glob those with the numbers asked for, in that order; a number that several files have stands
/// for all of them, one that none has for a file that does not exist.
fn chosen(found: &[Input], asked: &Frames, input: &Path) -> Vec<Input> {
    let mut files: HashMap<i64, Vec<&Input>> = HashMap::new();
    for file in found {
        if let Some(number) = file.number {
            files.entry(number).or_default().push(file);
        }
    }
    let mut chosen = Vec::new();
    for &number in asked.numbers() {
        match files.get(&number) {
            Some(files) => chosen.extend(files.iter().copied().cloned()),
            None => chosen.push(Input { path: input.into(), number: Some(number) }),
        }
    }
    chosen
}

/// The most bytes that a list may have.
const MOST_LISTED: u64 = 64 << 20;

/// The paths in a list, one a line, taken as they are; empty lines do not count. A list with zero bytes (`find -print0`) ends each
/// path by one.
fn listed(list: &Path) -> Result<Vec<PathBuf>, PlanError> {
    let failed = |error: std::io::Error| {
        PlanError::Failed(format!("{}: cannot read the list: {error}", list.display()))
    };
    let bytes = if list == Path::new("-") {
        lacuna_exr::read_most(std::io::stdin().lock(), MOST_LISTED)
    } else {
        lacuna_exr::read_small(list, MOST_LISTED)
    };
    let bytes = bytes.map_err(failed)?;
    // Some editors begin a text with the mark of its encoding.
    let bytes = bytes.strip_prefix(b"\xef\xbb\xbf").unwrap_or(&bytes);
    let by_zeros = bytes.contains(&0);
    let mut paths = Vec::new();
    for line in bytes.split(|&byte| byte == if by_zeros { 0 } else { b'\n' }) {
        let line = if by_zeros { line } else { line.strip_suffix(b"\r").unwrap_or(line) };
        if !line.is_empty() {
            paths.push(path_from(line.to_vec()).ok_or_else(|| {
                PlanError::Failed(format!("{}: line {} is not UTF-8", list.display(), paths.len() + 1))
            })?);
        }
    }
    if paths.is_empty() {
        return Err(PlanError::Failed(format!("{}: the list is empty", list.display())));
    }
    Ok(paths)
}

/// The path of those bytes; anywhere but on Unix they must be UTF-8.
fn path_from(bytes: Vec<u8>) -> Option<PathBuf> {
    #[cfg(unix)]
    let name = Some(<std::ffi::OsString as std::os::unix::ffi::OsStringExt>::from_vec(bytes));
    #[cfg(not(unix))]
    let name = String::from_utf8(bytes).ok();
    name.map(PathBuf::from)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn folder(names: &[&str]) -> tempfile::TempDir {
        let folder = tempfile::tempdir().unwrap();
        for name in names {
            std::fs::write(folder.path().join(name), "").unwrap();
        }
        folder
    }

    fn resolved(
        folder: &Path,
        inputs: &[&str],
        frames: Option<&str>,
    ) -> Result<Vec<(Option<i64>, String)>, PlanError> {
        let selection = Selection {
            inputs: inputs.iter().map(|input| folder.join(input)).collect(),
            frames: frames.map(|text| text.parse().unwrap()),
            ..Selection::default()
        };
        let name =
            |input: Input| (input.number, input.path.file_name().unwrap().to_str().unwrap().to_owned());
        Ok(resolve(&selection)?.frames.into_iter().map(name).collect())
    }

    #[test]
    fn a_pattern_takes_what_exists_by_number() {
        let folder =
            folder(&["s.0010.exr", "s.0002.exr", "s.-001.exr", "s.12345.exr", "s.2.exr", "s.0002.png"]);
        let found = resolved(folder.path(), &["s.####.exr"], None).unwrap();
        let numbers: Vec<_> = found.iter().map(|(number, _)| number.unwrap()).collect();
        assert_eq!(numbers, [-1, 2, 10, 12345]);
        let unpadded = resolved(folder.path(), &["s.%d.exr"], None).unwrap();
        assert!(unpadded.contains(&(Some(2), "s.2.exr".into())));
        assert!(!unpadded.contains(&(Some(2), "s.0002.exr".into())));
    }

    #[test]
    fn a_number_has_one_spelling() {
        let folder = folder(&["s.-001.exr", "s.-0001.exr", "s.-0002.exr"]);
        for frames in [None, Some("-1")] {
            let text = resolved(folder.path(), &["s.####.exr"], frames).unwrap_err().to_string();
            assert!(
                text.contains("s.-001.exr and ") && text.contains("s.-0001.exr are both frame -1"),
                "{text}"
            );
        }
        assert_eq!(resolved(folder.path(), &["s.####.exr"], Some("-2")).unwrap().len(), 1);
    }

    #[test]
    fn frames_are_taken_in_the_order_asked_whether_they_exist_or_not() {
        let folder = folder(&["s.0001.exr", "s.-0002.exr"]);
        let found = resolved(folder.path(), &["s.####.exr"], Some("3-1x2,-2")).unwrap();
        let expected = [(3, "s.0003.exr"), (1, "s.0001.exr"), (-2, "s.-0002.exr")];
        assert_eq!(found, expected.map(|(number, name)| (Some(number), name.to_owned())));
    }

    #[test]
    fn a_glob_takes_numbers_from_names() {
        let folder = folder(&["a 10.exr", "a 9.exr", "ä 3.exr", "b.png"]);
        let found = resolved(folder.path(), &["*.exr"], None).unwrap();
        let names: Vec<_> = found.iter().map(|(_, name)| name.as_str()).collect();
        assert_eq!(names, ["ä 3.exr", "a 9.exr", "a 10.exr"]);
        assert_eq!(resolved(folder.path(), &["a*.exr"], Some("10")).unwrap().len(), 1);
        assert_eq!(resolved(folder.path(), &["a*.exr"], Some("11")).unwrap()[0], (Some(11), "a*.exr".into()));
        assert!(matches!(resolved(folder.path(), &["c*.exr"], None), Err(PlanError::Failed(_))));
    }

    #[cfg(unix)]
    #[test]
    fn names_need_not_be_utf8() {
        use std::ffi::OsStr;
        use std::os::unix::ffi::OsStrExt;
        let folder = tempfile::tempdir().unwrap();
        let path = |name: &[u8]| folder.path().join(OsStr::from_bytes(name));
        for name in [&b"b\xff.0002.exr"[..], b"b\xff.0001.exr", b"b\xfe.0007.exr"] {
            std::fs::write(path(name), "").unwrap();
        }
        let found = |name: &[u8], frames: Option<&str>| {
            let frames = frames.map(|text| text.parse().unwrap());
            let selection = Selection { inputs: vec![path(name)], frames, ..Selection::default() };
            let frames = resolve(&selection).unwrap().frames;
            frames.into_iter().map(|input| (input.number, input.path)).collect::<Vec<_>>()
        };
        let both = [(Some(1), path(b"b\xff.0001.exr")), (Some(2), path(b"b\xff.0002.exr"))];
        assert_eq!(found(b"b\xff.####.exr", None), both);
        assert_eq!(found(b"b\xff.####.exr", Some("1-2")), both);
        assert_eq!(found(b"b\xff.*.exr", None), both);
        assert_eq!(found(b"b?.*.exr", None).len(), 3);
        assert_eq!(found(b"*.exr", Some("7")), [(Some(7), path(b"b\xfe.0007.exr"))]);
    }

    #[test]
    fn chunks_have_every_number_once_and_no_file_without_one() {
        let folder = folder(&["a.1.exr", "b.1.exr", "b.2.exr"]);
        let numbers = || {
            let inputs = vec![folder.path().join("*.exr")];
            frame_numbers(&Selection { inputs, ..Selection::default() })
        };
        assert_eq!(numbers(), Ok(vec![1, 2]));
        std::fs::write(folder.path().join("still.exr"), "").unwrap();
        assert!(numbers().unwrap_err().to_string().contains("still.exr: no frame number"));
    }

    #[test]
    fn a_file_of_that_very_name_is_that_file() {
        let folder = folder(&["odd[1].####.exr", "100% $F4.exr", "*.exr"]);
        for name in ["odd[1].####.exr", "100% $F4.exr", "*.exr"] {
            assert_eq!(resolved(folder.path(), &[name], None).unwrap()[0].1, name);
        }
    }

    #[test]
    fn standard_input_holds_no_frame() {
        let found = resolve(&Selection { inputs: vec!["-".into()], ..Selection::default() });
        assert!(found.unwrap_err().to_string().contains("--files-from - reads a list"));
    }

    #[test]
    fn folders_and_useless_frames_are_usage_errors() {
        let folder = folder(&["one.exr"]);
        assert!(matches!(resolved(folder.path(), &["."], None), Err(PlanError::Usage(_))));
        assert!(matches!(resolved(folder.path(), &["one.exr"], Some("1-3")), Err(PlanError::Usage(_))));
        assert!(matches!(resolved(folder.path(), &["##/s.exr"], None), Err(PlanError::Usage(_))));
        assert!(matches!(resolved(folder.path(), &["s.%4d.exr"], None), Err(PlanError::Usage(_))));
    }

    #[test]
    fn a_list_with_zeros_is_split_at_them() {
        let folder = folder(&[]);
        let list = folder.path().join("list");
        std::fs::write(&list, b"a\nb.0001.exr\0c.exr\0").unwrap();
        let found = resolve(&Selection { files_from: Some(list), ..Selection::default() }).unwrap();
        let names: Vec<_> = found.frames.iter().map(|input| input.path.to_str().unwrap()).collect();
        assert_eq!(names, ["a\nb.0001.exr", "c.exr"]);
    }

    #[cfg(unix)]
    #[test]
    fn a_list_that_is_a_pipe_is_refused() {
        let folder = folder(&[]);
        let pipe = folder.path().join("pipe");
        assert!(std::process::Command::new("mkfifo").arg(&pipe).status().unwrap().success());
        let found = resolve(&Selection { files_from: Some(pipe), ..Selection::default() });
        assert!(found.unwrap_err().to_string().contains("not a regular file"));
    }

    #[test]
    fn a_list_is_read_line_by_line() {
        let folder = folder(&[]);
        let list = folder.path().join("list");
        std::fs::write(&list, "\u{feff}a b.0001.exr\r\n\nü*.exr\n").unwrap();
        let selection = Selection { files_from: Some(list), ..Selection::default() };
        let inputs = resolve(&selection).unwrap();
        assert!(inputs.is_set);
        assert_eq!(inputs.frames[0], Input { path: "a b.0001.exr".into(), number: Some(1) });
        assert_eq!(inputs.frames[1], Input { path: "ü*.exr".into(), number: None });
    }
}
