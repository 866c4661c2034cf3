//! Paths as text in which patterns and globs can look for signs, and back, whatever bytes they hold.
//!
//! A byte that is not UTF-8 becomes a letter of its own, from the last private ones of Unicode; a name that has such letters
//! already is taken byte by byte there, so that every name comes back as it was.

use std::borrow::Cow;
use std::ffi::OsStr;
use std::path::{Path, PathBuf};

/// The letter of byte 0; those of the others follow.
#[cfg(unix)]
const FIRST: u32 = 0x10_fe00;

/// The byte that a letter stands for, if it stands for one.
#[cfg(unix)]
fn byte_of(letter: char) -> Option<u8> {
    u32::from(letter).checked_sub(FIRST).and_then(|byte| u8::try_from(byte).ok())
}

/// A name as text.
#[cfg(unix)]
pub fn to_text(name: &OsStr) -> Cow<'_, str> {
    use std::os::unix::ffi::OsStrExt;
    let plain = |text: &str| !text.chars().any(|letter| byte_of(letter).is_some());
    if let Some(text) = name.to_str().filter(|text| plain(text)) {
        return text.into();
    }
    let letter_of =
        |&byte: &u8| char::from_u32(FIRST + u32::from(byte)).unwrap_or(char::REPLACEMENT_CHARACTER);
    let mut text = String::with_capacity(4 * name.len());
    for chunk in name.as_bytes().utf8_chunks() {
        for letter in chunk.valid().chars() {
            if byte_of(letter).is_some() {
                text.extend(letter.encode_utf8(&mut [0; 4]).as_bytes().iter().map(letter_of));
            } else {
                text.push(letter);
            }
        }
        text.extend(chunk.invalid().iter().map(letter_of));
    }
    text.into()
}

/// The path of such a text.
#[cfg(unix)]
pub fn to_path(text: &str) -> PathBuf {
    let mut bytes = Vec::with_capacity(text.len());
    for letter in text.chars() {
        match byte_of(letter) {
            Some(byte) => bytes.push(byte),
            None => bytes.extend_from_slice(letter.encode_utf8(&mut [0; 4]).as_bytes()),
        }
    }
    <std::ffi::OsString as std::os::unix::ffi::OsStringExt>::from_vec(bytes).into()
}

/// A name as text.
#[cfg(not(unix))]
pub fn to_text(name: &OsStr) -> Cow<'_, str> {
    name.to_string_lossy()
}

/// The path of such a text.
#[cfg(not(unix))]
pub fn to_path(text: &str) -> PathBuf {
    text.into()
}

/// The folder of a file, `.` for a bare name.
pub fn folder_of(file: &Path) -> PathBuf {
    match file.parent() {
        Some(folder) if !folder.as_os_str().is_empty() => folder.into(),
        _ => ".".into(),
    }
}

#[cfg(all(test, unix))]
mod tests {
    use std::os::unix::ffi::OsStrExt;

    use super::*;

    #[test]
    fn every_name_comes_back() {
        for name in [
            &b"shot.0001.exr"[..],
            "größe 填充".as_bytes(),
            b"b\xff.exr",
            b"\xc3",
            "\u{10feff}\u{10fe00}".as_bytes(),
            b"",
        ] {
            let name = OsStr::from_bytes(name);
            assert_eq!(to_path(&to_text(name)), PathBuf::from(name));
        }
        // One letter a byte, which no other name has.
        assert_eq!(to_text(OsStr::from_bytes(b"b\xff")).chars().count(), 2);
        assert_ne!(to_text(OsStr::from_bytes(b"\xff")), to_text(OsStr::new("\u{10feff}")));
    }
}
