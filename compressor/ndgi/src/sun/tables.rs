//! How the levels of a bundle are coded: a palette of patterns, and how frequent each symbol is in its
//! context.
//!
//! Symbols are coded by asymmetric numeral systems over tables (Duda 2013): decoding one is a look-up and a
//! few bits.

use super::bits::Reader;

/// Contexts of modes and of patterns.
pub(super) const MODE_CONTEXTS: usize = 162;
pub(super) const PATTERN_CONTEXTS: usize = 81;
/// Modes: dark, lit, mixed.
pub(super) const MODES: usize = 3;
/// Patterns of the palette.
pub(super) const PALETTE: usize = 256;
/// Symbols of patterns: dark, lit, those of the palette, any other.
pub(super) const PATTERNS: usize = PALETTE + 3;
pub(super) const OTHER: usize = PATTERNS - 1;
/// Frequencies add up to 2 to the power of this.
pub(super) const MODE_BITS: u32 = 7;
pub(super) const PATTERN_BITS: u32 = 10;

/// How levels are coded. Equal ones have equal bytes.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Tables {
    /// Two rows of two levels: that of texel (x, y) in bits 3 (2 y + x) and up.
    pub(super) palette: Vec<u16>,
    /// Per context: how frequent each mode is, together 2^[`MODE_BITS`].
    pub(super) modes: Vec<[u16; MODES]>,
    /// Per context: how frequent each symbol of a pattern is, together 2^[`PATTERN_BITS`].
    pub(super) patterns: Vec<Vec<u16>>,
}

impl Tables {
    /// Tables by counts of each symbol, and of each pattern that was none of dark and lit.
    pub(super) fn of_counts(palette: Vec<u16>, modes: &[[u32; MODES]], patterns: &[Vec<u32>]) -> Self {
        let mode = |counts: &[u32; MODES]| {
            let scaled = scaled(counts, &[true; MODES], MODE_BITS);
            [scaled[0], scaled[1], scaled[2]]
        };
        let is_kept = |symbol: usize| symbol < 2 || symbol == OTHER;
        let kept: Vec<bool> = (0..PATTERNS).map(is_kept).collect();
        Tables {
            palette,
            modes: modes.iter().map(mode).collect(),
            patterns: patterns.iter().map(|counts| scaled(counts, &kept, PATTERN_BITS)).collect(),
        }
    }

    /// The bytes of the header.
    pub(crate) fn encode(&self) -> Vec<u8> {
        let mut bytes: Vec<u8> = self.palette.iter().flat_map(|pattern| pattern.to_le_bytes()).collect();
        bytes.extend(self.modes.as_flattened().iter().map(|frequency| *frequency as u8));
        for frequencies in &self.patterns {
            let there: Vec<usize> = (0..PATTERNS).filter(|&symbol| frequencies[symbol] > 0).collect();
            put(&mut bytes, there.len());
            let mut next = 0;
            for symbol in there {
                put(&mut bytes, symbol - next);
                put(&mut bytes, usize::from(frequencies[symbol]));
                next = symbol + 1;
            }
        }
        bytes
    }

    /// Tables from the bytes of a header, which are all theirs.
    pub(crate) fn decode(bytes: &[u8]) -> Result<Self, String> {
        let short = || "tables of the sun's levels are cut short".to_owned();
        let (palette, rest) = bytes.split_at_checked(2 * PALETTE).ok_or_else(short)?;
        let (modes, mut rest) = rest.split_at_checked(MODES * MODE_CONTEXTS).ok_or_else(short)?;
        let palette: Vec<u16> =
            palette.as_chunks::<2>().0.iter().map(|two| u16::from_le_bytes(*two)).collect();
        let modes: Vec<[u16; MODES]> =
            modes.as_chunks::<MODES>().0.iter().map(|m| m.map(u16::from)).collect();
        let mut patterns = Vec::with_capacity(PATTERN_CONTEXTS);
        for _ in 0..PATTERN_CONTEXTS {
            let (mut frequencies, mut next) = (vec![0; PATTERNS], 0);
            for _ in 0..take(&mut rest).ok_or_else(short)? {
                let symbol = next + take(&mut rest).ok_or_else(short)?;
                let frequency = take(&mut rest).ok_or_else(short)?;
                let place = frequencies.get_mut(symbol).filter(|_| frequency > 0);
                *place.ok_or("an invalid symbol of the sun's levels")? = frequency as u16;
                next = symbol + 1;
            }
            patterns.push(frequencies);
        }
        let is_whole = |frequencies: &[u16], bits: u32| {
            frequencies.iter().map(|f| u32::from(*f)).sum::<u32>() == 1 << bits
        };
        let whole = rest.is_empty()
            && palette.iter().all(|pattern| *pattern < 1 << 12)
            && modes.iter().all(|modes| is_whole(modes, MODE_BITS))
            && patterns.iter().all(|frequencies| is_whole(frequencies, PATTERN_BITS));
        if whole {
            Ok(Tables { palette, modes, patterns })
        } else {
            Err("tables of the sun's levels whose frequencies do not add up".to_owned())
        }
    }
}

