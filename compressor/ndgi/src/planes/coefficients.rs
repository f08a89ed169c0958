//! The coefficients of planes: 8×8 blocks of a cosine transform, coded in the context of the magnitudes
//! around them.

use super::range::{Coder, Context};

/// Coefficients of a block.
pub(super) const BLOCK: usize = 64;
/// Diagonals of a block.
const DIAGONALS: usize = 15;
/// Magnitudes up to this are coded one by one.
const MOST: u32 = 15;

/// The order of a block's coefficients, by diagonals: row · 8 + column; and where each diagonal begins.
const ORDER: ([u8; BLOCK], [u8; DIAGONALS + 1]) = order();

const fn order() -> ([u8; BLOCK], [u8; DIAGONALS + 1]) {
    let (mut order, mut begins) = ([0; BLOCK], [0; DIAGONALS + 1]);
    let (mut n, mut diagonal) = (0, 0);
    while diagonal < DIAGONALS {
        let mut i = 0;
        while i <= diagonal {
            let (y, x) = if diagonal % 2 == 1 { (i, diagonal - i) } else { (diagonal - i, i) };
            if y < 8 && x < 8 {
                order[n] = (y * 8 + x) as u8;
                n += 1;
            }
            i += 1;
        }
        diagonal += 1;
        begins[diagonal] = n as u8;
    }
    (order, begins)
}

/// Sums of magnitudes from which a level begins.
const LEVELS: [u32; 15] = [1, 2, 3, 4, 5, 7, 9, 12, 16, 22, 30, 42, 60, 90, 140];
/// Largest sum of magnitudes: 15 times the weights of all.
const LARGEST: usize = 15 * 13;
/// The level of each sum.
const LEVEL: [u8; LARGEST + 1] = level();

const fn level() -> [u8; LARGEST + 1] {
    let (mut levels, mut sum) = ([0; LARGEST + 1], 0);
    while sum <= LARGEST {
        let mut n = 0;
        while n < LEVELS.len() && LEVELS[n] as usize <= sum {
            n += 1;
        }
        levels[sum] = n as u8;
        sum += 1;
    }
    levels
}

/// All contexts of coefficients.
#[derive(Clone, Debug)]
pub(super) struct Model {
    /// How many diagonals a block has: by those of its neighbours and of the plane before, the bits so far.
    diagonals: [[[Context; 16]; 3]; 8],
    /// A coefficient that is not 0: by whether it is the mean, on the next two diagonals or beyond, and the
    /// level of the magnitudes around it.
    nonzero: [[Context; 16]; 3],
    /// More than 1, and more than that: by level.
    more: [[Context; 16]; 2],
    /// How much more than [`MOST`].
    rest: [Context; 24],
}

impl Default for Model {
    fn default() -> Self {
        let c = Context::default();
        Model { diagonals: [[[c; 16]; 3]; 8], nonzero: [[c; 16]; 3], more: [[c; 16]; 2], rest: [c; 24] }
    }
}

/// A block of zeros: what lies past the tile and in blocks that are not covered.
const NONE: [i16; BLOCK] = [0; BLOCK];

/// A magnitude as neighbours see it.
#[inline(always)]
fn seen(value: i16) -> u32 {
    u32::from(value.unsigned_abs()).min(15)
}

/// How many diagonals of a block are not all 0.
fn diagonals(block: &[i16; BLOCK]) -> usize {
    let last = ORDER.0.iter().rposition(|&at| block[usize::from(at)] != 0);
    last.map_or(0, |last| ORDER.1.iter().filter(|&&begin| usize::from(begin) <= last).count())
}

/// The contexts of the n-th coefficient of a block.
#[inline(always)]
fn around(
    block: &[i16; BLOCK],
    n: usize,
    at: usize,
    [left, above, under]: [&[i16; BLOCK]; 3],
) -> (usize, usize) {
    let before = if !at.is_multiple_of(8) { seen(block[at - 1]) } else { 0 };
    let over = if at >= 8 { seen(block[at - 8]) } else { 0 };
    let sum = 2 * (before + over) + 3 * (seen(left[at]) + seen(above[at]) + seen(under[at]));
    (usize::from(n > 0) + usize::from(n > 5), usize::from(LEVEL[sum as usize]))
}

/// What a writer would store if bits cost nothing, and what they cost.
#[derive(Clone, Copy, Debug)]
pub(super) struct Wanted<'a> {
    /// Per block, its coefficients in steps.
    pub exact: &'a [[f32; BLOCK]],
    /// Error, in squared steps, that a bit is worth.
    pub lambda: f32,
}

