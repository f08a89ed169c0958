//! The work done so far, one file per block of texels: sums of samples.
//!
//! While tracing, memory holds the blocks being worked on, never the page; a killed bake continues with what was written.

use crate::surface::BLOCK;
use crate::{Error, Result, Rgb};
use bytemuck::{Pod, Zeroable};
use std::path::{Path, PathBuf};

/// Side of a cell: the texels that are given samples together.
pub const CELL: usize = 16;
/// Cells of a block.
pub const CELLS: usize = (BLOCK / CELL) * (BLOCK / CELL);
/// Points of a texel that are probed for lying inside a solid.
pub const PROBES: u32 = 16;
/// All of them outside.
pub const ALL_OUTSIDE: u16 = u16::MAX;

/// Whether so many probed points are a texel's surface that it counts.
pub fn is_exposed(outside: u16) -> bool {
    is_enough(outside.count_ones())
}

/// Whether so many of a texel's probed points are enough of it.
pub fn is_enough(points: u32) -> bool {
    points >= PROBES / 8
}

/// Samples of one sampled light straight at one half of a texel.
#[derive(Clone, Copy, Debug, Default, PartialEq, Pod, Zeroable)]
#[repr(C)]
pub struct Direct {
    /// Sum of irradiances.
    pub sum: Rgb,
    /// Sum of the squares of the irradiances' channel sums.
    pub squares: f32,
    /// Samples drawn.
    pub drawn: u16,
    /// Those that had a point to start from: what the sum is divided by.
    pub taken: u16,
}

impl Direct {
    /// Adds a sample.
    pub fn add(&mut self, irradiance: Rgb) {
        self.sum += irradiance;
        self.squares += irradiance.element_sum().powi(2);
        self.drawn += 1;
        self.taken += 1;
    }

    /// Mean irradiance.
    pub fn mean(&self) -> Rgb {
        if self.taken == 0 { Rgb::ZERO } else { self.sum / f32::from(self.taken) }
    }

    /// Standard deviation of a sample, in the sum of its channels.
    pub fn deviation(&self) -> f32 {
        if self.taken == 0 {
            return 0.0;
        }
        let n = f32::from(self.taken);
        let mean = self.sum.element_sum() / n;
        (self.squares / n - mean * mean).max(0.0).sqrt()
    }

    /// Whether its samples differ by so much that more of them are worth their rays.
    pub fn varies(&self) -> bool {
        /// Standard deviation of a sample, relative to the mean, that is let be.
        const TOLERATED: f32 = 0.05;
        self.deviation() > TOLERATED * self.mean().element_sum()
    }

    /// Whether it differs so much from its neighbour that the edge of a shadow may run between them.
    pub fn differs_from(&self, neighbour: &Direct) -> bool {
        /// Of the greater of the two.
        const TOLERATED: f32 = 0.5;
        let (a, b) = (self.mean().element_sum(), neighbour.mean().element_sum());
        self.taken > 0 && neighbour.taken > 0 && (a - b).abs() > TOLERATED * a.max(b)
    }
}

/// Sums over the samples of one block, for its covered texels only.
#[derive(Clone, Debug, PartialEq)]
pub struct BlockState {
    /// Rounds completed.
    pub round: u32,
    /// Per texel, one bit per probed point, set where it is the texel's surface: outside solids, and on the side of a wall that the
    /// texel stands for ([`super::block::Worker::outside`]). Empty before they were probed.
    pub outside: Vec<u16>,
    /// `[texel][half][sampled light]`.
    pub direct: Vec<Direct>,
    /// `[texel][sampled light]`: trial samples, by which it is decided how many are wanted; empty before they are drawn and after
    /// the decision.
    pub trials: Vec<Direct>,
    /// `[texel][sampled light]`: how many direct samples are wanted, decided once (see [`super::direct`]); empty before that.
    pub wants: Vec<u8>,
    /// Per texel, log₂ of how many times the mean number of samples (the page's, or towards a target its cell's) it gets of indirect light ([`super::allocate`]); empty before
    /// that is decided.
    pub log2_shares: Vec<i8>,
    /// Per texel, the samples of indirect light drawn in each half.
    pub drawn: Vec<u32>,
    /// Per texel and half, those of them that had a point to start from: what the sums are divided by.
    pub taken: Vec<[u32; 2]>,
    /// `[texel][half][layer]`: sums of irradiance samples.
    pub sums: Vec<Rgb>,
}

impl BlockState {
    /// No samples yet.
    pub fn empty(texels: usize, layers: usize, sampled: usize) -> Self {
        BlockState {
            round: 0,
            outside: Vec::new(),
            direct: vec![Direct::default(); texels * 2 * sampled],
            trials: Vec::new(),
            wants: Vec::new(),
            log2_shares: Vec::new(),
            drawn: vec![0; texels],
            taken: vec![[0; 2]; texels],
            sums: vec![Rgb::ZERO; texels * 2 * layers],
        }
    }

