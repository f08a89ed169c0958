//! A tile's sun data as the shader reads them: resident normals, and visibility that changes from one
//! interval to the next.

use crate::place::Site;
use crate::shader::{HAS_COLOUR, HAS_SUN, HAS_WORDS, Job};
use ndgi::at::SunAt;
use ndgi::sun::{Block, TileSun};
use std::collections::BTreeMap;

/// What is known of a tile's sun.
#[derive(Debug)]
pub(crate) struct Seen {
    /// Where blocks, indices and normals begin in its part of the resident buffer.
    normals: [u32; 3],
    channels: usize,
    /// How long its part of the interval's buffer is.
    pub words: u32,
}

/// What a tile sees in an interval.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Held {
    /// Nothing.
    Dark,
    /// Something, that changes linearly.
    Still,
    /// Something, and words say how it changes.
    Moving,
}

impl Seen {
    /// Puts a tile's normals into its part of the resident buffer. `most`: bytes of its moving shadows in the
    /// interval that has most of them.
    pub(crate) fn new(tile: &TileSun, most: usize, resident: &mut Vec<u32>) -> Self {
        let normals = normals_of(tile, resident);
        let (texels, channels) = (tile.width * tile.height, tile.channels());
        let blocks = if most > 0 { channels * blocks(tile) } else { 0 };
        let words = channels * 2 * (texels / 8) + blocks + most.div_ceil(4);
        Seen { normals, channels, words: words as u32 }
    }

    /// The tile's part of the interval's buffer, at most [`Seen::words`]. `tile` has the times of the
    /// interval alone.
    pub(crate) fn part(&self, tile: &TileSun, times: [usize; 2]) -> (Held, Vec<u32>) {
        let (texels, channels) = (tile.width * tile.height, tile.channels());
        let mut out = Vec::with_capacity(self.words as usize);
        for channel in 0..channels {
            for time in [0, tile.times - 1] {
                let levels = &tile.levels[(channel * tile.times + time) * texels..][..texels];
                out.extend(levels.as_chunks::<8>().0.iter().map(|eight| {
                    eight
                        .iter()
                        .rev()
                        .fold(0, |word, level| word << 4 | u32::from((*level).min(TileSun::TOP)))
                }));
            }
        }
        let is_dark = out.iter().all(|word| *word == 0);
        if times[0] == times[1] {
            return (if is_dark { Held::Dark } else { Held::Still }, out);
        }
        let count = blocks(tile);
        let (mut table, mut words) = (vec![0u32; channels * count], Vec::new());
        for channel in 0..channels {
            for (number, block) in tile.shadows.blocks((channels, channel, 0), [tile.width, tile.height]) {
                let first = (words.len() as u32) << 10;
                table[channel * count + number] = match block {
                    Block::Nothing => continue,
                    Block::Doubled(word) => {
                        words.push(word.0);
                        1 | first
                    }
                    Block::Words(of) => {
                        words.extend(of.iter().flatten().map(|word| word.0));
                        let counts =
                            of.iter().rev().fold(0, |counts, words| counts << 2 | words.len() as u32);
                        2 | counts << 2 | first
                    }
                };
            }
        }
        if words.is_empty() {
            return (if is_dark { Held::Dark } else { Held::Still }, out);
        }
        out.extend(table);
        out.extend(
            words.chunks(2).map(|two| u32::from(two[0]) | u32::from(two.get(1).copied().unwrap_or(0)) << 16),
        );
        (Held::Moving, out)
    }

    /// Fills in what a job says of the sun; gives whether anything is seen of it.
    pub(crate) fn job(&self, site: &Site, held: Held, sun: &SunAt, job: &mut Job) -> bool {
        if held == Held::Dark {
            return false;
        }
        let texels = job.size[0] * job.size[1];
        let levels = self.channels as u32 * 2 * (texels / 8);
        let blocks = self.channels as u32 * job.size[0].div_ceil(8) * job.size[1].div_ceil(8);
        let start = site.interval;
        job.seen = [start, start + levels, 2 * (start + levels + blocks), 0];
        let [blocks, choices, normals] = self.normals.map(|at| site.resident + at);
        job.normals = [blocks, choices, normals, 0];
        job.direction[..3].copy_from_slice(&sun.direction);
        job.direction[3] = if sun.times[0] == sun.times[1] { 0.0 } else { sun.part };
        job.irradiance[..3].copy_from_slice(&sun.irradiance);
        job.has |= HAS_SUN;
        job.has |= if self.channels == 3 { HAS_COLOUR } else { 0 };
        job.has |= if held == Held::Moving { HAS_WORDS } else { 0 };
        true
    }
}

/// Blocks of 8×8 texels that cover a tile.
fn blocks(tile: &TileSun) -> usize {
    tile.width.div_ceil(8) * tile.height.div_ceil(8)
}

/// Three arrays: per 4×4 block, the start of its normal list, its index width in bits and the start of its
/// indices; the indices; the normals. Lists that are alike are kept once. Gives where the three begin.
fn normals_of(tile: &TileSun, out: &mut Vec<u32>) -> [u32; 3] {
    let bits = |normal: &[f32; 3]| normal.map(f32::to_bits);
    let across = tile.width / 4;
    let (mut blocks, mut choices, mut normals) = (Vec::new(), Vec::new(), Vec::<[u32; 3]>::new());
    // Where a list of normals begins that a block had before.
    let mut known: BTreeMap<Vec<[u32; 3]>, usize> = BTreeMap::new();
    for block in 0..across * (tile.height / 4) {
        let corner = block / across * 4 * tile.width + block % across * 4;
        let of: [[u32; 3]; 16] =
            std::array::from_fn(|i| bits(&tile.normals[corner + i / 4 * tile.width + i % 4]));
        let mut own: Vec<[u32; 3]> = Vec::new();
        let choice = of.map(|normal| {
            own.iter().position(|n| *n == normal).unwrap_or_else(|| {
                own.push(normal);
                own.len() - 1
            })
        });
        let width: u32 = match own.len() {
            1 => 0,
            2 => 1,
            3..=4 => 2,
            _ => 4,
        };
        let first = *known.entry(own).or_insert_with_key(|own| {
            normals.extend(own);
            normals.len() - own.len()
        });
        blocks.extend([width << 28 | first as u32, choices.len() as u32]);
        let word = choice.iter().rev().fold(0u64, |word, of| word << width | *of as u64);
        choices.extend([word as u32, (word >> 32) as u32].into_iter().take((width as usize).div_ceil(2)));
    }
    let start = out.len() as u32;
    let starts = [start, start + blocks.len() as u32, start + (blocks.len() + choices.len()) as u32];
    out.extend(blocks);
    out.extend(choices);
    out.extend(normals.into_iter().flatten());
    starts
}
