//! The greedy choice: pixel after pixel where the gain is largest, distances being brought up to date after each.
//!
//! A gain only falls as pixels are taken, so an entry that is out of date is found out when its turn comes. Entries wait in buckets by the
//! leading bits of their gains; a heap orders the bucket whose turn it is. Pixels of small gains enter only once all others have had their turn.

use std::cmp::Reverse;
use std::collections::BinaryHeap;

use lacuna_core::parallel::prelude::*;

use crate::Size;

/// Entries at first, over the pixels that are asked for; then as many times as many.
const ENTRIES: usize = 4;
/// Pixels that one task takes.
const PIECE: usize = 1 << 16;
/// Leading bits of a gain by which pixels are counted.
const COUNTED: u32 = 12;
/// Leading bits of a gain by which entries wait.
const SORTED: u32 = 16;
/// The gain of pixels that may not be taken.
const NEVER: u32 = 0;

/// What pixels are chosen by.
pub struct Picks<'a> {
    size: Size,
    /// The squared error per sixth power of the distance.
    coefficient: &'a [f32],
    /// Squared distance to the nearest pixel that is measured or taken.
    squared: Vec<u32>,
    /// Places that changed and whose neighbours may.
    open: Vec<(usize, usize)>,
}

/// Entries in the order of their gains.
struct Queue {
    /// Gains and pixels by the leading bits of the gains.
    waiting: Vec<Vec<(u32, usize)>>,
    /// The bucket whose turn it is: gain, order, pixel.
    heap: BinaryHeap<(u32, Reverse<u64>, Reverse<usize>)>,
    /// Its leading bits; buckets above are empty.
    now: usize,
}

impl Queue {
    fn bucket(gain: u32) -> usize {
        (gain >> (u32::BITS - SORTED)) as usize
    }

    fn new() -> Self {
        Self { waiting: vec![Vec::new(); 1 << SORTED], heap: BinaryHeap::new(), now: (1 << SORTED) - 1 }
    }

    /// The next of those that are worth `least` or more, a whole number of buckets.
    fn pop(
        &mut self,
        least: u32,
        order: &dyn Fn(usize) -> u64,
    ) -> Option<(u32, Reverse<u64>, Reverse<usize>)> {
        while self.heap.is_empty() && self.now > Self::bucket(least) {
            self.now -= 1;
            let entries = std::mem::take(&mut self.waiting[self.now]);
            self.heap = entries
                .into_iter()
                .map(|(gain, pixel)| (gain, Reverse(order(pixel)), Reverse(pixel)))
                .collect();
        }
        self.heap.pop()
    }
}

impl<'a> Picks<'a> {
    pub fn new(size: Size, coefficient: &'a [f32], squared: Vec<u32>) -> Self {
        Self { size, coefficient, squared, open: Vec::new() }
    }

    /// Up to `count` pixels, the most useful first, of those that are `allowed`; of equal gains the one of least `order` first, which
    /// may know the squared distance. Also
    /// the squared distances once they are taken.
    pub fn next(
        mut self,
        count: usize,
        order: &dyn Fn(usize, u32) -> u64,
        allowed: &(dyn Fn(usize) -> bool + Sync),
    ) -> (Vec<usize>, Vec<u32>) {
        let (gains, counts) = self.gains(allowed);
        let mut taken = Vec::with_capacity(count.min(gains.len()));
        let mut queue = Queue::new();
        // Pixels whose gains were `least` or more have entered.
        let (mut least, mut entries) = (u32::MAX, count.saturating_mul(ENTRIES));
        while taken.len() < count {
            let order_now = |pixel: usize| order(pixel, self.squared[pixel]);
            let Some((gain, Reverse(tie), Reverse(pixel))) = queue.pop(least, &order_now) else {
                if least == 0 {
                    break;
                }
                let below = least;
                least = least_of(&counts, entries).min(below);
                entries = entries.saturating_mul(ENTRIES);
                for (gain, pixel) in between(&gains, least, below) {
                    queue.waiting[Queue::bucket(gain)].push((gain, pixel));
                }
                continue;
            };
            let now = gain_of(self.coefficient[pixel], self.squared[pixel]);
            let is_late = now == gain && tie < order_now(pixel);
            if now == gain && !is_late {
                self.take(pixel);
                taken.push(pixel);
            } else if Queue::bucket(now) == queue.now {
                queue.heap.push((now, Reverse(order_now(pixel)), Reverse(pixel)));
            } else {
                queue.waiting[Queue::bucket(now)].push((now, pixel));
            }
        }
        (taken, self.squared)
    }

