//! Which codewords make shadows move as they do: the best one for 4×4 texels, and how many are worth their
//! bits.

use crate::lanes::{Instructions, Tier};
use ndgi::sun::{Block, ENTRIES, MOST, SIDE, STEPS, UNIT, Word};
use std::cmp::Ordering;

/// Texels that a codeword covers.
pub const TEXELS: usize = SIDE * SIDE;
/// Values of a codeword: by step from 1 on, then texel.
pub const SAMPLES: usize = (STEPS - 1) * TEXELS;
/// The values that an entry may have.
pub const LEVELS: usize = 15;
/// Transforms of an entry.
pub const TURNINGS: usize = 32;
/// The values by which candidates are found, of those a word may have: -1, about -1/2, about 1/2, 1. Of 0
/// nothing changes.
const COARSE: [[usize; 2]; 4] = [[0, 0], [3, 4], [10, 11], [14, 14]];
const FEATURES: usize = SAMPLES * COARSE.len();
/// Principal components of the codebook that are kept, to find candidates by.
const DIRECTIONS: usize = 64;
/// Candidates that are compared exactly.
const CANDIDATES: usize = 128;
/// Rounds in which the directions are found.
const ROUNDS: usize = 8;

/// Bits of a codeword.
const WORD: f32 = 16.0;
/// Bits of the counts of a block with at most one codeword a 4×4, and of one with more.
const FEW: f32 = 4.0;
const MANY: f32 = 8.0;
/// Bits of a group of blocks whatever is in it: its length, its modes, and what fills it up on average.
const GROUP: f32 = 8.0 + 32.0 + 6.0;

/// Visibility on 4×4 texels between two times: as a reader has it by the codewords found so far, and as it
/// is.
#[derive(Clone, Debug)]
pub struct Brick {
    /// By step from 1 on, then texel.
    pub reported: [f32; SAMPLES],
    /// The same.
    pub wanted: [f32; SAMPLES],
    /// What a squared error counts at a texel.
    pub weights: [f32; TEXELS],
}

/// By sample and level, by how much an entry's value there changes the error.
pub type Costs = Vec<[f32; LEVELS]>;

impl Brick {
    /// The weighted squared error, the mean over the steps.
    pub fn error(&self) -> f32 {
        let of = |i: usize| self.weights[i % TEXELS] * (self.reported[i] - self.wanted[i]).powi(2);
        (0..SAMPLES).map(of).sum::<f32>() / (STEPS - 1) as f32
    }

    /// Adds the value, in sevenths, of each step and texel.
    pub fn add(&mut self, value: impl Fn(usize, usize) -> i8) {
        for (i, reported) in self.reported.iter_mut().enumerate() {
            *reported = (*reported + f32::from(value(i / TEXELS + 1, i % TEXELS)) * UNIT).clamp(0.0, 1.0);
        }
    }

    /// Adds a word.
    pub fn add_word(&mut self, word: Word) {
        let values: [_; STEPS] = std::array::from_fn(|step| word.values(step));
        self.add(|step, i| values[step][i]);
    }

    /// Adds the quarter of a word whose texels are 2×2.
    fn add_doubled(&mut self, word: Word, quarter: usize) {
        let values: [_; STEPS] = std::array::from_fn(|step| word.values(step));
        self.add(|step, i| values[step][doubled(quarter, i)]);
    }

    /// What each value would change.
    pub fn costs(&self) -> Costs {
        let of = |i: usize| {
            let (reported, wanted) = (self.reported[i], self.wanted[i]);
            let weight = self.weights[i % TEXELS] / (STEPS - 1) as f32;
            let before = (reported - wanted).powi(2);
            std::array::from_fn(|level| {
                let after = (reported + (level as f32 - 7.0) * UNIT).clamp(0.0, 1.0) - wanted;
                weight * (after * after - before)
            })
        };
        (0..SAMPLES).map(of).collect()
    }
}

