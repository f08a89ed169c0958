//! The shape of a method: tiles in; decoded frames, bits and seconds out.

use super::curve::{Curve, tally};
use super::tiles::{Texels, Tile, TileSet};
use crate::Result;
use crate::clock::Clock;
use dataset::host::signals::stop_if_interrupted;
use rayon::prelude::*;

/// A method's result for one image, or for one tile's images.
#[derive(Clone, Debug)]
pub(super) struct Coded<T> {
    /// What its decoder gives: never negative, always finite.
    pub decoded: T,
    /// All bits that the decoder needs.
    pub bits: f64,
    /// CPU seconds.
    pub encode_seconds: f64,
    /// CPU seconds.
    pub decode_seconds: f64,
    /// The transfer curves chosen, where there was a choice.
    pub curves: Vec<Curve>,
}

/// A tile at every frame.
pub(super) type CodedTile = Coded<Vec<Texels>>;
/// All tiles.
pub(super) type CodedTiles = Coded<Vec<Vec<Texels>>>;

/// The images of all tiles at an hour.
pub(super) type AtHour<'a> = Box<dyn Fn(f64) -> Result<Vec<Texels>> + 'a>;

/// A variant of a method.
pub(super) struct Way<'a> {
    pub coded: CodedTiles,
    pub note: String,
    /// What its decoder gives between frames too; without it, light is linear between those around.
    pub at_hour: Option<AtHour<'a>>,
}

impl Way<'_> {
    /// One that has nothing of its own between frames.
    pub(super) fn new(coded: CodedTiles, note: String) -> Self {
        Way { coded, note, at_hour: None }
    }
}

/// The variants of one method; the best is shown.
pub(super) type Ways<'a> = Vec<Way<'a>>;

/// A row of the table to be.
pub(super) struct Method<'a> {
    pub family: &'static str,
    pub name: String,
    pub run: Box<dyn Fn() -> Result<Ways<'a>> + 'a>,
}

/// Runs an encoder, then its decoder, on this thread and takes their times. The decoder gets what was
/// encoded.
pub(super) fn timed<E, T>(
    encode: impl FnOnce() -> Result<(E, f64, Vec<Curve>)>,
    decode: impl FnOnce(&E) -> Result<T>,
) -> Result<Coded<T>> {
    let clock = Clock::start();
    let (encoded, bits, curves) = encode()?;
    let encode_seconds = clock.seconds();
    let clock = Clock::start();
    let decoded = decode(&encoded)?;
    Ok(Coded { decoded, bits, encode_seconds, decode_seconds: clock.seconds(), curves })
}

/// Items one after the other: their decoded parts in a list, the rest summed.
pub(super) fn together<T>(parts: impl IntoIterator<Item = Coded<T>>) -> Coded<Vec<T>> {
    let mut all = Coded {
        decoded: Vec::new(),
        bits: 0.0,
        encode_seconds: 0.0,
        decode_seconds: 0.0,
        curves: Vec::new(),
    };
    for part in parts {
        all.decoded.push(part.decoded);
        all.bits += part.bits;
        all.encode_seconds += part.encode_seconds;
        all.decode_seconds += part.decode_seconds;
        all.curves.extend(part.curves);
    }
    all
}

/// A method that compresses each tile by itself.
pub(super) fn each_tile(
    set: &TileSet,
    method: impl Fn(&Tile) -> Result<CodedTile> + Sync,
) -> Result<CodedTiles> {
    let tiles: Vec<CodedTile> = set
        .tiles
        .par_iter()
        .with_max_len(1)
        .map(|tile| {
            stop_if_interrupted()?;
            method(tile)
        })
        .collect::<Result<_>>()?;
    Ok(together(tiles))
}

/// A codec of single images: the texels, width and height in; multiples of 4.
pub(super) trait ImageCodec: Sync {
    /// Compresses an image, whose valid texels decide the choices that there are.
    fn code(&self, texels: &Texels, tile: &Tile) -> Result<Coded<Texels>>;
}

/// A method that compresses every image of every tile by itself.
#[cfg(feature = "baselines")]
pub(super) fn each_image(set: &TileSet, codec: &dyn ImageCodec) -> Result<CodedTiles> {
    each_tile(set, |tile| {
        let images = tile.filled.iter().map(|texels| codec.code(texels, tile));
        Ok(together(images.collect::<Result<Vec<_>>>()?))
    })
}

/// Squared error over the valid texels.
pub(super) fn squared_error(decoded: &Texels, wanted: &Texels, tile: &Tile) -> f64 {
    let of = |i: usize| {
        let error = |c: usize| f64::from(decoded[i][c]) - f64::from(wanted[i][c]);
        (0..3).map(|c| error(c).powi(2)).sum::<f64>()
    };
    tile.valid().map(of).sum()
}

/// Errors relative to the peak are told apart down to this (100 dB).
const LEAST_ERROR: f64 = 1e-10;

/// Per frame: the mean squared error relative to the peak; none of a black one.
pub(super) fn relative_errors(tile: &Tile, decoded: &[Texels]) -> Vec<Option<f64>> {
    let values = (3 * tile.valid().count()).max(1) as f64;
    let of = |(k, texels): (usize, &Texels)| {
        let error = squared_error(texels, &tile.source.frames[k], tile) / values;
        (tile.peaks[k] > 0.0).then(|| (error / f64::from(tile.peaks[k]).powi(2)).max(LEAST_ERROR))
    };
    decoded.iter().enumerate().map(of).collect()
}

/// Rounds of weighting; after the eighth little changes.
pub(super) const ROUNDS: usize = 8;

/// What has the highest mean PSNR of this many rounds, and the mean over the lit frames of the logarithm of
/// its error. Each round encodes by weights of the frames' squared errors: 1 at first, then 1 ÷ the last
/// round's relative error, which is its derivative in Σ ln error; black frames have 0.
pub(super) fn reweighted<S>(
    tile: &Tile,
    rounds: usize,
    mut encode: impl FnMut(&[f64]) -> S,
    decode: impl Fn(&S) -> Vec<Texels>,
) -> (S, f64) {
    let mut best: Option<(S, f64)> = None;
    let mut weights: Vec<f64> = tile.peaks.iter().map(|&peak| if peak > 0.0 { 1.0 } else { 0.0 }).collect();
    for _ in 0..rounds {
        let stored = encode(&weights);
        let errors = relative_errors(tile, &decode(&stored));
        let logarithms: Vec<f64> = errors.iter().flatten().map(|error| error.ln()).collect();
        let mean = logarithms.iter().sum::<f64>() / logarithms.len().max(1) as f64;
        weights = errors.iter().map(|error| error.map_or(0.0, |error| 1.0 / error)).collect();
        if best.as_ref().is_none_or(|(_, least)| mean < *least) {
            best = Some((stored, mean));
        }
    }
    best.expect("there is a round")
}

impl<T> Coded<T> {
    pub(super) fn note(&self) -> String {
        if self.curves.is_empty() { String::new() } else { tally(self.curves.iter().copied()) }
    }
}
