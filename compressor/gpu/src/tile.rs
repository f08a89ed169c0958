//! A tile's data as the shader reads it: what stays resident, what changes from one time of visibility to the next, and the job of a moment.

use crate::place::Spot;
use crate::shader;
use bytemuck::{Pod, Zeroable};
use ndgi::at::SunAt;
use ndgi::decode::{Inputs, along_tau};
use ndgi::grid::Grid;
use ndgi::model::{BORDER, TileParams};
use ndgi::sun::{Block, TileSun};
use ndgi::time::{Coding, Moment, Timeline};
use std::collections::BTreeMap;

const HAS_MAPS: u32 = 1;
const HAS_UVT: u32 = 2;
const HAS_UV: u32 = 4;
const HAS_UT: u32 = 8;
const HAS_VT: u32 = 16;
const HAS_SUN: u32 = 32;
const HAS_COLOUR: u32 = 64;
const HAS_WORDS: u32 = 128;
const IS_PAPERS: u32 = 256;

/// Beyond this a value does not fit into a 16-bit float.
const HALF_MAX: f32 = 65504.0;

/// `Job` of the shader but for its biases, field by field.
#[repr(C)]
#[derive(Clone, Copy, Debug, Default, Pod, Zeroable)]
pub(crate) struct Job {
    pub size: [u32; 2],
    pub has: u32,
    pub weights: u32,
    pub own: [u32; 4],
    pub to: [i32; 2],
    pub share_of_slice: f32,
    pub share_of_row: f32,
    pub uv: [u32; 4],
    pub first: [u32; 4],
    pub second: [u32; 4],
    pub uvt: [u32; 2],
    pub ut: [u32; 2],
    pub vt: [u32; 2],
    pub sides: [u32; 2],
    pub mean: [f32; 4],
    pub direction: [f32; 4],
    pub irradiance: [f32; 4],
    pub seen: [u32; 4],
    pub normals: [u32; 4],
}

/// What is known of a tile's section of features; its large maps are on the device.
#[derive(Debug)]
pub(crate) struct Maps {
    /// Without the blocks, and without F_ut and F_vt.
    params: TileParams,
    /// In words of the resident buffer.
    weights: u32,
    /// In texels of two bytes of the resident buffer.
    ut: u32,
    vt: u32,
    pub uv: Option<Spot>,
    pub slices: Vec<Spot>,
    /// Whether its network may be evaluated in 16 bits.
    pub fits_half: bool,
}

/// What is known of a tile's sun.
#[derive(Debug)]
pub(crate) struct Seen {
    normals: [u32; 3],
    channels: usize,
    /// Where its part of the interval's buffer begins, in words, and how long it is.
    pub region: (u32, usize),
    /// The times that the part is of, and whether anything is seen at them and between.
    pub held: Option<([usize; 2], Held)>,
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

/// A tile on the device.
#[derive(Debug, Default)]
pub(crate) struct Tile {
    pub maps: Option<Maps>,
    pub seen: Option<Seen>,
}

impl Tile {
    /// Its part of the interval's buffer counts as never written.
    pub fn forget(&mut self) {
        if let Some(seen) = &mut self.seen {
            seen.held = None;
        }
    }
}

/// 16-bit floats, two a word.
fn halves(values: [u16; 4]) -> [u32; 2] {
    let [a, b, c, d] = values.map(u32::from);
    [a | b << 16, c | d << 16]
}

/// Texels of two bytes, two a word.
fn pairs(texels: &[[u8; 2]]) -> impl Iterator<Item = u32> {
    texels.chunks(2).map(|two| {
        let [a, b] = [0, 1].map(|i| two.get(i).map_or(0, |texel| u32::from(u16::from_le_bytes(*texel))));
        a | b << 16
    })
}

impl Maps {
    /// Puts into the resident buffer what a tile has beside BC7 blocks; `uv` and `slices` are the places of those.
    pub fn new(mut params: TileParams, uv: Option<Spot>, slices: Vec<Spot>, resident: &mut Vec<u32>) -> Self {
        let weights = resident.len() as u32;
        weights_of(&params, resident);
        let mut plane = |texels: &[[u8; 2]]| {
            let at = 2 * resident.len() as u32;
            resident.extend(pairs(texels));
            at
        };
        let (ut, vt) = (plane(&params.f_ut), plane(&params.f_vt));
        let fits_half = largest(&params) < HALF_MAX;
        (params.f_uv, params.f_uvt, params.f_ut, params.f_vt) = Default::default();
        Maps { params, weights, ut, vt, uv, slices, fits_half }
    }

