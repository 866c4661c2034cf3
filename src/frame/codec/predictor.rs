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
    let planar = &*planar;
    if let (Some(first), Some(out)) = (planar.first(), predicted.first_mut()) {
        *out = *first;
    }
    let (before, after) = (planar, planar.get(1..).unwrap_or_default());
    for ((out, after), before) in predicted.iter_mut().skip(1).zip(after).zip(before) {
        *out = after.wrapping_sub(*before).wrapping_add(128);
    }
}

/// The inverse of [`apply`]: `raw` from `predicted`, of the same length.
pub(super) fn undo(predicted: &[u8], raw: &mut [u8]) {
    let (even, odd) = predicted.split_at(predicted.len().div_ceil(2));
    // The two halves are summed at the same time: the sum of the first is where the second begins.
    let total = |bytes: &[u8]| bytes.iter().fold(0_u8, |sum, &byte| sum.wrapping_add(byte ^ 128));
    let mut a = 128_u8;
    let mut b = a.wrapping_add(total(even));
    let (pairs, last) = raw.as_chunks_mut::<2>();
    for ((pair, even), odd) in pairs.iter_mut().zip(even).zip(odd) {
        a = a.wrapping_add(even ^ 128);
        b = b.wrapping_add(odd ^ 128);
        *pair = [a, b];
    }
    if let (Some(out), Some(byte)) = (last.first_mut(), even.last()) {
        *out = a.wrapping_add(byte ^ 128);
    }
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
        for length in 0..70_usize {
            let raw: Vec<u8> = (0..length).map(|i| (i * i * 37 + 11 * i) as u8).collect();
            let (mut planar, mut predicted, mut back) = (vec![0; length], vec![0; length], vec![0; length]);
            apply(&raw, &mut planar, &mut predicted);
            undo(&predicted, &mut back);
            assert_eq!(back, raw);
        }
    }
}
