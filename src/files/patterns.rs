//! File names with a frame number in them: `shot.####.exr`, `shot.%04d.exr`, `shot.@@@@.exr`, `shot.$F4.exr`.
//!
//! A single `#` reads as four digits, a run of n as n; `@` needs a run of two or more (so that `logo@2x.exr` is a
//! plain name); `%d` and `$F` pad nothing. Numbers wider than the padding take the digits that they need; the minus
//! sign of a negative number counts as one of the digits, as in C's `printf`. Everything else is literal, and so is a folder that
//! exists under the very name.

use std::path::{Path, PathBuf};

use crate::files::names::{to_path, to_text};

/// A path with at least one place for a frame number; several places take the same number.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Pattern {
    pieces: Vec<Piece>,
}

#[derive(Clone, Debug, PartialEq, Eq)]
enum Piece {
    Text(String),
    /// The least number of digits.
    Number(usize),
}

/// A spelling that would not do what it seems to say.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
pub enum PatternError {
    /// Padding that is none.
    #[error("'%{0}d' pads with spaces; write %0{0}d")]
    Spaces(usize),
    /// The spelling of another tool.
    #[error("'{0}' is not how a frame number is written here; write ####, %04d or $F4")]
    Angles(String),
}

impl Pattern {
    /// The pattern in `path`, or `None` if it has no place for a frame number. The folders that it begins with and that exist
    /// have none, whatever signs their names have.
    pub fn of(path: &Path) -> Result<Option<Self>, PatternError> {
        let text = to_text(path.as_os_str());
        Self::after(&text, existing_folders(&text))
    }

    /// The pattern in `text`, as it is read where no folder exists.
    pub fn parse(text: &str) -> Result<Option<Self>, PatternError> {
        Self::after(text, 0)
    }

    /// The pattern in `text`, of which the first bytes are literal.
    fn after(text: &str, known: usize) -> Result<Option<Self>, PatternError> {
        let mut pieces = Vec::new();
        let mut literal = text[..known].to_owned();
        let mut rest = &text[known..];
        while let Some(c) = rest.chars().next() {
            if let Some((length, width)) = token(rest)? {
                if !literal.is_empty() {
                    pieces.push(Piece::Text(std::mem::take(&mut literal)));
                }
                pieces.push(Piece::Number(width));
                rest = &rest[length..];
            } else {
                literal.push(c);
                rest = &rest[c.len_utf8()..];
            }
        }
        if pieces.is_empty() {
            return Ok(None);
        }
        if !literal.is_empty() {
            pieces.push(Piece::Text(literal));
        }
        Ok(Some(Self { pieces }))
    }

    /// The path of frame `number`.
    pub fn path(&self, number: i64) -> PathBuf {
        self.written(|width| format!("{number:0width$}"))
    }

    /// The file of frame `number`, to be read: as some tools spell negative numbers, if only that one exists.
    pub fn file(&self, number: i64) -> PathBuf {
        let path = self.path(number);
        match self.alternative(number) {
            Some(other) if !path.exists() && other.exists() => other,
            _ => path,
        }
    }

    /// The path of frame `number`, a negative one spelt as in the name of this file: `-0001` and `-001` are both of four digits.
    pub fn spelt_as(&self, number: i64, file: &Path) -> PathBuf {
        let name = file.file_name().map(to_text).unwrap_or_default();
        let full = (number < 0).then(|| format!("-{:04}", number.unsigned_abs()));
        let is_full = full.is_some_and(|full| name.contains(&full));
        self.alternative(number).filter(|_| is_full).unwrap_or_else(|| self.path(number))
    }

    /// The path of frame `number` as some tools write it: a minus sign before the full padding.
    pub fn alternative(&self, number: i64) -> Option<PathBuf> {
        (number < 0).then(|| self.written(|width| format!("-{:0width$}", number.unsigned_abs())))
    }

