//! The nearest samples of a pixel, found in rows of bits.

use crate::{Mask, Size};

/// A sample near a pixel.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Near {
    /// Squared distance.
    pub squared: u32,
    /// Row of the sample.
    pub row: u32,
    /// Column of the sample.
    pub column: u32,
}

/// Bits in a word.
const BITS: usize = 64;

/// Where the samples lie.
#[derive(Clone, Debug)]
pub struct Places {
    size: Size,
    /// Words in a row.
    words: usize,
    bits: Vec<u64>,
}

impl Places {
    /// The measured pixels of a mask for which `kept` holds, by index row by row.
    pub fn new(mask: &Mask, kept: impl Fn(usize) -> bool) -> Self {
        let size = mask.size();
        let words = size.width.div_ceil(BITS);
        let mut bits = vec![0; words * size.height];
        for (pixel, _) in mask.as_slice().iter().enumerate().filter(|(pixel, flag)| **flag && kept(*pixel)) {
            let (row, column) = (pixel / size.width, pixel % size.width);
            bits[row * words + column / BITS] |= 1 << (column % BITS);
        }
        Self { size, words, bits }
    }

    /// The samples nearest to a pixel other than itself, the nearest first, into `found`; returns how many there are.
    pub fn nearest(&self, (row, column): (usize, usize), found: &mut [Near]) -> usize {
        let mut list = List { found, count: 0 };
        self.scan(row, (row, column), &mut list);
        for step in 1..self.size.height {
            if list.is_beyond((step * step) as u32) {
                break;
            }
            if step <= row {
                self.scan(row - step, (row, column), &mut list);
            }
            if row + step < self.size.height {
                self.scan(row + step, (row, column), &mut list);
            }
        }
        list.count
    }

    /// Adds the samples of one row, outwards from the pixel's column.
    fn scan(&self, row: usize, (y, x): (usize, usize), list: &mut List<'_>) {
        let words = &self.bits[row * self.words..][..self.words];
        let dy = row.abs_diff(y);
        let add = |column: usize, list: &mut List<'_>| {
            let dx = column.abs_diff(x);
            let squared = (dy * dy + dx * dx) as u32;
            list.add(Near { squared, row: row as u32, column: column as u32 })
        };
        let (word, bit) = (x / BITS, x % BITS);
        // From the column on; the pixel itself does not count.
        let mut rest = words[word] & (u64::MAX << bit);
        if dy == 0 {
            rest &= !(1 << bit);
        }
        'right: for (at, &bits) in words.iter().enumerate().skip(word) {
            if at > word {
                rest = bits;
                if list.is_beyond(((at * BITS - x).pow(2) + dy * dy) as u32) {
                    break;
                }
            }
            while rest != 0 {
                if !add(at * BITS + rest.trailing_zeros() as usize, list) {
                    break 'right;
                }
                rest &= rest - 1;
            }
        }
        let mut rest = words[word] & !(u64::MAX << bit);
        'left: for at in (0..=word).rev() {
            if at < word {
                rest = words[at];
                if list.is_beyond(((x - at * BITS - (BITS - 1)).pow(2) + dy * dy) as u32) {
                    break;
                }
            }
            while rest != 0 {
                let top = BITS - 1 - rest.leading_zeros() as usize;
                if !add(at * BITS + top, list) {
                    break 'left;
                }
                rest &= !(1 << top);
            }
        }
    }
}

/// The nearest so far, in order.
struct List<'a> {
    found: &'a mut [Near],
    count: usize,
}

impl List<'_> {
    /// Whether nothing at this squared distance could enter.
    fn is_beyond(&self, squared: u32) -> bool {
        self.count == self.found.len() && self.found.last().is_none_or(|last| squared >= last.squared)
    }

    /// Takes a sample in; `false` if it is beyond.
    fn add(&mut self, near: Near) -> bool {
        if self.is_beyond(near.squared) {
            return false;
        }
        let mut at = if self.count < self.found.len() {
            self.count += 1;
            self.count - 1
        } else {
            self.count - 1
        };
        while at > 0 && self.found[at - 1].squared > near.squared {
            self.found[at] = self.found[at - 1];
            at -= 1;
        }
        self.found[at] = near;
        true
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use lacuna_core::hash;

    #[test]
    fn they_are_those_of_a_search_through_all() {
        for (size, density) in [(Size::new(9, 150), 8), (Size::new(70, 70), 40), (Size::new(1, 200), 3)] {
            let mask = Mask::from_fn(size, |row, column| {
                hash(1, (row * 1000 + column) as u64).is_multiple_of(density)
            });
            let places = Places::new(&mask, |pixel| pixel % 5 != 2);
            for pixel in (0..size.pixels()).step_by(7) {
                let (row, column) = (pixel / size.width, pixel % size.width);
                let mut all: Vec<u32> = (0..size.pixels())
                    .filter(|&other| mask.as_slice()[other] && other % 5 != 2 && other != pixel)
                    .map(|other| {
                        let (y, x) = (other / size.width, other % size.width);
                        (y.abs_diff(row).pow(2) + x.abs_diff(column).pow(2)) as u32
                    })
                    .collect();
                all.sort_unstable();
                all.truncate(6);
                let mut found = [Near::default(); 6];
                let count = places.nearest((row, column), &mut found);
                let squared: Vec<u32> = found[..count].iter().map(|near| near.squared).collect();
                assert_eq!(squared, all, "{size} {pixel}");
                for near in &found[..count] {
                    assert!(mask.is_measured(near.row as usize, near.column as usize));
                }
            }
        }
    }
}
