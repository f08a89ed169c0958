//! Makes the table of words by which shadows move between times, from datasets that keep the sun's
//! visibility:
//!
//!     cargo run --release -p compressor --example shadow_words -- words.bin dataset/yard dataset/room dataset/farmland
//!
//! Blocks of 4×4 texels whose visibility is not linear over an interval are drawn from all tiles; each round
//! gives each of them the word that helps it the most, and each entry of the table at each texel and step the
//! value that helps the blocks that have it the most. Clamping is part of both: a word that adds 1 means lit,
//! whatever was told.

use compressor::sunlight::Sunlight;
use compressor::sunlight::words::{Brick, Costs, LEVELS, SAMPLES, Search, TEXELS, doubled_costs};
use dataset::observe::Silent;
use dataset::store::Dataset;
use ndgi::sun::{Coder, ENTRIES, STEPS, SunDecoder, Word};
use rayon::prelude::*;
use std::path::Path;

/// Blocks drawn from each dataset, and the errors below which they are not.
const DRAWN: usize = 20_000;
const LEAST: f32 = 2e-6;
const LEAST_DOUBLED: f32 = 5e-6;
const ROUNDS: usize = 8;
/// After this many rounds, what a first word leaves of blocks is drawn too.
const SECOND: usize = 3;
/// An entry that gains less than this share of the mean is replaced.
const DEAD: f32 = 0.08;

/// SplitMix64.
struct Random(u64);

