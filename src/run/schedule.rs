//! Several frames on the way at once: one is read while another is solved and a third is written.
//!
//! A few threads each take the next frame through all its stages. Solving needs one of `parallel_frames` permits, so
//! the threads beyond those read ahead or write behind. A frame starts only when its memory fits beside that of the
//! frames on the way; frames start in order, so a large one is not overtaken for ever. The order in which frames end
//! changes no bit of them.

use std::collections::BTreeSet;
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::sync::atomic::{AtomicU64, Ordering};
use std::sync::{Condvar, Mutex, MutexGuard, PoisonError};

/// How much may happen at once.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Limits {
    /// Frames that are solved at the same time; at least 1.
    pub parallel_frames: usize,
    /// Further frames that are read ahead or written behind.
    pub overlap: usize,
    /// Bytes that the frames on the way may need together; no bound if `None`.
    pub memory: Option<u64>,
}

/// Bytes that a frame may need, by what is known before it is read.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Need {
    /// At least: a frame that needs more than the bound is refused.
    pub least: u64,
    /// At most: so much, or all that the bound allows, is held for it until it [settles](Share::settle) or [eases](Share::ease).
    pub most: u64,
}

impl From<u64> for Need {
    fn from(bytes: u64) -> Self {
        Self { least: bytes, most: bytes }
    }
}

/// Why a frame gave no result.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Refusal {
    /// The frame alone needs more than the bound.
    TooLarge {
        /// Bytes that it needs.
        needed: u64,
        /// The bound in bytes.
        bound: u64,
    },
    /// The work panicked: a defect, with its message.
    Panic(String),
    /// The run was stopped before this frame began.
    NotStarted,
}

/// What a frame asks for a permit to solve, which it holds meanwhile.
pub struct Permits<'a> {
    free: &'a Counter,
    all: usize,
    /// Its place among the frames: of those that wait, the first is served first.
    place: usize,
}

impl Permits<'_> {
    /// Waits for a permit and solves. With a single permit this runs inside the thread pool, where a loop starts without being handed over. With
    /// several, a thread of the pool that waits for a loop could take up another frame: then it runs outside.
    pub fn solve<T: Send>(&self, solve: impl FnOnce() -> T + Send) -> T {
        let _permit = self.free.take((1, &|| 1), self.place);
        if self.all == 1 { rayon::scope(|_| solve()) } else { solve() }
    }
}

/// The memory that is held for a frame.
pub struct Share<'a> {
    held: Held<'a>,
    bound: u64,
}

impl Share<'_> {
    /// Holds no more than `needed`, now that the frame was looked at.
    ///
    /// # Errors
    /// [`Refusal::TooLarge`].
    pub fn settle(&self, needed: u64) -> Result<(), Refusal> {
        self.held.counter.check(needed, self.bound)?;
        self.ease(needed);
        Ok(())
    }

    /// Holds no more than so much.
    pub fn ease(&self, most: u64) {
        self.held.shrink(most);
    }

    /// What is held for this frame includes so much that stays until the run ends: no frame gets it any more.
    pub fn keep(&self, bytes: u64) {
        self.held.keep(bytes);
    }
}

