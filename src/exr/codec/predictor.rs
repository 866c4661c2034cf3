//! What RLE and ZIP do to the bytes of a chunk first: even bytes before odd ones, then differences.

/// Writes the even bytes of `raw`, then the odd ones, into `planar`; their differences plus 128 into `predicted`.
/// All three have the same length.
pub(super) fn apply(raw: &[u8], planar: &mut [u8], predicted: &mut [u8]) {
    let (even, odd) = planar.split_at_mut(raw.len().div_ceil(2));
    let (pairs, last) = raw.as_chunks::<2>();
    for ((pair, even), odd) in pairs.iter().zip(even.iter_mut()).zip(odd) {
        *even = pair[0];
        *odd = pair[1];
    }
    if let (Some(last), Some(even)) = (last.first(), even.last_mut()) {
        *even = *last;
    }
    differences(planar, predicted);
}

/// The differences of neighbours plus 128; the first byte stays. A function of its own, so that the compiler knows the
/// slices apart and takes many bytes at a time.
#[inline(never)]
fn differences(bytes: &[u8], out: &mut [u8]) {
    let (Some((&first, after)), Some((place, places))) = (bytes.split_first(), out.split_first_mut()) else {
        return;
    };
    *place = first;
    for ((place, &byte), &before) in places.iter_mut().zip(after).zip(bytes) {
        *place = byte.wrapping_sub(before).wrapping_add(128);
    }
}

/// The inverse of [`apply`]: `raw` from `predicted`, of the same length.
///
/// Sums of eight bytes at a time, in 16-bit lanes, as products with ones; only the last of them waits for the bytes before.
pub(super) fn undo(predicted: &[u8], raw: &mut [u8]) {
    let (even, odd) = predicted.split_at(predicted.len().div_ceil(2));
    // The two halves are summed at the same time: the sum of the first is where the second begins.
    let total = |bytes: &[u8]| bytes.iter().fold(0_u8, |sum, &byte| sum.wrapping_add(byte ^ 128));
    let mut a = 128_u8;
    let mut b = a.wrapping_add(total(even));
    let (blocks, rest) = raw.as_chunks_mut::<16>();
    let ((evens, even), (odds, odd)) = (even.as_chunks::<8>(), odd.as_chunks::<8>());
    let (evens, more_even) = evens.split_at(blocks.len());
    let (odds, more_odd) = odds.split_at(blocks.len());
    for ((block, even), odd) in blocks.iter_mut().zip(evens).zip(odds) {
        let (even, odd) = (sums(*even, &mut a), sums(*odd, &mut b));
        // Pairs 0, 2, 4, 6 and 1, 3, 5, 7.
        let (one, two) = (even[0] | odd[0] << 8, even[1] | odd[1] << 8);
        for (lane, pair) in block.as_chunks_mut::<4>().0.iter_mut().enumerate() {
            let (one, two) = ((one >> (16 * lane)) as u16, (two >> (16 * lane)) as u16);
            *pair = (u32::from(one) | u32::from(two) << 16).to_le_bytes();
        }
    }
    let even = more_even.as_flattened().iter().chain(even);
    let mut odd = more_odd.as_flattened().iter().chain(odd);
    for (pair, even) in rest.chunks_mut(2).zip(even) {
        a = a.wrapping_add(even ^ 128);
        pair[0] = a;
        if let (Some(place), Some(odd)) = (pair.get_mut(1), odd.next()) {
            b = b.wrapping_add(odd ^ 128);
            *place = b;
        }
    }
}

/// The running sums of eight bytes less 128, from `before` on, which becomes the last: those of bytes 0, 2, 4, 6 and those of
/// bytes 1, 3, 5, 7, each in a lane of 16 bits.
#[inline]
fn sums(bytes: [u8; 8], before: &mut u8) -> [u64; 2] {
    const BYTES: u64 = 0x00ff_00ff_00ff_00ff;
    const ONES: u64 = 0x0001_0001_0001_0001;
    let bytes = u64::from_le_bytes(bytes) ^ 0x8080_8080_8080_8080;
    // A lane of the products sums that lane and those below: at most 4 x 255.
    let low = (bytes & BYTES).wrapping_mul(ONES);
    let high = (bytes >> 8 & BYTES).wrapping_mul(ONES);
    let start = u64::from(*before) * ONES;
    *before = before.wrapping_add(((low + high) >> 48) as u8);
    [(low + (high << 16) + start) & BYTES, (low + high + start) & BYTES]
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn known_bytes() {
        let raw = [10, 200, 12, 199, 9];
        let (mut planar, mut predicted) = ([0; 5], [0; 5]);
        apply(&raw, &mut planar, &mut predicted);
        assert_eq!(planar, [10, 12, 9, 200, 199]);
        assert_eq!(predicted, [10, 130, 125, 63, 127]);
    }

    #[test]
    fn undo_is_the_inverse() {
        for length in (0..70_usize).chain([1000, 4097]) {
            let raw: Vec<u8> = (0..length).map(|i| (i * i * 37 + 11 * i + (i >> 3)) as u8).collect();
            let (mut planar, mut predicted, mut back) = (vec![0; length], vec![0; length], vec![0; length]);
            apply(&raw, &mut planar, &mut predicted);
            undo(&predicted, &mut back);
            assert_eq!(back, raw);
        }
    }
}