/// A number in one byte, or two from 128 on.
fn put(bytes: &mut Vec<u8>, number: usize) {
    match number {
        0..128 => bytes.push(number as u8),
        _ => bytes.extend([number as u8 | 128, (number >> 7) as u8]),
    }
}

fn take(bytes: &mut &[u8]) -> Option<usize> {
    let (first, rest) = bytes.split_first()?;
    *bytes = rest;
    if *first < 128 {
        return Some(usize::from(*first));
    }
    let (second, rest) = bytes.split_first()?;
    *bytes = rest;
    Some(usize::from(*first & 127) | usize::from(*second) << 7)
}

/// Frequencies of counts that add up to a power of two; at least 1 where there is a count, or one is to be
/// kept.
fn scaled(counts: &[u32], kept: &[bool], bits: u32) -> Vec<u16> {
    let total = counts.iter().map(|count| u64::from(*count)).sum::<u64>().max(1);
    let whole = 1u64 << bits;
    let share = |count: u32| (u64::from(count) * whole * 2 + total) / (2 * total);
    let mut frequencies: Vec<u64> = counts
        .iter()
        .zip(kept)
        .map(|(&count, kept)| share(count).max(u64::from(count > 0 || *kept)))
        .collect();
    // What is too much is taken from the most frequent, what is missing given to it.
    loop {
        let sum: u64 = frequencies.iter().sum();
        let largest = (0..frequencies.len()).max_by_key(|&i| (frequencies[i], usize::MAX - i)).unwrap_or(0);
        match sum.cmp(&whole) {
            std::cmp::Ordering::Equal => break,
            std::cmp::Ordering::Less => frequencies[largest] += whole - sum,
            std::cmp::Ordering::Greater if frequencies[largest] > 1 => {
                frequencies[largest] -= (sum - whole).min(frequencies[largest] / 2).max(1);
            }
            // (There are fewer symbols than the whole.)
            std::cmp::Ordering::Greater => unreachable!("more symbols than the whole"),
        }
    }
    frequencies.into_iter().map(|frequency| frequency as u16).collect()
}

/// Which symbol stands at each state.
fn spread(frequencies: &[u16], bits: u32) -> Vec<u16> {
    let whole = 1usize << bits;
    let (mut at, mut symbols) = (0, vec![0; whole]);
    for (symbol, frequency) in frequencies.iter().enumerate() {
        for _ in 0..*frequency {
            symbols[at] = symbol as u16;
            at = (at + whole / 2 + whole / 8 + 3) & (whole - 1);
        }
    }
    symbols
}

/// What a state decodes to: its symbol, and base and number of bits of the next state.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct Step {
    pub symbol: u16,
    base: u16,
    bits: u8,
}

impl Step {
    /// The state before.
    #[inline]
    pub(super) fn before(&self, reader: &mut Reader) -> u32 {
        u32::from(self.base) + reader.take(u32::from(self.bits))
    }
}

/// Per state, its step.
pub(super) fn steps(frequencies: &[u16], bits: u32) -> Vec<Step> {
    let mut next: Vec<u32> = frequencies.iter().map(|frequency| u32::from(*frequency)).collect();
    let step = |symbol: u16| {
        let x = next[usize::from(symbol)];
        next[usize::from(symbol)] += 1;
        let count = bits - x.ilog2();
        Step { symbol, base: ((x << count) - (1 << bits)) as u16, bits: count as u8 }
    };
    spread(frequencies, bits).into_iter().map(step).collect()
}

/// Codes symbols, the last one first.
#[derive(Debug)]
pub(super) struct Stack<'a> {
    frequencies: &'a [u16],
    bits: u32,
    /// Per symbol, the states that stand for it.
    states: Vec<Vec<u32>>,
}