    fn written(&self, number: impl Fn(usize) -> String) -> PathBuf {
        let mut path = String::new();
        for piece in &self.pieces {
            match piece {
                Piece::Text(text) => path.push_str(text),
                Piece::Number(width) => path.push_str(&number(*width)),
            }
        }
        to_path(&path)
    }

    /// The frame number of `path` if it is one that this pattern stands for.
    pub fn number_of(&self, path: &Path) -> Option<i64> {
        let text = to_text(path.as_os_str());
        let Some(Piece::Number(_)) = self.pieces.iter().find(|piece| matches!(piece, Piece::Number(_)))
        else {
            return None;
        };
        let start = match &self.pieces[0] {
            Piece::Text(prefix) => prefix.len(),
            Piece::Number(_) => 0,
        };
        let digits = text.get(start..)?;
        let end = digits.char_indices().find(|&(at, c)| !(c.is_ascii_digit() || (at == 0 && c == '-')));
        let number = digits[..end.map_or(digits.len(), |(at, _)| at)].parse().ok()?;
        let is = |candidate: Option<PathBuf>| candidate.is_some_and(|candidate| candidate == path);
        (is(Some(self.path(number))) || is(self.alternative(number))).then_some(number)
    }

    /// The folder in which the frames lie, if it is the same for all of them.
    pub fn folder(&self) -> Option<PathBuf> {
        let (zero, one) = (self.path(0), self.path(1));
        (zero.parent() == one.parent()).then(|| zero.parent().map(Path::to_path_buf)).flatten()
    }
}

/// How many bytes of a path's text, its last name apart, are folders that exist, with the separator behind them.
pub(super) fn existing_folders(text: &str) -> usize {
    let ends = text.match_indices(std::path::is_separator).map(|(at, separator)| at + separator.len());
    let mut ends: Vec<usize> = ends.collect();
    while let Some(end) = ends.pop() {
        if to_path(&text[..end]).is_dir() {
            return end;
        }
    }
    0
}

/// Length and padding of the frame number's place at the start of `text`, if there is one.
fn token(text: &str) -> Result<Option<(usize, usize)>, PatternError> {
    let run = |c: char| text.chars().take_while(|&other| other == c).count();
    let digits = |text: &str| text.chars().take_while(char::is_ascii_digit).count();
    Ok(match text.as_bytes()[0] {
        b'#' => Some((run('#'), if run('#') == 1 { 4 } else { run('#') })),
        b'@' if run('@') > 1 => Some((run('@'), run('@'))),
        b'%' => {
            let width = &text[1..][..digits(&text[1..])];
            if text[1 + width.len()..].starts_with('d') && width.len() < 4 {
                let value = width.parse().unwrap_or(1);
                match width.as_bytes() {
                    [] | [b'0', ..] => Some((width.len() + 2, value.max(1))),
                    [_] | [b'1', _] => return Err(PatternError::Spaces(value)),
                    // `%20d` is a space of an address, and a word; nobody pads so far.
                    _ => None,
                }
            } else {
                None
            }
        }
        b'$' if text[1..].starts_with('F') => {
            let width = &text[2..][..digits(&text[2..]).min(2)];
            let next = text[2 + width.len()..].chars().next();
            let word = width.is_empty() && next.is_some_and(|c| c.is_alphanumeric() || c == '_');
            (!word).then(|| (2 + width.len(), width.parse().unwrap_or(1).max(1)))
        }
        b'<' => match text[1..].split_once('>') {
            Some((word, _)) if is_frame(word) => return Err(PatternError::Angles(format!("<{word}>"))),
            _ => None,
        },
        _ => None,
    })
}

/// Whether a word between angles stands for a frame number in other tools: `f`, `F4`, `frame`, `frame04`.
fn is_frame(word: &str) -> bool {
    let word = word.trim_end_matches(|c: char| c.is_ascii_digit()).to_ascii_lowercase();
    matches!(word.as_str(), "f" | "frame" | "fnum" | "framenum")
}