/// Runs `work` on every item and returns the results in the items' order. `need` estimates an item's bytes;
/// `stopped` ends the run before the next item.
pub fn run<I: Sync, T: Send>(
    items: &[I],
    limits: Limits,
    need: impl Fn(&I) -> Need + Sync,
    work: impl Fn(usize, &I, (&Permits<'_>, &Share<'_>)) -> T + Sync,
    refused: impl Fn(usize, &I, Refusal) -> T + Sync,
    stopped: impl Fn() -> bool + Sync,
) -> Vec<T> {
    let all = limits.parallel_frames.max(1);
    let free = Counter::new(all as u64);
    let bound = limits.memory.unwrap_or(u64::MAX);
    let memory = Counter::new(bound);
    let next = Mutex::new(0);
    let results: Mutex<Vec<Option<T>>> = Mutex::new(items.iter().map(|_| None).collect());
    let worker = || {
        loop {
            // The queue stays locked until the frame is admitted: frames start in order.
            let mut queue = lock(&next);
            let index = *queue;
            let Some(item) = items.get(index) else { return };
            *queue += 1;
            let outcome = if stopped() {
                drop(queue);
                Err(Refusal::NotStarted)
            } else {
                let Need { least, most } = limits.memory.map_or(0.into(), |_| estimate(&need, item));
                let again = || estimate(&need, item).most;
                let held = memory.check(least, bound).map(|()| memory.take((most, &again), index));
                drop(queue);
                held.and_then(|held| {
                    let share = Share { held, bound };
                    let permits = Permits { free: &free, all, place: index };
                    catch_unwind(AssertUnwindSafe(|| work(index, item, (&permits, &share))))
                        .map_err(|panic| Refusal::Panic(message(panic.as_ref())))
                })
            };
            let result = outcome.unwrap_or_else(|refusal| refused(index, item, refusal));
            lock(&results)[index] = Some(result);
        }
    };
    let threads = (all + limits.overlap).min(items.len()).max(1);
    std::thread::scope(|scope| {
        for _ in 1..threads {
            scope.spawn(worker);
        }
        worker();
    });
    let results = results.into_inner().unwrap_or_else(PoisonError::into_inner);
    results.into_iter().flatten().collect()
}

/// The estimate; nothing if it panics, as the work on that frame will, which says so.
fn estimate<I>(need: impl Fn(&I) -> Need, item: &I) -> Need {
    catch_unwind(AssertUnwindSafe(|| need(item))).unwrap_or(0.into())
}

/// What a panic said.
pub fn message(panic: &(dyn std::any::Any + Send)) -> String {
    let text = panic.downcast_ref::<&str>().map(ToString::to_string);
    text.or_else(|| panic.downcast_ref::<String>().cloned()).unwrap_or_else(|| "unknown".into())
}

/// A number of units to be had and given back.
struct Counter {
    state: Mutex<Units>,
    changed: Condvar,
}

struct Units {
    free: u64,
    /// Those that are free or held.
    all: u64,
    /// The places of those that wait.
    waiting: BTreeSet<usize>,
}

/// Units held.
struct Held<'a> {
    counter: &'a Counter,
    units: AtomicU64,
}

impl Counter {
    const fn new(units: u64) -> Self {
        let units = Units { free: units, all: units, waiting: BTreeSet::new() };
        Self { state: Mutex::new(units), changed: Condvar::new() }
    }

    /// That `needed` are not more than there are, of `bound` at first.
    fn check(&self, needed: u64, bound: u64) -> Result<(), Refusal> {
        let kept = bound - lock(&self.state).all;
        let needed = needed.saturating_add(kept);
        if needed > bound { Err(Refusal::TooLarge { needed, bound }) } else { Ok(()) }
    }

    /// Waits until `most` or all are free and nobody of a lower place waits, and takes them. What would take all asks `again` meanwhile.
    fn take(&self, (mut most, again): (u64, &dyn Fn() -> u64), place: usize) -> Held<'_> {
        let mut state = lock(&self.state);
        state.waiting.insert(place);
        while state.free < most.min(state.all) || state.waiting.first() != Some(&place) {
            state = self.changed.wait(state).unwrap_or_else(PoisonError::into_inner);
            if most >= state.all {
                most = again();
            }
        }
        state.waiting.remove(&place);
        let units = most.min(state.all);
        state.free -= units;
        drop(state);
        // Units may be left for the next.
        self.changed.notify_all();
        Held { counter: self, units: AtomicU64::new(units) }
    }
}

impl Held<'_> {
    /// Gives back what is beyond `units`.
    fn shrink(&self, units: u64) {
        let held = self.units.fetch_min(units, Ordering::Relaxed);
        lock(&self.counter.state).free += held.saturating_sub(units);
        self.counter.changed.notify_all();
    }

    /// Takes so many of those held out of all.
    fn keep(&self, units: u64) {
        let held = self.units.load(Ordering::Relaxed);
        let kept = units.min(held);
        self.units.store(held - kept, Ordering::Relaxed);
        lock(&self.counter.state).all -= kept;
        self.counter.changed.notify_all();
    }
}

