//! What is written is read back: pixels bit for bit, attributes byte for byte and in order.

use std::path::PathBuf;

use proptest::prelude::*;

use super::*;
use crate::samples_for_tests::{any_frame, assert_same_pixels, part, window};
use crate::{Compression, Limits, SampleType, read, read_header};

fn output() -> (tempfile::TempDir, PathBuf) {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("frame.exr");
    (folder, path)
}

fn written(frame: &Frame) -> Vec<u8> {
    let (_folder, path) = output();
    write(frame, &path, &WriteOptions::default()).unwrap();
    std::fs::read(path).unwrap()
}

#[test]
fn names_of_parts_are_compared_by_their_bytes() {
    let (_folder, path) = output();
    let parts = [b"a\xff", b"a\xfe"].map(|name| {
        let mut part = part(Some("a"), window(0, 0, 2, 2), &[SampleType::Half], 1);
        part.attributes.set("name", "string", name.to_vec());
        part
    });
    let mut frame = Frame { parts: parts.into() };
    write(&frame, &path, &WriteOptions::default()).unwrap();
    assert_same_pixels(&frame, &read(&path, &Limits::default()).unwrap());
    for name in [&b"a\xff"[..], b""] {
        frame.parts[1].attributes.set("name", "string", name.to_vec());
        assert!(matches!(write(&frame, &path, &WriteOptions::default()), Err(Error::Unwritable(_))));
    }
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(96))]

    #[test]
    fn frames_come_back(frame in any_frame()) {
        let (_folder, path) = output();
        write(&frame, &path, &WriteOptions::default()).unwrap();
        let again = read(&path, &Limits::default()).unwrap();
        assert_same_pixels(&frame, &again);
        for (before, after) in frame.parts.iter().zip(&again.parts) {
            let names: Vec<_> = before.attributes.iter().map(|attribute| &attribute.name).collect();
            let kept: Vec<_> =
                after.attributes.iter().filter(|attribute| names.contains(&&attribute.name)).collect();
            prop_assert_eq!(kept, before.attributes.iter().collect::<Vec<_>>());
        }
        // Once all required attributes are there, everything stays.
        let bytes = std::fs::read(&path).unwrap();
        prop_assert_eq!(&written(&again), &bytes);
        let headers = read_header(&path).unwrap();
        prop_assert!(headers.iter().map(|header| &header.attributes).eq(again.parts.iter().map(|part| &part.attributes)));
    }

    #[test]
    fn another_reader_sees_the_same(frame in any_frame()) {
        use exr::prelude::{FlatSamples, read_all_flat_layers_from_file};
        let (_folder, path) = output();
        write(&frame, &path, &WriteOptions::default()).unwrap();
        let image = read_all_flat_layers_from_file(&path).unwrap();
        prop_assert_eq!(image.layer_data.len(), frame.parts.len());
        for (part, layer) in frame.parts.iter().zip(&image.layer_data) {
            prop_assert_eq!(part.data_window.x_min, layer.attributes.layer_position.0);
            prop_assert_eq!(part.data_window.y_min, layer.attributes.layer_position.1);
            prop_assert_eq!(part.channels.len(), layer.channel_data.list.len());
            for (channel, other) in part.channels.iter().zip(&layer.channel_data.list) {
                let samples = match &other.sample_data {
                    FlatSamples::F16(samples) => Samples::Half(samples.clone()),
                    FlatSamples::F32(samples) => Samples::Float(samples.clone()),
                    FlatSamples::U32(samples) => Samples::Uint(samples.clone()),
                };
                prop_assert!(channel.samples.same_bits(&samples), "{}", channel.display_name());
            }
        }
    }

    #[test]
    fn threads_do_not_change_a_byte(frame in any_frame()) {
        let alone = rayon::ThreadPoolBuilder::new().num_threads(1).build().unwrap();
        let several = rayon::ThreadPoolBuilder::new().num_threads(5).build().unwrap();
        let one = alone.install(|| written(&frame));
        prop_assert_eq!(&one, &several.install(|| written(&frame)));
        // Outside of a pool chunks are written while others are packed.
        prop_assert_eq!(&one, &written(&frame));
    }
}

