//! Samples of other frames, as far as samples that are held out may judge them.
//!
//! Where other frames know more of measured pixels than of missing ones, as frames of one mask do whose motion is slow, held-out samples would
//! promise too much: each has a sample of another frame beside it, missing pixels have not. So where they are nearer on average, the nearest ones are
//! left out around those that judge, until as many of these as of missing pixels have one within any distance. Block by block,
//!
//! ```text
//! t(p) = quantile of d_1(q) over missing pixels q, at the rank that d_1(p) has among the pixels p that judge
//! ```
//!
//! with `d_1 <= d_2 <= ...` the distances to samples of other frames; those before the one whose distance comes nearest to `t(p)`, and is half of it at least,
//! are left out.
//!
//! Cost: the nearest sample of every missing pixel, some of those that judge. Fails: where samples lie otherwise around measured pixels than around
//! missing ones in more than their distance.

use std::ops::Range;

use lacuna_core::hash;
use lacuna_core::parallel::prelude::*;

use super::Carried;
use crate::{Mask, Size};

/// Side of the blocks in which distances are compared.
const BLOCK: usize = 64;
/// Pixels to either side within which samples are looked for. All that is farther away is as far.
const REACH: usize = 8;
const FAR: f32 = REACH as f32 + 1.0;
/// Samples around a pixel that are looked at.
const MOST: usize = 8;
/// Shuffles pixels whose samples are as far.
const SEED: u64 = 0x7e4d;

/// A sample of another frame: which frame, which of its samples, and how far it is.
#[derive(Clone, Copy)]
struct Near {
    frame: usize,
    sample: usize,
    distance: f32,
}

/// The samples that are left where the pixels of `judges` judge them, which are measured ones of the mask.
pub(crate) fn thinned((mask, judges): (&Mask, &[u32]), carried: &[&Carried]) -> Vec<Carried> {
    let places = Places::new(mask.size(), carried);
    let size = mask.size();
    let across = size.width.div_ceil(BLOCK);
    let mut blocks = vec![Vec::new(); size.height.div_ceil(BLOCK) * across];
    for &pixel in judges {
        let (row, column) = (pixel as usize / size.width, pixel as usize % size.width);
        blocks[row / BLOCK * across + column / BLOCK].push(pixel);
    }
    let surplus = |(block, judges): (usize, &Vec<u32>)| {
        if judges.is_empty() {
            return Vec::new();
        }
        let side = |at: usize, length: usize| at * BLOCK..(at * BLOCK + BLOCK).min(length);
        let area = (side(block / across, size.height), side(block % across, size.width));
        places.surplus(mask, judges, area)
    };
    let surplus = blocks.par_iter().with_max_len(1).enumerate().map(surplus).concat();
    let mut stays: Vec<Vec<bool>> = carried.iter().map(|carried| vec![true; carried.len()]).collect();
    for near in surplus {
        stays[near.frame][near.sample] = false;
    }
    let left = |(carried, stays): (&&Carried, &Vec<bool>)| {
        let all: Vec<usize> = (0..carried.len()).filter(|&i| stays[i]).collect();
        carried.only(&all)
    };
    carried.iter().zip(&stays).map(left).collect()
}

/// The samples of all frames by the pixel that each is in.
struct Places<'a> {
    size: Size,
    carried: &'a [&'a Carried],
    /// Where those of each pixel begin.
    first: Vec<u32>,
    /// Frame and sample.
    samples: Vec<[u32; 2]>,
}

