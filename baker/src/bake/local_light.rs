//! What errors are relative to, as the cache knows it: by it samples go to where errors are seen.
//!
//! It is not taken from the samples: a texel's own must have no say in their number ([`super::allocate`]).

use super::allocate::distinct;
use super::block::Worker;
use super::errors::{Parts, Sums, cell_of};
use super::indirect::Cache;
use super::local_errors::{CellMap, Pieces};
use super::state::CELLS;
use super::value::Value;
use crate::surface::BlockSurface;
use crate::{Result, Rgb};
use dataset::signals::stop_if_interrupted;
use rayon::prelude::*;

/// What reads the light of frames from the cache.
#[derive(Clone, Copy)]
pub struct CachedFrames<'a> {
    /// The texels.
    pub worker: &'a Worker<'a>,
    /// The cache.
    pub cache: &'a Cache<'a>,
    /// Where its cells are.
    pub cell_map: &'a CellMap,
    /// The layers of each frame.
    pub frames: &'a [Parts],
}

/// Per frame and cell, the light below which nothing is judged; no cells for a frame that equals an earlier
/// one.
pub struct Floors(Vec<Vec<f32>>);

impl CachedFrames<'_> {
    /// The floors of all cells.
    pub fn floors(&self) -> Result<Floors> {
        let grid = self.cell_map.grid();
        let distinct = distinct(self.frames);
        let of_block = |&block: &usize| -> Result<_> {
            stop_if_interrupted()?;
            let surface = self.worker.surface(block);
            let pieces = self.pieces(&surface);
            let cells = |light: Vec<Sums>| {
                let mut cells = [Sums::default(); CELLS];
                pieces.add_to_cells(&light, &mut cells);
                cells.map(|cell| cell.mean() as f32)
            };
            let light = self.light(&surface, &pieces, &distinct).into_iter().map(cells);
            Ok((surface.x0, surface.y0, light.collect::<Vec<_>>()))
        };
        let blocks = self.worker.blocks().par_iter().map(of_block).collect::<Result<Vec<_>>>()?;
        let mut floors = vec![Vec::new(); self.frames.len()];
        for (k, &frame) in distinct.iter().enumerate() {
            let mut cells = vec![Sums::default(); grid.cells()];
            for (x0, y0, light) in &blocks {
                for (cell, &light) in light[k].iter().enumerate().filter(|(_, light)| **light > 0.0) {
                    cells[grid.of_block(*x0, *y0, cell)] =
                        Sums { values: 1, light: f64::from(light), ..Sums::default() };
                }
            }
            floors[frame] = self.cell_map.floors(&cells).into_iter().map(|floor| floor as f32).collect();
        }
        Ok(Floors(floors))
    }

    /// For some frames, what the errors of a block's covered texels are relative to: the light of their
    /// pieces, or the floors.
    pub fn local_light(&self, surface: &BlockSurface, frames: &[usize], floors: &Floors) -> Vec<Vec<f64>> {
        let grid = self.cell_map.grid();
        let pieces = self.pieces(surface);
        let of_frame = |(light, &frame): (Vec<Sums>, &usize)| {
            let of_texel = |(texel, in_block): (usize, usize)| {
                let cell = grid.of_block(surface.x0, surface.y0, cell_of(surface, in_block));
                light[pieces.of(texel)].mean().max(f64::from(floors.0[frame][cell]))
            };
            surface.covered().enumerate().map(of_texel).collect()
        };
        self.light(surface, &pieces, frames).into_iter().zip(frames).map(of_frame).collect()
    }

    fn pieces(&self, surface: &BlockSurface) -> Pieces {
        let piece = |in_block: usize| {
            let (x, y) = (surface.x0 + in_block % surface.width, surface.y0 + in_block / surface.width);
            (cell_of(surface, in_block), self.cell_map.chart_of(x, y))
        };
        Pieces::new(surface.covered().map(piece))
    }

    /// Per frame, the light of each piece of a block.
    fn light(&self, surface: &BlockSurface, pieces: &Pieces, frames: &[usize]) -> Vec<Vec<Sums>> {
        let mut light = vec![pieces.sums(); frames.len()];
        let mut layers = vec![Rgb::ZERO; self.worker.transport.lights.layers()];
        for (texel, in_block) in surface.covered().enumerate() {
            let Some(entry) = self.cache.map.of_texel(surface.page_index(self.worker.atlas, in_block)) else {
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
