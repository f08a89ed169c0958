//! What misses a target error of light as it would be stored: with its noise taken out, where that is asked
//! for.

use super::folder::{FilteredLayer, Layers, Texel, each_sum};
use crate::Result;
use crate::bake::errors::{CellMap, LocalErrorSummary, Pieces, Sums, TargetJudgement, UnconvergedCells};
use crate::bake::prepare::Part;
use crate::bake::store::Parts;

/// Some layers of a page, and the frames that are made of them.
pub(crate) struct StoredLight<'a> {
    /// Where they are kept.
    pub folder: &'a Layers,
    /// Per layer its digest, the parts that lightmaps hold, and what a filter left of it.
    pub layers: Vec<(&'a String, &'static [Part], Option<FilteredLayer>)>,
    /// Per frame, which of them.
    pub frames: Vec<Parts>,
    /// The covered texels.
    pub texels: &'a [Texel],
    /// Which of them are valid.
    pub valid: Vec<bool>,
    /// Where cells are.
    pub cell_map: &'a CellMap,
    /// Where the texels are among them.
    pub pieces: Pieces,
    /// Width of the page.
    pub width: usize,
}

impl StoredLight<'_> {
    /// Error and light of a frame, cell by cell.
    fn cells(&self, frame: usize) -> Result<Vec<Sums>> {
        let mut readers = Vec::new();
        for &(layer, scale) in &self.frames[frame] {
            let (digest, parts, filtered) = &self.layers[layer];
            for &part in *parts {
                readers.push((self.folder.reader_of(digest, part, filtered.as_ref())?, scale));
            }
        }
        let mut sums = self.pieces.sums();
        each_sum(&readers, self.texels.len(), |texel, value| {
            if self.valid[texel] {
                self.pieces.add_texel(texel, value, &mut sums);
            }
        })?;
        let mut cells = vec![Sums::default(); self.cell_map.grid().cells()];
        self.pieces.add_to_cells(&sums, &mut cells);
        Ok(cells)
    }

    /// Per cell, the texels that light could reach.
    fn usable(&self) -> Vec<u32> {
        let mut usable = vec![0; self.cell_map.grid().cells()];
        for texel in self.texels.iter().filter(|texel| texel.usable == 1) {
            let index = texel.index as usize;
            usable[self.cell_map.grid().at(index % self.width, index / self.width)] += 1;
        }
        usable
    }

    /// Whether a frame misses the target.
    pub(crate) fn misses_target(&self, frame: usize, target: f64) -> Result<bool> {
        let mut unconverged = UnconvergedCells::none(self.cell_map.grid());
        unconverged.judge(self.cell_map, target, &self.cells(frame)?, &self.usable());
        Ok(!unconverged.is_met())
    }

    /// All frames against the target.
    pub(crate) fn judge(&self, target: f64) -> Result<TargetJudgement> {
        let usable = self.usable();
        let mut unconverged = UnconvergedCells::none(self.cell_map.grid());
        let mut errors = Vec::new();
        for frame in 0..self.frames.len() {
            let cells = self.cells(frame)?;
            unconverged.judge(self.cell_map, target, &cells, &usable);
            let of_cells = self.cell_map.errors(&cells);
            errors.extend(of_cells.into_iter().zip(&cells).map(|(error, sums)| (error, sums.values / 3)));
        }
        Ok(TargetJudgement { unconverged, local: LocalErrorSummary::of(errors.into_iter()) })
    }
}
