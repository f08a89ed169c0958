//! What misses a target error of light as it would be stored: with its noise taken out, where that is asked
//! for.

use super::errors::{Parts, Sums};
use super::layers::{FilteredLayer, Layers, Part, Texel};
use super::local::{Local, Pieces, Places};
use super::unconverged::UnconvergedCells;
use super::value::Value;
use crate::Result;

/// Some layers of a page, and the frames that are made of them.
pub struct Light<'a> {
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
    pub places: &'a Places,
    /// Width of the page.
    pub width: usize,
}

/// What came of judging light.
pub struct Judged {
    /// The cells that miss the target in some frame.
    pub unconverged: UnconvergedCells,
    /// Local errors of all frames together; `None` without light.
    pub local: Option<Local>,
}

impl Light<'_> {
    /// Error and light of a frame, cell by cell.
    fn cells(&self, frame: usize) -> Result<Vec<Sums>> {
        let mut sum = vec![Value::default(); self.texels.len()];
        for &(layer, scale) in &self.frames[frame] {
            let (digest, parts, filtered) = &self.layers[layer];
            let mut add = |i: usize, value: Value| sum[i] = sum[i].plus(value.times(scale));
            for &part in *parts {
                match filtered {
                    Some(filtered) if part == Part::Rest => self.folder.each_filtered(filtered, &mut add)?,
                    _ => self.folder.each(digest, part, &mut add)?,
                }
            }
        }
        let indices = self.texels.iter().map(|texel| texel.index as usize);
        let pieces = Pieces::of_texels(self.places, self.width, indices);
        let mut cells = vec![Sums::default(); self.places.grid().cells()];
        pieces.add_some(|i| self.valid[i].then_some(sum[i]), &mut cells);
        Ok(cells)
    }

    /// Per cell, the texels that light could reach.
    fn exposed(&self) -> Vec<u32> {
        let mut exposed = vec![0; self.places.grid().cells()];
        for texel in self.texels.iter().filter(|texel| texel.exposed == 1) {
            let index = texel.index as usize;
            exposed[self.places.grid().at(index % self.width, index / self.width)] += 1;
        }
        exposed
    }

    /// Whether a frame misses the target.
    pub fn is_missed(&self, frame: usize, target: f64) -> Result<bool> {
        let mut unconverged = UnconvergedCells::none(self.places.grid());
        unconverged.judge(self.places, target, &self.cells(frame)?, &self.exposed());
        Ok(!unconverged.is_met())
    }

    /// All frames against the target.
    pub fn judge(&self, target: f64) -> Result<Judged> {
        let exposed = self.exposed();
        let mut unconverged = UnconvergedCells::none(self.places.grid());
        let mut errors = Vec::new();
        for frame in 0..self.frames.len() {
            let cells = self.cells(frame)?;
            unconverged.judge(self.places, target, &cells, &exposed);
            let of_cells = self.places.errors(&cells);
            errors.extend(of_cells.into_iter().zip(&cells).map(|(error, sums)| (error, sums.values / 3)));
        }
        Ok(Judged { unconverged, local: Local::of(errors.into_iter()) })
    }
}