impl<'a> Stack<'a> {
    pub(super) fn new(frequencies: &'a [u16], bits: u32) -> Self {
        let mut states = vec![Vec::new(); frequencies.len()];
        for (state, symbol) in (0u32..).zip(spread(frequencies, bits)) {
            states[usize::from(symbol)].push(state);
        }
        Stack { frequencies, bits, states }
    }

    /// Whether a symbol can be coded.
    pub(super) fn has(&self, symbol: usize) -> bool {
        self.frequencies[symbol] > 0
    }

    /// The state that stands for a symbol before a state, and the bits, with their number, that the decoder
    /// reads after it.
    pub(super) fn push(&self, state: u32, symbol: usize) -> (u32, (u32, u32)) {
        let (x, frequency) = (state + (1 << self.bits), u32::from(self.frequencies[symbol]));
        let mut count = self.bits - frequency.ilog2();
        if x >> count < frequency {
            count -= 1;
        }
        (self.states[symbol][(x >> count) as usize - frequency as usize], (x & ((1 << count) - 1), count))
    }
}

#[cfg(test)]
mod tests {
    use super::super::bits::Writer;
    use super::*;

    #[test]
    fn symbols_come_back_at_the_bits_that_their_frequencies_tell() {
        let counts = [900u32, 3, 50, 0, 47];
        let frequencies = scaled(&counts, &[false; 5], 10);
        assert_eq!(frequencies.iter().sum::<u16>(), 1024);
        assert!(frequencies[1] >= 1 && frequencies[3] == 0);
        let stack = Stack::new(&frequencies, 10);
        let mut random = crate::testing::Random(5);
        let symbols: Vec<usize> = (0..20_000)
            .map(|_| {
                let at = random.below(1000) as u32;
                (0..5).find(|&s| counts[..=s].iter().sum::<u32>() > at).unwrap()
            })
            .collect();
        let (mut state, mut bits) = (0, Vec::new());
        for &symbol in symbols.iter().rev() {
            let (next, put) = stack.push(state, symbol);
            bits.push(put);
            state = next;
        }
        let mut writer = Writer::default();
        writer.put(state, 10);
        bits.into_iter().rev().for_each(|(value, count)| writer.put(value, count));
        let bytes = writer.finish();
        let entropy: f64 = counts
            .iter()
            .filter(|count| **count > 0)
            .map(|count| f64::from(*count) * -(f64::from(*count) / 1000.0).log2())
            .sum::<f64>()
            * 20.0;
        assert!(
            (bytes.len() as f64 * 8.0) < 1.03 * entropy,
            "{} bytes, entropy {}",
            bytes.len(),
            entropy / 8.0
        );
        let steps = steps(&frequencies, 10);
        let mut reader = Reader::new(&bytes);
        let mut state = reader.take(10);
        for symbol in symbols {
            let step = steps[state as usize];
            assert_eq!(usize::from(step.symbol), symbol);
            state = step.before(&mut reader);
        }
        assert_eq!(state, 0);
        assert!(reader.is_at_end());
    }

    #[test]
    fn tables_are_read_as_they_were_written_and_hostile_ones_refused() {
        let mut random = crate::testing::Random(1);
        let modes: Vec<[u32; 3]> =
            (0..MODE_CONTEXTS).map(|_| [0; 3].map(|_: u32| random.below(50) as u32)).collect();
        let patterns: Vec<Vec<u32>> = (0..PATTERN_CONTEXTS)
            .map(|_| (0..PATTERNS).map(|_| (random.below(20) / 15) as u32).collect())
            .collect();
        let palette = (0..PALETTE as u16).map(|i| 13 * i % 4096).collect();
        let tables = Tables::of_counts(palette, &modes, &patterns);
        let bytes = tables.encode();
        assert_eq!(Tables::decode(&bytes), Ok(tables));
        for length in 0..bytes.len() {
            assert!(Tables::decode(&bytes[..length]).is_err(), "{length}");
        }
        for at in (0..bytes.len()).step_by(3) {
            let mut bad = bytes.clone();
            bad[at] ^= 1 << random.below(8);
            // Some changes of the palette are no fault.
            if let Ok(found) = Tables::decode(&bad) {
                assert_eq!(found.encode(), bad, "{at}");
            }
        }
    }
}
