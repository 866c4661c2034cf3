//! Numbers that look random, made from numbers that do not.

/// Mixes 64 bits so that each bit of the input changes about half of the output's.
///
/// Source: G. Steele, D. Lea, C. Flood, "Fast Splittable Pseudorandom Number Generators", OOPSLA 2014 (its 64-bit mixer, with
/// the constants of D. Stafford's variant 13).
pub const fn mix(value: u64) -> u64 {
    let value = (value ^ (value >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
    let value = (value ^ (value >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
    value ^ (value >> 31)
}

/// A hash of two numbers: the second counts along a stream that the first starts.
pub const fn hash(seed: u64, value: u64) -> u64 {
    mix(mix(seed).wrapping_add(value.wrapping_add(1).wrapping_mul(0x9e37_79b9_7f4a_7c15)))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn each_bit_changes_about_half_of_the_others() {
        let keys = 0..64_u64;
        let changed =
            |bit: u32| keys.clone().map(|key| (mix(key) ^ mix(key ^ 1 << bit)).count_ones()).sum::<u32>();
        assert!((0..64).all(|bit| (64 * 28..64 * 36).contains(&changed(bit))));
    }
}
