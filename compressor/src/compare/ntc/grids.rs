//! The two feature grids of every tile: where they lie among the parameters, how a texel reads them, how they
//! are rounded.

use super::super::tiles::TileSet;
use super::Preset;
use super::network::INPUTS;
use crate::train::targets::Random;

/// Sine and cosine of three octaves along both axes; repeats every eight texels.
const POSITION: usize = 12;

/// Where the grids of all tiles lie: first those of high resolution, then the others.
#[derive(Clone, Debug)]
pub(super) struct Layout {
    tiles: Vec<TileLayout>,
    features: [usize; 2],
    /// Parameters of all grids of high resolution, and of all.
    pub high: usize,
    pub len: usize,
}

#[derive(Clone, Debug)]
struct TileLayout {
    width: usize,
    /// First parameter of both grids.
    start: [usize; 2],
    /// Cells across, of both.
    across: [usize; 2],
    columns: Vec<Reading>,
    rows: Vec<Reading>,
}

/// What a texel reads along one axis.
#[derive(Clone, Copy, Debug)]
struct Reading {
    /// The two cells of the grid of high resolution.
    high: [usize; 2],
    /// Those of the other, and the share of the second.
    low: [usize; 2],
    share: f32,
    position: [f32; POSITION / 2],
}

/// The two cells around a texel's centre on an axis of n cells of `scale` texels, and the share of the
/// second; clamped at the ends.
fn around(x: usize, scale: usize, n: usize) -> ([usize; 2], f32) {
    let p = ((x as f32 + 0.5) / scale as f32 - 0.5).max(0.0);
    let i = (p as usize).min(n - 1);
    ([i, (i + 1).min(n - 1)], p - i as f32)
}

impl Layout {
    /// Of the tiles of a run.
    pub(super) fn new(set: &TileSet, preset: &Preset) -> Self {
        let scales = [preset.scale, 2 * preset.scale];
        let axis = |side: usize| -> Vec<Reading> {
            let reading = |x: usize| {
                let [high, low] = scales.map(|scale| around(x, scale, side.div_ceil(scale)));
                let octave = |i: usize| {
                    let angle = std::f32::consts::TAU * (x as f32 + 0.5) / (8 >> (i / 2)) as f32;
                    if i.is_multiple_of(2) { angle.sin() } else { angle.cos() }
                };
                Reading { high: high.0, low: low.0, share: low.1, position: std::array::from_fn(octave) }
            };
            (0..side).map(reading).collect()
        };
        let mut tiles: Vec<TileLayout> = Vec::new();
        let mut start = [0, 0];
        for tile in &set.tiles {
            let (width, height) = (tile.source.width, tile.source.height);
            let across = scales.map(|scale| width.div_ceil(scale));
            tiles.push(TileLayout { width, start, across, columns: axis(width), rows: axis(height) });
            for grid in 0..2 {
                start[grid] += across[grid] * height.div_ceil(scales[grid]) * preset.features[grid];
            }
        }
        let [high, low] = start;
        tiles.iter_mut().for_each(|tile| tile.start[1] += high);
        Layout { tiles, features: preset.features, high, len: high + low }
    }

    /// Bits of all grids.
    pub(super) fn bits(&self, preset: &Preset) -> f64 {
        let counts = [self.high, self.len - self.high];
        counts.iter().zip(preset.bits).map(|(&count, bits)| count as f64 * f64::from(bits)).sum()
    }

    /// Reads a texel's inputs: four cells, the low-resolution grid, the position.
    #[inline(always)]
    pub(super) fn read(&self, grids: &[f32], tile: usize, texel: usize, out: &mut [f32; INPUTS]) {
        let [high, low] = self.features;
        self.cells(tile, texel, |i, cell| {
            out[i * high..(i + 1) * high].copy_from_slice(&grids[cell..cell + high]);
        });
        let sums = &mut out[4 * high..4 * high + low];
        sums.fill(0.0);
        self.corners(tile, texel, |cell, share| {
            sums.iter_mut().zip(&grids[cell..cell + low]).for_each(|(sum, value)| *sum += share * value);
        });
        let tile = &self.tiles[tile];
        let positions = [tile.columns[texel % tile.width], tile.rows[texel / tile.width]].map(|r| r.position);
        for (i, position) in positions.iter().enumerate() {
            let at = 4 * high + low + i * POSITION / 2;
            out[at..at + POSITION / 2].copy_from_slice(position);
        }
    }