    /// Width of the hidden layers.
    pub fn hidden(&self) -> usize {
        self.params.shape.hidden
    }

    /// Fills in what a job says of the maps at a moment, and gives the biases of the first layer; `None` where they are black.
    pub fn job(&self, timeline: &Timeline, moment: &Moment, job: &mut Job) -> Option<Vec<f32>> {
        let (shape, has) = (&self.params.shape, &self.params.shape.contents);
        let inputs = Inputs::at(&self.params, timeline, moment);
        if inputs.means == [0.0; 3] {
            return None;
        }
        job.has |= HAS_MAPS;
        job.weights = self.weights;
        job.mean[..3].copy_from_slice(&inputs.means);
        if timeline.coding == Coding::Paper {
            job.has |= IS_PAPERS;
        }
        if let Some([x, y, layer]) = self.uv {
            job.has |= HAS_UV;
            job.uv = [x, y, layer, 0];
        }
        if has.uvt > 0 {
            let (first, second, share) = along_tau(inputs.tau, shape.uvt[2]);
            let spot = |i: usize| {
                let [x, y, layer] = self.slices[i];
                [x, y, layer, 0]
            };
            (job.first, job.second, job.share_of_slice) = (spot(first), spot(second), share);
            job.uvt = [shape.uvt[0] as u32, shape.uvt[1] as u32];
            job.has |= HAS_UVT;
        }
        if has.ut || has.vt {
            let (first, second, share) = along_tau(inputs.tau, shape.rows);
            let rows = |at: u32, side: usize| [first, second].map(|row| at + (row * side) as u32);
            (job.ut, job.vt, job.share_of_row) = (rows(self.ut, shape.ut), rows(self.vt, shape.vt), share);
            job.sides = [shape.ut as u32, shape.vt as u32];
            job.has |= if has.ut { HAS_UT } else { 0 } | if has.vt { HAS_VT } else { 0 };
        }
        Some(self.bias(&inputs.gamma, &timeline.states[moment.a]))
    }