/// The texel of a doubled word that covers texel i of a quarter of its block.
fn doubled(quarter: usize, i: usize) -> usize {
    let (x, y) = (quarter % 2 * SIDE + i % SIDE, quarter / 2 * SIDE + i / SIDE);
    y / 2 * SIDE + x / 2
}

/// Costs of a doubled word, from those of the quarters.
pub fn doubled_costs(quarters: &[Option<Brick>; 4]) -> Costs {
    let mut sum = vec![[0.0; LEVELS]; SAMPLES];
    for (quarter, brick) in quarters.iter().enumerate() {
        for (i, costs) in brick.iter().flat_map(Brick::costs).enumerate() {
            let to = i / TEXELS * TEXELS + doubled(quarter, i % TEXELS);
            sum[to].iter_mut().zip(costs).for_each(|(sum, cost)| *sum += cost);
        }
    }
    sum
}

/// Columns of a matrix that are multiplied together.
const PANEL: usize = 8;

/// Finds the best word of a table.
#[derive(Debug)]
pub struct Search {
    /// Per entry its levels by sample.
    entries: Vec<[u8; SAMPLES]>,
    /// By turning and sample, the sample of an entry that comes there.
    source: Vec<[usize; SAMPLES]>,
    mean: Vec<f32>,
    /// The directions in which entries are told apart, in panels.
    directions: Vec<[f32; PANEL]>,
    /// The places of the entries along the directions, in panels.
    places: Vec<[f32; PANEL]>,
    tier: Tier,
}

/// A matrix of `depth` rows in panels of eight columns, one panel after the other; the last is filled up
/// with 0.
fn panels(columns: usize, depth: usize, value: impl Fn(usize, usize) -> f32) -> Vec<[f32; PANEL]> {
    let of = |panel: usize, row: usize| {
        std::array::from_fn(|i| {
            let column = panel * PANEL + i;
            if column < columns { value(row, column) } else { 0.0 }
        })
    };
    (0..columns.div_ceil(PANEL))
        .flat_map(|panel| (0..depth).map(move |row| (panel, row)))
        .map(|(p, r)| of(p, r))
        .collect()
}

/// `rows` · a matrix in panels, eight columns at a time: what they are of all rows goes to `take` with the
/// number of the panel. The number of rows is a multiple of four. Sums go along a row from the left, whatever
/// the instructions.
#[inline(always)]
fn multiply(
    rows: &[f32],
    depth: usize,
    panels: &[[f32; PANEL]],
    mut take: impl FnMut(usize, usize, &[[f32; PANEL]; 4]),
) {
    for (number, panel) in panels.chunks_exact(depth).enumerate() {
        for (quad, rows) in rows.chunks_exact(4 * depth).enumerate() {
            let (a, rest) = rows.split_at(depth);
            let (b, rest) = rest.split_at(depth);
            let (c, d) = rest.split_at(depth);
            let mut sums = [[0.0f32; PANEL]; 4];
            for ((values, (a, b)), (c, d)) in panel.iter().zip(a.iter().zip(b)).zip(c.iter().zip(d)) {
                for (sum, row) in sums.iter_mut().zip([a, b, c, d]) {
                    for i in 0..PANEL {
                        sum[i] += row * values[i];
                    }
                }
            }
            take(number, quad, &sums);
        }
    }
}

/// Which of [`COARSE`] a level is nearest to.
fn coarse(level: u8) -> Option<usize> {
    match level {
        0..=1 => Some(0),
        2..=5 => Some(1),
        6..=8 => None,
        9..=12 => Some(2),
        _ => Some(3),
    }
}

fn order(a: &(f32, u32), b: &(f32, u32)) -> Ordering {
    a.0.total_cmp(&b.0).then(a.1.cmp(&b.1))
}

fn features(entry: &[u8; SAMPLES]) -> impl Iterator<Item = usize> + '_ {
    let of = |(i, level): (usize, &u8)| coarse(*level).map(|k| i * COARSE.len() + k);
    entry.iter().enumerate().filter_map(of)
}

