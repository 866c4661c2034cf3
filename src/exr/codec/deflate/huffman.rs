//! Prefix codes: lengths from counts, codes from lengths.

/// A symbol's code, its bits in the order in which they are written, and how many they are.
#[derive(Clone, Copy, Default)]
pub(super) struct Code {
    pub(super) bits: u16,
    pub(super) length: u8,
}

/// The lengths of an optimal prefix code for these counts, none above `limit`; 0 for what does not occur. There are
/// at least two symbols with a length, so that the code is complete.
///
/// Two queues: J. van Leeuwen, "On the construction of Huffman trees", ICALP 1976. Codes past the limit are cut and paid for by the
/// longest of the others, which costs next to nothing at the limits of deflate.
pub(super) fn lengths(counts: &[u32], limit: usize, lengths: &mut [u8]) {
    lengths.fill(0);
    let used = counts.iter().zip(0_u16..).filter(|(count, _)| **count > 0);
    let mut leaves: Vec<(u32, u16)> = used.map(|(&count, symbol)| (count, symbol)).collect();
    if leaves.len() < 2 {
        let only = leaves.first().map_or(0, |leaf| usize::from(leaf.1));
        (lengths[only], lengths[usize::from(only == 0)]) = (1, 1);
        return;
    }
    leaves.sort_unstable();
    let mut of_length = cut(&depths(&leaves), limit);
    for &(_, symbol) in leaves.iter().rev() {
        // The most frequent ones take the shortest codes.
        let Some(length) = of_length.iter().position(|&count| count > 0) else { return };
        of_length[length] -= 1;
        lengths[usize::from(symbol)] = length as u8;
    }
}

/// The depth of each leaf in the tree; `leaves` are sorted, two at least.
fn depths(leaves: &[(u32, u16)]) -> Vec<usize> {
    let count = leaves.len();
    let mut sums: Vec<u64> = Vec::with_capacity(count);
    let mut parents = vec![0; 2 * count - 1];
    let (mut leaf, mut node) = (0, 0);
    for new in count..2 * count - 1 {
        let mut sum = 0;
        for _ in 0..2 {
            let least = leaves.get(leaf).map(|leaf| u64::from(leaf.0));
            match (least, sums.get(node)) {
                (Some(least), other) if other.is_none_or(|&other| least <= other) => {
                    parents[leaf] = new;
                    (sum, leaf) = (sum + least, leaf + 1);
                }
                (_, other) => {
                    parents[count + node] = new;
                    (sum, node) = (sum + other.copied().unwrap_or(0), node + 1);
                }
            }
        }
        sums.push(sum);
    }
    let mut depths = vec![0; 2 * count - 1];
    for at in (0..2 * count - 2).rev() {
        depths[at] = depths[parents[at]] + 1;
    }
    depths.truncate(count);
    depths
}

/// How many codes have each length once none is longer than `limit`.
fn cut(depths: &[usize], limit: usize) -> Vec<usize> {
    let mut of_length = vec![0; limit + 1];
    for &depth in depths {
        of_length[depth.min(limit)] += 1;
    }
    let taken = of_length.iter().enumerate().map(|(length, count)| count << (limit - length)).sum::<usize>();
    // Each round frees one place: a code of full length becomes the sibling of a shorter one, which grows by a bit.
    for _ in 1_usize << limit..taken {
        let Some(length) = (1..limit).rev().find(|&length| of_length[length] > 0) else { break };
        of_length[limit] -= 1;
        of_length[length] -= 1;
        of_length[length + 1] += 2;
    }
    of_length
}

/// The codes that the format gives to these lengths, 0 to 15.
pub(super) fn codes<const N: usize>(lengths: &[u8; N]) -> [Code; N] {
    let mut of_length = [0_u16; 16];
    for &length in lengths.iter().filter(|&&length| length > 0) {
        of_length[usize::from(length)] += 1;
    }
    let mut code = 0_u16;
    let mut next = of_length.map(|count| {
        let first = code.wrapping_mul(2);
        code = first.wrapping_add(count);
        first
    });
    lengths.map(|length| {
        if length == 0 {
            return Code::default();
        }
        let code = &mut next[usize::from(length)];
        let bits = code.reverse_bits() >> (16 - length);
        *code = code.wrapping_add(1);
        Code { bits, length }
    })
}
