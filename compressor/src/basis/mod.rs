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

/// A source of a tile, transformed: for trying several steps.
#[derive(Clone, Debug)]
pub struct Fitted {
    transformed: klt::Transformed,
    coverage: Vec<Coverage>,
    source: u16,
    size: [usize; 2],
    chroma: u8,
    is_linear: bool,
}

impl Fitted {
    /// Of a source's light on a tile of stored width and height. `chroma`: colour differences count this over
    /// 16 as much as luminance.
    pub fn new(
        light: &SourceLight,
        coverage: &[Coverage],
        size: [usize; 2],
        chroma: u8,
        is_linear: bool,
    ) -> Self {
        let scale = f64::from(chroma) / 16.0;
        let transformed = klt::Transformed::new(light, coverage, scale, is_linear);
        Fitted { transformed, coverage: coverage.to_vec(), source: light.source, size, chroma, is_linear }
    }

    /// The light source: [`SourceLight::source`].
    pub fn source(&self) -> u16 {
        self.source
    }

    /// Its planes at a step, and their bytes.
    pub fn quantised(&self, quantiser: &Quantiser) -> (PlaneSet, Vec<u8>) {
        let Fitted { transformed, coverage, source, size, chroma, is_linear } = self;
        quantise::quantise(transformed, coverage, *source, *size, *chroma, *is_linear, quantiser)
    }
}