    /// Whether enough of a texel lies outside solids for it to count as surface.
    pub fn is_exposed(&self, texel: usize) -> bool {
        is_exposed(self.outside.get(texel).copied().unwrap_or(0))
    }

    /// Sums of the trials' mean direct light of each light over the exposed texels, and how many those are.
    pub fn trial_sums(&self, lights: usize) -> (Vec<f64>, f64) {
        let mut sums = vec![0.0; lights];
        let trials =
            self.trials.chunks(lights.max(1)).enumerate().filter(|(texel, _)| self.is_exposed(*texel));
        for (_, trials) in trials {
            sums.iter_mut().zip(trials).for_each(|(s, d)| *s += f64::from(d.mean().element_sum()));
        }
        let exposed = (0..self.taken.len()).filter(|&t| self.is_exposed(t)).count();
        (sums, exposed as f64)
    }

    /// The estimate of each layer at a texel by one half; `lights` tells to which layers sampled lights add.
    pub fn means(&self, texel: usize, half: usize, lights: &crate::trace::lights::Lights, out: &mut [Rgb]) {
        let layers = lights.layers();
        let from = (texel * 2 + half) * layers;
        let scale = 1.0 / (self.taken[texel][half].max(1) as f32);
        for (out, sum) in out.iter_mut().zip(&self.sums[from..from + layers]) {
            *out = *sum * scale;
        }
        let from = (texel * 2 + half) * lights.sampled();
        for (light, direct) in self.direct[from..from + lights.sampled()].iter().enumerate() {
            out[lights.layer_of_sampled(light)] += direct.mean();
        }
    }
}

/// The folder of block files of one piece of work.
#[derive(Debug)]
pub struct StateFolder {
    root: PathBuf,
    layers: usize,
    sampled: usize,
}

const MAGIC: &[u8; 8] = b"TLMBLK06";
/// Magic, round, texels, layers, sampled lights, whether probed (1), tried (2), decided for direct light (4) and for indirect (8).
const HEADER: usize = 8 + 5 * 4;

impl StateFolder {
    /// Opens or creates the folder of the work with this digest below `dataset`, and removes those of other work.
    pub fn open(dataset: &Path, digest: &str, layers: usize, sampled: usize) -> Result<Self> {
        for other in Self::others(dataset, digest) {
            let _ = std::fs::remove_dir_all(other);
        }
        let root = dataset.join(FOLDER).join(&digest[..16]);
        std::fs::create_dir_all(&root).map_err(Error::io(&root))?;
        Ok(StateFolder { root, layers, sampled })
    }

    /// The unfinished work of other bakes, which [`StateFolder::open`] forgets.
    pub fn others(dataset: &Path, digest: &str) -> Vec<PathBuf> {
        let entries = std::fs::read_dir(dataset.join(FOLDER)).into_iter().flatten().flatten();
        entries.map(|e| e.path()).filter(|path| !path.ends_with(&digest[..16])).collect()
    }

    /// Forgets all work below `dataset`.
    pub fn clear(dataset: &Path) -> Result<()> {
        dataset::files::remove_folder(&dataset.join(FOLDER))
    }

    /// The folder, for files that belong to the work.
    pub fn root(&self) -> &Path {
        &self.root
    }

    fn path(&self, block: usize) -> PathBuf {
        self.root.join(format!("block-{block:07}.bin"))
    }

    /// Reads a block, or gives an empty one if nothing fitting was written yet.
    pub fn read(&self, block: usize, texels: usize) -> Result<BlockState> {
        let path = self.path(block);
        let empty = || BlockState::empty(texels, self.layers, self.sampled);
        match std::fs::read(&path) {
            Ok(bytes) => Ok(self.parse(&bytes, empty()).unwrap_or_else(empty)),
            Err(e) if e.kind() == std::io::ErrorKind::NotFound => Ok(empty()),
            Err(e) => Err(Error::io(&path)(e)),
        }
    }

    /// `None` where the bytes are not those of such a block.
    fn parse(&self, bytes: &[u8], mut state: BlockState) -> Option<BlockState> {
        let (header, mut rest) = bytes.split_at_checked(HEADER)?;
        let word = |i: usize| {
            let at = 8 + 4 * i;
            Some(u32::from_le_bytes(header.get(at..at + 4)?.try_into().ok()?))
        };
        let texels = state.taken.len();
        let fits = header.starts_with(MAGIC)
            && [word(1)?, word(2)?, word(3)?] == [texels as u32, self.layers as u32, self.sampled as u32];
        state.outside = vec![0; if word(4)? & 1 == 1 { texels } else { 0 }];
        let (known, records) = (word(4)?, texels * self.sampled);
        state.trials = vec![Direct::default(); if known & 2 == 2 { records } else { 0 }];
        state.wants = vec![0; if known & 4 == 4 { records } else { 0 }];
        state.log2_shares = vec![0; if known & 8 == 8 { texels } else { 0 }];
        state.round = word(0)?;
        let mut fill = |values: &mut [u8]| -> Option<()> {
            let (head, tail) = rest.split_at_checked(values.len())?;
            values.copy_from_slice(head);
            rest = tail;
            Some(())
        };
        fill(bytemuck::cast_slice_mut(&mut state.outside))?;
        fill(bytemuck::cast_slice_mut(&mut state.direct))?;
        fill(bytemuck::cast_slice_mut(&mut state.trials))?;
        fill(&mut state.wants)?;
        fill(bytemuck::cast_slice_mut(&mut state.log2_shares))?;
        fill(bytemuck::cast_slice_mut(&mut state.drawn))?;
        fill(bytemuck::cast_slice_mut(&mut state.taken))?;
        fill(bytemuck::cast_slice_mut(&mut state.sums))?;
        (fits && rest.is_empty()).then_some(state)
    }

