//! Where the texels of a page lie in space, on disk block by block. In memory are the blocks used last, and
//! an index: which blocks have texels in which box of space.

use super::texel_in_space::{Key, TexelInSpace};
use crate::surface::BLOCK;
use crate::{Error, Result};
use dataset::host::ReadExactAt;
use std::collections::BTreeMap;
use std::fs::File;
use std::io::{BufWriter, Write};
use std::ops::Range;
use std::path::{Path, PathBuf};
use std::sync::{Arc, Mutex, PoisonError};

/// Blocks that are in memory at once.
pub(crate) const BLOCKS_AT_ONCE: usize = 1024;
/// Bytes of a texel on disk.
pub(crate) const TEXEL_BYTES: u64 = size_of::<TexelInSpace>() as u64;
/// Bytes of a block in memory.
pub(crate) const BLOCK_BYTES: usize = BLOCK * BLOCK * (size_of::<TexelInSpace>() + size_of::<(Key, u32)>());

/// The covered texels of a page in space, in their order.
pub(super) struct StoredBlocks {
    folder: PathBuf,
    file: File,
    /// The texels of each block.
    blocks: Vec<Range<u32>>,
    /// Ascending pairs: a box with valid texels, and the number of a block that has some of them.
    boxes: Vec<(Key, u32)>,
    loaded: Mutex<Loaded>,
}

/// What is in memory.
#[derive(Default)]
struct Loaded {
    /// By number, with the count of uses at its last one.
    blocks: BTreeMap<u32, (Arc<Block>, u64)>,
    uses: u64,
}

/// A block in memory.
struct Block {
    first: u32,
    texels: Vec<TexelInSpace>,
    /// Valid texels by their boxes, numbered within the block.
    sorted: Vec<(Key, u32)>,
}

impl StoredBlocks {
    /// A texel.
    pub(super) fn texel(&self, texel: u32) -> Result<TexelInSpace> {
        let number = self.blocks.partition_point(|texels| texels.end <= texel);
        let block = self.block(number as u32)?;
        Ok(block.texels[(texel - block.first) as usize])
    }

    /// Whether there are valid texels in some boxes.
    pub(super) fn holds(&self, keys: Range<Key>) -> bool {
        let from = self.boxes.partition_point(|(key, _)| *key < keys.start);
        self.boxes.get(from).is_some_and(|(key, _)| *key < keys.end)
    }

    /// Goes through the valid texels in some boxes, box by box, and in each in their order.
    pub(super) fn each_in(&self, keys: Range<Key>, mut each: impl FnMut(u32, &TexelInSpace)) -> Result<()> {
        let from = self.boxes.partition_point(|(key, _)| *key < keys.start);
        for &(key, number) in self.boxes[from..].iter().take_while(|(key, _)| *key < keys.end) {
            let block = self.block(number)?;
            let from = block.sorted.partition_point(|(of, _)| *of < key);
            for &(_, texel) in block.sorted[from..].iter().take_while(|(of, _)| *of == key) {
                each(block.first + texel, &block.texels[texel as usize]);
            }
        }
        Ok(())
    }

    /// A block, read if it is not in memory.
    fn block(&self, number: u32) -> Result<Arc<Block>> {
        if let Some(block) = self.loaded().get(number) {
            return Ok(block);
        }
        let texels = self.blocks[number as usize].clone();
        let mut block = Block {
            first: texels.start,
            texels: vec![TexelInSpace::INVALID; texels.len()],
            sorted: Vec::new(),
        };
        let at = texels.start as u64 * size_of::<TexelInSpace>() as u64;
        let bytes = bytemuck::cast_slice_mut(&mut block.texels);
        self.file.read_exact_at(bytes, at).map_err(Error::io(&self.folder))?;
        block.sorted = sorted_keys(&block.texels);
        let block = Arc::new(block);
        self.loaded().insert(number, block.clone());
        Ok(block)
    }

    fn loaded(&self) -> std::sync::MutexGuard<'_, Loaded> {
        self.loaded.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

impl Loaded {
    fn get(&mut self, number: u32) -> Option<Arc<Block>> {
        self.uses += 1;
        let (block, last_use) = self.blocks.get_mut(&number)?;
        *last_use = self.uses;
        Some(block.clone())
    }

    /// Adds a block; if memory is full, the least recently used one goes.
    fn insert(&mut self, number: u32, block: Arc<Block>) {
        if self.blocks.len() >= BLOCKS_AT_ONCE {
            let oldest =
                self.blocks.iter().min_by_key(|(_, (_, last_use))| *last_use).map(|(number, _)| *number);
            oldest.and_then(|number| self.blocks.remove(&number));
        }
        self.blocks.insert(number, (block, self.uses));
    }
}

/// Writes blocks, one after the other.
pub(super) struct StoredBlocksWriter {
    folder: PathBuf,
    file: BufWriter<File>,
    blocks: Vec<Range<u32>>,
    boxes: Vec<(Key, u32)>,
}

impl StoredBlocksWriter {
    /// Into a nameless file in a folder, which is gone once closed, even by a kill.
    pub(super) fn create(folder: &Path) -> Result<Self> {
        let file = tempfile::tempfile_in(folder).map_err(Error::io(folder))?;
        let (blocks, boxes) = (Vec::new(), Vec::new());
        Ok(StoredBlocksWriter { folder: folder.to_owned(), file: BufWriter::new(file), blocks, boxes })
    }

    /// Adds a block.
    pub(super) fn push(&mut self, texels: &[Option<TexelInSpace>]) -> Result<()> {
        let texels: Vec<TexelInSpace> =
            texels.iter().map(|texel| texel.unwrap_or(TexelInSpace::INVALID)).collect();
        let (number, first) = (self.blocks.len() as u32, self.blocks.last().map_or(0, |last| last.end));
        self.file.write_all(bytemuck::cast_slice(&texels)).map_err(Error::io(&self.folder))?;
        self.blocks.push(first..first + texels.len() as u32);
        let mut keys: Vec<Key> = sorted_keys(&texels).into_iter().map(|(key, _)| key).collect();
        keys.dedup();
        self.boxes.extend(keys.into_iter().map(|key| (key, number)));
        Ok(())
    }

    /// All blocks.
    pub(super) fn finish(mut self) -> Result<StoredBlocks> {
        let file = self.file.into_inner().map_err(|e| Error::io(&self.folder)(e.into_error()))?;
        self.boxes.sort_unstable();
        let loaded = Mutex::default();
        Ok(StoredBlocks { folder: self.folder, file, blocks: self.blocks, boxes: self.boxes, loaded })
    }
}

/// The valid ones among some texels, ascending by box.
fn sorted_keys(texels: &[TexelInSpace]) -> Vec<(Key, u32)> {
    let keys = texels.iter().zip(0..).filter(|(texel, _)| **texel != TexelInSpace::INVALID);
    let mut sorted: Vec<(Key, u32)> = keys.map(|(texel, i)| (texel.key(), i)).collect();
    sorted.sort_unstable();
    sorted
}
