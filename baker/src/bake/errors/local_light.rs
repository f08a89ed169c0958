//! The light that a texel's error is relative to, read from the cache: samples are handed out by it.
//!
//! It is not taken from the texels' samples: a texel's own samples must not decide how many it gets
//! ([`crate::bake::samples::allocate`]). (The cache holds its direct samples, but their number does not
//! follow the shares.)

use super::local_errors::{CellMap, Pieces};
use super::sums::Sums;
use crate::bake::samples::{Cache, Worker, distinct};
use crate::bake::store::{CELLS, Parts, Value, cell_of};
use crate::receivers::ReceiverBlock;
use crate::{Result, Rgb};
use dataset::host::signals::stop_if_interrupted;
use rayon::prelude::*;

/// Reads the light of frames from the cache.
#[derive(Clone, Copy)]
pub(crate) struct CachedLight<'a> {
    /// Gives surfaces and blocks.
    pub worker: &'a Worker<'a>,
    /// The solved cache.
    pub cache: &'a Cache<'a>,
    /// The page's cells.
    pub cell_map: &'a CellMap,
    /// Per frame, its layers.
    pub frames: &'a [Parts],
}

/// Per frame and cell, the least light in klx that errors are relative to. A frame that equals an earlier one
/// has no cells: only [`distinct`] frames may be asked for.
pub(crate) struct Floors(Vec<Vec<f32>>);

impl CachedLight<'_> {
    /// The floors of all cells, by [`CellMap::floors`].
    ///
    /// # Errors
    /// [`crate::Error::Interrupted`] alone.
    pub(crate) fn floors(&self) -> Result<Floors> {
        let grid = self.cell_map.grid();
        let distinct = distinct(self.frames);
        let of_block = |&block: &usize| -> Result<_> {
            stop_if_interrupted()?;
            let receivers = self.worker.block(block);
            let pieces = self.pieces(&receivers);
            let means_of_cells = |light: Vec<Sums>| {
                let mut cells = [Sums::default(); CELLS];
                pieces.add_to_cells(&light, &mut cells);
                cells.map(|cell| (cell.values > 0).then(|| cell.mean() as f32))
            };
            let light = self.light(&receivers, &pieces, &distinct).into_iter().map(means_of_cells);
            Ok((receivers.x0, receivers.y0, light.collect::<Vec<_>>()))
        };
        let blocks = self.worker.blocks().par_iter().map(of_block).collect::<Result<Vec<_>>>()?;
        let mut floors = vec![Vec::new(); self.frames.len()];
        for (k, &frame) in distinct.iter().enumerate() {
            let mut cells = vec![Sums::default(); grid.cells()];
            for (x0, y0, light) in &blocks {
                for (cell, light) in light[k].iter().enumerate() {
                    if let Some(light) = light {
                        cells[grid.of_block(*x0, *y0, cell)] =
                            Sums { values: 1, light: f64::from(*light), ..Sums::default() };
                    }
                }
            }
            floors[frame] = self.cell_map.floors(&cells).into_iter().map(|floor| floor as f32).collect();
        }
        Ok(Floors(floors))
    }

    /// Per frame of `frames` (distinct ones) and covered texel of a block, in order: the light in klx that
    /// its errors are relative to. That is the mean light of its piece, or its cell's floor if that is more.
    pub(crate) fn local_light(
        &self,
        receivers: &ReceiverBlock,
        frames: &[usize],
        floors: &Floors,
    ) -> Vec<Vec<f64>> {
        let grid = self.cell_map.grid();
        let pieces = self.pieces(receivers);
        let of_frame = |(sums, &frame): (Vec<Sums>, &usize)| {
            let of_texel = |(texel, in_block): (usize, usize)| {
                let cell = grid.of_block(receivers.x0, receivers.y0, cell_of(receivers, in_block));
                sums[pieces.of(texel)].mean().max(f64::from(floors.0[frame][cell]))
            };
            receivers.covered().enumerate().map(of_texel).collect()
        };
        self.light(receivers, &pieces, frames).into_iter().zip(frames).map(of_frame).collect()
    }

    fn pieces(&self, receivers: &ReceiverBlock) -> Pieces {
        Pieces::new(receivers.covered().map(|in_block| self.cell_map.piece_of(receivers, in_block)))
    }

    /// Per frame, the sums of each piece of a block: light alone. Texels without a cache entry do not count.
    fn light(&self, receivers: &ReceiverBlock, pieces: &Pieces, frames: &[usize]) -> Vec<Vec<Sums>> {
        let mut light = vec![pieces.sums(); frames.len()];
        let mut layers = vec![Rgb::ZERO; self.worker.transport.lights.layers()];
        for (texel, in_block) in receivers.covered().enumerate() {
            let Some(entry) = self.cache.map.of_texel(receivers.page_index(in_block)) else {
                continue;
            };
            layers.fill(Rgb::ZERO);
            self.cache.halves.iter().for_each(|half| half.add(entry, Rgb::splat(0.5), &mut layers));
            for (light, &frame) in light.iter_mut().zip(frames) {
                let sum = self.frames[frame].iter().map(|&(layer, scale)| layers[layer] * scale).sum();
                pieces.add_texel(texel, &Value::traced(sum, Rgb::ZERO), light);
            }
        }
        light
    }
}
