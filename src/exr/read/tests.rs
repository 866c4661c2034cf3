//! Broken and hostile files: an error that names the place, never a panic, no memory before it is known to be due.

use std::path::Path;

use proptest::prelude::*;

use super::*;
use crate::samples_for_tests::{any_frame, part, window};
use crate::{Compression, Layout, WriteOptions, write};

/// The bytes of a file with that frame.
fn bytes(frame: &Frame) -> Vec<u8> {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("frame.exr");
    write(frame, &path, &WriteOptions::default()).unwrap();
    std::fs::read(path).unwrap()
}

fn read_bytes(bytes: &[u8], limit: u64) -> Result<Frame, Error> {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("frame.exr");
    std::fs::write(&path, bytes).unwrap();
    read(&path, &Limits { bytes: limit })
}

/// One part of 40 rows in three chunks.
fn frame() -> Frame {
    Frame {
        parts: vec![part(Some("beauty"), window(0, -8, 10, 40), &[SampleType::Half, SampleType::Float], 0)],
    }
}

/// Where the value of an attribute begins in the file.
fn value_of(bytes: &[u8], name: &str, kind: &str) -> usize {
    let head = [name.as_bytes(), &[0], kind.as_bytes(), &[0]].concat();
    bytes.windows(head.len()).position(|window| window == head).unwrap() + head.len() + 4
}

fn change(bytes: &mut [u8], at: usize, new: &[u8]) {
    bytes[at..at + new.len()].copy_from_slice(new);
}

/// Where the only part's table of chunks begins.
fn table(bytes: &[u8]) -> usize {
    parse(bytes).unwrap().length as usize
}

fn message(bytes: &[u8]) -> String {
    read_bytes(bytes, 1 << 30).unwrap_err().to_string()
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(64))]

    #[test]
    fn changed_bytes_never_panic(
        frame in any_frame(),
        changes in prop::collection::vec((any::<prop::sample::Index>(), any::<u8>()), 1..8),
        cut in prop::option::of(any::<prop::sample::Index>()),
    ) {
        let mut bytes = bytes(&frame);
        for (index, byte) in changes {
            let index = index.index(bytes.len());
            bytes[index] = byte;
        }
        bytes.truncate(cut.map_or(bytes.len(), |cut| cut.index(bytes.len())));
        let _ = read_bytes(&bytes, 1 << 28);
    }

    #[test]
    fn lossy_chunks_of_noise_never_panic(number in 4..10_u8, noise in prop::collection::vec(any::<u8>(), 1..400)) {
        let mut frame = frame();
        frame.parts[0].compression = Compression::None;
        let mut bytes = bytes(&frame);
        let at = value_of(&bytes, "compression", "compression");
        bytes[at] = number;
        let table = table(&bytes);
        // One chunk holds the first rows; the others are missing.
        change(&mut bytes, table, &(table as u64 + 16).to_le_bytes());
        bytes.truncate(table + 16);
        bytes.extend((-8_i32).to_le_bytes());
        bytes.extend((noise.len() as i32).to_le_bytes());
        bytes.extend(&noise);
        let window = value_of(&bytes, "dataWindow", "box2i");
        change(&mut bytes, window + 12, &7_i32.to_le_bytes());
        let _ = read_bytes(&bytes, 1 << 28);
    }
}

#[test]
fn every_truncation_is_an_error() {
    let bytes = bytes(&frame());
    for length in 0..bytes.len() {
        assert!(read_bytes(&bytes[..length], 1 << 30).is_err(), "{length}");
    }
    assert!(matches!(read_bytes(&bytes[..table(&bytes) - 3], 1 << 30), Err(Error::Truncated { .. })));
    assert!(matches!(read_bytes(b"", 1 << 30), Err(Error::NotExr)));
    assert!(matches!(read_bytes(b"\x89PNG\r\n\x1a\n and more", 1 << 30), Err(Error::NotExr)));
}