#[test]
fn attributes_keep_bytes_and_order() {
    let mut part = part(None, window(-5, 7, 9, 4), &[SampleType::Half], 3);
    let long = "an attribute with a name of more than thirty-one bytes";
    part.attributes.set("zuletzt", "string", "Grüße, 世界".into());
    part.attributes.set("keyCode", "keycode", (1..=7_i32).flat_map(i32::to_le_bytes).collect());
    part.attributes.set("compression", "compression", vec![9]);
    part.attributes.set(long, "a type that no library knows, with a long name", vec![1, 2, 3]);
    part.attributes.set("empty", "string", Vec::new());
    part.channels[0].name = b"a.layer.with.a.name.of.more.than.31.bytes.R".to_vec();
    let (_folder, path) = output();
    write(&Frame { parts: vec![part.clone()] }, &path, &WriteOptions::default()).unwrap();
    let again = read(&path, &Limits::default()).unwrap().parts.remove(0);
    let names: Vec<_> = again
        .attributes
        .iter()
        .take(5)
        .map(|attribute| String::from_utf8(attribute.name.clone()).unwrap())
        .collect();
    assert_eq!(names, ["zuletzt", "keyCode", "compression", long, "empty"]);
    for name in ["zuletzt", "keyCode", long, "empty"] {
        assert_eq!(again.attributes.get(name), part.attributes.get(name));
    }
    assert_eq!(again.attributes.get("keyCode").unwrap().value.len(), 28);
    assert_eq!(again.attributes.text("zuletzt").unwrap(), "Grüße, 世界");
    assert_eq!(again.attributes.get("compression").unwrap().value, [3]);
    assert_eq!(again.channels[0].name, part.channels[0].name);
    assert!(again.channels[0].samples.same_bits(&part.channels[0].samples));
}

#[test]
fn decreasing_line_order_is_kept() {
    let mut part = part(None, window(0, 10, 8, 40), &[SampleType::Float], 0);
    part.attributes.set("lineOrder", "lineOrder", vec![1]);
    let bytes = written(&Frame { parts: vec![part.clone()] });
    let table = headers(&Frame { parts: vec![part] }).unwrap().len();
    let entries: Vec<u64> =
        bytes[table..table + 24].as_chunks().0.iter().map(|b| u64::from_le_bytes(*b)).collect();
    assert!(entries[0] > entries[1] && entries[1] > entries[2]);
    assert_eq!(entries[2] as usize, table + 24);
}

#[test]
fn channels_are_sorted_and_may_come_in_any_order() {
    let mut part = part(None, window(0, 0, 5, 6), &[SampleType::Half, SampleType::Uint], 9);
    let sorted = Frame { parts: vec![part.clone()] };
    part.channels.reverse();
    assert_eq!(written(&sorted), written(&Frame { parts: vec![part] }));
}

#[test]
fn the_level_changes_the_size_not_the_pixels() {
    let frame = Frame { parts: vec![part(None, window(0, 0, 70, 70), &[SampleType::Half; 3], 1)] };
    let (_folder, path) = output();
    let length = |level| {
        write(&frame, &path, &WriteOptions { compression_level: Some(level), ..WriteOptions::default() })
            .unwrap();
        assert_same_pixels(&frame, &read(&path, &Limits::default()).unwrap());
        std::fs::metadata(&path).unwrap().len()
    };
    assert!(length(9) <= length(1));
    assert!(length(1) < length(0));
}