impl Search {
    /// In the table that decoders have.
    pub fn of_table() -> Self {
        let entry = |entry: usize| {
            let mut levels = [0; SAMPLES];
            for step in 1..STEPS {
                let to = &mut levels[(step - 1) * TEXELS..][..TEXELS];
                to.iter_mut().zip(Word::entry(entry, step)).for_each(|(to, v)| *to = (v + 7) as u8);
            }
            levels
        };
        Self::new((0..ENTRIES).map(entry).collect())
    }

    /// In some entries.
    pub fn new(entries: Vec<[u8; SAMPLES]>) -> Self {
        let source = |turning: usize| {
            std::array::from_fn(|i| {
                let step = Word::source_step(turning, i / TEXELS + 1) - 1;
                step * TEXELS + Word::source(turning, i % SIDE, i % TEXELS / SIDE)
            })
        };
        let (mean, directions) = directions(&entries);
        let place: Vec<[f32; DIRECTIONS]> =
            entries.iter().map(|entry| project(&directions, &mean, entry)).collect();
        Search {
            places: panels(entries.len(), DIRECTIONS, |d, entry| place[entry][d]),
            directions: panels(DIRECTIONS, FEATURES, |feature, d| directions[feature][d]),
            source: (0..TURNINGS).map(source).collect(),
            tier: Tier::detect(),
            entries,
            mean,
        }
    }

    /// The entries, by [`Search::new`].
    pub fn entries(&self) -> &[[u8; SAMPLES]] {
        &self.entries
    }

    /// Costs of an entry's values where it is turned: by the samples and levels of the entry.
    pub fn turned(&self, costs: &Costs, turning: usize) -> Costs {
        let mut turned = vec![[0.0; LEVELS]; SAMPLES];
        for (from, costs) in self.source[turning].iter().zip(costs) {
            turned[*from] = *costs;
            if turning & 1 != 0 {
                turned[*from].reverse();
            }
        }
        turned
    }

    /// The codeword that lowers the error most: its entry, its transform, and the change. Only the 128 best
    /// by a low-dimensional projection are compared exactly.
    pub fn best(&self, costs: &Costs) -> (usize, usize, f32) {
        let mut candidates = match self.tier.instructions() {
            Instructions::Portable => self.candidates(costs),
            // SAFETY: the processor was asked for the tier.
            #[cfg(target_arch = "x86_64")]
            _ => unsafe { self.candidates_avx2(costs) },
        };
        candidates.sort_unstable_by(order);
        candidates.truncate(CANDIDATES);
        let exact = |(_, number): &(f32, u32)| {
            let (turning, entry) =
                (*number as usize / self.entries.len(), *number as usize % self.entries.len());
            let entry = &self.entries[entry];
            let level = |(i, from): (usize, &usize)| {
                let level = usize::from(entry[*from]);
                costs[i][if turning & 1 != 0 { LEVELS - 1 - level } else { level }]
            };
            (self.source[turning].iter().enumerate().map(level).sum::<f32>(), *number)
        };
        let best = candidates.iter().map(exact).min_by(order).unwrap_or_default();
        (best.1 as usize % self.entries.len(), best.1 as usize / self.entries.len(), best.0)
    }

    #[cfg(target_arch = "x86_64")]
    #[target_feature(enable = "avx2")]
    fn candidates_avx2(&self, costs: &Costs) -> Vec<(f32, u32)> {
        self.candidates(costs)
    }

