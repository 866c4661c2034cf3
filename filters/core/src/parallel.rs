//! Loops over parts of buffers, shared out among rayon's threads.
//!
//! Named and used like rayon's indexed iterators: `rows.par_chunks_mut(width).zip(..).enumerate().for_each(..)`. Rayon's compile
//! their scheduler anew for every closure, a fifth of all there was to compile; here it is compiled once ([`fork`]), the halving once
//! for every kind of parts, and only the loop over the items of a task for every closure. Tasks are halved as rayon halves them: once
//! a thread, and again where another thread has taken one over.
//!
//! Results come in the order of the parts, whatever the number of threads. Nothing else is offered: a sum is folded from
//! them, in their order.

use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Mutex, PoisonError};

mod parts;

/// What a module that loops this way imports.
pub mod prelude {
    pub use super::{IntoParallel, Parallel, ParallelSlice};
}

pub use parts::{
    Chunks, ChunksMut, Enumerate, Indices, IntoParallel, Items, ItemsMut, Limited, ParallelSlice, Zip,
};

/// A sequence that can be cut in two, for two threads.
pub trait Parallel: Sized + Send {
    /// What a closure gets.
    type Item;

    /// Number of items.
    fn len(&self) -> usize;

    /// The first `at` items, and the others.
    fn split_at(self, at: usize) -> (Self, Self);

    /// The items, in order, for one thread.
    fn items(self) -> impl Iterator<Item = Self::Item>;

    /// Items that one task has at least, and at most unless that is fewer.
    fn limits(&self) -> (usize, usize) {
        (1, usize::MAX)
    }

    /// Whether there is no item.
    fn is_empty(&self) -> bool {
        self.len() == 0
    }

    /// Items with their numbers, from 0.
    fn enumerate(self) -> Enumerate<Self> {
        Enumerate::new(self)
    }

    /// Items beside those of `other`; as many as the shorter has.
    fn zip<P: IntoParallel>(self, other: P) -> Zip<Self, P::Parts> {
        Zip::new(self, other.into_par_iter())
    }

    /// At least `least` items a task.
    fn with_min_len(self, least: usize) -> Limited<Self> {
        Limited::new(self, (least, usize::MAX))
    }

    /// Shares them out only if `shared`; otherwise they are one task, of the calling thread.
    fn shared_if(self, shared: bool) -> Limited<Self> {
        self.with_min_len(if shared { 1 } else { usize::MAX })
    }

    /// At most `most` items a task.
    fn with_max_len(self, most: usize) -> Limited<Self> {
        Limited::new(self, (1, most))
    }

    /// Calls `task` for each item.
    fn for_each(self, task: impl Fn(Self::Item) + Sync) {
        share(self, &|parts: Self| parts.items().for_each(&task));
    }

    /// Calls `task` for each item, with what `init` makes for each task.
    fn for_each_init<W>(self, init: impl Fn() -> W + Sync, task: impl Fn(&mut W, Self::Item) + Sync) {
        share(self, &|parts: Self| {
            let mut with = init();
            parts.items().for_each(|item| task(&mut with, item));
        });
    }

    /// Whether `holds` for every item; not all are looked at if not.
    fn all(self, holds: impl Fn(Self::Item) -> bool + Sync) -> bool {
        let all = AtomicBool::new(true);
        share(self, &|parts: Self| {
            if all.load(Ordering::Relaxed) && !parts.items().all(&holds) {
                all.store(false, Ordering::Relaxed);
            }
        });
        all.into_inner()
    }

    /// What `task` makes of each item, in order.
    fn map<R: Send>(self, task: impl Fn(Self::Item) -> R + Sync) -> Vec<R> {
        collect(self, &|parts: Self| parts.items().map(&task).collect())
    }

    /// What `task` makes of each item, with what `init` makes for each task, in order.
    fn map_init<W, R: Send>(
        self,
        init: impl Fn() -> W + Sync,
        task: impl Fn(&mut W, Self::Item) -> R + Sync,
    ) -> Vec<R> {
        collect(self, &|parts: Self| {
            let mut with = init();
            parts.items().map(|item| task(&mut with, item)).collect()
        })
    }
}

/// Runs both, on two threads if one is idle; each is told whether another thread than the caller's has taken it over.
#[inline(never)]
pub fn fork(left: &mut (dyn FnMut(bool) + Send), right: &mut (dyn FnMut(bool) + Send)) {
    rayon::join_context(|context| left(context.migrated()), |context| right(context.migrated()));
}

/// Runs both, on two threads if one is idle, and returns what they return.
pub fn join<A: Send, B: Send>(left: impl FnOnce() -> A + Send, right: impl FnOnce() -> B + Send) -> (A, B) {
    rayon::join(left, right)
}

/// How often parts are still to be halved.
#[derive(Clone, Copy)]
struct Halving {
    times: usize,
    least: usize,
}

impl Halving {
    #[inline(never)]
    fn new(len: usize, (least, most): (usize, usize)) -> Self {
        Self { times: rayon::current_num_threads().max(len / most.max(1)), least: least.max(1) }
    }

    /// What is left after halving `len` items; nothing if they are one task.
    #[inline(never)]
    fn again(self, len: usize, moved: bool) -> Option<Self> {
        if len / 2 < self.least || (self.times == 0 && !moved) {
            return None;
        }
        // A task that was taken over shows that threads are idle.
        let least = if moved { rayon::current_num_threads() } else { 0 };
        Some(Self { times: (self.times / 2).max(least), ..self })
    }
}

/// Shares parts out among the threads.
fn share<P: Parallel>(parts: P, task: &(dyn Fn(P) + Sync)) {
    halve(Halving::new(parts.len(), parts.limits()), false, parts, task);
}

/// The results of all tasks, in the order of their parts.
fn collect<P: Parallel, R: Send>(parts: P, task: &(dyn Fn(P) -> Vec<R> + Sync)) -> Vec<R> {
    let done = Mutex::new((Vec::new(), Vec::new()));
    share(parts.enumerate(), &|parts: Enumerate<P>| {
        let first = parts.first();
        let results = task(parts.into_inner());
        let mut done = done.lock().unwrap_or_else(PoisonError::into_inner);
        done.0.push(first);
        done.1.push(results);
    });
    let (firsts, mut done) = done.into_inner().unwrap_or_else(PoisonError::into_inner);
    let mut order = ascending(&firsts).into_iter();
    let mut all = order.next().map(|k| std::mem::take(&mut done[k])).unwrap_or_default();
    order.for_each(|k| all.append(&mut done[k]));
    all
}

/// The places of numbers, that of the least number first. Sorting results themselves would compile a sort for every kind of them.
#[inline(never)]
fn ascending(numbers: &[usize]) -> Vec<usize> {
    let mut order: Vec<usize> = (0..numbers.len()).collect();
    order.sort_unstable_by_key(|&k| numbers[k]);
    order
}

fn halve<P: Parallel>(halving: Halving, moved: bool, parts: P, task: &(dyn Fn(P) + Sync)) {
    let len = parts.len();
    let Some(halving) = halving.again(len, moved) else {
        return task(parts);
    };
    let (left, right) = parts.split_at(len / 2);
    let (mut left, mut right) = (Some(left), Some(right));
    let mut first = |moved| left.take().into_iter().for_each(|parts| halve(halving, moved, parts, task));
    let mut second = |moved| right.take().into_iter().for_each(|parts| halve(halving, moved, parts, task));
    fork(&mut first, &mut second);
}

#[cfg(test)]
mod tests;
