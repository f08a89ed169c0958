//! Shadows that move between the times of visibility: codewords of a fixed codebook, added to visibility that
//! is linear between times.
//!
//! Codewords are not entropy-coded. A reader adds up at most 15 lengths and 15 counts to find those of a
//! texel, so a shader could read the section unchanged; `ndgi-gpu` repacks it by block.

use crate::model::Section;

/// Steps from one time to the next. At the 11 ends within codewords are added; between ends visibility is
/// linear.
pub const STEPS: usize = 12;
/// Side in texels of what a codeword covers.
pub const SIDE: usize = 4;
/// Entries of the codebook.
pub const ENTRIES: usize = 2048;
/// The unit of a codeword's values.
pub const UNIT: f32 = 1.0 / 7.0;
/// Most codewords on 4×4 texels.
pub const MOST: usize = 3;
/// Side in texels of a block, which one codeword may cover: each of its values then covers 2×2 texels.
const BLOCK: usize = 2 * SIDE;
/// Side in texels of a group of 4×4 blocks.
const GROUP: usize = 4 * BLOCK;

/// Per entry and step from 1 on, texel by texel and row by row: 7 more than the value, the first of two in
/// the lower four bits.
static TABLE: &[u8; ENTRIES * (STEPS - 1) * 8] = include_bytes!("words.bin");

/// A codeword, what is added on 4×4 texels: an entry of the codebook, transformed.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Word(pub u16);

impl Word {
    /// Of an entry and its transform, whose bits are: 0 negates, 1 reverses time, 2 transposes, 3 mirrors
    /// columns, 4 mirrors rows; applied from bit 4 down to bit 0.
    pub fn new(entry: usize, turning: usize) -> Self {
        Word((turning << 11 | entry) as u16)
    }

    /// Values of an entry of the table at a step from 1 to 11, in sevenths, row by row.
    pub fn entry(entry: usize, step: usize) -> [i8; SIDE * SIDE] {
        let at = (entry * (STEPS - 1) + step - 1) * 8;
        std::array::from_fn(|i| (TABLE[at + i / 2] >> (i % 2 * 4) & 15) as i8 - 7)
    }

    /// The texel of an entry that a turning brings to (x, y), by its place in the row-by-row order.
    pub fn source(turning: usize, x: usize, y: usize) -> usize {
        let (x, y) = if turning & 4 != 0 { (y, x) } else { (x, y) };
        let x = if turning & 8 != 0 { SIDE - 1 - x } else { x };
        let y = if turning & 16 != 0 { SIDE - 1 - y } else { y };
        y * SIDE + x
    }

    /// The step of an entry that a turning brings to a step.
    pub fn source_step(turning: usize, step: usize) -> usize {
        if turning & 2 != 0 { STEPS - step } else { step }
    }

    /// What it adds at a step, in sevenths, row by row; nothing at the times themselves.
    pub fn values(self, step: usize) -> [i8; SIDE * SIDE] {
        if step == 0 || step == STEPS {
            return [0; SIDE * SIDE];
        }
        let (entry, turning) = (usize::from(self.0) % ENTRIES, usize::from(self.0) / ENTRIES);
        let of = Self::entry(entry, Self::source_step(turning, step));
        let sign = if turning & 1 != 0 { -1 } else { 1 };
        std::array::from_fn(|i| sign * of[Self::source(turning, i % SIDE, i / SIDE)])
    }
}

/// What a block of 8×8 texels has over an interval.
#[derive(Clone, Debug, Default, PartialEq)]
pub enum Block {
    /// Visibility is linear.
    #[default]
    Nothing,
    /// One word, each of whose texels is 2×2.
    Doubled(Word),
    /// Up to [`MOST`] words on each 4×4: upper left, upper right, lower left, lower right.
    Words([Vec<Word>; 4]),
}

/// How many blocks cover a tile, across and down.
fn blocks(size: [usize; 2]) -> [usize; 2] {
    size.map(|side| side.div_ceil(BLOCK))
}

