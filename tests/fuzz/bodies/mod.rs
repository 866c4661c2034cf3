//! What each fuzz target does with its bytes: plain functions, which the tests of the stable compiler call with the stored files. Each
//! panics on what must never be.

// A target uses one of them.
#![allow(dead_code, reason = "each target is a program of its own")]

pub mod dictionaries;
mod draw;
pub mod exr;
pub mod fills;
pub mod frames;
pub mod headers;
pub mod masks;
pub mod patterns;
pub mod scenes;
pub mod volumes;

use std::path::{Path, PathBuf};

/// A target: its name, which is that of the folder of its files, and what it does.
pub type Target = (&'static str, fn(&[u8]));

/// All of them.
pub const TARGETS: [Target; 9] = [
    ("dictionaries", dictionaries::body),
    ("exr", exr::body),
    ("fills", fills::body),
    ("frames", frames::body),
    ("headers", headers::body),
    ("masks", masks::body),
    ("patterns", patterns::body),
    ("scenes", scenes::body),
    ("volumes", volumes::body),
];

/// Bytes of memory that reading may take.
const MOST: u64 = 48 << 20;

/// A folder of this process.
fn folder() -> &'static Path {
    static FOLDER: std::sync::OnceLock<PathBuf> = std::sync::OnceLock::new();
    FOLDER.get_or_init(|| {
        let found = tempfile::Builder::new().prefix("lacuna-fuzz-").tempdir().unwrap();
        // Removed by `clean`; a process that the fuzzer ends cannot.
        found.keep()
    })
}

/// Removes the folder of this process.
pub fn clean() {
    let _ = std::fs::remove_dir_all(folder());
}

/// A file of that name with these bytes. One thread at a time may use a name.
fn file(name: &str, bytes: &[u8]) -> PathBuf {
    let path = folder().join(name);
    std::fs::write(&path, bytes).unwrap();
    path
}
