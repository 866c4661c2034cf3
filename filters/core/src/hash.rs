//! Numbers that look random, made from numbers that do not, and sums of bytes.

/// Mixes 64 bits so that each bit of the input changes about half of the output's.
///
/// Source: G. Steele, D. Lea, C. Flood, "Fast Splittable Pseudorandom Number Generators", OOPSLA 2014 (its 64-bit mixer, with
/// the constants of D. Stafford's variant 13).
pub const fn mix(value: u64) -> u64 {
    let value = (value ^ (value >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
    let value = (value ^ (value >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
    value ^ (value >> 31)
}

const PRIMES: [u64; 5] = [
    0x9e37_79b1_85eb_ca87,
    0xc2b2_ae3d_27d4_eb4f,
    0x1656_67b1_9e37_79f9,
    0x85eb_ca77_c2b2_ae63,
    0x27d4_eb2f_1656_67c5,
];
/// Bytes that the lanes of a sum take together.
const STRIPE: usize = 32;

/// A sum of bytes that tells contents apart as fast as memory gives them: XXH64 with seed 0. Whoever wants to can make two with
/// the same sum.
///
/// Source: Y. Collet, "xxHash fast digest algorithm", `doc/xxhash_spec.md` of github.com/Cyan4973/xxHash.
#[derive(Clone, Debug)]
pub struct Sum {
    lanes: [u64; 4],
    /// Less than a stripe, at the beginning.
    rest: [u8; STRIPE],
    length: u64,
}

impl Default for Sum {
    fn default() -> Self {
        let [first, second, ..] = PRIMES;
        let lanes = [first.wrapping_add(second), second, 0, 0_u64.wrapping_sub(first)];
        Self { lanes, rest: [0; STRIPE], length: 0 }
    }
}

impl Sum {
    /// Takes further bytes.
    pub fn add(&mut self, mut bytes: &[u8]) {
        let held = self.length as usize % STRIPE;
        self.length = self.length.wrapping_add(bytes.len() as u64);
        if held > 0 {
            let (now, later) = bytes.split_at(bytes.len().min(STRIPE - held));
            self.rest[held..held + now.len()].copy_from_slice(now);
            if held + now.len() < STRIPE {
                return;
            }
            let stripe = self.rest;
            self.stripe(&stripe);
            bytes = later;
        }
        let (stripes, rest) = bytes.as_chunks::<STRIPE>();
        for stripe in stripes {
            self.stripe(stripe);
        }
        self.rest[..rest.len()].copy_from_slice(rest);
    }

    fn stripe(&mut self, stripe: &[u8; STRIPE]) {
        for (lane, word) in self.lanes.iter_mut().zip(stripe.as_chunks::<8>().0) {
            *lane = round(*lane, u64::from_le_bytes(*word));
        }
    }

    /// The sum of all bytes.
    pub fn value(&self) -> u64 {
        let [first, second, third, fourth, fifth] = PRIMES;
        let mut sum = fifth;
        if self.length >= STRIPE as u64 {
            let turned = self.lanes.iter().zip([1, 7, 12, 18]).map(|(lane, by)| lane.rotate_left(by));
            sum = turned.fold(0, u64::wrapping_add);
            for lane in self.lanes {
                sum = (sum ^ round(0, lane)).wrapping_mul(first).wrapping_add(fourth);
            }
        }
        sum = sum.wrapping_add(self.length);
        let (words, rest) = self.rest[..self.length as usize % STRIPE].as_chunks::<8>();
        for word in words {
            sum ^= round(0, u64::from_le_bytes(*word));
            sum = sum.rotate_left(27).wrapping_mul(first).wrapping_add(fourth);
        }
        let (half, rest) = rest.as_chunks::<4>();
        for word in half {
            sum ^= u64::from(u32::from_le_bytes(*word)).wrapping_mul(first);
            sum = sum.rotate_left(23).wrapping_mul(second).wrapping_add(third);
        }
        for byte in rest {
            sum = (sum ^ u64::from(*byte).wrapping_mul(fifth)).rotate_left(11).wrapping_mul(first);
        }
        sum = (sum ^ (sum >> 33)).wrapping_mul(second);
        sum = (sum ^ (sum >> 29)).wrapping_mul(third);
        sum ^ (sum >> 32)
    }
}

fn round(lane: u64, word: u64) -> u64 {
    let [first, second, ..] = PRIMES;
    lane.wrapping_add(word.wrapping_mul(second)).rotate_left(31).wrapping_mul(first)
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

    /// Values of the reference implementation.
    #[test]
    fn sums_are_those_of_xxh64_however_the_bytes_come() {
        let sum = |pieces: &[&[u8]]| {
            let mut sum = Sum::default();
            for piece in pieces {
                sum.add(piece);
            }
            sum.value()
        };
        let spammish: &[u8] = b"Nobody inspects the spammish repetition";
        for (bytes, expected) in [
            (&b""[..], 0xef46_db37_51d8_e999),
            (b"a", 0xd24e_c4f1_a98c_6e5b),
            (b"abc", 0x44bc_2cf5_ad77_0999),
            (spammish, 0xfbce_a83c_8a37_8bf1),
        ] {
            assert_eq!(sum(&[bytes]), expected, "{bytes:?}");
        }
        let long: Vec<u8> = (0..=255).collect();
        for at in 0..long.len() {
            let (a, b) = long.split_at(at);
            assert_eq!(sum(&[a, b]), sum(&[&long]), "{at}");
            let (b, c) = b.split_at(b.len() / 3);
            assert_eq!(sum(&[a, b, c]), sum(&[&long]), "{at}");
        }
    }
}