/// A tile's section: by channel and interval, the blocks row by row; an empty one where all have nothing.
///
/// # Panics
/// Unless each plane has as many blocks as cover the tile, and none of them more words than it may.
pub fn encode(planes: &[Vec<Block>], size: [usize; 2]) -> Section {
    let [across, down] = blocks(size);
    let (mut ends, mut data) = (Vec::new(), Vec::new());
    for plane in planes {
        assert_eq!(plane.len(), across * down, "blocks of the tile");
        let (mut sizes, mut groups) = (Vec::new(), Vec::new());
        for row in (0..down).step_by(4) {
            for column in (0..across).step_by(4) {
                let inside = |i: usize| (row + i / 4 < down && column + i % 4 < across).then_some(i);
                let block = |i: usize| {
                    inside(i).map_or(&Block::Nothing, |i| &plane[(row + i / 4) * across + column + i % 4])
                };
                let group = encode_group(std::array::from_fn(block));
                sizes.push((group.len() / 2) as u8);
                groups.extend(group);
            }
        }
        if !groups.is_empty() {
            sizes.resize(sizes.len().next_multiple_of(2), 0);
            data.extend(sizes);
            data.extend(groups);
        }
        ends.extend((data.len() as u32 / 2).to_le_bytes());
    }
    if data.is_empty() {
        return Section::default();
    }
    ends.extend(data);
    ends.resize(ends.len().next_multiple_of(16), 0);
    Section { word: 0, bytes: ends }
}

fn encode_group(blocks: [&Block; 16]) -> Vec<u8> {
    let (mut modes, mut nibbles, mut words) = (0u32, Vec::new(), Vec::new());
    for (i, block) in blocks.into_iter().enumerate() {
        let mode = match block {
            Block::Nothing => 0,
            Block::Doubled(word) => {
                words.push(*word);
                1
            }
            Block::Words(of) => {
                words.extend(of.iter().flatten());
                let counts = of.each_ref().map(|words| words.len() as u8);
                assert!(counts.iter().all(|count| usize::from(*count) <= MOST), "words of a block");
                match counts {
                    [0, 0, 0, 0] => 0,
                    [a @ (0 | 1), b @ (0 | 1), c @ (0 | 1), d @ (0 | 1)] => {
                        nibbles.push(a | b << 1 | c << 2 | d << 3);
                        2
                    }
                    [a, b, c, d] => {
                        nibbles.extend([a | b << 2, c | d << 2]);
                        3
                    }
                }
            }
        };
        modes |= mode << (2 * i);
    }
    if modes == 0 {
        return Vec::new();
    }
    nibbles.resize(nibbles.len().next_multiple_of(4), 0);
    let mut bytes = modes.to_le_bytes().to_vec();
    bytes.extend(nibbles.as_chunks::<2>().0.iter().map(|[low, high]| low | high << 4));
    bytes.extend(words.iter().flat_map(|word| word.0.to_le_bytes()));
    bytes
}

/// What a section says of one block.
#[derive(Clone, Copy, Debug, Default)]
struct Coded<'a> {
    is_doubled: bool,
    /// Words on each 4×4, or one in all.
    counts: [u8; 4],
    /// Two bytes each.
    words: &'a [u8],
}

impl Coded<'_> {
    /// The words on a 4×4 of the block, in order.
    fn on(&self, quarter: usize) -> impl Iterator<Item = Word> {
        let (skip, count) = match self.is_doubled {
            true => (0, 1),
            false => (self.counts[..quarter].iter().map(|n| usize::from(*n)).sum(), self.counts[quarter]),
        };
        let words = self.words.as_chunks::<2>().0.iter().skip(skip).take(count.into());
        words.map(|word| Word(u16::from_le_bytes(*word)))
    }
}

