//! Volume files of every format, read, and resampled to cubes.

use lacuna_volume::read::{RawLayout, read};
use lacuna_volume::{Limits, Scene};

const ENDINGS: [&str; 7] = ["nrrd", "nhdr", "mha", "nii", "nii.gz", "vti", "raw"];
/// Bytes of memory.
const MOST: u64 = 8 << 20;

/// The first byte names the format, the others are the file.
pub fn body(data: &[u8]) {
    let Some((&format, bytes)) = data.split_first() else { return };
    let ending = ENDINGS[usize::from(format) % ENDINGS.len()];
    let name = format!("volumes.{ending}");
    let path = super::file(&name, bytes);
    let limits = Limits { bytes: MOST, outside: false };
    // A file without a header says how it lies in its first line.
    let layout =
        String::from_utf8_lossy(bytes.split(|byte| *byte == b'\n').next().unwrap_or_default()).into_owned();
    let raw: Option<RawLayout> = layout.parse().ok().filter(|_| ending == "raw");
    if let Ok(grid) = read(&path, raw.as_ref(), &limits) {
        let (low, high) = grid.range();
        assert!(low.is_finite() && high.is_finite() && low <= high);
    }
    let scene = Scene::parse(&format!("volume = \"{name}\"\nresample = true\n"), &[]).unwrap();
    if let Ok(stage) = lacuna_volume::prepare(&scene, super::folder(), &limits) {
        let _ = stage.camera(1).map(|camera| stage.shader(&camera));
    }
}
