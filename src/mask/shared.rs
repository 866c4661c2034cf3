//! Mask files, read once for all frames that share them.

use std::path::{Path, PathBuf};
use std::sync::{Arc, Mutex, PoisonError};

use lacuna_exr::Limits;

use crate::files::content::State;
use crate::mask::{Error, MaskFile};

/// A file, and its state before it was read.
type Known = (PathBuf, Option<State>);

/// The last mask file that was read.
#[derive(Default)]
pub struct MaskFiles {
    last: Mutex<Option<(Known, Arc<MaskFile>)>>,
}

impl MaskFiles {
    /// The mask file at that path, as it is now.
    pub fn get(&self, path: &Path, limits: Limits) -> Result<Arc<MaskFile>, Error> {
        // Held while the file is read: frames that share it wait instead of reading it again.
        let mut last = self.last.lock().unwrap_or_else(PoisonError::into_inner);
        let now = (path.to_path_buf(), State::of(path));
        if let Some((known, file)) = &*last
            && *known == now
        {
            return Ok(Arc::clone(file));
        }
        let file = Arc::new(MaskFile::read(path, limits)?);
        *last = Some((now, Arc::clone(&file)));
        Ok(file)
    }
}