/// The 16 blocks of a group that has some bytes.
fn group(bytes: &[u8]) -> Result<[Coded<'_>; 16], String> {
    let cut = || "a group of moving shadows is cut short".to_owned();
    let (modes, rest) = bytes.split_first_chunk::<4>().ok_or_else(cut)?;
    let modes = u32::from_le_bytes(*modes);
    let mode = |i: usize| modes >> (2 * i) & 3;
    let count: usize = (0..16).map(|i| [0, 0, 1, 2][mode(i) as usize]).sum();
    let (nibbles, mut words) = rest.split_at_checked(count.div_ceil(4) * 2).ok_or_else(cut)?;
    let nibble = |i: usize| nibbles[i / 2] >> (i % 2 * 4) & 15;
    let (mut reported, mut at) = ([Coded::default(); 16], 0);
    for (i, reported) in reported.iter_mut().enumerate() {
        let counts = match mode(i) {
            0 => continue,
            1 => [1, 0, 0, 0],
            2 => [0, 1, 2, 3].map(|k| nibble(at) >> k & 1),
            _ => [0, 1, 2, 3].map(|k| nibble(at + k / 2) >> (k % 2 * 2) & 3),
        };
        at += [0, 0, 1, 2][mode(i) as usize];
        let of = 2 * counts.iter().map(|n| usize::from(*n)).sum::<usize>();
        let (own, tail) = words.split_at_checked(of).ok_or_else(cut)?;
        *reported = Coded { is_doubled: mode(i) == 1, counts, words: own };
        words = tail;
    }
    if !words.is_empty() {
        return Err(format!("a group of moving shadows is {} bytes too long", words.len()));
    }
    if modes == 0 || (at..2 * nibbles.len()).any(|i| nibble(i) != 0) {
        return Err("a group of moving shadows is empty, or padded with other bytes than zeros".to_owned());
    }
    Ok(reported)
}

/// The groups of a plane that have some bytes, with their numbers.
fn groups(plane: &[u8], count: usize) -> impl Iterator<Item = Result<(usize, &[u8]), String>> {
    let sizes = if plane.is_empty() { &[] } else { plane.get(..count).unwrap_or(plane) };
    let mut rest = plane.get(count.next_multiple_of(2)..).unwrap_or_default();
    sizes.iter().enumerate().filter(|(_, size)| **size > 0).map(move |(i, size)| {
        let (group, tail) =
            rest.split_at_checked(2 * usize::from(*size)).ok_or("groups of moving shadows are cut short")?;
        rest = tail;
        Ok((i, group))
    })
}

/// The planes of a section, by channel and interval, and what follows them.
fn planes_of(bytes: &[u8], count: usize) -> Result<(Vec<&[u8]>, &[u8]), String> {
    let (ends, data) =
        bytes.split_at_checked(4 * count).ok_or("plane ends of moving shadows are cut short")?;
    let (mut planes, mut from) = (Vec::with_capacity(count), 0usize);
    for (plane, end) in ends.as_chunks::<4>().0.iter().enumerate() {
        let end = usize::try_from(u64::from(u32::from_le_bytes(*end)) * 2).unwrap_or(usize::MAX);
        planes.push(
            data.get(from..end).ok_or_else(|| format!("plane {plane} of moving shadows ends at {end}"))?,
        );
        from = end;
    }
    Ok((planes, &data[from..]))
}

/// The largest sum over channels of planes' lengths, by channel and interval.
fn most(lengths: &[usize], intervals: usize) -> usize {
    let of = |interval: usize| lengths.iter().skip(interval).step_by(intervals).sum();
    (0..intervals).map(of).max().unwrap_or(0)
}

/// How the shadows of a tile move.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Shadows {
    /// By channel and interval, as they lie in the section; none where nothing moves.
    planes: Vec<Vec<u8>>,
    /// Groups across and down.
    groups: [usize; 2],
}

