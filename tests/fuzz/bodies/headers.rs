//! Headers of EXR files: attributes, the memory that they promise, channels and their rules, the mask that would be found.

use lacuna::mask::Source;
use lacuna::{channels, info, mask, verify};
use lacuna_exr::{Limits, memory_needed, read, read_header, read_whole_header};

/// Frames of more bytes are not described.
const MOST: u64 = 1 << 20;

/// The bytes are a file.
pub fn body(data: &[u8]) {
    let path = super::file("headers.exr", data);
    let (parts, whole) = (read_header(&path), read_whole_header(&path));
    assert!(parts.is_ok() || whole.is_err(), "chunks of a file without headers");
    let Ok(parts) = parts else { return };
    let needed = memory_needed(&parts);
    if needed > 0 {
        assert!(read(&path, &Limits { bytes: needed - 1 }).is_err(), "read with less than it promised");
    }
    if needed > MOST {
        return;
    }
    let Ok(frame) = read(&path, &Limits { bytes: needed }) else { return };
    assert!(whole.is_ok(), "a frame that is whole has all of its chunks");
    let _ = verify::Claims::read(&frame);
    let masks = mask::find(&frame, &Source::Auto, None);
    let found = masks.as_ref().map_or(Vec::new(), |masks| masks.mask_channels.clone());
    let choices = channels::choose(&frame, &found, &[]);
    let told = info::describe(&frame, masks.as_ref(), &choices);
    assert!(!told.to_string().is_empty());
    let _ = channels::print_rules(&frame, &choices);
}