/// The frame number in a plain file name: the last field between dots that is all digits, else the last run of
/// digits before the extension that is no version (`_v2`). A minus sign counts if it starts the field.
pub fn number_in_name(path: &Path) -> Option<i64> {
    let stem = to_text(path.file_stem()?);
    stem[digits_in_stem(&stem)?].parse().ok()
}

/// What frame `number` of the sequence may be called that a plain file name is one frame of, the likeliest name first: with as many
/// digits, or with fewer where the name does not show that it is padded, as 9 beside 10.
pub fn beside(path: &Path, number: i64) -> Vec<PathBuf> {
    let stem = path.file_stem().map(to_text).unwrap_or_default();
    let Some(digits) = digits_in_stem(&stem) else { return Vec::new() };
    let (own, width) = (&stem[digits.clone()], digits.len());
    let unsigned = own.trim_start_matches('-');
    let padded = unsigned.len() > 1 && unsigned.starts_with('0');
    let mut names: Vec<String> = Vec::new();
    for width in (if padded { unsigned.len() } else { 1 }..=width).rev() {
        names.push(format!("{number:0width$}"));
        if number < 0 {
            names.push(format!("-{:0width$}", number.unsigned_abs()));
        }
    }
    let mut seen = std::collections::HashSet::new();
    names.retain(|name| seen.insert(name.clone()));
    let ending = path.extension().map(|ending| format!(".{}", to_text(ending))).unwrap_or_default();
    let whole = |name| format!("{}{name}{}{ending}", &stem[..digits.start], &stem[digits.end..]);
    names.into_iter().map(|name| path.with_file_name(to_path(&whole(name)))).collect()
}

/// Where the frame number stands. A version (`_v2`, `.v002`) is none.
fn digits_in_stem(stem: &str) -> Option<std::ops::Range<usize>> {
    let mut end = stem.len();
    for field in stem.rsplit('.') {
        let digits = field.strip_prefix('-').unwrap_or(field);
        if !digits.is_empty() && digits.bytes().all(|byte| byte.is_ascii_digit()) {
            return Some(end - field.len()..end);
        }
        end = end.saturating_sub(field.len() + 1);
    }
    let mut rest = stem;
    loop {
        let end = rest.rfind(|c: char| c.is_ascii_digit())? + 1;
        let start = rest[..end].trim_end_matches(|c: char| c.is_ascii_digit()).len();
        if !is_version(&stem[..start], &stem[end..]) {
            return Some(start..end);
        }
        rest = &stem[..start];
    }
}

/// Whether digits between these texts are those of a version: a word of its own that begins with `v`.
fn is_version(before: &str, after: &str) -> bool {
    let ends = |next: Option<char>| !next.is_some_and(char::is_alphanumeric);
    let begun = before.strip_suffix(['v', 'V']);
    begun.is_some_and(|before| ends(before.chars().next_back())) && ends(after.chars().next())
}

#[cfg(test)]
mod tests {
    use super::*;

    fn pattern(text: &str) -> Pattern {
        Pattern::parse(text).unwrap().unwrap()
    }

    fn path(text: &str, number: i64) -> String {
        pattern(text).path(number).to_str().unwrap().into()
    }

    #[test]
    fn all_spellings_pad_as_documented() {
        assert_eq!(path("a/shot.####.exr", 12), "a/shot.0012.exr");
        assert_eq!(path("shot.#.exr", 12), "shot.0012.exr");
        assert_eq!(path("shot.##.exr", 7), "shot.07.exr");
        assert_eq!(path("shot.%04d.exr", 12), "shot.0012.exr");
        assert_eq!(path("shot.%d.exr", 12), "shot.12.exr");
        assert_eq!(path("shot.@@@.exr", 12), "shot.012.exr");
        assert_eq!(path("shot.$F4.exr", 12), "shot.0012.exr");
        assert_eq!(path("shot.$F.exr", 12), "shot.12.exr");
        assert_eq!(path("####/shot.%02d.exr", 3), "0003/shot.03.exr");
        assert_eq!(path("größe ünd raum.####.exr", 1), "größe ünd raum.0001.exr");
    }

