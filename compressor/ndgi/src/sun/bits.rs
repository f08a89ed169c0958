//! Bits one after another, the lowest of each byte first.

/// Reads bits; past the end they are 0, and the end is told.
#[derive(Debug)]
pub(super) struct Reader<'a> {
    bytes: &'a [u8],
    at: usize,
}

impl<'a> Reader<'a> {
    pub(super) fn new(bytes: &'a [u8]) -> Self {
        Reader { bytes, at: 0 }
    }

    /// The next bits, at most 16.
    #[inline]
    pub(super) fn take(&mut self, count: u32) -> u32 {
        let first = self.at / 8;
        let word = match self.bytes.get(first..first + 4) {
            Some(four) => u32::from_le_bytes([four[0], four[1], four[2], four[3]]),
            None => {
                (0..4).map(|i| u32::from(self.bytes.get(first + i).copied().unwrap_or(0)) << (8 * i)).sum()
            }
        };
        let bits = word >> (self.at % 8) & ((1 << count) - 1);
        self.at += count as usize;
        bits
    }

    /// Whether all bytes were read, no bit past them, and what is left of the last is 0.
    pub(super) fn is_at_end(&mut self) -> bool {
        let left = (8 * self.bytes.len()).checked_sub(self.at);
        left.is_some_and(|left| left < 8 && self.take(left as u32) == 0)
    }
}

/// Writes bits.
#[derive(Debug, Default)]
pub(super) struct Writer {
    bytes: Vec<u8>,
    used: u32,
    word: u32,
}

impl Writer {
    pub(super) fn put(&mut self, value: u32, count: u32) {
        self.word |= value << self.used;
        self.used += count;
        while self.used >= 8 {
            self.bytes.push(self.word as u8);
            (self.word, self.used) = (self.word >> 8, self.used - 8);
        }
    }

    pub(super) fn finish(mut self) -> Vec<u8> {
        if self.used > 0 {
            self.bytes.push(self.word as u8);
        }
        self.bytes
    }
}
