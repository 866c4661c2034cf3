//! EXR files: what is read is written, and comes back with every bit.

use lacuna_exr::{Compression, Error, Frame, Limits, WriteOptions, read, write};

/// The bytes are a file.
pub fn body(data: &[u8]) {
    let path = super::file("exr.exr", data);
    let Ok(mut frame) = read(&path, &Limits { bytes: super::MOST }) else { return };
    for part in frame.parts.iter_mut().filter(|part| !part.compression.is_lossless()) {
        part.compression = Compression::Zip;
    }
    let out = super::folder().join("exr-out.exr");
    match write(&frame, &out, &WriteOptions::default()) {
        Ok(()) => {}
        // What no file can hold.
        Err(Error::Unwritable(_)) => return,
        Err(error) => panic!("{error}"),
    }
    let again = read(&out, &Limits { bytes: 2 * super::MOST }).unwrap();
    same(&frame, &again);
}

/// Equal parts, channels and bits.
fn same(before: &Frame, after: &Frame) {
    assert_eq!(before.parts.len(), after.parts.len());
    for (before, after) in before.parts.iter().zip(&after.parts) {
        assert_eq!((before.data_window, before.display_window), (after.data_window, after.display_window));
        assert_eq!(before.channels.len(), after.channels.len());
        for channel in &before.channels {
            // A file may name a channel twice, or not in order.
            let mut found = after.channels.iter().filter(|other| other.name == channel.name);
            assert!(
                found.any(|other| other.samples.same_bits(&channel.samples)),
                "{}",
                channel.display_name()
            );
        }
    }
}
