//! The levels of one tile at one time: their coding.
//!
//! Blocks of 8×8 texels are dark, lit or mixed; in mixed ones blocks of 4×4; in mixed ones of these the
//! patterns of 2×2 texels. Each symbol is coded in a context of its neighbours: those to the left and above
//! for 8×8 and 2×2, on all four sides for 4×4.

use super::TileSun;
use super::bits::{Reader, Writer};
use super::tables::{
    MODE_BITS, MODE_CONTEXTS, MODES, OTHER, PALETTE, PATTERN_BITS, PATTERN_CONTEXTS, PATTERNS, Stack, Step,
    Tables, steps,
};
use std::collections::BTreeMap;

const DARK: u8 = 0;
const LIT: u8 = 1;
const MIXED: u8 = 2;
const TOP: u8 = TileSun::TOP;
const ANY: u8 = TileSun::ANY;
/// Where a 2×2, or a 4×4, lies in the block around it, in the order of coding.
const QUARTERS: [(usize, usize); 4] = [(0, 0), (1, 0), (0, 1), (1, 1)];

/// Levels of whole 8×8 blocks, and what is known of blocks.
struct Plane {
    /// Texels and blocks of 8 across and down.
    width: usize,
    size: [usize; 2],
    levels: Vec<u8>,
    /// Per 8×8 its mode.
    eights: Vec<u8>,
    /// Per 4×4 its mode, or that of the 8×8 around it.
    fours: Vec<u8>,
}

impl Plane {
    fn new([width, height]: [usize; 2], level: u8) -> Self {
        let size = [width.div_ceil(8), height.div_ceil(8)];
        let blocks = size[0] * size[1];
        Plane {
            width: 8 * size[0],
            size,
            levels: vec![level; 64 * blocks],
            eights: vec![DARK; blocks],
            fours: vec![DARK; 4 * blocks],
        }
    }

    /// The context of the mode of the 8×8 at (x, y): those to the left, above it to the left, above and above
    /// it to the right.
    fn context_of_eight(&self, x: usize, y: usize) -> usize {
        let at = |x: usize, y: usize| usize::from(self.eights[y * self.size[0] + x]);
        let (left, up, right) = (x > 0, y > 0, x + 1 < self.size[0]);
        let west = if left { at(x - 1, y) } else { 0 };
        let north_west = if left && up { at(x - 1, y - 1) } else { 0 };
        let north = if up { at(x, y - 1) } else { 0 };
        let north_east = if up && right { at(x + 1, y - 1) } else { 0 };
        west + 3 * north_west + 9 * north + 27 * north_east
    }

    /// The context of the mode of the 4×4 at (x, y): its four neighbours, where they are not coded yet the
    /// 8×8 around them.
    fn context_of_four(&self, x: usize, y: usize) -> usize {
        let [width, height] = self.size.map(|size| 2 * size);
        let at = |x: usize, y: usize| usize::from(self.fours[y * width + x]);
        let west = if x > 0 { at(x - 1, y) } else { 0 };
        let north = if y > 0 { at(x, y - 1) } else { 0 };
        let east = if x + 1 < width { at(x + 1, y) } else { 2 };
        let south = if y + 1 < height { at(x, y + 1) } else { 2 };
        MODE_CONTEXTS / 2 + west + 3 * north + 9 * east + 27 * south
    }

    /// The context of the pattern at texel (x, y): two texels to the left, two above; dark, between or lit.
    fn context_of_pattern(&self, x: usize, y: usize) -> usize {
        let kind = |level: u8| match level {
            0 => 0,
            TOP => 2,
            _ => 1,
        };
        let at = |x: usize, y: usize| kind(self.levels[y * self.width + x]);
        let left = |y: usize| if x > 0 { at(x - 1, y) } else { 0 };
        let above = |x: usize| if y > 0 { at(x, y - 1) } else { 0 };
        27 * left(y) + 9 * left(y + 1) + 3 * above(x) + above(x + 1)
    }

    fn fill(&mut self, [x, y]: [usize; 2], side: usize, level: u8) {
        for row in y..y + side {
            self.levels[row * self.width + x..][..side].fill(level);
        }
    }

    /// Gives each 4×4 the mode of the 8×8 around it, before their own are coded; where those are that have
    /// one of their own, in the order of coding.
    fn grow(&mut self) -> Vec<[usize; 2]> {
        for y in 0..2 * self.size[1] {
            for x in 0..2 * self.size[0] {
                self.fours[y * 2 * self.size[0] + x] = self.eights[y / 2 * self.size[0] + x / 2];
            }
        }
        let across = self.size[0];
        (0..self.eights.len())
            .filter(|&i| self.eights[i] == MIXED)
            .flat_map(|i| QUARTERS.map(|(dx, dy)| [2 * (i % across) + dx, 2 * (i / across) + dy]))
            .collect()
    }

