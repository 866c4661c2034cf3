//! Mask files, read once for all frames that share them.

use std::path::{Path, PathBuf};
use std::sync::{Arc, Mutex, PoisonError};

use lacuna_exr::Limits;

use crate::mask::{Error, MaskFile};

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
        let file = Arc::new(MaskFile::read(path, limits)?);
        *last = Some((path.into(), Arc::clone(&file)));
        Ok(file)
    }
}
