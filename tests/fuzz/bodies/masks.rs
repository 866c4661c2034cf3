//! Mask files: PNG images and EXR frames.

use lacuna::mask::MaskFile;
use lacuna_exr::Limits;

/// The bytes are a file.
pub fn body(data: &[u8]) {
    for name in ["masks.png", "masks.exr"] {
        let path = super::file(name, data);
        let _ = MaskFile::read(&path, Limits { bytes: super::MOST });
    }
}
