//! The coding `basis`: a tile's light as planes that all frames share, by the Karhunen–Loève transform over
//! time and colour, each light group apart.
//!
//! In: a band of tiles with its light. Out: a tile's section of planes and its brightness. Callers:
//! `compress`. `light` is what is transformed, `klt` finds what planes are best, `quantise` makes whole
//! numbers of them; `tile` does all of it.

mod light;
mod klt;
mod quantise;
mod tile;

pub use light::SourceLight;
pub use quantise::Quantiser;
pub use tile::{BasisTile, FittedTile};

use crate::planes::PlaneSet;
use crate::tile::Coverage;
use quantise::Blocks;

/// A source of a tile, transformed: for trying several steps.
#[derive(Clone, Debug)]
pub struct Fitted {
    transformed: klt::Transformed,
    blocks: Blocks,
    source: u16,
    chroma: u8,
}

impl Fitted {
    /// Of a source's light on a tile of stored width and height. `chroma`: colour differences count this over
    /// 16 as much as luminance.
    pub fn new(light: &SourceLight, coverage: &[Coverage], size: [usize; 2], chroma: u8) -> Self {
        let transformed = klt::Transformed::new(light, coverage, f64::from(chroma) / 16.0);
        Fitted { transformed, blocks: Blocks::new(coverage, size), source: light.source, chroma }
    }

    /// Its planes at a step, and their bytes.
    pub fn quantised(&self, quantiser: &Quantiser) -> (PlaneSet, Vec<u8>) {
        let set = PlaneSet { source: self.source, chroma: self.chroma, ..PlaneSet::default() };
        quantise::quantise(&self.transformed, &self.blocks, set, quantiser)
    }
}
