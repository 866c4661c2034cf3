//! Bits into bytes, the lowest first.

/// A buffer of fixed length that is filled bit by bit.
#[derive(Default)]
pub(super) struct Bits {
    out: Vec<u8>,
    at: usize,
    buffer: u64,
    count: u32,
}

impl Bits {
    /// Begins anew, with room for so many bytes.
    pub(super) fn clear(&mut self, room: usize) {
        // What is there is written over.
        self.out.resize(room.max(self.out.len()), 0);
        (self.at, self.buffer, self.count) = (0, 0, 0);
    }

    /// Adds the lowest `count` bits of `value`, whose others are 0. At most 56 bits between two calls of
    /// [`flush`](Self::flush).
    #[inline]
    pub(super) fn add(&mut self, value: u32, count: u32) {
        self.buffer |= u64::from(value) << self.count;
        self.count += count;
    }

    /// Writes whole bytes; fewer than eight bits stay.
    #[inline]
    pub(super) fn flush(&mut self) {
        if let Some(bytes) = self.out.get_mut(self.at..).and_then(|rest| rest.first_chunk_mut()) {
            *bytes = self.buffer.to_le_bytes();
        }
        let whole = self.count / 8;
        self.at += whole as usize;
        self.buffer = self.buffer.checked_shr(8 * whole).unwrap_or(0);
        self.count %= 8;
    }

    /// Zeros up to the next whole byte.
    pub(super) fn align(&mut self) {
        self.count = self.count.next_multiple_of(8);
        self.flush();
    }

    /// Adds bytes, after [`align`](Self::align).
    pub(super) fn bytes(&mut self, bytes: &[u8]) {
        if let Some(place) = self.out.get_mut(self.at..self.at + bytes.len()) {
            place.copy_from_slice(bytes);
        }
        self.at += bytes.len();
    }

    pub(super) fn written(&self) -> &[u8] {
        &self.out[..self.at.min(self.out.len())]
    }
}
