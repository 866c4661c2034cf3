//! What reading a volume may take.

use super::Error;

/// What reading a volume may take, and which files it may open.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Limits {
    /// Bytes of memory for the voxels and what is made from them.
    pub bytes: u64,
    /// Whether a header may name a file outside its own folder.
    pub outside: bool,
}

impl Default for Limits {
    /// As much memory as there is; no file outside the header's folder.
    fn default() -> Self {
        Self { bytes: u64::MAX, outside: false }
    }
}

impl Limits {
    /// That so many voxels fit, each taking `each` bytes at the peak.
    ///
    /// # Errors
    /// [`Error::Volume`] if they do not.
    pub fn voxels(&self, size: [usize; 3], each: u64) -> Result<(), Error> {
        let need = size.iter().try_fold(each, |product, &n| product.checked_mul(n as u64));
        match need {
            Some(need) if need <= self.bytes => Ok(()),
            _ => {
                let [x, y, z] = size;
                let need = need.map_or("more than any".into(), |need| format!("{} MB of", need / 1_000_000));
                let granted = self.bytes / 1_000_000;
                Err(Error::Volume(format!(
                    "{x}x{y}x{z} voxels need {need} memory, {granted} MB are granted (--memory)"
                )))
            }
        }
    }
}
