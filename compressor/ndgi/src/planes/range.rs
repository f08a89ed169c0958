//! Binary range coding with adaptive probabilities. One trait serves the writer and the reader, so that both
//! go through the same contexts.

use std::sync::LazyLock;

/// The probability that a bit is 0, learnt from the bits before it.
#[derive(Clone, Copy, Debug)]
pub(super) struct Context {
    /// In 2⁻¹⁶.
    zero: u16,
    /// Bits seen, at most as many as there are [`SHIFTS`], less one.
    seen: u8,
}

impl Default for Context {
    fn default() -> Self {
        Context { zero: 1 << 15, seen: 0 }
    }
}

/// A bit moves the probability by 2⁻ˢ of its distance: s, by the number of bits seen before.
const SHIFTS: [u8; 16] = [1, 2, 2, 3, 3, 3, 3, 4, 4, 4, 4, 4, 4, 4, 4, 5];
/// Neither bit is less probable than this.
const LEAST: u16 = 64;

/// Bits of a bit by its probability in 1/256.
static COSTS: LazyLock<[f32; 257]> =
    LazyLock::new(|| std::array::from_fn(|p| -((p as f32 + 0.5) / 256.0).min(1.0).log2()));

impl Context {
    #[inline(always)]
    fn zero(self) -> u32 {
        u32::from(self.zero.clamp(LEAST, u16::MAX - LEAST))
    }

    /// Bits that a bit costs.
    pub(super) fn bits(self, bit: bool) -> f32 {
        let zero = self.zero();
        COSTS[((if bit { 65536 - zero } else { zero }) >> 8) as usize]
    }

    #[inline(always)]
    fn learn(&mut self, bit: bool) {
        let shift = SHIFTS[usize::from(self.seen & 15)];
        match bit {
            false => self.zero += (u16::MAX - self.zero) >> shift,
            true => self.zero -= self.zero >> shift,
        }
        self.seen += u8::from(self.seen < 15);
    }
}

/// A writer, which takes bits, or a reader, which ignores what it is given; both return the bit.
pub(super) trait Coder {
    /// One bit.
    fn bit(&mut self, context: &mut Context, bit: bool) -> bool;
    /// Bits of equal probability, the highest first.
    fn raw(&mut self, bits: u32, value: u32) -> u32;

    /// A number ≥ 0 by Elias' code of value + 1: its length by contexts, the rest raw. At most 2³⁰ − 2.
    fn number(&mut self, contexts: &mut [Context], value: u32) -> u32 {
        let length = 31 - (value + 1).leading_zeros();
        let mut read = 0;
        while read < 29 {
            let at = (read as usize).min(contexts.len() - 1);
            if !self.bit(&mut contexts[at], read < length) {
                break;
            }
            read += 1;
        }
        ((1 << read) | self.raw(read, (value + 1) & ((1 << length) - 1))) - 1
    }

    /// A number of either sign.
    fn signed(&mut self, contexts: &mut [Context], value: i32) -> i32 {
        let size = self.number(contexts, value.unsigned_abs()) as i32;
        if size != 0 && self.raw(1, u32::from(value < 0)) == 1 { -size } else { size }
    }
}

/// Below this the range is widened by a byte.
const NARROW: u32 = 1 << 24;

/// Writes bits.
#[derive(Debug)]
pub(super) struct Writer {
    low: u64,
    range: u32,
    /// The last byte, which a carry may still change, and the number of bytes 0xff behind it.
    held: Option<u8>,
    ones: usize,
    bytes: Vec<u8>,
}

impl Default for Writer {
    fn default() -> Self {
        Writer { low: 0, range: u32::MAX, held: None, ones: 0, bytes: Vec::new() }
    }
}

impl Writer {
    fn shift(&mut self) {
        let carry = (self.low >> 32) as u8;
        let top = (self.low >> 24) as u8;
        if carry == 0 && top == 0xff {
            self.ones += 1;
        } else {
            if let Some(held) = self.held {
                self.bytes.push(held.wrapping_add(carry));
            }
            let between = 0xffu8.wrapping_add(carry);
            self.bytes.extend(std::iter::repeat_n(between, self.ones));
            (self.held, self.ones) = (Some(top), 0);
        }
        self.low = (self.low & 0x00ff_ffff) << 8;
    }

    fn widen(&mut self) {
        while self.range < NARROW {
            self.range <<= 8;
            self.shift();
        }
    }

    /// The bytes; zeros at the end are left out, as readers continue with zeros.
    pub(super) fn finish(mut self) -> Vec<u8> {
        for _ in 0..5 {
            self.shift();
        }
        while self.bytes.last() == Some(&0) {
            self.bytes.pop();
        }
        self.bytes
    }
}

impl Coder for Writer {
    fn bit(&mut self, context: &mut Context, bit: bool) -> bool {
        let zero = (self.range >> 16) * context.zero();
        if bit {
            self.low += u64::from(zero);
            self.range -= zero;
        } else {
            self.range = zero;
        }
        context.learn(bit);
        self.widen();
        bit
    }