    /// All gains, and how many pixels have which leading bits.
    fn gains(&self, allowed: &(dyn Fn(usize) -> bool + Sync)) -> (Vec<u32>, Vec<usize>) {
        let mut gains = vec![NEVER; self.squared.len()];
        let values = self.coefficient.par_chunks(PIECE).zip(self.squared.par_chunks(PIECE));
        let pieces = gains.par_chunks_mut(PIECE).zip(values).enumerate();
        let counts: Vec<Vec<u32>> = pieces.map(|(piece, (gains, (own, squared)))| {
            let mut counts = vec![0; 1 << COUNTED];
            for (k, (gain, (&own, &squared))) in gains.iter_mut().zip(own.iter().zip(squared)).enumerate() {
                if squared > 0 && allowed(piece * PIECE + k) {
                    *gain = gain_of(own, squared);
                    counts[(*gain >> (u32::BITS - COUNTED)) as usize] += 1;
                }
            }
            counts
        });
        let mut all = vec![0; 1 << COUNTED];
        for counts in counts {
            all.iter_mut().zip(counts).for_each(|(all, count)| *all += count as usize);
        }
        (gains, all)
    }

    /// Marks a pixel as measured: those that are nearer to it than to any other learn so.
    ///
    /// The pixels that change surround the new one without a gap (they are its Voronoi cell), so they are found by spreading.
    pub fn take(&mut self, pixel: usize) {
        let size = self.size;
        let (row, column) = (pixel / size.width, pixel % size.width);
        self.squared[pixel] = 0;
        self.open.push((row, column));
        while let Some((y, x)) = self.open.pop() {
            for y in y.saturating_sub(1)..(y + 2).min(size.height) {
                for x in x.saturating_sub(1)..(x + 2).min(size.width) {
                    let new = u32::try_from(y.abs_diff(row).pow(2) + x.abs_diff(column).pow(2));
                    let old = &mut self.squared[y * size.width + x];
                    if let Some(new) = new.ok().filter(|new| *new < *old) {
                        *old = new;
                        self.open.push((y, x));
                    }
                }
            }
        }
    }

    /// Squared distance to the nearest pixel that is measured or taken.
    #[cfg(test)]
    pub fn squared(&self) -> &[u32] {
        &self.squared
    }
}

/// What measuring a pixel at this squared distance from all others is worth: the bits of a float that is not negative, which order like
/// it, and one.
fn gain_of(coefficient: f32, squared: u32) -> u32 {
    (coefficient * (squared as f32).powi(4)).max(0.0).to_bits() + 1
}

/// The largest gain, as far as its leading bits tell, that `count` pixels reach; 0 where fewer may be taken.
fn least_of(counts: &[usize], count: usize) -> u32 {
    let mut sum = 0;
    let found = counts.iter().enumerate().rev().find(|(_, here)| {
        sum += **here;
        sum >= count
    });
    found.map_or(0, |(leading, _)| (leading as u32) << (u32::BITS - COUNTED))
}

/// Pixels that may be taken and whose gains lie between these, the upper one excluded.
fn between(gains: &[u32], least: u32, below: u32) -> impl Iterator<Item = (u32, usize)> {
    let found = gains.par_chunks(PIECE).enumerate().map(|(piece, gains)| -> Vec<(u32, usize)> {
        let within =
            gains.iter().enumerate().filter(|(_, gain)| (least.max(NEVER + 1)..below).contains(gain));
        within.map(|(k, &gain)| (gain, piece * PIECE + k)).collect()
    });
    found.into_iter().flatten()
}