    #[test]
    fn numbers_may_outgrow_the_padding_and_be_negative() {
        assert_eq!(path("s.####.exr", 123_456), "s.123456.exr");
        assert_eq!(path("s.####.exr", -1), "s.-001.exr");
        assert_eq!(path("s.%d.exr", -12), "s.-12.exr");
        assert_eq!(path("s.####.exr", -12_345), "s.-12345.exr");
    }

    #[test]
    fn other_signs_are_literal() {
        for text in
            ["plain.exr", "100%.exr", "logo@2x.exr", "a%20b.exr", "$FOO.exr", "%s.exr", "$.exr", "%%.exr"]
        {
            assert_eq!(Pattern::parse(text), Ok(None), "{text}");
        }
        assert_eq!(path("100% $FOO a@b.##.exr", 1), "100% $FOO a@b.01.exr");
        for text in ["a.<f>.exr", "a.<F4>.exr", "<frame>.exr", "s.##/<frame04>.exr"] {
            assert!(matches!(Pattern::parse(text), Err(PatternError::Angles(_))), "{text}");
        }
        assert_eq!(Pattern::parse("a.<view>.<f.exr"), Ok(None));
        assert_eq!(Pattern::parse("a.%4d.exr"), Err(PatternError::Spaces(4)));
        assert_eq!(Pattern::parse("a.%14d.exr"), Err(PatternError::Spaces(14)));
        assert_eq!(Pattern::parse("my%20dog.exr"), Ok(None));
    }

    #[test]
    fn a_name_gives_back_its_number() {
        let shot = pattern("dir/shot.####.exr");
        let number = |name: &str| shot.number_of(Path::new(name));
        assert_eq!(number("dir/shot.0012.exr"), Some(12));
        assert_eq!(number("dir/shot.12345.exr"), Some(12345));
        assert_eq!(number("dir/shot.-001.exr"), Some(-1));
        assert_eq!(number("dir/shot.-0001.exr"), Some(-1));
        for other in [
            "dir/shot.12.exr",
            "dir/shot.00012.exr",
            "dir/shot..exr",
            "dir/shot.0012.png",
            "shot.0012.exr",
            "d",
        ] {
            assert_eq!(number(other), None, "{other}");
        }
        assert_eq!(pattern("####.exr").number_of(Path::new("0007.exr")), Some(7));
        assert_eq!(pattern("s-##.exr").number_of(Path::new("s-07.exr")), Some(7));
        assert_eq!(pattern("##/s.##.exr").number_of(Path::new("07/s.08.exr")), None);
        assert_eq!(pattern("##/s.##.exr").number_of(Path::new("07/s.07.exr")), Some(7));
        assert_eq!(pattern("é.##.exr").number_of(Path::new("aé.07.exr")), None);
    }

    #[test]
    fn every_number_comes_back() {
        for text in ["s.####.exr", "s.%d.exr", "a/s_@@@.exr", "$F3.exr"] {
            for number in [-12_345, -100, -1, 0, 1, 9, 10, 999, 1000, 99_999] {
                let pattern = pattern(text);
                assert_eq!(pattern.number_of(&pattern.path(number)), Some(number), "{text} {number}");
            }
        }
    }

