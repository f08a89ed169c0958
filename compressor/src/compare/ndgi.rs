//! NDGI itself: the trainer of `compress`, on these tiles.

use super::method::{CodedTile, CodedTiles, each_tile, timed};
use super::tiles::{Texels, Tile, TileSet};
use crate::bundle::encode_payload;
use crate::compress::{Preset, of_tile, seed};
use crate::decode::TileDecoder;
use crate::model::{PAYLOAD, Profile, STORED, TileParams};
use crate::tile::TileSource;
use crate::time::Timeline;
use crate::train::{Aim, Recipe, TrainedTile, train};
use crate::{Error, Result, of_bundle};

/// A bundle's tiles overlap by their border: so many more texels are stored than there are.
const BORDERS: f64 = (STORED * STORED) as f64 / (PAYLOAD * PAYLOAD) as f64;

/// What a tile is trained with.
pub(super) fn recipe(preset: &Preset, of_seed: u64, tile: &Tile) -> Recipe {
    let (iterations, passes) = (preset.iterations, preset.passes);
    Recipe { iterations, passes, paper: false, seed: seed(of_seed, tile.place), aim: Aim::MeanPsnr }
}

/// Every tile by a profile and preset.
pub(super) fn code(set: &TileSet, profile: &Profile, preset: &Preset, of_seed: u64) -> Result<CodedTiles> {
    each_tile(set, |tile| {
        trained(tile, &set.timeline, |source| train(source, profile, &recipe(preset, of_seed, tile)))
    })
}

/// A tile as some training stores it.
pub(super) fn trained(
    tile: &Tile,
    timeline: &Timeline,
    train: impl FnOnce(&TileSource) -> Result<TrainedTile>,
) -> Result<CodedTile> {
    let encode = || {
        let params = train(&tile.source).map_err(|error| of_tile(tile.place, error))?.params;
        let bits = match &params {
            None => 0.0,
            Some(params) => {
                let payload = encode_payload(params).map_err(|what| Error::invalid("payload", what))?;
                8.0 * payload.bytes() as f64 * BORDERS
            }
        };
        Ok((params, bits, Vec::new()))
    };
    timed(encode, |params| decode(tile, timeline, params.as_ref()))
}

fn decode(tile: &Tile, timeline: &Timeline, params: Option<&TileParams>) -> Result<Vec<Texels>> {
    let hours = &tile.source.hours;
    let Some(params) = params else {
        return Ok(vec![vec![[0.0; 3]; tile.texels()]; hours.len()]);
    };
    let decoder = TileDecoder::new(params, timeline).map_err(of_bundle)?;
    Ok(hours.iter().map(|hour| decoder.decode_tile(&timeline.at(*hour))).collect())
}