    fn raw(&mut self, bits: u32, value: u32) -> u32 {
        for i in (0..bits).rev() {
            self.range >>= 1;
            if value >> i & 1 == 1 {
                self.low += u64::from(self.range);
            }
            self.widen();
        }
        value
    }
}

/// Reads bits; behind the last byte it reads zeros.
#[derive(Debug)]
pub(super) struct Reader<'a> {
    code: u32,
    range: u32,
    bytes: &'a [u8],
    /// Bytes read, those behind the last one too.
    at: usize,
}

impl<'a> Reader<'a> {
    pub(super) fn new(bytes: &'a [u8]) -> Self {
        let mut reader = Reader { code: 0, range: u32::MAX, bytes, at: 0 };
        for _ in 0..4 {
            reader.code = reader.code << 8 | reader.byte();
        }
        reader
    }

    #[inline(always)]
    fn byte(&mut self) -> u32 {
        let byte = self.bytes.get(self.at).map_or(0, |byte| u32::from(*byte));
        self.at += 1;
        byte
    }

    #[inline(always)]
    fn widen(&mut self) {
        while self.range < NARROW {
            self.range <<= 8;
            self.code = self.code << 8 | self.byte();
        }
    }

    /// How many bytes were read, those behind the last one too.
    pub(super) fn read(&self) -> usize {
        self.at
    }
}

impl Coder for Reader<'_> {
    #[inline(always)]
    fn bit(&mut self, context: &mut Context, _: bool) -> bool {
        let zero = (self.range >> 16) * context.zero();
        let bit = self.code >= zero;
        if bit {
            self.code -= zero;
            self.range -= zero;
        } else {
            self.range = zero;
        }
        context.learn(bit);
        self.widen();
        bit
    }

    #[inline(always)]
    fn raw(&mut self, bits: u32, _: u32) -> u32 {
        let mut value = 0;
        for _ in 0..bits {
            self.range >>= 1;
            let bit = self.code >= self.range;
            if bit {
                self.code -= self.range;
            }
            value = value << 1 | u32::from(bit);
            self.widen();
        }
        value
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::testing::Random;

    /// Writes or reads a mixture of bits of many probabilities, raw bits and numbers.
    fn walk(coder: &mut impl Coder, values: &[(u32, i32)]) -> Vec<(u32, i32)> {
        let mut contexts = [Context::default(); 40];
        let (bits, numbers) = contexts.split_at_mut(16);
        let walk = |&(a, b): &(u32, i32)| {
            let bit = coder.bit(&mut bits[(a % 16) as usize], a & 64 != 0);
            let rest = coder.raw(7, a >> 7 & 0x7f);
            (u32::from(bit) << 6 | rest << 7 | a & 0x3f, coder.signed(numbers, b))
        };
        values.iter().map(walk).collect()
    }

    #[test]
    fn what_is_written_is_read() {
        let mut random = Random(1);
        for rounds in [0, 1, 2, 3, 10, 1000, 20_000] {
            for bias in [0, 1, 8, 64] {
                let mut value = || {
                    let a = random.draw() as u32 & 0x3fff;
                    let a = if random.below(65) < bias { a | 64 } else { a & !64 };
                    let b = (random.draw() as i32 >> 2) >> random.below(31);
                    (a, b.clamp(-(1 << 29), 1 << 29))
                };
                let values: Vec<_> = (0..rounds).map(|_| value()).collect();
                let mut writer = Writer::default();
                walk(&mut writer, &values);
                let bytes = writer.finish();
                let mut reader = Reader::new(&bytes);
                let found = walk(&mut reader, &values.iter().map(|v| (v.0 & 0x3f, 0)).collect::<Vec<_>>());
                assert_eq!(found, values);
                // All bytes are needed; at most four are read past them, and fewer than four are not.
                assert!(reader.read() >= bytes.len() && reader.read() < bytes.len() + 9, "{}", reader.read());
            }
        }
    }

    #[test]
    fn coding_costs_what_entropy_says() {
        let mut random = Random(2);
        for per_mille in [1u32, 10, 100, 300, 500, 900, 999] {
            let bits: Vec<bool> = (0..200_000).map(|_| random.below(1000) < per_mille as usize).collect();
            let mut writer = Writer::default();
            let mut context = Context::default();
            bits.iter().for_each(|bit| _ = writer.bit(&mut context, *bit));
            let p = f64::from(per_mille) / 1000.0;
            let entropy = -(p * p.log2() + (1.0 - p) * (1.0 - p).log2()) * bits.len() as f64 / 8.0;
            let found = writer.finish().len() as f64;
            assert!(
                found > 0.97 * entropy && found < 1.05 * entropy + 160.0,
                "{per_mille}: {found} {entropy}"
            );
        }
    }
}
