//! From bytes to literals and matches.

use std::ops::Range;

/// How far back a match may lie, and how long it may be.
const WINDOW: usize = 32_768;
const LONGEST: usize = 258;
/// A match takes about 20 bits. Where literals take 8 bits, four bytes are worth it ...
const SHORTEST: usize = 4;
/// ... and six where a range has fewer different bytes than this, as the halves of a smooth image do.
const SHORTEST_OF_FEW: usize = 6;
const FEW: usize = 180;
/// Bits of a hash: a table of 16-bit places fills two thirds of a first-level cache.
const HASH_BITS: u32 = 14;
/// The step of the search is 1 + (tries since the last match / 2^PATIENCE)^2, up to a number to 32 that the bytes themselves
/// give: so a search in bytes that were there before soon treads where the one before did.
const PATIENCE: u32 = 5;
const STEPS: usize = 32;
/// The last bytes of a range are literals: the search looks at eight at a time.
const MARGIN: usize = 8;

/// Some literals, then a match; none at the end of a range, where its length is 0.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct Token {
    pub(super) literals: u32,
    pub(super) length: u16,
    pub(super) distance: u16,
}

/// The search's memory: for a hash of four bytes the place where they stood last, without its higher bits.
pub(super) struct Parser {
    places: Vec<u16>,
    tokens: Vec<Token>,
}

impl Parser {
    pub(super) fn new() -> Self {
        Self { places: vec![0; 1 << HASH_BITS], tokens: Vec::new() }
    }

    /// Forgets what was seen. Places are proposals, which are compared with the input, so that zeros harm nothing.
    pub(super) fn clear(&mut self) {
        self.places.fill(0);
    }

    /// Cuts a range of the input into tokens; matches lie in all that is before.
    pub(super) fn parse(&mut self, input: &[u8], range: Range<usize>) -> &[Token] {
        self.tokens.clear();
        let shortest = shortest(&input[range.clone()]);
        let (mut at, mut begun, mut tries) = (range.start, range.start, 0_usize);
        let last = range.end.saturating_sub(MARGIN);
        while at < last {
            let bytes = four(input, at);
            let place = &mut self.places[hash(bytes)];
            let distance = usize::from((at as u16).wrapping_sub(*place));
            *place = at as u16;
            if distance.wrapping_sub(1) < WINDOW.min(at) && four(input, at - distance) == bytes {
                let most = LONGEST.min(range.end - at);
                let mut length = alike(&input[at - distance..], &input[at..at + most]);
                if length >= shortest {
                    // Steps may have gone past the beginning of the match.
                    let mut from = at;
                    while from > begun.max(distance)
                        && length < LONGEST
                        && input[from - 1] == input[from - 1 - distance]
                    {
                        from -= 1;
                        length += 1;
                    }
                    at = self.repeat(input, (begun, from, range.end), (length, distance));
                    self.remember(input, from + 1..at.min(last));
                    (begun, tries) = (at, 0);
                    continue;
                }
            }
            at += 1 + (tries >> PATIENCE).pow(2).min(hash(bytes) % STEPS);
            tries += 1;
        }
        self.tokens.push(Token { literals: (range.end - begun) as u32, length: 0, distance: 0 });
        &self.tokens
    }

    /// Takes a match, and as many more from the same distance as follow each other at full length. Returns where they end.
    fn repeat(
        &mut self,
        input: &[u8],
        (begun, from, end): (usize, usize, usize),
        (mut length, distance): (usize, usize),
    ) -> usize {
        let (mut literals, mut at) = ((from - begun) as u32, from);
        loop {
            self.tokens.push(Token { literals, length: length as u16, distance: distance as u16 });
            at += length;
            if length < LONGEST {
                return at;
            }
            let most = LONGEST.min(end - at);
            length = alike(&input[at - distance..], &input[at..at + most]);
            if length < SHORTEST {
                return at;
            }
            literals = 0;
        }
    }

    /// Enters the places inside of a match, of a long one those that a long search would tread.
    fn remember(&mut self, input: &[u8], places: Range<usize>) {
        let long = places.len() >= STEPS;
        let mut at = places.start;
        while at < places.end {
            let hash = hash(four(input, at));
            self.places[hash] = at as u16;
            at += if long { 1 + hash % STEPS } else { 1 };
        }
    }
}

/// The length from which on matches are taken, by a look at every eighth byte.
fn shortest(bytes: &[u8]) -> usize {
    let mut seen = [false; 256];
    bytes.iter().step_by(8).for_each(|&byte| seen[usize::from(byte)] = true);
    let different = seen.iter().filter(|&&seen| seen).count();
    if different < FEW { SHORTEST_OF_FEW } else { SHORTEST }
}

#[inline]
fn four(input: &[u8], at: usize) -> u32 {
    input[at..].first_chunk().map_or(0, |bytes| u32::from_le_bytes(*bytes))
}

#[inline]
fn hash(bytes: u32) -> usize {
    (bytes.wrapping_mul(0x9e37_79b1) >> (u32::BITS - HASH_BITS)) as usize
}

/// How many bytes the beginnings have in common; `before` is as long as `now` or longer.
fn alike(before: &[u8], now: &[u8]) -> usize {
    let (words, rest) = now.as_chunks::<8>();
    for (index, (word, other)) in words.iter().zip(before.as_chunks::<8>().0).enumerate() {
        let differ = u64::from_le_bytes(*word) ^ u64::from_le_bytes(*other);
        if differ != 0 {
            return 8 * index + (differ.trailing_zeros() / 8) as usize;
        }
    }
    let done = now.len() - rest.len();
    done + rest.iter().zip(&before[done..]).take_while(|(a, b)| a == b).count()
}
