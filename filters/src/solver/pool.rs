//! Buffers that serve one task after another: memory that is not new costs no page faults.

use std::ops::{Deref, DerefMut};
use std::sync::{Mutex, PoisonError};

/// Buffers that nobody uses now.
#[derive(Debug, Default)]
pub struct Pool<B>(Mutex<Vec<B>>);

/// A buffer that goes back to its pool.
#[derive(Debug)]
pub struct Lent<'a, B: Default> {
    own: B,
    pool: &'a Pool<B>,
}

impl<B: Default> Pool<B> {
    /// A buffer as its last user left it, or a new one.
    pub fn lend(&self) -> Lent<'_, B> {
        let own = self.0.lock().unwrap_or_else(PoisonError::into_inner).pop().unwrap_or_default();
        Lent { own, pool: self }
    }
}

impl<B: Default> Drop for Lent<'_, B> {
    fn drop(&mut self) {
        self.pool.0.lock().unwrap_or_else(PoisonError::into_inner).push(std::mem::take(&mut self.own));
    }
}

impl<B: Default> Deref for Lent<'_, B> {
    type Target = B;

    fn deref(&self) -> &B {
        &self.own
    }
}

impl<B: Default> DerefMut for Lent<'_, B> {
    fn deref_mut(&mut self) -> &mut B {
        &mut self.own
    }
}