    /// Corners of the 2×2 patterns in the order of coding, of a 4×4.
    fn patterns([x, y]: [usize; 2]) -> [[usize; 2]; 4] {
        QUARTERS.map(|(dx, dy)| [x + 2 * dx, y + 2 * dy])
    }

    fn cropped(&self, [width, height]: [usize; 2]) -> impl Iterator<Item = u8> + '_ {
        (0..height).flat_map(move |y| self.levels[y * self.width..][..width].iter().copied())
    }
}

/// How often a pattern must occur in a context to be a symbol of its table.
const WORTH: u32 = 2;

/// A pattern's levels in one number.
fn number(levels: [u8; 4]) -> u16 {
    (0..4).map(|i| u16::from(levels[i]) << (3 * i)).sum()
}

/// Tables made ready to decode.
#[derive(Clone, Debug)]
pub(super) struct Decoder {
    palette: Vec<u16>,
    modes: Vec<Step>,
    patterns: Vec<Step>,
}

impl Decoder {
    pub(super) fn new(tables: &Tables) -> Self {
        Decoder {
            palette: tables.palette.clone(),
            modes: tables.modes.iter().flat_map(|frequencies| steps(frequencies, MODE_BITS)).collect(),
            patterns: tables
                .patterns
                .iter()
                .flat_map(|frequencies| steps(frequencies, PATTERN_BITS))
                .collect(),
        }
    }

    /// Decodes one plane of a tile.
    pub(super) fn plane(&self, bytes: &[u8], size: [usize; 2], out: &mut Vec<u8>) -> Result<(), String> {
        let mut plane = Plane::new(size, 0);
        let mut reader = Reader::new(bytes);
        let mut state = reader.take(MODE_BITS);
        let mut state_of_pattern = reader.take(PATTERN_BITS);
        let mut mode = |context: usize, reader: &mut Reader| {
            let step = self.modes[(context << MODE_BITS) + state as usize];
            state = step.before(reader);
            step.symbol as u8
        };
        let [across, down] = plane.size;
        for y in 0..down {
            for x in 0..across {
                let found = mode(plane.context_of_eight(x, y), &mut reader);
                plane.eights[y * across + x] = found;
                if found == LIT {
                    plane.fill([8 * x, 8 * y], 8, TOP);
                }
            }
        }
        let mixed = plane.grow();
        for &[x, y] in &mixed {
            let found = mode(plane.context_of_four(x, y), &mut reader);
            plane.fours[y * 2 * across + x] = found;
            if found == LIT {
                plane.fill([4 * x, 4 * y], 4, TOP);
            }
        }
        for &[x, y] in &mixed {
            if plane.fours[y * 2 * across + x] != MIXED {
                continue;
            }
            for [x, y] in Plane::patterns([4 * x, 4 * y]) {
                let context = plane.context_of_pattern(x, y);
                let step = self.patterns[(context << PATTERN_BITS) + state_of_pattern as usize];
                state_of_pattern = step.before(&mut reader);
                let pattern = match usize::from(step.symbol) {
                    0 => continue,
                    1 => 0xfff,
                    OTHER => reader.take(12) as u16,
                    symbol => self.palette[symbol - 2],
                };
                let at = y * plane.width + x;
                for (i, place) in [at, at + 1, at + plane.width, at + plane.width + 1].into_iter().enumerate()
                {
                    plane.levels[place] = (pattern >> (3 * i) & 7) as u8;
                }
            }
        }
        if !reader.is_at_end() || [state, state_of_pattern] != [0; 2] {
            return Err("levels of the sun that do not end at their end mark".to_owned());
        }
        out.extend(plane.cropped(size));
        Ok(())
    }
}

/// What is to be coded of a plane, in order: contexts and symbols, and of patterns the levels.
#[derive(Debug, Default)]
struct Symbols {
    modes: Vec<(usize, u8)>,
    patterns: Vec<(usize, u16)>,
}

/// Counts of symbols: tables are made by them.
#[derive(Clone, Debug)]
pub struct Counts {
    modes: Vec<[u32; MODES]>,
    /// Per context, patterns by their levels.
    patterns: Vec<BTreeMap<u16, u32>>,
}

impl Default for Counts {
    fn default() -> Self {
        Counts { modes: vec![[0; MODES]; MODE_CONTEXTS], patterns: vec![BTreeMap::new(); PATTERN_CONTEXTS] }
    }
}

