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
        let why = match need {
            Some(need) if need > self.bytes => {
                format!("{} MB are granted (--memory)", self.bytes / 1_000_000)
            }
            Some(need) if is_there(need) => return Ok(()),
            _ => "which the system does not give".into(),
        };
        let [x, y, z] = size;
        let need = need.map_or("more than any".into(), |need| format!("{} MB of", need / 1_000_000));
        Err(Error::Volume(format!("{x}x{y}x{z} voxels need {need} memory, {why}")))
    }
}

/// Whether the system gives so much memory. It is given back at once: a failure at this place has a message, a later one ends the process.
pub fn is_there(bytes: u64) -> bool {
    let mut room = Vec::<u8>::new();
    let given = usize::try_from(bytes).is_ok_and(|bytes| room.try_reserve_exact(bytes).is_ok());
    // Or the compiler leaves the reservation out.
    std::hint::black_box(&room);
    given
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn memory_that_is_not_granted_or_not_there_is_refused() {
        let none = Limits { bytes: 1000, outside: false };
        assert!(none.voxels([10, 10, 10], 1).is_ok());
        assert!(
            none.voxels([10, 10, 11], 1).unwrap_err().to_string().contains("0 MB are granted (--memory)")
        );
        let all = Limits::default();
        assert!(
            all.voxels([1 << 10, 1 << 20, 1 << 26], 1).unwrap_err().to_string().contains("does not give")
        );
        assert!(
            all.voxels([usize::MAX, usize::MAX, 2], 5).unwrap_err().to_string().contains("more than any")
        );
        assert!(is_there(1 << 20) && !is_there(1 << 56) && !is_there(u64::MAX));
    }
}