    /// Writes a block, replacing what was there. (In the byte order of the machine: work in progress does not travel.)
    pub fn write(&self, block: usize, state: &BlockState) -> Result<()> {
        let mut bytes = Vec::with_capacity(HEADER + state.sums.len() * 12 + state.direct.len() * 20);
        bytes.extend_from_slice(MAGIC);
        let known = [
            state.outside.is_empty(),
            state.trials.is_empty(),
            state.wants.is_empty(),
            state.log2_shares.is_empty(),
        ];
        let known = known.iter().rev().fold(0, |bits, is_empty| bits << 1 | u32::from(!is_empty));
        let texels = state.taken.len() as u32;
        for word in [state.round, texels, self.layers as u32, self.sampled as u32, known] {
            bytes.extend_from_slice(&word.to_le_bytes());
        }
        bytes.extend_from_slice(bytemuck::cast_slice(&state.outside));
        bytes.extend_from_slice(bytemuck::cast_slice(&state.direct));
        bytes.extend_from_slice(bytemuck::cast_slice(&state.trials));
        bytes.extend_from_slice(&state.wants);
        bytes.extend_from_slice(bytemuck::cast_slice(&state.log2_shares));
        bytes.extend_from_slice(bytemuck::cast_slice(&state.drawn));
        bytes.extend_from_slice(bytemuck::cast_slice(&state.taken));
        bytes.extend_from_slice(bytemuck::cast_slice(&state.sums));
        // Whole or absent for a run that is killed; not synced, since after a power failure the work may start again.
        let path = self.path(block);
        let temporary = path.with_extension("partial");
        std::fs::write(&temporary, &bytes).map_err(Error::io(&temporary))?;
        std::fs::rename(&temporary, &path).map_err(Error::io(&path))
    }
}

/// Name of the folder of work in progress inside a dataset.
const FOLDER: &str = dataset::store::WORK;

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_block_reads_back_whole() {
        let dir = tempfile::tempdir().unwrap();
        let digest = "0123456789abcdef0123";
        let folder = StateFolder::open(dir.path(), digest, 3, 2).unwrap();
        assert_eq!(folder.read(5, 4).unwrap(), BlockState::empty(4, 3, 2));
        let mut state = BlockState::empty(4, 3, 2);
        state.round = 2;
        state.log2_shares = vec![-1, 0, 1, 3];
        state.drawn = vec![1, 2, 4, 16];
        state.outside = vec![1, 2, 3, 16];
        state.trials = vec![Direct { drawn: 3, ..Direct::default() }; 8];
        state.wants = vec![1; 8];
        state.taken = vec![[1, 2], [3, 4], [5, 6], [7, 8]];
        state.direct[7].add(Rgb::new(1.0, 2.0, 3.0));
        for (i, s) in state.sums.iter_mut().enumerate() {
            *s = Rgb::new(i as f32, 0.5 * i as f32, -1.0);
        }
        folder.write(5, &state).unwrap();
        assert_eq!(folder.read(5, 4).unwrap(), state);
        // Another bake's work is removed; a block of another size, or cut short, is not taken for this one's.
        assert_eq!(folder.read(5, 3).unwrap(), BlockState::empty(3, 3, 2));
        let path = folder.path(5);
        let bytes = std::fs::read(&path).unwrap();
        std::fs::write(&path, &bytes[..bytes.len() - 1]).unwrap();
        assert_eq!(folder.read(5, 4).unwrap(), BlockState::empty(4, 3, 2));
        assert!(StateFolder::others(dir.path(), digest).is_empty());
        assert_eq!(StateFolder::others(dir.path(), "fedcba9876543210fedc").len(), 1);
        StateFolder::open(dir.path(), "fedcba9876543210fedc", 3, 2).unwrap();
        assert!(!folder.root().exists());
    }

    #[test]
    fn only_what_varies_is_worth_more_samples() {
        let mut d = Direct::default();
        assert!(!d.varies());
        (0..4).for_each(|_| d.add(Rgb::splat(2.0)));
        assert!(!d.varies());
        d.add(Rgb::ZERO);
        assert!(d.varies());
        let mut dark = Direct::default();
        (0..4).for_each(|_| dark.add(Rgb::ZERO));
        assert!(!dark.varies());
    }
}
