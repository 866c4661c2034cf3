//! Every EXR file of the shared corpus, where it exists: valid ones survive reading, writing and reading again,
//! unsupported ones are refused by name, damaged ones never panic.

use std::path::{Path, PathBuf};

use lacuna_exr::{self, Attribute, Compression, Error, Frame, Limits, Part, WriteOptions};

fn corpus() -> Option<PathBuf> {
    let data = Path::new(env!("CARGO_MANIFEST_DIR")).join("../shared/data");
    if !data.is_dir() {
        println!("left out: {} does not exist", data.display());
        return None;
    }
    let folder = data.join("exr");
    assert!(folder.is_dir(), "{} does not exist", folder.display());
    Some(folder)
}

/// All files below the folder, sorted; texts are not frames.
fn files(folder: &Path) -> Vec<PathBuf> {
    let mut found = Vec::new();
    for entry in std::fs::read_dir(folder).unwrap() {
        let path = entry.unwrap().path();
        if path.is_dir() {
            found.extend(files(&path));
        } else if path.extension().is_none_or(|extension| extension != "rst") {
            found.push(path);
        }
    }
    found.sort();
    found
}

fn is_broken(path: &Path) -> bool {
    path.components()
        .any(|part| ["Damaged", "invalid", "fuzzed"].iter().any(|name| part.as_os_str() == *name))
}

fn assert_same(path: &Path, before: &Frame, after: &Frame) {
    assert_eq!(before.parts.len(), after.parts.len(), "{}", path.display());
    for (before, after) in before.parts.iter().zip(&after.parts) {
        assert_eq!(before.data_window, after.data_window);
        assert_eq!(before.display_window, after.display_window);
        assert_eq!(before.compression, after.compression);
        assert_eq!(before.layout, after.layout);
        assert!(!after.had_levels);
        assert_eq!(before.channels.len(), after.channels.len());
        for (a, b) in before.channels.iter().zip(&after.channels) {
            assert_eq!(a.name, b.name);
            assert_eq!(a.perceptually_linear, b.perceptually_linear);
            assert!(a.samples.same_bits(&b.samples), "{}: {}", path.display(), a.display_name());
        }
    }
}

/// The attributes that `before` had, in order, as `part` has them; without those that must change if `before` had
/// levels or a lossy compression.
fn lasting<'a>(part: &'a Part, before: &Part) -> Vec<&'a Attribute> {
    let lossy = !before.compression.is_lossless();
    let changed = |name: &[u8]| match name {
        b"compression" => lossy,
        b"chunkCount" => lossy || before.had_levels,
        b"tiles" => before.had_levels,
        _ => false,
    };
    let had = |name: &[u8]| before.attributes.iter().any(|attribute| attribute.name == name);
    part.attributes.iter().filter(|attribute| had(&attribute.name) && !changed(&attribute.name)).collect()
}

/// Writes the frame as `fill` would and reads it back.
fn check_survival(path: &Path, original: &Frame, output: &Path) {
    let mut frame = original.clone();
    for part in &mut frame.parts {
        if !part.compression.is_lossless() {
            part.compression = Compression::Zip;
        }
    }
    lacuna_exr::write(&frame, output, &WriteOptions::default()).unwrap();
    let again = lacuna_exr::read(output, &Limits::default()).unwrap();
    assert_same(path, &frame, &again);
    for (before, after) in original.parts.iter().zip(&again.parts) {
        assert_eq!(lasting(before, before), lasting(after, before), "{}", path.display());
    }
    // The same bytes for the same frame.
    let bytes = std::fs::read(output).unwrap();
    lacuna_exr::write(&again, output, &WriteOptions::default()).unwrap();
    assert!(bytes == std::fs::read(output).unwrap(), "{}", path.display());
}

#[test]
fn valid_files_survive() {
    let Some(corpus) = corpus() else { return };
    let folder = tempfile::tempdir().unwrap();
    let (mut survived, mut refused) = (0, 0);
    for path in files(&corpus).into_iter().filter(|path| !is_broken(path)) {
        match lacuna_exr::read(&path, &Limits::default()) {
            Ok(frame) => {
                check_survival(&path, &frame, &folder.path().join("out.exr"));
                survived += 1;
            }
            Err(error) => {
                let name = path.to_string_lossy();
                assert!(matches!(error, Error::Unsupported { .. }), "{name}: {error}");
                assert!(["deep", "LuminanceChroma", "_YC"].iter().any(|kind| name.contains(kind)), "{name}");
                refused += 1;
            }
        }
    }
    println!("valid files: {survived} survived, {refused} refused by name");
    assert!(survived > 0);
}

/// Most memory that this process has taken so far, in bytes, where the system tells.
fn peak_memory() -> Option<u64> {
    let status = std::fs::read_to_string("/proc/self/status").ok()?;
    let line = status.lines().find_map(|line| line.strip_prefix("VmHWM:"))?;
    Some(line.trim().strip_suffix(" kB")?.parse::<u64>().ok()? << 10)
}

#[test]
fn broken_files_never_panic() {
    let Some(corpus) = corpus() else { return };
    let (mut read, mut refused) = (0, 0);
    for path in files(&corpus).into_iter().filter(|path| is_broken(path)) {
        match lacuna_exr::read(&path, &Limits::default()) {
            Ok(_) => read += 1,
            Err(error) => {
                println!("{}: {error}", path.file_name().unwrap().to_string_lossy());
                assert_eq!(error.to_string().lines().count(), 1);
                refused += 1;
            }
        }
    }
    println!("broken files: {read} read, {refused} refused");
    if let Some(peak) = peak_memory() {
        assert!(peak < 2 << 30, "{peak} bytes of memory were taken");
    }
    assert!(read + refused > 0);
}