#[test]
fn missing_repeated_and_swapped_chunks_are_named() {
    let whole = bytes(&frame());
    let table = table(&whole);
    let mut missing = whole.clone();
    change(&mut missing, table + 8, &[0; 8]);
    assert_eq!(
        message(&missing),
        "unfinished: the chunk at row 8 of part 0 (beauty) has no pixels in the file; render it again"
    );
    let mut repeated = whole.clone();
    repeated.copy_within(table..table + 8, table + 16);
    assert!(message(&repeated).contains("other bytes than the chunk at row 24 of part 0 (beauty)"));
    let mut inside = whole.clone();
    change(&mut inside, table, &8_u64.to_le_bytes());
    assert!(message(&inside).contains("other bytes than the chunk at row -8"));
    let mut beyond = whole.clone();
    change(&mut beyond, table, &u64::MAX.to_le_bytes());
    assert!(message(&beyond).starts_with("truncated"));
    let mut negative = whole.clone();
    let first = u64::from_le_bytes(whole[table..table + 8].try_into().unwrap()) as usize;
    change(&mut negative, first + 4, &(-5_i32).to_le_bytes());
    assert!(message(&negative).contains("other bytes"));
}

#[test]
fn claims_beyond_the_file_or_the_limit_take_no_memory() {
    let whole = bytes(&frame());
    let window = value_of(&whole, "dataWindow", "box2i");
    let mut wide = whole.clone();
    change(&mut wide, window + 8, &i32::MAX.to_le_bytes());
    assert!(matches!(read_bytes(&wide, 1 << 30), Err(Error::TooLarge { .. })));
    let mut high = whole.clone();
    change(&mut high, window + 12, &1_000_000_i32.to_le_bytes());
    assert!(message(&high).contains("truncated: the file ends inside the table of chunks"));
    // No 60 MB of pixels fit into the few bytes of three chunks.
    let mut dense = whole.clone();
    change(&mut dense, window + 8, &250_000_i32.to_le_bytes());
    assert!(message(&dense).contains("cannot have"), "{}", message(&dense));
    assert!(
        matches!(read_bytes(&whole, 2000), Err(Error::TooLarge { needed, limit: 2000 }) if needed > 2400)
    );
}

#[test]
fn little_memory_gives_the_same_pixels() {
    for compression in [Compression::None, Compression::Zip, Compression::Piz] {
        let mut frame = frame();
        frame.parts[0].compression = compression;
        let bytes = bytes(&frame);
        let error = read_bytes(&bytes, 1).unwrap_err();
        let Error::TooLarge { needed, .. } = error else { panic!("{error}") };
        let least = read_bytes(&bytes, needed).unwrap();
        let most = read_bytes(&bytes, 1 << 30).unwrap();
        crate::samples_for_tests::assert_same_pixels(&least, &most);
    }
}