    /// Words by about how much they change the error, among them the [`CANDIDATES`] best; each by turning ·
    /// entries + entry.
    #[inline(always)]
    fn candidates(&self, costs: &Costs) -> Vec<(f32, u32)> {
        // Costs by features of an entry that is turned.
        let mut turned = vec![0.0; TURNINGS * FEATURES];
        for (turning, (turned, source)) in turned.chunks_exact_mut(FEATURES).zip(&self.source).enumerate() {
            for (costs, from) in costs.iter().zip(source) {
                let of = COARSE.map(|[a, b]| 0.5 * (costs[a] + costs[b]));
                for k in 0..COARSE.len() {
                    turned[from * COARSE.len() + k] =
                        of[if turning & 1 != 0 { COARSE.len() - 1 - k } else { k }];
                }
            }
        }
        let mut queries = [0.0; TURNINGS * DIRECTIONS];
        multiply(&turned, FEATURES, &self.directions, |panel, quad, sums| {
            for (row, sums) in sums.iter().enumerate() {
                queries[(quad * 4 + row) * DIRECTIONS + panel * PANEL..][..PANEL].copy_from_slice(sums);
            }
        });
        let start =
            |turned: &[f32]| turned.iter().zip(&self.mean).map(|(cost, mean)| cost * mean).sum::<f32>();
        let starts: Vec<f32> = turned.chunks_exact(FEATURES).map(start).collect();
        let (mut candidates, mut limit) = (Vec::new(), f32::MAX);
        multiply(&queries, DIRECTIONS, &self.places, |panel, quad, sums| {
            for (row, sums) in sums.iter().enumerate() {
                let turning = quad * 4 + row;
                let limit = limit - starts[turning];
                if !sums.iter().fold(false, |any, sum| any | (*sum < limit)) {
                    continue;
                }
                for (i, sum) in sums.iter().enumerate().filter(|(_, sum)| **sum < limit) {
                    let entry = panel * PANEL + i;
                    if entry < self.entries.len() {
                        candidates
                            .push((sum + starts[turning], (turning * self.entries.len() + entry) as u32));
                    }
                }
            }
            if candidates.len() > 4 * CANDIDATES {
                candidates.select_nth_unstable_by(CANDIDATES - 1, order);
                candidates.truncate(CANDIDATES);
                limit = candidates[CANDIDATES - 1].0;
            }
        });
        candidates
    }

    fn word(&self, costs: &Costs) -> Word {
        let (entry, turning, _) = self.best(costs);
        Word::new(entry, turning)
    }

    /// What the blocks of 8×8 of a tile have over an interval, row by row, so that error + `price` · bits is
    /// small. `bricks` are those of the blocks; none where the tile has none.
    pub fn blocks(&self, blocks: Vec<[Option<Brick>; 4]>, across: usize, price: f32) -> Vec<Block> {
        let mut chosen: Vec<(Block, f32)> = blocks.into_iter().map(|of| self.block(of, price)).collect();
        // Groups whose words together are not worth what it takes to tell of any.
        let down = chosen.len() / across;
        for (top, left) in (0..down).step_by(4).flat_map(|y| (0..across).step_by(4).map(move |x| (y, x))) {
            let group = (top..(top + 4).min(down))
                .flat_map(|y| (left..(left + 4).min(across)).map(move |x| y * across + x));
            let gain: f32 = group.clone().map(|i| chosen[i].1).sum();
            if gain <= price * GROUP {
                group.for_each(|i| chosen[i] = (Block::Nothing, 0.0));
            }
        }
        chosen.into_iter().map(|(block, _)| block).collect()
    }

