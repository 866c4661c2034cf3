//! Mask files, read once for all frames that share them.

use std::io::Read;
use std::path::{Path, PathBuf};
use std::sync::{Arc, Mutex, PoisonError};

use super::batch::Failure;
use crate::frame::{self, Limits};
use crate::mask::MaskFile;

/// The first bytes of an EXR file.
const EXR: [u8; 4] = [0x76, 0x2f, 0x31, 0x01];

/// The last mask file that was read.
#[derive(Default)]
pub struct MaskFiles {
    last: Mutex<Option<(PathBuf, Arc<MaskFile>)>>,
}

impl MaskFiles {
    /// The mask file at that path.
    pub fn get(&self, path: &Path, limits: Limits) -> Result<Arc<MaskFile>, Failure> {
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

/// Reads a mask file: EXR by its first bytes, else PNG.
pub fn read(path: &Path, limits: Limits) -> Result<MaskFile, Failure> {
    let mut start = [0; 4];
    frame::open_regular(path)
        .and_then(|mut file| file.read_exact(&mut start))
        .map_err(|error| Failure::at(path, format!("cannot read the mask: {error}")))?;
    if start == EXR {
        let frame = frame::read(path, &limits).map_err(|error| Failure::at(path, error))?;
        return Ok(MaskFile::from_frame(path.display().to_string(), frame));
    }
    MaskFile::read_png(path).map_err(|error| Failure::at(path, error))
}
