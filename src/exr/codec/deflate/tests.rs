//! Streams are read back by libdeflate and by zlib-rs; codes are compared with the optimum.

use std::io::Read;

use proptest::prelude::*;

use super::huffman::{codes, lengths};
use super::*;

fn check(deflater: &mut Deflater, input: &[u8]) -> usize {
    let packed = deflater.zlib(input).to_vec();
    let mut back = vec![0; input.len()];
    let found = libdeflater::Decompressor::new().zlib_decompress(&packed, &mut back);
    assert_eq!((found.ok(), back.as_slice() == input), (Some(input.len()), true));
    let mut other = Vec::new();
    flate2::read::ZlibDecoder::new(packed.as_slice()).read_to_end(&mut other).unwrap();
    assert!(other == input);
    // Whatever was compressed before, the bytes are the same.
    assert_eq!(packed, Deflater::new().zlib(input));
    packed.len()
}

/// Numbers that look random.
fn noise(length: usize) -> Vec<u8> {
    let mut state = 1_u64;
    let mut next = || {
        state = state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1);
        (state >> 56) as u8
    };
    (0..length).map(|_| next()).collect()
}

#[test]
fn sizes_around_the_borders_of_blocks_come_back() {
    let mut deflater = Deflater::new();
    let bytes = noise(3 * BLOCK);
    for length in (0..40).chain([2 * BLOCK - 1, 2 * BLOCK, 2 * BLOCK + 1, 3 * BLOCK]) {
        check(&mut deflater, &bytes[..length]);
        check(&mut deflater, &vec![7; length]);
        check(&mut deflater, &(0..length).map(|i| (i / 300) as u8).collect::<Vec<_>>());
    }
}

#[test]
fn noise_hardly_grows_and_runs_vanish() {
    let mut deflater = Deflater::new();
    let length = 300_000;
    assert!(check(&mut deflater, &noise(length)) < length + 64);
    assert!(check(&mut deflater, &vec![128; length]) < length / 200);
    // A pattern of 5000 bytes is found again although steps are long by then.
    let pattern: Vec<u8> = noise(5000).into_iter().cycle().take(length).collect();
    let packed = check(&mut deflater, &pattern);
    assert!(packed < length / 20, "{packed}");
}

#[test]
fn few_symbols_take_their_entropy() {
    let mut deflater = Deflater::new();
    // Sixteen equally frequent symbols without matches to speak of: 4 bits each.
    let input: Vec<u8> = noise(200_000).iter().map(|byte| byte >> 4).collect();
    let packed = check(&mut deflater, &input) as f64;
    assert!((0.49..0.52).contains(&(packed / input.len() as f64)), "{packed}");
}

/// Bits of an optimal code without a limit: the sum of the inner nodes.
fn optimum(counts: &[u32]) -> u64 {
    let mut heap: std::collections::BinaryHeap<_> =
        counts.iter().filter(|count| **count > 0).map(|&count| std::cmp::Reverse(u64::from(count))).collect();
    let mut bits = 0;
    while let (Some(a), Some(b)) = (heap.pop(), heap.pop()) {
        bits += a.0 + b.0;
        heap.push(std::cmp::Reverse(a.0 + b.0));
    }
    bits
}

proptest! {
    #[test]
    fn any_bytes_come_back(seed in prop::collection::vec((any::<u8>(), 1..400_usize, any::<bool>()), 0..200)) {
        let mut input = Vec::new();
        for (byte, length, run) in seed {
            if run {
                input.extend(std::iter::repeat_n(byte, length));
            } else {
                input.extend((0..length).map(|i| byte.wrapping_mul((i * i % 251) as u8)));
            }
        }
        check(&mut Deflater::new(), &input);
    }

    #[test]
    fn codes_are_complete_and_shortest(counts in prop::collection::vec(prop_oneof![Just(0), 1..50_u32, 1..1_000_000_u32], 286)) {
        let mut found = [0; 286];
        lengths(&counts, 14, &mut found);
        let kraft: u32 = found.iter().filter(|length| **length > 0).map(|length| 1 << (15 - length)).sum();
        prop_assert_eq!(kraft, 1 << 15);
        if counts.iter().filter(|count| **count > 0).count() > 1 {
            prop_assert!(counts.iter().zip(found).all(|(count, length)| (*count > 0) == (length > 0)));
            let bits: u64 = counts.iter().zip(found).map(|(count, length)| u64::from(*count) * u64::from(length)).sum();
            // Where no code is as long as the limit it is the optimum.
            let least = optimum(&counts);
            prop_assert!(bits == least || (found.contains(&14) && bits >= least && bits - least <= least / 50));
        }
        // No code is the beginning of another one.
        let codes = codes(&found);
        let mut all: Vec<_> = codes.iter().filter(|code| code.length > 0).map(|code| {
            (code.bits.reverse_bits() >> (16 - code.length)) << (15 - code.length)
        }).collect();
        all.sort_unstable();
        prop_assert!(all.windows(2).all(|pair| pair[0] < pair[1]));
    }
}

#[test]
fn the_limit_holds_for_counts_that_grow_fastest() {
    // Fibonacci's numbers make the longest codes.
    let mut counts = vec![1_u32, 1];
    while counts.len() < 30 {
        counts.push(counts[counts.len() - 1] + counts[counts.len() - 2]);
    }
    for limit in [5, 7, 14] {
        let mut found = [0; 30];
        lengths(&counts, limit, &mut found);
        let kraft: usize = found.iter().map(|&length| 1 << (limit - usize::from(length))).sum();
        assert!(
            kraft <= 1 << limit && found.iter().all(|&length| 1 <= length && usize::from(length) <= limit)
        );
    }
}