impl<'a> Places<'a> {
    fn new(size: Size, carried: &'a [&'a Carried]) -> Self {
        let mut first = vec![0_u32; size.pixels() + 1];
        carried.iter().flat_map(|carried| carried.pixels(size)).for_each(|at| first[at + 1] += 1);
        for at in 0..size.pixels() {
            first[at + 1] += first[at];
        }
        let mut next = first.clone();
        let mut samples = vec![[0; 2]; first[size.pixels()] as usize];
        for (frame, carried) in carried.iter().enumerate() {
            for (sample, at) in carried.pixels(size).enumerate() {
                samples[next[at] as usize] = [frame as u32, sample as u32];
                next[at] += 1;
            }
        }
        Self { size, carried, first, samples }
    }

    /// The nearest samples of a pixel, so many at most, from the nearest one on.
    fn nearest(&self, pixel: usize, most: usize) -> Vec<Near> {
        let Size { height, width } = self.size;
        let (row, column) = (pixel / width, pixel % width);
        let mut found: Vec<Near> = Vec::with_capacity(most + 1);
        let mut look = |y: usize, x: usize| {
            let at = y * width + x;
            for &[frame, sample] in &self.samples[self.first[at] as usize..self.first[at + 1] as usize] {
                let (frame, sample) = (frame as usize, sample as usize);
                let [y, x] = self.carried[frame].places[sample];
                let distance = (y - row as f32).hypot(x - column as f32);
                let rank = found.partition_point(|near| near.distance <= distance);
                found.insert(rank, Near { frame, sample, distance });
                found.truncate(most);
            }
            found.get(most - 1).map_or(f32::INFINITY, |near| near.distance)
        };
        for ring in 0..=REACH {
            let (low, high) = (row.saturating_sub(ring), (row + ring).min(height - 1));
            let (left, right) = (column.saturating_sub(ring), (column + ring).min(width - 1));
            let mut last = f32::INFINITY;
            for y in low..=high {
                let is_edge = y.abs_diff(row) == ring;
                for x in (left..=right).filter(|x| is_edge || x.abs_diff(column) == ring) {
                    last = look(y, x);
                }
            }
            // Whatever lies beyond the ring is farther away.
            if last <= ring as f32 + 0.5 {
                break;
            }
        }
        found
    }

    /// What is left out around the pixels of a block that judge.
    fn surplus(
        &self,
        mask: &Mask,
        judges: &[u32],
        (rows, columns): (Range<usize>, Range<usize>),
    ) -> Vec<Near> {
        let width = self.size.width;
        let pixels = rows.flat_map(|row| columns.clone().map(move |column| row * width + column));
        let distance = |near: &[Near]| near.first().map_or(FAR, |near| near.distance.min(FAR));
        let missing = pixels.filter(|&pixel| !mask.as_slice()[pixel]);
        let mut open: Vec<f32> = missing.map(|pixel| distance(&self.nearest(pixel, 1))).collect();
        if open.is_empty() {
            return Vec::new();
        }
        open.sort_unstable_by(f32::total_cmp);
        let mut own: Vec<(u64, Vec<Near>)> = judges
            .iter()
            .map(|&pixel| (hash(SEED, u64::from(pixel)), self.nearest(pixel as usize, MOST)))
            .collect();
        let sum = |all: &mut dyn Iterator<Item = f32>| all.map(f64::from).sum::<f64>();
        let known = sum(&mut own.iter().map(|(_, near)| distance(near))) / own.len() as f64;
        if known >= sum(&mut open.iter().copied()) / open.len() as f64 {
            return Vec::new();
        }
        own.sort_unstable_by(|a, b| distance(&a.1).total_cmp(&distance(&b.1)).then(a.0.cmp(&b.0)));
        let count = own.len();
        let beyond = |(rank, (_, mut near)): (usize, (u64, Vec<Near>))| {
            let wanted = open[(2 * rank + 1) * open.len() / (2 * count)];
            let is_near = |distance: f32| distance < 0.5 * wanted;
            let off =
                |distance: f32| if is_near(distance) { FAR } else { (distance.min(FAR) - wanted).abs() };
            let all = near.iter().map(|near| near.distance).chain((near.len() < MOST).then_some(FAR));
            let best = all.map(off).enumerate().min_by(|a, b| a.1.total_cmp(&b.1)).map_or(0, |(at, _)| at);
            near.truncate(best);
            near
        };
        own.into_iter().enumerate().flat_map(beyond).collect()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::Planes;

    const SIZE: Size = Size::new(96, 96);

    /// A third of the pixels in no order, another one for each seed.
    fn mask(seed: u64) -> Mask {
        Mask::from_fn(SIZE, |y, x| hash(seed, (y * 96 + x) as u64).is_multiple_of(5))
    }

    fn moved(seed: u64, offset: i32, by: [f32; 2]) -> Carried {
        let place = |at: usize| [(at / 96) as f32 + by[0], (at % 96) as f32 + by[1]];
        Carried::new(SIZE, (&Planes::zeros(SIZE, 1), &mask(seed)), offset, place).unwrap()
    }

    fn judges(mask: &Mask) -> Vec<u32> {
        (0..).zip(mask.as_slice()).filter(|(at, flag)| **flag && at % 4 == 1).map(|(at, _)| at).collect()
    }

    /// The mean distance from pixels to the nearest sample.
    fn mean(carried: &[Carried], pixels: &[u32]) -> f64 {
        let all: Vec<&Carried> = carried.iter().collect();
        let places = Places::new(SIZE, &all);
        let far = |&pixel: &u32| places.nearest(pixel as usize, 1).first().map_or(FAR, |near| near.distance);
        pixels.iter().map(far).map(f64::from).sum::<f64>() / pixels.len() as f64
    }

    fn missing(mask: &Mask) -> Vec<u32> {
        (0..).zip(mask.as_slice()).filter(|(_, flag)| !**flag).map(|(at, _)| at).collect()
    }

    #[test]
    fn the_nearest_are_those_of_a_search_through_all() {
        let carried = [moved(1, 1, [0.3, -1.7]), moved(2, -1, [2.4, 0.6])];
        let all: Vec<&Carried> = carried.iter().collect();
        let places = Places::new(SIZE, &all);
        for pixel in (0..SIZE.pixels()).step_by(37) {
            let (row, column) = ((pixel / 96) as f32, (pixel % 96) as f32);
            let of = |carried: &Carried| {
                carried.places.iter().map(|[y, x]| (y - row).hypot(x - column)).collect::<Vec<f32>>()
            };
            let mut expected: Vec<f32> = carried.iter().flat_map(of).collect();
            expected.sort_unstable_by(f32::total_cmp);
            let found: Vec<f32> = places.nearest(pixel, 3).iter().map(|near| near.distance).collect();
            assert_eq!(found, expected[..3], "{pixel}");
        }
    }

    /// Frames of one mask know what lies beside its pixels, whatever moves by less than these are apart.
    #[test]
    fn pixels_that_judge_have_samples_as_far_as_missing_ones() {
        let (own, judges) = (mask(1), judges(&mask(1)));
        for by in [0.0, 0.4, 0.8] {
            let carried = [moved(1, -1, [by, -0.5 * by]), moved(1, 1, [-by, 0.5 * by])];
            let all: Vec<&Carried> = carried.iter().collect();
            let left = thinned((&own, &judges), &all);
            let (before, after) = (mean(&carried, &judges), mean(&left, &judges));
            let wanted = mean(&carried, &missing(&own));
            // At most half as far off as before, and to the safe side.
            assert!(after > wanted - 0.05, "{by}: {after} {wanted}");
            assert!(after - wanted < 0.5 * (wanted - before), "{by}: {before} {after} {wanted}");
        }
    }

    #[test]
    fn of_masks_that_have_nothing_in_common_nearly_all_samples_stay() {
        let (own, judges) = (mask(1), judges(&mask(1)));
        let carried = [moved(2, -1, [0.7, 0.2]), moved(3, 1, [-0.7, -0.2])];
        let all: Vec<&Carried> = carried.iter().collect();
        let left = thinned((&own, &judges), &all);
        let count = |all: &[Carried]| all.iter().map(Carried::len).sum::<usize>();
        assert!(count(&left) * 20 > count(&carried) * 19, "{} of {}", count(&left), count(&carried));
        assert!((mean(&left, &judges) - mean(&carried, &missing(&own))).abs() < 0.05);
    }
}
