//! The stored files of every fuzz target, and what the fuzzer found, through the stable compiler: seconds, in every check. `scripts/fuzz`
//! looks for more.

#![allow(
    clippy::unwrap_used,
    clippy::panic,
    missing_docs,
    unreachable_pub,
    reason = "tests fail by panicking, and their bodies are no library"
)]

mod bodies;

use std::path::{Path, PathBuf};

use bodies::TARGETS;

fn files(folder: &Path) -> Vec<PathBuf> {
    let mut found: Vec<_> = std::fs::read_dir(folder).unwrap().map(|entry| entry.unwrap().path()).collect();
    found.sort();
    found
}

#[test]
fn nothing_stored_breaks_its_target() {
    let corpus = Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/fuzz/corpus");
    for (name, body) in TARGETS {
        let files = files(&corpus.join(name));
        assert!(files.len() > 1, "{name}: no files");
        for path in files {
            println!("{}", path.display());
            body(&std::fs::read(&path).unwrap());
        }
    }
    bodies::clean();
}

#[test]
fn every_target_is_one_of_the_fuzzer() {
    let manifest = include_str!("Cargo.toml");
    let named =
        manifest.lines().filter_map(|line| line.strip_prefix("path = \"targets/")?.strip_suffix(".rs\""));
    let named: std::collections::BTreeSet<_> = named.collect();
    assert_eq!(named, TARGETS.iter().map(|(name, _)| *name).collect());
}
