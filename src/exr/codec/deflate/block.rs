//! One block: counts, codes, their description, then the tokens; or the bytes as they are, if those are fewer.

use super::bits::Bits;
use super::huffman::{Code, codes, lengths};
use super::parse::Token;

/// Literals, the end of a block, lengths; distances; the code lengths' own code.
const SYMBOLS: usize = 286;
const DISTANCES: usize = 30;
const DESCRIBING: usize = 19;
const END: usize = 256;
/// Four literals fit the buffer at once.
const LONGEST_CODE: usize = 14;
/// The order in which the code lengths' own lengths are written.
const ORDER: [usize; DESCRIBING] = [16, 17, 18, 0, 8, 7, 9, 6, 10, 5, 11, 4, 12, 3, 13, 2, 14, 1, 15];

/// A length's or a distance's symbol, from the first of its kind on, and the bits that follow it.
#[derive(Clone, Copy, Default)]
struct Range {
    symbol: u16,
    extra: u8,
    rest: u16,
}

/// The symbols of all lengths.
static LENGTHS: [Range; 259] = {
    let mut all = [Range { symbol: 0, extra: 0, rest: 0 }; 259];
    let mut length = 3;
    while length < 258 {
        all[length] = power_range(length as u32 - 3, 2);
        length += 1;
    }
    all[258] = Range { symbol: 28, extra: 0, rest: 0 };
    all
};

/// The symbol for a number in ranges whose size doubles after every 2^`fine` of them.
const fn power_range(number: u32, fine: u32) -> Range {
    let Some(top) = number.checked_ilog2() else { return Range { symbol: 0, extra: 0, rest: 0 } };
    if top <= fine {
        return Range { symbol: number as u16, extra: 0, rest: 0 };
    }
    let extra = top - fine;
    let symbol = (extra << fine) + (number >> extra);
    Range { symbol: symbol as u16, extra: extra as u8, rest: (number & ((1 << extra) - 1)) as u16 }
}

fn of_distance(distance: u16) -> Range {
    power_range(u32::from(distance) - 1, 1)
}

/// Writes a block, the last one of the stream or not. `bytes` are those that the tokens stand for.
pub(super) fn write(bits: &mut Bits, bytes: &[u8], tokens: &[Token], last: bool) {
    let counts = Counts::of(bytes, tokens);
    let (mut symbols, mut distances) = ([0; SYMBOLS], [0; DISTANCES]);
    lengths(&counts.symbols, LONGEST_CODE, &mut symbols);
    lengths(&counts.distances, LONGEST_CODE, &mut distances);
    let description = Description::new(&symbols, &distances);
    let coded = description.bits() + counts.bits(&symbols, &distances);
    bits.add(u32::from(last), 1);
    // As it is: two bits say so, at most seven end the byte, and four bytes tell how many follow.
    if bytes.len() <= 0xffff && 8 * bytes.len() as u64 + 7 + 32 <= coded {
        bits.add(0, 2);
        bits.align();
        let length = bytes.len() as u16;
        bits.bytes(&length.to_le_bytes());
        bits.bytes(&(!length).to_le_bytes());
        bits.bytes(bytes);
        return;
    }
    bits.add(2, 2);
    description.write(bits);
    write_tokens(bits, bytes, tokens, (&codes(&symbols), &codes(&distances)));
}

/// The literals before each token, and the token.
fn runs<'a>(bytes: &'a [u8], tokens: &'a [Token]) -> impl Iterator<Item = (&'a [u8], &'a Token)> {
    tokens.iter().scan(bytes, |rest, token| {
        let (run, after) = rest.split_at(token.literals as usize);
        *rest = &after[usize::from(token.length)..];
        Some((run, token))
    })
}

/// How often each symbol occurs.
struct Counts {
    symbols: [u32; SYMBOLS],
    distances: [u32; DISTANCES],
}

impl Counts {
    fn of(bytes: &[u8], tokens: &[Token]) -> Self {
        let mut counts = Self { symbols: [0; SYMBOLS], distances: [0; DISTANCES] };
        // Four counters for each literal: one alone would wait for itself where the same follows.
        let mut literals = [[0_u32; 256]; 4];
        for (run, token) in runs(bytes, tokens) {
            let (fours, odd) = run.as_chunks::<4>();
            for four in fours {
                for (counts, &byte) in literals.iter_mut().zip(four) {
                    counts[usize::from(byte)] += 1;
                }
            }
            for &byte in odd {
                literals[0][usize::from(byte)] += 1;
            }
            if token.length > 0 {
                let length = LENGTHS[usize::from(token.length)].symbol;
                counts.symbols[END + 1 + usize::from(length)] += 1;
                counts.distances[usize::from(of_distance(token.distance).symbol)] += 1;
            }
        }
        for (byte, count) in counts.symbols.iter_mut().take(256).enumerate() {
            *count = literals.iter().map(|counts| counts[byte]).sum();
        }
        counts.symbols[END] = 1;
        counts
    }