    /// b₁ with γ and the gates, which are the same for all texels.
    fn bias(&self, of_gamma: &[f32; 4], state: &[bool]) -> Vec<f32> {
        let (shape, mlp) = (&self.params.shape, &self.params.mlp);
        let (inputs, [.., gamma, gates]) = (shape.inputs(), shape.columns());
        let given: Vec<f32> =
            of_gamma[..gamma.len()].iter().copied().chain(self.params.gate_inputs(state)).collect();
        let unit = |j: usize| {
            let row = &mlp[j * inputs..][gamma.start..gates.end];
            let of_time: f32 = row.iter().zip(&given).map(|(w, g)| w.to_f32() * g).sum();
            mlp[shape.hidden * inputs + j].to_f32() + of_time
        };
        (0..shape.hidden).map(unit).collect()
    }
}

/// A tile's weights as matrices of four inputs to four outputs, and its biases; 0 for what the tile does not have.
fn weights_of(params: &TileParams, out: &mut Vec<u32>) {
    let (shape, hidden) = (&params.shape, params.shape.hidden);
    let (inputs, columns, start) = (shape.inputs(), shape.columns(), out.len());
    let [uvt, uv, ut, vt, ..] = &columns;
    let (w2, b2) = (hidden * inputs + hidden, hidden * inputs + hidden + hidden * hidden);
    let (w3, b3) = (b2 + hidden, b2 + hidden + 3 * hidden);
    let at = |i: usize| params.mlp[i].0;
    // The four inputs of a group, by their columns of W₁.
    let four = |range: &std::ops::Range<usize>| [0, 1, 2, 3].map(|c| range.clone().nth(c));
    let planes = [ut.clone().next(), ut.clone().nth(1), vt.clone().next(), vt.clone().nth(1)];
    let mut matrix = |column: &dyn Fn(usize) -> [u16; 4]| (0..4).for_each(|c| out.extend(halves(column(c))));
    for group in [four(uvt), four(uv), planes] {
        for j in (0..hidden).step_by(4) {
            matrix(&|c| [0, 1, 2, 3].map(|r| group[c].map_or(0, |input| at((j + r) * inputs + input))));
        }
    }
    for j in (0..hidden).step_by(4) {
        for k in (0..hidden).step_by(4) {
            matrix(&|c| [0, 1, 2, 3].map(|r| at(w2 + (j + r) * hidden + k + c)));
        }
    }
    for k in (0..hidden).step_by(4) {
        matrix(&|c| [0, 1, 2, 3].map(|r| if r < 3 { at(w3 + r * hidden + k + c) } else { 0 }));
    }
    for j in (0..hidden).step_by(4) {
        out.extend(halves([0, 1, 2, 3].map(|r| at(b2 + j + r))));
    }
    out.extend(halves([at(b3), at(b3 + 1), at(b3 + 2), 0]));
    debug_assert_eq!(out.len() - start, shader::words(hidden));
}

/// A bound of all that a tile's network sums up, whatever its maps hold.
fn largest(params: &TileParams) -> f32 {
    let shape = &params.shape;
    let mlp: Vec<f32> = params.mlp.iter().map(|w| w.to_f32().abs()).collect();
    let [w1, b1, w2, b2, w3, b3] = shape.split_mlp(&mlp);
    let layer = |weights: &[f32], biases: &[f32], inputs: &[f32]| -> Vec<f32> {
        let row = |j: usize| weights[j * inputs.len()..][..inputs.len()].iter().zip(inputs);
        let sum = |j: usize| biases[j] + row(j).map(|(w, x)| w * x).sum::<f32>();
        (0..biases.len()).map(sum).collect()
    };
    // Features are within ±3/2, γ and gates within ±1; the activation makes nothing larger.
    let h1 = layer(w1, b1, &vec![1.5; shape.inputs()]);
    let h2 = layer(w2, b2, &h1);
    let y = layer(w3, b3, &h2);
    [h1, h2, y].concat().into_iter().fold(0.0, f32::max)
}

impl Seen {
    /// Puts a tile's normals into the resident buffer, and reserves the tile's region of the interval buffer; `interval` is its length so far in u32s.
    pub fn new(tile: &TileSun, resident: &mut Vec<u32>, interval: &mut u32) -> Self {
        let normals = normals_of(tile, resident);
        let (texels, channels) = (tile.width * tile.height, tile.channels());
        let most = tile.shadows.most_bytes(channels);
        let blocks = if most > 0 { channels * blocks(tile) } else { 0 };
        let words = channels * 2 * (texels / 8) + blocks + most.div_ceil(4);
        let region = (*interval, words);
        *interval += words as u32;
        Seen { normals, channels, region, held: None }
    }

    /// The tile's part of the interval's buffer. `tile` has the times around the moment alone.
    pub fn part(&self, tile: &TileSun, times: [usize; 2]) -> (Held, Vec<u32>) {
        let (texels, channels) = (tile.width * tile.height, tile.channels());
        let mut out = Vec::with_capacity(self.region.1);
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
    pub fn job(&self, sun: &SunAt, job: &mut Job) -> bool {
        let Some((_, held)) = self.held.filter(|(_, held)| *held != Held::Dark) else { return false };
        let texels = job.size[0] * job.size[1];
        let levels = self.channels as u32 * 2 * (texels / 8);
        let blocks = self.channels as u32 * job.size[0].div_ceil(8) * job.size[1].div_ceil(8);
        let start = self.region.0;
        job.seen = [start, start + levels, 2 * (start + levels + blocks), 0];
        let [blocks, choices, normals] = self.normals;
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

/// Three arrays: per 4×4 block, the start of its normal list, its index width in bits and the start of its indices; the indices; the normals. Lists that
/// are alike are kept once. Gives where the three begin.
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

/// The job of a tile that has nothing yet: its size, which texels are written, and where.
pub(crate) fn blank(
    grid: &Grid,
    [column, row]: [usize; 2],
    to: [i32; 2],
    with_border: bool,
    exposure: f32,
) -> Job {
    let (width, height) = grid.stored(column, row);
    let (own_width, own_height) = grid.payload(column, row);
    let border = if with_border { 0 } else { BORDER };
    let rim = 2 * (BORDER - border);
    let own = [border, border, border + own_width + rim, border + own_height + rim].map(|x| x as u32);
    let border = border as i32;
    let mut job = Job { size: [width as u32, height as u32], own, ..Job::default() };
    job.to = to.map(|at| at - border);
    job.mean[3] = exposure;
    job
}