impl Drop for Held<'_> {
    fn drop(&mut self) {
        self.shrink(0);
    }
}

/// Locks; what a panicking thread left behind is still whole, for each update is a single assignment.
fn lock<T>(mutex: &Mutex<T>) -> MutexGuard<'_, T> {
    mutex.lock().unwrap_or_else(PoisonError::into_inner)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn limits(parallel_frames: usize, overlap: usize, memory: Option<u64>) -> Limits {
        Limits { parallel_frames, overlap, memory }
    }

    #[test]
    fn results_come_in_the_items_order() {
        let items: Vec<u64> = (0..50).collect();
        for (parallel, overlap, memory) in [(1, 0, None), (1, 2, Some(3)), (4, 2, Some(1)), (3, 0, None)] {
            let results = run(
                &items,
                limits(parallel, overlap, memory),
                |_| 1.into(),
                |index, item, (permits, _)| {
                    permits.solve(|| std::thread::sleep(std::time::Duration::from_micros(50 * (item % 3))));
                    (index as u64, item * item)
                },
                |_, _, refusal| panic!("{refusal:?}"),
                || false,
            );
            assert_eq!(results, items.iter().map(|&i| (i, i * i)).collect::<Vec<_>>());
        }
    }

    #[test]
    fn frames_that_wait_are_solved_in_order() {
        let (items, order): (Vec<usize>, _) = ((0..30).collect(), Mutex::new(Vec::new()));
        let held = AtomicU64::new(0);
        run(
            &items,
            limits(1, 29, None),
            |_| 0.into(),
            |_, &item, (permits, _)| {
                while item != 0 && held.load(Ordering::SeqCst) == 0 {
                    std::thread::yield_now();
                }
                permits.solve(|| {
                    held.store(1, Ordering::SeqCst);
                    // The first goes on when all others wait, who came in any order.
                    while item == 0 && lock(&permits.free.state).waiting.len() < 29 {
                        std::thread::yield_now();
                    }
                    lock(&order).push(item);
                });
            },
            |_, _, refusal| panic!("{refusal:?}"),
            || false,
        );
        assert_eq!(order.into_inner().unwrap(), items);
    }

    #[test]
    fn the_bounds_hold() {
        let (solving, most_solving) = (AtomicU64::new(0), AtomicU64::new(0));
        let (bytes, most_bytes) = (AtomicU64::new(0), AtomicU64::new(0));
        let items = [5_u64, 1, 1, 7, 3, 2, 10, 1, 1, 1, 4, 6];
        run(
            &items,
            limits(2, 3, Some(10)),
            |&need| need.into(),
            |_, &need, (permits, _)| {
                most_bytes.fetch_max(bytes.fetch_add(need, Ordering::SeqCst) + need, Ordering::SeqCst);
                permits.solve(|| {
                    most_solving.fetch_max(solving.fetch_add(1, Ordering::SeqCst) + 1, Ordering::SeqCst);
                    std::thread::sleep(std::time::Duration::from_millis(2));
                    solving.fetch_sub(1, Ordering::SeqCst);
                });
                bytes.fetch_sub(need, Ordering::SeqCst);
            },
            |_, _, refusal| panic!("{refusal:?}"),
            || false,
        );
        assert!(most_bytes.into_inner() <= 10);
        assert!(most_solving.into_inner() <= 2);
    }

    #[test]
    fn a_frame_that_cannot_fit_is_refused_and_the_rest_done() {
        let results = run(
            &[1_u64, 11, 2],
            limits(1, 1, Some(10)),
            |&need| need.into(),
            |_, &need, _| Ok(need),
            |_, _, refusal| Err(refusal),
            || false,
        );
        assert_eq!(results, [Ok(1), Err(Refusal::TooLarge { needed: 11, bound: 10 }), Ok(2)]);
    }

    #[test]
    fn what_a_frame_does_not_need_is_given_back() {
        // The second fits beside the first once that has settled; the fourth turns out to be too large.
        let items = [(9, 1), (9, 3), (9, 4), (12, 11), (12, 2)];
        let settled = AtomicU64::new(0);
        let results = run(
            &items,
            limits(3, 0, Some(10)),
            |&(most, _)| Need { least: 1, most },
            |index, &(_, needed), (_, share)| {
                share.settle(needed)?;
                settled.fetch_add(1, Ordering::SeqCst);
                // Unless the first gives back what is beyond its need, this waits for ever.
                while index == 0 && settled.load(Ordering::SeqCst) == 1 {
                    std::thread::yield_now();
                }
                Ok(needed)
            },
            |_, _, refusal| Err(refusal),
            || false,
        );
        let refusal = Refusal::TooLarge { needed: 11, bound: 10 };
        assert_eq!(results, [Ok(1), Ok(3), Ok(4), Err(refusal), Ok(2)]);
    }

    #[test]
    fn what_is_kept_is_taken_from_the_bound_of_all() {
        let (there, bytes, most) = (AtomicU64::new(0), AtomicU64::new(0), AtomicU64::new(0));
        let take = |more| most.fetch_max(bytes.fetch_add(more, Ordering::SeqCst) + more, Ordering::SeqCst);
        let results = run(
            &[3_u64, 3, 3, 6, 7, 3, 3],
            limits(7, 0, Some(10)),
            |&need| Need {
                least: need,
                most: if there.load(Ordering::SeqCst) == 0 { u64::MAX } else { need },
            },
            |_, &need, (_, share)| {
                if there.fetch_add(1, Ordering::SeqCst) == 0 {
                    take(4);
                    share.keep(4);
                }
                share.ease(need);
                take(need);
                std::thread::sleep(std::time::Duration::from_millis(2));
                bytes.fetch_sub(need, Ordering::SeqCst);
                Ok(need)
            },
            |_, _, refusal| Err(refusal),
            || false,
        );
        let refusal = Refusal::TooLarge { needed: 11, bound: 10 };
        assert_eq!(results, [Ok(3), Ok(3), Ok(3), Ok(6), Err(refusal), Ok(3), Ok(3)]);
        assert!(most.into_inner() <= 10);
    }

    #[test]
    fn a_panic_is_one_frames_failure() {
        let results = run(
            &[1, 0, 2],
            limits(1, 0, None),
            |_| 0.into(),
            |_, item, (permits, _)| {
                permits.solve(|| assert!(*item != 0, "item {item}"));
                Ok(*item)
            },
            |_, _, refusal| Err(refusal),
            || false,
        );
        assert_eq!(results, [Ok(1), Err(Refusal::Panic("item 0".into())), Ok(2)]);
    }

    #[test]
    fn an_estimate_that_panics_stops_nothing() {
        let need = |item: &i32| if *item == 0 { panic!("item 0") } else { 1.into() };
        let work = |_, &item: &i32, _: (&Permits<'_>, &Share<'_>)| Ok(item);
        let results =
            run(&[1, 0, 2], limits(1, 1, Some(9)), need, work, |_, _, refusal| Err(refusal), || false);
        assert_eq!(results, [Ok(1), Ok(0), Ok(2)]);
    }

    #[test]
    fn a_stopped_run_starts_nothing_more() {
        let done = AtomicU64::new(0);
        let results = run(
            &[1, 2, 3],
            limits(1, 0, None),
            |_| 0.into(),
            |_, &item, _| {
                done.fetch_add(1, Ordering::SeqCst);
                Ok(item)
            },
            |_, _, refusal| Err(refusal),
            || done.load(Ordering::SeqCst) > 0,
        );
        assert_eq!(results, [Ok(1), Err(Refusal::NotStarted), Err(Refusal::NotStarted)]);
    }
}