    /// Bits of the tokens with codes of these lengths.
    fn bits(&self, symbols: &[u8], distances: &[u8]) -> u64 {
        // What follows lengths and distances does not change; symbols do not tell it of lengths, so it is taken by rank.
        let extra_length = |rank: usize| if rank == 28 { 0 } else { (rank / 4).saturating_sub(1) };
        let extra_distance = |rank: usize| (rank / 2).saturating_sub(1);
        let bits = |counts: &[u32], lengths: &[u8], extra: &dyn Fn(usize) -> usize| -> u64 {
            let each = counts.iter().zip(lengths).enumerate();
            each.map(|(rank, (&count, &length))| u64::from(count) * (u64::from(length) + extra(rank) as u64))
                .sum()
        };
        bits(&self.symbols[..=END], &symbols[..=END], &|_| 0)
            + bits(&self.symbols[END + 1..], &symbols[END + 1..], &extra_length)
            + bits(&self.distances, distances, &extra_distance)
    }
}

/// How the lengths of the codes are told: as symbols of a code of their own.
struct Description {
    symbols: usize,
    distances: usize,
    /// A symbol and what follows it.
    told: Vec<(u8, u8)>,
    lengths: [u8; DESCRIBING],
}

impl Description {
    fn new(symbols: &[u8; SYMBOLS], distances: &[u8; DISTANCES]) -> Self {
        let used = |lengths: &[u8], least: usize| {
            lengths.iter().rposition(|&length| length > 0).map_or(least, |last| least.max(last + 1))
        };
        let mut this = Self {
            symbols: used(symbols, END + 1),
            distances: used(distances, 1),
            told: Vec::with_capacity(SYMBOLS + DISTANCES),
            lengths: [0; DESCRIBING],
        };
        let all = [&symbols[..this.symbols], &distances[..this.distances]].concat();
        for run in all.chunk_by(|a, b| a == b) {
            this.tell(run[0], run.len());
        }
        let mut counts = [0; DESCRIBING];
        for &(symbol, _) in &this.told {
            counts[usize::from(symbol)] += 1;
        }
        lengths(&counts, 7, &mut this.lengths);
        this
    }

    /// The same length `count` times.
    fn tell(&mut self, length: u8, mut count: usize) {
        let (repeat, most) = if length == 0 { (17, 138) } else { (16, 6) };
        if length > 0 {
            self.told.push((length, 0));
            count -= 1;
        }
        while count >= 3 {
            let some = count.min(most);
            let long = repeat == 17 && some > 10;
            self.told.push(if long { (18, some as u8 - 11) } else { (repeat, some as u8 - 3) });
            count -= some;
        }
        self.told.extend(std::iter::repeat_n((length, 0), count));
    }

    /// Bits that follow a symbol.
    const fn extra(symbol: u8) -> u32 {
        match symbol {
            16 => 2,
            17 => 3,
            18 => 7,
            _ => 0,
        }
    }

    /// How many of the code lengths' own lengths are written.
    fn own(&self) -> usize {
        ORDER.iter().rposition(|&symbol| self.lengths[symbol] > 0).map_or(4, |last| (last + 1).max(4))
    }

    fn bits(&self) -> u64 {
        let each = self.told.iter().map(|(symbol, _)| {
            u64::from(self.lengths[usize::from(*symbol)]) + u64::from(Self::extra(*symbol))
        });
        14 + 3 * self.own() as u64 + each.sum::<u64>()
    }

    fn write(&self, bits: &mut Bits) {
        bits.add((self.symbols - END - 1) as u32, 5);
        bits.add(self.distances as u32 - 1, 5);
        bits.add(self.own() as u32 - 4, 4);
        bits.flush();
        for &symbol in &ORDER[..self.own()] {
            bits.add(u32::from(self.lengths[symbol]), 3);
            bits.flush();
        }
        let codes = codes(&self.lengths);
        for &(symbol, rest) in &self.told {
            put(bits, codes[usize::from(symbol)]);
            bits.add(u32::from(rest), Self::extra(symbol));
            bits.flush();
        }
    }
}

#[inline]
fn put(bits: &mut Bits, code: Code) {
    bits.add(u32::from(code.bits), u32::from(code.length));
}

#[inline]
fn put_range(bits: &mut Bits, code: Code, range: Range) {
    put(bits, code);
    bits.add(u32::from(range.rest), u32::from(range.extra));
}

fn write_tokens(
    bits: &mut Bits,
    bytes: &[u8],
    tokens: &[Token],
    (symbols, distances): (&[Code; SYMBOLS], &[Code; DISTANCES]),
) {
    for (run, token) in runs(bytes, tokens) {
        let (fours, odd) = run.as_chunks::<4>();
        for four in fours {
            for &byte in four {
                put(bits, symbols[usize::from(byte)]);
            }
            bits.flush();
        }
        for &byte in odd {
            put(bits, symbols[usize::from(byte)]);
        }
        bits.flush();
        if token.length > 0 {
            let length = LENGTHS[usize::from(token.length)];
            let distance = of_distance(token.distance);
            put_range(bits, symbols[END + 1 + usize::from(length.symbol)], length);
            put_range(bits, distances[usize::from(distance.symbol)], distance);
            bits.flush();
        }
    }
    put(bits, symbols[END]);
    bits.flush();
}
