//! The greedy choice: pixel after pixel where the gain is largest, distances being brought up to date after each.
//!
//! A gain only falls as pixels are taken, so an entry of the heap that is out of date is found out when it comes to the top. The heap
//! has the pixels of the largest gains alone, and others only once what is left in it has fallen to theirs.

use std::cmp::Reverse;
use std::collections::BinaryHeap;

use lacuna_core::parallel::prelude::*;

use crate::Size;

/// Entries of the heap at first, over the pixels that are asked for; then as many times as many.
const ENTRIES: usize = 8;
/// Pixels that one task takes.
const PIECE: usize = 1 << 14;
/// Leading bits of a gain by which pixels are counted.
const COUNTED: u32 = 16;
/// The gain of pixels that may not be taken.
const NEVER: u32 = 0;

/// What pixels are chosen by.
pub struct Picks<'a> {
    size: Size,
    /// The squared error per sixth power of the distance.
    coefficient: &'a [f32],
    /// Squared distance to the nearest pixel that is measured or taken.
    squared: Vec<u32>,
}

impl<'a> Picks<'a> {
    pub fn new(size: Size, coefficient: &'a [f32], squared: Vec<u32>) -> Self {
        Self { size, coefficient, squared }
    }

    /// Up to `count` pixels, the most useful first, of those that are `allowed`; of equal gains the one of least `order` first. Also
    /// the squared distances once they are taken.
    pub fn next(
        mut self,
        count: usize,
        order: &dyn Fn(usize) -> u32,
        allowed: &(dyn Fn(usize) -> bool + Sync),
    ) -> (Vec<usize>, Vec<u32>) {
        let gains = self.gains(allowed);
        let mut taken = Vec::with_capacity(count.min(gains.len()));
        let mut heap: BinaryHeap<(u32, Reverse<u32>, Reverse<usize>)> = BinaryHeap::new();
        // Pixels whose gains were `least` or more are in the heap.
        let (mut least, mut entries) = (u32::MAX, count.saturating_mul(ENTRIES));
        while taken.len() < count {
            if least > NEVER + 1 && heap.peek().is_none_or(|(gain, ..)| *gain < least) {
                let below = least;
                least = least_of(&gains, entries).min(below);
                entries = entries.saturating_mul(ENTRIES);
                let more = gains.iter().enumerate().filter(|(_, gain)| (least..below).contains(gain));
                heap.extend(more.map(|(pixel, &gain)| (gain, Reverse(order(pixel)), Reverse(pixel))));
                continue;
            }
            let Some((gain, tie, Reverse(pixel))) = heap.pop() else { break };
            let now = gain_of(self.coefficient[pixel], self.squared[pixel]);
            if now < gain {
                heap.push((now, tie, Reverse(pixel)));
                continue;
            }
            self.take(pixel);
            taken.push(pixel);
        }
        (taken, self.squared)
    }

    fn gains(&self, allowed: &(dyn Fn(usize) -> bool + Sync)) -> Vec<u32> {
        let mut gains = vec![NEVER; self.squared.len()];
        let values = self.coefficient.par_chunks(PIECE).zip(self.squared.par_chunks(PIECE));
        gains.par_chunks_mut(PIECE).zip(values).enumerate().for_each(|(piece, (gains, (own, squared)))| {
            for (k, (gain, (&own, &squared))) in gains.iter_mut().zip(own.iter().zip(squared)).enumerate() {
                if squared > 0 && allowed(piece * PIECE + k) {
                    *gain = gain_of(own, squared);
                }
            }
        });
        gains
    }

    /// Marks a pixel as measured: those that are nearer to it than to any other learn so.
    ///
    /// The pixels that change surround the new one without a gap (they are its Voronoi cell), so they are found by spreading.
    pub fn take(&mut self, pixel: usize) {
        let size = self.size;
        let (row, column) = (pixel / size.width, pixel % size.width);
        self.squared[pixel] = 0;
        let mut open = vec![(row, column)];
        while let Some((y, x)) = open.pop() {
            for y in y.saturating_sub(1)..(y + 2).min(size.height) {
                for x in x.saturating_sub(1)..(x + 2).min(size.width) {
                    let new = u32::try_from(y.abs_diff(row).pow(2) + x.abs_diff(column).pow(2));
                    let old = &mut self.squared[y * size.width + x];
                    if let Some(new) = new.ok().filter(|new| *new < *old) {
                        *old = new;
                        open.push((y, x));
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

/// The largest gain, as far as its leading bits tell, that `count` pixels reach; [`NEVER`] and one where fewer may be taken.
fn least_of(gains: &[u32], count: usize) -> u32 {
    let mut counts = vec![0_usize; 1 << COUNTED];
    for gain in gains {
        counts[(gain >> (u32::BITS - COUNTED)) as usize] += 1;
    }
    let mut sum = 0;
    let found = counts.iter().enumerate().rev().find(|(_, count_here)| {
        sum += **count_here;
        sum >= count
    });
    found.map_or(0, |(leading, _)| (leading as u32) << (u32::BITS - COUNTED)).max(NEVER + 1)
}