/// Visibility at `at` within an interval at whose ends it is `ends`. `values`: per codeword, in order, its
/// value at the step before and the step after.
fn moved(ends: [f32; 2], at: Step, values: impl Iterator<Item = [i8; 2]>) -> f32 {
    let linear = |step: usize| ends[0] + (ends[1] - ends[0]) * (step as f32 / STEPS as f32);
    let mut seen = [linear(at.before), linear(at.before + 1)];
    for values in values {
        (0..2).for_each(|k| seen[k] = (seen[k] + f32::from(values[k]) * UNIT).clamp(0.0, 1.0));
    }
    seen[0] * (1.0 - at.part) + seen[1] * at.part
}

/// The step before a share of an interval, and how far it is to the next.
#[derive(Clone, Copy, Debug)]
struct Step {
    before: usize,
    part: f32,
}

impl Step {
    fn of(share: f32) -> Self {
        let at = share * STEPS as f32;
        let before = (at as usize).min(STEPS - 1);
        Step { before, part: at - before as f32 }
    }
}

impl Shadows {
    /// From a tile's section; with `only` of that interval alone, as if there were no other.
    ///
    /// # Errors
    /// What the format forbids.
    pub fn decode(
        section: (u32, &[u8]),
        size: [usize; 2],
        channels: usize,
        intervals: usize,
        only: Option<usize>,
    ) -> Result<Self, String> {
        let (word, bytes) = section;
        if word != 0 {
            return Err(format!("word {word:#x} of moving shadows; expected 0"));
        }
        let across_down = size.map(|side| side.div_ceil(GROUP));
        let (of_section, rest) = planes_of(bytes, channels * intervals)?;
        let mut planes = Vec::new();
        for (plane, bytes) in of_section.into_iter().enumerate() {
            if only.is_some_and(|only| plane % intervals != only) {
                continue;
            }
            let count = across_down[0] * across_down[1];
            let mut length = if bytes.is_empty() { 0 } else { count.next_multiple_of(2) };
            if bytes.get(count..length).is_some_and(|filling| filling.iter().any(|byte| *byte != 0)) {
                return Err("a plane of moving shadows is padded with a byte other than zero".to_owned());
            }
            for part in groups(bytes, count) {
                let (_, bytes) = part?;
                group(bytes)?;
                length += bytes.len();
            }
            if length != bytes.len() {
                return Err(format!("a plane of moving shadows of {} bytes; expected {length}", bytes.len()));
            }
            planes.push(bytes.to_vec());
        }
        if rest.len() >= 16 || rest.iter().any(|byte| *byte != 0) {
            return Err("only zeros up to the next multiple of 16 may follow moving shadows".to_owned());
        }
        Ok(Shadows { planes, groups: across_down })
    }

    /// What blocks of 8×8 texels have over an interval, with their numbers, row by row: those with some
    /// words. `size` is the tile's.
    pub fn blocks(
        &self,
        (channels, channel, interval): (usize, usize, usize),
        size: [usize; 2],
    ) -> Vec<(usize, Block)> {
        let ([across, down], [wide, high]) = (self.groups, blocks(size));
        let Some(plane) = self.plane(channels, channel, interval) else { return Vec::new() };
        let mut found = Vec::new();
        for (number, bytes) in groups(plane, across * down).flatten() {
            for (i, reported) in group(bytes).unwrap_or_default().iter().enumerate() {
                let [x, y] = [number % across * 4 + i % 4, number / across * 4 + i / 4];
                let block = match reported.is_doubled {
                    true => reported.on(0).next().map_or(Block::Nothing, Block::Doubled),
                    false => Block::Words(std::array::from_fn(|quarter| reported.on(quarter).collect())),
                };
                if !reported.words.is_empty() && x < wide && y < high {
                    found.push((y * wide + x, block));
                }
            }
        }
        found
    }