impl Model {
    /// The coefficients of a block that cost least, error and bits together: in order, each is rounded to
    /// nearest or one nearer to 0; then the block ends at the best diagonal.
    fn chosen(
        &self,
        exact: &[f32; BLOCK],
        lambda: f32,
        class: [usize; 2],
        beside: [&[i16; BLOCK]; 3],
    ) -> [i16; BLOCK] {
        let mut block = [0i16; BLOCK];
        for (to, exact) in block.iter_mut().zip(exact) {
            *to = exact.round().clamp(-32767.0, 32767.0) as i16;
        }
        let most = diagonals(&block);
        let tree = &self.diagonals[class[0]][class[1]];
        let ending = |count: usize| -> f32 {
            let bits = (0..4).rev().map(|bit| {
                let node = (16 | count) >> (bit + 1);
                tree[node].bits(count >> bit & 1 == 1)
            });
            lambda * bits.sum::<f32>()
        };
        // Costs relative to those of a block of zeros.
        let (mut best, mut total) = ((ending(0), 0), 0.0);
        for diagonal in 0..most {
            for n in usize::from(ORDER.1[diagonal])..usize::from(ORDER.1[diagonal + 1]) {
                let at = usize::from(ORDER.0[n]);
                let (band, level) = around(&block, n, at, beside);
                let exact = exact[at];
                let cost = |size: u32| {
                    let error = exact.abs() - size as f32;
                    error * error - exact * exact + lambda * self.bits(band, level, size)
                };
                let size = u32::from(block[at].unsigned_abs());
                let mut least = (cost(size), size);
                if size > 0 {
                    let smaller = cost(size - 1);
                    if smaller <= least.0 {
                        least = (smaller, size - 1);
                    }
                }
                total += least.0;
                block[at] = (least.1 as i16) * block[at].signum();
            }
            let ended = total + ending(diagonal + 1);
            if ended < best.0 {
                best = (ended, diagonal + 1);
            }
        }
        for &at in &ORDER.0[usize::from(ORDER.1[best.1])..] {
            block[usize::from(at)] = 0;
        }
        block
    }

    /// Bits of a magnitude.
    fn bits(&self, band: usize, level: usize, size: u32) -> f32 {
        let mut bits = self.nonzero[band][level].bits(size > 0);
        if size == 0 {
            return bits;
        }
        let first = self.more[0][level].bits(size > 1);
        let [again, last] = [true, false].map(|more| self.more[1][level].bits(more));
        bits += 1.0 + first;
        if size > 1 {
            bits += again * (size.min(MOST) - 2) as f32 + if size < MOST { last } else { 0.0 };
        }
        if size >= MOST {
            bits += 2.0 * ((size - MOST + 1) as f32).log2() + 1.0;
        }
        bits
    }

    /// Writes or reads the coefficients of one plane, `columns` blocks across, of those blocks that are
    /// covered. `before`: the plane before it in its set, and the diagonals of its blocks. With `wanted`
    /// they are chosen. Gives the diagonals of this plane's blocks.
    pub(super) fn plane(
        &mut self,
        coder: &mut impl Coder,
        columns: usize,
        covered: &[bool],
        before: Option<(&[[i16; BLOCK]], &[u8])>,
        plane: &mut [[i16; BLOCK]],
        wanted: Option<Wanted>,
    ) -> Vec<u8> {
        let mut found = vec![0u8; plane.len()];
        for i in (0..plane.len()).filter(|&i| covered[i]) {
            let left = (!i.is_multiple_of(columns)).then(|| i - 1);
            let above = i.checked_sub(columns);
            let under = before.map_or(0, |(_, diagonals)| usize::from(diagonals[i]));
            let around = match [left, above].map(|at| at.map(|at| usize::from(found[at]))) {
                [Some(left), Some(above)] => left + above,
                [Some(one), None] | [None, Some(one)] => 2 * one,
                [None, None] => 2 * under,
            };
            let class = [0, 2, 4, 7, 11, 16, 22].iter().filter(|&&most| around > most).count();
            let class = [class, if under > 3 { 2 } else { under.min(1) }];
            let (done, rest) = plane.split_at_mut(i);
            let block = &mut rest[0];
            let missing = left.or(above).map_or(&NONE, |at| &done[at]);
            let left = left.map_or(missing, |at| &done[at]);
            let above = above.map_or(missing, |at| &done[at]);
            let under = before.map_or(&NONE, |(plane, _)| &plane[i]);
            if let Some(Wanted { exact, lambda }) = wanted {
                *block = self.chosen(&exact[i], lambda, class, [left, above, under]);
            }
            let count = diagonals(block);
            let tree = &mut self.diagonals[class[0]][class[1]];
            let mut node = 1;
            for bit in (0..4).rev() {
                node = 2 * node + usize::from(coder.bit(&mut tree[node], count >> bit & 1 == 1));
            }
            let count = node - 16;
            found[i] = count as u8;
            self.block(coder, usize::from(ORDER.1[count]), block, [left, above, under]);
        }
        found
    }

    /// The first `count` coefficients of a block, in the context of those to the left, above and in the plane
    /// before.
    #[inline(always)]
    fn block(
        &mut self,
        coder: &mut impl Coder,
        count: usize,
        block: &mut [i16; BLOCK],
        [left, above, under]: [&[i16; BLOCK]; 3],
    ) {
        for (n, &at) in ORDER.0[..count].iter().enumerate() {
            let at = usize::from(at & 63);
            let (band, level) = around(block, n, at, [left, above, under]);
            let size = u32::from(block[at].unsigned_abs());
            if !coder.bit(&mut self.nonzero[band][level], size > 0) {
                block[at] = 0;
                continue;
            }
            let mut read = 1;
            while read < MOST && coder.bit(&mut self.more[usize::from(read > 1)][level], size > read) {
                read += 1;
            }
            if read == MOST {
                read += coder.number(&mut self.rest, size.saturating_sub(MOST));
            }
            let value = i16::try_from(read).unwrap_or(i16::MAX);
            block[at] = if coder.raw(1, u32::from(block[at] < 0)) == 1 { -value } else { value };
        }
    }
}