#[test]
fn frames_that_no_file_can_hold_are_refused() {
    let whole = || part(Some("a"), window(0, 0, 4, 4), &[SampleType::Half, SampleType::Half], 1);
    let mut cases: Vec<(&str, Frame)> = vec![("no parts", Frame { parts: Vec::new() })];
    let mut case = |what, change: fn(&mut Part)| {
        let mut part = whole();
        change(&mut part);
        cases.push((what, Frame { parts: vec![part] }));
    };
    case("two channels", |part| part.channels[1].name = part.channels[0].name.clone());
    case("no channels", |part| part.channels.clear());
    case("pixels instead", |part| part.data_window.x_max += 1);
    case("empty", |part| part.data_window.y_max = -1);
    case("no name", |part| part.channels[0].name.clear());
    case("no name", |part| part.attributes.set(&"x".repeat(256), "int", vec![0; 4]));
    case("size 0", |part| part.layout = Layout::Tiles { width: 0, height: 4 });
    case("pxr24", |part| part.compression = Compression::Pxr24);
    cases.push(("names of their own", Frame { parts: vec![whole(), whole()] }));
    for (what, frame) in cases {
        let (folder, path) = output();
        let error = write(&frame, &path, &WriteOptions::default()).unwrap_err().to_string();
        assert!(error.contains(what), "{what}: {error}");
        assert_eq!(std::fs::read_dir(folder.path()).unwrap().count(), 0);
    }
}

#[test]
fn errors_leave_the_folder_as_it_was() {
    let frame = Frame { parts: vec![part(None, window(0, 0, 4, 4), &[SampleType::Half], 1)] };
    let (folder, path) = output();
    let missing = folder.path().join("no such folder/frame.exr");
    assert!(matches!(write(&frame, &missing, &WriteOptions::default()), Err(Error::Io { .. })));
    std::fs::write(&path, "precious").unwrap();
    let options = WriteOptions { over: Over::Keep, ..WriteOptions::default() };
    assert!(matches!(write(&frame, &path, &options), Err(Error::Exists)));
    assert_eq!(std::fs::read(&path).unwrap(), b"precious");
    assert_eq!(std::fs::read_dir(folder.path()).unwrap().count(), 1);
}

/// A file in memory that takes only so many bytes at once, is interrupted every third time, and fails for good at a place.
struct Failing {
    content: std::io::Cursor<Vec<u8>>,
    /// Bytes that it takes before it fails.
    left: usize,
    error: rustix::io::Errno,
    calls: usize,
}

impl Write for Failing {
    fn write(&mut self, bytes: &[u8]) -> std::io::Result<usize> {
        self.calls += 1;
        if self.calls.is_multiple_of(3) {
            return Err(ErrorKind::Interrupted.into());
        }
        if self.left == 0 {
            return Err(self.error.into());
        }
        let taken = bytes.len().min(7).min(self.left);
        self.left -= taken;
        self.content.write(&bytes[..taken])
    }

    fn flush(&mut self) -> std::io::Result<()> {
        Ok(())
    }
}

impl Seek for Failing {
    fn seek(&mut self, to: SeekFrom) -> std::io::Result<u64> {
        self.content.seek(to)
    }
}

#[test]
fn a_write_that_fails_anywhere_is_told_and_short_ones_go_on() {
    use rustix::io::Errno;
    let frame = Frame { parts: vec![part(None, window(0, 0, 5, 40), &[SampleType::Half], 3)] };
    let header = headers(&frame).unwrap();
    let expected = written(&frame);
    let run = |left: usize, error: Errno| {
        let content = std::io::Cursor::default();
        let file = Failing { content, left, error, calls: 0 };
        let (early, _due) = channel();
        let mut output = Output { file: BufWriter::with_capacity(16, file), position: 0, asked: 0, early };
        let result = write_all(&mut output, &frame, &header, None);
        let (file, _) = output.file.into_parts();
        (result, file.content.into_inner())
    };
    let (result, content) = run(usize::MAX, Errno::IO);
    result.unwrap();
    assert_eq!(content, expected, "short writes and interrupts");
    // The offset table is written twice: zeros first.
    for left in 0..expected.len() {
        for error in [Errno::NOSPC, Errno::IO, Errno::DQUOT, Errno::FBIG] {
            let (result, _) = run(left, error);
            let Err(Error::Io { source, .. }) = result else { panic!("{left}: {error} was not told") };
            assert_eq!(source.raw_os_error(), Some(error.raw_os_error()), "{left}");
        }
    }
}