    /// All values of the codebook, as a shader holds them: per entry and step from 1 to 11 eight bytes, of
    /// 4×4 texels row by row, the first of two in the lower four bits; 7 more than the value.
    pub fn codebook() -> &'static [u8] {
        TABLE
    }

    /// Bytes of the interval that has most of them, over all channels.
    pub fn most_bytes(&self, channels: usize) -> usize {
        let lengths: Vec<usize> = self.planes.iter().map(Vec::len).collect();
        most(&lengths, self.planes.len() / channels.max(1))
    }

    /// The same of a section that is not decoded.
    pub(crate) fn most_bytes_in(bytes: &[u8], channels: usize, intervals: usize) -> Result<usize, String> {
        let (planes, _) = planes_of(bytes, channels * intervals)?;
        let lengths: Vec<usize> = planes.into_iter().map(<[u8]>::len).collect();
        Ok(most(&lengths, intervals))
    }

    fn plane(&self, channels: usize, channel: usize, interval: usize) -> Option<&[u8]> {
        let intervals = self.planes.len() / channels.max(1);
        let plane = self.planes.get(channel * intervals + interval).filter(|_| interval < intervals)?;
        (!plane.is_empty()).then_some(plane)
    }

    /// What is seen at one texel, where words say so. `ends` is what is seen at the ends of the interval.
    pub(super) fn texel(
        &self,
        (channels, channel, interval): (usize, usize, usize),
        share: f32,
        [x, y]: [usize; 2],
        ends: [f32; 2],
    ) -> Option<f32> {
        let (plane, at) = (self.plane(channels, channel, interval)?, Step::of(share));
        let [across, down] = self.groups;
        let wanted = y / GROUP * across + x / GROUP;
        let (_, bytes) = groups(plane, across * down).flatten().find(|(i, _)| *i == wanted)?;
        let reported = group(bytes).ok()?[y % GROUP / BLOCK * 4 + x % GROUP / BLOCK];
        let [x, y] = [x % BLOCK, y % BLOCK];
        let mut words = reported.on(y / SIDE * 2 + x / SIDE).peekable();
        words.peek()?;
        let i = if reported.is_doubled { y / 2 * SIDE + x / 2 } else { y % SIDE * SIDE + x % SIDE };
        let values = words.map(|word| [0, 1].map(|k| word.values(at.before + k)[i]));
        Some(moved(ends, at, values))
    }

    /// Writes over what is seen, row by row, where words say so. `ends` has it at the ends of the interval.
    pub(super) fn apply(
        &self,
        (channels, channel, interval): (usize, usize, usize),
        share: f32,
        width: usize,
        ends: impl Fn(usize) -> [f32; 2],
        seen: &mut [f32],
    ) {
        let Some(plane) = self.plane(channels, channel, interval) else { return };
        let (at, height) = (Step::of(share), seen.len() / width);
        let [across, down] = self.groups;
        for (number, bytes) in groups(plane, across * down).flatten() {
            let [left, top] = [number % across * GROUP, number / across * GROUP];
            for (i, reported) in group(bytes).unwrap_or_default().iter().enumerate() {
                for quarter in 0..4 {
                    let mut values = [[[0i8; 2]; SIDE * SIDE]; MOST];
                    let mut count = 0;
                    for (word, values) in reported.on(quarter).zip(&mut values) {
                        let steps = [0, 1].map(|k| word.values(at.before + k));
                        (0..SIDE * SIDE).for_each(|i| values[i] = [steps[0][i], steps[1][i]]);
                        count += 1;
                    }
                    let x0 = left + i % 4 * BLOCK + quarter % 2 * SIDE;
                    let y0 = top + i / 4 * BLOCK + quarter / 2 * SIDE;
                    if count == 0 || x0 >= width || y0 >= height {
                        continue;
                    }
                    for (x, y) in (0..SIDE).flat_map(|y| (0..SIDE).map(move |x| (x, y))) {
                        let i = match reported.is_doubled {
                            true => (quarter / 2 * SIDE + y) / 2 * SIDE + (quarter % 2 * SIDE + x) / 2,
                            false => y * SIDE + x,
                        };
                        let texel = (y0 + y) * width + x0 + x;
                        seen[texel] = moved(ends(texel), at, values[..count].iter().map(|v| v[i]));
                    }
                }
            }
        }
    }
}
