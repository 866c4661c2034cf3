//! Every item once, in order, by any number of threads.

use std::sync::atomic::{AtomicUsize, Ordering};

use super::*;

fn on<R: Send>(threads: usize, work: impl FnOnce() -> R + Send) -> R {
    rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap().install(work)
}

const THREADS: [usize; 4] = [1, 2, 3, 8];
const LENGTHS: [usize; 8] = [0, 1, 2, 3, 7, 64, 1000, 1001];

#[test]
fn every_item_is_visited_once_with_its_number() {
    for (threads, len) in THREADS.into_iter().flat_map(|t| LENGTHS.map(|len| (t, len))) {
        on(threads, || {
            let mut values = vec![0; len];
            values.par_iter_mut().enumerate().for_each(|(i, value)| *value += i + 1);
            assert_eq!(values, (1..=len).collect::<Vec<_>>());
            assert_eq!((0..len).into_par_iter().map(|i| 2 * i), (0..len).map(|i| 2 * i).collect::<Vec<_>>());
            assert_eq!(values.clone().into_par_iter().map(|value| value), values);
        });
    }
}

#[test]
fn chunks_are_those_of_one_thread() {
    for (threads, len) in THREADS.into_iter().flat_map(|t| LENGTHS.map(|len| (t, len))) {
        on(threads, || {
            let from: Vec<usize> = (0..len).collect();
            for size in [1, 2, 3, 10, 1000, 5000] {
                let mut to = vec![(0, 0); len];
                to.par_chunks_mut(size).zip(from.par_chunks(size)).enumerate().for_each(
                    |(chunk, (to, from))| {
                        assert_eq!(to.len(), from.len());
                        to.iter_mut().zip(from).for_each(|(to, from)| *to = (chunk, *from));
                    },
                );
                assert!(to.iter().enumerate().all(|(i, value)| *value == (i / size, i)));
            }
        });
    }
}

#[test]
fn the_shorter_of_two_ends_both() {
    let (long, short) = (vec![1; 100], vec![2; 37]);
    let sums = on(3, || long.par_iter().zip(&short).zip(0..1000).map(|((a, b), c)| a + b + c));
    assert_eq!(sums, (3..40).collect::<Vec<_>>());
}

#[test]
fn one_item_is_enough_for_not_all() {
    for (threads, len) in THREADS.into_iter().flat_map(|t| LENGTHS.map(|len| (t, len))) {
        on(threads, || {
            assert!((0..len).into_par_iter().all(|i| i < len));
            assert!((0..len).all(|wrong| !(0..len).into_par_iter().all(|i| i != wrong)));
        });
    }
}

#[test]
fn tasks_keep_to_their_limits() {
    let tasks = |parts: Limited<Indices>| {
        let count = AtomicUsize::new(0);
        parts.for_each_init(|| count.fetch_add(1, Ordering::Relaxed), |_, _| ());
        count.into_inner()
    };
    for threads in THREADS {
        on(threads, || {
            assert_eq!(tasks((0..100).into_par_iter().with_min_len(usize::MAX)), 1);
            assert_eq!(tasks((0..99).into_par_iter().with_min_len(50)), 1);
            assert!((2..=10).contains(&tasks((0..100).into_par_iter().with_min_len(10))));
            assert_eq!(tasks((0..100).into_par_iter().with_max_len(1)), 100);
        });
    }
}

#[test]
fn what_is_made_for_a_task_is_kept_within_it() {
    let seen = on(4, || {
        (0..500).into_par_iter().map_init(Vec::new, |seen, i| {
            seen.push(i);
            (i, seen.windows(2).all(|pair| pair[0] + 1 == pair[1]))
        })
    });
    assert!(seen.into_iter().enumerate().all(|(i, (item, in_order))| item == i && in_order));
}

#[test]
#[should_panic(expected = "the 60th")]
fn a_panic_reaches_the_caller() {
    on(3, || (0..100).into_par_iter().for_each(|i| assert_ne!(i, 60, "the 60th")));
}
