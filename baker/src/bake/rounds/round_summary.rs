//! What the blocks of a page reached in a round, all together.

use super::round::Round;
use crate::bake::errors::{BlockErrors, CellMap, Errors, LocalErrorSummary, Sums, median};
use crate::bake::store::{CELLS, Parts};
use crate::trace::counts::RayCounts;

/// A block after a round.
pub(super) struct BlockResult {
    /// Column of its top left texel.
    pub x0: usize,
    /// Row of its top left texel.
    pub y0: usize,
    /// The texels of each cell that light could reach.
    pub usable: [u32; CELLS],
    /// Per frame, error and light of each cell.
    pub cells: Vec<[Sums; CELLS]>,
    /// Texels that were given samples.
    pub texels: u32,
    /// Samples of indirect light over all of them.
    pub samples: u64,
    /// Rays traced for it.
    pub rays: RayCounts,
}

impl BlockResult {
    /// What is asked of it towards a target.
    pub(super) fn cells(&self) -> BlockErrors<'_> {
        BlockErrors { x0: self.x0, y0: self.y0, usable: self.usable, sums: &self.cells }
    }
}

/// What the blocks of a page of this size reached, all together.
pub(super) fn summarise(
    [width, height]: [usize; 2],
    frames: &[Parts],
    cell_map: &CellMap,
    blocks: &[BlockResult],
    samples: u32,
    seconds: f64,
) -> Round {
    let mut errors = Errors::new(width, height, frames.len());
    for block in blocks {
        for (frame, cells) in block.cells.iter().enumerate() {
            let mut all = Sums::default();
            cells.iter().for_each(|c| all.add(c));
            errors.add(frame, block.x0, block.y0, &all);
        }
    }
    let frame_means: Vec<f64> = (0..frames.len()).map(|s| errors.frame(s).mean()).collect();
    let mut relative = errors.relative(frames.iter().any(|parts| !parts.is_empty()));
    relative.sort_by(f64::total_cmp);
    let at = |q: f64| relative.get(((relative.len() as f64 - 1.0) * q) as usize).copied().unwrap_or(0.0);
    let (local, local_frames) = local(frames.len(), cell_map, blocks);
    let texels: u64 = blocks.iter().map(|d| u64::from(d.texels)).sum();
    let drawn: u64 = blocks.iter().map(|d| d.samples).sum();
    Round {
        samples,
        mean_samples: drawn as f64 / texels.max(1) as f64,
        seconds,
        median_error: median(&relative),
        p95_error: at(0.95),
        worst_error: at(1.0),
        frame_errors: (0..frames.len()).map(|s| errors.relative_of_frame(s)).collect(),
        frame_means,
        local,
        local_frames,
        denoised: None,
        unconverged_cells: 0,
        is_missed: false,
        is_late: false,
    }
}

/// The local errors of all frames together, and of each.
fn local(
    frames: usize,
    cell_map: &CellMap,
    blocks: &[BlockResult],
) -> (Option<LocalErrorSummary>, Vec<Option<LocalErrorSummary>>) {
    let grid = cell_map.grid();
    let (mut all, mut of_frames) = (Vec::new(), Vec::new());
    for frame in 0..frames {
        let mut cells = vec![Sums::default(); grid.cells()];
        for block in blocks {
            for (cell, sums) in block.cells[frame].iter().enumerate() {
                cells[grid.of_block(block.x0, block.y0, cell)] = *sums;
            }
        }
        let (errors, local) = cell_map.judge(&cells);
        all.extend(errors.iter().zip(&cells).map(|(error, sums)| (*error, sums.values / 3)));
        of_frames.push(local);
    }
    (LocalErrorSummary::of(all.into_iter()), of_frames)
}