    /// What one block has, and how much better that is than nothing.
    fn block(&self, mut bricks: [Option<Brick>; 4], price: f32) -> (Block, f32) {
        let errors = bricks.each_ref().map(|brick| brick.as_ref().map_or(0.0, Brick::error));
        let nothing: f32 = errors.iter().sum();
        let mut best = (Block::Nothing, nothing);
        if nothing <= price * WORD {
            return (Block::Nothing, 0.0);
        }
        let word = self.word(&doubled_costs(&bricks));
        let mut cost = price * WORD;
        for (quarter, brick) in bricks.iter().enumerate() {
            if let Some(mut brick) = brick.clone() {
                brick.add_doubled(word, quarter);
                cost += brick.error();
            }
        }
        if cost < best.1 {
            best = (Block::Doubled(word), cost);
        }
        // Of each quarter, words while another may pay, and what the error is with none, one, …
        let trial_fits = [0, 1, 2, 3].map(|quarter| {
            let (mut words, mut after) = (Vec::new(), vec![errors[quarter]]);
            if let Some(brick) = &mut bricks[quarter] {
                while words.len() < MOST && after[words.len()] > price * WORD {
                    let word = self.word(&brick.costs());
                    brick.add_word(word);
                    words.push(word);
                    after.push(brick.error());
                }
            }
            (words, after)
        });
        for (most, bits) in [(1, FEW), (MOST, MANY)] {
            let mut cost = price * bits;
            let words = trial_fits.each_ref().map(|(words, after)| {
                let of = |n: usize| after[n] + price * WORD * n as f32;
                let n = (0..after.len().min(most + 1)).min_by(|a, b| of(*a).total_cmp(&of(*b))).unwrap_or(0);
                cost += of(n);
                words[..n].to_vec()
            });
            if cost < best.1 {
                best = (Block::Words(words), cost);
            }
        }
        (best.0, nothing - best.1)
    }
}

/// The place of an entry along the directions.
fn project(directions: &[[f32; DIRECTIONS]], mean: &[f32], entry: &[u8; SAMPLES]) -> [f32; DIRECTIONS] {
    let mut place = [0.0; DIRECTIONS];
    for (mean, direction) in mean.iter().zip(directions) {
        (0..DIRECTIONS).for_each(|d| place[d] -= mean * direction[d]);
    }
    for feature in features(entry) {
        (0..DIRECTIONS).for_each(|d| place[d] += directions[feature][d]);
    }
    place
}

/// The mean of the entries' features, and the orthonormal directions in which they vary most, found by
/// iteration.
fn directions(entries: &[[u8; SAMPLES]]) -> (Vec<f32>, Vec<[f32; DIRECTIONS]>) {
    let mut mean = vec![0.0; FEATURES];
    let share = 1.0 / entries.len() as f32;
    entries.iter().for_each(|entry| features(entry).for_each(|feature| mean[feature] += share));
    // Anything initially; a hash of the place.
    let start = |feature: usize| {
        std::array::from_fn(|d| {
            let hash = (feature * DIRECTIONS + d + 1).wrapping_mul(0x9e37_79b9_7f4a_7c15);
            (hash >> 40) as f32 / (1u32 << 23) as f32 - 1.0
        })
    };
    let mut directions: Vec<[f32; DIRECTIONS]> = (0..FEATURES).map(start).collect();
    orthonormal(&mut directions);
    for _ in 0..ROUNDS {
        let mut next = vec![[0.0; DIRECTIONS]; FEATURES];
        let mut total = [0.0; DIRECTIONS];
        for entry in entries {
            let place = project(&directions, &mean, entry);
            (0..DIRECTIONS).for_each(|d| total[d] += place[d]);
            for feature in features(entry) {
                (0..DIRECTIONS).for_each(|d| next[feature][d] += place[d]);
            }
        }
        for (next, mean) in next.iter_mut().zip(&mean) {
            (0..DIRECTIONS).for_each(|d| next[d] -= mean * total[d]);
        }
        orthonormal(&mut next);
        directions = next;
    }
    (mean, directions)
}

