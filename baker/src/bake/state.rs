//! The work done so far, one file per block of texels: sums of samples, readable layer by layer.
//!
//! Memory holds the blocks being worked on, never the page; a killed bake continues with what was written.

use crate::{Error, Result, Rgb};
use dataset::files::write_atomically;
use std::fs::File;
use std::os::unix::fs::FileExt;
use std::path::{Path, PathBuf};

/// Sums over the samples of one block, for its covered texels only.
#[derive(Clone, Debug, PartialEq)]
pub struct BlockState {
    /// Samples per texel so far, both halves together.
    pub samples: u32,
    /// Per covered texel and half, the samples that lay outside solids: what the sums are divided by.
    pub exposed: Vec<[u32; 2]>,
    /// `[texel][half][layer]`: sums of irradiance samples, half of `samples` in each half.
    pub sums: Vec<Rgb>,
}

impl BlockState {
    /// No samples yet.
    pub fn empty(texels: usize, layers: usize) -> Self {
        BlockState { samples: 0, exposed: vec![[0; 2]; texels], sums: vec![Rgb::ZERO; texels * 2 * layers] }
    }
}

/// The folder of block files of one bake.
#[derive(Debug)]
pub struct StateFolder {
    root: PathBuf,
    layers: usize,
}

const MAGIC: &[u8; 8] = b"TLMBLOCK";
const HEADER: usize = 24;

impl StateFolder {
    /// Opens or creates the folder of the bake with this digest below `dataset`, and removes those of other bakes.
    pub fn open(dataset: &Path, digest: &str, layers: usize) -> Result<Self> {
        let parent = dataset.join(FOLDER);
        let root = parent.join(&digest[..16]);
        if let Ok(entries) = std::fs::read_dir(&parent) {
            for entry in entries.flatten().filter(|e| e.path() != root) {
                let _ = std::fs::remove_dir_all(entry.path());
            }
        }
        std::fs::create_dir_all(&root).map_err(Error::io(&root))?;
        Ok(StateFolder { root, layers })
    }

    /// Forgets all work below `dataset`.
    pub fn clear(dataset: &Path) {
        let _ = std::fs::remove_dir_all(dataset.join(FOLDER));
    }

    /// The folder, for small files that belong to the work.
    pub fn root(&self) -> &Path {
        &self.root
    }

    fn path(&self, block: usize) -> PathBuf {
        self.root.join(format!("block-{block:07}.bin"))
    }

    /// Reads a block, or gives an empty one if nothing fitting was written yet.
    pub fn read(&self, block: usize, texels: usize) -> Result<BlockState> {
        let path = self.path(block);
        let bytes = match std::fs::read(&path) {
            Ok(bytes) => bytes,
            Err(e) if e.kind() == std::io::ErrorKind::NotFound => {
                return Ok(BlockState::empty(texels, self.layers));
            }
            Err(e) => return Err(Error::io(&path)(e)),
        };
        let per_texel = 8 + self.layers * 2 * 12;
        if bytes.len() != HEADER + texels * per_texel || &bytes[..8] != MAGIC {
            return Ok(BlockState::empty(texels, self.layers));
        }
        let word = |i: usize| u32::from_le_bytes([bytes[i], bytes[i + 1], bytes[i + 2], bytes[i + 3]]);
        let mut state = BlockState::empty(texels, self.layers);
        state.samples = word(8);
        for (i, e) in state.exposed.iter_mut().enumerate() {
            *e = [word(HEADER + 8 * i), word(HEADER + 8 * i + 4)];
        }
        // On disk [layer][half][texel], in memory [texel][half][layer].
        let values: &[u8] = &bytes[HEADER + 8 * texels..];
        let at = |i: usize| f32::from_le_bytes([values[i], values[i + 1], values[i + 2], values[i + 3]]);
        for layer in 0..self.layers {
            for half in 0..2 {
                for texel in 0..texels {
                    let from = ((layer * 2 + half) * texels + texel) * 12;
                    state.sums[(texel * 2 + half) * self.layers + layer] =
                        Rgb::new(at(from), at(from + 4), at(from + 8));
                }
            }
        }
        Ok(state)
    }

    /// Writes a block, replacing what was there.
    pub fn write(&self, block: usize, state: &BlockState) -> Result<()> {
        let texels = state.exposed.len();
        let mut bytes = Vec::with_capacity(HEADER + texels * (8 + self.layers * 24));
        bytes.extend_from_slice(MAGIC);
        bytes.extend_from_slice(&state.samples.to_le_bytes());
        bytes.extend_from_slice(&(texels as u32).to_le_bytes());
        bytes.extend_from_slice(&(self.layers as u32).to_le_bytes());
        bytes.resize(HEADER, 0);
        for b in state.exposed.as_flattened() {
            bytes.extend_from_slice(&b.to_le_bytes());
        }
        for layer in 0..self.layers {
            for half in 0..2 {
                for texel in 0..texels {
                    for v in state.sums[(texel * 2 + half) * self.layers + layer].to_array() {
                        bytes.extend_from_slice(&v.to_le_bytes());
                    }
                }
            }
        }
        write_atomically(&self.path(block), &bytes)
    }

    /// Reads one layer of a block: per texel the sums of both halves.
    pub fn read_layer(&self, block: usize, texels: usize, layer: usize) -> Result<Vec<[Rgb; 2]>> {
        let path = self.path(block);
        let mut bytes = vec![0; texels * 24];
        read_at(&path, &mut bytes, (HEADER + 8 * texels + layer * texels * 24) as u64)?;
        let rgb = |i: usize| {
            let v = |k: usize| {
                let o = i * 12 + k * 4;
                f32::from_le_bytes([bytes[o], bytes[o + 1], bytes[o + 2], bytes[o + 3]])
            };
            Rgb::new(v(0), v(1), v(2))
        };
        Ok((0..texels).map(|t| [rgb(t), rgb(texels + t)]).collect())
    }
}

fn read_at(path: &Path, bytes: &mut [u8], offset: u64) -> Result<()> {
    let file = File::open(path).map_err(Error::io(path))?;
    file.read_exact_at(bytes, offset).map_err(Error::io(path))
}

/// Name of the folder of work in progress inside a dataset.
const FOLDER: &str = ".bake";

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_block_reads_back_whole_and_by_layer() {
        let dir = tempfile::tempdir().unwrap();
        let digest = "0123456789abcdef0123";
        let folder = StateFolder::open(dir.path(), digest, 3).unwrap();
        assert_eq!(folder.read(5, 4).unwrap(), BlockState::empty(4, 3));
        let mut state = BlockState::empty(4, 3);
        state.samples = 8;
        state.exposed = vec![[1, 2], [3, 4], [5, 6], [7, 8]];
        for (i, s) in state.sums.iter_mut().enumerate() {
            *s = Rgb::new(i as f32, 0.5 * i as f32, -1.0);
        }
        folder.write(5, &state).unwrap();
        assert_eq!(folder.read(5, 4).unwrap(), state);
        let layer = folder.read_layer(5, 4, 2).unwrap();
        assert_eq!(layer[3], [state.sums[3 * 6 + 2], state.sums[3 * 6 + 3 + 2]]);
        // Another bake's work is removed; a block of another size is not taken for this one's.
        assert_eq!(folder.read(5, 3).unwrap(), BlockState::empty(3, 3));
        StateFolder::open(dir.path(), "fedcba9876543210fedc", 3).unwrap();
        assert!(!folder.root().exists());
    }
}
