//! The run-length code of the format: a count byte, then one byte to repeat or several to copy.

/// Runs shorter than this are copied.
const SHORTEST_RUN: usize = 3;
/// Most bytes that one count byte can repeat less one, or copy.
const LONGEST: usize = 127;

/// Fills `out` exactly.
pub(super) fn decode(mut packed: &[u8], mut out: &mut [u8]) -> Result<(), String> {
    let broken = || "its run lengths are broken".to_owned();
    while let Some((&count, rest)) = packed.split_first() {
        let count = count as i8;
        let length = if count < 0 { usize::from(count.unsigned_abs()) } else { count as usize + 1 };
        let (filled, unfilled) = std::mem::take(&mut out).split_at_mut_checked(length).ok_or_else(broken)?;
        if count < 0 {
            let (literal, rest) = rest.split_at_checked(length).ok_or_else(broken)?;
            filled.copy_from_slice(literal);
            packed = rest;
        } else {
            let (&byte, rest) = rest.split_first().ok_or_else(broken)?;
            filled.fill(byte);
            packed = rest;
        }
        out = unfilled;
    }
    if out.is_empty() { Ok(()) } else { Err(broken()) }
}

/// The code of `bytes`; up to 1/127 longer than they are.
pub(super) fn encode(bytes: &[u8]) -> Vec<u8> {
    let mut packed = Vec::with_capacity(bytes.len() / 2);
    let mut rest = bytes;
    let run =
        |bytes: &[u8]| bytes.iter().take(LONGEST + 1).take_while(|byte| Some(*byte) == bytes.first()).count();
    while let Some(&byte) = rest.first() {
        let length = run(rest);
        if length >= SHORTEST_RUN {
            packed.extend([(length - 1) as u8, byte]);
            rest = rest.get(length..).unwrap_or_default();
        } else {
            let literal = rest.windows(SHORTEST_RUN).take(LONGEST).position(|w| w.iter().all(|b| b == &w[0]));
            let (copied, after) = rest.split_at(literal.unwrap_or(LONGEST.min(rest.len())));
            packed.push((copied.len() as i8).wrapping_neg() as u8);
            packed.extend(copied);
            rest = after;
        }
    }
    packed
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn known_code() {
        assert_eq!(encode(&[7, 7, 7, 7, 1, 2, 2]), [3, 7, 253, 1, 2, 2]);
        assert_eq!(encode(&[5; 130]), [127, 5, 254, 5, 5]);
    }

    #[test]
    fn decode_is_the_inverse_and_refuses_other_lengths() {
        for seed in 1..200_u32 {
            let bytes: Vec<u8> = (0..seed * 3).map(|i| (i * i / (seed % 7 + 1) / 40) as u8).collect();
            let packed = encode(&bytes);
            let mut out = vec![0; bytes.len()];
            decode(&packed, &mut out).unwrap();
            assert_eq!(out, bytes);
            assert!(decode(&packed, &mut vec![0; bytes.len() + 1]).is_err());
            assert!(decode(&packed, &mut vec![0; bytes.len() - 1]).is_err());
        }
    }
}