impl Counts {
    /// Adds others.
    pub fn add(&mut self, other: &Counts) {
        for (a, b) in self.modes.as_flattened_mut().iter_mut().zip(other.modes.as_flattened()) {
            *a += b;
        }
        for (a, b) in self.patterns.iter_mut().zip(&other.patterns) {
            b.iter().for_each(|(pattern, count)| *a.entry(*pattern).or_default() += count);
        }
    }

    /// The tables that code what was counted in the fewest bits.
    pub fn tables(&self) -> Tables {
        let mut all: BTreeMap<u16, u32> = BTreeMap::new();
        for (pattern, count) in self.patterns.iter().flatten() {
            *all.entry(*pattern).or_default() += count;
        }
        let mut palette: Vec<(u32, u16)> = all
            .into_iter()
            .filter(|(pattern, _)| ![0, 0xfff].contains(pattern))
            .map(|(p, n)| (n, p))
            .collect();
        palette.sort_by_key(|(count, pattern)| (std::cmp::Reverse(*count), *pattern));
        let mut palette: Vec<u16> = palette.into_iter().map(|(_, pattern)| pattern).take(PALETTE).collect();
        palette.resize(PALETTE, 0);
        let patterns: Vec<Vec<u32>> = self
            .patterns
            .iter()
            .map(|counts| {
                let mut symbols = vec![0; PATTERNS];
                for (pattern, count) in counts {
                    let symbol = symbol_of(&palette, *pattern);
                    // Rarer patterns are cheaper as OTHER than as an entry of the table.
                    symbols[if symbol > 1 && *count < WORTH { OTHER } else { symbol }] += count;
                }
                symbols
            })
            .collect();
        Tables::of_counts(palette, &self.modes, &patterns)
    }
}

/// The symbol of a pattern.
fn symbol_of(palette: &[u16], pattern: u16) -> usize {
    match pattern {
        0 => 0,
        0xfff => 1,
        _ => palette.iter().position(|&of| of == pattern).map_or(OTHER, |at| at + 2),
    }
}

/// Codes levels.
#[derive(Debug)]
pub struct Coder<'a> {
    tables: &'a Tables,
    modes: Vec<Stack<'a>>,
    patterns: Vec<Stack<'a>>,
    /// By pattern, its symbol.
    symbols: Vec<u16>,
}

impl<'a> Coder<'a> {
    /// By tables.
    pub fn new(tables: &'a Tables) -> Self {
        let mut symbols = vec![OTHER as u16; 1 << 12];
        for (i, &pattern) in tables.palette.iter().enumerate().rev() {
            symbols[usize::from(pattern)] = (i + 2) as u16;
        }
        (symbols[0], symbols[0xfff]) = (0, 1);
        Coder {
            tables,
            modes: tables.modes.iter().map(|frequencies| Stack::new(frequencies, MODE_BITS)).collect(),
            patterns: tables
                .patterns
                .iter()
                .map(|frequencies| Stack::new(frequencies, PATTERN_BITS))
                .collect(),
            symbols,
        }
    }

    /// The bits that a pattern takes in a context, about.
    fn bits(&self, context: usize, pattern: u16) -> f32 {
        let of = &self.tables.patterns[context];
        let cost = |symbol: usize| PATTERN_BITS as f32 - f32::from(of[symbol]).log2();
        match usize::from(self.symbols[usize::from(pattern)]) {
            symbol if symbol != OTHER && of[symbol] > 0 => cost(symbol),
            _ => cost(OTHER) + 12.0,
        }
    }

    /// The bytes of a plane of a tile.
    pub(super) fn plane(&self, levels: &[u8], size: [usize; 2]) -> Vec<u8> {
        let Symbols { modes, patterns } = symbols(levels, size, Some(self));
        let (mut bits, mut state) = (Vec::new(), 0);
        for &(context, pattern) in patterns.iter().rev() {
            let stack = &self.patterns[context];
            let symbol = usize::from(self.symbols[usize::from(pattern)]);
            let symbol = if stack.has(symbol) { symbol } else { OTHER };
            if symbol == OTHER {
                bits.push((u32::from(pattern), 12));
            }
            let (next, put) = stack.push(state, symbol);
            bits.push(put);
            state = next;
        }
        let state_of_pattern = state;
        state = 0;
        for &(context, mode) in modes.iter().rev() {
            let (next, put) = self.modes[context].push(state, usize::from(mode));
            bits.push(put);
            state = next;
        }
        let mut writer = Writer::default();
        writer.put(state, MODE_BITS);
        writer.put(state_of_pattern, PATTERN_BITS);
        bits.into_iter().rev().for_each(|(value, count)| writer.put(value, count));
        writer.finish()
    }
}

