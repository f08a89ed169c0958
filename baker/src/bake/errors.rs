//! How wrong the bake is at this moment: the difference of two independently scrambled halves, per tile and set.
//!
//! With A and B the halves' means, the estimate is (A + B)/2 and its squared standard error is estimated by ((A − B)/2)².
//! (A running variance of low-discrepancy points would overestimate it.)

use super::plan::Plan;
use super::state::BlockState;
use crate::Rgb;
use crate::surface::BLOCK;
use dataset::tiles::TILE;

/// Error and light of one tile at one set, as sums over valid texels and channels.
#[derive(Clone, Copy, Debug, Default)]
pub struct Sums {
    /// Texels × channels.
    pub values: u64,
    /// Sum of squared standard errors.
    pub squared_error: f64,
    /// Sum of values.
    pub light: f64,
}

impl Sums {
    fn add(&mut self, other: &Sums) {
        self.values += other.values;
        self.squared_error += other.squared_error;
        self.light += other.light;
    }

    /// Mean squared standard error.
    pub fn mse(&self) -> f64 {
        if self.values == 0 { 0.0 } else { self.squared_error / self.values as f64 }
    }

    /// Mean value.
    pub fn mean(&self) -> f64 {
        if self.values == 0 { 0.0 } else { self.light / self.values as f64 }
    }
}

/// The error of a whole page, per set and metric tile.
#[derive(Clone, Debug)]
pub struct Errors {
    /// Metric tiles across.
    pub columns: usize,
    /// `tiles[set][tile]`.
    pub tiles: Vec<Vec<Sums>>,
}

/// Whether enough of a texel's samples lie outside solids for it to count as surface.
pub fn is_exposed(exposed: [u32; 2], samples: u32) -> bool {
    const LEAST_SHARE: u32 = 8;
    exposed[0] > 0 && exposed[1] > 0 && (exposed[0] + exposed[1]) * LEAST_SHARE >= samples
}

/// Whether any light reached a texel in any layer: what lies in the ground or between two bodies gets none.
pub fn is_lit(sums: &[Rgb]) -> bool {
    sums.iter().any(|s| *s != Rgb::ZERO)
}

/// The sums of one block for every set: a block lies in one metric tile.
pub fn of_block(plan: &Plan, state: &BlockState) -> Vec<Sums> {
    let layers = plan.layers();
    (0..plan.moments.len())
        .map(|moment| {
            let parts = plan.layers_of(moment);
            let mut sums = Sums::default();
            for (texel, &exposed) in state.exposed.iter().enumerate() {
                let sums_of_texel = &state.sums[texel * 2 * layers..(texel + 1) * 2 * layers];
                if !is_exposed(exposed, state.samples) || !is_lit(sums_of_texel) {
                    continue;
                }
                let half = |h: usize| {
                    let from = (texel * 2 + h) * layers;
                    parts.iter().map(|&l| state.sums[from + l].as_dvec3()).sum::<glam::DVec3>()
                        / f64::from(exposed[h])
                };
                let (a, b) = (half(0), half(1));
                sums.values += 3;
                sums.squared_error += ((a - b) * 0.5).length_squared();
                sums.light += ((a + b) * 0.5).element_sum();
            }
            sums
        })
        .collect()
}

impl Errors {
    /// An empty table for a page.
    pub fn new(width: usize, height: usize, sets: usize) -> Self {
        let columns = width.div_ceil(TILE);
        Errors { columns, tiles: vec![vec![Sums::default(); columns * height.div_ceil(TILE)]; sets] }
    }

    /// Adds the sums of the block whose top left texel is (x0, y0).
    pub fn add(&mut self, x0: usize, y0: usize, block: &[Sums]) {
        const { assert!(TILE.is_multiple_of(BLOCK)) };
        let tile = (y0 / TILE) * self.columns + x0 / TILE;
        for (set, sums) in self.tiles.iter_mut().zip(block) {
            set[tile].add(sums);
        }
    }

    /// The whole page at one set.
    pub fn set(&self, set: usize) -> Sums {
        let mut all = Sums::default();
        self.tiles[set].iter().for_each(|t| all.add(t));
        all
    }

    /// Relative error of one set over the whole page; `None` without light.
    pub fn relative_of_set(&self, set: usize) -> Option<f64> {
        let all = self.set(set);
        (all.light > 0.0).then(|| dataset::metrics::relative_error(all.mse(), all.mean(), all.mean()))
    }

    /// Relative error of every (tile, set) with light, by the project's one definition.
    pub fn relative(&self) -> Vec<f64> {
        let mut all = Vec::new();
        for (set, tiles) in self.tiles.iter().enumerate() {
            let set_mean = self.set(set).mean();
            if set_mean > 0.0 {
                let lit = tiles.iter().filter(|t| t.values > 0);
                all.extend(lit.map(|t| dataset::metrics::relative_error(t.mse(), t.mean(), set_mean)));
            }
        }
        all
    }
}