impl Random {
    fn next(&mut self) -> u64 {
        self.0 = self.0.wrapping_add(0x9e37_79b9_7f4a_7c15);
        let z = (self.0 ^ (self.0 >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
        let z = (z ^ (z >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
        z ^ (z >> 31)
    }

    fn unit(&mut self) -> f64 {
        (self.next() >> 11) as f64 / (1u64 << 53) as f64
    }

    fn draw<T>(&mut self, mut of: Vec<T>, count: usize) -> Vec<T> {
        let count = count.min(of.len());
        for i in 0..count {
            let other = i + (self.next() % (of.len() - i) as u64) as usize;
            of.swap(i, other);
        }
        of.truncate(count);
        of
    }
}

#[expect(clippy::large_enum_variant, reason = "a few thousand of them")]
enum Item {
    Brick(Brick),
    Block([Option<Brick>; 4]),
}

impl Item {
    fn costs(&self) -> Costs {
        match self {
            Item::Brick(brick) => brick.costs(),
            Item::Block(quarters) => doubled_costs(quarters),
        }
    }
}

/// Blocks of a dataset that words could help, some of them.
fn items(root: &Path, random: &mut Random) -> Result<Vec<Item>, Box<dyn std::error::Error>> {
    let dataset = Dataset::open(root)?;
    let masks =
        (0..dataset.config.pages.len()).map(|page| dataset.mask(page)).collect::<Result<Vec<_>, _>>()?;
    let sunlight = Sunlight::new(&dataset, true)?.ok_or("the sun lights nothing there")?;
    let console = Silent;
    let sun = sunlight.coded(&masks, &console)?;
    let (coder, decoder) = (Coder::new(&sun.tables), SunDecoder::new(&sun));
    let tiles = sunlight.each_tile("blocks", &masks, &console, |band, column, seen| {
        let (_, Some(reported)) = band.reported(column, &coder, &decoder)? else { return Ok(Vec::new()) };
        let mut items = Vec::new();
        for quarters in sunlight.bricks(band, column, &reported, seen)? {
            let errors = quarters.each_ref().map(|brick| brick.as_ref().map_or(0.0, Brick::error));
            if errors.iter().sum::<f32>() > LEAST_DOUBLED {
                items.push(Item::Block(quarters.clone()));
            }
            let bricks = quarters.into_iter().zip(errors).filter(|(_, error)| *error > LEAST);
            items.extend(bricks.filter_map(|(brick, _)| brick.map(Item::Brick)));
        }
        Ok(items)
    })?;
    Ok(random.draw(tiles.into_iter().flatten().flatten().collect(), DRAWN))
}

/// The values that would help one block the most, those next to 0 of as good ones.
fn ideal(costs: &Costs) -> [u8; SAMPLES] {
    std::array::from_fn(|i| {
        let near = |level: &usize| level.abs_diff(LEVELS / 2);
        let order = |a: &usize, b: &usize| costs[i][*a].total_cmp(&costs[i][*b]).then(near(a).cmp(&near(b)));
        (0..LEVELS).min_by(order).unwrap_or(LEVELS / 2) as u8
    })
}

/// The most that a word could gain on a block.
fn possible(costs: &Costs) -> f32 {
    -costs.iter().map(|of| of.iter().fold(0.0, |a: f32, b| a.min(*b))).sum::<f32>()
}

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let mut arguments = std::env::args().skip(1);
    let out = arguments.next().ok_or("expected the file to write, then datasets")?;
    let mut random = Random(1);
    let mut all = Vec::new();
    for root in arguments {
        let items = items(Path::new(&root), &mut random)?;
        println!("{root}: {} blocks", items.len());
        all.extend(items);
    }
    let mut costs: Vec<Costs> = all.par_iter().map(Item::costs).collect();
    let mut limits: Vec<f32> = costs.iter().map(possible).collect();
    let draw = |limits: &[f32], random: &mut Random| {
        let total: f64 = limits.iter().map(|limit| f64::from(limit.max(0.0))).sum();
        let mut at = random.unit() * total;
        limits.iter().position(|limit| {
            at -= f64::from(limit.max(0.0));
            at < 0.0
        })
    };
    let mut entries = Vec::new();
    for _ in 0..ENTRIES {
        entries.push(ideal(&costs[draw(&limits, &mut random).ok_or("nothing moves there")?]));
    }
    for round in 0..ROUNDS {
        let search = Search::new(entries.clone());
        let found: Vec<_> = costs.par_iter().map(|costs| search.best(costs)).collect();
        let gains: Vec<f32> = found.iter().map(|(_, _, cost)| -cost).collect();
        println!(
            "round {round}: {} blocks, words gain {:.2} % of what they could",
            costs.len(),
            100.0 * gains.iter().sum::<f32>() / limits.iter().sum::<f32>()
        );
        let mut sums = vec![vec![[0.0f32; LEVELS]; SAMPLES]; ENTRIES];
        let mut gain = vec![0.0f32; ENTRIES];
        for (costs, (entry, turning, cost)) in costs.iter().zip(&found) {
            gain[*entry] -= cost;
            for (sum, of) in sums[*entry].iter_mut().zip(search.turned(costs, *turning)) {
                sum.iter_mut().zip(of).for_each(|(sum, cost)| *sum += cost);
            }
        }
        let least = DEAD * gain.iter().sum::<f32>() / ENTRIES as f32;
        for (entry, (sums, gain)) in entries.iter_mut().zip(sums.iter().zip(gain)) {
            if gain > least || round + 1 == ROUNDS {
                *entry = ideal(sums);
            } else {
                let left: Vec<f32> = limits.iter().zip(&gains).map(|(limit, gain)| limit - gain).collect();
                let other = draw(&left, &mut random).ok_or("nothing is left")?;
                *entry = ideal(&costs[other]);
            }
        }
        if round + 1 == SECOND {
            let rest = all.iter().zip(&found).filter_map(|(item, (entry, turning, _))| {
                let Item::Brick(brick) = item else { return None };
                let mut brick = brick.clone();
                brick.add(|step, i| {
                    let step = Word::source_step(*turning, step);
                    let from = (step - 1) * TEXELS + Word::source(*turning, i % 4, i / 4);
                    let value = search.entries()[*entry][from] as i8 - 7;
                    if turning & 1 != 0 { -value } else { value }
                });
                (brick.error() > LEAST_DOUBLED).then(|| brick.costs())
            });
            let rest: Vec<Costs> = random.draw(rest.collect(), all.len() / 3);
            limits.extend(rest.iter().map(possible));
            costs.extend(rest);
        }
    }
    let mut bytes = Vec::new();
    for entry in &entries {
        for step in 0..STEPS - 1 {
            let of = entry[step * TEXELS..][..TEXELS].as_chunks::<2>().0;
            bytes.extend(of.iter().map(|[low, high]| low | high << 4));
        }
    }
    std::fs::write(out, bytes)?;
    Ok(())
}
