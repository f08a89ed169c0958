//! How wrong the bake is at this time: the difference of two independently scrambled halves, per tile and
//! frame.
//!
//! With A and B the halves' means, the estimate is (A + B)/2 and its squared standard error is estimated by
//! ((A − B)/2)². (A running variance of low-discrepancy points would overestimate it.)

use crate::bake::store::Value;
use crate::surface::BLOCK;
use dataset::format::TILE;
use dataset::pictures::metrics::relative_error;

/// Error and light of some texels at one frame, as sums over valid texels and channels.
#[derive(Clone, Copy, Debug, Default)]
pub struct Sums {
    /// Texels × channels.
    pub values: u64,
    /// Sum of squared standard errors.
    pub squared_error: f64,
    /// Sum of the estimated squared biases of the filter. The estimate is unbiased, so this may be negative.
    pub squared_bias: f64,
    /// Sum of the squared standard errors before filtering.
    pub variance_before: f64,
    /// Sum of values.
    pub light: f64,
    /// Sum of squared standard errors, each ÷ the square of the mean light of its own piece
    /// ([`super::local_errors`]); 0 where nobody asks for it.
    pub local: f64,
    /// `squared_bias`, made relative in the same way.
    pub local_squared_bias: f64,
    /// `variance_before`, likewise.
    pub local_variance_before: f64,
}

impl Sums {
    /// Adds other texels.
    pub fn add(&mut self, other: &Sums) {
        self.values += other.values;
        self.squared_error += other.squared_error;
        self.squared_bias += other.squared_bias;
        self.variance_before += other.variance_before;
        self.light += other.light;
        self.local += other.local;
        self.local_squared_bias += other.local_squared_bias;
        self.local_variance_before += other.local_variance_before;
    }

    /// Adds a texel.
    pub fn add_texel(&mut self, value: &Value) {
        self.values += 3;
        self.squared_error += value.variance();
        self.squared_bias += value.squared_bias();
        self.variance_before += value.noise.as_dvec3().length_squared();
        self.light += value.mean.as_dvec3().element_sum();
    }

    /// Mean squared error.
    pub fn mse(&self) -> f64 {
        if self.values == 0 {
            0.0
        } else {
            (self.squared_error + self.squared_bias.max(0.0)) / self.values as f64
        }
    }

    /// Mean value.
    pub fn mean(&self) -> f64 {
        if self.values == 0 { 0.0 } else { self.light / self.values as f64 }
    }
}

/// The error of a whole page, per frame and metric tile.
#[derive(Clone, Debug)]
pub struct Errors {
    /// Metric tiles across.
    pub columns: usize,
    /// `tiles[frame][tile]`.
    pub tiles: Vec<Vec<Sums>>,
}

/// The one in the middle of sorted values, of two the greater; 0 of none.
pub(crate) fn median(sorted: &[f64]) -> f64 {
    sorted.get(sorted.len() / 2).copied().unwrap_or(0.0)
}

impl Errors {
    /// An empty table for a page.
    pub fn new(width: usize, height: usize, frames: usize) -> Self {
        let columns = width.div_ceil(TILE);
        Errors { columns, tiles: vec![vec![Sums::default(); columns * height.div_ceil(TILE)]; frames] }
    }

    /// Adds the sums of the texel or block whose top left texel is (x0, y0).
    pub fn add(&mut self, frame: usize, x0: usize, y0: usize, sums: &Sums) {
        const { assert!(TILE.is_multiple_of(BLOCK)) };
        self.tiles[frame][(y0 / TILE) * self.columns + x0 / TILE].add(sums);
    }

    /// The whole page at one frame.
    pub fn frame(&self, frame: usize) -> Sums {
        let mut all = Sums::default();
        self.tiles[frame].iter().for_each(|t| all.add(t));
        all
    }

    /// Relative error of one frame over the whole page; `None` without light.
    pub fn relative_of_frame(&self, frame: usize) -> Option<f64> {
        let all = self.frame(frame);
        (all.light > 0.0).then(|| relative_error(all.mse(), all.mean(), all.mean()))
    }

    /// Relative error of every (tile, frame) with light, by the project's one definition. Where something
    /// `shines` and no frame has light, all of it may be missing: 1.
    pub fn relative(&self, shines: bool) -> Vec<f64> {
        let mut all = Vec::new();
        for (frame, tiles) in self.tiles.iter().enumerate() {
            let frame_mean = self.frame(frame).mean();
            if frame_mean > 0.0 {
                let lit = tiles.iter().filter(|t| t.values > 0);
                all.extend(lit.map(|t| relative_error(t.mse(), t.mean(), frame_mean)));
            }
        }
        if all.is_empty() && shines {
            all.push(1.0);
        }
        all
    }
}
