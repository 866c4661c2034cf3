//! Reading little-endian numbers and names from a slice that may end too early.

use super::Error;

/// What is left of a byte slice, and what is being read for the message if it ends.
pub(super) struct Bytes<'a> {
    rest: &'a [u8],
    length: usize,
    /// Named by [`Error::Truncated`].
    pub(super) place: &'static str,
}

impl<'a> Bytes<'a> {
    pub(super) fn new(bytes: &'a [u8], place: &'static str) -> Self {
        Self { rest: bytes, length: bytes.len(), place }
    }

    /// Number of bytes read so far.
    pub(super) fn position(&self) -> usize {
        self.length - self.rest.len()
    }

    pub(super) fn is_empty(&self) -> bool {
        self.rest.is_empty()
    }

    fn truncated(&self) -> Error {
        Error::Truncated { place: self.place.into() }
    }

    pub(super) fn take(&mut self, count: usize) -> Result<&'a [u8], Error> {
        let (taken, rest) = self.rest.split_at_checked(count).ok_or_else(|| self.truncated())?;
        self.rest = rest;
        Ok(taken)
    }

    fn array<const N: usize>(&mut self) -> Result<[u8; N], Error> {
        let (taken, rest) = self.rest.split_first_chunk::<N>().ok_or_else(|| self.truncated())?;
        self.rest = rest;
        Ok(*taken)
    }

    pub(super) fn u8(&mut self) -> Result<u8, Error> {
        Ok(u8::from_le_bytes(self.array()?))
    }

    pub(super) fn u32(&mut self) -> Result<u32, Error> {
        Ok(u32::from_le_bytes(self.array()?))
    }

    pub(super) fn i32(&mut self) -> Result<i32, Error> {
        Ok(i32::from_le_bytes(self.array()?))
    }

    pub(super) fn u64(&mut self) -> Result<u64, Error> {
        Ok(u64::from_le_bytes(self.array()?))
    }

    /// A name that a zero ends: at most 255 bytes, empty where a list ends.
    pub(super) fn name(&mut self) -> Result<&'a [u8], Error> {
        let window = self.rest.get(..256).unwrap_or(self.rest);
        let Some(length) = window.iter().position(|&byte| byte == 0) else {
            let message = format!("a name in {} is longer than 255 bytes", self.place);
            return Err(if window.len() == 256 { Error::damaged(message) } else { self.truncated() });
        };
        let name = self.take(length)?;
        self.take(1)?;
        Ok(name)
    }
}