/// Counts the symbols of a plane, as tables would code it where there are some.
pub(super) fn count(levels: &[u8], size: [usize; 2], coder: Option<&Coder>, counts: &mut Counts) {
    let Symbols { modes, patterns } = symbols(levels, size, coder);
    modes.iter().for_each(|(context, mode)| counts.modes[*context][usize::from(*mode)] += 1);
    patterns
        .iter()
        .for_each(|(context, pattern)| *counts.patterns[*context].entry(*pattern).or_default() += 1);
}

/// The symbols of a plane. Levels that do not matter are those that take few bits.
fn symbols(levels: &[u8], size: [usize; 2], coder: Option<&Coder>) -> Symbols {
    let mut plane = Plane::new(size, ANY);
    for (row, line) in levels.chunks_exact(size[0]).enumerate() {
        plane.levels[row * plane.width..][..size[0]].copy_from_slice(line);
    }
    let mut found = Symbols::default();
    let [across, down] = plane.size;
    // Of a block: whether it may be dark, or lit.
    let may = |plane: &Plane, [x, y]: [usize; 2], side: usize, level: u8| {
        (y..y + side)
            .all(|y| plane.levels[y * plane.width + x..][..side].iter().all(|l| [level, ANY].contains(l)))
    };
    let mode = |plane: &Plane, corner: [usize; 2], side: usize, left: u8| {
        match (may(plane, corner, side, 0), may(plane, corner, side, TOP)) {
            // What does not matter at all is as what lies to the left.
            (true, true) => left & LIT,
            (true, false) => DARK,
            (false, true) => LIT,
            (false, false) => MIXED,
        }
    };
    for y in 0..down {
        for x in 0..across {
            let left = if x > 0 { plane.eights[y * across + x - 1] } else { DARK };
            let now = mode(&plane, [8 * x, 8 * y], 8, left);
            found.modes.push((plane.context_of_eight(x, y), now));
            plane.eights[y * across + x] = now;
            if now != MIXED {
                plane.fill([8 * x, 8 * y], 8, TOP * now);
            }
        }
    }
    let mixed = plane.grow();
    for &[x, y] in &mixed {
        let left = if x > 0 { plane.fours[y * 2 * across + x - 1] } else { DARK };
        let now = mode(&plane, [4 * x, 4 * y], 4, left);
        found.modes.push((plane.context_of_four(x, y), now));
        plane.fours[y * 2 * across + x] = now;
        if now != MIXED {
            plane.fill([4 * x, 4 * y], 4, TOP * now);
        }
    }
    for &[x, y] in &mixed {
        if plane.fours[y * 2 * across + x] != MIXED {
            continue;
        }
        for [x, y] in Plane::patterns([4 * x, 4 * y]) {
            let at = y * plane.width + x;
            let places = [at, at + 1, at + plane.width, at + plane.width + 1];
            let context = plane.context_of_pattern(x, y);
            let pattern = chosen(places.map(|place| plane.levels[place]), context, coder);
            for (i, place) in places.into_iter().enumerate() {
                plane.levels[place] = (pattern >> (3 * i) & 7) as u8;
            }
            found.patterns.push((context, pattern));
        }
    }
    found
}

/// A pattern of these levels, of those that do not matter the cheapest.
fn chosen(levels: [u8; 4], context: usize, coder: Option<&Coder>) -> u16 {
    let fixed = |other: u8| number(levels.map(|level| if level == ANY { other } else { level }));
    if !levels.contains(&ANY) {
        return fixed(0);
    }
    // Without tables yet, dark or lit, whichever more of the known ones are nearer to.
    let known = levels.iter().filter(|level| **level != ANY);
    let sum: u32 = known.clone().map(|level| u32::from(*level)).sum();
    let plain = fixed(if 2 * sum > 7 * known.count() as u32 { TOP } else { 0 });
    let Some(coder) = coder else { return plain };
    let fits = |pattern: u16| (0..4).all(|i| [ANY, (pattern >> (3 * i) & 7) as u8].contains(&levels[i]));
    let all = [0, 0xfff].into_iter().chain(coder.tables.palette.iter().copied());
    let cheapest =
        all.filter(|pattern| fits(*pattern)).map(|pattern| (coder.bits(context, pattern), pattern));
    let cheapest = cheapest.min_by(|a, b| a.0.total_cmp(&b.0));
    cheapest.filter(|(bits, _)| *bits < coder.bits(context, plain)).map_or(plain, |(_, pattern)| pattern)
}