/// Makes columns orthonormal, one after another; one that is nothing beside the others becomes 0.
fn orthonormal(columns: &mut [[f32; DIRECTIONS]]) {
    for d in 0..DIRECTIONS {
        let length =
            |columns: &[[f32; DIRECTIONS]]| columns.iter().map(|row| row[d] * row[d]).sum::<f32>().sqrt();
        let before = length(columns);
        for _ in 0..2 {
            for other in 0..d {
                let along: f32 = columns.iter().map(|row| row[d] * row[other]).sum();
                columns.iter_mut().for_each(|row| row[d] -= along * row[other]);
            }
        }
        let after = length(columns);
        let scale = if after > 1e-4 * before && after > 0.0 { 1.0 / after } else { 0.0 };
        columns.iter_mut().for_each(|row| row[d] *= scale);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Shadows whose edges cross a block in directions and at speeds of all kinds, over a line between
    /// levels; weights of all kinds.
    fn bricks() -> Vec<Brick> {
        let brick = |n: usize| {
            let [a, b, c] = [0.7, 1.3, 2.1].map(|k| (k * n as f32).sin());
            let seen = |i: usize, step: f32| {
                let [x, y] = [(i % SIDE) as f32 - 1.5, (i / SIDE) as f32 - 1.5];
                (0.5 + 0.7 * (a * x + b * y) + (0.4 + c) * (step - 6.0 - 3.0 * a)).clamp(0.0, 1.0)
            };
            let wanted = |i: usize| seen(i % TEXELS, (i / TEXELS + 1) as f32);
            let reported = |i: usize| {
                let [from, to] = [0.0, STEPS as f32].map(|step| (7.0 * seen(i % TEXELS, step)).round() / 7.0);
                from + (to - from) * (i / TEXELS + 1) as f32 / STEPS as f32
            };
            Brick {
                reported: std::array::from_fn(reported),
                wanted: std::array::from_fn(wanted),
                weights: std::array::from_fn(|i| 1.0 + (1.7 * (i + n) as f32).sin()),
            }
        };
        (1..9).map(brick).collect()
    }

    #[test]
    fn costs_are_what_a_word_changes_and_the_best_of_all_is_nearly_found() {
        let mut search = Search::of_table();
        let (mut found, mut least, mut before) = (0.0, 0.0, 0.0);
        for brick in bricks() {
            let costs = brick.costs();
            let (entry, turning, cost) = search.best(&costs);
            let mut after = brick.clone();
            after.add_word(Word::new(entry, turning));
            let change = after.error() - brick.error();
            assert!((change - cost).abs() < 1e-4 * brick.error(), "{change} {cost}");
            // Of all words, one by one, by the entry's own samples.
            let all = (0..TURNINGS).flat_map(|turning| {
                let costs = search.turned(&costs, turning);
                let of = move |entry: &[u8; SAMPLES]| {
                    costs.iter().zip(entry).map(|(of, level)| of[usize::from(*level)]).sum::<f32>()
                };
                search.entries().iter().map(of).collect::<Vec<_>>()
            });
            least += all.fold(0.0, f32::min);
            (found, before) = (found + cost, before + brick.error());
            // The same whatever the instructions.
            let tier = std::mem::replace(&mut search.tier, Tier::portable());
            assert_eq!(search.best(&costs), (entry, turning, cost));
            search.tier = tier;
        }
        // (Changes are negative.)
        assert!(found < 0.85 * least && least < -0.5 * before, "{found} of {least}, {before}");
    }

    #[test]
    fn blocks_have_words_where_they_are_worth_their_bits() {
        let search = Search::of_table();
        let [a, b, c, d, ..] = &bricks()[..] else { panic!() };
        let quarters = [a, b, c, d].map(|brick| Some(brick.clone()));
        let error: f32 = [a, b, c, d].iter().map(|brick| brick.error()).sum();
        let words = |price: f32| match &search.blocks(vec![quarters.clone()], 1, price)[0] {
            Block::Nothing => 0,
            Block::Doubled(_) => 1,
            Block::Words(of) => of.iter().map(Vec::len).sum(),
        };
        assert_eq!(words(error), 0);
        let many = words(1e-6 * error);
        assert!((5..=4 * MOST).contains(&many), "{many}");
        // At a price of nothing none is taken that does harm; where there is nothing to gain, none.
        let still = Brick { wanted: a.reported, ..a.clone() };
        assert_eq!(search.blocks(vec![[Some(still), None, None, None]], 1, 0.0), [Block::Nothing]);
    }
}
