//! Mask files, read once for all frames that share them.

use std::io::Read;
use std::path::{Path, PathBuf};
use std::sync::{Arc, Mutex, PoisonError};

use crate::frame::{self, Limits};
use crate::mask::{Error, MaskFile};

/// The first bytes of an EXR file.
const EXR: [u8; 4] = [0x76, 0x2f, 0x31, 0x01];

/// The first bytes of a PNG image.
const PNG: [u8; 8] = [0x89, b'P', b'N', b'G', b'\r', b'\n', 0x1a, b'\n'];

/// The last mask file that was read.
#[derive(Default)]
pub struct MaskFiles {
    last: Mutex<Option<(PathBuf, Arc<MaskFile>)>>,
}

impl MaskFiles {
    /// The mask file at that path.
    pub fn get(&self, path: &Path, limits: Limits) -> Result<Arc<MaskFile>, Error> {
        // Held while the file is read: frames that share it wait instead of reading it again.
        let mut last = self.last.lock().unwrap_or_else(PoisonError::into_inner);
        if let Some((known, file)) = &*last
            && known == path
        {
            return Ok(Arc::clone(file));
        }
        let file = Arc::new(read(path, limits)?);
        *last = Some((path.into(), Arc::clone(&file)));
        Ok(file)
    }
}

/// Reads a mask file: EXR or PNG, by its first bytes.
pub fn read(path: &Path, limits: Limits) -> Result<MaskFile, Error> {
    let name = path.display().to_string();
    let fail = |why: String| Error::File { path: name.clone(), why };
    let mut start = Vec::new();
    let file = frame::open_regular(path);
    file.and_then(|file| file.take(8).read_to_end(&mut start)).map_err(|error| fail(match &*name {
        // A mask takes the number of its frame, not whatever is there.
        glob if glob.contains(['*', '?']) => format!(
            "{error}; a mask takes a pattern such as mask.####.exr, which goes frame by frame, but no glob"
        ),
        _ => error.to_string(),
    }))?;
    if start.starts_with(&EXR) {
        let frame = frame::read(path, &limits).map_err(|error| fail(error.to_string()))?;
        return Ok(MaskFile::from_frame(name, frame));
    }
    if start == PNG {
        return MaskFile::read_png(path);
    }
    let ending = path.extension().map(|ending| ending.to_string_lossy().to_ascii_lowercase());
    Err(fail(match ending.as_deref() {
        Some("exr") => "not an EXR file".into(),
        Some("png") => "not a PNG image".into(),
        _ => "neither an EXR file nor a PNG image".into(),
    }))
}