    /// Adds a gradient of a texel's inputs to the grids'.
    #[inline(always)]
    pub(super) fn add(&self, gradient: &mut [f32], tile: usize, texel: usize, of_inputs: &[f32; INPUTS]) {
        let [high, low] = self.features;
        self.cells(tile, texel, |i, cell| {
            let of = &of_inputs[i * high..(i + 1) * high];
            gradient[cell..cell + high].iter_mut().zip(of).for_each(|(sum, d)| *sum += d);
        });
        self.corners(tile, texel, |cell, share| {
            let of = &of_inputs[4 * high..4 * high + low];
            gradient[cell..cell + low].iter_mut().zip(of).for_each(|(sum, d)| *sum += share * d);
        });
    }

    /// The first parameter of each of the four cells of high resolution.
    #[inline(always)]
    fn cells(&self, tile: usize, texel: usize, mut each: impl FnMut(usize, usize)) {
        let tile = &self.tiles[tile];
        let (x, y) = (tile.columns[texel % tile.width].high, tile.rows[texel / tile.width].high);
        for i in 0..4 {
            each(i, tile.start[0] + (y[i / 2] * tile.across[0] + x[i % 2]) * self.features[0]);
        }
    }

    /// The first parameter of each of the four cells of low resolution, with its share.
    #[inline(always)]
    fn corners(&self, tile: usize, texel: usize, mut each: impl FnMut(usize, f32)) {
        let tile = &self.tiles[tile];
        let (column, row) = (&tile.columns[texel % tile.width], &tile.rows[texel / tile.width]);
        let [along, down] = [column.share, row.share].map(|share| [1.0 - share, share]);
        for i in 0..4 {
            let cell = row.low[i / 2] * tile.across[1] + column.low[i % 2];
            each(tile.start[1] + cell * self.features[1], down[i / 2] * along[i % 2]);
        }
    }
}

/// A quantiser of B bits: N = 2ᴮ steps of 1/N, rounded to −(N/2 − 1) … N/2 of them.
#[derive(Clone, Copy, Debug)]
pub(super) struct Quantiser {
    steps: f32,
}

impl Quantiser {
    /// Of this many bits.
    pub(super) fn new(bits: u32) -> Self {
        Quantiser { steps: (1u32 << bits) as f32 }
    }

    /// Where values are held while they are trained.
    pub(super) fn bounds(self) -> [f32; 2] {
        [-(self.steps - 1.0) / 2.0, self.steps / 2.0].map(|step| step / self.steps)
    }

    /// The value that is stored.
    pub(super) fn round(self, value: f32) -> f32 {
        (value * self.steps).round().clamp(1.0 - self.steps / 2.0, self.steps / 2.0) / self.steps
    }

    /// A value with uniform noise of a step's width.
    pub(super) fn noisy(self, value: f32, random: &mut Random) -> f32 {
        value + random.uniform(-0.5, 0.5) / self.steps
    }
}

#[cfg(test)]
mod tests {
    use super::super::super::testing::{set_of, tile_of};
    use super::super::PRESETS;
    use super::*;

    #[test]
    fn a_texel_reads_the_cells_around_it() {
        assert_eq!(around(0, 4, 3), ([0, 1], 0.0));
        assert_eq!(around(6, 4, 3), ([1, 2], 0.125));
        assert_eq!(around(11, 4, 3), ([2, 2], 0.375));
        // Two tiles of 8×8: the second's grids hold their own cell's number.
        let tile = tile_of(8, 8, vec![vec![[1.0; 3]; 64]; 2]);
        let set = set_of(vec![tile.clone(), tile], &[0.0, 12.0]);
        let layout = Layout::new(&set, &PRESETS[0]);
        assert_eq!((layout.high, layout.len), (2 * 4 * 12, 2 * (4 * 12 + 8)));
        let grids: Vec<f32> = (0..layout.len).map(|i| i as f32).collect();
        let mut inputs = [0.0; INPUTS];
        // Texel (5, 2): between cells 0 and 1 across and down, the low grid has one cell.
        layout.read(&grids, 1, 2 * 8 + 5, &mut inputs);
        let cells: Vec<f32> = (0..4).map(|i| inputs[12 * i]).collect();
        assert_eq!(cells, [48.0, 60.0, 72.0, 84.0]);
        assert_eq!(inputs[48], 96.0 + 8.0);
        assert!(
            inputs[56..68].iter().all(|wave| wave.abs() <= 1.0) && inputs[68..].iter().all(|&x| x == 0.0)
        );
    }

    #[test]
    fn rounding_gives_as_many_values_as_the_bits_tell() {
        for bits in [2, 4] {
            let quantiser = Quantiser::new(bits);
            let [low, high] = quantiser.bounds();
            let mut values: Vec<f32> =
                (0..=1000).map(|i| quantiser.round(low + (high - low) * i as f32 / 1000.0)).collect();
            values.dedup();
            assert_eq!(values.len(), 1 << bits);
            assert_eq!(values.last(), Some(&0.5));
        }
    }
}