    #[test]
    fn plain_names_have_numbers_too() {
        let number = |name: &str| number_in_name(Path::new(name));
        assert_eq!(number("a/shot.0012.exr"), Some(12));
        assert_eq!(number("shot.-003.exr"), Some(-3));
        assert_eq!(number("shot-003.exr"), Some(3));
        assert_eq!(number("shot_v2.0012.beauty_l8.exr"), Some(12));
        for name in ["shot_v2.exr", "shot.v002.exr", "v3.exr", "shot-V4_final.exr", "a_v2_v3.exr"] {
            assert_eq!(number(name), None, "{name}");
        }
        assert_eq!(number("sh_0002_v2.exr"), Some(2));
        assert_eq!(number("sh0010_v002_beauty.exr"), Some(10));
        assert_eq!(number("view2.exr"), Some(2));
        assert_eq!(number("shot_v2b.exr"), Some(2));
        assert_eq!(number("ov7.exr"), Some(7));
        assert_eq!(number("shot_v2.0012.exr"), Some(12));
        assert_eq!(number("0007.exr"), Some(7));
        assert_eq!(number("bild ä7ö.exr"), Some(7));
        assert_eq!(number("plain.exr"), None);
    }

    #[test]
    fn other_frames_of_a_name_are_found() {
        let beside = |name: &str, number| {
            let paths = beside(Path::new(name), number);
            paths.iter().map(|path| path.to_str().unwrap().to_owned()).collect::<Vec<_>>().join(" ")
        };
        assert_eq!(beside("a/shot.0012.exr", 9), "a/shot.0009.exr");
        assert_eq!(beside("shot_v2.0012.beauty_l8.exr", 13), "shot_v2.0013.beauty_l8.exr");
        assert_eq!(beside("shot-9.exr", 10), "shot-10.exr");
        assert_eq!(beside("sh_0002_v2.exr", 3), "sh_0003_v2.exr");
        assert_eq!(beside("0007.exr", 6), "0006.exr");
        assert_eq!(beside("plain.exr", 6), "");
        // Ten may be padded or not.
        assert_eq!(beside("s.10.exr", 9), "s.09.exr s.9.exr");
        assert_eq!(beside("s.10000.exr", 9999), "s.09999.exr s.9999.exr");
        assert_eq!(beside("s.0.exr", -1), "s.-1.exr");
        assert_eq!(beside("s.0001.exr", -1), "s.-001.exr s.-0001.exr");
        assert_eq!(beside("s.-10.exr", -9), "s.-09.exr s.-009.exr s.-9.exr");
        assert_eq!(beside("s.-0001.exr", 0), "s.00000.exr s.0000.exr");
    }

    #[test]
    fn a_folder_of_that_very_name_is_that_folder() {
        let room = tempfile::tempdir().unwrap();
        std::fs::create_dir_all(room.path().join("a#1/%d")).unwrap();
        let path = |text: &str| Pattern::of(&room.path().join(text)).unwrap().map(|pattern| pattern.path(3));
        let is = |text: &str, expected: Option<&str>| {
            assert_eq!(path(text), expected.map(|name| room.path().join(name)), "{text}");
        };
        is("a#1/e.##.exr", Some("a#1/e.03.exr"));
        is("a#1/%d//e.##.exr", Some("a#1/%d//e.03.exr"));
        is("a#1/e.exr", None);
        // The last name is a file's, and a folder that is not there has the number.
        is("a#1/%d", Some("a#1/3"));
        is("a#1/##/e.exr", Some("a#1/03/e.exr"));
        is("b##/e.exr", Some("b03/e.exr"));
        let inside = Pattern::of(&room.path().join("a#1/e.##.exr")).unwrap().unwrap();
        assert_eq!(inside.folder(), Some(room.path().join("a#1")));
        assert_eq!(inside.number_of(&room.path().join("a#1/e.07.exr")), Some(7));
    }

    #[test]
    fn the_folder_is_known_unless_it_has_the_number() {
        assert_eq!(pattern("a/s.##.exr").folder(), Some("a".into()));
        assert_eq!(pattern("s.##.exr").folder(), Some("".into()));
        assert_eq!(pattern("a.##/s.exr").folder(), None);
    }
}