#[test]
fn contradictions_in_the_header_are_refused() {
    let whole = bytes(&frame());
    let mut frame = frame();
    frame.parts[0].layout = Layout::Tiles { width: 4, height: 4 };
    let tiled = bytes(&frame);
    let at = |name, kind| value_of(&whole, name, kind);
    let tiles = value_of(&tiled, "tiles", "tiledesc");
    let channels = at("channels", "chlist");
    let order = at("lineOrder", "lineOrder");
    let mut longer = whole.clone();
    longer.insert(order, 0);
    let long_name = [&whole[..8], &[b'x'; 300]].concat();
    let cases: Vec<(&[u8], usize, Vec<u8>, &str)> = vec![
        (&whole, at("dataWindow", "box2i"), 11_i32.to_le_bytes().into(), "\"dataWindow\" is empty"),
        (&whole, at("compression", "compression"), vec![200], "compression 200 is unknown"),
        (&whole, at("compression", "compression"), vec![13], "ZSTD compression is not supported"),
        (&whole, at("displayWindow", "box2i") - 4, (-1_i32).to_le_bytes().into(), "negative size"),
        (&longer, order - 4, 2_i32.to_le_bytes().into(), "\"lineOrder\" has size 2 instead of 1"),
        (&whole, channels + 8, 3_i32.to_le_bytes().into(), "unknown type 3"),
        (&whole, channels + 16, 2_i32.to_le_bytes().into(), "subsampled channels (layer.0"),
        (&whole, channels + 6, vec![b'9'], "twice or out of order"),
        (&tiled, tiles, 0_u32.to_le_bytes().into(), "tiles of size 0"),
        (&tiled, tiles + 8, vec![3], "unknown level mode"),
        (&tiled, 5, vec![0x08], "deep data is not supported"),
        (&whole, 5, vec![0x10], "is missing"),
        (&whole, 4, vec![3], "unknown"),
        (&long_name, 8, vec![b'y'], "a name in the header is longer than 255 bytes"),
    ];
    for (bytes, at, new, expected) in cases {
        let mut bytes = bytes.to_vec();
        change(&mut bytes, at, &new);
        let message = message(&bytes);
        assert!(message.contains(expected), "{expected}: {message}");
        assert_eq!(message.lines().count(), 1);
    }
}

#[test]
fn parts_need_names_of_their_own_and_their_own_chunks() {
    let small = |name| part(Some(name), window(0, 0, 4, 4), &[SampleType::Half], 1);
    let whole = bytes(&Frame { parts: vec![small("one"), small("two")] });
    let mut twice = whole.clone();
    let at = whole.windows(3).position(|bytes| bytes == b"two").unwrap();
    change(&mut twice, at, b"one");
    assert!(message(&twice).contains("two parts are called \"one\""));
    let mut swapped = whole.clone();
    let table = table(&whole);
    let (first, second) = swapped[table..table + 16].split_at_mut(8);
    first.swap_with_slice(second);
    assert!(message(&swapped).contains("of part 0 (one)"));
    let mut count = whole.clone();
    change(&mut count, value_of(&whole, "chunkCount", "int"), &2_i32.to_le_bytes());
    assert!(message(&count).contains("chunkCount"));
}

#[test]
fn levels_are_told_and_not_written_again() {
    let mut frame = Frame { parts: vec![part(None, window(2, 3, 1, 1), &[SampleType::Half], 1)] };
    frame.parts[0].layout = Layout::Tiles { width: 8, height: 8 };
    let one_level = bytes(&frame);
    // A single pixel has one level of each kind, so that the rest of the file stays true.
    let at = value_of(&one_level, "tiles", "tiledesc") + 8;
    for mode in [0x01, 0x02, 0x11, 0x12] {
        let mut levels = one_level.clone();
        levels[at] = mode;
        let again = read_bytes(&levels, 1 << 30).unwrap();
        assert!(again.parts[0].had_levels);
        let written = bytes(&again);
        assert_eq!(written[at], mode & 0xf0);
        assert!(!read_bytes(&written, 1 << 30).unwrap().parts[0].had_levels);
    }
}

#[test]
fn headers_tell_the_memory_that_reading_needs() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("frame.exr");
    write(&frame(), &path, &WriteOptions::default()).unwrap();
    let parts = read_header(&path).unwrap();
    assert_eq!(parts[0].name().as_deref(), Some("beauty"));
    assert_eq!(parts[0].channels[1].display_name(), "layer.1");
    let needed = memory_needed(&parts);
    assert!(needed >= 10 * 40 * 6);
    assert!(read(&path, &Limits { bytes: needed }).is_ok());
    assert!(matches!(read(&path, &Limits { bytes: needed - 1 }), Err(Error::TooLarge { .. })));
}

#[test]
fn what_is_no_file_is_an_error() {
    assert!(matches!(read(Path::new("/no/such/file.exr"), &Limits::default()), Err(Error::Io { .. })));
    let folder = tempfile::tempdir().unwrap();
    assert!(read(folder.path(), &Limits::default()).is_err());
}
